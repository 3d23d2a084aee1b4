"""The entries of the canonical form against the heat balance written out by hand."""

import numpy as np
import pytest

from flightcal.scenario.network import DEEP_SPACE
from flightcal.simulator import build_network
from flightcal.simulator.network import STEFAN_BOLTZMANN

from .. import oracle, small
from .systems import assembled

T = {"body": 290.0, "panel": 265.0, "shell": 270.0}


def rich():
    """Every kind of node, conductor and load at once."""
    written = small.content()
    model = written["simulator"]
    model["nodes"] |= {"shell": {"arithmetic": True}, "bus": {"boundary": "body_temp"}}
    written["observations"].pop("body_temp")
    written["observations"]["panel_temp"] = {"node": "panel", "bias": "0.3 K"}
    model["conductors"] += [
        {"between": ["body", "shell"], "conductance": "0.2 W/K"},
        {"between": ["shell", "space"], "radiative": "0.01 m^2"},
        {"between": ["panel", "bus"], "conductance": "0.15 W/K"},
        {"between": ["bus", "shell"], "radiative": "0.02 m^2"},
    ]
    model["faces"] = {
        "top": {
            "node": "panel",
            "area": "0.03 m^2",
            "normal": [1, 0, -1],
            "absorptivity": 0.2,
            "emissivity": 0.8,
        }
    }
    written["environment"] = {
        "orbit": {"altitude": "500 km", "inclination": "97 deg", "ltan": "12:00", "epoch": "2024-03-01T00:00:00"},
        "albedo": 0.35,
        "earth_infrared": "240 W/m^2",
    }
    model["modes"] = {"quiet": {"body": "3 W", "shell": "1 W"}, "busy": {"body": "11 W"}}
    model["timeline"] = [
        {"at": "2024-03-01T00:00:00", "mode": "quiet"},
        {"at": "2024-03-01T00:20:30", "mode": "busy"},
        {"at": "2024-03-01T00:50:00", "mode": "quiet"},
    ]
    return written


def net_heat(network, system, temperatures, inputs, heater):
    """W into each node: what the canonical form says, times the capacities."""
    A, N, Q, B, g = (np.array(matrix) for matrix in oracle.dense(network.structure, system))
    x = np.array([temperatures[node] for node in network.nodes])
    w = np.array([inputs.get(column, 0.0) for column in network.columns])[: B.shape[1]]
    rate = A @ x + Q @ x**2 + N @ x**4 + B @ w + heater * g[0]
    capacity = {"body": 3000.0, "panel": 800.0, "shell": 1.0}
    return {node: rate[k] * capacity[node] for k, node in enumerate(network.nodes)}


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    return build_network(small.load(tmp_path_factory.mktemp("rich"), rich())[0])


def system_of(network, values=None):
    initial = np.array([T[node] for node in network.nodes])
    values = network.values if values is None else values
    return assembled(network, values, initial)


def test_every_node_has_the_heat_balance_of_its_links_loads_and_faces(network):
    inputs = {
        "one": 1.0,
        "solar.top": 900.0,
        "albedo.top": 300.0,
        "infrared.top": 0.25,
        "mode.busy": 1.0,
        "driver.sun": 0.7,
        "temperature.bus": 285.0,
        "temperature4.bus": 285.0**4,
    }
    found = net_heat(network, system_of(network), T, inputs, heater=1.0)
    s, (body, panel, shell) = STEFAN_BOLTZMANN, (T["body"], T["panel"], T["shell"])
    link, skin = 0.6 * (body - panel), 0.2 * (body - shell)
    face = 0.03 * (0.2 * (900.0 + 0.35 * 300.0) + 0.8 * (240.0 * 0.25 - s * (panel**4 - DEEP_SPACE**4)))
    expected = {
        "body": -link - skin + 11.0 + 30.0,
        "panel": link - s * 0.05 * (panel**4 - 4.0**4) + 0.15 * (285.0 - panel) + 12 * 0.7 + face,
        "shell": skin - s * 0.01 * (shell**4 - 4.0**4) + s * 0.02 * (285.0**4 - shell**4),
    }
    for node, heat in expected.items():
        assert found[node] == pytest.approx(heat, rel=1e-10), node


def test_nothing_drives_a_network_without_inputs_but_its_own_temperatures(network):
    found = net_heat(network, system_of(network), dict.fromkeys(T, 0.0), {}, heater=0.0)
    assert found == dict.fromkeys(T, 0.0)


def test_what_a_link_takes_from_one_node_it_gives_to_the_other(tmp_path):
    written = small.content()
    written["simulator"]["conductors"] = [
        {"between": ["body", "panel"], "conductance": "0.6 W/K"},
        {"between": ["body", "panel"], "radiative": "0.05 m^2", "name": "gap"},
    ]
    written["simulator"]["nodes"].pop("space")
    written["parameters"].pop("panel_size")
    network = build_network(small.load(tmp_path, written)[0])
    found = net_heat(network, system_of(network), T, {}, heater=0.0)
    assert found["panel"] == pytest.approx(0.6 * 25.0 + STEFAN_BOLTZMANN * 0.05 * (290.0**4 - 265.0**4))
    assert found["body"] == pytest.approx(-found["panel"], rel=1e-12)


def test_states_are_the_nodes_without_a_given_temperature_and_only_massless_ones_have_no_mass(network):
    assert set(network.nodes) == {"body", "panel", "shell"}
    assert {network.nodes[k] for k in network.diffusive} == {"body", "panel"}


def test_thresholds_and_sensors_are_those_of_the_heater(network):
    system = system_of(network)
    assert (system.lower, system.upper) == (pytest.approx([283.15]), pytest.approx([286.15]))
    assert network.nodes[network.structure.sensor[0]] == "body"


@pytest.mark.parametrize(
    ("path", "node", "slope"),
    [
        ("conductors.body-panel.conductance", "panel", 25.0),
        ("faces.top.area", "panel", 0.2 * 900.0 + 0.2 * 0.35 * 300.0 - 0.8 * STEFAN_BOLTZMANN * (265.0**4)),
        ("environment.albedo", "panel", 0.03 * 0.2 * 300.0),
        ("modes.busy.body", "body", 1.0),
        ("heaters.heater.power", "body", 1.0),
        ("loads.sun.coefficient", "panel", 0.7),
        ("nodes.space.boundary", "panel", STEFAN_BOLTZMANN * 0.05 * 4 * 4.0**3),
    ],
)
def test_a_number_acts_where_it_stands(network, path, node, slope):
    inputs = {"solar.top": 900.0, "albedo.top": 300.0, "mode.busy": 1.0, "driver.sun": 0.7, "one": 1.0}
    values = network.values.copy()
    size = 1e-4 * values[network.position(path)]
    values[network.position(path)] += size
    before = net_heat(network, system_of(network), T, inputs, heater=1.0)
    after = net_heat(network, system_of(network, values), T, inputs, heater=1.0)
    assert (after[node] - before[node]) / size == pytest.approx(slope, rel=1e-3, abs=1e-9)


def test_a_capacity_divides_the_whole_heat_of_its_node(network):
    values = network.values.copy()
    values[network.position("nodes.body.capacity")] *= 2.0
    before = net_heat(network, system_of(network), T, {"mode.busy": 1.0}, heater=1.0)
    after = net_heat(network, system_of(network, values), T, {"mode.busy": 1.0}, heater=1.0)
    assert after["body"] == pytest.approx(before["body"] / 2.0)
    assert after["panel"] == before["panel"]
