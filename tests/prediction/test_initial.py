"""Conditioning of the initial temperatures against the exact answer of a linear network with Gaussian noise."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

from flightcal.prediction.errors import FirstErrors, WhiteErrors
from flightcal.prediction.initial import condition_initial, condition_start
from flightcal.problem import build_window

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
    return build_window(scenario, data, "test", span=600.0)


def exact(first, link):
    """Mean and covariance of the initial temperatures (body, panel), by the textbook."""
    A = link * np.array([[-1, 1], [1, -1]]) / np.array([[3000.0], [800.0]])
    seconds = (first.times - first.times[0]) / np.timedelta64(1, "s")
    G = np.array([expm(A * t)[0] for t in seconds])
    valid = np.isfinite(first.observed[:, 0])
    prior_mean = np.array([first.observed[0, 0], 263.15])
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


def test_thetas_of_different_noise_are_conditioned_together_as_they_are_alone(first):
    thetas, noise = np.tile([4.0, 0.0, 0.0], (2, 1)), np.array([[0.03], [3.0]])
    together = condition_initial(first, thetas, WhiteErrors(noise))
    alone = [condition_initial(first, thetas[s : s + 1], WhiteErrors(noise[s : s + 1]))[0] for s in range(2)]
    np.testing.assert_allclose(together, alone, atol=1e-9)
    assert abs(together[0, 2] - together[1, 2]) > 0.1


def test_a_theta_that_cannot_be_simulated_keeps_the_prior_mean(first):
    thetas = np.array([[4.0, 0.0, 0.0], [np.inf, 0.0, 0.0], [4.0, 0.0, 0.0]])
    found = condition_initial(first, thetas, WhiteErrors(np.tile(NOISE, (3, 1))))
    np.testing.assert_allclose(found[1, 1:], [first.observed[0, 0], 263.15])
    np.testing.assert_allclose(found[0, 1:], exact(first, 4.0)[0], atol=1e-3)


@pytest.mark.parametrize("fails", [0, 2])
def test_one_theta_that_cannot_be_simulated_does_not_keep_the_others_from_being_conditioned(first, fails):
    thetas = np.tile([4.0, 0.0, 0.0], (3, 1))
    thetas[fails, 0] = np.inf
    found = condition_initial(first, thetas, WhiteErrors(np.tile(NOISE, (3, 1))))
    np.testing.assert_allclose(found[1, 1:], exact(first, 4.0)[0], atol=1e-3)


def test_a_theta_that_fails_once_its_initial_temperatures_are_updated_keeps_the_prior_mean(first):
    class Fragile:
        def __getattr__(self, name):
            return getattr(first, name)

        def simulate_many(self, thetas, heat=None):
            moved = (thetas[:, 0] > 4.05) & (np.abs(thetas[:, 2] - 263.15) > 0.1)
            return [None if off else run for off, run in zip(moved, first.simulate_many(thetas), strict=True)]

    thetas = np.array([[4.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.1, 0.0, 0.0]])
    found = condition_initial(Fragile(), thetas, WhiteErrors(np.tile(NOISE, (3, 1))))
    np.testing.assert_array_equal(found[2, 1:], [first.observed[0, 0], 263.15])
    np.testing.assert_allclose(found[0, 1:], exact(first, 4.0)[0], atol=1e-3)


def test_initial_temperatures_are_draws_from_their_prior_where_most_thetas_cannot_be_simulated(first):
    count = 1000
    found = condition_initial(
        first,
        np.tile([np.inf, 0.0, 0.0], (count, 1)),
        WhiteErrors(np.tile(NOISE, (count, 1))),
        np.random.default_rng(0),
    )[:, 1:]
    deviations = np.array([2.0, 5.0])
    off = (found - [first.observed[0, 0], 263.15]) / deviations
    np.testing.assert_allclose(off.mean(axis=0), 0.0, atol=4 / np.sqrt(count))
    np.testing.assert_allclose(off.std(axis=0), 1.0, rtol=4 / np.sqrt(2 * count))


def test_thetas_without_initial_temperatures_come_back_as_they_are():
    thetas = np.array([[4.0], [5.0]])
    found = condition_initial(SimpleNamespace(names=("link",)), thetas, WhiteErrors(NOISE[None]))
    np.testing.assert_array_equal(found, thetas)
    assert not np.shares_memory(found, thetas)


def test_what_the_errors_are_expected_to_be_is_not_told_to_the_temperatures(first):
    T = len(first.times)
    factors = np.tile(NOISE[0] * np.eye(T), (1, 1, 1, 1))
    theta = np.array([[4.0, 285.0, 262.0]])
    expected = np.linspace(-1.0, 1.0, T)[None, :, None]
    found = condition_initial(first, theta, FirstErrors(expected, factors, np.arange(T)))
    without = replace(first, observed=first.observed - expected[0])
    np.testing.assert_allclose(
        found, condition_initial(without, theta, FirstErrors(0 * expected, factors, np.arange(T))), atol=1e-9
    )
    assert np.abs(found - condition_initial(first, theta, FirstErrors(0 * expected, factors, np.arange(T)))).max() > 0.1


def test_the_initial_temperatures_are_at_the_top_of_their_density_where_radiation_bends_the_simulation(tmp_path):
    written = small.content()
    written["simulator"]["nodes"]["body"]["capacity"] = "40 J/K"
    written["simulator"]["conductors"].append({"between": ["body", "space"], "radiative": "0.3 m^2"})
    written["simulator"]["nodes"]["panel"]["initial"] = "150 degC"
    written["simulator"].pop("heaters")
    written["parameters"] = {"link": written["parameters"]["link"]}
    written["observations"] = {"body_temp": {"node": "body", "noise": "0.3 K"}}
    scenario, data = small.load(tmp_path, written)
    problem = build_window(scenario, data, "test", span=600.0)
    positions = [problem.names.index(f"initial.{node}") for node in ("body", "panel")]
    truth = small.median(problem)
    truth[positions] += 4.0, 40.0
    made = problem.simulate(truth).temperatures
    problem = replace(problem, observed=made + NOISE * np.random.default_rng(0).standard_normal(made.shape))
    priors = [problem.reads[problem.names[k]] for k in positions]

    def log_density(theta):
        residual = (problem.observed - problem.simulate(theta).temperatures)[np.isfinite(problem.observed)]
        off = [(theta[k] - prior.mean) / prior.standard_deviation for k, prior in zip(positions, priors, strict=True)]
        return -0.5 * np.sum(residual**2) / NOISE[0] ** 2 - 0.5 * np.sum(np.square(off))

    theta = small.median(problem)[None]
    theta[0, positions] = 5.0, 1500.0
    found = condition_initial(problem, theta, WhiteErrors(problem.noise(theta[0])[None]))[0]
    for k in positions:
        step = np.zeros(len(found))
        step[k] = 0.05
        below, at, above = (log_density(found + side * step) for side in (-1, 0, 1))
        # How far the top is, over the standard deviation; two iterations would leave 2e-4.
        curvature = (2 * at - below - above) / 0.05**2
        assert abs((above - below) / 0.1) / np.sqrt(curvature) < 1e-5


@pytest.mark.parametrize("on", [0.0, 1.0])
def test_the_first_samples_tell_whether_a_heater_without_a_status_is_on(tmp_path, on):
    """30 W into 3 kJ/K is 0.6 K a minute."""
    written = small.content()
    del written["simulator"]["heaters"]["heater"]["measured_by"], written["observations"]["heater_status"]
    scenario, data = small.load(tmp_path, written)
    window = build_window(scenario, data, "test", span=600.0)
    truth = small.median(window)
    truth[window.names.index("initial.body")] = 284.0
    made = window.begun(np.array([on])).simulate(truth).temperatures
    rng = np.random.default_rng(0)
    window = replace(window, observed=made + NOISE * rng.standard_normal(made.shape))
    thetas = np.tile(truth, (50, 1))
    noise = WhiteErrors(np.tile([0.3, 0.3], (50, 1)))
    found, begun = condition_start(window, thetas, noise, rng, None, np.array([0.5]))
    np.testing.assert_array_equal(begun, np.full((50, 1), on))
    np.testing.assert_allclose(found.mean(axis=0), truth, atol=0.5)
    # Where they tell nothing it is on as often as at other times.
    unseen = replace(window, observed=np.full_like(window.observed, np.nan))
    many = np.tile(truth, (1000, 1))
    guess = condition_start(unseen, many, WhiteErrors(np.ones((1000, 2))), rng, None, np.array([0.3]))[1]
    assert abs(guess.mean() - 0.3) < 4.0 * np.sqrt(0.3 * 0.7 / 1000)


def test_a_state_of_a_heater_at_which_simulations_fail_is_not_chosen(tmp_path):
    written = small.content()
    del written["simulator"]["heaters"]["heater"]["measured_by"], written["observations"]["heater_status"]
    scenario, data = small.load(tmp_path, written)
    window = build_window(scenario, data, "test", span=600.0)

    class FailsWhereOn:
        def __init__(self, wrapped, on=0.0):
            self.wrapped, self.on = wrapped, on

        def __getattr__(self, name):
            return getattr(self.wrapped, name)

        def begun(self, on):
            return FailsWhereOn(self.wrapped.begun(on), on[0])

        def simulate_many(self, thetas, heat=None):
            return [None] * len(thetas) if self.on else self.wrapped.simulate_many(thetas, heat)

    thetas, noise = np.tile(small.median(window), (20, 1)), WhiteErrors(np.full((20, 2), 0.3))
    rng = np.random.default_rng(0)
    _, begun = condition_start(FailsWhereOn(window), thetas, noise, rng, None, np.array([0.9]))
    np.testing.assert_array_equal(begun, np.zeros((20, 1)))
