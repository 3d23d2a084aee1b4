"""Eight simulations side by side against the same ones by themselves."""

import numpy as np
import pytest
from numba import njit

from flightcal.simulator.integrate import Observation, switches
from flightcal.simulator.kernels.forward import FINISHED, NOT_FINITE, TOO_MANY_SWITCHES
from flightcal.simulator.kernels.lanes import WIDTH, elements, lane_count, lane_memory, put, take
from flightcal.simulator.sampling import Sensors
from flightcal.simulator.system import pack

from .systems import random_system, simulated


@njit(_nrt=False)
def reckon(memory, out):
    x, y = elements(memory), elements(out)
    for i in range(memory.shape[0] - 1):
        total = x[i] * 2.0
        total += 1.0 / x[i + 1]
        total -= x[i] * x[i + 1]
        y[i] = 3 * total / x[i] - x[i + 1]
    y[memory.shape[0] - 1] = 7.0
    for lane in range(lane_count(memory)):
        put(y, 0, lane, take(x, 0, lane) + lane)


def test_lanes_reckon_as_single_numbers_do():
    values = np.random.default_rng(0).uniform(1.0, 2.0, (5, WIDTH))
    memory, out = lane_memory(5), lane_memory(5)
    assert memory.ctypes.data % 64 == 0
    memory[:] = values
    reckon(memory, out)
    for lane in range(WIDTH):
        single = np.empty(5)
        reckon(values[:, lane].copy(), single)
        np.testing.assert_allclose(out[1:, lane], single[1:], rtol=1e-14)
        assert out[0, lane] == values[0, lane] + lane


CASES = {
    "two thermostats and a massless node": {},
    "three thermostats on ten nodes": {"nodes": 10, "heaters": 3, "massless": 2},
    "one heater measured, two simulated": {"heaters": 3, "measured_heaters": 1, "seed": 3},
    "no heater": {"heaters": 0},
    "conductances with a slope": {"slope": 4e-3},
}


def around(system, count):
    """Packed systems near one, each with its own heat, thresholds and start."""
    rng = np.random.default_rng(0)
    moved = []
    for _ in range(count):
        shift = rng.normal(0.0, 1.0)
        moved.append(
            pack(
                system._replace(
                    forcing=system.forcing * rng.uniform(0.9, 1.1, system.forcing.shape),
                    heating=system.heating * rng.uniform(0.8, 1.2, system.heating.shape),
                    lower=system.lower + shift,
                    upper=system.upper + shift,
                    initial=system.initial + rng.normal(0.0, 2.0, system.initial.shape),
                )
            )
        )
    return np.stack(moved)


@pytest.mark.parametrize("count", [1, 5, WIDTH, 21])
@pytest.mark.parametrize("options", CASES.values(), ids=CASES.keys())
def test_simulations_side_by_side_are_those_one_by_one(options, count):
    structure, system, drive = random_system(**{"seed": 1, **options})
    packed = around(system, count)
    samples = np.linspace(0.0, drive.times[-1], 70)
    observation = Observation(samples, Sensors(np.array([2, 0]), np.array([False, True])))
    errors = np.array([[1.0], [0.0], [0.0]]) + np.random.default_rng(1).normal(size=(count, 3, 2))
    outputs = simulated(structure, packed, drive, observation, errors, lanes=True).outputs
    assert (outputs.outcome == FINISHED).all()
    numbers = set()
    for k in range(count):
        alone = simulated(structure, packed[k], drive, observation, errors[k]).outputs
        np.testing.assert_allclose(outputs.temperatures[k], alone.temperatures[0], rtol=0, atol=1e-9)
        np.testing.assert_array_equal(outputs.status[k], alone.status[0])
        np.testing.assert_allclose(outputs.duty_cycle[k], alone.duty_cycle[0], atol=1e-9)
        found, expected = switches(outputs, k), switches(alone, 0)
        np.testing.assert_allclose(found.time, expected.time, atol=1e-6)
        np.testing.assert_array_equal(found.heater, expected.heater)
        np.testing.assert_array_equal(found.on, expected.on)
        numbers.add(len(expected.time))
    if count == 21 and options.get("heaters", 2):
        assert len(numbers) > 1, "the simulations must differ in their switches to test anything"


def test_a_failed_simulation_leaves_its_neighbours_alone():
    structure, system, drive = random_system(1)
    packed = around(system, 12)
    expected = simulated(structure, packed, drive, lanes=True).outputs
    broken = packed.copy()
    broken[3, -1] = np.nan
    tight = system._replace(upper=system.lower + 1e-7, heating=system.heating * 1e3)
    broken[5] = pack(tight)
    outputs = simulated(structure, broken, drive, lanes=True).outputs
    assert outputs.outcome[3] == NOT_FINITE
    assert outputs.outcome[5] == TOO_MANY_SWITCHES
    others = [k for k in range(12) if k not in (3, 5)]
    assert (outputs.outcome[others] == FINISHED).all()
    np.testing.assert_array_equal(outputs.duty_cycle[others], expected.duty_cycle[others])


def test_results_do_not_depend_on_what_is_in_the_other_lanes():
    structure, system, drive = random_system(1)
    packed = around(system, 16)
    outputs = simulated(structure, packed, drive, lanes=True).outputs
    turned = simulated(structure, packed[::-1].copy(), drive, lanes=True).outputs
    np.testing.assert_array_equal(outputs.duty_cycle, turned.duty_cycle[::-1])
