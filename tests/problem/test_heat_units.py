"""Unit heats, and what temperatures do under them."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from flightcal.probability import Profile, Slow
from flightcal.problem import (
    SLOW,
    build_problem,
    errors_of_weights,
    heat_of_weights,
    heat_units,
    patterns_of,
    places_of,
    responses,
    sampled_windows,
    split,
    unit_heats,
)
from flightcal.problem.heat_model import Gain, own_groups
from flightcal.simulator import SimulationFailure
from tests import small
from tests.problem.heated import HARMONICS, by_group, in_place_of_another, model_of, problem_of, written


def energy(window, series):
    """J of heat [..., 2 K]."""
    steps = np.diff(window.network.drive.times)
    return series.reshape(*series.shape[:-1], -1, 2).mean(axis=-1) @ steps


def test_over_an_orbit_a_patterns_harmonics_add_nothing_to_the_constant(problem, model):
    window = sampled_windows(problem)[0]
    assert window.network.drive.times[-1] == small.PERIOD
    units = unit_heats(model, window)
    for group_units in by_group(model, units, "constant"):
        np.testing.assert_allclose(group_units.series, 1.0, rtol=1e-12)
        assert len(group_units.series) == 1
    for group_units in by_group(model, units, "pattern"):
        assert len(group_units.series) == 2 * HARMONICS
        # Linear between points at most 20 s apart.
        curvature = (2.0 * np.pi * HARMONICS / small.PERIOD) ** 2
        found = energy(window, group_units.series)
        np.testing.assert_allclose(found, 0.0, atol=20.0**2 / 12.0 * curvature * small.PERIOD)


def test_a_simulators_error_is_that_of_its_own_window_and_no_heat(unheated):
    problem = in_place_of_another(unheated)
    model = model_of(problem)
    for window in problem.windows:
        units = unit_heats(model, window)
        theta = problem.at(window, problem.priors.median()[None])[0]
        found = zip(model.groups, units, responses(window, theta, model, units), strict=True)
        errors = [(group, group_units, response) for group, group_units, response in found if group.part == "error"]
        assert [group.window for group, *_ in errors] == ["train.first", "train.second"]
        simulator = window.simulator
        for group, error_units, response in errors:
            assert not error_units.series.any()
            if group.window == window.name:
                expected = simulator.error_basis * np.sqrt(simulator.error_variance)
                np.testing.assert_allclose(response, expected, rtol=1e-12)
            else:
                assert response.shape[2] == 0
        weights = [np.ones(len(group_units.node)) for group_units in units]
        expected = (simulator.error_basis * np.sqrt(simulator.error_variance)).sum(axis=2)
        np.testing.assert_allclose(errors_of_weights(units, weights), expected, rtol=1e-12)
        alone = [
            np.zeros(len(group_units.node)) if group_units.error is None else np.ones(len(group_units.node))
            for group_units in units
        ]
        assert not heat_of_weights(model, units, alone).any()


def test_a_pattern_is_the_same_at_the_same_phase_of_every_window(problem, model):
    phase = np.linspace(3700.0, 5300.0, 30)
    found = []
    for window, start in zip(sampled_windows(problem), (0.0, 9000.0), strict=True):
        series = by_group(model, unit_heats(model, window), "pattern")[0].series
        middle = start + 0.5 * (window.network.drive.times[1:] + window.network.drive.times[:-1])
        order = np.argsort(middle % small.PERIOD)
        means = series.reshape(len(series), -1, 2).mean(axis=2)[:, order]
        found.append([np.interp(phase, (middle % small.PERIOD)[order], mean) for mean in means])
    np.testing.assert_allclose(found[0], found[1], rtol=0.0, atol=1e-3)


def test_the_gain_of_a_load_is_the_heat_of_that_load(problem, model):
    window = sampled_windows(problem)[1]
    (gain_units,) = by_group(model, unit_heats(model, window), "gains")
    drive = window.network.drive
    amperes = drive.series[window.network.network.columns.index("driver.sun")]
    theta = problem.at(window, problem.priors.median()[None])[0]
    coefficient = 12.0 * theta[window.names.index("panel_size")]
    assert gain_units.node.tolist() == [1]
    np.testing.assert_allclose(gain_units.series[0], coefficient * amperes, rtol=1e-12)


def test_a_gain_does_what_a_larger_coefficient_does(problem, model, centre):
    window = sampled_windows(problem)[0]
    theta = problem.at(window, problem.priors.median()[None])[0]
    (gain_units,) = by_group(model, unit_heats(model, window), "gains")
    heat = np.zeros((2, gain_units.series.shape[1]))
    heat[1] = 0.1 * gain_units.series[0]
    simulator, mapping = window.network, window.network.mapping
    numbers = mapping.written.copy()
    numbers[simulator.network.position("loads.sun.coefficient")] *= 1.1
    expected = replace(simulator, mapping=mapping._replace(written=numbers)).simulate(theta[window.simulated])
    found = simulator.with_heat(heat).simulate(theta[window.simulated])
    np.testing.assert_allclose(found.temperatures, expected.temperatures, rtol=0.0, atol=1e-8)


def test_a_switch_is_uncertain_by_its_heaters_power_over_a_sampling_interval(problem, model):
    windows = sampled_windows(problem)
    for window, other in zip(windows, reversed(windows), strict=True):
        units = dict(
            zip([group.window or group.scale for group in model.groups], unit_heats(model, window), strict=True)
        )
        switching, switch_units = window.switching, units[window.name]
        assert len(switching.time) > 4
        assert len(switch_units.node) == len(switching.time)
        np.testing.assert_allclose(
            energy(window, switch_units.series), 30.0 * switching.interval / np.sqrt(12.0), rtol=1e-9
        )
        assert set(switch_units.node) == {model.nodes.index("body")}
        assert not len(units[other.name].node)


def over_the_sun(folder):
    """A problem whose pattern is over the Sun sensor's current."""
    return problem_of(folder, written(heat={"pattern": {"over": "sun"}}))


