"""A Matern process beyond an edge, against its covariance function."""

import numpy as np
import pytest
from scipy.linalg import expm

from flightcal.prediction.matern import ORDER, continue_path, covariance, fading, stationary, transition

LENGTH, AMPLITUDE = 700.0, 2.0


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
def test_a_continued_path_has_the_covariance_of_the_process(smoothness):
    rng, count = np.random.default_rng(0), 20_000
    rest = stationary(smoothness, np.array(AMPLITUDE), np.array(LENGTH))
    scale = np.sqrt(np.diag(rest))
    root = scale[:, None] * np.linalg.cholesky(rest / np.outer(scale, scale))
    state = (root @ rng.standard_normal((ORDER[smoothness], count))).T
    sizes, lengths = np.full(count, AMPLITUDE), np.full(count, LENGTH)
    values = continue_path(smoothness, sizes, lengths, state, np.array([100.0, 200.0, 200.0]), rng)
    times = np.array([0.0, 100.0, 300.0, 500.0])
    found = np.cov(np.concatenate([state[None, :, 0], values]))
    expected = covariance(smoothness, AMPLITUDE, LENGTH, times[:, None] - times)
    # A sample covariance of so many draws is known to sqrt(2 / count) of the variance.
    np.testing.assert_allclose(found, expected, atol=5 * np.sqrt(2 / count) * AMPLITUDE**2)
