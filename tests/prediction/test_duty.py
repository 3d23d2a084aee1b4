"""Errors of duty cycles: those of whole orbits, and an interval that holds another window's as often as it says."""

import numpy as np
import pytest

from flightcal.errors import RunError
from flightcal.prediction import predict
from flightcal.prediction.duty import draw_duty_errors, duty_errors, sampled_duty_cycle, unknown_share
from flightcal.prediction.errors import window_errors
from flightcal.problem import build_problem, build_window

from .. import small

NOISE = {"model": "ar1", "standard_deviation": "0.2 K", "correlation_time": "8 min"}


def test_an_orbits_error_is_the_mean_of_telemetry_minus_simulation_over_its_samples():
    seconds = 100.0 + 60.0 * np.arange(33)  # three orbits of ten samples, and three of a fourth
    observed, simulated = np.random.default_rng(0).random((2, 33, 2))
    errors = duty_errors(observed, simulated, seconds - 100.0, 600.0, 1980.0)
    expected = (observed - simulated)[:30].reshape(3, 10, 2).mean(axis=1)
    np.testing.assert_allclose(errors, expected)


def test_an_orbit_that_ends_with_the_window_is_whole():
    seconds = 60.0 * np.arange(20)
    assert len(duty_errors(np.ones((20, 1)), np.zeros((20, 1)), seconds, 600.0, 1200.0)) == 2
    assert len(duty_errors(np.ones((20, 1)), np.zeros((20, 1)), seconds, 600.0, 1198.0)) == 2
    assert len(duty_errors(np.ones((19, 1)), np.zeros((19, 1)), seconds[:19], 600.0, 1140.0)) == 1


@pytest.mark.parametrize("late", [0.0, 37.0])
def test_packets_with_time_stamps_of_their_own_leave_whole_orbits_whole(late):
    """Eight other packets in the minute between two of the heater's status, each with a time of its own."""
    rng = np.random.default_rng(3)
    status_times = 60.0 * np.arange(30) + late * rng.random(30)
    others = rng.uniform(status_times[0], 1790.0, 240)
    seconds = np.sort(np.concatenate([status_times, others]))
    observed = np.where(np.isin(seconds, status_times), 1.0, np.nan)[:, None]
    errors = duty_errors(observed, np.full(observed.shape, 0.25), seconds, 600.0, 1800.0)
    np.testing.assert_allclose(errors, [[0.75]] * 3)


