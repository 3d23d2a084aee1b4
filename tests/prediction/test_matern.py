"""A Matern process beyond an edge, against its covariance function."""

import numpy as np
import pytest
from scipy.linalg import expm

from flightcal.prediction import matern
from flightcal.prediction.matern import ORDER, continue_path, covariance, fading, stationary, transition

LENGTH, AMPLITUDE = 700.0, 2.0


def at_rest(smoothness, length, count, rng):
    """Draws [count, p] of the stationary state."""
    rest = stationary(smoothness, np.array(AMPLITUDE), np.array(length))
    scale = np.sqrt(np.diag(rest))
    root = scale[:, None] * np.linalg.cholesky(rest / np.outer(scale, scale))
    return (root @ rng.standard_normal((ORDER[smoothness], count))).T


@pytest.mark.parametrize("smoothness", [1.5, 2.5])
@pytest.mark.parametrize("gap", [10.0, 400.0, 5000.0])
def test_the_transition_is_that_of_the_stochastic_differential_equation(smoothness, gap):
    rate = np.sqrt(2 * smoothness) / LENGTH
    drift = {
        1.5: [[0, 1], [-(rate**2), -2 * rate]],
        2.5: [[0, 1, 0], [0, 0, 1], [-(rate**3), -3 * rate**2, -3 * rate]],
    }[smoothness]
    found = transition(smoothness, np.array(LENGTH), gap)
    np.testing.assert_allclose(found, expm(np.array(drift) * gap), rtol=1e-10)
    np.testing.assert_allclose(fading(smoothness, LENGTH, np.array([gap]))[0], found[0], rtol=1e-12)


@pytest.mark.parametrize("smoothness", [1.5, 2.5])
@pytest.mark.parametrize("length", [0.7, 700.0, 7e6])
def test_a_continued_path_has_the_covariance_of_the_process(smoothness, length):
    rng, count = np.random.default_rng(0), 20_000
    sizes, lengths = np.full(count, AMPLITUDE), np.full(count, length)
    state = at_rest(smoothness, length, count, rng)
    values = continue_path(smoothness, sizes, lengths, state, length / 7 * np.array([1.0, 2.0, 2.0]), rng)
    times = length / 7 * np.array([0.0, 1.0, 3.0, 5.0])
    found = np.cov(np.concatenate([state[None, :, 0], values]))
    expected = covariance(smoothness, AMPLITUDE, length, times[:, None] - times)
    # A sample covariance of so many draws is known to sqrt(2 / count) of the variance.
    np.testing.assert_allclose(found, expected, atol=5 * np.sqrt(2 / count) * AMPLITUDE**2)


@pytest.mark.parametrize(("smoothness", "step"), [(1.5, 0.1), (2.5, 10.0), (2.5, 180.0)])
def test_many_steps_so_short_that_rounding_hides_them_are_one_long_one(smoothness, step):
    """What a step of 10 s adds to a process of 10 hours is less than the rounding of its covariance."""
    rng, count, steps, length = np.random.default_rng(0), 4000, 300, 36000.0
    sizes, lengths, at = np.full(count, AMPLITUDE), np.full(count, length), np.zeros((count, ORDER[smoothness]))
    values = continue_path(smoothness, sizes, lengths, at, np.full(steps, step), rng)[-1]
    rest = stationary(smoothness, np.array(AMPLITUDE), np.array(length))
    moved = transition(smoothness, np.array(length), steps * step)
    expected = np.sqrt((rest - moved @ rest @ moved.T)[0, 0])
    # A standard deviation of so many draws is known to 1 / sqrt(2 count); each step may add the root of rounding.
    assert values.std() == pytest.approx(expected, rel=4 / np.sqrt(2 * count), abs=AMPLITUDE * np.sqrt(1e-15 * steps))


@pytest.mark.parametrize("smoothness", [1.5, 2.5])
def test_a_path_without_a_gap_is_where_its_state_is(smoothness):
    rng = np.random.default_rng(0)
    state = at_rest(smoothness, LENGTH, 10, rng)
    sizes, lengths = np.full(10, AMPLITUDE), np.full(10, LENGTH)
    values = continue_path(smoothness, sizes, lengths, state, np.array([0.0, 0.0]), rng)
    # The root of the rounding, twice.
    np.testing.assert_allclose(values, [state[:, 0]] * 2, atol=1e-6)


def test_gaps_that_differ_by_rounding_are_one_step_and_others_are_not(monkeypatch):
    asked = []

    def noted(smoothness, length, gap):
        asked.append(gap)
        return transition(smoothness, length, gap)

    monkeypatch.setattr(matern, "transition", noted)
    rounded = 60.0 + 1e-9 * np.arange(5)
    one = np.ones(1)
    continue_path(
        2.5, one, LENGTH * one, np.zeros((1, 3)), np.array([*rounded, 60.001, 60.0]), np.random.default_rng(0)
    )
    assert asked == [60.0, 60.001]
