"""Whole campaigns: taken up again, retried, killed."""

import multiprocessing
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from flightcal.campaign import Design, Subject, open_campaign, run_campaign
from flightcal.campaign.campaign import outcomes_of
from flightcal.campaign.run import Here
from flightcal.campaign.store import RunStore
from flightcal.errors import RunError
from flightcal.progress import Silent
from tests.campaign.simulators import Deadly, Sleeper, Various, executions, label
from tests.campaign.test_run import thetas
from tests.told import Told

SUBJECT = Subject(
    {"simulator": "s"}, {}, ("a", "b"), ("x", "y"), ("h",), np.datetime64("2024-03-01", "ns") + np.arange(5)
)


def design(count):
    return Design("prior", 1, {}, thetas(count))


@contextmanager
def nothing():
    raise AssertionError("nothing is left to do, and yet workers are asked for")
    yield


@pytest.fixture
def connect():
    return lambda: nullcontext(Here(2))


def test_a_campaign_runs_all_once_and_its_repetition_none(connect, tmp_path):
    told = Told()
    tally = run_campaign(
        tmp_path / "c", SUBJECT, design(30), Sleeper(tmp_path / "log"), connect,
        together=4, progress=told,
    )  # fmt: skip
    assert (tally.outcomes, tally.left, tally.total) == ({"finished": 30}, 0, 30)
    first, left = told.said
    assert first == "found: 0 of 30 runs done; 30 left"
    assert re.fullmatch(r"4 done; the other 26 take about \d+ s, by the time of the first", left)
    assert told.stages["running"][-1] == (30, "30 of 30 runs done: 30 finished; 0 left")
    assert str(tally) == "30 of 30 runs done: 30 finished; 0 left"
    again = run_campaign(tmp_path / "c", SUBJECT, design(30), Sleeper(tmp_path / "log"), nothing)
    assert again == tally
    assert set(executions(tmp_path / "log").values()) == {1}


def test_a_campaign_that_grows_runs_only_what_is_new(connect, tmp_path):
    thetas_of = partial(np.random.default_rng(1).random, (50, 2))()
    for count in (20, 50, 30):
        given = Design("sobol", 1, {}, thetas_of[:count])
        tally = run_campaign(tmp_path / "c", SUBJECT, given, Sleeper(tmp_path / "log"), connect)
        assert tally.outcomes == {"finished": count}
    assert executions(tmp_path / "log") == {label(theta): 1 for theta in thetas_of}
    assert open_campaign(tmp_path / "c").sizes["run"] == 50


def test_failed_runs_are_run_again_only_when_asked(connect, tmp_path):
    def run(function, **options):
        return run_campaign(tmp_path / "c", SUBJECT, design(10), function(tmp_path / "log"), connect, **options)

    first = run(Various)
    assert first.outcomes == {"finished": 7, "timed out": 1, "not finite": 1, "crashed": 1}
    assert run(Sleeper) == first
    assert str(first).startswith("10 of 10 runs done: 7 finished, 1 ")
    assert run(Sleeper, retry_failed=True).outcomes == {"finished": 10}
    assert sorted(executions(tmp_path / "log").values()) == [1] * 7 + [2] * 3


def test_a_damaged_record_is_counted_and_run_again(connect, tmp_path):
    run = partial(run_campaign, tmp_path / "c", SUBJECT, design(10), Sleeper(tmp_path / "log"), connect)
    run()
    store = RunStore(tmp_path / "c" / "runs", SUBJECT.identity)
    store.file(thetas(10)[4]).write_bytes(b"")
    told = Told()
    assert run(progress=told).outcomes == {"finished": 10}
    assert told.said[0] == "found: 9 of 10 runs done: 9 finished; 1 left, 1 of them damaged"
    assert executions(tmp_path / "log").total() == 11


