"""Principal shapes of trajectories, and what they leave out."""

import numpy as np

from flightcal.emulation.principal import principal_shapes


def trajectories(runs, rank, seed=0, rough=0.0):
    """Runs [S, 30, 2] of `rank` shapes, and of white noise of size `rough`."""
    rng = np.random.default_rng(seed)
    shapes = np.random.default_rng(99).standard_normal((rank, 30, 2)) * np.geomspace(10.0, 1.0, rank)[:, None, None]
    return (
        280.0
        + np.einsum("sr,rtn->stn", rng.standard_normal((runs, rank)), shapes)
        + rough * rng.standard_normal((runs, 30, 2))
    )


def tail_of(found):
    """Root mean square of what the shapes are said to leave out of each channel [N], K."""
    return np.sqrt(np.einsum("tnr,r->tn", found.tail**2, found.tail_variance).mean(axis=0))


def test_at_full_rank_the_shapes_are_exact():
    runs = trajectories(40, 5)
    found = principal_shapes(runs, np.array([1e-6, 1e-6]))
    assert found.shapes.shape == (30, 2, 5)
    rebuilt = found.mean + np.einsum("sr,tnr->stn", found.coefficients(runs), found.shapes)
    np.testing.assert_allclose(rebuilt, runs, atol=1e-9)
    new = trajectories(10, 5, seed=1)
    rebuilt = found.mean + np.einsum("sr,tnr->stn", found.coefficients(new), found.shapes)
    np.testing.assert_allclose(rebuilt, new, atol=1e-9)
    assert tail_of(found).max() < 1e-9


def test_coefficients_have_mean_zero_and_variance_one():
    runs = trajectories(40, 5)
    coefficients = principal_shapes(runs, np.array([0.1, 0.1])).coefficients(runs)
    np.testing.assert_allclose(coefficients.mean(axis=0), 0.0, atol=1e-9)
    np.testing.assert_allclose(coefficients.std(axis=0, ddof=1), 1.0, rtol=1e-9)


def test_a_finer_tolerance_takes_more_shapes():
    runs = trajectories(60, 8)
    counts = [principal_shapes(runs, np.full(2, kelvin)).shapes.shape[2] for kelvin in (20.0, 5.0, 0.1)]
    assert counts[0] < counts[1] < counts[2] == 8


def test_what_is_left_out_is_that_of_runs_not_seen():
    runs = trajectories(60, 4, rough=0.5)
    found = principal_shapes(runs, np.full(2, 0.01))
    assert found.shapes.shape[2] == 25  # noise has no shapes: the most that are taken
    new = trajectories(400, 4, seed=1, rough=0.5)
    left_out = new - found.mean - np.einsum("sr,tnr->stn", found.coefficients(new), found.shapes)
    seen = runs - found.mean - np.einsum("sr,tnr->stn", found.coefficients(runs), found.shapes)
    unseen = np.sqrt(np.mean(left_out**2, axis=(0, 1)))
    np.testing.assert_allclose(tail_of(found), unseen, rtol=0.15)
    assert (np.sqrt(np.mean(seen**2, axis=(0, 1))) < 0.75 * unseen).all()


def test_channels_count_by_their_tolerance():
    runs = trajectories(60, 8)
    found = principal_shapes(runs, np.array([1e-3, 1e3]))
    left_out = runs - found.mean - np.einsum("sr,tnr->stn", found.coefficients(runs), found.shapes)
    assert np.sqrt(np.mean(left_out[..., 0] ** 2)) < 1e-3
