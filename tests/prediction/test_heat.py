"""Unmodelled heat in predictions: how windows go on from training, and at which temperatures thermostats switch."""

from dataclasses import replace

import numpy as np
import pytest

from flightcal.calibration.find_heat import find_heat
from flightcal.calibration.heat_point import start_with_heat
from flightcal.prediction import predict
from flightcal.prediction.heat import DrawnHeat, draw_heat
from flightcal.prediction.thresholds import Thresholds, scattered
from flightcal.probability.heat import fading
from flightcal.problem import SLOW, build_problem, build_window, knots_of

from .. import small

NOISE = 0.1
"""K, of the telemetry."""
OFF = 0.3
"""K: the heater truly goes on so much above what the scenario writes, and off so much below."""
DRAWS = 40
END = "2024-03-01T03:05:00"
"""Of training: the heater is off for some minutes before and after."""


def written(*, status=True, heaters=True):
    content = small.content() | {"heat": {"pattern": {"harmonics": 2}, "slow": {"time": "30 min"}}}
    content["time_error"] = "none"
    content["windows"] = {
        "train": {"start": "2024-03-01T00:00:00", "end": END},
        "test": {
            "next": {"start": END, "end": "2024-03-01T04:00:00"},
            "later": {"start": "2024-03-01T06:00:00", "end": "2024-03-01T07:00:00"},
        },
    }
    if not status:
        del content["simulator"]["heaters"]["heater"]["measured_by"], content["observations"]["heater_status"]
    if not heaters:
        del content["simulator"]["heaters"], content["observations"]["heater_status"], content["parameters"]["power"]
    return content


def flown(folder, off, *, noise=NOISE):
    """Telemetry of a satellite whose thermostat's thresholds are nearer to each other, by `off` each."""
    content = written()
    content["simulator"]["heaters"]["heater"] |= {"on_below": f"{10.0 + off} degC", "off_above": f"{13.0 - off} degC"}
    return small.closed_loop(folder, content, noise=noise)[1]


def drawn_of(folder, content, data):
    """A problem with heat, draws of it at one point, and their heat."""
    problem = build_problem(small.load(folder, content)[0], data)
    heated, z = start_with_heat(problem, find_heat(problem, problem.priors.median()))
    draws = np.tile(heated.to_theta(z), (DRAWS, 1))
    return heated, draws, draw_heat(heated, draws, np.random.default_rng(0))


@pytest.fixture(scope="module", params=[0.0, OFF])
def off(request):
    return request.param


@pytest.fixture(scope="module")
def case(tmp_path_factory, off):
    data = flown(tmp_path_factory.mktemp("flown"), off)
    return data, *drawn_of(tmp_path_factory.mktemp("heat"), written(), data)


def predicted(case, name):
    data, problem, draws, drawn = case
    return predict(problem, data, name, {}, draws, seed=0, heat=drawn)[0].isel(by=-1)


# --- drivers with gaps -------------------------------------------------------------------------------------------


def test_where_a_driver_has_a_gap_a_prediction_is_as_unsure_as_the_driver(tmp_path_factory):
    data = flown(tmp_path_factory.mktemp("whole"), 0.0)
    content = written(heaters=False)
    content["telemetry"]["channels"]["sun"]["fill"] = "previous_orbit"
    gap = data.copy(deep=True)
    # Half an hour of the window that begins at 06:00.
    gap["sun"].values[375:405] = np.nan
    widths = []
    for k, telemetry in enumerate((data, gap)):
        found = drawn_of(tmp_path_factory.mktemp(f"gap{k}"), content, telemetry)
        ahead = predicted((telemetry, *found), "test.later")
        widths.append((ahead["upper"] - ahead["lower"]).sel(channel="panel_temp").values)
        assert found[0].heat.groups == tuple(g for g in found[0].heat.groups if g.part != "gaps")
    whole, unsure = widths
    np.testing.assert_allclose(unsure[:12], whole[:12], rtol=0.5)
    # 12 W/A times 0.35 A is 4 W for 10 min in each piece: some 2 K in 800 J/K, four deviations of that wide.
    assert unsure[45] > whole[45] + 3.0


# --- changes of mode ---------------------------------------------------------------------------------------------


