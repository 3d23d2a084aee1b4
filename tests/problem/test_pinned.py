"""Heaters that switch more often than telemetry shows."""

import numpy as np
import pytest
import xarray

from flightcal.check import suspects
from flightcal.problem import PIN, build_problem, fast_heaters, pinned, pinned_heaters, unseen_heaters
from flightcal.simulator import open_loop
from tests import small

ALL = (np.datetime64("2024-03-01"), np.datetime64("2024-03-02"))
THETA = {"link": 0.65, "panel_size": 1.1, "power": 28.0, "capacity": 300.0, "initial_panel": 262.0}


def held(scenario, data):
    """Scenario and telemetry with what can be held in all of it."""
    return pinned(scenario, data, unseen_heaters(scenario, data, [ALL]))


def fast():
    """The small satellite with a light body, which its heater warms in half a minute."""
    written = small.content()
    del written["heat"]
    written["simulator"]["nodes"]["body"]["capacity"] = "300 J/K"
    written["parameters"]["capacity"] = {
        "sets": "nodes.body.capacity",
        "prior": {"lognormal": {"median": "300 J/K", "factor": 1.2}},
    }
    return written


def without_status(written):
    del written["simulator"]["heaters"]["heater"]["measured_by"], written["observations"]["heater_status"]
    return written


def opened(problem):
    (window,) = problem.open_loop.windows
    return window


@pytest.fixture
def told(tmp_path):
    """Scenario and telemetry with a status."""
    return small.closed_loop(tmp_path, fast(), **THETA)


def test_the_node_of_such_a_heater_is_at_its_measured_temperature_in_open_loop(told):
    problem = build_problem(*told)
    window = opened(problem)
    assert pinned_heaters(window.scenario) == ("heater",)
    assert pinned_heaters(problem.windows[0].scenario) == ()
    theta = problem.at(window, problem.priors.median())
    body = window.simulator.channels.index("body_temp")
    off = (window.simulate(theta).temperatures - window.observed)[window.valid[:, body], body]
    # Between its thresholds, 3 K apart, it is anywhere; on average it is where it is measured.
    assert np.std(off) < 1.0
    assert np.mean(off) == pytest.approx(0.0, abs=0.1)
    assert not len(window.switching.time)


def test_telemetry_of_such_a_node_says_nothing_of_its_own_numbers_and_much_of_its_links(told):
    problem = build_problem(*told)
    window = opened(problem)
    theta = problem.at(window, problem.priors.median())
    before = window.simulate(theta).temperatures
    moved = {}
    for name in ("capacity", "power", "link"):
        other = theta.copy()
        other[window.names.index(name)] *= 1.2
        moved[name] = np.abs(window.simulate(other).temperatures - before).max()
    assert moved["capacity"] < 0.05
    assert moved["power"] < 0.05
    assert moved["link"] > 1.0


def test_a_right_scenario_with_such_a_heater_is_not_suspected(told, tmp_path):
    scenario, data = told
    assert suspects(build_problem(scenario, data), data).found == ()
    silent, same = small.load(tmp_path, without_status(fast()))
    same = data.drop_vars(set(data) - set(same))
    assert suspects(build_problem(silent, same), same).found == ()


def test_a_heater_without_a_status_is_known_by_what_it_would_do(told, tmp_path):
    _, data = told
    silent, _ = small.load(tmp_path, without_status(fast()))
    problem = build_problem(silent, data)
    assert fast_heaters(problem.windows) == {"heater"}
    window = opened(problem)
    assert pinned_heaters(window.scenario) == ("heater",)
    assert window.unmeasured == ()


@pytest.mark.parametrize(("capacity", "seen"), [(600, False), (3000, True)])
def test_a_heater_without_a_status_that_is_on_for_less_than_two_samples_is_not_seen(tmp_path, capacity, seen):
    """A cycle of 600 J/K takes four samples, of which it is on for less than two; of 3,000 J/K both take nine."""
    written = without_status(fast())
    written["simulator"]["nodes"]["body"]["capacity"] = f"{capacity} J/K"
    written["parameters"]["capacity"]["prior"] = {"lognormal": {"median": f"{capacity} J/K", "factor": 1.2}}
    problem = build_problem(*small.load(tmp_path, written))
    assert fast_heaters(problem.windows) == (set() if seen else {"heater"})


