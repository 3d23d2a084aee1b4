import pickle
from dataclasses import dataclass

import numpy as np

from flightcal.campaign import run_function
from flightcal.campaign.store import RunStore
from flightcal.simulator import SimulationFailure, Trajectory
from flightcal.simulator.system import Switch
from tests import small
from tests.campaign.simulators import TIMES, Sleeper, executions, label, record
from tests.campaign.test_run import job, thetas


@dataclass(frozen=True)
class Fragile:
    """Fails where theta[0] is odd."""

    parameters = ("a", "b")
    channels = ("x", "y")
    heaters = ("h",)

    def simulate(self, theta):
        if theta[0] % 2:
            raise SimulationFailure(f"{theta[0]:g} is odd")
        nothing = np.zeros(0)
        return Trajectory(np.full((3, 2), theta[0]), np.ones((3, 1)), np.ones(1), Switch(nothing, nothing, nothing))

    def simulate_many(self, thetas):
        return [None if theta[0] % 2 else self.simulate(theta) for theta in thetas]


class Recording(Fragile):
    def run(self, theta):
        return record(theta, "timed out", "too slow")

    def run_many(self, thetas):
        raise AssertionError("the campaign's workers are the processes")


def test_a_simulation_that_fails_is_a_record_that_says_why():
    run, together = run_function(Fragile(), 3)
    records = run(thetas(3))
    assert together > 1
    assert [found.outcome for found in records] == ["finished", "not finite", "finished"]
    assert [found.message for found in records] == ["", "1 is odd", ""]
    assert records[1].temperatures.shape == (3, 2)
    assert np.isnan(records[1].temperatures).all()
    assert records[1].status.shape == (3, 1)


def test_a_simulator_that_makes_records_is_run_one_theta_at_a_time():
    run, together = run_function(Recording(), 3)
    assert together == 1
    assert [found.message for found in run(thetas(2))] == ["too slow"] * 2


def test_a_networks_run_function_travels_and_gives_what_the_simulator_gives(tmp_path):
    scenario, data = small.closed_loop(tmp_path)
    simulator = small.simulator_of(scenario, data, hours=2.0)
    run, _ = run_function(simulator, 121)
    there = pickle.loads(pickle.dumps(run))
    theta = small.theta_of(simulator)
    (found,) = there(theta[None])
    expected = simulator.simulate(theta)
    np.testing.assert_allclose(found.temperatures, expected.temperatures, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(found.status, expected.status)


def test_a_job_runs_only_what_has_no_record_and_tells_all_outcomes(tmp_path):
    given = job(tmp_path, Sleeper(tmp_path / "log"))
    given.store.write(thetas(4)[2], record(thetas(4)[2], "timed out"))
    assert given.record_missing(thetas(4)) == {"finished": 3, "timed out": 1}
    assert label(thetas(4)[2]) not in executions(tmp_path / "log")
    assert given.record_missing(thetas(4)) == {"finished": 3, "timed out": 1}
    assert executions(tmp_path / "log").total() == 3


def test_a_run_that_is_given_up_says_how_often_it_was_tried(tmp_path):
    given = job(tmp_path, Sleeper(tmp_path / "log"))
    assert given.give_up(thetas(1)[0], 3) == {"crashed": 1}
    assert given.recorded(thetas(1)[0]).attempts == 3


def test_a_record_has_the_theta_that_was_asked_for(tmp_path):
    given = job(tmp_path, Sleeper(tmp_path / "log"))
    given.record_missing(thetas(4))
    store = RunStore(given.store.folder, given.store.identity)
    assert [store.read(theta).temperatures.shape[0] for theta in thetas(4)] == [TIMES] * 4