def test_after_a_change_of_mode_a_prediction_is_as_unsure_as_its_time(tmp_path_factory):
    content = written(heaters=False)
    content["simulator"] |= {
        "modes": {"quiet": {}, "busy": {"panel": "16 W"}},
        "timeline": [
            {"at": "2024-03-01T00:00:00", "mode": "quiet"},
            {"at": "2024-03-01T06:30:00", "mode": "busy"},
        ],
    }
    data = small.closed_loop(tmp_path_factory.mktemp("changed"), content, noise=NOISE)[1]
    widths = []
    for error in ("none", "60 s"):
        content["time_error"] = error
        found = drawn_of(tmp_path_factory.mktemp(error.replace(" ", "")), content, data)
        # Training has no change.
        assert not any(group.part == "changes" for group in found[0].heat.groups)
        ahead = predicted((data, *found), "test.later")
        widths.append((ahead["upper"] - ahead["lower"]).sel(channel="panel_temp").values)
    whole, unsure = widths
    assert unsure[2:28].mean() == pytest.approx(whole[2:28].mean(), rel=0.3)
    # 16 W for 60 s is 1.2 K in 800 J/K, four deviations of that wide, some minutes ago.
    assert unsure[34] > whole[34] + 2.0


# --- plans ---------------------------------------------------------------------------------------------------------


def test_a_plan_is_predicted_from_the_last_telemetry_on_and_holds(tmp_path_factory):
    flew = flown(tmp_path_factory.mktemp("flown"), 0.0)
    content = written()
    now, begins, ends = (f"2024-03-01T0{at}:00" for at in ("5:00", "5:30", "7:00"))
    content["windows"]["test"] = {"plan": {"start": begins, "end": ends, "planned": True}}
    content["telemetry"]["channels"]["sun"]["fill"] = "previous_orbit"
    known = flew.where(flew["time"] < np.datetime64(now), np.nan)
    # The Sun's current is planned.
    data = known.assign(flags=flew["flags"], sun=flew["sun"])
    found = drawn_of(tmp_path_factory.mktemp("heat"), content, data)
    ahead = predicted((data, *found), "test.plan")
    assert ahead["time"].values[0] == np.datetime64(begins)
    assert ahead.attrs["initial_state"] == "that of the last telemetry, simulated on"
    planned = ahead
    assert not np.isfinite(planned["observed"]).any()
    truth = flew.sel(time=planned["time"])
    for channel in ("body_temp", "panel_temp"):
        of_channel = planned.sel(channel=channel)
        inside = (truth[channel] > of_channel["lower"]) & (truth[channel] < of_channel["upper"])
        assert float(inside.mean()) > 0.8, channel
        assert float((of_channel["upper"] - of_channel["lower"]).mean()) < 6.0
        # What is flown has measurement noise, and the extremes have none.
        for end, extreme in (("lowest", truth[channel].min()), ("highest", truth[channel].max())):
            draws = ahead[end].sel(channel=channel)
            assert draws.min() - 0.2 < extreme < draws.max() + 0.2, (channel, end)


# --- from training to what follows --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def at_end(tmp_path_factory, off):
    """Temperatures [N] K where training ends, as they truly were."""
    data = flown(tmp_path_factory.mktemp("true"), off, noise=0.0).sel(time=np.datetime64(END))
    return np.array([float(data[channel]) for channel in ("body_temp", "panel_temp")])


