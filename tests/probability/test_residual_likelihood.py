"""Every likelihood against dense matrices or scipy's distributions, its derivatives against differences."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.special import digamma

from flightcal.probability.likelihood import Likelihood, information, weights_given
from flightcal.probability.noise.ar1 import WHITE
from flightcal.probability.noise.rounded import STEP
from flightcal.probability.noise.student import DEGREES

from .residual_cases import (
    CORRELATED,
    CORRELATED_STUDENT,
    INDEPENDENT,
    ROUNDED,
    STUDENT,
    Case,
    iid_log_likelihood,
    log_likelihood,
)

CASES = {
    "independent": ((INDEPENDENT, INDEPENDENT), (False, False), {}),
    "correlated": ((CORRELATED, CORRELATED), (False, False), {}),
    "student": ((STUDENT, STUDENT), (False, False), {}),
    "correlated student": ((CORRELATED_STUDENT, CORRELATED_STUDENT), (False, False), {}),
    "rounded": ((ROUNDED, ROUNDED), (False, False), {}),
    "discrepancy": ((INDEPENDENT, INDEPENDENT), (True, True), {}),
    "rougher discrepancy": ((INDEPENDENT, INDEPENDENT), (True, True), {"smoothness": 1.5}),
    "discrepancy, correlated": ((CORRELATED, CORRELATED), (True, True), {}),
    "mixed": ((INDEPENDENT, CORRELATED), (True, False), {}),
}


@pytest.fixture(params=CASES)
def case(request):
    kinds, discrepant, options = CASES[request.param]
    return Case(kinds, discrepant, **options)


def value_at(case, numbers=None, simulated=None):
    return log_likelihood(
        case.residuals,
        case.observed,
        case.simulated if simulated is None else simulated,
        case.numbers if numbers is None else numbers,
    )[0]


def test_it_is_the_dense_log_density(case):
    assert value_at(case) == pytest.approx(case.dense(), rel=1e-10)


def test_what_its_memory_held_before_is_of_no_matter(case):
    expected = log_likelihood(case.residuals, case.observed, case.simulated, case.numbers)
    likelihood = Likelihood([case.residuals], case.numbers.shape[1])
    likelihood((1e3 * case.observed, case.simulated, 2.0 * case.numbers))
    value, (bars,) = likelihood((case.observed, case.simulated, case.numbers))
    assert value == expected[0]
    np.testing.assert_array_equal(bars.simulated, expected[1])
    np.testing.assert_array_equal(bars.numbers, expected[2])


def test_derivatives_by_the_numbers_are_those_of_differences(case):
    derivative = log_likelihood(case.residuals, case.observed, case.simulated, case.numbers)[2]
    differs = np.zeros(derivative.shape, bool)
    for index in np.ndindex(derivative.shape):
        if case.residuals.kinds[index[0]] == ROUNDED and index[1] == STEP:
            continue
        if case.numbers[index] == 0.0:  # the kind has fewer numbers
            assert derivative[index] == 0.0
            continue
        sides = []
        for sign in (1.0, -1.0):
            moved = case.numbers.copy()
            moved[index] *= 1.0 + sign * 1e-5
            sides.append(value_at(case, numbers=moved))
        expected = (sides[0] - sides[1]) / (2e-5 * case.numbers[index])
        differs[index] = expected != 0.0
        assert derivative[index] == pytest.approx(expected, rel=1e-6, abs=1e-6), index
    assert differs.any(axis=1).all()


def test_derivatives_by_the_simulated_are_those_of_differences(case):
    derivative = log_likelihood(case.residuals, case.observed, case.simulated, case.numbers)[1]
    for index in np.ndindex(derivative.shape):
        sides = []
        for sign in (1.0, -1.0):
            moved = case.simulated.copy()
            moved[index] += sign * 1e-5
            sides.append(value_at(case, simulated=moved))
        assert derivative[index] == pytest.approx((sides[0] - sides[1]) / 2e-5, rel=1e-6, abs=1e-6), index
    assert (derivative[np.isnan(case.observed)] == 0.0).all()


def test_correlated_noise_needs_no_white_noise_beside_it():
    case = Case((CORRELATED, CORRELATED), (False, True))
    case.numbers[:, WHITE] = 0.0
    assert value_at(case) == pytest.approx(case.dense(), rel=1e-9)


def test_independent_noise_is_the_published_likelihood():
    case = Case((INDEPENDENT, INDEPENDENT), (False, False))
    value, simulated_bar, numbers_bar, *_ = log_likelihood(case.residuals, case.observed, case.simulated, case.numbers)
    expected = iid_log_likelihood(case.observed, case.simulated, case.numbers[:, 0])
    assert value == pytest.approx(expected[0], rel=1e-13)
    np.testing.assert_allclose(simulated_bar, expected[1], rtol=1e-13)
    np.testing.assert_allclose(numbers_bar[:, 0], expected[2], rtol=1e-12)


@pytest.mark.parametrize("degrees", [0.3, 2.0, 10.9, 11.0, 12.0, 300.0])
def test_the_derivative_by_degrees_of_freedom_is_exact(degrees):
    """Differences would not see the last terms of the digamma function's series, which are largest near 11."""
    case = Case((STUDENT, STUDENT), (False, False))
    case.observed[:], case.simulated[:] = np.nan, 0.0
    case.observed[3] = [0.1, 2.0]
    case.residuals = replace(case.residuals, valid=np.isfinite(case.observed).T.copy())
    case.numbers[:, DEGREES] = degrees
    found = log_likelihood(case.residuals, case.observed, case.simulated, case.numbers)[2][:, DEGREES]
    squares = (case.observed[3] / case.numbers[:, 0]) ** 2
    expected = 0.5 * (digamma(0.5 * (degrees + 1.0)) - digamma(0.5 * degrees) - 1.0 / degrees)
    expected += 0.5 * (degrees + 1.0) * squares / (degrees * (degrees + squares)) - 0.5 * np.log1p(squares / degrees)
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1.5e-13)


