"""Where posteriors lie in their priors."""

from types import SimpleNamespace

import numpy as np
import pytest

from flightcal.calibration.posterior import prior_scores
from flightcal.probability import Priors
from flightcal.scenario import Normal, Uniform


def test_a_right_priors_scores_are_as_wide_as_they_are_said_to_be():
    """Of 4,000 linear measurements, half of them so noisy that they narrow the prior little."""
    rng = np.random.default_rng(5)
    priors = Priors(("x",), (Normal(mean=3.0, standard_deviation=2.0),))
    problem = SimpleNamespace(priors=priors, names=("x",))
    seen = []
    for noise in np.repeat([0.3, 1.5], 2000):
        truth = rng.standard_normal()
        measured = truth + noise * rng.standard_normal()
        mean, variance = measured / (1.0 + noise**2), noise**2 / (1.0 + noise**2)
        z = mean + np.sqrt(variance) * rng.standard_normal((2, 400, 1))
        score = prior_scores(problem, 3.0 + 2.0 * z)["x"]
        seen.append(score.prior_score / score.usual_score)
    for of_noise in (seen[:2000], seen[2000:]):
        # The deviation of 2,000 normal numbers is known to 1.6%.
        assert np.std(of_noise) == pytest.approx(1.0, abs=0.06)


def test_a_posterior_that_is_off_and_no_narrower_than_its_prior_is_more_than_it_seems():
    rng = np.random.default_rng(6)
    priors = Priors(("x",), (Uniform(lower=0.66, upper=0.86),))
    problem = SimpleNamespace(priors=priors, names=("x",))
    pressed = priors.to_theta(2.0 + 0.95 * rng.standard_normal((4, 500, 1)))
    known = priors.to_theta(2.0 + 0.1 * rng.standard_normal((4, 500, 1)))
    for draws, usual in ((pressed, 0.5), (known, 1.0)):
        score = prior_scores(problem, draws)["x"]
        assert score.prior_score == pytest.approx(2.0, abs=0.1)
        assert score.usual_score == pytest.approx(usual, rel=0.02)
