"""Sizes of heat and noise, against the dense normal distribution."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.linalg import block_diag

from flightcal.calibration.sizes import Around
from flightcal.probability import Priors
from flightcal.scenario import HalfNormal, HalfStudentT
from tests.calibration.heated import below, scores


@pytest.fixture(scope="module")
def linear():
    """`Around` of two windows of two channels, the second's noise known; columns and residuals of each part."""
    rng = np.random.default_rng(0)
    counts, r, m = (30, 25, 20, 28), 9, 6
    columns = [rng.normal(size=(count, r)) for count in counts]
    left = [rng.normal(size=count) for count in counts]
    names = ("noise.a", "noise.a.correlation_time", "heat.x", "heat.y")
    half_normals = (HalfNormal(scale=scale) for scale in (1.0, 300.0, 0.5))
    sizes = Priors(names, (*half_normals, HalfStudentT(scale=2.0, degrees_of_freedom=3.0)))
    around = Around(
        bases=(),
        sizes=sizes,
        free=np.array([0, 2, 3]),
        noise=np.array([0, -1]),
        held=np.array([np.nan, 0.7]),
        scale=np.array([2, 2, 3, 3, 3, -1]),
        mean=rng.normal(size=r - m),
        deviation=rng.uniform(0.5, 2.0, r - m),
        moving=np.array([0, 2, 3]),
        gram=np.stack([part.T @ part for part in columns]),
        moment=np.stack([part.T @ y for part, y in zip(columns, left, strict=True)]),
        squares=np.array([y @ y for y in left]),
        samples=np.array(counts),
        determinant=rng.normal(size=4),
    )
    return around, columns, left


SIZES = np.array([0.9, 250.0, 0.4, 1.3])


def dense(linear, sizes):
    """Columns, residuals, covariance of the noise, and prior variances of the unknowns."""
    around, columns, left = linear
    deviations = [sizes[0], 0.7, sizes[0], 0.7]
    noise = block_diag(*(d**2 * np.eye(len(y)) for d, y in zip(deviations, left, strict=True)))
    roots = np.array([*sizes[[2, 2, 3, 3, 3]], 1.0, *around.deviation])
    return np.concatenate(columns), np.concatenate(left), noise, roots**2


@pytest.mark.parametrize("factor", [1.0, 0.3, 4.0])
def test_the_cost_of_sizes_is_that_of_the_dense_normal_and_their_prior(linear, factor):
    around = linear[0]
    sizes = SIZES * (factor, 1.0, factor, 1.0 / factor)
    columns, left, noise, variance = dense(linear, sizes)
    expected = stats.multivariate_normal.logpdf(left, cov=noise + columns * variance @ columns.T)
    expected += 0.5 * len(left) * np.log(2.0 * np.pi) - 0.5 * around.determinant.sum()
    at = scores(around, sizes)
    value, gradient = around.cost(at, SIZES)
    held = Priors(around.sizes.names[1:2], around.sizes.priors[1:2])
    prior = stats.norm.logpdf(at).sum() + float(held.at(held.to_z(SIZES[1:2])).log_density)
    assert -value == pytest.approx(expected + prior, rel=1e-9)
    for k, step in enumerate(1e-5 * np.eye(3)):
        sides = [around.cost(at + sign * step, SIZES)[0] for sign in (1.0, -1.0)]
        assert gradient[k] == pytest.approx((sides[0] - sides[1]) / 2e-5, rel=1e-6, abs=1e-5)


def test_the_weights_covariance_and_how_many_are_told_are_those_of_the_dense_normal(linear):
    around, (columns, _, noise, variance) = linear[0], dense(linear, SIZES)
    weights = columns[:, :6]
    expected = np.linalg.inv(np.diag(1.0 / variance[:6]) + weights.T @ np.linalg.solve(noise, weights))
    covariance, told = around.known_of_weights(SIZES)
    np.testing.assert_allclose(covariance, expected, rtol=1e-9)
    assert told == pytest.approx(6.0 - np.trace(expected / variance[:6]))


def test_z_at_given_sizes_is_that_of_the_dense_conditional_normal(linear):
    around = linear[0]
    columns, left, noise, variance = dense(linear, SIZES)
    wide = columns * variance
    gain = np.linalg.solve(noise + wide @ columns.T, wide).T
    mean, factor = around.of_z(SIZES)
    np.testing.assert_allclose(mean, around.mean + (gain @ left)[6:], atol=1e-10)
    np.testing.assert_allclose(factor @ factor.T, (np.diag(variance) - gain @ wide)[6:, 6:], atol=1e-10)