def test_a_duty_cycle_on_samples_leaves_out_what_telemetry_leaves_out():
    observed = np.array([[1.0, np.nan], [np.nan, np.nan], [0.0, np.nan], [0.0, np.nan]])
    simulated = np.array([[1.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
    found = sampled_duty_cycle(np.stack([simulated, 1.0 - simulated]), observed)
    np.testing.assert_allclose(found, [[2 / 3, np.nan], [1 / 3, np.nan]])


def test_a_status_is_unknown_in_gaps_and_at_the_ends():
    seconds = np.concatenate([60.0 * np.arange(5, 20), 60.0 * np.arange(30, 40)])  # 15 min of 40 without a row
    observed = np.ones((25, 3))
    observed[3:6, 1] = np.nan
    observed[:, 2] = np.nan
    np.testing.assert_allclose(unknown_share(observed, seconds, 2400.0), [15 / 40, 18 / 40, 1.0])


def test_samples_without_a_status_do_not_count_and_half_of_an_orbit_is_needed():
    observed, simulated = np.ones((20, 1)), np.full((20, 1), 0.25)
    observed[[0, 1, 2, 3, 4]] = np.nan
    simulated[:5] = 1.0
    observed[10:16] = np.nan
    errors = duty_errors(observed, simulated, 60.0 * np.arange(20), 600.0, 1200.0)
    np.testing.assert_allclose(errors, [[0.75], [np.nan]])


def test_a_single_sample_has_no_orbit():
    assert duty_errors(np.ones((1, 2)), np.zeros((1, 2)), np.zeros(1), 600.0, 60.0).shape == (0, 2)


@pytest.mark.parametrize(("orbits", "known"), [(0.5, 3), (2.0, 4), (2.0, 12)])
def test_the_95_percent_of_drawn_errors_hold_a_new_windows_error_in_95_percent(orbits, known):
    """For a window of m orbits whose errors are independent, the mean of m of them."""
    rng = np.random.default_rng(1)
    repeats = 4000
    seen = 0.02 + 0.01 * rng.standard_normal((known, repeats))
    new = 0.02 + 0.01 / np.sqrt(orbits) * rng.standard_normal(repeats)
    low, high = np.quantile(draw_duty_errors(seen, orbits, 2000, rng), [0.025, 0.975], axis=0)
    covered = np.mean((low <= new) & (new <= high))
    # Chance: four deviations of a share of 4000, 1.4%; the quantiles of 2000 draws add little.
    assert covered == pytest.approx(0.95, abs=0.016)


def test_where_fewer_than_three_orbits_are_known_nothing_is_drawn():
    errors = np.array([[0.1, 0.2], [0.3, 0.1], [np.nan, 0.3]])
    drawn = draw_duty_errors(errors, 2.0, 50, np.random.default_rng(0))
    assert (drawn[:, 0] == 0.0).all()
    assert (drawn[:, 1] != 0.0).all()


def case(folder, noise, *, minutes=35):
    """Training of 140 min, an orbit of so many minutes, and a heater that telemetry has on for longer."""
    written = small.content()
    written["environment"] = {"period": f"{minutes} min"}
    written["windows"] = {
        "train": {"start": "2024-03-01T00:00:00", "end": "2024-03-01T02:20:00"},
        "test": {"start": "2024-03-01T02:30:00", "end": "2024-03-01T03:40:00"},
    }
    written["noise"] = noise
    written["observations"]["panel_temp"].pop("noise", None)
    scenario, data = small.closed_loop(folder, written)
    problem = build_problem(scenario, data)
    values = {"noise.body_temp": 0.2, "noise.panel_temp": 0.2, "initial.body": 285.0, "initial.panel": 262.0}
    values |= small.TRUTH
    return scenario, data, problem, np.tile([values[name] for name in problem.names], (400, 1))


def test_a_new_windows_duty_is_off_as_in_training_where_residuals_have_a_model(tmp_path):
    scenario, data, problem, draws = case(tmp_path, NOISE)
    simulated = problem.windows[0].simulate(draws[0]).status[:, 0]
    seconds = (problem.windows[0].times - problem.windows[0].times[0]) / np.timedelta64(1, "s")
    told = data["heater_status"].values.copy()
    told[: len(simulated)] = np.where(seconds // 2100 == 2, 1.0, simulated)  # on for all of the third of four orbits
    data["heater_status"].values[:] = told
    train = predict(build_problem(scenario, data), data, "train", {}, draws, seed=1)[0]
    test = predict(build_problem(scenario, data), data, "test", {}, draws, seed=1)[0]
    run = build_window(scenario, data, "test").simulate(draws[0])
    spread = np.quantile(train["duty_cycle"], [0.025, 0.975]) - simulated.mean()
    assert np.abs(spread).max() < 0.02  # status of the training window is known
    error = 1.0 - simulated[seconds // 2100 == 2].mean()
    assert error > 0.2
    shift = test["duty_cycle"].values[:, 0] - run.duty_cycle[0]
    # Four errors, of which one is not zero: mean e / 4, deviation e / 2; Student's t with three degrees of freedom.
    scale = error / 2 * np.sqrt(1 / 4 + 1 / 2)
    assert np.median(shift) == pytest.approx(error / 4, abs=5 * scale * 1.36 / np.sqrt(400))
    quartiles = np.quantile(shift, [0.25, 0.75])
    np.testing.assert_allclose(quartiles, error / 4 + scale * np.array([-0.765, 0.765]), atol=0.2 * scale)
    assert test.attrs["duty_cycle_contains"].endswith(", its error as in 4 orbits of the training window")
    assert train.attrs["duty_cycle_contains"] == "parameters, initial temperatures"


def test_independent_noise_leaves_duty_as_it_is_simulated(tmp_path):
    scenario, data, _, draws = case(tmp_path, {"standard_deviation": "0.2 K"})
    data["heater_status"].values[:60] = 1.0
    test, ensemble = predict(build_problem(scenario, data), data, "test", {}, draws[:20], seed=1)
    assert np.ptp(test["duty_cycle"].values) < 0.05
    assert test.attrs["duty_cycle_contains"] == "parameters, initial temperatures"
    np.testing.assert_array_equal(test["duty_cycle"], ensemble.duty_cycle)


def test_two_orbits_of_training_say_that_they_tell_too_little(tmp_path):
    scenario, data, _, draws = case(tmp_path, NOISE, minutes=70)
    data["heater_status"].values[:60] = 1.0
    test = predict(build_problem(scenario, data), data, "test", {}, draws[:20], seed=1)[0]
    assert np.ptp(test["duty_cycle"].values) < 0.05
    assert test.attrs["duty_cycle_contains"].endswith(
        "takes 3 whole orbits of training with a known status to tell; there are 2"
    )


def test_a_duty_cycle_stays_a_share(tmp_path):
    scenario, data, _, draws = case(tmp_path, NOISE)
    seconds = (data["time"].values - data["time"].values[0]) / np.timedelta64(1, "s")
    data["heater_status"].values[:] = seconds // 2100 % 2
    duty = predict(build_problem(scenario, data), data, "test", {}, draws, seed=1)[0]["duty_cycle"].values
    assert duty.min() == 0.0
    assert duty.max() == 1.0


def test_the_simulation_that_telemetry_is_held_to_is_the_mean_of_the_draws_that_did_not_fail(tmp_path):
    scenario, data, train, draws = case(tmp_path, NOISE)
    draws = draws[:6]
    draws[:, train.names.index("power")] += [0.0, 2.0, 4.0, -2.0, 8.0, 0.0]
    draws[5, train.names.index("initial.body")] = np.nan
    errors = window_errors(train, build_window(scenario, data, "test"), draws, 11)
    status = np.mean([train.windows[0].simulate(theta).status for theta in draws[:5]], axis=0)
    seconds = (train.windows[0].times - train.windows[0].times[0]) / np.timedelta64(1, "s")
    assert len(errors.duty) == 4
    np.testing.assert_allclose(errors.duty, duty_errors(train.windows[0].status, status, seconds, 2100.0, 8400.0))


def test_a_training_window_that_no_draw_can_simulate_is_a_clear_error(tmp_path):
    scenario, data, train, draws = case(tmp_path, NOISE)
    draws[:, train.names.index("initial.body")] = np.nan
    with pytest.raises(RunError, match="window 'test': 20 of 20 simulations failed"):
        predict(build_problem(scenario, data), data, "test", {}, draws[:20], seed=1)