def test_the_steps_are_those_that_the_other_nodes_need(tmp_path):
    """How a held node begins, and each bend of its telemetry, would ask for six times as many."""
    written = fast()
    del written["simulator"]["step"]
    problem = build_problem(*small.closed_loop(tmp_path, written, **THETA))
    held_, free = (window.network.accuracy.steps for window in (opened(problem), problem.windows[0]))
    assert held_ < free


def test_where_each_switch_is_seen_and_where_a_node_has_no_channel_nothing_is_held(told, tmp_path):
    scenario, data = small.closed_loop(tmp_path, small.content() | {"heat": {}})
    assert held(open_loop(scenario), data)[1] is data
    scenario, data = told
    observations = {
        name: observation for name, observation in scenario.observations.items() if observation.node != "body"
    }
    assert held(open_loop(scenario.model_copy(update={"observations": observations})), data)[1] is data


def test_a_channel_with_errors_holds_its_node_where_the_node_is(told):
    scenario, data = told
    item = scenario.observations["body_temp"].model_copy(update={"bias": 2.0, "gain": 1.1})
    erring = scenario.model_copy(update={"observations": {**scenario.observations, "body_temp": item}})
    _, right = held(open_loop(scenario), data)
    read = 1.1 * (data["body_temp"] - 273.15) + 273.15 + 2.0
    _, found = held(open_loop(erring), data.assign(body_temp=read))
    np.testing.assert_allclose(found[f"{PIN}body"], right[f"{PIN}body"], atol=1e-9)


def test_a_node_without_telemetry_for_long_is_not_held(told):
    scenario, data = told
    heard = np.arange(data.sizes["time"]) % 100 < 40
    seldom = data.assign(body_temp=data["body_temp"].where(xarray.DataArray(heard, dims="time")))
    assert held(open_loop(scenario), data)[1] is not data
    assert held(open_loop(scenario), seldom)[1] is seldom
    few = np.arange(data.sizes["time"]) % 100 > 5
    gaps = data.assign(body_temp=data["body_temp"].where(xarray.DataArray(few, dims="time")))
    assert pinned_heaters(opened(build_problem(scenario, gaps)).scenario) == ("heater",)


def test_what_cannot_be_held_in_one_window_is_held_in_none(tmp_path):
    """So the numbers of all windows are in the same places."""
    written = fast()
    hour = "2024-03-01T0{}:00:00".format
    written["windows"] = {
        "train": {"first": {"start": hour(0), "end": hour(2)}, "second": {"start": hour(3), "end": hour(5)}}
    }
    scenario, data = small.closed_loop(tmp_path, written, **THETA)
    heard = (data["time"] < data["time"][150]) | (np.arange(data.sizes["time"]) % 50 < 20)
    both, one = (
        build_problem(scenario, telemetry)
        for telemetry in (data, data.assign(body_temp=data["body_temp"].where(heard)))
    )
    assert [pinned_heaters(window.scenario) for window in both.open_loop.windows] == [("heater",)] * 2
    assert [pinned_heaters(window.scenario) for window in one.open_loop.windows] == [()] * 2
    paths = [window.network.network.paths for window in both.open_loop.windows]
    assert paths[0] == paths[1]


def test_what_holds_a_node_is_no_number_of_the_scenario(told):
    window = opened(build_problem(*told))
    paths = window.network.network.paths
    assert any(PIN in path for path in paths)
    assert not any(PIN in paths[k] for k in window.sizes)


def test_no_sample_that_is_used_lies_where_such_a_node_goes_to_its_telemetry(told):
    problem = build_problem(*told)
    window = opened(problem)
    theta = problem.at(window, problem.priors.median())
    theta[window.names.index("initial.body")] += 2.0
    late = window.names.index("telemetry.time_error")
    by_time = []
    for seconds in (-2.0, 0.0):
        theta[late] = seconds
        by_time.append(window.simulate(theta).temperatures[window.valid])
    assert np.abs(by_time[0] - by_time[1]).max() < 0.5
    assert not window.valid.all()
