"""Massless nodes at the beginning of a simulation."""

from dataclasses import replace

import numpy as np
import pytest

from flightcal.simulator.balance import balanced

from .. import small

STEFAN_BOLTZMANN = 5.670374419e-8
SUN, AREA, LEAK = 1500.0, 1.54, 0.04
"""W into an outer layer, m^2 to space, m^2 to the body below it."""


def simulator_with_a_layer(folder, sun=SUN):
    content = small.content()
    content["simulator"]["nodes"]["layer"] = {"arithmetic": True}
    content["simulator"]["conductors"] += [
        {"between": ["layer", "body"], "radiative": f"{LEAK} m^2"},
        {"between": ["layer", "space"], "radiative": f"{AREA} m^2"},
    ]
    content["simulator"]["modes"] = {"lit": {"layer": f"{sun} W"}}
    content["simulator"]["timeline"] = [{"at": "2024-03-01T00:00:00", "mode": "lit"}]
    content["simulator"]["heaters"]["heater"]["power"] = "1 W"
    del content["parameters"]["power"]
    content["observations"]["panel_temp"]["node"] = "layer"
    simulator = small.simulator_of(*small.load(folder, content))
    seconds = np.linspace(0.0, 3.0, 31)
    return replace(simulator, observation=replace(simulator.observation, times=seconds))


def in_balance(body, sun):
    """K of the layer: what it radiates is what it gets."""
    return ((sun / STEFAN_BOLTZMANN + LEAK * body**4 + AREA * 4.0**4) / (AREA + LEAK)) ** 0.25


@pytest.mark.parametrize("sun", [0.0, 100.0, SUN, 4000.0])
def test_a_layer_that_radiates_is_in_balance_from_the_beginning(tmp_path, sun):
    simulator = simulator_with_a_layer(tmp_path, sun)
    for body in (275.0, 285.0, 295.0):
        run = simulator.simulate(small.theta_of(simulator, initial_body=body))
        # It gets 100 W at most, which warm it by 0.03 K a second.
        np.testing.assert_allclose(run.temperatures[:, 0], body, atol=0.15)
        # The first reading is at the beginning, before the three steps in which it settles.
        np.testing.assert_allclose(run.temperatures[1:, 1], in_balance(body, sun), atol=0.05)


def test_without_massless_nodes_a_network_stays_as_it_is(tmp_path):
    simulator = small.simulator_of(*small.load(tmp_path))
    assert balanced(simulator, small.theta_of(simulator)) is simulator.network
