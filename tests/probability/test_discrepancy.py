"""The basis of the discrepancy: which covariance its prior gives."""

import numpy as np
import pytest

from flightcal.probability.discrepancy import frequencies, in_phase

from .residual_cases import INDEPENDENT, Case


def matern(smoothness, length, gap):
    x = np.sqrt(2 * smoothness) * np.abs(gap) / length
    return (1 + x + (x**2 / 3 if smoothness == 2.5 else 0)) * np.exp(-x)


@pytest.mark.parametrize("smoothness", [1.5, 2.5])
def test_the_covariance_is_that_of_the_matern_process_around_the_orbit(smoothness):
    length, frequency = 0.3, frequencies(60)
    density = (2 * smoothness / length**2 + frequency**2) ** (-smoothness - 0.5) * np.where(frequency == 0, 1, 2)
    phase = np.linspace(0.0, 1.0, 50)
    functions = in_phase(phase, 60)
    found = functions * (density / density[:61].sum()) @ functions.T
    turns = np.arange(-30, 31)
    around = matern(smoothness, length, (phase[:, None] - phase)[..., None] + turns).sum(axis=-1)
    np.testing.assert_allclose(found, around / around[0, 0], atol=1e-4)
    np.testing.assert_allclose(found[0], found[-1], atol=1e-12)


@pytest.mark.parametrize("smoothness", [1.5, 2.5])
def test_the_prior_variance_is_the_amplitude_squared_everywhere(smoothness):
    case = Case((INDEPENDENT, INDEPENDENT), (True, True), smoothness=smoothness)
    for k in range(2):
        deviations = case.residuals.shapes.prior.deviations(case.numbers[k, -2:])
        np.testing.assert_allclose(deviations**2, case.prior_variances(k), rtol=1e-12)
        variance = case.basis**2 @ deviations**2
        np.testing.assert_allclose(variance, case.numbers[k, -2] ** 2, rtol=1e-12)
