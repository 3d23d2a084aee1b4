"""Massless states that act linearly: what is left without them moves as the whole does."""

import numpy as np
import pytest

from flightcal.simulator import integrate, network_simulator
from flightcal.simulator.elimination import eliminate
from flightcal.simulator.kernels import elimination
from flightcal.simulator.system import make_structure, packed_size

from .. import small

HEATED = ("body", "strap")


def strapped(**strap):
    """A body and a panel linked by two massless nodes in a row, of which the first has the heater and takes loads."""
    written = small.content()
    model = written["simulator"]
    model["nodes"] |= {"strap": {"arithmetic": True}, "flange": {"arithmetic": True}}
    model["conductors"][0] = {"between": ["body", "strap"], "conductance": "3 W/K"}
    model["conductors"] += [
        {"between": ["strap", "flange"], "conductance": "2 W/K", **strap},
        {"between": ["flange", "panel"], "conductance": "1 W/K"},
    ]
    model["heaters"]["heater"] |= {"node": "strap", "off_above": "11 degC"}
    model["modes"] = {"quiet": {"strap": "1 W"}, "busy": {"strap": "3 W", "flange": "1 W"}}
    model["timeline"] = [
        {"at": "2024-03-01T00:00:00", "mode": "quiet"},
        {"at": "2024-03-01T00:40:00", "mode": "busy"},
    ]
    written["parameters"]["link"]["sets"] = "conductors.body-strap.conductance"
    written["parameters"]["inner"] = {
        "sets": "conductors.strap-flange.conductance",
        "prior": {"lognormal": {"median": "2 W/K", "factor": 1.3}},
    }
    written["parameters"]["busy"] = {"sets": "modes.busy.strap", "prior": {"uniform": ["1 W", "8 W"]}}
    return written


def simulator_of(folder, written, *, hours=3.0, heated=HEATED):
    scenario, data = small.load(folder, written, hours=hours)
    times = data["time"].values
    period = small.period_of(scenario)
    return network_simulator(scenario, data, times[0], times[-1], times, period=period, heated=heated)


def gone(simulator):
    """Names of the nodes that are eliminated."""
    place = np.arange(len(simulator.network.nodes)) if simulator.elimination is None else simulator.elimination.place
    return {name for name, at in zip(simulator.network.nodes, place, strict=True) if at < 0}


def test_what_is_left_moves_as_the_whole_does(tmp_path):
    simulator = simulator_of(tmp_path, strapped())
    assert gone(simulator) == {"strap", "flange"}
    theta = small.theta_of(simulator)
    whole = integrate(simulator.network.structure, simulator.system(theta), simulator.drive)
    calls = simulator.calls()
    calls.simulate(theta)
    found = calls.integration
    left = np.flatnonzero(simulator.elimination.place >= 0)
    assert len(whole.switches.time) >= 4
    np.testing.assert_allclose(found.states, whole.states[:, left], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.switches.time, whole.switches.time, rtol=0, atol=1e-5)
    np.testing.assert_array_equal(found.status, whole.status)
    trajectory = simulator.simulate(theta)
    expected = whole.states[-1, simulator.network.diffusive]
    np.testing.assert_allclose(trajectory.final, expected, rtol=0, atol=1e-9)


def test_many_simulations_are_those_of_each(tmp_path):
    simulator = simulator_of(tmp_path, strapped())
    thetas = np.stack([small.theta_of(simulator, inner=inner) for inner in (1.6, 1.9, 2.3, 2.6)])
    for theta, many in zip(thetas, simulator.simulate_many(thetas), strict=True):
        one = simulator.simulate(theta)
        np.testing.assert_allclose(many.temperatures, one.temperatures, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ["link", "inner", "busy", "power", "panel_size", "initial.body", "initial.panel"])
