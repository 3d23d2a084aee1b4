"""The likelihood of heaters' status against enumeration, simulation, scipy and differences."""

import math

import numpy as np
import pytest
from scipy import stats

from flightcal.probability.kernels.switching import (
    BAND,
    NO_STATUS,
    DutyCycles,
    StatusCall,
    StatusSamples,
    status_work,
    switching,
)

TIMES = np.delete(np.arange(0.0, 1200.0, 60.0), [9, 10])
"""One gap, in which nothing switches."""
ON = ((TIMES > 205.0) & (TIMES < 470.0)) | (TIMES > 800.0)
CASES = {
    "as measured": ([205.0, 470.0, 800.0], 10.0),
    "a long error of timing": ([205.0, 470.0, 800.0], 150.0),
    "a pulse too short": ([205.0, 250.0, 800.0], 25.0),
    "a pulse too many": ([240.0, 300.0, 420.0, 500.0, 810.0], 25.0),
    "one in the gap": ([215.0, 571.0, 790.0], 25.0),
    "one too few": ([230.0], 40.0),
}
ERROR = 0.02


def sampled(times, on):
    samples = StatusSamples(np.array([0]), np.array([0]), np.array([0, len(times)]), times, on * 1.0)
    return NO_STATUS._replace(samples=samples)


def run(data, work, times, heaters, ons, status):
    """Value, and derivatives by switches; those by settings are in `work`."""
    # Room for one more switch than there are.
    room = [np.append(part, np.nan) for part in (times, ons)]
    bar, value = np.full(len(times) + 1, np.nan), np.empty(1)
    call = StatusCall(data, work, np.array([len(times)]), room[0], np.append(heaters, 0), room[1], status, bar, value)
    assert switching(call) == 0
    assert np.isnan(bar[-1])
    return float(value[0]), bar[:-1]


def evaluate(data, switches, settings, initial=0.0):
    """Value, and derivatives by switches and settings."""
    switches = np.asarray(switches, float)
    work = status_work(data, len(settings), len(switches))
    work.settings[:] = settings
    ons = np.where(np.arange(len(switches)) % 2 == 0, 1.0 - initial, initial)
    heaters = np.zeros(len(switches), np.int64)
    value, bar = run(data, work, switches, heaters, ons, np.full((1, 1), initial))
    return value, bar, work.settings_bar.copy()


@pytest.mark.parametrize("tau", [5.0, 30.0, 200.0])
@pytest.mark.parametrize("switch", [10.0, 205.0, 560.0, 1190.0])
def test_one_switch_is_between_samples_with_the_chance_of_its_error_of_timing(switch, tau):
    """Summed over the intervals in which it may have happened; a sample that disagrees is an error."""
    on = TIMES > 300.0
    edges = np.concatenate([[-np.inf], TIMES, [np.inf]])
    chance = np.diff(stats.norm(switch, tau).cdf(edges))
    wrong = [np.sum((np.arange(len(TIMES)) >= k) != on) for k in range(len(chance))]
    expected = sum(p * ERROR**w * (1 - ERROR) ** (len(TIMES) - w) for p, w in zip(chance, wrong, strict=True))
    assert evaluate(sampled(TIMES, on), [switch], [tau, ERROR])[0] == pytest.approx(np.log(expected), rel=1e-9)


def test_far_from_the_measured_switch_it_keeps_its_precision():
    """Seven standard deviations off, and wrong samples rarer still: the interval's chance is a difference of tails."""
    times, on = np.array([0.0, 60.0, 120.0]), np.array([0.0, 0.0, 1.0])
    for switch, tail in ((190.0, stats.norm.sf([-7.0, -13.0])), (-10.0, stats.norm.sf([13.0, 7.0]))):
        expected = np.log(tail[1] - tail[0] if switch < 0 else stats.norm.cdf(-7.0) - stats.norm.cdf(-13.0))
        found = evaluate(sampled(times, on), [switch], [10.0, 1e-30])[0]
        assert found == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("switches", "tau"), CASES.values(), ids=CASES.keys())
