"""Scores against hand-worked values and numerical integration."""

import math

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import quad
from scipy.stats import norm

from flightcal.prediction import Metric, comparison_table, score, simulator_errors
from flightcal.prediction.metrics import (
    SimulatorError,
    crps_of_draws,
    log_score_normal,
    mape_celsius,
    mape_kelvin,
    mean_absolute_error,
    mpiw,
    picp,
    probability_below,
    rmse,
    scores_of_runs,
    status_agreement,
)


def test_rmse_and_mape_leave_out_missing_samples():
    observed, predicted = [300.0, np.nan, 290.0, 310.0], [303.0, 100.0, 286.0, np.nan]
    assert rmse(observed, predicted) == pytest.approx(math.sqrt((9 + 16) / 2))
    assert mape_kelvin(observed, predicted) == pytest.approx(100 * (3 / 300 + 4 / 290) / 2)
    assert mape_celsius(observed, predicted) == pytest.approx(100 * (3 / 26.85 + 4 / 16.85) / 2)


def test_a_percentage_of_celsius_is_undefined_within_one_degree_of_zero():
    assert mape_celsius([300.0, 273.15 - 0.99], [300.0, 270.0]) is None
    assert mape_celsius([300.0, 273.15 - 1.01], [300.0, 270.0]) is not None


def test_scores_of_nothing_are_nan():
    assert math.isnan(rmse([np.nan], [1.0]))
    assert math.isnan(picp([np.nan], [1.0], [2.0]))
    assert math.isnan(mpiw([], []))


def test_coverage_counts_the_bounds_as_inside():
    lower, upper = np.full(4, 1.0), np.full(4, 2.0)
    assert picp([1.0, 2.0, 2.1, 0.9], lower, upper) == 0.5
    assert mpiw(lower, upper) == 1.0


def test_a_nominal_interval_covers_its_share_of_samples():
    samples = np.random.default_rng(0).normal(290.0, 0.5, 20_000)
    half = norm.ppf(0.975) * 0.5
    assert picp(samples, 290.0 - half, 290.0 + half) == pytest.approx(0.95, abs=4 * math.sqrt(0.95 * 0.05 / 20_000))


def test_the_absolute_error_leaves_out_missing_samples():
    assert mean_absolute_error([1.0, 5.0, np.nan], [3.0, 4.0, 0.0]) == 1.5


def test_the_log_score_is_the_mean_log_density():
    observed, mean = np.array([290.3, 288.0, np.nan]), np.array([290.0, 290.0, 1.0])
    deviation = np.array([0.4, 0.7, 1.0])
    expected = norm(mean, deviation).logpdf(observed)[:2].mean()
    assert log_score_normal(observed, mean, deviation) == pytest.approx(expected, rel=1e-12)
    assert log_score_normal(observed, mean, deviation * [1.0, 0.0, 1.0]) == -math.inf


def crps_by_definition(cdf, observed, low, high):
    """The integral of (F(x) - [x >= observed])^2 (Gneiting & Raftery 2007, eq. 20)."""
    below, _ = quad(lambda x: cdf(x) ** 2, low, observed, epsabs=1e-12)
    above, _ = quad(lambda x: (1 - cdf(x)) ** 2, observed, high, epsabs=1e-12)
    return below + above


def test_crps_of_few_draws_is_on_average_that_of_their_distribution():
    """Two humps, as of a heater that is on in some draws; telemetry between them, in one, and beyond both."""
    rng = np.random.default_rng(1)
    observed, sets, size = np.array([0.0, 2.1, -4.0]), 20_000, 5
    draws = rng.normal(np.where(rng.random((size, sets)) < 0.3, 2.0, -1.0), 0.5)
    found = crps_of_draws(np.tile(observed[:, None], sets), np.broadcast_to(draws[:, None], (size, 3, sets)))

    def distribution(x):
        return 0.3 * norm.cdf(x, 2, 0.5) + 0.7 * norm.cdf(x, -1, 0.5)

    for telemetry, scores in zip(observed, found, strict=True):
        expected = crps_by_definition(distribution, telemetry, -9, 9)
        assert scores.mean() == pytest.approx(expected, abs=4 * scores.std() / math.sqrt(sets))


def test_crps_of_draws_is_worked_out_by_hand_and_missing_where_telemetry_is():
    draws = np.array([[1.0, 1.0], [3.0, 3.0], [8.0, 8.0]])
    found = crps_of_draws([4.0, np.nan], draws)
    # Mean distance to telemetry, less half the mean distance of the three pairs.
    assert found[0] == pytest.approx((3 + 1 + 4) / 3 - 0.5 * (2 + 7 + 5) / 3, rel=1e-14)
    assert np.isnan(found[1])


