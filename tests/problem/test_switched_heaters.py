"""Two heaters on one switch: one thermostat, one status, heat in two nodes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flightcal.check.prepared import prepared
from flightcal.check.wrongs.heaters import heaters as wrong_heaters
from flightcal.prediction import predict
from flightcal.problem import (
    build_problem,
    heat_model,
    heat_of_weights,
    heated_switches,
    held_by,
    hold,
    responses,
    sampled_windows,
    shifts_of_weights,
    unit_heats,
)
from flightcal.scenario import calibrated_text, heat_of, load_scenario, resolved_yaml, settable
from flightcal.simulator.network import STEFAN_BOLTZMANN
from flightcal.telemetry import read
from tests import small

LEO = Path(__file__).parents[2] / "examples" / "leo_observer" / "scenario.yaml"


def written(**more):
    content = small.content() | more
    content["simulator"]["heaters"]["second"] = {"node": "panel", "power": "8 W", "switched_with": "heater"}
    content["parameters"]["second_power"] = {
        "sets": "heaters.second.power",
        "prior": {"lognormal": {"median": "8 W", "factor": 1.2}},
    }
    content["windows"]["train"]["end"] = "2024-03-01T01:30:00"
    return content


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """Scenario and telemetry, with heat that no block describes in both nodes."""
    parts = {"pattern": {"harmonics": 1}, "gains": None, "slow": None}
    return small.closed_loop(tmp_path_factory.mktemp("switched"), written(heat=parts))


@pytest.fixture(scope="module")
def problem(case):
    return build_problem(*case)


def model_of(problem, window):
    theta = problem.at(window, problem.priors.median()[None])[0]
    return heat_model(problem.scenario, problem.scenario.heat, (window,), theta)


def switches_of(model, window):
    (switch_units,) = [
        u for group, u in zip(model.groups, unit_heats(model, window), strict=True) if group.part == "switches"
    ]
    return switch_units


def simulated(folder, content):
    simulator = small.simulator_of(*small.load(folder, content), hours=2.0)
    return simulator, simulator.simulate(small.theta_of(simulator))


def test_two_in_one_node_are_one_of_their_power(tmp_path):
    content, one = written(), small.content()
    content["simulator"]["heaters"]["second"]["node"] = "body"
    one["simulator"]["heaters"]["heater"]["power"] = "38 W"
    del one["parameters"]["power"], content["parameters"]["power"]
    (tmp_path / "one").mkdir()
    (_, together), (_, single) = simulated(tmp_path, content), simulated(tmp_path / "one", one)
    assert len(together.switches.time) > 2
    np.testing.assert_array_equal(together.status, single.status)
    np.testing.assert_allclose(together.temperatures, single.temperatures, atol=1e-8)


def test_each_heats_its_own_node_while_the_one_thermostat_is_on(tmp_path):
    simulator, run = simulated(tmp_path, written())
    (k,) = [k for k, column in enumerate(simulator.network.columns) if column == "driver.sun"]
    edges = [0.0, *run.switches.time, 7200.0]
    on = [bool(run.status[0, 0]), *(run.switches.on > 0.5)]
    assert len(edges) > 4

    def rate(t, y, u):
        body, panel = y
        sun = np.interp(t, simulator.drive.times[1:], simulator.drive.inputs[:, 1, k])
        link = 0.6 * (panel - body)
        lost = 0.05 * STEFAN_BOLTZMANN * (panel**4 - 4.0**4)
        return [(link + 30.0 * u) / 3000.0, (-link + 12.0 * sun - lost + 8.0 * u) / 800.0]

    y = [285.0, 285.0]
    for first, last, u in zip(edges, edges[1:], on, strict=False):
        y = solve_ivp(rate, (first, last), y, args=(u,), rtol=1e-9, atol=1e-9, max_step=60.0).y[:, -1]
    np.testing.assert_allclose(run.temperatures[-1], y, atol=5e-3)


def test_the_switch_has_one_status_and_the_power_of_all_its_heaters(problem):
    (window,) = problem.windows
    assert problem.heaters == ("heater",)
    theta = small.median(window)
    theta[window.names.index("second_power")] = 9.5
    theta[window.names.index("power")] = 31.0
    np.testing.assert_allclose(window.simulator.heater_power(theta[window.simulated]), [40.5])


def test_the_density_has_the_gradient_of_both_powers(problem):
    rng = np.random.default_rng(0)
    for of in (problem, problem.open_loop):
        z = of.to_z(of.priors.median()) + 0.1 * rng.standard_normal(len(of.names))
        _, gradient = of.log_density_and_gradient(z)
        for name in ("power", "second_power"):
            k, step = of.names.index(name), 1e-5 * np.eye(len(z))[of.names.index(name)]
            numeric = (of.log_density(z + step) - of.log_density(z - step)) / 2e-5
            assert numeric != 0.0
            np.testing.assert_allclose(gradient[k], numeric, rtol=1e-5)


def test_in_open_loop_both_follow_the_measured_status(problem):
    (closed,), (opened,) = problem.windows, problem.open_loop.windows
    theta = problem.at(opened, problem.priors.median()[None])[0]
    assert opened.network.drive.measured.shape[1] == 1
    with_both = opened.simulate(theta)
    theta[opened.names.index("second_power")] = 1e-9
    with_one = opened.simulate(theta)
    on = opened.status[:, 0] > 0.5
    panel = (with_both.temperatures - with_one.temperatures)[:, opened.simulator.channels.index("panel_temp")]
    assert np.abs(panel[: int(np.argmax(on))]).max(initial=0.0) < 1e-9
    assert panel[len(on) - 1] > 0.1
    assert closed.network.network.heaters == opened.network.network.heaters == ("heater",)


def test_the_moment_of_a_switch_is_one_unknown_for_the_heat_of_both(problem):
    (window,) = sampled_windows(problem)
    model = model_of(problem, window)
    switch_units, switching = switches_of(model, window), window.switching
    assert set(switching.heater) == {"heater"}
    assert len(switch_units.series) == len(switching.time) > 2
    weights = np.eye(len(switch_units.series))[1]
    heat = heat_of_weights(model, [switch_units], [weights])
    lasting = np.repeat(np.diff(window.network.drive.times), 2) / 2.0
    spread = switching.interval[1] / np.sqrt(12.0)
    np.testing.assert_allclose(heat @ lasting, [30.0 * spread, 8.0 * spread], rtol=1e-9)


def test_heat_that_moves_a_switch_acts_between_the_samples_that_show_it_and_nowhere_else():
    scenario = load_scenario(LEO)
    problem = build_problem(scenario, read(scenario))
    (window,) = sampled_windows(problem)
    theta = problem.at(window, problem.priors.median()[None])[0]
    model = heat_model(scenario, heat_of(scenario), (window,), theta)
    switch_units, switching, times = switches_of(model, window), window.switching, window.network.drive.times
    assert len(switch_units.series) == len(switching.time) > 20
    for series, time, interval in zip(switch_units.series, switching.time, switching.interval, strict=True):
        middle = 0.5 * (times[1:] + times[:-1])
        inside = np.repeat(np.abs(middle - time) < 0.5 * interval, 2)
        np.testing.assert_allclose(series[~inside], 0.0, atol=1e-6)
        np.testing.assert_allclose(series[inside], series.max(), rtol=1e-6)


def test_its_response_is_that_of_the_heat_in_both_nodes(problem):
    (window,) = sampled_windows(problem)
    theta = problem.at(window, problem.priors.median()[None])[0]
    held = held_by(window, theta)
    window = window if held is None else hold(window, held)
    model = model_of(problem, window)
    switch_units = switches_of(model, window)
    apart = [replace(switch_units, share=switch_units.share * (np.arange(2) == k)) for k in range(2)]
    (both,) = responses(window, theta, model, [switch_units])
    body, panel = (responses(window, theta, model, [part])[0] for part in apart)
    assert np.abs(panel).max() > 1e-4
    np.testing.assert_allclose(both, body + panel, atol=1e-6 * np.abs(both).max())


def test_where_one_node_alone_has_heat_only_its_part_is_uncertain(tmp_path):
    content = written(heat={"nodes": ["panel"], "gains": None, "slow": None})
    scenario, data = small.closed_loop(tmp_path, content)
    problem = build_problem(scenario, data)
    (window,) = sampled_windows(problem)
    model = model_of(problem, window)
    switch_units, switching = switches_of(model, window), window.switching
    np.testing.assert_array_equal(switch_units.share, np.ones((len(switching.time), 1)))
    np.testing.assert_allclose(switch_units.series.max(axis=1) * np.sqrt(12.0), 8.0, rtol=0.5)


def test_a_switch_whose_nodes_have_no_heat_is_not_shifted(tmp_path):
    content = small.content() | {"heat": {"nodes": ["panel"], "gains": None, "slow": None}}
    scenario, data = small.closed_loop(tmp_path, content)
    problem = build_problem(scenario, data)
    (window,) = sampled_windows(problem)
    model = model_of(problem, window)
    assert heated_switches(model, window) == ()
    weights = [np.zeros((3, len(group_units.series))) for group_units in unit_heats(model, window)]
    np.testing.assert_array_equal(shifts_of_weights(model, window, weights), np.zeros((3, len(window.switching.time))))


def test_a_prediction_counts_the_energy_of_both(tmp_path):
    scenario, data = small.closed_loop(tmp_path, written())
    problem = build_problem(scenario, data)
    draws = np.tile(problem.priors.median(), (4, 1))
    found, _ = predict(problem, data, "test", {"genetic": draws[0]}, draws, seed=0)
    assert list(found["heater"].values) == ["heater"]
    seconds = 3.0 * 3600.0
    duty, energy = found["point_duty_cycle"], found["point_energy"]
    np.testing.assert_allclose(energy.values, duty.values * 38.0 * seconds, rtol=1e-6)


def test_each_heater_of_a_switch_may_be_suspected_by_itself(case):
    view = prepared(*case)
    suspected = {wrong.about for wrong in wrong_heaters(view)}
    assert suspected == {"heater", "second", "every heater", "heater from a time on", "second from a time on"}


def test_the_text_of_a_scenario_with_them_is_read_again_with_calibrated_powers(case, tmp_path):
    scenario, _ = case
    assert [path for path in settable(scenario) if path.startswith("heaters.second")] == ["heaters.second.power"]
    for text in ((scenario.folder / "scenario.yaml").read_text(), resolved_yaml(scenario, absolute=True)):
        means = {"link": 0.6, "panel_size": 1.0, "power": 30.0, "second_power": 8.75}
        (tmp_path / "again.yaml").write_text(calibrated_text(text, scenario, means))
        again = load_scenario(tmp_path / "again.yaml")
        assert again.network.heaters["second"].power == 8.75
        assert again.network.heaters["heater"] == scenario.network.heaters["heater"]


@pytest.mark.parametrize("samples", [0, 1])
def test_a_status_that_telemetry_hardly_tells_drives_no_heater(tmp_path, samples):
    scenario, data = small.closed_loop(tmp_path, written())
    data["heater_status"].values[samples:] = np.nan
    problem = build_problem(scenario, data)
    assert problem.open_loop is None
    assert sampled_windows(problem) == problem.windows