def test_the_most_probable_sizes_have_the_least_cost(linear):
    around = linear[0]
    sizes = around.most_probable(SIZES)
    at = scores(around, sizes)
    value, gradient = around.cost(at, sizes)
    assert sizes[1] == pytest.approx(SIZES[1], rel=1e-12)
    assert np.abs(gradient).max() < 0.01
    for move in 0.3 * np.random.default_rng(0).standard_normal((20, 3)):
        assert around.cost(at + move, sizes)[0] > value


def test_drawn_sizes_are_distributed_as_their_cost_says(linear):
    around, count = linear[0], 800
    sizes = around.most_probable(SIZES)
    drawn = around.draw_sizes(sizes, count, np.random.default_rng(1))
    assert (np.abs(drawn[:, 1] / sizes[1] - 1.0) < 1e-9).all()
    at = scores(around, sizes)
    axes = [middle + np.linspace(-span, span, 16) for middle, span in zip(at, (0.7, 3.0, 3.0), strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    density = np.exp(around.cost(at, sizes)[0] - [around.cost(point, sizes)[0] for point in grid])
    density /= density.sum()
    of_grid = np.stack(
        [around.sizes.priors[k].scale * stats.halfnorm.ppf(stats.norm.cdf(grid[:, i])) for i, k in enumerate((0, 2))]
        + [2.0 * stats.t.ppf(0.5 + 0.5 * stats.norm.cdf(grid[:, 2]), 3.0)],
        axis=1,
    )
    # Standard errors are 3%. The normal distribution of the scores alone has means that are a quarter off.
    np.testing.assert_allclose(drawn[:, around.free].mean(axis=0), density @ of_grid, rtol=0.12)


def test_sizes_of_which_the_telemetry_tells_nothing_are_drawn_from_their_prior(linear):
    around, count = linear[0], 1000
    gram, moment = around.gram.copy(), around.moment.copy()
    gram[:, :5], gram[:, :, :5], moment[:, :5] = 0.0, 0.0, 0.0
    blind = replace(around, gram=gram, moment=moment)
    drawn = blind.draw_sizes(blind.most_probable(SIZES), count, np.random.default_rng(0))
    for k in (2, 3):
        prior = blind.sizes.priors[k]
        assert stats.kstest(drawn[:, k], lambda sizes, prior=prior: below(prior, sizes)).pvalue > 1e-4


def draws_at(around, sizes, count=40):
    """z [S, d] of which those that are simulated are drawn at sizes."""
    rng = np.random.default_rng(3)
    z = rng.normal(size=(count, 5))
    mean, factor = around.of_z(sizes)
    z[:, around.moving] = mean + rng.standard_normal((count, len(mean))) @ factor.T
    return z


def test_draws_at_the_same_sizes_stay_where_they_are(linear):
    around = linear[0]
    z = draws_at(around, SIZES)
    spread, sizes = around.spread(z, SIZES, SIZES[None], np.random.default_rng(0))
    np.testing.assert_allclose(spread, z, rtol=0.0, atol=1e-9)
    np.testing.assert_array_equal(sizes, np.tile(SIZES, (len(z), 1)))


def test_draws_at_other_sizes_have_the_mean_and_covariance_of_these(linear):
    around, other = linear[0], SIZES * (0.5, 1.0, 2.0, 0.7)
    z = draws_at(around, SIZES)
    spread, sizes = around.spread(z, SIZES, other[None], np.random.default_rng(0))
    (mean, factor), (new_mean, new_factor) = around.of_z(SIZES), around.of_z(other)
    standard = np.linalg.solve(factor, (z[:, around.moving] - mean).T)
    np.testing.assert_allclose(
        np.linalg.solve(new_factor, (spread[:, around.moving] - new_mean).T), standard, rtol=0.0, atol=1e-9
    )
    still = np.setdiff1d(np.arange(5), around.moving)
    np.testing.assert_array_equal(spread[:, still], z[:, still])
    assert (sizes == other).all()


def test_all_drawn_sizes_have_as_many_draws(linear):
    around = linear[0]
    drawn = SIZES * np.random.default_rng(1).uniform(0.5, 2.0, (64, len(SIZES)))
    sizes = around.spread(draws_at(around, SIZES, 400), SIZES, drawn, np.random.default_rng(0))[1]
    _, counts = np.unique(sizes, axis=0, return_counts=True)
    assert len(counts) == 64
    assert counts.max() - counts.min() <= 1
