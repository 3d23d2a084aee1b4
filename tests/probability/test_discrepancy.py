"""The bases of the discrepancy: which covariance their priors give."""

import numpy as np
import pytest

from flightcal.probability.discrepancy import (
    PhaseBasis,
    functions_for,
    longest_lengthscale,
    matern_factor,
    shortest_lengthscale,
    time_basis,
)

from .residual_cases import INDEPENDENT, Case


def matern(smoothness, length, gap):
    x = np.sqrt(2 * smoothness) * np.abs(gap) / length
    return (1 + x + (x**2 / 3 if smoothness == 2.5 else 0)) * np.exp(-x)


def covariance(basis, smoothness, length, seconds):
    density = matern_factor(smoothness) * length ** (-2 * smoothness)
    density = density * (2 * smoothness / length**2 + basis.frequencies**2) ** (-smoothness - 0.5)
    functions = basis.at(seconds)
    return functions * density @ functions.T


@pytest.mark.parametrize("smoothness", [1.5, 2.5])
@pytest.mark.parametrize("place", ["shortest", "longest"])
def test_in_time_the_covariance_is_that_of_the_matern_process(smoothness, place):
    """Within what 40 functions can tell: at the edges of the lengthscales that they are made for."""
    seconds = np.linspace(1000.0, 13000.0, 80)
    longest = longest_lengthscale(1000.0, 13000.0)
    basis = time_basis(1000.0, 13000.0, longest, smoothness, 40)
    length = longest if place == "longest" else shortest_lengthscale(basis, smoothness)
    assert (
        np.abs(
            covariance(basis, smoothness, length, seconds) - matern(smoothness, length, seconds[:, None] - seconds)
        ).max()
        < 0.05
    )
    assert functions_for(basis, smoothness, length) <= 40
    assert functions_for(basis, smoothness, 0.5 * shortest_lengthscale(basis, smoothness)) == 80


@pytest.mark.parametrize("smoothness", [1.5, 2.5])
def test_the_shortest_lengthscale_needs_just_the_functions_that_there_are(smoothness):
    for count in range(5, 300):
        basis = time_basis(0.0, 10740.0, 2685.0, smoothness, count)
        assert functions_for(basis, smoothness, shortest_lengthscale(basis, smoothness)) == count


@pytest.mark.parametrize("smoothness", [1.5, 2.5])
def test_of_short_lengthscales_it_is_so_up_to_the_windows_ends(smoothness):
    seconds, length = np.linspace(0.0, 12000.0, 80), 400.0
    found = covariance(time_basis(0.0, 12000.0, length, smoothness, 150), smoothness, length, seconds)
    np.testing.assert_allclose(found, matern(smoothness, length, seconds[:, None] - seconds), atol=0.05)


def test_derivatives_of_the_functions_are_those_of_differences():
    basis = time_basis(0.0, 5000.0, 1500.0, 1.5, 9)
    seconds = np.linspace(0.0, 5000.0, 7)
    for order in (1, 2):
        difference = (basis.at(seconds + 0.1, order - 1) - basis.at(seconds - 0.1, order - 1)) / 0.2
        scale = np.abs(basis.at(seconds, order)).max()
        np.testing.assert_allclose(basis.at(seconds, order), difference, atol=1e-6 * scale)


@pytest.mark.parametrize("smoothness", [1.5, 2.5])
def test_in_phase_the_covariance_is_that_of_the_matern_process_around_the_orbit(smoothness):
    length, basis = 0.3, PhaseBasis(60)
    frequency = basis.frequencies
    density = (2 * smoothness / length**2 + frequency**2) ** (-smoothness - 0.5) * np.where(frequency == 0, 1, 2)
    phase = np.linspace(0.0, 1.0, 50)
    functions = basis.at(phase)
    found = functions * (density / density[:61].sum()) @ functions.T
    turns = np.arange(-30, 31)
    around = matern(smoothness, length, (phase[:, None] - phase)[..., None] + turns).sum(axis=-1)
    np.testing.assert_allclose(found, around / around[0, 0], atol=1e-4)
    np.testing.assert_allclose(found[0], found[-1], atol=1e-12)


@pytest.mark.parametrize("smoothness", [(1.5, 2.5), (2.5, 1.5)])
def test_in_phase_the_prior_variance_is_the_amplitude_squared_everywhere(smoothness):
    case = Case((INDEPENDENT, INDEPENDENT), (True, True), smoothness=smoothness, parts=("phase",))
    for k in range(2):
        variance = case.basis**2 @ case.prior_variances(k)
        np.testing.assert_allclose(variance, case.numbers[k, -2] ** 2, rtol=1e-12)
