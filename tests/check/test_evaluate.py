"""Densities of many points at once are the problem's own."""

import numpy as np
import pytest
from scipy.stats import norm

from flightcal.check.evaluate import THOROUGH, densities, effort_for, in_batches, log_likelihoods
from flightcal.scenario import Normal

from .problems import NOISE, formula_problem, samples, several

PRIORS = {"level": Normal(mean=1.0, standard_deviation=3.0)}


@pytest.fixture(scope="module")
def problem():
    return formula_problem(PRIORS, lambda t: 290.0 + t[0] * np.ones((samples(), 2)), {"level": 1.0})


Z = np.array([[0.0], [0.02], [-0.01]])


def test_densities_are_the_problems_own_and_likelihoods_lack_the_prior(problem):
    values, runs = densities(problem, Z)
    np.testing.assert_allclose(values, [problem.log_density(z) for z in Z], rtol=1e-14)
    likelihoods, _ = log_likelihoods(problem, Z, runs)
    expected = [norm(290.0 + 1.0 + 3.0 * z[0], NOISE).logpdf(problem.windows[0].observed).sum() for z in Z]
    np.testing.assert_allclose(likelihoods, expected, rtol=1e-12)


def test_runs_that_were_made_are_not_made_again_and_failed_ones_have_no_density(problem, monkeypatch):
    _, runs = densities(problem, Z)

    def refuse(*_):
        raise AssertionError("simulated again")

    monkeypatch.setattr(type(problem.windows[0].simulator), "simulate", refuse)
    values, _ = densities(problem, Z, [runs[0], None, runs[2]])
    assert np.isfinite(values[[0, 2]]).all()
    assert values[1] == -np.inf


def test_the_likelihoods_of_two_windows_add_up(problem):
    other = formula_problem(PRIORS, lambda t: 290.0 + 2.0 * t[0] * np.ones((samples(), 2)), {"level": 1.0}, seed=1)
    both = log_likelihoods(several(one=problem, other=other), Z)[0]
    np.testing.assert_allclose(both, log_likelihoods(problem, Z)[0] + log_likelihoods(other, Z)[0], rtol=1e-12)


def test_batches_cover_everything_once():
    parts = in_batches(1200)
    assert [i for part in parts for i in range(part.start, part.stop)] == list(range(1200))


def test_a_network_is_worth_every_effort(problem):
    assert effort_for(problem, 30) is THOROUGH
