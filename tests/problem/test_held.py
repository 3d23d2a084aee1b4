"""Heaters whose status is not known all the time."""

from dataclasses import replace

import numpy as np
import pytest

from flightcal.problem import build_problem, held_by, hold, sampled_windows, with_other

from .. import small
from .heated import problem_of, written


def test_held_heaters_do_what_they_did_where_the_status_is_not_known(problem, centre):
    window = sampled_windows(problem)[0]
    assert np.isnan(window.network.drive.measured).any()
    theta = problem.at(window, centre[None])[0]
    held = held_by(window, theta)
    found = hold(window, held)
    assert not np.isnan(found.network.drive.measured).any()
    run, expected = found.simulate(theta), window.simulate(theta)
    np.testing.assert_allclose(run.temperatures, expected.temperatures, atol=1e-3)
    np.testing.assert_allclose(run.duty_cycle, expected.duty_cycle, atol=1e-9)
    assert len(found.switching.time) == len(window.switching.time) + len(held.switches)


def test_a_heater_that_leaves_a_gap_otherwise_than_simulated_has_switched_once_more_in_it(problem, centre):
    window = sampled_windows(problem)[0]
    theta = problem.at(window, centre[None])[0]
    simulator, drive = window.network, window.network.drive
    as_simulated = held_by(window, theta)
    ((begin, end, _),) = as_simulated.gaps
    stays_on = bool(as_simulated.on) and as_simulated.on[-1][1] == end
    step = int(np.searchsorted(drive.times, end))
    for after in (0.0, 1.0):
        measured = drive.measured.copy()
        measured[step : step + 4, 0] = after
        told = replace(window, simulator=replace(simulator, drive=replace(drive, measured=measured)))
        held = held_by(told, theta)
        assert (bool(held.on) and held.on[-1][1] == end) == bool(after)
        if bool(after) == stays_on:
            assert held == as_simulated
            continue
        assert len(held.switches) == len(as_simulated.switches) + 1
        time, _, within = held.switches[-1]
        last = max((time for time, _, _ in as_simulated.switches), default=begin)
        # Anywhere between the last switch and the end, of which that is mean and width.
        assert (time, within) == pytest.approx((0.5 * (last + end), end - last))
        on, before = (sum(until - since for since, until, _ in history.on) for history in (held, as_simulated))
        assert abs(on - before) == pytest.approx(0.5 * (end - last))


def test_with_a_status_all_the_time_nothing_is_held(problem, centre):
    window = sampled_windows(problem)[1]
    assert held_by(window, problem.at(window, centre[None])[0]) is None


def test_a_status_drives_the_heater_that_it_observes_and_has_no_likelihood_beside_heat(tmp_path):
    content, data = written(windows=1), small.closed_loop(tmp_path)[1]
    driven = build_problem(small.load(tmp_path, content)[0], data)
    del content["simulator"]["heaters"]["heater"]["measured_by"]
    content["observations"]["heater_status"]["likelihood"] = {"switch_times": {}}
    problem = build_problem(small.load(tmp_path, content)[0], data)
    assert problem.names == driven.names
    (window,), (expected,) = sampled_windows(problem), sampled_windows(driven)
    theta = problem.at(window, problem.priors.median())
    np.testing.assert_array_equal(window.simulate(theta).temperatures, expected.simulate(theta).temperatures)
    assert window.unmeasured == ()
    content["heat"] = "none"
    assert "timing.heater_status" in build_problem(small.load(tmp_path, content)[0], data).names


def without_a_status(folder, **parameters):
    content = written(windows=1)
    del content["simulator"]["heaters"]["heater"]["measured_by"], content["observations"]["heater_status"]
    content["parameters"] |= parameters
    data = small.closed_loop(folder)[1]
    return build_problem(small.load(folder, content)[0], data)


def test_a_heater_without_a_status_is_held_all_the_time(tmp_path):
    problem = without_a_status(tmp_path)
    (window,) = sampled_windows(problem)
    assert window is not problem.windows[0]
    theta = problem.at(window, problem.priors.median())
    held = held_by(window, theta)
    assert held.gaps == ((0.0, float(window.network.drive.times[-1]), 0),)
    found = hold(window, held)
    expected = problem.windows[0].simulate(theta)
    np.testing.assert_allclose(found.simulate(theta).temperatures, expected.temperatures, atol=2e-3)
    np.testing.assert_array_equal(found.status, expected.status)
    other = hold(window, with_other(held, 0, [(600.0, 1200.0)], {600.0: 120.0, 1200.0: 120.0}))
    assert other.simulate(theta).duty_cycle[0] * window.network.drive.times[-1] == pytest.approx(600.0)
    assert other.switching.interval.tolist() == [120.0, 120.0]


def test_thermostats_act_where_their_thresholds_are_to_be_found_and_nothing_else_tells_these(tmp_path):
    lower = {
        "sets": "heaters.heater.on_below",
        "prior": {"normal": {"mean": "10 degC", "standard_deviation": "1 K"}},
    }
    problem = without_a_status(tmp_path, lower=lower)
    assert sampled_windows(problem) is problem.windows


def test_a_switch_in_a_long_gap_of_the_status_is_that_which_is_held_alone(tmp_path):
    problem = problem_of(tmp_path, written(windows=1))
    (window,) = sampled_windows(problem)
    status = window.status[:, 0]
    # Ten minutes, which the heater leaves otherwise than it enters them.
    known = [k for k in range(5, len(status) - 15) if np.isfinite(status[k : k + 11]).all()]
    begin = next(k for k in known if status[k] != status[k + 10])
    scenario, data = small.closed_loop(tmp_path, written(windows=1))
    data["heater_status"].values[begin + 1 : begin + 10] = np.nan
    (gapped,) = sampled_windows(build_problem(scenario, data))
    inside = (gapped.switching.time > 60.0 * begin) & (gapped.switching.time < 60.0 * (begin + 10))
    assert not inside.any()
