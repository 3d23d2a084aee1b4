"""Predictions of windows: what is scored, and that nothing scored is looked at."""

import numpy as np
import pytest

from flightcal.calibration import build_problem
from flightcal.prediction import STOCHASTIC, predict

from .. import small

SPAN = np.timedelta64(10, "m")


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    scenario, data = small.closed_loop(tmp_path_factory.mktemp("predict"))
    problem = build_problem(scenario, data)
    values = {"noise.body_temp": 0.1, "initial.body": 285.0, "initial.panel": 262.0} | small.TRUTH
    truth = np.array([values[name] for name in problem.names])
    draws = np.tile(truth, (40, 1))
    draws[:, 0] += 0.003 * np.random.default_rng(0).standard_normal(40)
    return scenario, data, {"point": truth}, draws


def predicted(case, window, data=None):
    scenario, own, points, draws = case
    return predict(scenario, own if data is None else data, window, points, draws, seed=1)[0]


def changed(data, scenario, *, after):
    """The telemetry of the test window from `after` on replaced by something else; drivers are as they were."""
    start = np.datetime64(scenario.windows["test"].start)
    other = data.copy(deep=True)
    late = data["time"].values > start + after
    rng = np.random.default_rng(9)
    for channel in ("body_temp", "panel_temp"):
        other[channel].values[late] += 7.0 + rng.standard_normal(late.sum())
    other["heater_status"].values[late] = rng.integers(0, 2, late.sum())
    return other


PREDICTIONS = (
    "mean", "lower", "upper", "standard_deviation", "model_lower", "model_upper", "status", "duty_cycle",
    "switch_count", "energy", "point_duty_cycle", "point_switch_count", "point_energy",
)  # fmt: skip


def test_the_first_samples_of_an_unseen_window_are_not_scored_and_all_others_are(case):
    result = predicted(case, "test")
    early = result["time"].values <= result["time"].values[0] + SPAN
    assert early.sum() == 11
    np.testing.assert_array_equal(result["scored"], ~early)


def test_all_samples_of_the_train_window_are_scored(case):
    assert predicted(case, "train")["scored"].all()


def test_telemetry_after_the_first_samples_does_not_change_the_prediction(case):
    scenario, data, *_ = case
    result, other = predicted(case, "test"), predicted(case, "test", changed(data, scenario, after=SPAN))
    for name in PREDICTIONS:
        np.testing.assert_array_equal(result[name], other[name], err_msg=name)
    assert not np.array_equal(result["observed"], other["observed"])


def test_status_that_is_scored_is_not_looked_at_even_where_no_other_is_near(case):
    scenario, data, *_ = case
    start = np.datetime64(scenario.windows["test"].start)
    time = data["time"].values
    bare = data.copy(deep=True)
    bare["heater_status"].values[(time > start - np.timedelta64(1, "h")) & (time <= start + SPAN)] = np.nan
    other = changed(bare, scenario, after=SPAN)
    for status in (0.0, 1.0):
        other["heater_status"].values[time > start + SPAN] = status
        bare["heater_status"].values[time > start + SPAN] = 1.0 - status
        np.testing.assert_array_equal(predicted(case, "test", bare)["mean"], predicted(case, "test", other)["mean"])


def test_the_first_samples_do_change_the_prediction(case):
    scenario, data, *_ = case
    start = np.datetime64(scenario.windows["test"].start)
    other = data.copy(deep=True)
    other["panel_temp"].values[(data["time"].values >= start) & (data["time"].values <= start + SPAN)] += 3.0
    difference = predicted(case, "test", other)["mean"] - predicted(case, "test")["mean"]
    assert (difference.sel(channel="panel_temp")[:, 0] > 2.0).all()


def test_the_true_parameters_predict_an_unseen_window_within_the_noise(case):
    result = predicted(case, "test")
    residual = (result["observed"] - result["mean"].sel({"method": "point"})).values[result["scored"].values]
    np.testing.assert_allclose(np.sqrt((residual**2).mean(axis=0)), 0.1, rtol=0.25)
    inside = (result["lower"].sel({"method": STOCHASTIC}) <= result["observed"]) & (
        result["observed"] <= result["upper"].sel({"method": STOCHASTIC})
    )
    assert 0.88 < float(inside.mean()) < 0.995


def test_the_train_window_is_predicted_with_the_initial_temperatures_of_theta(case):
    scenario, data, points, _ = case
    expected = build_problem(scenario, data).simulate(points["point"]).temperatures
    np.testing.assert_array_equal(predicted(case, "train")["mean"].sel({"method": "point"}), expected)


def test_the_same_seed_gives_the_same_prediction(case):
    assert predicted(case, "test").identical(predicted(case, "test"))


def test_another_seed_draws_other_noise(case):
    scenario, data, points, draws = case
    other, _ = predict(scenario, data, "test", points, draws, seed=2)
    assert not np.array_equal(other["lower"].values, predicted(case, "test")["lower"].values)


def test_the_means_over_the_simulations_stand_in_the_row_of_the_stochastic_update(case):
    result = predicted(case, "test")
    row = result.isel(method=-1)
    assert result["duty_cycle"].values.std() > 0.0
    for name in ("duty_cycle", "switch_count", "energy"):
        assert row[f"point_{name}"].values == pytest.approx(result[name].mean("simulation").values), name


def test_measured_duty_and_switches_stand_beside_the_predicted_ones(case):
    result = predicted(case, "test")
    status = result["observed_status"].values[:, 0]
    assert result["observed_duty_cycle"].values == pytest.approx([status.mean()])
    assert result["observed_switch_count"].values == [np.abs(np.diff(status)).sum()]
    assert result["point_duty_cycle"].sel({"method": "point"}).values == pytest.approx([status.mean()], abs=0.02)
    assert result["point_switch_count"].sel({"method": "point"}).values == result["observed_switch_count"].values


def test_a_points_energy_is_that_of_its_heater_over_the_window(case):
    result = predicted(case, "test").sel({"method": "point"})
    window = case[0].windows["test"]
    seconds = (window.end - window.start).total_seconds()
    expected = result["point_duty_cycle"].values * small.TRUTH["power"] * seconds
    np.testing.assert_allclose(result["point_energy"].values, expected, rtol=1e-9)


def test_the_dataset_says_what_its_interval_contains(case):
    assert "not model discrepancy" in predicted(case, "test").attrs["interval_contains"]
    assert predicted(case, "test").attrs["initial_state"].startswith("estimated from the first 10 min")
    assert predicted(case, "train").attrs["initial_state"] == "calibrated with the parameters"
