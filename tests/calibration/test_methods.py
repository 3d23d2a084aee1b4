"""Both methods on a small problem, whole."""

import json

import numpy as np
import pytest
import xarray

from flightcal.calibration import (
    calibrate_genetic,
    calibrate_nuts,
    genetic_points,
    posterior_mean,
    with_residual_noise,
)
from flightcal.calibration.posterior import posterior_tree
from flightcal.errors import FlightcalError
from flightcal.problem import Problem, build_problem
from flightcal.scenario import GeneticSettings, NutsSettings
from flightcal.simulator import SimulationFailure
from tests.told import Told

from .. import small

SEARCHED = ["link", "panel_size", "power", "initial.body", "initial.panel"]


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    written = small.content()
    written["windows"]["train"]["end"] = "2024-03-01T01:15:00"
    return build_problem(*small.closed_loop(tmp_path_factory.mktemp("methods"), written))


@pytest.fixture(scope="module")
def genetic(problem):
    return calibrate_genetic(problem, GeneticSettings(runs=3, population=24, generations=15), seed=5)


@pytest.fixture(scope="module")
def posterior(problem):
    # Both chains are long enough to be told apart from a broken sampler, not to pass the gates.
    return calibrate_nuts(problem, NutsSettings(chains=2, draws=150, warmup=100), seed=4)


def test_the_genetic_result_has_every_run_and_its_summaries(problem, genetic):
    assert list(genetic["parameter"].values) == SEARCHED
    assert dict(genetic.sizes) == {"run": 3, "parameter": 5, "generation": 15}
    best = genetic["best"].values
    np.testing.assert_allclose(genetic["mean_theta"], best.mean(axis=0))
    np.testing.assert_array_equal(genetic["best_theta"], best[np.argmin(genetic["rmse"].values)])
    assert (np.diff(genetic["history"], axis=1) <= 0).all()
    np.testing.assert_array_equal(genetic["history"][:, -1], genetic["rmse"])
    assert genetic["generations"].values.tolist() == [15, 15, 15]
    counts = {"seed": 5, "evaluations": 3 * 15 * 24, "failures": 0, "converged_runs": 0}
    assert counts.items() <= genetic.attrs.items()
    assert genetic.attrs["converged_when"].startswith("over 100 generations its best cost has fallen by less than 1%")


def test_the_genetic_algorithm_minimises_the_rmse(problem, genetic):
    thetas = np.tile(problem.priors.median(), (3, 1))
    thetas[:, [problem.names.index(name) for name in SEARCHED]] = genetic["best"]
    np.testing.assert_allclose(problem.rmse(thetas), genetic["rmse"])
    assert (genetic["rmse"] <= 0.5 * genetic["history"][:, 0]).all()
    assert genetic["rmse"].min() < 0.4 * problem.rmse(problem.priors.median()[None])[0]


def test_the_same_seed_gives_the_same_genetic_result_and_another_a_different_one(problem):
    settings = GeneticSettings(runs=2, population=8, generations=3)
    first, again, other = (calibrate_genetic(problem, settings, seed=seed) for seed in (5, 5, 6))
    assert first.identical(again)
    assert not np.array_equal(first["best"], other["best"])


def test_settings_and_seed_are_the_scenarios_unless_given(problem):
    told = Told()
    result = calibrate_genetic(problem, progress=told)
    assert (result.sizes["run"], result.sizes["generation"], result.attrs["seed"]) == (2, 8, 3)
    assert [done for done, _ in told.stages["search"]] == list(range(1, 9))
    assert (
        told.stages["search"][-1][1]
        == f"generation 8, 2 of 2 runs have ended, RMSE {result['rmse'].values.min():.3f} K"
    )


def test_the_weight_of_heater_status_is_part_of_what_is_minimised(problem):
    settings = GeneticSettings(runs=1, population=8, generations=2, heater_status_weight=5.0)
    result = calibrate_genetic(problem, settings, seed=1)
    theta = genetic_points(problem, result)["genetic_best"]
    assert result["rmse"].values == pytest.approx(problem.rmse(theta[None], 5.0))
    assert result["rmse"].values[0] > problem.rmse(theta[None])[0]


def test_points_are_whole_thetas_whose_noise_is_the_rmse_of_each_channel(problem, genetic):
    points = genetic_points(problem, genetic)
    assert list(points) == ["poorly_calibrated", "genetic", "genetic_best"]
    chosen = [problem.names.index(name) for name in SEARCHED]
    np.testing.assert_array_equal(points["genetic"][chosen], genetic["mean_theta"])
    np.testing.assert_array_equal(points["genetic_best"][chosen], genetic["best_theta"])
    for theta in points.values():
        residual = problem.windows[0].observed - problem.windows[0].simulate(theta).temperatures
        assert theta[problem.names.index("noise.body_temp")] == pytest.approx(np.sqrt(np.mean(residual[:, 0] ** 2)))
    np.testing.assert_array_equal(points["poorly_calibrated"][chosen], genetic["poor_theta"])


def test_the_posteriors_mean_is_a_point_though_it_may_tell_no_noise(problem):
    usual = problem.priors.median()
    draws = {
        name: (("chain", "draw"), value * np.array([[0.98, 1.0], [1.02, 1.04]]))
        for name, value in zip(problem.names, usual, strict=True)
        if not name.startswith("noise.")
    }
    posterior = xarray.DataTree.from_dict({"posterior": xarray.Dataset(draws)})
    theta = posterior_mean(problem, posterior)
    told = np.array([name in draws for name in problem.names])
    np.testing.assert_allclose(theta[told], 1.01 * usual[told])
    residual = problem.windows[0].observed - problem.windows[0].simulate(theta).temperatures
    assert theta[problem.names.index("noise.body_temp")] == pytest.approx(np.sqrt(np.mean(residual[:, 0] ** 2)))