def test_the_value_is_the_sum_over_all_ways_in_which_switches_lie_between_samples(switches, tau):
    """By enumeration: each switch has an interval of its own, and has happened when those before it have too."""
    edges = np.concatenate([[-np.inf], TIMES, [np.inf]])
    places = np.meshgrid(*[np.arange(len(edges) - 1)] * len(switches), indexing="ij", sparse=True)
    likelihood = 1.0
    for switch, place in zip(switches, places, strict=True):
        likelihood = likelihood * np.diff(stats.norm(switch, tau).cdf(edges))[place]
    for sample, on in enumerate(ON):
        odd, all_before = False, True
        for place in places:
            all_before = all_before & (place <= sample)
            odd = odd ^ all_before
        likelihood *= np.where(odd == on, 1 - ERROR, ERROR)
    value = evaluate(sampled(TIMES, ON), switches, [tau, ERROR])[0]
    assert value == pytest.approx(np.log(likelihood.sum()), rel=1e-10)


@pytest.mark.parametrize(("switches", "tau"), CASES.values(), ids=CASES.keys())
def test_the_derivatives_agree_with_differences(switches, tau):
    data = sampled(TIMES, ON)
    _, by_time, by_setting = evaluate(data, switches, [tau, ERROR])

    def moved(k, step):
        point = np.array([*switches, tau, ERROR])
        point[k] += step
        return evaluate(data, point[:-2], point[-2:])[0]

    for k, found in enumerate([*by_time, *by_setting]):
        step = 1e-6 if k == len(switches) + 1 else 1e-3
        expected = (moved(k, step) - moved(k, -step)) / (2 * step)
        assert found == pytest.approx(expected, rel=1e-6, abs=1e-8)


def test_a_heater_that_never_switches_costs_an_error_for_each_sample_that_disagrees():
    wrong = ON.sum()
    expected = wrong * np.log(ERROR) + (len(ON) - wrong) * np.log(1 - ERROR)
    assert evaluate(sampled(TIMES, ON), [], [10.0, ERROR])[0] == pytest.approx(expected, rel=1e-12)
    expected = wrong * np.log(1 - ERROR) + (len(ON) - wrong) * np.log(ERROR)
    assert evaluate(sampled(TIMES, ON), [], [10.0, ERROR], initial=1.0)[0] == pytest.approx(expected, rel=1e-12)


def test_a_pulse_fades_away_as_it_gets_shorter():
    """No sample sees it, so it costs nothing: nothing jumps where a simulation gains or loses two switches."""
    data = sampled(TIMES, np.zeros(len(TIMES)))
    without = evaluate(data, [], [3.0, ERROR])[0]
    values = [evaluate(data, [330.0, 330.0 + length], [3.0, ERROR])[0] for length in (1e-3, 10.0, 200.0)]
    assert values[0] == pytest.approx(without, abs=1e-9)
    assert values[0] > values[1] - 1e-9 > values[2] + 3.0


def test_it_is_smooth_where_a_switch_passes_a_sample():
    data = sampled(TIMES, ON)
    values = [evaluate(data, [s, 470.0, 800.0], [10.0, 1e-3])[0] for s in np.arange(150.0, 330.0, 0.5)]
    slopes = [evaluate(data, [s, 470.0, 800.0], [10.0, 1e-3])[1][0] for s in np.arange(150.0, 330.0, 0.5)]
    np.testing.assert_allclose(np.diff(values) / 0.5, 0.5 * (np.add(slopes[1:], slopes[:-1])), atol=2e-4)


def test_a_switch_that_is_surely_between_two_samples_may_move_and_cost_nothing():
    """More than eight standard deviations from both."""
    value, by_time, by_setting = evaluate(sampled(TIMES, ON), [210.0, 450.0, 810.0], [30.0 / 8.05, ERROR])
    assert value == sum([math.log(1 - ERROR)] * len(TIMES))
    assert not by_time.any()
    assert by_setting[0] == 0.0


def test_more_uncertain_switches_at_once_than_there_is_room_for_have_no_density():
    data = sampled(TIMES, ON)
    assert np.isfinite(evaluate(data, np.linspace(300.0, 330.0, BAND - 1), [5.0, ERROR])[0])
    assert evaluate(data, np.linspace(300.0, 330.0, BAND), [5.0, ERROR])[0] == -np.inf


