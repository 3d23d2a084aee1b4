"""Functions of time that unmodelled heat is made of."""

import numpy as np
import pytest

from flightcal.probability import Slow, pattern, waves
from flightcal.probability.heat import cholesky, fading, hats

HARMONICS = 4
PHASE = np.arange(240) / 240.0
TIME = 10800.0
KNOTS = np.arange(2, 9) * TIME / 3.0
JITTER = 1e-9
"""What the factor of a covariance has more than the covariance."""


def test_waves_are_a_constant_and_orthogonal_over_an_orbit():
    found = waves(PHASE, HARMONICS)
    assert found.shape == (1 + 2 * HARMONICS, len(PHASE))
    mean_products = found @ found.T / len(PHASE)
    np.testing.assert_allclose(mean_products, np.diag([1.0] + [0.5] * 2 * HARMONICS), atol=1e-12)


def test_waves_are_cosine_and_sine_of_each_harmonic():
    found = waves(np.array([0.0, 0.125, 1.25]), 2)
    half = np.sqrt(0.5)
    expected = [[1, 1, 1], [1, half, 0], [0, half, 1], [1, 0, -1], [0, 1, 0]]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_waves_without_harmonics_are_the_constant():
    np.testing.assert_array_equal(waves(PHASE, 0), np.ones((1, len(PHASE))))
    np.testing.assert_array_equal(pattern(PHASE, 0), np.ones((1, len(PHASE))))


def test_a_pattern_falls_off_from_the_third_harmonic_on():
    ratio = pattern(PHASE + 0.01, 6)[:, 3] / waves(PHASE + 0.01, 6)[:, 3]
    order = np.array([0, *(k for k in range(1, 7) for _ in "cs")])
    np.testing.assert_allclose(ratio, (1.0 + order**2 / 9.0) ** -0.5, rtol=1e-12)
    assert ratio[5] == pytest.approx(np.sqrt(0.5), rel=1e-12)


def test_a_pattern_is_equally_uncertain_at_every_phase():
    variance = (pattern(PHASE, 6) ** 2).sum(axis=0)
    np.testing.assert_allclose(variance, variance[0], rtol=1e-12)


def test_hats_interpolate_between_knots_and_hold_beyond():
    values = np.random.default_rng(0).standard_normal(len(KNOTS))
    seconds = np.linspace(KNOTS[0] - 5000.0, KNOTS[-1] + 5000.0, 50)
    np.testing.assert_allclose(values @ hats(seconds, KNOTS), np.interp(seconds, KNOTS, values), atol=1e-12)
    np.testing.assert_allclose(hats(seconds, KNOTS).sum(axis=0), 1.0, atol=1e-12)


# --- what is slow ---------------------------------------------------------------------------------------------


def test_slow_heat_is_an_ornstein_uhlenbeck_process_at_its_knots():
    found = Slow(KNOTS, TIME).at(KNOTS)
    expected = np.exp(-np.abs(KNOTS[:, None] - KNOTS) / TIME)
    np.testing.assert_allclose(found.T @ found, expected, atol=2 * JITTER)


def test_slow_heat_is_linear_between_knots():
    slow = Slow(KNOTS, TIME)
    at_knots, between = slow.at(KNOTS), slow.at(0.25 * KNOTS[:-1] + 0.75 * KNOTS[1:])
    np.testing.assert_allclose(between, 0.25 * at_knots[:, :-1] + 0.75 * at_knots[:, 1:], atol=1e-12)


def test_plain_weights_of_slow_heat_are_its_values_at_the_knots():
    values = np.random.default_rng(0).standard_normal(len(KNOTS))
    seconds = np.linspace(KNOTS[0], KNOTS[-1], 33)
    plain = Slow(KNOTS, TIME, plain=True)
    np.testing.assert_allclose(values @ plain.at(seconds), np.interp(seconds, KNOTS, values), atol=1e-12)
    weights = np.linalg.solve(Slow(KNOTS, TIME).root, values)
    np.testing.assert_allclose(weights @ Slow(KNOTS, TIME).at(seconds), values @ plain.at(seconds), atol=1e-9)


OTHERS = {
    "after": KNOTS[-1] + np.arange(1, 5) * TIME / 3.0,
    "before": KNOTS[0] - np.arange(4, 0, -1) * TIME / 3.0,
    "some the same": KNOTS[-1] + np.arange(-2, 3) * TIME / 3.0,
    "in a gap": KNOTS[0] + np.array([0.4, 0.8]) * TIME / 3.0,
}


@pytest.mark.parametrize("others", OTHERS.values(), ids=OTHERS)
def test_beyond_its_knots_it_is_the_dense_conditional_normal(others):
    slow = Slow(KNOTS, TIME)
    weights = np.random.default_rng(0).standard_normal(len(KNOTS))
    every = np.concatenate([KNOTS, others])
    covariance = np.exp(-np.abs(every[:, None] - every) / TIME)
    q = len(KNOTS)
    gain = covariance[q:, :q] @ np.linalg.inv(covariance[:q, :q])
    expected, factor = slow.beyond(others)
    np.testing.assert_allclose(expected @ weights, gain @ (slow.root @ weights), atol=20 * JITTER)
    left = covariance[q:, q:] - gain @ covariance[:q, q:]
    np.testing.assert_allclose(factor @ factor.T, left, atol=20 * JITTER)


def test_what_is_expected_and_what_is_not_are_as_large_as_the_prior_together():
    slow = Slow(KNOTS, TIME)
    others = OTHERS["after"]
    expected, factor = slow.beyond(others)
    np.testing.assert_allclose(expected @ expected.T + factor @ factor.T, fading(others, others, TIME), atol=2 * JITTER)


def test_long_after_its_knots_slow_heat_has_faded_to_its_prior():
    far = KNOTS[-1] + 25.0 * TIME + np.arange(4) * TIME / 3.0
    expected, factor = Slow(KNOTS, TIME).beyond(far)
    assert np.abs(expected).max() < np.exp(-25.0) * (1.0 + 1e-6)
    np.testing.assert_allclose(factor @ factor.T, fading(far, far, TIME), atol=2 * JITTER)


def test_a_covariance_without_rank_has_a_factor():
    one = np.ones((3, 1))
    factor = cholesky(one @ one.T - 1e-13 * np.eye(3))
    np.testing.assert_allclose(factor @ factor.T, one @ one.T, atol=2 * JITTER)