def test_poorly_calibrated_are_parameters_within_their_priors_at_the_right_initial_temperatures(problem, genetic):
    theta, median = genetic_points(problem, genetic)["poorly_calibrated"], problem.priors.median()
    of_initial = np.array([name.startswith("initial.") for name in problem.names])
    np.testing.assert_array_equal(theta[of_initial], median[of_initial])
    wrong = [problem.names.index(name) for name in SEARCHED if not name.startswith("initial.")]
    assert (theta[wrong] != median[wrong]).all()
    low, high = (problem.priors.quantile(p) for p in (1e-4, 1.0 - 1e-4))
    assert ((low < theta) & (theta < high))[wrong].all()
    draws = np.tile(median, (400, 1))
    draws[:, wrong] = problem.priors.sample(np.random.default_rng(8), 400)[:, wrong]
    rmse = problem.rmse(np.concatenate([theta[None], draws]))
    # The place of one of 24 draws.
    assert 0.55 < (rmse[1:] < rmse[0]).mean() < 0.92
    assert rmse[0] > 1.25 * problem.rmse(median[None])[0]


def test_a_simulation_that_fails_beside_the_mode_is_a_message(problem, monkeypatch):
    def fail(*_):
        raise SimulationFailure("not finite after 60 s")

    monkeypatch.setattr(Problem, "coordinates", fail)
    with pytest.raises(FlightcalError, match="calibration: not finite after 60 s: check units"):
        calibrate_nuts(problem, random_starts=1)


def test_a_calibration_without_any_start_is_a_message(problem):
    with pytest.raises(FlightcalError, match="found no start"):
        calibrate_nuts(problem, random_starts=0)


def test_residual_noise_of_a_failed_simulation_stays_as_it_was(problem):
    theta = problem.priors.median()
    theta[problem.names.index("initial.body")] = np.nan
    np.testing.assert_array_equal(with_residual_noise(problem, theta), theta)


def test_a_small_run_of_nuts_finds_the_truth_with_the_width_of_the_laplace_approximation(problem, posterior):
    chains, draws, size = posterior.theta.shape
    assert (chains, size) == (2, 6)
    assert 150 < draws <= 8 * 150, "more are made until enough are effective"
    assert posterior.flat.shape == (2 * draws, 6)
    np.testing.assert_array_equal(posterior.theta, problem.to_theta(posterior.draws.z))
    mode = posterior.modes[0]
    z = posterior.draws.z.reshape(-1, 6)
    deviation = np.sqrt(np.diag(np.linalg.inv(problem.gauss_newton_hessian(mode.z))))
    assert (np.abs(z.mean(axis=0) - mode.z) < deviation).all()
    assert (z.std(axis=0) / deviation > 0.6).all()
    assert (z.std(axis=0) / deviation < 1.6).all()
    truth = np.array([small.TRUTH[name] for name in problem.names[:3]])
    assert (np.abs(posterior.flat[:, :3].mean(axis=0) - truth) < 4 * posterior.flat[:, :3].std(axis=0)).all()
    assert not posterior.draws.interrupted


def test_too_few_draws_fail_the_gate_of_effective_samples(problem):
    settings = problem.scenario.calibration.nuts.model_copy(update={"draws": 50, "min_ess": 4000.0})
    posterior = calibrate_nuts(problem, settings, 1, random_starts=1)
    assert posterior.theta.shape[1] == 50, "more than eight times as many would be needed"
    assert not posterior.diagnostics.passed
    assert "too few independent draws" in posterior.diagnostics.verdict


def test_the_posterior_tree_holds_arvizs_groups(problem, posterior):
    tree = posterior_tree(problem, posterior, seed=1, most_predictions=30)
    assert set(tree.children) == {"posterior", "sample_stats", "prior", "posterior_predictive", "observed_data"}
    np.testing.assert_array_equal(tree["posterior"]["link"], posterior.theta[..., 0])
    predicted = tree["posterior_predictive"]["temperature"]
    assert predicted.dims == ("chain", "draw", "time", "channel")
    assert predicted.sizes["chain"] * predicted.sizes["draw"] <= 30
    spread = (predicted - tree["observed_data"]["temperature"]).std(("chain", "draw", "time")).values
    np.testing.assert_allclose(spread, np.sqrt(2) * 0.1, rtol=0.2)
    prior = tree["prior"]["power"].values
    assert prior.std() == pytest.approx(3.0, rel=0.1)
    report = json.loads(tree.attrs["switch_sequences"])[0]
    assert report["sequences"] >= 1
    assert 0 < report["share_of_most_common"] <= 1
    assert tree.attrs["interrupted"] == "false"


def test_a_model_that_cannot_be_simulated_anywhere_is_reported(problem, monkeypatch):
    def fails(*_):
        return -np.inf, np.zeros(len(problem.names))

    monkeypatch.setattr(type(problem), "log_density_and_gradient", fails)
    with pytest.raises(FlightcalError, match="no start of the calibration can be simulated"):
        calibrate_nuts(problem, NutsSettings(chains=2, draws=50, warmup=50), seed=1)