def test_a_window_that_begins_where_training_ends_goes_on_from_its_final_state(case, at_end):
    trained, following = predicted(case, "train"), predicted(case, "test.next")
    *_, drawn = case
    assert "end of the training window" in following.attrs["initial_state"]
    assert following["scored"].all()
    assert following["time"].values[0] == np.datetime64(END)
    first = following["mean"].values[0]
    np.testing.assert_allclose(first, drawn.ends[0].temperatures.mean(axis=0), rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(first, at_end, rtol=0.0, atol=NOISE)
    # In a minute the body cools by a few noises, and the panel warms by as much.
    assert trained["time"].values[-1] == np.datetime64(END) - np.timedelta64(1, "m")
    np.testing.assert_allclose(first, trained["observed"].values[-1], rtol=0.0, atol=8.0 * NOISE)


def test_other_windows_begin_as_their_first_samples_say(case):
    *_, drawn = case
    assert drawn.continued(small.START + np.timedelta64(6, "h")) is None
    later = predicted(case, "test.later")
    assert "estimated from the first" in later.attrs["initial_state"]
    assert not later["scored"].values[0]


def test_in_training_the_noise_is_judged_where_heaters_do_what_was_measured(case):
    data, problem, draws, drawn = case
    observed, fitted = problem.windows[0].observed, drawn.fitted["train"]
    # Of 185 samples each the deviation is known to 5%; two dozen weights and parameters take a little of it.
    deviation = np.nanstd(observed - fitted, axis=0)
    assert (deviation > 0.75 * NOISE).all()
    assert (deviation < 1.15 * NOISE).all()
    shifted = replace(drawn, fitted={"train": fitted + 1.0})
    before, after = (predicted((data, problem, draws, heat), "train")["innovation"] for heat in (drawn, shifted))
    assert (abs(after - before).mean() > 3.0 * NOISE).all()


def test_the_end_of_training_is_where_its_simulations_with_heat_end(case, at_end):
    *_, drawn = case
    (end,) = drawn.ends
    assert end.time == np.datetime64(END)
    assert drawn.continued(end.time) is end
    # Surer of it than one sample is, and not surer than they may be.
    error, deviation = end.temperatures.mean(axis=0) - at_end, end.temperatures.std(axis=0)
    assert (deviation < NOISE).all()
    assert (np.abs(error) < 4.0 * deviation).all()


def test_the_end_of_training_has_the_nodes_in_the_order_of_theta_not_in_the_simulators(tmp_path):
    content = written()
    content["simulator"]["nodes"]["box"] = {"capacity": "500 J/K", "initial": "11 degC"}
    content["simulator"]["conductors"].append({"between": ["body", "box"], "conductance": "0.3 W/K"})
    data = small.closed_loop(tmp_path, content, noise=0.02)[1]
    problem, _, drawn = drawn_of(tmp_path, content, data)
    window = problem.windows[0]
    names = [name for name in window.names if name.startswith("initial.")]
    assert names != [name for name in window.simulator.parameters if name.startswith("initial.")]
    found = dict(zip(names, drawn.ends[0].temperatures.mean(axis=0), strict=True))
    for node in ("body", "panel"):
        assert abs(found[f"initial.{node}"] - float(data[f"{node}_temp"].sel(time=np.datetime64(END)))) < NOISE


def test_no_training_window_is_gone_on_from_if_all_its_simulations_failed(case):
    *_, drawn = case
    (end,) = drawn.ends
    failed = replace(end, temperatures=np.full_like(end.temperatures, np.nan))
    assert replace(drawn, ends=(failed,)).continued(end.time) is None


# --- slow heat ----------------------------------------------------------------------------------------------------


COUNT = 2000


@pytest.fixture(scope="module")
def slow(case):
    """Slow heat of many draws far above what its prior has, values at the knots [S, 3, Q] and scales [S] of a group."""
    data, problem, *_ = case
    model, rng = problem.heat, np.random.default_rng(0)
    knots = len(model.slow.knots)
    weights = tuple(4.0 + rng.standard_normal((COUNT, 3 * knots)) for _ in model.groups)
    scales = tuple(rng.uniform(0.5, 2.0, COUNT) for _ in model.groups)
    drawn = DrawnHeat(model, weights, scales, np.ones(COUNT, bool), None, (), {})
    g = next(k for k, group in enumerate(model.groups) if group.part == "slow_pattern")
    values = weights[g].reshape(COUNT, 3, knots) @ model.slow.root.T
    return data, problem, drawn, g, values, scales[g]


def in_window(slow, name):
    """Knots, and values there [S, 3, R]."""
    data, problem, drawn, g, *_ = slow
    window = build_window(problem.scenario, data, name)
    found = drawn.in_window(window, np.random.default_rng(1))
    assert found.model.slow.plain
    for other, group in enumerate(problem.heat.groups):
        assert (found.weights[other] is drawn.weights[other]) == (group.part not in SLOW)
    return knots_of(problem.heat, window), found.weights[g].reshape(COUNT, 3, -1)


def test_in_the_training_window_slow_heat_is_what_was_found(slow):
    _, problem, _, _, values, scale = slow
    knots, found = in_window(slow, "train")
    np.testing.assert_array_equal(knots, problem.heat.slow.knots)
    # The factor of a covariance that is zero has a little on its diagonal.
    np.testing.assert_allclose(found, values, rtol=0.0, atol=5.0 * np.sqrt(3e-9) * scale.max() + 1e-6)


def test_slow_heat_fades_from_its_last_value_in_training(slow):
    _, problem, _, _, values, scale = slow
    knots, found = in_window(slow, "test.next")
    fade = np.exp(-(knots - problem.heat.slow.knots[-1]).clip(0.0) / problem.heat.slow.time)
    beyond = fade < 1.0
    assert beyond.sum() > 3
    expected = values[..., -1:] * fade[beyond]
    standard = (found[..., beyond] - expected) / (scale[:, None, None] * np.sqrt(1.0 - fade[beyond] ** 2))
    count = 3 * COUNT
    assert np.abs(standard.mean(axis=(0, 1))).max() < 4.5 / np.sqrt(count)
    assert np.abs(standard.var(axis=(0, 1)) - 1.0).max() < 4.5 * np.sqrt(2.0 / count)


def test_far_from_training_slow_heat_is_as_its_prior_has_it(slow):
    _, problem, _, _, _, scale = slow
    knots, found = in_window(slow, "test.later")
    assert knots[0] - problem.heat.slow.knots[-1] > 5.0 * problem.heat.slow.time
    standard = (found / scale[:, None, None]).reshape(-1, len(knots))
    limit = 4.5 / np.sqrt(len(standard))
    # A value of 4 + 1 prior deviations in training has left e^-5 of it.
    assert np.abs(standard.mean(axis=0)).max() < limit + 12.0 * np.exp(-5.0)
    covariance = np.cov(standard.T)
    expected = fading(knots, knots, problem.heat.slow.time)
    assert np.abs(covariance - expected).max() < np.sqrt(2.0) * limit + 0.01


# --- thresholds ---------------------------------------------------------------------------------------------------


def test_thresholds_are_found_where_thermostats_switch(case, off):
    *_, drawn = case
    offsets = drawn.thresholds.offsets
    assert offsets.shape == drawn.thresholds.scatter.shape == (DRAWS, 2, 1)
    on, goes_off = offsets[:, :, 0].mean(axis=0)
    assert on == pytest.approx(off, abs=0.06)
    assert goes_off == pytest.approx(-off, abs=0.06)
    # Sharper than its switches' samples: where in between each was is told by the temperatures after it.
    assert (offsets.std(axis=0) < 0.04).all()


def test_a_prediction_tells_how_far_above_its_thresholds_a_heater_switches(case):
    *_, drawn = case
    prediction, offsets = predicted(case, "test.later"), drawn.thresholds.offsets[:, :, 0]
    told, least = prediction["threshold_offset"], prediction["least_threshold_offset"]
    np.testing.assert_allclose(told.values[:, 0], offsets.mean(axis=0))
    assert told["direction"].values.tolist() == ["on", "off"]
    for mean, bound, draws in zip(told.values[:, 0], least.values[:, 0], offsets.T, strict=True):
        assert abs(bound) < abs(mean)
        assert bound == 0.0 or (np.sign(mean) * draws >= abs(bound)).mean() == pytest.approx(0.95, abs=0.01)


def test_without_heaters_there_are_no_thresholds(tmp_path_factory):
    data = flown(tmp_path_factory.mktemp("flown"), 0.0)
    *_, drawn = drawn_of(tmp_path_factory.mktemp("heat"), written(heaters=False), data)
    assert drawn.thresholds is None
    assert drawn.usable.all()


def test_without_a_measured_status_thresholds_and_predictions_are_about_as_right(tmp_path_factory, off, case):
    data = case[0]
    problem, draws, drawn = drawn_of(tmp_path_factory.mktemp("heat"), written(status=False), data)
    lower, upper = np.median(drawn.thresholds.offsets[:, :, 0], axis=0)
    assert abs(lower - off) < 0.2
    assert abs(upper + off) < 0.2
    for name in ("train", "test.next", "test.later"):
        found = predict(problem, data, name, {}, draws, seed=0, heat=drawn)[0].isel(by=-1)
        truth = data["heater_status"].sel(time=found["time"]).values
        wrong, usual = (
            np.abs(prediction["status"].values[:, 0] - truth).mean() for prediction in (found, predicted(case, name))
        )
        # Thermostats of draws fall out of step, so some of that is usual.
        assert wrong < usual + 0.15, name


def test_each_switch_is_off_by_its_draws_offset_and_by_scatter_of_its_own():
    rng = np.random.default_rng(0)
    offsets, scatter = rng.normal(size=(3, 2, 2)), rng.uniform(0.1, 0.3, (3, 2, 2))
    thresholds = Thresholds(offsets, scatter)
    np.testing.assert_array_equal(scattered(thresholds, 5, None), offsets[:, None])
    count = 10_000
    found = scattered(thresholds, count, rng)
    assert found.shape == (3, count, 2, 2)
    standard = (found - offsets[:, None]) / scatter[:, None]
    assert np.abs(standard.mean(axis=1)).max() < 4.5 / np.sqrt(count)
    assert np.abs(standard.std(axis=1) - 1.0).max() < 4.5 / np.sqrt(2 * count)