def test_a_folder_may_be_given_from_where_one_is(connect, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run_campaign(Path("c"), SUBJECT, design(5), Sleeper(tmp_path / "log"), connect).left == 0
    assert (tmp_path / "c" / "campaign.json").exists()


def test_a_theta_that_the_design_has_twice_is_run_once(connect, tmp_path):
    twice = np.concatenate([thetas(6), thetas(6)])
    run = Sleeper(tmp_path / "log")
    tally = run_campaign(tmp_path / "c", SUBJECT, Design("posterior", 1, {}, twice), run, connect)
    assert tally.outcomes == {"finished": 12}
    assert executions(tmp_path / "log").total() == 6


def test_a_store_that_cannot_be_written_is_a_message(connect, tmp_path):
    @contextmanager
    def connect_and_break():
        with connect() as runner:
            (tmp_path / "c" / "runs").rmdir()
            (tmp_path / "c" / "runs").write_text("a file where the folder should be")
            yield runner

    with pytest.raises(RunError, match="a worker cannot record its run"):
        run_campaign(tmp_path / "c", SUBJECT, design(3), Sleeper(tmp_path / "log"), connect_and_break)


# --- kills ---------------------------------------------------------------------------------------------------

SCRIPT = """
import sys
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from flightcal.campaign import run_campaign
from flightcal.campaign.run import Here
from tests.campaign.simulators import Deadly
from tests.campaign.test_campaign import SUBJECT, design

if __name__ == "__main__":
    folder, runs, seconds = Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
    tally = run_campaign(
        folder / "c", SUBJECT, design(runs), Deadly(folder / "log", seconds), partial(nullcontext, Here(2))
    )
    print(tally)
"""


def started(folder: Path, runs: int, seconds: float) -> subprocess.Popen:
    """The campaign in a process of its own, which leads a group of processes."""
    (folder / "script.py").write_text(SCRIPT)
    root = Path(__file__).parents[2]
    path = os.pathsep.join([str(root / "src"), str(root)])
    return subprocess.Popen(
        [sys.executable, str(folder / "script.py"), str(folder), str(runs), str(seconds)],
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def finished(folder: Path, runs: int) -> set[str]:
    """Labels of the runs that have a record."""
    store = RunStore(folder / "c" / "runs", SUBJECT.identity)
    given = thetas(runs)
    return {
        label(theta) for theta, outcome in zip(given, outcomes_of(store, given), strict=True) if outcome == "finished"
    }


def wait_for_runs(folder: Path, more: int, process: subprocess.Popen) -> None:
    """Until so many more runs have begun."""
    wanted = executions(folder / "log").total() + more
    deadline = time.monotonic() + 120
    while executions(folder / "log").total() < wanted and process.poll() is None:
        assert time.monotonic() < deadline, process.stderr.read()
        time.sleep(0.005)


def check_killed_campaign(connect, folder: Path, runs: int, seconds: float, kill_all: list[bool]) -> None:
    """Kill it with SIGKILL at random moments, resume, and count by the log that the simulated function itself keeps."""
    rng = np.random.default_rng()
    recorded, before = [], []
    for everything in kill_all:
        process = started(folder, runs, seconds)
        wait_for_runs(folder, int(rng.integers(1, runs // (len(kill_all) + 1))), process)
        time.sleep(rng.uniform(0.0, 3.0 * seconds))
        assert process.poll() is None
        if everything:
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()  # the workers must notice by themselves
        process.communicate()
        time.sleep(1.0)
        recorded.append(finished(folder, runs))
        before.append(executions(folder / "log"))
    tally = run_campaign(folder / "c", SUBJECT, design(runs), Deadly(folder / "log", seconds), connect)
    assert tally.outcomes == {"finished": runs}
    total = executions(folder / "log")
    assert set(total) == {label(theta) for theta in thetas(runs)}
    for done, log in zip(recorded, before, strict=True):
        # What had a record at a kill was never begun again.
        assert all(total[run] == log[run] for run in done)
    # Each kill, and the worker that theta[0] == 7 kills, costs at most what two workers had in flight.
    assert total.total() <= runs + 2 * len(kill_all) + 1
    data = open_campaign(folder / "c")
    assert (data["outcome"] == "finished").all()
    np.testing.assert_allclose(data["temperatures"].values[:, 0, 0], thetas(runs).sum(axis=1))


def test_a_campaign_that_is_killed_takes_up_where_it_was(connect, tmp_path):
    check_killed_campaign(connect, tmp_path, 100, 0.02, [False])


@pytest.mark.slow
def test_2000_runs_killed_three_times_at_random_are_all_done_and_none_twice(connect, tmp_path):
    check_killed_campaign(connect, tmp_path, 2000, 0.02, [True, False, True])


def test_ctrl_c_leaves_no_run_that_counts_as_a_crash_and_the_same_call_resumes(connect, tmp_path):
    process = started(tmp_path, 60, 0.05)
    wait_for_runs(tmp_path, 10, process)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    process.communicate(timeout=60)
    assert process.returncode != 0
    done = finished(tmp_path, 60)
    assert 5 < len(done) < 60
    data = open_campaign(tmp_path / "c")
    assert set(data["outcome"].values.tolist()) == {"finished", "not run"}
    before = executions(tmp_path / "log")
    assert run_campaign(tmp_path / "c", SUBJECT, design(60), Sleeper(tmp_path / "log"), connect).left == 0
    assert all(executions(tmp_path / "log")[run] == before[run] for run in done)


def test_a_worker_that_is_killed_from_outside_costs_only_its_run(connect, tmp_path):
    killed = []

    class KillOnce(Silent):
        def at(self, done, note=""):
            if not killed and done >= 10:
                killed.append(multiprocessing.active_children()[0])
                killed[0].kill()

    run = Deadly(tmp_path / "log", 0.02, times=0)
    tally = run_campaign(tmp_path / "c", SUBJECT, design(60), run, connect, progress=KillOnce())
    assert tally.outcomes == {"finished": 60}
    assert killed
    assert executions(tmp_path / "log").total() <= 61