@pytest.mark.parametrize("share", [1e-4, 1e-2, 1.0, 5.0])
def test_a_step_far_in_the_tail_has_its_whole_probability(share):
    """Steps of a share of the noise's standard deviation, up to 100 standard deviations away."""
    case = Case((ROUNDED, ROUNDED), (False, False))
    case.observed[:, 0] = np.linspace(-100.0, 100.0, len(case.observed))
    case.observed[:, 1] = np.geomspace(1e-8, 30.0, len(case.observed))
    case.residuals = replace(case.residuals, valid=np.ones((2, len(case.observed)), bool))
    case.simulated[:] = 0.0
    case.numbers[:, 0], case.numbers[:, STEP] = 1.0, share
    value, simulated_bar, numbers_bar, *_ = log_likelihood(case.residuals, case.observed, case.simulated, case.numbers)
    lower = np.abs(case.observed) - share / 2
    # By quadrature: the density at the lower end times the integral of how it falls from there.
    nodes, weights = np.polynomial.legendre.leggauss(200)
    reach = np.minimum(share, 40.0 / (1.0 + np.maximum(lower, 0.0)))
    x = lower[..., None] + 0.5 * reach[..., None] * (1.0 + nodes)
    fall = np.exp(-0.5 * (x - lower[..., None]) * (x + lower[..., None]))
    expected = np.log(0.5 * reach * (fall @ weights) / share) - 0.5 * np.log(2 * np.pi)
    assert value + 0.5 * (lower**2).sum() == pytest.approx(expected.sum(), abs=1e-8)
    assert np.isfinite(simulated_bar).all()
    assert np.isfinite(numbers_bar[:, 0]).all()


