"""Conductances that depend on temperature, as a scenario has them, against the law itself and other integrators."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from flightcal.problem import build_problem
from flightcal.scenario import calibrated_text, lint, load_scenario, resolved_yaml, settable
from flightcal.simulator import (
    Drive,
    MarchCall,
    build_network,
    flow_through,
    integrate,
    march,
    network_simulator,
    step_size,
)
from flightcal.simulator.network import STEFAN_BOLTZMANN
from flightcal.simulator.system import pack

from .. import small
from .systems import random_system

WALL, SPACE, AT = 250.0, 4.0, 283.15
SLOPES = {"body-panel": 0.004, "panel-wall": -0.002, "panel-bus": 0.003, "shell-body": 0.005}


def written(*, step="30 s", heaters=True):
    """Sloped links between nodes, to a massless one, and to boundaries that are fixed and measured."""
    content = small.content()
    model = content["simulator"]
    model["step"] = step
    model["nodes"] |= {
        "shell": {"arithmetic": True},
        "wall": {"boundary": f"{WALL} K"},
        "bus": {"boundary": "bus_temp"},
    }
    content["telemetry"]["channels"]["bus_temp"] = {"column": "body", "unit": "degC", "kind": "temperature"}
    model["conductors"][0] |= {"conductance_slope": "0.004 1/K", "at": "10 degC"}
    model["conductors"] += [
        {"between": ["panel", "wall"], "conductance": "0.2 W/K", "conductance_slope": "-0.2 percent/K"},
        {"between": ["panel", "bus"], "conductance": "0.1 W/K", "conductance_slope": "0.003 1/K"},
        {"between": ["shell", "body"], "conductance": "0.3 W/K", "conductance_slope": "0.005 1/K"},
        {"between": ["shell", "space"], "radiative": "0.02 m^2"},
    ]
    content["parameters"] |= {
        "slope": {
            "sets": "conductors.body-panel.conductance_slope",
            "prior": {"normal": {"mean": "0.004 1/K", "standard_deviation": "0.001 1/K"}},
        },
        "slopes": {
            "scales": [f"conductors.{name}.conductance_slope" for name in ("panel-wall", "panel-bus", "shell-body")],
            "prior": {"lognormal": {"median": 1, "factor": 1.3}},
        },
        "wall": {"sets": "nodes.wall.boundary", "prior": {"normal": {"mean": "250 K", "standard_deviation": "3 K"}}},
    }
    if not heaters:
        del model["heaters"], content["observations"]["heater_status"], content["parameters"]["power"]
    return content


def law(conductance, slope, first, second, at=293.15):
    """W into the first."""
    return conductance * (1.0 + slope * (0.5 * (first + second) - at)) * (second - first)


def shell_of(body):
    def balance(shell):
        return law(0.3, 0.005, shell, body) - 0.02 * STEFAN_BOLTZMANN * (shell**4 - SPACE**4)

    return brentq(balance, 100.0, 400.0, xtol=1e-12)


def current(t):
    """Of the Sun sensor, linear between its samples."""
    samples = 60.0 * np.arange(60)
    return np.interp(t, samples, small.sunlight(samples))


def rate(t, y, heat=0.0):
    body, panel = y
    bus = 273.15 + 12.0 + 0.001 * t / 60.0
    link = law(0.6, 0.004, body, panel, AT)
    into_panel = law(0.2, -0.002, panel, WALL) + law(0.1, 0.003, panel, bus) - link + 12.0 * current(t)
    into_panel -= 0.05 * STEFAN_BOLTZMANN * (panel**4 - SPACE**4)
    return [(link + law(0.3, 0.005, body, shell_of(body))) / 3000.0, (into_panel + heat) / 800.0]


def test_temperatures_are_those_of_the_law_itself(tmp_path):
    simulator = small.simulator_of(*small.load(tmp_path, written(step="6 s", heaters=False)), hours=0.7)
    theta = small.theta_of(simulator, initial_body=290.0, initial_panel=255.0)
    times = simulator.observation.times
    exact = solve_ivp(rate, (0.0, times[-1]), [290.0, 255.0], t_eval=times, rtol=1e-10, atol=1e-10, max_step=5.0).y.T
    run = simulator.simulate(theta)
    np.testing.assert_allclose(run.temperatures, exact, atol=1e-5)
    assert np.ptp(exact[:, 1]) > 5.0


def test_the_error_falls_with_the_third_power_of_the_step():
    errors = []
    for steps in (40, 80, 160):
        structure, system, _ = random_system(5, heaters=0, massless=0, steps=1, slope=4e-3)
        times = np.linspace(0.0, 6000.0, steps + 1)
        inputs = np.stack([np.ones((steps, 3)), np.ones((steps, 3))], axis=1)
        run = integrate(structure, system, Drive(times, inputs, np.empty((steps, 0)), np.empty(0)))
        n = len(structure.mass)
        A, N, Q, B = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, 3))
        rows = np.arange(n)
        A[np.repeat(rows, np.diff(structure.linear_start)), structure.linear_column] = system.linear
        N[np.repeat(rows, np.diff(structure.radiative_start)), structure.radiative_column] = system.radiative
        Q[structure.quadratic_row, structure.quadratic_column] = system.quadratic
        B[structure.forcing_row, structure.forcing_column] = system.forcing

        def balance(t, x, A=A, N=N, Q=Q, B=B):
            return A @ x + Q @ x**2 + N @ x**4 + B @ np.ones(3)

        exact = solve_ivp(balance, (0, 6000), system.initial, method="Radau", rtol=1e-10, atol=1e-10).y[:, -1]
        errors.append(np.abs(run.states[-1] - exact).max())
    assert (np.log2(np.array(errors[:-1]) / errors[1:]) > 2.7).all(), errors


def test_the_density_has_the_gradient_of_slopes_and_boundaries(tmp_path):
    problem = build_problem(*small.closed_loop(tmp_path, written()))
    rng = np.random.default_rng(0)
    for of in (problem, problem.open_loop):
        z = of.to_z(of.priors.median()) + 0.05 * rng.standard_normal(len(of.names))
        _, gradient = of.log_density_and_gradient(z)
        for name in ("link", "slope", "slopes", "wall", "initial.panel"):
            k, size = of.names.index(name), 1e-5
            step = size * np.eye(len(z))[k]
            numeric = (of.log_density(z + step) - of.log_density(z - step)) / (2.0 * size)
            np.testing.assert_allclose(gradient[k], numeric, rtol=2e-5, atol=1e-4, err_msg=name)


def test_many_side_by_side_are_those_by_themselves(tmp_path):
    simulator = small.simulator_of(*small.load(tmp_path, written()), hours=2.0)
    thetas = np.stack([small.theta_of(simulator, slope=slope) for slope in (-0.002, 0.0, 0.004, 0.01)])
    runs = simulator.simulate_many(thetas)
    for theta, run in zip(thetas, runs, strict=True):
        np.testing.assert_allclose(run.temperatures, simulator.simulate(theta).temperatures, atol=1e-9)
    assert np.abs(runs[0].temperatures - runs[3].temperatures).max() > 0.1


def with_heat(folder):
    """Simulator with heat of 2 W into the panel, and theta."""
    scenario, data = small.load(folder, written(step="6 s", heaters=False))
    times = data["time"].values[:40]
    period = small.period_of(scenario)
    simulator = network_simulator(scenario, data, times[0], times[-1], times, period=period, heated=("panel",))
    heat = np.full((1, 2 * (len(simulator.drive.times) - 1)), 2.0)
    return simulator.with_heat(heat), small.theta_of(simulator, initial_body=290.0, initial_panel=255.0)


def test_heat_that_no_block_describes_warms_as_the_law_says(tmp_path):
    heated, theta = with_heat(tmp_path)
    end = heated.observation.times[-1]
    exact = solve_ivp(rate, (0.0, end), [290.0, 255.0], args=(2.0,), rtol=1e-10, atol=1e-10, max_step=5.0).y[:, -1]
    np.testing.assert_allclose(heated.simulate(theta).temperatures[-1], exact, atol=1e-5)


def test_with_heat_the_product_with_the_jacobian_is_that_of_differences(tmp_path):
    heated, theta = with_heat(tmp_path)
    run, pull_back = heated.linearise(theta)
    weights = np.random.default_rng(0).standard_normal(run.temperatures.shape)
    gradient = pull_back(weights)
    for k, name in enumerate(heated.parameters):
        size = 1e-5 * max(abs(theta[k]), 1e-3)
        step = size * np.eye(len(theta))[k]
        above, below = ((heated.simulate(theta + sign * step).temperatures * weights).sum() for sign in (1, -1))
        np.testing.assert_allclose(gradient[k], (above - below) / (2.0 * size), rtol=1e-5, atol=1e-6, err_msg=name)


def test_heat_that_flows_through_a_node_is_that_of_its_links(tmp_path):
    """The panel's links alone; what a boundary gives is told apart from what the node loses."""
    content = written(heaters=False)
    content["simulator"]["conductors"] = [
        content["simulator"]["conductors"][0],
        content["simulator"]["conductors"][2],
    ]
    content["simulator"]["nodes"] = {name: content["simulator"]["nodes"][name] for name in ("body", "panel", "wall")}
    content["simulator"]["loads"] = {}
    content["parameters"] = {}
    scenario, data = small.load(tmp_path, content)
    simulator = small.simulator_of(scenario, data, hours=2.0)
    theta = small.theta_of(simulator, initial_body=300.0, initial_panel=255.0)
    run = integrate(simulator.network.structure, simulator.system(theta), simulator.drive)
    states = dict(zip(simulator.network.nodes, run.states.T, strict=True))
    body, panel = (0.5 * (states[name][1:] + states[name][:-1]) for name in ("body", "panel"))
    flows = np.abs(law(0.6, 0.004, panel, body, AT)) + np.abs(law(0.2, -0.002, panel, WALL))
    steps = np.diff(simulator.drive.times)
    expected = 0.5 * (flows @ steps) / steps.sum()
    np.testing.assert_allclose(flow_through(simulator, scenario, ["panel"], theta), [expected], rtol=1e-9)


