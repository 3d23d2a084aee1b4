from collections import Counter

import numpy as np
import pytest

from flightcal.campaign import Job, RunStore
from flightcal.campaign.cluster import local_cluster
from flightcal.campaign.run import run_missing
from flightcal.errors import RunError
from tests.campaign.simulators import CHANNELS, HEATERS, TIMES, Deadly, Sleeper, Various, executions, label


@pytest.fixture(scope="module")
def client():
    with local_cluster(2) as client:
        yield client


def job(folder, function):
    (folder / "runs").mkdir(exist_ok=True)
    return Job(function, RunStore(folder / "runs", "simulator"), TIMES, CHANNELS, HEATERS)


def thetas(count):
    return np.stack([np.arange(count), np.linspace(0.0, 1.0, count)], axis=1)


@pytest.mark.parametrize("chunk", [1, 7])
def test_every_theta_is_run_once_and_recorded(client, tmp_path, chunk):
    given = job(tmp_path, Sleeper(tmp_path / "log"))
    told = []
    outcomes = run_missing(client, given, thetas(50), chunk=chunk, on_progress=lambda found: told.append(found.total()))
    assert outcomes == {"finished": 50}
    assert told[-1] == 50
    assert told == sorted(told)
    assert executions(tmp_path / "log") == {label(theta): 1 for theta in thetas(50)}
    for theta in thetas(50):
        assert given.store.read(theta).temperatures[0, 0] == theta.sum()


def test_more_tasks_than_are_submitted_at_a_time(client, tmp_path, monkeypatch):
    monkeypatch.setattr("flightcal.campaign.run._MOST_SUBMITTED", 4)
    assert run_missing(client, job(tmp_path, Sleeper(tmp_path / "log")), thetas(30)) == {"finished": 30}


def test_what_has_a_record_is_not_run_again(client, tmp_path):
    run_missing(client, job(tmp_path, Sleeper(tmp_path / "log")), thetas(20)[::2])
    assert run_missing(client, job(tmp_path, Sleeper(tmp_path / "log")), thetas(20), chunk=3) == {"finished": 20}
    assert set(executions(tmp_path / "log").values()) == {1}


def test_failures_are_records_too_and_are_not_run_again(client, tmp_path):
    given = job(tmp_path, Various(tmp_path / "log"))
    expected = {"finished": 7, "timed out": 1, "not finite": 1, "crashed": 1}
    assert run_missing(client, given, thetas(10)) == expected
    assert run_missing(client, given, thetas(10)) == expected
    assert set(executions(tmp_path / "log").values()) == {1}
    found = given.store.read(thetas(10)[3])
    assert (found.outcome, found.message) == ("crashed", "ValueError: no such thing")
    assert np.isnan(found.temperatures).all()
    assert found.temperatures.shape == (TIMES, CHANNELS)


def test_an_error_costs_the_run_that_it_comes_from_and_no_other_of_its_task(client, tmp_path):
    outcomes = run_missing(client, job(tmp_path, Various(tmp_path / "log")), thetas(10), chunk=10)
    assert outcomes == {"finished": 7, "timed out": 1, "not finite": 1, "crashed": 1}


@pytest.mark.parametrize("chunk", [1, 4])
def test_a_worker_that_is_lost_costs_only_its_task(client, tmp_path, chunk):
    outcomes = run_missing(client, job(tmp_path, Deadly(tmp_path / "log")), thetas(40), chunk=chunk)
    assert outcomes == {"finished": 40}
    lost = {label(theta) for theta in thetas(40)[7 // chunk * chunk : 8]}
    assert executions(tmp_path / "log") == Counter(label(theta) for theta in thetas(40)) + Counter(lost)


@pytest.mark.slow
@pytest.mark.parametrize("chunk", [1, 4])
def test_a_run_that_kills_every_worker_is_recorded_as_crashed_and_costs_no_other(client, tmp_path, chunk):
    given = job(tmp_path, Deadly(tmp_path / "log", times=1000))
    assert run_missing(client, given, thetas(12), chunk=chunk) == {"finished": 11, "crashed": 1}
    assert "the worker process died" in given.store.read(thetas(12)[7]).message


def test_a_folder_that_the_workers_do_not_see_is_a_message(client, tmp_path):
    given = job(tmp_path, Sleeper(tmp_path / "log"))
    (tmp_path / "runs").rmdir()
    with pytest.raises(RunError, match="do all workers see the campaign's folder"):
        run_missing(client, given, thetas(3))
    assert not (tmp_path / "runs").exists()


@pytest.mark.slow
def test_workers_that_do_not_come_back_are_replaced(tmp_path, monkeypatch):
    monkeypatch.setattr("flightcal.campaign.run._RESTART", 2.0)
    with local_cluster(2) as client:
        told = []

        def lose_all(outcomes):
            if not told:
                client.cluster.scale(0)
            told.append(outcomes)

        given = job(tmp_path, Sleeper(tmp_path / "log", 0.05))
        assert run_missing(client, given, thetas(60), on_progress=lose_all) == {"finished": 60}
        assert len(client.nthreads()) >= 2
    assert executions(tmp_path / "log").total() <= 62


def test_a_damaged_record_is_run_again(client, tmp_path):
    given = job(tmp_path, Sleeper(tmp_path / "log"))
    run_missing(client, given, thetas(5))
    file = given.store.file(thetas(5)[2])
    file.write_bytes(file.read_bytes()[:200])
    assert run_missing(client, given, thetas(5)) == {"finished": 5}
    assert executions(tmp_path / "log")[label(thetas(5)[2])] == 2
    assert given.store.read(thetas(5)[2]).outcome == "finished"
