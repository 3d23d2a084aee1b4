"""Thousands of simulations in JAX against the compiled integration."""

import numpy as np
import pytest

from flightcal.simulator import integrate
from flightcal.simulator.accelerated import integrate_thousands
from flightcal.simulator.kernels.forward import FINISHED, NOT_FINITE, TOO_MANY_SWITCHES
from flightcal.simulator.system import pack, unpack

from .systems import random_system
from .test_lanes import CASES, around


@pytest.mark.parametrize("options", CASES.values(), ids=CASES.keys())
def test_states_are_those_of_the_compiled_integration(options):
    structure, system, drive = random_system(**{"seed": 1, **options})
    packed = around(system, 12)
    states, outcome, _ = integrate_thousands(structure, packed, drive)
    assert (outcome == FINISHED).all()
    for k, row in enumerate(packed):
        run = integrate(structure, unpack(structure, row), drive)
        if options.get("heaters", 2) > options.get("measured_heaters", 0):
            assert len(run.switches.time) >= 2, "the case must switch to test anything"
        np.testing.assert_allclose(states[:, :, k], run.states, rtol=0, atol=1e-6)


def test_a_failed_simulation_leaves_its_neighbours_alone():
    structure, system, drive = random_system(1)
    packed = around(system, 4)
    expected, *_ = integrate_thousands(structure, packed, drive)
    broken = packed.copy()
    broken[1, -1] = np.nan
    broken[2] = pack(system._replace(upper=system.lower + 1e-7, heating=system.heating * 1e3))
    states, outcome, _ = integrate_thousands(structure, broken, drive)
    assert outcome.tolist() == [FINISHED, NOT_FINITE, TOO_MANY_SWITCHES, FINISHED]
    np.testing.assert_allclose(states[:, :, [0, 3]], expected[:, :, [0, 3]], rtol=0, atol=1e-9)
