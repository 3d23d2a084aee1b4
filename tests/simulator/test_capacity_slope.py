"""Capacities that depend on temperature, C (1 + s (T - T0)): a node's heat is a state beside its temperature."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flightcal.simulator import flow_through, heat_of_inputs
from flightcal.simulator.network import STEFAN_BOLTZMANN
from tests import small

SLOPE, AT = 3e-3, 273.15


def sloped(slope=SLOPE, nodes=("body", "panel")):
    """The small satellite with capacities that depend on temperature."""
    written = small.content()
    for name in nodes:
        written["simulator"]["nodes"][name] |= {"capacity_slope": f"{slope!r} 1/K", "at": "0 degC"}
    if slope:
        prior = {"normal": {"mean": f"{slope} 1/K", "standard_deviation": "0.001 1/K"}}
        written["parameters"]["slope"] = {"sets": "nodes.body.capacity_slope", "prior": prior}
    written["parameters"]["capacity"] = {"sets": "nodes.body.capacity", "prior": {"uniform": ["2 kJ/K", "4 kJ/K"]}}
    written["parameters"]["on_below"] = {
        "sets": "heaters.heater.on_below",
        "prior": {"normal": {"mean": "10 degC", "standard_deviation": "0.5 degC"}},
    }
    return written


@pytest.fixture
def simulator(tmp_path):
    return small.simulator_of(*small.load(tmp_path, sloped()), hours=5)


def independent(simulator, theta, hours):
    """Temperatures [T, 2] K of body and panel by another solver, whose thermostat switches at events."""
    names = dict(zip(simulator.parameters, theta, strict=True))
    times = np.arange(0.0, hours * 3600.0 + 1.0, 60.0)

    def rate(t, x, on):
        body, panel = x
        link = names["link"] * (panel - body)
        radiated = names["panel_size"] * STEFAN_BOLTZMANN * 0.05 * (panel**4 - 4.0**4)
        sun = 12.0 * names["panel_size"] * np.interp(t, times, small.sunlight(times))
        return [
            (link + on * names["power"]) / (names["capacity"] * (1.0 + names["slope"] * (body - AT))),
            (sun - link - radiated) / (800.0 * (1.0 + SLOPE * (panel - AT))),
        ]

    t, x, on, found = 0.0, np.array([names["initial.body"], names["initial.panel"]]), 0.0, []
    switched = 0
    while t < times[-1]:
        threshold = 286.15 if on else names["on_below"]

        def crossed(t, x, on, threshold=threshold):
            return x[0] - threshold

        crossed.terminal, crossed.direction = True, 1.0 if on else -1.0
        run = solve_ivp(
            rate, (t, times[-1]), x, args=(on,), events=crossed, rtol=1e-10, atol=1e-9, max_step=60.0, dense_output=True
        )
        within = (times >= t) & (times <= run.t[-1])
        found += list(zip(times[within], run.sol(times[within]).T, strict=True))
        t, x, on = run.t[-1], run.y[:, -1], 1.0 - on
        switched += t < times[-1]
    assert switched >= 4
    table = dict(found)
    return np.array([table[time] for time in times])


def test_temperatures_are_those_of_another_solver(simulator):
    theta = small.theta_of(simulator, initial_panel=250.0)
    found = simulator.simulate(theta).temperatures
    wanted = independent(simulator, theta, 5)
    assert np.abs(found - wanted).max() < 1e-3
    constant = theta.copy()
    constant[simulator.parameters.index("slope")] = 0.0
    assert np.abs(simulator.simulate(constant).temperatures - wanted).max() > 0.2


def test_heat_in_is_the_integral_of_the_capacity(tmp_path):
    """A body alone, heated all the time: the temperature that its heat makes, in closed form."""
    written = sloped()
    written["simulator"]["heaters"]["heater"] |= {"on_below": "150 degC", "off_above": "200 degC"}
    simulator = small.simulator_of(*small.load(tmp_path, written), hours=2)
    theta = small.theta_of(simulator, link=0.0, on_below=423.15)
    body = simulator.simulate(theta).temperatures[:, 0]
    power, capacity, seconds = 30.0, 3000.0, 60.0 * np.arange(len(body))
    held = capacity * ((body - 285.0) + 0.5 * SLOPE * ((body - AT) ** 2 - (285.0 - AT) ** 2))
    assert body[-1] > 340.0
    np.testing.assert_allclose(held, power * seconds, atol=0.05)


@pytest.mark.parametrize("name", ["slope", "capacity", "on_below", "link", "initial.body", "initial.panel"])
def test_the_derivative_agrees_with_differences_across_switches(simulator, name):
    theta = small.theta_of(simulator, initial_panel=250.0)
    weights = np.random.default_rng(0).normal(size=(301, 2))
    run, pull_back = simulator.linearise(theta)
    assert len(run.switches.time) >= 4
    k = simulator.parameters.index(name)
    step = 1e-7 * abs(theta[k])

    def objective(size):
        moved = theta.copy()
        moved[k] += size
        return float((simulator.simulate(moved).temperatures * weights).sum())

    expected = (8 * (objective(step) - objective(-step)) - (objective(2 * step) - objective(-2 * step))) / (12 * step)
    assert pull_back(weights)[k] == pytest.approx(expected, rel=1e-5, abs=1e-6)


def test_lanes_do_what_one_simulation_does(simulator):
    thetas = np.tile(small.theta_of(simulator), (20, 1))
    thetas[:, simulator.parameters.index("slope")] = np.linspace(0.0, 4e-3, 20)
    for theta, run in zip(thetas, simulator.simulate_many(thetas), strict=True):
        alone = simulator.simulate(theta)
        np.testing.assert_allclose(run.temperatures, alone.temperatures, atol=1e-7)
        np.testing.assert_allclose(run.final, alone.temperatures[-1], atol=1e-7)


@pytest.mark.parametrize("measured", [False, True])
def test_a_slope_of_next_to_nothing_is_none(tmp_path, measured):
    """In open and in closed loop; also the heat that flows, and what the thermostats watch."""
    made = []
    for slope in (0.0, 1e-9):
        written = sloped(slope)
        del written["parameters"]["on_below"]
        written["simulator"]["heater_input"] = "measured" if measured else "simulated"
        if not slope:
            for node in ("body", "panel"):
                del written["simulator"]["nodes"][node]["capacity_slope"], written["simulator"]["nodes"][node]["at"]
        scenario, data = small.load(tmp_path, written)
        data["heater_status"].values[:] = (np.arange(data.sizes["time"]) // 20) % 2
        made.append((scenario, small.simulator_of(scenario, data, hours=5)))
    (scenario, plain), (_, other) = made
    theta, same = (small.theta_of(simulator, initial_panel=260.0) for simulator in (plain, other))
    np.testing.assert_allclose(other.simulate(same).temperatures, plain.simulate(theta).temperatures, atol=2e-3)
    nodes = ("body", "panel")
    flow = flow_through(plain, scenario, nodes, theta)
    np.testing.assert_allclose(flow_through(other, made[1][0], nodes, same), flow, rtol=1e-3)
    inputs = heat_of_inputs(plain, nodes, theta)
    np.testing.assert_allclose(heat_of_inputs(other, nodes, same), inputs, atol=1e-6)
    assert other.network.nodes[other.network.watched[0]] == "body"
    assert sorted(other.network.own_nodes) == sorted(plain.network.nodes)


def test_a_threshold_that_is_off_is_so_in_temperature(simulator):
    """A shift of 2 K at each switch is what other thresholds are."""
    theta = small.theta_of(simulator)
    higher = theta.copy()
    higher[simulator.parameters.index("on_below")] += 2.0
    off = np.zeros((1, 1, 2, 1))
    off[0, 0, 0] = 2.0
    (shifted,) = simulator.simulate_switching(theta[None], off)
    np.testing.assert_allclose(shifted.temperatures, simulator.simulate(higher).temperatures, atol=1e-6)