def test_a_pattern_over_a_driver_is_the_same_at_the_same_value_of_it_and_of_no_other_time(tmp_path):
    problem = over_the_sun(tmp_path)
    model = model_of(problem)
    found, current = [], []
    for window in sampled_windows(problem):
        (pattern_units, _) = by_group(model, unit_heats(model, window), "pattern")
        weights = np.random.default_rng(1).standard_normal(len(pattern_units.node))
        drive = window.network.drive
        found.append((weights @ pattern_units.series).reshape(-1, 2))
        current.append(
            np.stack([drive.inputs[:, k, window.network.network.columns.index("driver.sun")] for k in (0, 1)], axis=1)
        )
    heat, amperes = np.concatenate(found), np.concatenate(current)
    # In shadow the current is zero: one heat, whatever the time.
    dark = amperes.max(axis=1) == 0.0
    assert dark.sum() > 20
    assert np.ptp(heat[dark]) < 1e-9
    assert np.ptp(heat[~dark]) > 0.1


def test_a_profile_is_a_smooth_process_that_goes_back_to_its_prior_beyond_a_length():
    profile = Profile(np.linspace(0.0, 10.0, 101), 2.0, (0.0, 10.0))
    draws = np.random.default_rng(0).standard_normal((4000, 101)) @ profile.at(np.array([1.0, 1.1, 3.0, 9.0]))
    correlation = np.corrcoef(draws.T)
    # Of 4000 draws a correlation is known to 0.016, a deviation to 1.1%.
    np.testing.assert_allclose(draws.std(axis=0), 1.0, atol=0.05)
    x = np.sqrt(3.0) * np.array([0.05, 1.0, 4.0])
    np.testing.assert_allclose(correlation[0, 1:], (1.0 + x) * np.exp(-x), atol=0.07)


