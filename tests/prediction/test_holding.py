"""Whether intervals hold: right and wrong predictions of noise that is correlated over 20 min."""

import numpy as np
import pytest
from scipy.signal import lfilter

from flightcal.prediction import Holding, hold_together
from flightcal.prediction.holding import replicate

MINUTES = 20.0
RHO = np.exp(-1.0 / MINUTES)
"""AR(1) noise, of samples a minute apart."""


def correlated(rng, draws, samples, channels):
    """AR(1) noise of unit deviation, [S, T, N]."""
    fresh = rng.standard_normal((draws, samples, channels)) * np.sqrt(1 - RHO**2)
    fresh[:, 0] /= np.sqrt(1 - RHO**2)
    return lfilter([1.0], [1.0, -RHO], fresh, axis=1)


def replicated(observed, *prediction):
    """Of samples a minute apart."""
    return replicate(60.0 * np.arange(len(observed)), observed, *prediction)


def holds(*prediction):
    return hold_together([replicated(*prediction)])[0]


def repeats(count, width=1.0, *, draws=300, samples=380, channels=4, seed=0):
    """Share of predictions that hold, whose draws are so wide; telemetry has a deviation of one."""
    rng = np.random.default_rng(seed)
    everything = np.ones(samples, bool)
    found = []
    for _ in range(count):
        made = correlated(rng, draws + 1, samples, channels)
        found.append(holds(made[0], everything, width * made[1:], 0.95).holds)
    return np.mean(found)


def test_a_right_prediction_holds_in_99_of_100_repeats():
    count = 150
    # Too wide is no failure, so between 99% and 100%; 300 draws place the end of the band to about 0.6%.
    error = np.sqrt(0.01 * 0.99 * (1 / count + 1 / 300))
    assert repeats(count) >= 0.99 - 3 * error


def test_intervals_half_as_wide_hold_nearly_never():
    assert repeats(40, 0.5) <= 0.05


def test_intervals_twice_as_wide_hold_and_are_said_to_be_wide():
    made = correlated(np.random.default_rng(1), 301, 4000, 2)
    found = holds(made[0], np.ones(4000, bool), 2 * made[1:], 0.95)
    assert found.holds
    assert found.too_wide.all()


@pytest.mark.slow
def test_the_share_of_right_predictions_that_hold_does_not_depend_on_how_many_channels_there_are():
    for channels in (1, 12):
        error = np.sqrt(0.01 * 0.99 * (1 / 600 + 1 / 400))
        share = repeats(600, draws=400, samples=190, channels=channels)
        assert 0.99 - 3 * error <= share


def test_the_band_of_a_right_prediction_is_as_wide_as_the_docstring_says():
    made = correlated(np.random.default_rng(2), 1001, 190, 4)
    found = holds(made[0], np.ones(190, bool), made[1:], 0.95)
    # The end of the band of four channels of one prediction is known to about 3 points.
    assert found.lower.mean() == pytest.approx(0.65, abs=0.06)
    assert (found.lower < 0.9).all()


def test_coverage_is_the_share_of_scored_samples_inside_the_interval_of_all_draws():
    rng = np.random.default_rng(3)
    observed, draws = rng.standard_normal((50, 2)), rng.standard_normal((200, 50, 2))
    observed[5, 1] = np.nan
    scored = np.arange(50) >= 10
    low, high = np.quantile(draws, [0.1, 0.9], axis=0)
    inside = (low <= observed) & (observed <= high)
    found = replicated(observed, scored, draws, 0.8)
    np.testing.assert_allclose(found.coverage, inside[10:].mean(axis=0))
    assert found.replicated.shape == (200, 2)


def test_replicates_are_held_to_the_interval_of_the_other_draws():
    draws = np.random.default_rng(4).standard_normal((60, 7, 1))
    found = replicated(np.zeros((7, 1)), np.ones(7, bool), draws, 0.9)
    for s in range(60):
        low, high = np.quantile(np.delete(draws, s, axis=0), [0.05, 0.95], axis=0)
        assert found.replicated[s, 0] == pytest.approx(((low <= draws[s]) & (draws[s] <= high)).mean())


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({}, ""),
        ({"coverage": 0.5}, "below 60.0%"),
        ({"error": 3.2}, "3.2 deviations off, above 3.0"),
        ({"coverage": 0.5, "lasting": 7.0}, "7.0 deviations off for five minutes or more, above 5.0"),
        ({"coverage": np.nan, "error": np.nan, "lasting": np.nan}, ""),
        ({"lasting": np.nan}, ""),
    ],
)
def test_it_is_said_why_a_channel_does_not_hold(changed, why):
    right = {"coverage": 0.95, "lower": 0.6, "upper": 1.0, "error": 1.0, "most_error": 3.0, "lasting": 2.0}
    values = {**right, "most_lasting": 5.0, **changed}
    found = Holding(**{name: np.array([value]) for name, value in values.items()})
    assert found.why(0) == why
    assert (found.room[0] < 0.0) == bool(why)


