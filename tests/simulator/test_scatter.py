"""Thermostats that switch around their thresholds."""

import numpy as np

from flightcal.simulator.integrate import switches
from flightcal.simulator.kernels.forward import FINISHED
from flightcal.simulator.system import pack

from .systems import random_system, simulated


def scatter_of(count, seed=0):
    return np.random.default_rng(seed).normal(0.0, 0.2, (count, 40, 2))


def test_a_heater_switches_where_its_own_draw_has_moved_the_threshold():
    structure, system, drive = random_system(5)
    scatter = scatter_of(1)[0]
    run = simulated(structure, pack(system), drive, scatter=scatter)
    record, latest, seen = run.record, [0, 0], 0
    for segment in np.flatnonzero(record.event[0, : record.segments[0]] >= 0):
        k = record.event[0, segment]
        was_on = record.heater[0, segment, k] > 0.5
        threshold = (system.upper if was_on else system.lower)[k] + scatter[latest[k] % 40, k]
        assert abs(record.state[0, segment + 1, structure.sensor[k]] - threshold) < 1e-9
        seen += 1
        latest[k] = seen
    assert seen == len(run.switches.time) > 10
    assert min(latest) > 3, "both heaters must switch several times"


def test_scattered_simulations_side_by_side_are_those_one_by_one():
    structure, system, drive = random_system(5)
    scatter = scatter_of(11)
    packed = np.tile(pack(system), (11, 1))
    outputs = simulated(structure, packed, drive, scatter=scatter, lanes=True).outputs
    assert (outputs.outcome == FINISHED).all()
    for k in range(11):
        alone = simulated(structure, packed[k], drive, scatter=scatter[k]).outputs
        np.testing.assert_allclose(switches(outputs, k).time, switches(alone, 0).time, atol=1e-6)
    assert len({tuple(switches(outputs, k).time) for k in range(11)}) == 11
