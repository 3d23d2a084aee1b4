import multiprocessing
import os
import time

import numpy as np
import pytest

from flightcal.campaign.store import DamagedRecord, RunStore
from flightcal.external.record import Record

THETA = np.array([0.1, -0.0, 1e300])


def files(store):
    return list(store.folder.glob("??/*.npz"))


def record(theta=THETA, outcome="finished", message="", fill=1.0):
    return Record(theta, outcome, message, 2, 0.25, np.full((4, 2), fill), np.full((4, 1), np.nan))


def assert_same(found, expected):
    for name, value in vars(expected).items():
        np.testing.assert_array_equal(getattr(found, name), value)
        assert type(getattr(found, name)) is type(value), name


def test_a_record_comes_back_as_it_was_written(tmp_path):
    store = RunStore(tmp_path, "simulator")
    assert store.read(THETA) is None
    store.write(THETA, record(message="µ: 3 \n of 4"))
    assert_same(store.read(THETA), record(message="µ: 3 \n of 4"))


def test_a_run_is_known_by_simulator_and_every_bit_of_theta(tmp_path):
    nudged = [np.where(np.arange(3) == k, np.nextafter(THETA, np.inf), THETA) for k in range(3)]
    thetas = [THETA, *nudged, THETA * [1.0, -1.0, 1.0], THETA[:2], THETA[[1, 0, 2]]]
    keys = {RunStore(tmp_path, identity).key(theta) for identity in ("simulator", "other") for theta in thetas}
    assert len(keys) == 14
    assert RunStore(tmp_path / "elsewhere", "simulator").key(THETA.copy()) == RunStore(tmp_path, "simulator").key(THETA)


def test_the_key_is_the_same_in_another_process(tmp_path):
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.apply(RunStore(tmp_path, "simulator").key, (THETA,)) == RunStore(tmp_path, "simulator").key(THETA)


def test_a_finished_run_is_not_replaced_by_one_that_failed(tmp_path):
    store = RunStore(tmp_path, "simulator")
    store.write(THETA, record(outcome="timed out"))
    store.write(THETA, record())
    store.write(THETA, record(outcome="crashed"))
    assert store.read(THETA).outcome == "finished"


def test_a_write_that_is_cut_short_leaves_what_there_was(tmp_path, monkeypatch):
    store = RunStore(tmp_path, "simulator")
    store.write(THETA, record(outcome="timed out"))

    def cut(*_):
        raise OSError("cut short")

    monkeypatch.setattr("flightcal.run.folder.os.replace", cut)
    for theta in (THETA, THETA + 1.0):
        with pytest.raises(OSError, match="cut short"):
            store.write(theta, record(theta))
    assert store.read(THETA).outcome == "timed out"
    assert store.read(THETA + 1.0) is None
    assert files(store) == [store.file(THETA)]


def test_a_discarded_record_is_gone(tmp_path):
    store = RunStore(tmp_path, "simulator")
    store.write(THETA, record())
    store.discard(THETA)
    store.discard(THETA)
    assert store.read(THETA) is None
    assert files(store) == []


@pytest.mark.parametrize("length", [0, 1, 30, 500, -1])
def test_a_truncated_file_is_damage_and_not_a_record(tmp_path, length):
    store = RunStore(tmp_path, "simulator")
    store.write(THETA, record())
    whole = store.file(THETA).read_bytes()
    store.file(THETA).write_bytes(whole[:length])
    with pytest.raises(DamagedRecord, match="damaged record"):
        store.read(THETA)
    store.write(THETA, record())
    assert store.file(THETA).read_bytes()[:64] == whole[:64]
    assert_same(store.read(THETA), record())


def test_a_flipped_bit_is_damage(tmp_path):
    """Anywhere in the numbers; in the format's own padding it may go unseen, but nothing else is read."""
    store = RunStore(tmp_path, "simulator")
    store.write(THETA, record(fill=np.pi))
    whole = store.file(THETA).read_bytes()
    place = whole.index(np.full(8, np.pi).tobytes())
    for byte in range(place, place + 64):
        store.file(THETA).write_bytes(whole[:byte] + bytes([whole[byte] ^ 4]) + whole[byte + 1 :])
        with pytest.raises(DamagedRecord):
            store.read(THETA)


def test_the_file_of_another_run_is_damage(tmp_path):
    store, other = RunStore(tmp_path, "simulator"), THETA + 1.0
    store.write(other, record(theta=other))
    store.file(THETA).parent.mkdir(exist_ok=True)
    store.file(other).rename(store.file(THETA))
    with pytest.raises(DamagedRecord, match="record of another run"):
        store.read(THETA)


def write_all(folder, start, count):
    store = RunStore(folder, "simulator")
    for k in range(count):
        theta = np.array([float((k + start) % count)])
        store.write(theta, record(theta=theta, fill=theta[0]))


def test_processes_that_write_the_same_runs_at_once_leave_each_run_once_and_whole(tmp_path):
    context = multiprocessing.get_context("fork")
    writers = [context.Process(target=write_all, args=(tmp_path, 25 * k, 100)) for k in range(4)]
    store = RunStore(tmp_path, "simulator")
    for writer in writers:
        writer.start()
    while any(writer.is_alive() for writer in writers):
        for k in range(100):
            found = store.read(np.array([float(k)]))  # never half of one
            assert found is None or found.temperatures[0, 0] == k
    assert [writer.exitcode for writer in writers] == [0] * 4
    assert len(files(store)) == 100
    assert len([file for file in tmp_path.rglob("*") if file.is_file()]) == 100


def test_a_writer_that_was_killed_leaves_nothing_that_counts_and_is_tidied_up(tmp_path):
    store = RunStore(tmp_path, "simulator")
    store.write(THETA, record())
    half = store.file(THETA).parent / f".{store.file(THETA).name}.x8f2k"
    half.write_bytes(store.file(THETA).read_bytes()[:100])
    store.discard(THETA)
    assert store.read(THETA) is None
    assert files(store) == []
    store.tidy()
    assert half.exists()  # a writer may be at it
    os.utime(half, (time.time() - 7200.0,) * 2)
    store.tidy()
    assert not half.exists()