def test_the_worst_channel_is_the_one_furthest_below_its_band():
    made = correlated(np.random.default_rng(5), 301, 400, 3)
    observed = made[0] + np.array([0.0, 4.0, 0.0])
    found = holds(observed, np.ones(400, bool), made[1:], 0.95)
    assert not found.holds
    assert found.worst == 1
    assert found.coverage[1] < found.lower[1]


def test_a_window_that_lies_farther_off_than_any_draw_does_not_hold_even_if_its_coverage_may_be_nothing():
    rng = np.random.default_rng(8)
    # Errors that last for the whole window: one draw in twenty has no sample inside.
    draws = rng.standard_normal((1000, 1, 2)) + 0.1 * rng.standard_normal((1000, 100, 2))
    for off, held in ((2.2, True), (8.0, False)):
        found = holds(np.full((100, 2), [0.0, off]), np.ones(100, bool), draws, 0.95)
        assert found.coverage[1] == 0.0
        assert found.lower[1] == 0.0
        assert found.holds == held
        assert found.worst == 1
        assert found.error[1] == pytest.approx(off, rel=0.1)
        assert 2.4 < found.most_error[1] < 4.5


@pytest.mark.parametrize(("samples", "held"), [(0, True), (1, True), (4, True), (8, False)])
def test_an_error_that_lasts_for_minutes_does_not_hold_and_a_spike_does(samples, held):
    rng = np.random.default_rng(10)
    # Slow errors, beside which neither coverage nor the error of all samples notices ten minutes.
    draws = rng.standard_normal((1001, 1, 2)) + 0.1 * rng.standard_normal((1001, 600, 2))
    observed, draws = draws[0].copy(), draws[1:]
    observed[200 : 200 + samples, 1] += 15.0
    found = holds(observed, np.ones(600, bool), draws, 0.95)
    assert found.coverage[1] > found.lower[1]
    assert found.error[1] < found.most_error[1]
    assert found.holds == held
    assert found.holds or found.worst == 1


def test_an_error_lasts_for_five_samples_or_five_minutes():
    observed = np.zeros((100, 1))
    observed[40:52] = np.linspace(4.0, 9.0, 12)[:, None]
    draws = np.random.default_rng(11).standard_normal((500, 100, 1))
    z = np.abs(observed - draws.mean(axis=0)) / draws.std(axis=0, ddof=1)
    for step, count in ((300.0, 5), (60.0, 5), (30.0, 10), (10.0, 30)):
        found = replicate(step * np.arange(100), observed, np.ones(100, bool), draws, 0.95)
        expected = max(z[k : k + count].min() for k in range(100 - count))
        assert found.lasting == pytest.approx(expected)
    few = replicate(np.arange(4.0), observed[:4], np.ones(4, bool), draws[:, :4], 0.95)
    assert np.isnan(few.lasting).all()
    assert np.isfinite(hold_together([few])[0].room).all()


def test_errors_of_replicates_are_in_deviations_of_the_other_draws():
    draws = np.random.default_rng(9).standard_normal((60, 7, 1))
    found = replicated(np.zeros((7, 1)), np.ones(7, bool), draws, 0.9)
    for s in range(60):
        others = np.delete(draws, s, axis=0)
        z = (draws[s] - others.mean(axis=0)) / others.std(axis=0, ddof=1)
        assert found.replicated_error[s, 0] == pytest.approx(np.sqrt(np.mean(z**2)))


def test_a_channel_without_samples_says_nothing():
    made = correlated(np.random.default_rng(6), 301, 400, 2)
    made[0, :, 1] = np.nan
    found = holds(made[0], np.ones(400, bool), made[1:], 0.95)
    assert found.holds
    assert np.isnan([found.coverage[1], found.lower[1], found.upper[1]]).all()
    nothing = holds(np.full((400, 2), np.nan), np.ones(400, bool), made[1:], 0.95)
    assert nothing.holds
    assert nothing.worst == -1


def test_windows_judged_together_have_wider_bands_than_one_alone():
    rng = np.random.default_rng(7)
    everything = np.ones(300, bool)
    windows = []
    for _ in range(6):
        made = correlated(rng, 301, 300, 2)
        windows.append(replicated(made[0], everything, made[1:], 0.95))
    alone = [hold_together([window])[0].lower.mean() for window in windows]
    together = [found.lower.mean() for found in hold_together(windows)]
    assert np.mean(together) < np.mean(alone)
    assert len(together) == 6
