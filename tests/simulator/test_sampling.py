"""What the sensors say of the states on the grid, and its derivative."""

import numpy as np
import pytest
from numba import njit
from scipy.optimize import check_grad

from flightcal.simulator.drive import make_grid
from flightcal.simulator.kernels import sampling as kernels
from flightcal.simulator.kernels.forward import Record
from flightcal.simulator.kernels.sampling import SpreadCall, spread
from flightcal.simulator.sampling import Sensors, locate

from .. import oracle
from ..oracle import QUICKLY_COMPILED, jax
from .systems import drive_of

NOTHING = np.empty(0)


@njit
def interpolate(sampling, sensors, times, on_grid, errors, at_samples):
    kernels.interpolate(sampling, sensors, times, on_grid, errors, at_samples)


def spread_back(sampling, sensors, grid, states, errors, weights):
    """Cotangents of states [K+1, n] and errors [3, N] from those of the samples [T, N]."""
    states_bar, errors_bar = np.empty_like(states), np.empty_like(errors)
    record = Record._make([np.empty(0)] * len(Record._fields))._replace(states=states[None])
    spread(SpreadCall(sampling, sensors, grid, record, errors[None], weights, states_bar, errors_bar))
    return states_bar, errors_bar


def no_errors(channels):
    return np.array([[1.0], [0.0], [0.0]]) * np.ones(channels)


def at_samples(sampling, grid, on_grid, sensors=None, errors=None):
    channels = on_grid.shape[1] if sensors is None else len(sensors.state)
    sensors = Sensors(np.arange(channels), np.zeros(channels, bool)) if sensors is None else sensors
    found = np.empty((len(sampling.point), channels))
    interpolate(sampling, sensors, grid, on_grid, no_errors(channels) if errors is None else errors, found)
    return found


def test_dense_samples_are_interpolated_instead_of_refining_the_grid():
    samples = np.arange(0.0, 301.0, 1.0)
    grid = make_grid(300.0, 30.0, samples, NOTHING, NOTHING, settle=False)
    assert len(grid) == 11
    line = np.stack([grid * 2.0, grid * 0.0 + 1.0], axis=1)
    np.testing.assert_allclose(at_samples(locate(samples, grid), grid, line)[:, 0], 2.0 * samples)


def test_a_sample_at_a_jump_is_seen_after_it():
    grid = make_grid(300.0, 30.0, NOTHING, NOTHING, np.array([100.0]), settle=False)
    after = (np.arange(len(grid)) > np.flatnonzero(grid == 100.0)[0]).astype(float)[:, None]
    assert at_samples(locate(np.array([99.999999999, 100.0]), grid), grid, after)[1, 0] == 1.0


def test_a_reading_in_celsius_is_gain_times_the_temperature_in_celsius_plus_bias():
    grid = np.array([0.0, 60.0])
    sensors = Sensors(np.array([0]), np.array([False]))
    errors = np.array([[1.02], [0.5], [0.0]])
    seen = at_samples(locate(grid, grid), grid, np.array([[273.15 - 40.0], [273.15 + 60.0]]), sensors, errors)
    np.testing.assert_allclose(seen[:, 0] - 273.15, [1.02 * -40.0 + 0.5, 1.02 * 60.0 + 0.5])


@pytest.mark.parametrize("offset", [-70.0, -3.0, 0.0, 11.0, 70.0])
def test_a_time_offset_moves_the_samples_of_a_ramp_and_no_further_than_the_window(offset):
    grid = make_grid(300.0, 30.0, NOTHING, NOTHING, np.array([100.0]), settle=False)
    samples = np.linspace(0.0, 300.0, 21)
    sensors = Sensors(np.array([0, 0]), np.array([True, False]))
    errors = no_errors(2)
    errors[2, 0] = offset
    seen = at_samples(locate(samples, grid), grid, (280.0 + 0.02 * grid)[:, None], sensors, errors)
    np.testing.assert_allclose(seen[:, 0], 280.0 + 0.02 * np.clip(samples + offset, 0.0, 300.0))
    np.testing.assert_allclose(seen[:, 1], 280.0 + 0.02 * samples)


@pytest.fixture
def scene():
    """A grid with a jump and settling steps, states of any kind, and sensors of which some are moved."""
    rng = np.random.default_rng(0)
    grid = make_grid(300.0, 30.0, NOTHING, NOTHING, np.array([100.0]), settle=True)
    states = 280.0 + rng.normal(size=(len(grid), 3))
    samples = np.sort(rng.uniform(0, 300, 40))
    sensors = Sensors(np.array([2, 0, 2, 1]), np.array([True, False, False, True]))
    errors = np.array([[0.9, 1.1, 1.0, 1.3], [0.3, 0.0, -1.0, 2.0], [17.0, 0.0, 0.0, -41.0]])
    return grid, states, samples, sensors, errors, rng.normal(size=(40, 4))


def test_what_sensors_say_and_its_derivative_are_the_oracles(scene):
    grid, states, samples, sensors, errors, weights = scene
    drive = drive_of(grid, np.ones((len(grid), 1)))

    def said(states, errors):
        return oracle.observe(states, drive, samples, sensors.state, errors)

    got = at_samples(locate(samples, grid), grid, states, sensors, errors)
    np.testing.assert_allclose(got, said(states, errors), atol=1e-9)
    states_bar, errors_bar = spread_back(locate(samples, grid), sensors, grid, states, errors, weights)
    gradient = jax.grad(lambda *at: (said(*at) * weights).sum(), argnums=(0, 1))
    by_states, by_errors = jax.jit(gradient, compiler_options=QUICKLY_COMPILED)(states, errors)
    by_errors = by_errors.at[2].multiply(sensors.moved)
    np.testing.assert_allclose(states_bar, by_states, atol=1e-9)
    np.testing.assert_allclose(errors_bar, by_errors, atol=1e-7)
    assert np.abs(errors_bar[2, sensors.moved]).min() > 1e-3


def test_the_derivative_by_the_errors_agrees_with_differences(scene):
    grid, states, samples, sensors, errors, weights = scene

    def value(flat):
        return float((at_samples(locate(samples, grid), grid, states, sensors, flat.reshape(3, 4)) * weights).sum())

    def gradient(flat):
        return spread_back(locate(samples, grid), sensors, grid, states, flat.reshape(3, 4), weights)[1].ravel()

    assert check_grad(value, gradient, errors.ravel(), epsilon=1e-6) < 1e-3 * np.abs(gradient(errors.ravel())).max()


def test_the_slope_of_the_steps_that_settle_massless_nodes_is_not_one_in_time():
    """Such a node jumps within a ten-thousandth of a second, and a sample at the jump must not see that as a rate."""
    grid = make_grid(300.0, 30.0, NOTHING, NOTHING, np.array([100.0]), settle=True)
    states = np.where(np.arange(len(grid)) < 2, 290.0, 250.0)[:, None]
    sensors, sampling = Sensors(np.array([0]), np.array([True])), locate(np.array([0.0, 60.0]), grid)
    _, errors_bar = spread_back(sampling, sensors, grid, states, no_errors(1), np.ones((2, 1)))
    assert errors_bar[2, 0] == 0.0
