"""Conditioning of the initial temperatures against the exact answer of a linear network with Gaussian noise."""

import numpy as np
import pytest
from scipy.linalg import expm

from flightcal.calibration import build_problem
from flightcal.prediction import WhiteErrors, condition_initial

from .. import small

NOISE = np.array([0.3])


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """Two conducting nodes, of which one is observed; the window's first ten minutes."""
    written = small.content()
    model = written["simulator"]
    model["nodes"].pop("space")
    model["conductors"] = model["conductors"][:1]
    model["conductors"][0]["conductance"] = "4 W/K"
    for section in ("heaters", "loads"):
        model.pop(section)
    written["parameters"] = {"link": written["parameters"]["link"]}
    written["observations"] = {"body_temp": {"node": "body", "noise": "0.3 K"}}
    scenario, data = small.load(tmp_path_factory.mktemp("linear"), written)
    data["body_temp"].values[213:215] = np.nan
    data["body_temp"].values[210:] += 0.3 * np.random.default_rng(0).standard_normal(data.sizes["time"] - 210)
    return build_problem(scenario, data, "test", span=600.0)


def exact(first, link):
    """Mean and covariance of the initial temperatures (body, panel), by the textbook."""
    A = link * np.array([[-1, 1], [1, -1]]) / np.array([[3000.0], [800.0]])
    seconds = (first.times - first.times[0]) / np.timedelta64(1, "s")
    G = np.array([expm(A * t)[0] for t in seconds])
    valid = np.isfinite(first.observed[:, 0])
    prior_mean = np.array([first.observed[:3, 0].mean(), 263.15])
    precision = np.diag([2.0**-2, 5.0**-2]) + G[valid].T @ G[valid] / NOISE[0] ** 2
    residual = first.observed[valid, 0] - G[valid] @ prior_mean
    return prior_mean + np.linalg.solve(precision, G[valid].T @ residual / NOISE[0] ** 2), np.linalg.inv(precision)


def test_a_point_estimate_gets_the_exact_posterior_mean(first):
    assert first.names == ("link", "initial.body", "initial.panel")
    mean, _ = exact(first, 4.0)
    theta = np.array([[4.0, 100.0, 500.0]])
    found = condition_initial(first, theta, WhiteErrors(NOISE[None]))
    np.testing.assert_allclose(found[0, 1:], mean, atol=1e-3)
    assert found[0, 0] == 4.0
    np.testing.assert_array_equal(theta, [[4.0, 100.0, 500.0]])


def test_draws_have_the_exact_posterior_mean_and_covariance(first):
    mean, covariance = exact(first, 4.0)
    thetas = np.tile([4.0, 285.0, 262.0], (4000, 1))
    found = condition_initial(first, thetas, WhiteErrors(np.tile(NOISE, (4000, 1))), np.random.default_rng(1))[:, 1:]
    factor = np.linalg.cholesky(covariance)
    white = np.linalg.solve(factor, (found - mean).T)
    np.testing.assert_allclose(white.mean(axis=1), 0.0, atol=4 / np.sqrt(4000))
    np.testing.assert_allclose(np.cov(white), np.eye(2), atol=0.1)
    # The unobserved node is known less well than the observed one, and better than its prior says.
    assert covariance[0, 0] < covariance[1, 1] < 25.0


def test_every_theta_is_conditioned_with_its_own_simulation_and_noise(first):
    thetas = np.array([[3.9, 0.0, 0.0], [4.0, 0.0, 0.0], [4.1, 0.0, 0.0]])
    found = condition_initial(first, thetas, WhiteErrors(np.tile(NOISE, (3, 1))))
    assert found[0, 1] != found[2, 1]
    np.testing.assert_allclose(found[2, 1:], exact(first, 4.1)[0], atol=0.25)
    sure, unsure = (
        condition_initial(first, thetas[1:2], WhiteErrors(np.array([[noise]])))[0, 2] for noise in (0.01, 100.0)
    )
    assert abs(unsure - 263.15) < 0.1 < abs(sure - 263.15)


def test_a_theta_that_cannot_be_simulated_keeps_the_prior_mean(first):
    thetas = np.array([[4.0, 0.0, 0.0], [1e300, 0.0, 0.0], [4.0, 0.0, 0.0]])
    found = condition_initial(first, thetas, WhiteErrors(np.tile(NOISE, (3, 1))))
    np.testing.assert_allclose(found[1, 1:], [first.observed[:3, 0].mean(), 263.15])
    np.testing.assert_allclose(found[0, 1:], exact(first, 4.0)[0], atol=1e-3)
