"""Heaters whose status is not known all the time."""

from dataclasses import replace

import numpy as np
import pytest

from flightcal.problem import held_by, hold, sampled_windows


def test_held_heaters_do_what_they_did_where_the_status_is_not_known(problem, centre):
    window = sampled_windows(problem)[0]
    assert np.isnan(window.network.drive.measured).any()
    theta = problem.at(window, centre[None])[0]
    held = held_by(window, theta)
    found = hold(window, held)
    assert not np.isnan(found.network.drive.measured).any()
    run, expected = found.simulate(theta), window.simulate(theta)
    # Within a step a share of the power stands for a switch.
    step, power, capacity = 30.0, 30.0, 3000.0
    assert np.abs(run.temperatures - expected.temperatures).max() < 0.25 * step * power / capacity
    np.testing.assert_allclose(run.duty_cycle, expected.duty_cycle, atol=1e-9)
    assert len(found.switching.time) == len(window.switching.time) + len(held.switches)


def test_a_heater_that_leaves_a_gap_otherwise_than_simulated_has_switched_once_more_in_it(problem, centre):
    window = sampled_windows(problem)[0]
    theta = problem.at(window, centre[None])[0]
    simulator, drive = window.network, window.network.drive
    as_simulated = held_by(window, theta)
    gap = np.array([step for step, _, _ in as_simulated.shares])
    begin, end = drive.times[gap[0]], drive.times[gap[-1] + 1]
    for after in (0.0, 1.0):
        measured = drive.measured.copy()
        measured[gap[-1] + 1 : gap[-1] + 5, 0] = after
        told = replace(window, simulator=replace(simulator, drive=replace(drive, measured=measured)))
        held = held_by(told, theta)
        assert held.shares[-1][2] == pytest.approx(after)
        if after == as_simulated.shares[-1][2]:
            assert held == as_simulated
            continue
        assert len(held.switches) == len(as_simulated.switches) + 1
        time, _, within = held.switches[-1]
        last = max((time for time, _, _ in as_simulated.switches), default=begin)
        # Anywhere between the last switch and the end, of which that is mean and width.
        assert (time, within) == pytest.approx((0.5 * (last + end), end - last))
        on = sum(share * (drive.times[step + 1] - drive.times[step]) for step, _, share in held.shares)
        before = sum(share * (drive.times[step + 1] - drive.times[step]) for step, _, share in as_simulated.shares)
        assert abs(on - before) == pytest.approx(0.5 * (end - last))


def test_with_a_status_all_the_time_nothing_is_held(problem, centre):
    window = sampled_windows(problem)[1]
    assert held_by(window, problem.at(window, centre[None])[0]) is None