def test_steps_under_given_heat_are_those_of_the_integration():
    structure, system, drive = random_system(4, heaters=0, steps=20, slope=4e-3)
    inputs = np.ones_like(drive.inputs)
    times = 30.0 * np.arange(len(drive.times))
    run = integrate(structure, system, replace(drive, times=times, inputs=inputs))
    heat = np.zeros(len(structure.mass))
    np.add.at(heat, structure.forcing_row, system.forcing)
    x = system.initial.copy()
    memory = np.empty(step_size.py_func(None, structure))
    march(MarchCall(structure, pack(system), x, heat, heat.copy(), 30.0 * (len(times) - 1), len(times) - 1, memory))
    np.testing.assert_allclose(x, run.states[-1], atol=1e-9)


def test_without_slopes_there_are_no_entries_for_them(tmp_path):
    network = build_network(small.load(tmp_path)[0])
    assert not len(network.structure.quadratic_row)
    assert not any(column.startswith("temperature2") for column in network.columns)


def test_slopes_are_written_read_and_calibrated(tmp_path):
    scenario, _ = small.load(tmp_path, written())
    slopes = {path: number for path, number in settable(scenario).items() if path.endswith("slope")}
    assert {path.split(".")[1]: number.value for path, number in slopes.items()} == pytest.approx(SLOPES)
    assert {number.unit for number in slopes.values()} == {"1/K"}
    means = {"link": 0.6, "panel_size": 1.0, "power": 30.0, "slope": 0.0051, "slopes": 1.5, "wall": 251.0}
    for text in ((tmp_path / "scenario.yaml").read_text(), resolved_yaml(scenario, absolute=True)):
        (tmp_path / "again.yaml").write_text(calibrated_text(text, scenario, means))
        again = load_scenario(tmp_path / "again.yaml").network.conductors
        assert again[0].conductance_slope == pytest.approx(0.0051)
        assert again[0].at == pytest.approx(283.15)
        assert again[2].conductance_slope == pytest.approx(-0.003)


def test_a_slope_that_turns_the_conductance_negative_is_warned_of(tmp_path):
    content = written()
    content["simulator"]["conductors"][0]["conductance_slope"] = "0.02 1/K"
    small.load(tmp_path, content)
    (found,) = lint(tmp_path / "scenario.yaml")
    assert found.warning
    assert found.location == "conductors.body-panel.conductance_slope"
    assert "below zero at -100 degC" in found.message