def test_crps_of_one_draw_is_the_absolute_error():
    np.testing.assert_array_equal(crps_of_draws([4.0, 1.0], [[1.0, 1.5]]), [3.0, 0.5])


def test_the_probability_of_less_counts_equal_draws_half():
    draws = np.array([[1.0] * 4, [3.0] * 4, [3.0] * 4, [8.0] * 4])
    found = probability_below([0.0, 3.0, 5.0, np.nan], draws)
    np.testing.assert_array_equal(found, [0.0, 0.5, 0.75, np.nan])


def test_status_agreement_of_probabilities_is_that_of_the_simulations_behind_them():
    rng = np.random.default_rng(3)
    observed = (rng.random(50) < 0.4).astype(float)
    simulations = rng.random((200, 50)) < 0.3
    each = (simulations == observed).mean()
    assert status_agreement(observed, simulations.mean(axis=0)) == pytest.approx(each)


@pytest.fixture
def prediction() -> xr.Dataset:
    """Two channels, one heater, four samples of which the first is for the initial state."""
    methods = ["uncalibrated", "poorly_calibrated", "genetic", "stochastic"]
    observed = np.array([[400.0, 400.0], [300.0, 273.5], [301.0, 290.0], [302.0, np.nan]])
    offsets = np.array([4.0, 3.0, 2.0, 1.0])[:, None, None]
    mean = np.where(np.isfinite(observed), observed, 280.0)[None] + offsets
    interval = np.array([np.nan, np.nan, np.nan, 1.5])[:, None, None]
    of_method, of_heater = ("by", "time", "channel"), ("by", "heater")
    return xr.Dataset(
        {
            "observed": (("time", "channel"), observed),
            "scored": ("time", [False, True, True, True]),
            "mean": (of_method, mean),
            "lower": (of_method, mean - interval),
            "upper": (of_method, mean + interval),
            "standard_deviation": (of_method, mean * 0 + interval / 1.96),
            "crps": (("time", "channel"), np.array([[9.0, 9.0], [0.2, 0.5], [0.3, 0.6], [0.4, np.nan]])),
            "observed_status": (("time", "heater"), [[1.0], [1.0], [0.0], [np.nan]]),
            "status": (("by", "time", "heater"), np.full((4, 4, 1), 1.0)),
            "point_duty_cycle": (of_heater, np.full((4, 1), 0.5)),
            "point_sampled_duty_cycle": (of_heater, np.full((4, 1), 0.6)),
            "unknown_status": ("heater", [0.25]),
            "point_switch_count": (of_heater, np.full((4, 1), 3.0)),
            "point_energy": (of_heater, np.full((4, 1), 1000.0)),
            "observed_duty_cycle": ("heater", [0.4]),
            "observed_switch_count": ("heater", [5.0]),
        },
        {"time": np.datetime64("2024-03-01", "ns") + np.arange(4) * np.timedelta64(60, "s"),
         "by": methods, "channel": ["a", "b"], "heater": ["h"]},
    )  # fmt: skip


def values(metrics: list[Metric], **wanted: str) -> dict[str, float | None]:
    return {m.metric: m.value for m in metrics if all(getattr(m, k) == v for k, v in wanted.items())}


def test_only_scored_samples_count(prediction):
    spoiled = prediction.copy(deep=True)
    spoiled["observed"][0] = 1.0
    spoiled["observed_status"][0] = 0.0
    assert score(spoiled, "test") == score(prediction, "test")


def test_every_method_channel_and_pool_is_scored(prediction):
    metrics = score(prediction, "test")
    assert {m.window for m in metrics} == {"test"}
    assert {(m.method, m.channel) for m in metrics if m.metric == "rmse"} == {
        (str(m), c) for m in prediction["by"].values for c in ("a", "b", "all")
    }
    assert values(metrics, method="genetic", channel="a")["rmse"] == pytest.approx(2.0)
    assert values(metrics, method="stochastic", channel="all")["rmse"] == pytest.approx(1.0)
    assert values(metrics, method="stochastic", channel="all")["picp"] == 1.0
    assert values(metrics, method="stochastic", channel="b")["mpiw"] == pytest.approx(3.0)
    assert values(metrics, method="stochastic", channel="all")["crps"] == pytest.approx(0.4)
    assert values(metrics, method="stochastic", channel="b")["crps"] == pytest.approx(0.55)
    assert values(metrics, method="genetic", channel="a")["crps"] == pytest.approx(2.0)


def test_scores_of_distributions_take_each_samples_own_deviation(prediction):
    prediction["standard_deviation"][-1] *= np.array([[1.0, 1.0], [2.0, 0.5], [0.3, 1.7], [1.1, 1.0]])
    prediction["upper"][-1, 3, 1] += 5.0  # where there is no telemetry
    found = values(score(prediction, "test"), method="stochastic", channel="all")
    stochastic = prediction.sel({"by": "stochastic"}).isel(time=slice(1, None))
    given = [stochastic[name].values for name in ("observed", "mean", "standard_deviation")]
    assert found["log_score"] == pytest.approx(np.nanmean(norm(*given[1:]).logpdf(given[0])))
    assert found["mpiw"] == pytest.approx(3.0)