def test_the_derivative_agrees_with_differences_across_switches(tmp_path, name):
    """With heat that no block describes into a node that is eliminated."""
    simulator = simulator_of(tmp_path, strapped())
    heat = np.zeros((len(HEATED), 2 * len(simulator.drive.inputs)))
    heat[1] = 2.0 * np.sin(np.arange(heat.shape[1]) / 30.0)
    plain, simulator = simulator, simulator.with_heat(heat)
    theta = small.theta_of(simulator)
    trajectory, pull_back = simulator.linearise(theta)
    assert np.abs(trajectory.temperatures - plain.simulate(theta).temperatures).max() > 0.1
    events = trajectory.switches.time
    inside = [time for time in events if np.abs(simulator.drive.times - time).min() > 1.0]
    assert len(events) >= 4
    assert inside, "a switch within a step"
    rng = np.random.default_rng(0)
    weights, of_times = rng.normal(size=trajectory.temperatures.shape), 0.01 * rng.normal(size=len(events))
    k = simulator.parameters.index(name)
    step = np.zeros_like(theta)
    step[k] = 1e-5 * abs(theta[k]) if theta[k] < 200 else 1e-4

    def objective(sign):
        run = simulator.simulate(theta + sign * step)
        return float((run.temperatures * weights).sum() + run.switches.time @ of_times)

    expected = (objective(1) - objective(-1)) / (2 * step[k])
    found = pull_back(weights, switches_bar=of_times)[k]
    assert found != 0.0
    assert found == pytest.approx(expected, rel=2e-4)


def test_heat_into_a_node_that_is_eliminated_is_that_of_a_mode_of_its_power(tmp_path):
    simulator = simulator_of(tmp_path, strapped())
    heat = np.zeros((len(HEATED), 2 * len(simulator.drive.inputs)))
    heat[1] = simulator.drive.inputs[..., simulator.network.columns.index("mode.busy")].ravel()
    theta = small.theta_of(simulator)
    (found,) = simulator.simulate_many(theta[None], heat[None])
    expected = simulator.simulate(small.theta_of(simulator, busy=4.0))
    np.testing.assert_allclose(found.temperatures, expected.temperatures, rtol=0, atol=1e-7)


def test_a_conductance_that_depends_on_temperature_is_not_eliminated(tmp_path):
    simulator = simulator_of(tmp_path, strapped(conductance_slope="0.003 1/K", at="283.15 K"))
    assert gone(simulator) == set()


def test_what_radiates_or_is_read_is_not_eliminated(tmp_path):
    written = strapped()
    written["simulator"]["conductors"].append({"between": ["flange", "space"], "radiative": "0.01 m^2"})
    assert gone(simulator_of(tmp_path, written)) == {"strap"}
    written = strapped()
    written["observations"]["panel_temp"]["node"] = "flange"
    assert gone(simulator_of(tmp_path, written)) == {"strap"}


def test_a_hub_of_many_links_stays_for_its_elimination_would_link_all_of_them():
    def star(arms):
        links = sorted(
            {(i, i) for i in range(arms + 1)} | {(i, arms) for i in range(arms)} | {(arms, i) for i in range(arms)}
        )
        return make_structure(np.append(np.ones(arms), 0.0), links, [(0, 0)], [], [(0, 0)], [], [])

    assert eliminate(star(3), ()).place.tolist() == [0, 1, 2, -1]
    assert eliminate(star(9), ()) is None


def test_the_derivative_of_what_is_left_agrees_with_differences():
    """Of every entry, with two states that are eliminated one after the other."""
    n, inner, rng = 6, (1, 4), np.random.default_rng(0)
    everything = [(i, j) for i in range(n) for j in range(n)]
    radiation = [(i, j) for i, j in everything if j not in inner]
    mass = np.where(np.isin(np.arange(n), inner), 0.0, 1.0)
    structure = make_structure(mass, everything, radiation, [(0, 2)], [(1, 0), (2, 1)], [(0, 4)], [0])
    found = eliminate(structure, ())
    assert found.place.tolist() == [0, -1, 1, 2, -1, 3]
    size, left = packed_size(structure), packed_size(found.structure)
    whole, weights = rng.normal(size=(1, size)), rng.normal(size=left)
    entries, packed, whole_bar = np.empty(found.entries), np.empty((1, left)), np.empty(size)

    def objective(changed):
        elimination.eliminate(elimination.EliminateCall(np.ones(1, np.int64), found.plan, changed, entries, packed))
        return float(packed[0] @ weights)

    steps = 1e-6 * np.eye(size)[:, None]
    expected = np.array([(objective(whole + step) - objective(whole - step)) / 2e-6 for step in steps])
    objective(whole)
    back = elimination.PullBackEliminationCall(found.plan, entries, np.empty(found.entries), weights, whole_bar)
    elimination.pull_back_elimination(back)
    np.testing.assert_allclose(whole_bar, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
