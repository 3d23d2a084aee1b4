"""Profiles of a linear Gaussian problem, whose profiles are parabolas."""

import numpy as np
import pytest

from flightcal.check.profile import check_names, profile
from flightcal.errors import ScenarioError
from flightcal.scenario import LogNormal, Normal

from .problems import NOISE, centre_at, formula_problem, samples


def test_the_profile_of_a_linear_problem_is_its_marginal_parabola():
    matrix = 0.04 * np.random.default_rng(0).standard_normal((samples(), 2, 3))
    matrix[..., 1] += 0.9 * matrix[..., 0]
    priors = {name: Normal(mean=0.0, standard_deviation=2.0) for name in "abc"}
    problem = formula_problem(priors, lambda theta: 290.0 + matrix @ theta, dict.fromkeys("abc", 0.0))
    flat = matrix.reshape(-1, 3) / NOISE
    precision = flat.T @ flat + np.eye(3) / 4.0
    covariance = np.linalg.inv(precision)
    mean = covariance @ flat.T @ ((problem.windows[0].observed - 290.0).ravel() / NOISE)
    found = profile(problem, centre_at(problem, **dict(zip("abc", mean, strict=True))), "a")
    deviation = np.sqrt(covariance[0, 0])
    np.testing.assert_allclose(found.log_density, -0.5 * ((found.theta - mean[0]) / deviation) ** 2, atol=1e-4)
    assert found.lower == pytest.approx(mean[0] - 1.96 * deviation, abs=0.03 * deviation)
    assert found.upper == pytest.approx(mean[0] + 1.96 * deviation, abs=0.03 * deviation)
    assert found.told


def test_a_factor_of_a_product_is_not_told():
    shape = np.random.default_rng(0).standard_normal((samples(), 2))
    priors = {name: LogNormal(median=2.0, factor=1.3) for name in ("a", "b")}
    problem = formula_problem(priors, lambda t: 290.0 + t[0] * t[1] * shape, {"a": 2.0, "b": 2.0})
    found = profile(problem, centre_at(problem, a=2.0, b=2.0), "a")
    assert not found.told
    assert np.ptp(found.log_likelihood) < 0.1
    assert found.log_density.min() < -1.92


def test_a_name_that_is_no_parameter_is_refused():
    priors = {"a": Normal(mean=0.0, standard_deviation=1.0)}
    problem = formula_problem(priors, lambda t: 290.0 + t[0] * np.ones((samples(), 2)), {"a": 0.0})
    with pytest.raises(ScenarioError, match="--profile b: expected one of a"):
        check_names(problem, ["b"])
