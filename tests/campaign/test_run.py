import logging
from collections import Counter

import dask
import numpy as np
import pytest
from distributed import Client, LocalCluster

from flightcal.campaign.cluster import Cluster
from flightcal.campaign.job import Job
from flightcal.campaign.run import Here
from flightcal.campaign.store import RunStore
from flightcal.errors import RunError
from tests.campaign.simulators import CHANNELS, HEATERS, TIMES, Deadly, Sleeper, Various, executions, label


@pytest.fixture(scope="module", params=["here", pytest.param("cluster", marks=pytest.mark.slow)])
def runner(request):
    if request.param == "here":
        yield Here(2)
        return
    settings = {
        # A worker holds the tasks that it runs and no others, so that one that is lost costs no other run a chance.
        "distributed.scheduler.worker-saturation": 1.0,
        "distributed.scheduler.allowed-failures": 2,
    }
    options = {"threads_per_worker": 1, "dashboard_address": "127.0.0.1:0", "silence_logs": logging.CRITICAL}
    with (
        dask.config.set(settings),
        LocalCluster(n_workers=2, **options) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        yield Cluster(client)


def job(folder, function):
    (folder / "runs").mkdir(exist_ok=True)
    return Job(function, RunStore(folder / "runs", "simulator"), TIMES, CHANNELS, HEATERS)


def thetas(count):
    return np.stack([np.arange(count), np.linspace(0.0, 1.0, count)], axis=1)


@pytest.mark.parametrize("chunk", [1, 7])
def test_every_theta_is_run_once_and_recorded(runner, tmp_path, chunk):
    given = job(tmp_path, Sleeper(tmp_path / "log"))
    told = []
    outcomes = runner.run_missing(given, thetas(50), chunk=chunk, on_progress=lambda found: told.append(found.total()))
    assert outcomes == {"finished": 50}
    assert told[-1] == 50
    assert told == sorted(told)
    assert executions(tmp_path / "log") == {label(theta): 1 for theta in thetas(50)}
    for theta in thetas(50):
        assert given.store.read(theta).temperatures[0, 0] == theta.sum()


def test_more_tasks_than_are_submitted_at_a_time(runner, tmp_path, monkeypatch):
    monkeypatch.setattr("flightcal.campaign.cluster._MOST_SUBMITTED", 4)
    assert runner.run_missing(job(tmp_path, Sleeper(tmp_path / "log")), thetas(30)) == {"finished": 30}


def test_what_has_a_record_is_not_run_again(runner, tmp_path):
    runner.run_missing(job(tmp_path, Sleeper(tmp_path / "log")), thetas(20)[::2])
    assert runner.run_missing(job(tmp_path, Sleeper(tmp_path / "log")), thetas(20), chunk=3) == {"finished": 20}
    assert set(executions(tmp_path / "log").values()) == {1}


def test_failures_are_records_too_and_are_not_run_again(runner, tmp_path):
    given = job(tmp_path, Various(tmp_path / "log"))
    expected = {"finished": 7, "timed out": 1, "not finite": 1, "crashed": 1}
    assert runner.run_missing(given, thetas(10)) == expected
    assert runner.run_missing(given, thetas(10)) == expected
    assert set(executions(tmp_path / "log").values()) == {1}
    found = given.store.read(thetas(10)[3])
    assert (found.outcome, found.message) == ("crashed", "ValueError: no such thing")
    assert np.isnan(found.temperatures).all()
    assert found.temperatures.shape == (TIMES, CHANNELS)


def test_an_error_costs_the_run_that_it_comes_from_and_no_other_of_its_task(runner, tmp_path):
    outcomes = runner.run_missing(job(tmp_path, Various(tmp_path / "log")), thetas(10), chunk=10)
    assert outcomes == {"finished": 7, "timed out": 1, "not finite": 1, "crashed": 1}


@pytest.mark.parametrize("chunk", [1, 4])
def test_a_worker_that_is_lost_costs_only_its_task(runner, tmp_path, chunk):
    outcomes = runner.run_missing(job(tmp_path, Deadly(tmp_path / "log")), thetas(40), chunk=chunk)
    assert outcomes == {"finished": 40}
    lost = {label(theta) for theta in thetas(40)[7 // chunk * chunk : 8]}
    assert executions(tmp_path / "log") == Counter(label(theta) for theta in thetas(40)) + Counter(lost)


@pytest.mark.slow
@pytest.mark.parametrize("chunk", [1, 4])
def test_a_run_that_kills_every_worker_is_recorded_as_crashed_and_costs_no_other(runner, tmp_path, chunk):
    given = job(tmp_path, Deadly(tmp_path / "log", times=1000))
    assert runner.run_missing(given, thetas(12), chunk=chunk) == {"finished": 11, "crashed": 1}
    found = given.store.read(thetas(12)[7])
    assert "the worker process died" in found.message
    # How often a cluster has tried is its own affair.
    assert found.attempts == (3 if isinstance(runner, Here) else 1)


def test_a_folder_that_the_workers_do_not_see_is_a_message(runner, tmp_path):
    given = job(tmp_path, Sleeper(tmp_path / "log"))
    (tmp_path / "runs").rmdir()
    with pytest.raises(RunError, match="do all workers see the campaign's folder"):
        runner.run_missing(given, thetas(3))
    assert not (tmp_path / "runs").exists()


def test_a_damaged_record_is_run_again(runner, tmp_path):
    given = job(tmp_path, Sleeper(tmp_path / "log"))
    runner.run_missing(given, thetas(5))
    file = given.store.file(thetas(5)[2])
    file.write_bytes(file.read_bytes()[:200])
    assert runner.run_missing(given, thetas(5)) == {"finished": 5}
    assert executions(tmp_path / "log")[label(thetas(5)[2])] == 2
    assert given.store.read(thetas(5)[2]).outcome == "finished"
