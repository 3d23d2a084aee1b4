import numpy as np
import pytest

from flightcal.simulator.inputs import make_grid
from flightcal.simulator.sampling import interpolate, locate, spread

NOTHING = np.empty(0)


def at_samples(sampling, on_grid, states=None):
    states = np.arange(on_grid.shape[1]) if states is None else states
    found = np.empty((len(sampling.point), len(states)))
    interpolate(sampling, on_grid, states, np.zeros(len(states)), found)
    return found


def test_dense_samples_are_interpolated_instead_of_refining_the_grid():
    samples = np.arange(0.0, 301.0, 1.0)
    grid = make_grid(300.0, 30.0, samples, NOTHING, NOTHING, settle=False)
    assert len(grid) == 11
    line = np.stack([grid * 2.0, grid * 0.0 + 1.0], axis=1)
    np.testing.assert_allclose(at_samples(locate(samples, grid), line)[:, 0], 2.0 * samples)


def test_a_sample_at_a_jump_is_seen_after_it():
    grid = make_grid(300.0, 30.0, NOTHING, NOTHING, np.array([100.0]), settle=False)
    after = (np.arange(len(grid)) > np.flatnonzero(grid == 100.0)[0]).astype(float)[:, None]
    assert at_samples(locate(np.array([99.999999999, 100.0]), grid), after)[1, 0] == 1.0


def test_spread_is_the_transpose_of_interpolate():
    rng = np.random.default_rng(0)
    grid = make_grid(300.0, 30.0, NOTHING, NOTHING, np.array([100.0]), settle=True)
    sampling = locate(np.sort(rng.uniform(0, 300, 40)), grid)
    x, y = rng.normal(size=(len(grid), 3)), rng.normal(size=(40, 3))
    states = np.array([2, 0, 2])
    on_grid, offsets = np.empty_like(x), np.empty(3)
    spread(sampling, y, states, on_grid, offsets)
    assert (at_samples(sampling, x, states) * y).sum() == pytest.approx((x * on_grid).sum())
    np.testing.assert_allclose(offsets, y.sum(axis=0))