def test_switches_long_before_the_first_sample_need_no_room():
    """An even number of them, more than there is room for, which leaves the heater as it was."""
    early, late = np.linspace(0.0, 1000.0, BAND + 8), 3000.0 + np.array([205.0, 470.0, 800.0])
    data = sampled(3000.0 + TIMES, ON)
    value, bar, settings_bar = evaluate(data, [*early, *late], [25.0, ERROR])
    expected = evaluate(data, late, [25.0, ERROR])
    assert value == pytest.approx(expected[0], rel=1e-12)
    np.testing.assert_allclose(bar, np.concatenate([np.zeros(len(early)), expected[1]]), rtol=1e-12)
    np.testing.assert_allclose(settings_bar, expected[2], rtol=1e-12)


def test_channels_and_heaters_are_told_apart():
    """Two heaters, of which one is seen by two channels: the values add, and each switch gets its own derivative."""
    single = [sampled(TIMES, ON), sampled(TIMES, TIMES > 300.0)]
    samples = StatusSamples(
        np.array([1, 0, 1]), np.array([2, 0, 4]), np.array([0, 18, 36, 54]),
        np.tile(TIMES, 3), np.concatenate([ON, TIMES > 300.0, ON]) * 1.0,
    )  # fmt: skip
    data = NO_STATUS._replace(samples=samples)
    times = np.array([205.0, 310.0, 470.0, 800.0])
    heaters, ons = np.array([1, 0, 1, 1]), np.array([1.0, 1.0, 0.0, 1.0])
    work = status_work(data, 6, 4)
    work.settings[:] = [20.0, 0.01, 10.0, 0.02, 15.0, 0.03]
    value, bar = run(data, work, times, heaters, ons, np.zeros((1, 2)))
    first = evaluate(single[0], times[[0, 2, 3]], [10.0, 0.02])
    again = evaluate(single[0], times[[0, 2, 3]], [15.0, 0.03])
    other = evaluate(single[1], times[[1]], [20.0, 0.01])
    assert value == pytest.approx(first[0] + again[0] + other[0], rel=1e-12)
    np.testing.assert_allclose(bar, np.insert(first[1] + again[1], 1, other[1]))
    np.testing.assert_allclose(work.settings_bar, np.concatenate([other[2], first[2], again[2]]))


def test_of_channels_with_the_same_settings_the_derivatives_add_up():
    samples = StatusSamples(
        np.array([0, 0]), np.array([0, 0]), np.array([0, 18, 36]), np.tile(TIMES, 2), np.tile(ON, 2) * 1.0
    )  # fmt: skip
    once = evaluate(sampled(TIMES, ON), [200.0, 471.0, 790.0], [20.0, ERROR])
    twice = evaluate(NO_STATUS._replace(samples=samples), [200.0, 471.0, 790.0], [20.0, ERROR])
    for one, two in zip(once, twice, strict=True):
        np.testing.assert_allclose(two, 2.0 * one, rtol=1e-12)


SPANS = ([0.0, 500.0], [300.0, 1100.0])  # s, begin and end


@pytest.mark.parametrize("initial", [0.0, 1.0])
def test_a_duty_cycle_is_normal_around_the_simulated_share_of_the_known_time(initial):
    switches = np.array([120.0, 290.0, 410.0, 470.0, 620.0, 1300.0])
    duties = DutyCycles(np.array([0]), np.array([0]), np.array([0, 2]), *map(np.array, SPANS), np.array([0.4]))
    data = NO_STATUS._replace(duties=duties)
    value, by_time, by_setting = evaluate(data, switches, [0.05], initial)
    fine = np.arange(0.5, 1400.0, 1.0)
    known = np.any([(fine > begin) & (fine < end) for begin, end in zip(*SPANS, strict=True)], axis=0)
    on = (np.searchsorted(switches, fine) + initial) % 2
    assert value == pytest.approx(stats.norm(on[known].mean(), 0.05).logpdf(0.4), rel=1e-9)
    for k in range(len(switches)):
        step = np.zeros(len(switches))
        step[k] = 1e-3
        above, below = (evaluate(data, switches + sign * step, [0.05], initial)[0] for sign in (1, -1))
        assert by_time[k] == pytest.approx((above - below) / 2e-3, rel=1e-6, abs=1e-12)
    assert by_time[2] == 0.0, "in the time that is not known"
    above, below = (evaluate(data, switches, [0.05 + step], initial)[0] for step in (1e-6, -1e-6))
    assert by_setting[0] == pytest.approx((above - below) / 2e-6, rel=1e-6)