def test_point_methods_have_no_interval_scores(prediction):
    metrics = score(prediction, "test")
    assert {m.method for m in metrics if m.metric in ("picp", "mpiw")} == {"stochastic"}


def test_undefined_scores_are_none_with_a_reason(prediction):
    metrics = score(prediction, "test")
    of_b = next(m for m in metrics if (m.method, m.channel, m.metric) == ("genetic", "b", "mape_celsius"))
    assert of_b.value is None
    assert "0 degC" in of_b.note
    prediction["observed"][:, 1] = prediction["crps"][:, 1] = np.nan
    empty = [m for m in score(prediction, "test") if m.channel == "b"]
    assert all(m.value is None and m.note for m in empty)


def test_heater_errors_are_simulated_minus_observed(prediction):
    found = values(score(prediction, "test"), method="genetic", channel="h")
    assert found["duty_cycle_error"] == pytest.approx(0.2)  # of the known samples, where it is on for 0.6
    assert (found["duty_cycle"], found["status_unknown"]) == (0.5, 0.25)
    assert found["switch_count_error"] == -2.0
    assert found["status_agreement"] == 0.5
    assert found["energy_error"] == pytest.approx(1000 * (0.6 - 0.4) / 0.5)


def test_a_scenario_without_heaters_is_scored(prediction):
    bare = prediction.drop_dims("heater")
    assert values(score(bare, "test"), method="genetic", channel="a")["rmse"] == pytest.approx(2.0)


def test_comparison_gives_the_ratio_beside_the_papers(prediction):
    rows = {(r.channel, r.metric): r for r in comparison_table(score(prediction, "test"))}
    pooled = rows["all", "rmse"]
    assert pooled.ratio == pytest.approx(0.5)
    assert pooled.published == pytest.approx(0.753, abs=5e-4)
    assert rows["all", "mape_kelvin"].published == pytest.approx(0.885, abs=5e-4)
    assert rows["b", "mape_celsius"].ratio is None
    assert "0 degC" in rows["b", "mape_celsius"].note


def test_comparison_has_the_best_genetic_run_beside_the_mean(prediction):
    renamed = prediction.assign_coords(by=["genetic_best", *prediction["by"].values[1:]])
    row = next(r for r in comparison_table(score(renamed, "test")) if (r.channel, r.metric) == ("a", "rmse"))
    assert (row.genetic_best, row.genetic, row.stochastic) == pytest.approx((4.0, 2.0, 1.0))
    assert row.ratio_best == pytest.approx(0.25)
    assert next(iter(comparison_table(score(prediction, "test")))).ratio_best is None


def test_scores_of_runs_are_the_ends_and_the_middle_of_their_errors(prediction):
    runs = prediction.assign_coords(method=["run_1", "run_2", "run_3", "stochastic"])
    of_runs = [m for m in score(runs, "test") if m.method != "stochastic"]
    found = scores_of_runs(of_runs)
    assert {m.method for m in found} == {"genetic_runs"}
    assert values(found, channel="a") == pytest.approx({"rmse_lowest": 2.0, "rmse_median": 3.0, "rmse_highest": 4.0})
    assert {m.note for m in found} == {"of 3 runs"}


def test_comparison_stands_one_missing_method(prediction):
    rows = comparison_table(score(prediction.sel({"by": ["genetic"]}), "test"))
    assert rows[0].stochastic is None
    assert rows[0].ratio is None


def test_what_the_calibrated_numbers_alone_are_worth_is_told_of_unseen_windows_with_telemetry():
    errors = {
        ("train", "calibrated"): 0.1, ("test", "uncalibrated"): 3.0, ("test", "calibrated"): 0.5,
        ("test", "genetic_best"): 0.4, ("test", "stochastic"): 0.25, ("plan", "uncalibrated"): None,
        ("plan", "calibrated"): None, ("plan", "genetic_best"): None, ("plan", "stochastic"): None,
    }  # fmt: skip
    metrics = [Metric(method, window, "all", "rmse", value, "K") for (window, method), value in errors.items()]
    assert simulator_errors(metrics) == [SimulatorError("test", 3.0, 0.5, 0.4, 0.25)]
    assert str(simulator_errors(metrics)[0]) == (
        "test: RMSE 3 K before, 0.25 K as this run predicts; simulated alone 0.5 K with calibrated.yaml, 0.4 K with "
        "best_fit.yaml"
    )
    assert simulator_errors(metrics[:4]) == []