@pytest.mark.parametrize("kind", [INDEPENDENT, CORRELATED])
def test_weights_are_those_of_the_dense_conditional_normal(kind):
    case = Case((kind, kind), (True, True))
    ((mean, factor),) = weights_given([case.residuals], [case.observed], [case.simulated], [case.numbers])
    for k in range(2):
        prior, basis = np.diag(case.prior_variances(k)), case.basis[case.valid(k)]
        gain = prior @ basis.T @ np.linalg.inv(case.covariance(k))
        np.testing.assert_allclose(mean[k], gain @ case.residual(k), atol=1e-8 * np.abs(mean[k]).max())
        covariance = prior - gain @ basis @ prior
        np.testing.assert_allclose(factor[k] @ factor[k].T, covariance, atol=1e-8 * np.abs(covariance).max())


def test_a_channel_without_discrepancy_has_no_weights():
    case = Case((INDEPENDENT, CORRELATED), (True, False))
    ((mean, factor),) = weights_given([case.residuals], [case.observed], [case.simulated], [case.numbers])
    assert mean[0].any()
    assert not mean[1].any()
    assert not factor[1].any()


# --- with a surrogate's error ---------------------------------------------------------------------------------


@pytest.fixture(params=["independent", "correlated", "discrepancy", "discrepancy, correlated", "mixed"])
def surrogate(request):
    kinds, discrepant, options = CASES[request.param]
    case = Case(kinds, discrepant, **options)
    errors = np.random.default_rng(2).normal(size=(*case.observed.shape, 3))
    case.residuals = case.residuals.with_errors(errors)
    return case, np.array([0.3, 1.1, 0.0])


def test_with_a_surrogates_error_it_is_the_dense_normal_of_all_channels(surrogate):
    case, variance = surrogate
    valid = np.isfinite(case.observed)
    covariance = np.zeros((valid.sum(), valid.sum()))
    place = np.cumsum(valid.ravel()).reshape(valid.shape) - 1
    for k in range(2):
        rows = place[valid[:, k], k]
        covariance[np.ix_(rows, rows)] = case.covariance(k)
    basis = case.residuals.shapes.errors[valid]
    covariance += basis * variance @ basis.T
    expected = stats.multivariate_normal.logpdf((case.observed - case.simulated)[valid], cov=covariance)
    found = log_likelihood(case.residuals, case.observed, case.simulated, case.numbers, variance)[0]
    assert found == pytest.approx(expected, rel=1e-10)


def test_derivatives_with_a_surrogates_error_are_those_of_differences(surrogate):
    case, variance = surrogate
    given = {"simulated": case.simulated, "numbers": case.numbers, "variance": variance + 0.2}

    def value(**changed):
        now = given | changed
        return log_likelihood(case.residuals, case.observed, now["simulated"], now["numbers"], now["variance"])

    for name, place in (("simulated", 1), ("numbers", 2), ("variance", 3)):
        derivative = value()[place]
        for index in list(np.ndindex(given[name].shape))[:: 7 if name == "simulated" else 1]:
            size = max(abs(given[name][index]), 0.1)
            sides = []
            for sign in (1.0, -1.0):
                moved = given[name].copy()
                moved[index] += sign * 1e-5 * size
                sides.append(value(**{name: moved})[0])
            expected = (sides[0] - sides[1]) / (2e-5 * size)
            assert derivative[index] == pytest.approx(expected, rel=2e-6, abs=2e-6), (name, index)


def test_an_error_without_variance_is_none(surrogate):
    case, _ = surrogate
    given = case.observed, case.simulated, case.numbers
    found = log_likelihood(case.residuals, *given, np.zeros(3))
    expected = log_likelihood(case.residuals.with_errors(np.empty((0, 0, 0))), *given)
    for one, other in zip(found[:3], expected[:3], strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("kind", [INDEPENDENT, CORRELATED])
def test_the_information_has_the_inverse_of_the_dense_covariance(kind):
    case = Case((kind, kind), (True, False))
    jacobian, expected = np.random.default_rng(3).normal(size=(*case.observed.shape, 2)), np.zeros((2, 2))
    for k in range(2):
        columns = jacobian[case.valid(k), k]
        expected += columns.T @ np.linalg.solve(case.covariance(k), columns)
    found = information([case.residuals], [jacobian], [np.eye(2)], [case.numbers], [np.empty(0)])
    np.testing.assert_allclose(found, expected, rtol=1e-10)
