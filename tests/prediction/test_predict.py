"""Predictions of windows: what is scored, and that nothing scored is looked at."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from flightcal.prediction import predict
from flightcal.prediction.initial import around_usual, beside, condition_initial
from flightcal.prediction.predict import STOCHASTIC
from flightcal.problem import build_problem, build_window

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
    scenario, telemetry, points, draws = case
    return predict(
        build_problem(scenario, telemetry if data is None else data),
        telemetry if data is None else data,
        window,
        points,
        draws,
        seed=1,
    )[0]


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


def test_a_node_without_a_channel_starts_where_training_had_it_and_not_where_training_starts(tmp_path):
    """Nothing measures the panel, whose 60 degC at the start of training are soon forgotten."""
    written = small.content()
    written["observations"].pop("panel_temp")
    written["simulator"]["nodes"]["panel"]["initial"] = "60 degC"
    scenario, data = small.load(tmp_path, written)
    problem = build_problem(scenario, data)
    values = {"noise.body_temp": 0.1, "initial.body": 285.0, "initial.panel": 333.15} | small.TRUTH
    theta = np.array([values[name] for name in problem.names])
    found = build_window(scenario, data, "test", span=600.0)
    usual = around_usual(found, problem, np.stack([theta - 1e-6, theta + 1e-6]))
    written_start, start = (window.reads["initial.panel"] for window in (found, usual))
    assert (written_start.mean, written_start.standard_deviation) == (333.15, 5.0)
    assert 250.0 < start.mean < 285.0
    assert 5.0 <= start.standard_deviation < 20.0
    assert usual.reads["initial.body"] is found.reads["initial.body"]


def test_a_node_that_went_with_others_is_as_cold_as_they_are_and_one_that_did_not_is_as_ever():
    rng = np.random.default_rng(0)
    read = rng.normal(290.0, 20.0, 4000)
    with_it, alone = read - 3.0 + rng.normal(0.0, 0.5, 4000), rng.normal(300.0, 2.0, 4000)
    kelvins, told = np.stack([with_it, read, alone], axis=1), np.array([False, True, False])
    mean, deviation = beside(kelvins, np.ones(4000), told, np.array([280.0]))
    # Of a deviation of 20 K around 290 K and one of 5 K around 280 K.
    assert mean == pytest.approx([277.6, 300.0], abs=0.6)
    assert deviation == pytest.approx([4.9, 2.0], abs=0.3)


def test_a_node_is_known_worse_the_farther_others_are_from_where_they_have_been():
    kelvins, told = np.linspace([280.0, 281.0], [290.0, 287.0], 50), np.array([False, True])
    mean, deviation = beside(kelvins, np.ones(50), told, np.array([267.0]))
    assert 280.0 < mean[0] < 285.0
    assert deviation[0] > 14.0


def test_longer_steps_count_as_many_shorter_ones():
    kelvins, told = np.array([[280.0, 281.0], [290.0, 287.0], [284.0, 290.0]]), np.array([False, True])
    read = np.array([283.0])
    weighted = beside(kelvins, np.array([1.0, 3.0, 2.0]), told, read)
    np.testing.assert_allclose(weighted, beside(kelvins[[0, 1, 1, 1, 2, 2]], np.ones(6), told, read))


def test_the_first_samples_of_an_unseen_window_are_not_scored_and_all_others_are(case):
    result = predicted(case, "test")
    early = result["time"].values <= result["time"].values[0] + SPAN
    assert early.sum() == 11
    np.testing.assert_array_equal(result["scored"], ~early)


def test_all_samples_of_the_train_window_are_scored(case):
    assert predicted(case, "train")["scored"].all()


def test_an_unseen_window_that_begins_in_a_gap_is_predicted_from_its_first_sample_on(case):
    scenario, data, *_ = case
    start = np.datetime64(scenario.windows["test"].start)
    times = data["time"].values
    gap = data.copy(deep=True)
    for channel in ("body_temp", "panel_temp"):
        gap[channel].values[(times >= start) & (times < start + 3 * SPAN)] = np.nan
    prediction = predicted(case, "test", gap)
    scored = prediction["time"].values[prediction["scored"].values]
    assert scored[0] > start + 4 * SPAN
    found = prediction.sel(by=STOCHASTIC, time=scored)
    inside = (found["lower"] <= found["observed"]) & (found["observed"] <= found["upper"])
    assert inside.mean() > 0.8


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
    residual = (result["observed"] - result["mean"].sel({"by": "point"})).values[result["scored"].values]
    np.testing.assert_allclose(np.sqrt((residual**2).mean(axis=0)), 0.1, rtol=0.25)
    inside = (result["lower"].sel({"by": STOCHASTIC}) <= result["observed"]) & (
        result["observed"] <= result["upper"].sel({"by": STOCHASTIC})
    )
    assert 0.88 < float(inside.mean()) < 0.995


def test_the_train_window_is_predicted_with_the_initial_temperatures_of_theta(case):
    scenario, data, points, _ = case
    expected = build_problem(scenario, data).simulate(points["point"])[0].temperatures
    np.testing.assert_array_equal(predicted(case, "train")["mean"].sel({"by": "point"}), expected)


def test_the_same_seed_gives_the_same_prediction(case):
    assert predicted(case, "test").identical(predicted(case, "test"))


def test_another_seed_draws_other_noise(case):
    scenario, data, points, draws = case
    other, _ = predict(build_problem(scenario, data), data, "test", points, draws, seed=2)
    lower, usual = (result["lower"].sel({"by": STOCHASTIC}).values for result in (other, predicted(case, "test")))
    assert np.isfinite(lower).all()
    assert not np.array_equal(lower, usual)


def test_another_window_draws_other_noise(tmp_path):
    written = small.content()
    written["windows"]["train"] = {"first": written["windows"]["train"], "again": written["windows"]["test"]}
    written["windows"]["test"] = {"start": "2024-03-01T06:35:00", "end": "2024-03-01T06:55:00"}
    scenario, data = small.closed_loop(tmp_path, written)
    draws = np.tile(build_problem(scenario, data).priors.median(), (5, 1))
    noise = []
    for window in ("train.first", "train.again"):
        prediction = predict(build_problem(scenario, data), data, window, {}, draws, seed=1)[0].sel({"by": STOCHASTIC})
        noise.append((prediction["lower"] - prediction["mean"]).values)
    assert noise[0].shape == noise[1].shape
    assert not np.allclose(*noise)


def test_interval_and_span_are_those_of_the_settings(tmp_path):
    written = small.content()
    written["calibration"]["prediction"] |= {"interval": 0.8, "initial_span": "20 min"}
    scenario, data = small.closed_loop(tmp_path, written)
    problem = build_problem(scenario, data)
    draws = np.tile(problem.priors.median(), (400, 1))
    result, _ = predict(build_problem(scenario, data), data, "train", {}, draws, seed=1)
    width = (result["upper"] - result["lower"]).sel({"by": STOCHASTIC}).values.mean(axis=0)
    # The quantiles of 400 draws, averaged over 181 samples.
    np.testing.assert_allclose(width, 2 * 1.2816 * problem.windows[0].noise(draws[0]), rtol=0.02)
    assert result.attrs["interval"] == 0.8
    later, _ = predict(build_problem(scenario, data), data, "test", {}, draws[:4], seed=1)
    assert int((~later["scored"]).sum()) == 21
    assert later.attrs["initial_state"].startswith("estimated from the first 20 min")


def test_draws_are_conditioned_with_their_own_noise_and_failures_are_counted(case, monkeypatch):
    scenario, data, _, draws = case
    problem, given = build_problem(scenario, data), []

    def noted(first, thetas, errors, rng=None, heat=None):
        given.append(errors.noise)
        return condition_initial(first, thetas, errors, rng, heat)

    for module in ("predict", "initial"):
        monkeypatch.setattr(sys.modules[f"flightcal.prediction.{module}"], "condition_initial", noted)
    thetas = draws[:4].copy()
    thetas[:, problem.names.index("noise.body_temp")] = [0.1, 0.2, 0.3, 0.4]
    thetas[3, problem.names.index("power")] = np.nan
    result, ensemble = predict(build_problem(scenario, data), data, "test", {}, thetas, seed=1)
    np.testing.assert_array_equal(given[0], [problem.windows[0].noise(theta) for theta in thetas])
    assert result.attrs["failed_simulations"] == ensemble.failed == 1


class Shifted:
    """In the place of an emulator: the simulator itself and 2 K on the panel, of some of the samples."""

    def __init__(self, exact, part=slice(None)):
        self.exact, self.part = exact, part
        self.error_basis = np.zeros((len(exact.observation.times), len(exact.channels), 1))

    def __getattr__(self, name):
        return getattr(self.exact, name)

    def on(self, part):
        return Shifted(self.exact, part)

    def simulate_many(self, thetas):
        return [
            replace(run, temperatures=run.temperatures[self.part] + [0.0, 2.0], error_variance=np.zeros(1))
            for run in self.exact.simulate_many(thetas)
        ]


def test_draws_run_on_a_stand_in_from_the_first_sample_and_points_on_the_simulator_itself(case, monkeypatch):
    scenario, data, points, draws = case
    monkeypatch.setattr(sys.modules["flightcal.prediction.predict"], "EmulatedSimulator", Shifted)
    result, _ = predict(
        build_problem(scenario, data), data, "test", points, draws, seed=1,
        stand_in=lambda window: replace(window, simulator=Shifted(window.simulator)),
    )  # fmt: skip
    np.testing.assert_allclose(result["mean"].sel({"by": "point"}), predicted(case, "test")["mean"][0], atol=1e-9)
    # The first samples tell the stand-in that its panel is 2 K colder.
    panel = result.sel(channel="panel_temp")
    assert abs((panel["mean"].sel({"by": STOCHASTIC}) - panel["observed"])[:11].mean()) < 0.3
    assert np.abs(panel["mean"].sel({"by": STOCHASTIC}) - panel["mean"].sel({"by": "point"}))[60:].max() > 1.0
    assert ", the surrogate's error, measurement noise" in result.attrs["interval_contains"]
    assert result.attrs["model_interval_contains"].endswith(", the surrogate's error")


def test_the_means_over_the_simulations_stand_in_the_row_of_the_stochastic_update(case):
    result = predicted(case, "test")
    row = result.isel(by=-1)
    assert result["duty_cycle"].values.std() > 0.0
    for name in ("duty_cycle", "switch_count", "energy"):
        assert row[f"point_{name}"].values == pytest.approx(result[name].mean("simulation").values), name


def test_each_points_run_and_the_ensemble_stand_in_their_own_rows(case):
    scenario, data, points, draws = case
    problem = build_problem(scenario, data)
    position = problem.names.index
    thetas = {name: points["point"].copy() for name in ("failed", "truth", "strong", "warm")}
    thetas["failed"][position("power")] = np.nan
    thetas["strong"][position("power")] = 35.0
    thetas["warm"][position("initial.body")] = 1000.0  # its heater never switches
    result, ensemble = predict(build_problem(scenario, data), data, "train", thetas, draws, seed=1)
    assert result["by"].values.tolist() == [*thetas, STOCHASTIC]
    by_method = ("mean", "status", "point_duty_cycle", "point_switch_count", "point_energy")
    assert all(np.isnan(result[name].sel({"by": "failed"})).all() for name in by_method)
    for method in ("truth", "strong", "warm"):
        row, run = result.sel({"by": method}), problem.windows[0].simulate(thetas[method])
        energy = run.duty_cycle * thetas[method][position("power")] * 10800.0
        expected = (run.temperatures, run.status, run.duty_cycle, [len(run.switches.time)], energy)
        for name, values in zip(by_method, expected, strict=True):
            np.testing.assert_allclose(row[name], values, rtol=1e-9, err_msg=name)
        assert np.isnan(row["upper"]).all()
    stochastic = result.sel({"by": STOCHASTIC})
    by_sample = ("model_lower", "model_upper", "crps", "probability_below")
    for name in ("mean", "lower", "upper", "standard_deviation", "status", *by_sample):
        np.testing.assert_array_equal(stochastic[name], getattr(ensemble, name), err_msg=name)


def test_phases_of_all_windows_count_from_the_training_windows_start(case):
    # The window begins 3.5 h later, and an orbit takes 1.5 h.
    assert float(predicted(case, "test")["orbit_phase"][0]) == pytest.approx((3.5 / 1.5) % 1.0)
    assert float(predicted(case, "train")["orbit_phase"][0]) == 0.0


def test_measured_duty_and_switches_are_those_of_the_valid_samples(case):
    scenario, data, _, draws = case
    other = data.copy(deep=True)
    status = other["heater_status"].values[210:390]
    status[:] = 0.3
    status[[20, 60, 61]] = 0.7
    status[[40, 59, 90, 91]] = np.nan
    with np.errstate(invalid="raise"):
        result, _ = predict(build_problem(scenario, other), other, "test", {}, draws[:3], seed=1)
        assert result["observed_duty_cycle"].values == pytest.approx([(173 * 0.3 + 3 * 0.7) / 176])
        assert result["observed_switch_count"].values == [4]
        status[:] = np.nan
        result, _ = predict(build_problem(scenario, other), other, "test", {}, draws[:3], seed=1)
    assert np.isnan(result["observed_duty_cycle"]).all()
    assert np.isnan(result["observed_switch_count"]).all()


def test_measured_duty_and_switches_stand_beside_the_predicted_ones(case):
    result = predicted(case, "test")
    status = result["observed_status"].values[:, 0]
    assert result["observed_duty_cycle"].values == pytest.approx([status.mean()])
    assert result["observed_switch_count"].values == [np.abs(np.diff(status)).sum()]
    assert result["point_duty_cycle"].sel({"by": "point"}).values == pytest.approx([status.mean()], abs=0.02)
    assert result["point_switch_count"].sel({"by": "point"}).values == result["observed_switch_count"].values


def test_a_points_energy_is_that_of_its_heater_over_the_window(case):
    result = predicted(case, "test").sel({"by": "point"})
    window = case[0].windows["test"]
    seconds = (window.end - window.start).total_seconds()
    expected = result["point_duty_cycle"].values * small.TRUTH["power"] * seconds
    np.testing.assert_allclose(result["point_energy"].values, expected, rtol=1e-9)


def test_the_dataset_says_what_its_interval_contains(case):
    said = "parameters, initial temperatures, measurement noise; not model discrepancy"
    assert predicted(case, "test").attrs["interval_contains"] == said
    assert predicted(case, "test").attrs["model_interval_contains"] == "parameters, initial temperatures"
    assert predicted(case, "test").attrs["initial_state"].startswith("estimated from the first 10 min")
    assert predicted(case, "train").attrs["initial_state"] == "calibrated with the parameters"


def test_a_method_is_selected_by_keyword(case):
    """xarray takes no keyword of `sel` for a dimension where it has one of its own, such as `method`."""
    result = predicted(case, "test")
    np.testing.assert_array_equal(result["mean"].sel(by="point"), result["mean"][0])
    assert not {"method", "tolerance", "drop"} & set(result.dims)