def test_patterns_over_a_driver_are_over_its_range(tmp_path):
    problem = over_the_sun(tmp_path)
    model = model_of(problem)
    assert model.profile.range == (0.0, pytest.approx(1.0, abs=1e-3))
    # Three lengths beyond, each a fifth of the range.
    assert (model.profile.knots[0], model.profile.knots[-1]) == (
        pytest.approx(-0.6, abs=2e-3),
        pytest.approx(1.6, abs=2e-3),
    )
    kept = tuple(np.eye(len(group_units.node)) for group_units in unit_heats(model, sampled_windows(problem)[0]))
    looked = replace(model, kept=kept)
    weights = np.random.default_rng(2).standard_normal((1, sum(basis.shape[1] for basis in kept)))
    places = places_of(model, 3)
    whole = patterns_of(looked, weights, places)
    groups = dict(zip([group.scale for group in model.groups], split(looked, weights), strict=True))
    constant, functions = groups["heat.panel.constant"][0], groups["heat.panel.pattern"][0]
    expected = constant[0] + functions @ model.profile.at(places[1:2])[:, 0]
    assert whole[0, model.nodes.index("panel"), 1] == pytest.approx(expected)


def with_gap(folder, content, first, last):
    """The problem with the Sun sensor's samples from minute `first` to `last` missing, and how much it varies, A."""
    scenario, data = small.closed_loop(folder, content)
    data["sun"].values[first : last + 1] = np.nan
    return build_problem(scenario, data), float(np.nanstd(data["sun"].values))


def test_a_gap_in_a_driver_is_unknown_heat_of_its_load_while_it_lasts(tmp_path):
    # From 01:41 to 02:39 in shadow and sunlight; "first" has ended at 01:30, "second" begins at 02:30.
    for (first, last), window, seconds in (((20, 45), 0, 27 * 60), ((101, 159), 1, 10 * 60)):
        folder = tmp_path / str(first)
        folder.mkdir()
        content = written()
        content["telemetry"]["channels"]["sun"]["fill"] = "previous_orbit"
        problem, deviation = with_gap(folder, content, first, last)
        model = model_of(problem)
        windows = sampled_windows(problem)
        (gap_units,) = by_group(model, unit_heats(model, windows[window]), "gaps")
        theta = problem.at(windows[window], problem.priors.median()[None])[0]
        coefficient = 12.0 * theta[windows[window].names.index("panel_size")]
        pieces = max(1, round(seconds / 600.0))
        assert gap_units.node.tolist() == [model.nodes.index("panel")] * pieces
        np.testing.assert_allclose(
            energy(windows[window], gap_units.series), coefficient * deviation * seconds / pieces, rtol=1e-9
        )
        (other,) = by_group(model, unit_heats(model, windows[1 - window]), "gaps")
        assert not len(other.node)


def test_a_driver_without_a_gap_leaves_no_heat_unknown(model):
    assert not any(group.part == "gaps" for group in model.groups)


