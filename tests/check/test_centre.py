"""The point that is examined, found with and without derivatives."""

import numpy as np
import pytest

from flightcal.check import centre as module
from flightcal.check.centre import expanded, find_centre
from flightcal.errors import FlightcalError
from flightcal.scenario import LogNormal, Normal

from .problems import formula_problem, samples, several

PRIORS = {"gain": LogNormal(median=2.0, factor=1.5), "level": Normal(mean=0.0, standard_deviation=5.0)}
TRUTH = {"gain": 2.6, "level": 3.0}


@pytest.fixture(scope="module")
def problem():
    time = np.linspace(0.0, 3.0, samples())[:, None]
    return formula_problem(PRIORS, lambda t: 290.0 + np.ones((1, 2)) * (np.exp(-time * t[0]) * 10.0 + t[1]), TRUTH)


def prior_runs(problem, count):
    draws = problem.priors.sample(np.random.default_rng(0), count)
    return draws, problem.simulate_many(draws)


def test_steps_by_differences_end_at_the_mode_that_gradients_find(problem, monkeypatch):
    exact = find_centre(problem, prior_runs(problem, 20), 2, 0)
    assert exact.is_mode
    np.testing.assert_allclose(problem.to_theta(exact.z), list(TRUTH.values()), rtol=0.05)
    monkeypatch.setattr(module, "needs_emulator", lambda problem: True)
    found = find_centre(problem, prior_runs(problem, 20), 3, 0)
    assert found.is_mode
    deviation = np.sqrt(np.diag(exact.covariance))
    np.testing.assert_allclose((found.z - exact.z) / deviation, 0.0, atol=0.3)
    np.testing.assert_allclose(found.hessian, exact.hessian, rtol=0.05)


@pytest.mark.parametrize("windows", [1, 2])
def test_an_expansion_is_exact_where_the_simulators_are_linear(windows):
    priors = {name: Normal(mean=1.0, standard_deviation=2.0) for name in "ab"}

    def linear_problem(seed):
        matrix = np.random.default_rng(seed).standard_normal((samples(), 2, 2))
        return formula_problem(priors, lambda theta: 290.0 + matrix @ theta, {"a": 1.0, "b": 1.0})

    problem = linear_problem(0) if windows == 1 else several(one=linear_problem(0), other=linear_problem(1))
    z = np.array([0.3, -0.2])
    linear = expanded(problem, z)
    elsewhere = np.array([1.3, 0.4])
    assert linear.log_density(elsewhere) == pytest.approx(problem.log_density(elsewhere), rel=1e-9)
    np.testing.assert_allclose(
        linear.log_density_and_gradient(elsewhere)[1], problem.log_density_and_gradient(elsewhere)[1], rtol=1e-5
    )
    np.testing.assert_allclose(linear.gauss_newton_hessian(z), problem.gauss_newton_hessian(z), rtol=1e-5)


def test_a_problem_of_which_no_run_finishes_is_refused(problem, monkeypatch):
    monkeypatch.setattr(module, "needs_emulator", lambda problem: True)
    draws, runs = prior_runs(problem, 3)
    with pytest.raises(FlightcalError, match="no simulation at the prior's draws finishes"):
        find_centre(problem, (draws, [None] * len(runs)), 1, 0)
