"""A Dask cluster that is already there."""

import logging
import threading
import time

import pytest
from distributed import LocalCluster
from typer.testing import CliRunner

from flightcal.campaign import open_campaign
from flightcal.campaign.cluster import remote_cluster
from flightcal.cli import app
from flightcal.errors import RunError
from tests.campaign.simulators import Sleeper, executions
from tests.campaign.test_run import job, thetas
from tests.commands.test_calibrate import write


@pytest.fixture
def cluster():
    options = {"threads_per_worker": 1, "dashboard_address": "127.0.0.1:0", "silence_logs": logging.CRITICAL}
    with LocalCluster(n_workers=1, **options) as cluster:
        yield cluster


def test_a_campaign_runs_on_a_scheduler_by_its_address_and_leaves_the_cluster_up(cluster, tmp_path):
    arguments = ["campaign", str(write(tmp_path)), "--runs", "20", "--out", str(tmp_path / "c")]
    result = CliRunner().invoke(app, [*arguments, "--scheduler", cluster.scheduler_address])
    assert result.exit_code == 0, result.output
    assert set(open_campaign(tmp_path / "c")["outcome"].values.tolist()) == {"finished"}
    with remote_cluster(cluster.scheduler_address) as reached:
        assert reached.client.submit(sum, [1, 2]).result() == 3


def test_a_scheduler_without_workers_is_a_message(cluster, monkeypatch):
    monkeypatch.setattr("flightcal.campaign.cluster._NO_WORKERS", 0.5)
    cluster.scale(0)
    while cluster.scheduler.workers:
        time.sleep(0.05)
    with pytest.raises(RunError, match=r"found no worker within 0\.5 s"), remote_cluster(cluster.scheduler_address):
        pass


@pytest.mark.slow
def test_a_scheduler_that_goes_away_is_a_message_and_the_runs_that_are_done_stay_done(cluster, tmp_path):
    given = job(tmp_path, Sleeper(tmp_path / "log", 0.05))
    with remote_cluster(cluster.scheduler_address) as runner:
        closing = threading.Thread(target=cluster.close)

        def close_once(outcomes):
            if outcomes.total() == 5:
                closing.start()

        with pytest.raises(RunError, match="the Dask scheduler is gone"):
            runner.run_missing(given, thetas(400), on_progress=close_once)
        closing.join()
    done = [theta for theta in thetas(400) if given.recorded(theta) is not None]
    assert 5 <= len(done) < 400
    assert len(done) <= executions(tmp_path / "log").total() <= len(done) + 1