def test_a_jump_of_a_driver_is_unknown_heat_between_its_samples(tmp_path):
    scenario, data = small.closed_loop(tmp_path, written(windows=1))
    minutes = np.arange(data.sizes["time"])
    # Beyond the window's end there is another one.
    data["sun"].values[:] = np.isin(minutes // 35, (1, 3, 5, 7))
    problem = build_problem(scenario, data)
    model, window = model_of(problem), sampled_windows(problem)[0]
    (gap_units,) = by_group(model, unit_heats(model, window), "gaps")
    inside = [minute for minute in range(35, len(minutes), 35) if 60.0 * minute <= window.network.drive.times[-1]]
    coefficient = 12.0 * problem.at(window, problem.priors.median()[None])[0][window.names.index("panel_size")]
    assert gap_units.node.tolist() == [model.nodes.index("panel")] * len(inside)
    np.testing.assert_allclose(energy(window, gap_units.series), coefficient * 60.0 / np.sqrt(12.0), rtol=1e-9)
    heated = window.network.drive.times[1:][(gap_units.series.reshape(len(inside), -1, 2) > 0.0).any(axis=(0, 2))]
    assert set(np.ceil(heated / 60.0).astype(int)) == set(inside)


BUSY = [Gain(0, ("mode.busy",), (12.0,))]


def with_modes(late=0.0, **more):
    """One window, without a heater: a busy mode from 00:40 to 01:05, or as many seconds later."""
    content = written(heaters=False, windows=1, **more)
    milliseconds = (1e3 * np.array([0.0, 2400.0 + late, 3900.0 + late])).astype("timedelta64[ms]")
    changes = np.datetime64("2024-03-01T00:00:00.000") + milliseconds
    content["simulator"] |= {
        "modes": {"quiet": {"body": "9 W", "panel": "2 W"}, "busy": {"body": "21 W"}},
        "timeline": [
            {"at": str(at), "mode": mode} for at, mode in zip(changes, ("quiet", "busy", "quiet"), strict=True)
        ],
    }
    return content


def test_a_change_of_mode_is_as_uncertain_as_time_tags(tmp_path):
    def simulated(late):
        folder = tmp_path / f"{late:g}"
        folder.mkdir()
        problem = problem_of(folder, with_modes(late, time_error="4 s"))
        return problem, problem.windows[0].simulate(theta_of(problem)).temperatures

    def theta_of(problem):
        return problem.at(problem.windows[0], problem.priors.median()[None])[0]

    problem, _ = simulated(0.0)
    model, window = model_of(problem), sampled_windows(problem)[0]
    units = unit_heats(model, window)
    (change_units,) = by_group(model, units, "changes")
    # 12 W more into the body and 2 W less into the panel, for four seconds; and the other way round.
    body, panel = (model.nodes.index(name) for name in ("body", "panel"))
    moved = change_units.share * energy(window, change_units.series)[:, None]
    np.testing.assert_allclose(moved[:, [body, panel]], [[48.0, -8.0], [-48.0, 8.0]], rtol=1e-9)
    (response,) = by_group(model, responses(window, theta_of(problem), model, units), "changes")
    expected = 0.5 * (simulated(-4.0)[1] - simulated(4.0)[1])
    seconds = (window.times - window.start) / np.timedelta64(1, "s")
    settled = np.abs(seconds[:, None] - [2400.0, 3900.0]).min(axis=1) > 120.0
    found = response.sum(axis=2)
    assert np.abs(expected).max() > 0.005
    assert np.abs(found - expected)[settled].max() < 0.03 * np.abs(expected).max()


def test_a_change_of_mode_between_two_samples_may_be_anywhere_between_them(tmp_path):
    content = with_modes(time_error="none")
    content["simulator"]["timeline"][1]["within"] = "5 min"
    problem = problem_of(tmp_path, content)
    model, window = model_of(problem), sampled_windows(problem)[0]
    (change_units,) = by_group(model, unit_heats(model, window), "changes")
    assert len(change_units.share) == 1  # the other change is known
    body, grid = model.nodes.index("body"), window.network.drive.times
    moved = change_units.series[0].reshape(-1, 2).mean(axis=1) * change_units.share[0, body]
    inside = (grid[:-1] >= 2250.0) & (grid[1:] <= 2550.0)
    np.testing.assert_allclose(moved[inside] @ np.diff(grid)[inside], 12.0 * 300.0 / np.sqrt(12.0), rtol=0.1)
    np.testing.assert_allclose(moved @ np.diff(grid), 12.0 * 300.0 / np.sqrt(12.0), rtol=1e-9)


@pytest.mark.parametrize("more", [{"time_error": "none"}, {"heat": "none"}])
def test_modes_change_when_the_scenario_says_where_time_tags_are_right(tmp_path, more):
    problem = problem_of(tmp_path, with_modes(**more))
    window = sampled_windows(problem)[0]
    assert len(window.changes) == 2
    assert own_groups(window, BUSY) == ()


def test_a_mode_that_goes_on_is_no_change(tmp_path):
    content = with_modes()
    content["simulator"]["timeline"][1]["mode"] = "quiet"
    (window,) = sampled_windows(problem_of(tmp_path, content))
    assert window.changes == ()


def test_a_change_between_modes_of_the_same_heat_or_of_other_nodes_is_none(tmp_path):
    window = sampled_windows(problem_of(tmp_path, with_modes()))[0]
    assert [group.part for group in own_groups(window, BUSY)] == ["changes"]
    assert own_groups(window, [*BUSY, Gain(0, ("mode.quiet",), (12.0,))]) == ()
    assert own_groups(window, []) == ()


def test_heat_drifts_and_the_constant_and_each_harmonic_of_a_pattern_wander(problem, model):
    window = sampled_windows(problem)[0]
    units, count = unit_heats(model, window), len(model.slow.knots)
    drift, around = (by_group(model, units, part)[1].series for part in SLOW)
    assert (len(drift), len(around)) == (count, (1 + 2 * HARMONICS) * count)
    drift = drift.reshape(count, -1, 2).mean(axis=2)
    constant, cosine, sine, *_ = around.reshape(1 + 2 * HARMONICS, count, -1, 2).mean(axis=3) / model.of_pattern
    middle = 0.5 * (window.network.drive.times[1:] + window.network.drive.times[:-1])
    process = Slow(model.slow.knots, model.slow.time).at(middle)
    np.testing.assert_allclose(drift, process, atol=1e-6)
    np.testing.assert_allclose(constant, process, atol=1e-6)
    np.testing.assert_allclose(np.hypot(cosine, sine)[0], np.abs(process[0]), atol=1e-4)
    angle = 2.0 * np.pi * middle / small.PERIOD
    shift = np.arctan2(sine[0] / process[0], cosine[0] / process[0])
    np.testing.assert_allclose(np.angle(np.exp(1j * (shift - angle - (shift - angle)[0]))), 0.0, atol=2e-3)


def test_responses_are_what_a_little_heat_does(problem, model, centre):
    window = sampled_windows(problem)[0]
    theta = problem.at(window, centre[None])[0]
    units = unit_heats(model, window)
    found = responses(window, theta, model, units)
    rng = np.random.default_rng(0)
    weights = [
        0.02 * group.size * rng.normal(size=len(group_units.node))
        for group, group_units in zip(model.groups, units, strict=True)
    ]
    heat = heat_of_weights(model, units, weights)
    sides = [window.network.with_heat(sign * heat).simulate(theta[window.simulated]).temperatures for sign in (1, -1)]
    expected = sum(response @ of_group for response, of_group in zip(found, weights, strict=True))
    assert np.abs(expected).max() > 0.01
    # A heat's third power is left: temperatures cubed over the absolute one squared, and the nudge's.
    np.testing.assert_allclose(0.5 * (sides[0] - sides[1]), expected, rtol=0.0, atol=1e-4 * np.abs(expected).max())


def test_heat_that_has_faded_since_another_window_does_nothing(problem, model, centre):
    window = sampled_windows(problem)[0]
    theta = problem.at(window, centre[None])[0]
    units = unit_heats(model, window)
    k = next(k for k, group_units in enumerate(units) if len(group_units.series) > 1)
    series = units[k].series.copy()
    series[0] = 1e-310  # too small to divide by
    faded = [*units[:k], replace(units[k], series=series), *units[k + 1 :]]
    with warnings.catch_warnings(action="error"):
        found = responses(window, theta, model, faded)
    assert not found[k][..., 0].any()
    np.testing.assert_allclose(found[k][..., 1:], responses(window, theta, model, units)[k][..., 1:], rtol=1e-9)


def test_heat_that_changes_a_temperature_without_bound_is_a_failure(problem, model, centre, monkeypatch):
    monkeypatch.setattr(heat_units, "_MOST_CHANGED", 1e-3)
    window = sampled_windows(problem)[0]
    with pytest.raises(SimulationFailure, match=r"more than 0\.001 K"):
        responses(window, problem.at(window, centre[None])[0], model, unit_heats(model, window))
