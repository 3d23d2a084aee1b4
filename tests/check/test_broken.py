"""Sensors that are broken by their own telemetry alone."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter
from ruamel.yaml import YAML

from flightcal.check.broken import broken, stuck_throughout
from flightcal.scenario import load_scenario
from flightcal.scenario.telemetry import Span
from flightcal.telemetry import read

EXAMPLES = Path(__file__).parents[2] / "examples"

TIMES = np.datetime64("2024-03-01T00:00:00", "ns") + np.arange(200) * np.timedelta64(60, "s")
MODELLED = 290.0 + 8.0 * np.sin(np.arange(200) / 16.0)
"""K, what a simulator has."""


def telemetry(*, step=0.1, noise=0.1, seed=0):
    return np.round((MODELLED + noise * np.random.default_rng(seed).standard_normal(200)) / step) * step


def found(values, modelled=MODELLED):
    return broken("body_temp", TIMES, values, modelled)


@pytest.mark.parametrize("seed", range(5))
def test_a_sound_sensor_is_not_broken(seed):
    assert found(telemetry(seed=seed)) is None


def test_a_sensor_that_shows_one_number_in_all_of_another_window_is_stuck():
    flat = np.full(200, 290.0)
    flat[50] = np.nan
    found = stuck_throughout("body_temp", TIMES, flat, telemetry())
    assert (found.suspicion.kind, found.useless.sum()) == ("stuck", 199)
    assert "in all 199 samples" in found.suspicion.sentence
    assert stuck_throughout("body_temp", TIMES, telemetry(seed=1), telemetry()) is None
    # A node that hardly moves, or is seen too seldom, rests.
    assert stuck_throughout("body_temp", TIMES, flat, 290.0 + 0.05 * (telemetry() - 290.0)) is None
    assert stuck_throughout("body_temp", TIMES[:90], flat[:90], telemetry()) is None
    half = np.append(telemetry()[:100], np.full(100, 290.0))
    assert stuck_throughout("body_temp", TIMES, flat, half) is None


def test_a_coarse_sensor_without_noise_is_not_broken():
    assert found(telemetry(step=0.5, noise=0.0)) is None


def test_a_sensor_of_steps_of_2_k_is_not_stuck_within_one_of_them():
    minutes = np.arange(200)
    shadow = -12.0 * (1.0 - np.exp(-(minutes - 150) / 12.0))
    modelled = 290.0 + np.where(minutes < 150, 0.85 * np.sin(2 * np.pi * minutes / 90.0), shadow)
    assert found(np.round(modelled / 2.0) * 2.0, modelled) is None


def test_no_sensor_of_the_bundled_satellite_is_broken():
    scenario = load_scenario(EXAMPLES / "leo_observer" / "scenario.yaml")
    data = read(scenario)
    times = data["time"].to_numpy()
    for channel in (name for name in scenario.observations if name.endswith("temperature")):
        # With all gaps in it, and orbits that come again in steps of 0.125 K.
        for first in range(0, len(times) - 200, 100):
            for part in (slice(first, first + 200), slice(first, None)):
                values = data[channel].to_numpy()[part]
                assert broken(channel, times[part], values, np.full(len(values), np.nan)) is None


def test_a_thermostats_cycle_is_no_repetition():
    cycle = np.resize(np.concatenate([np.linspace(290.0, 293.0, 5), np.linspace(293.0, 290.0, 20)]), 200)
    noisy = cycle + 0.05 * np.random.default_rng(0).standard_normal(200)
    assert found(np.round(noisy / 0.1) * 0.1, cycle) is None


def test_a_stuck_sensor_is_told_by_what_the_model_does_meanwhile():
    values = telemetry()
    values[100:] = values[100]
    fault = found(values)
    assert fault.suspicion.kind == "stuck"
    assert "from 2024-03-01 01:40:00 UTC" in fault.suspicion.sentence
    assert fault.useless[101:].all()
    assert found(values, np.full(200, 290.0)) is None


def test_a_sensor_that_is_stuck_again_and_again_is_told_with_all_stretches():
    """As are stale rows of one file between those of another, of which a right one is no spike."""
    values = telemetry()
    stretches = [slice(30, 64), slice(80, 113), slice(140, 180)]
    for part in stretches:
        values[part] = values[part.start]
    values[178] = telemetry()[178]
    fault = found(values)
    assert fault.suspicion.title == "body_temp is stuck again and again"
    assert fault.suspicion.sentence.startswith("3 times it reads one number for 33 samples or more, the first")
    assert all(fault.useless[part.start : part.stop - 2].all() for part in stretches)
    assert fault.useless.sum() < 110
    assert found(values, np.full(200, 290.0)) is None


def test_a_stuck_sensor_is_told_by_where_it_goes_on():
    values = telemetry()
    values[20:32] = values[20]
    assert found(values, np.full(200, np.nan)) is None
    values[32:] += 6.0
    fault = found(values, np.full(200, np.nan))
    assert fault.suspicion.kind == "stuck"
    assert "in 12 samples" in fault.suspicion.sentence
    assert fault.useless.sum() >= 11


UNKNOWN = np.full(200, np.nan)
"""What the model does, where there is none."""


@pytest.mark.parametrize("part", [slice(105, 175), slice(60, 110), slice(145, 200)])
def test_without_a_model_a_stuck_sensor_is_told_by_how_it_moves_elsewhere(part):
    values = telemetry()
    values[part] = values[part.start]
    fault = found(values, UNKNOWN)
    assert fault.suspicion.kind == "stuck"
    assert "its other samples move by" in fault.suspicion.sentence
    assert fault.useless[part.start + 1 : part.stop].all()


@pytest.mark.parametrize("step", [0.5, 1.0, 2.0])
def test_without_a_model_a_steady_sensor_of_coarse_steps_is_not_stuck(step):
    steady = 290.0 + 0.2 * np.sin(np.arange(200) / 16.0)
    moving = np.where(np.arange(200) < 80, 0.0, MODELLED - MODELLED[80])
    settling = 20.0 * np.exp(-np.arange(200) / 8.0) + np.where(np.arange(200) < 130, 0.0, MODELLED - MODELLED[130])
    heating = 0.3 * np.maximum(np.arange(200) - 90, 0.0)
    for temperature in (steady, steady + moving, steady + settling, steady + heating):
        assert found(np.round(temperature / step) * step, UNKNOWN) is None


def test_without_a_model_means_of_coarse_readings_that_come_to_rest_are_not_stuck():
    """Readings in steps of 0.44 K, of which means are also parts of a step apart, as those of `chandra_acis`."""
    seconds = np.arange(1600) / 8.0
    away = 290.0 - 12.0 * (1.0 - np.exp(-np.maximum(seconds - 130.0, 0.0) / 30.0))
    temperature = away - 15.0 * np.exp(-seconds / 9.0)
    means = (np.round(temperature / 0.44) * 0.44).reshape(200, 8).mean(axis=1)
    assert (np.diff(means) == 0.0).sum() > 60
    assert found(means, UNKNOWN) is None


def test_a_sensor_that_is_stuck_throughout_is_told():
    assert found(np.full(200, 290.0)).suspicion.sentence.count("throughout") == 1


def test_a_copied_block_is_told_with_its_lag():
    values = telemetry()
    values[90:160] = values[20:90]
    fault = found(values)
    assert fault.suspicion.kind == "repeating"
    assert "those of 70 samples before" in fault.suspicion.sentence
    assert fault.useless[90:160].all()


def test_a_held_reading_is_told_with_its_stride():
    fault = found(telemetry()[np.arange(200) // 8 * 8])
    assert (fault.suspicion.kind, "8 samples" in fault.suspicion.title) == ("held", True)


@pytest.mark.parametrize("stride", [5, 8])
def test_lines_between_few_readings_are_told_with_how_many_samples_they_replace(stride):
    places = np.arange(200)
    kept = places % stride == 3
    values = np.round(np.interp(places, places[kept], telemetry()[kept]), 2)
    # Some are lost, and the others are as they were.
    values[[40, 41, 90]] = np.nan
    suspected = found(values)
    assert suspected.suspicion.kind == "interpolated"
    assert f"One of {stride} samples" in suspected.suspicion.sentence
    np.testing.assert_array_equal(np.isfinite(values) & ~suspected.useless, kept & np.isfinite(values))


def test_lines_that_go_on_to_readings_outside_of_the_window_are_lines_too():
    places = np.arange(200)
    kept = places % 16 == 8
    values = np.interp(places, places[kept], telemetry()[kept], left=np.nan)
    inside = slice(5, 198)  # as if the first and last lines began and ended outside
    values[:8] = values[8] + 0.5 * (places[:8] - 8)
    values[184:] = values[184] - 0.4 * (places[184:] - 184)
    suspected = found(values[inside].round(2), MODELLED[inside])
    assert suspected.suspicion.kind == "interpolated"
    assert "One of 16 samples" in suspected.suspicion.sentence


@pytest.mark.parametrize("noise", [0.0, 0.002])
def test_what_rises_and_falls_in_straight_lines_is_no_interpolation(noise):
    values = 290.0 + np.abs(np.arange(200) % 60 - 35) / 4.0 + noise * np.random.default_rng(0).standard_normal(200)
    assert found(values, np.full(200, np.nan)) is None
    assert found(MODELLED.round(3)) is None


def test_a_spike_is_told_with_its_time_and_left_out():
    values = telemetry()
    values[57] += 40.0
    fault = found(values)
    assert fault.suspicion.kind == "spike"
    assert "2024-03-01 00:57:00 UTC" in fault.suspicion.sentence
    assert np.flatnonzero(fault.useless).tolist() == [57]


def test_spikes_that_come_now_and_then_are_told_from_noise():
    values = telemetry()
    hit = [17, 57, 80, 121, 160]
    values[hit] += 25.0 + np.arange(5)
    fault = found(values)
    assert (fault.suspicion.kind, fault.suspicion.title) == ("spike", "body_temp has 5 spikes")
    assert np.flatnonzero(fault.useless).tolist() == hit


def test_a_sensor_that_is_broken_for_a_time_is_told_with_what_leaves_that_time_out():
    stuck, spike, copied = telemetry(), telemetry(), telemetry()
    stuck[100:140] = stuck[100]
    spike[[57, 121]] += 40.0
    copied[90:160] = copied[20:90]
    for values in (stuck, spike, copied):
        fault = found(values)
        text, _, place = fault.suspicion.advice.removeprefix("Leave it out: '").partition("' of ")
        assert place == "body_temp in 'telemetry: channels'"
        written = TypeAdapter(tuple[Span, ...]).validate_python(YAML(typ="safe").load(text)["leave_out"])
        assert len(written) == (2 if fault.suspicion.kind == "spike" else 1)
        within = [(np.datetime64(span.start) <= TIMES) & (np.datetime64(span.end) >= TIMES) for span in written]
        np.testing.assert_array_equal(np.any(within, axis=0), fault.useless)


def test_the_last_sample_before_a_gap_is_no_spike():
    values = 290.0 + np.concatenate([np.zeros(19), [40.0], np.zeros(80)])
    values += 0.05 * np.random.default_rng(0).standard_normal(100)
    unknown = np.full(100, np.nan)
    after = TIMES[0] + np.concatenate([np.arange(20), 200 + np.arange(80)]) * np.timedelta64(60, "s")
    assert broken("array_temp", after, values, unknown) is None
    assert broken("array_temp", TIMES[:100], values, unknown).suspicion.kind == "spike"


def test_a_peak_that_the_model_has_too_is_no_spike():
    peak = 290.0 + 20.0 * np.exp(-2.0 * np.abs(np.arange(200) - 77))
    assert broken("array_temp", TIMES, peak, peak - 3.0) is None
    assert broken("array_temp", TIMES, peak, MODELLED).suspicion.kind == "spike"


def test_a_number_that_stands_for_no_reading_is_told_though_it_comes_often():
    values = telemetry()
    lost = np.random.default_rng(1).choice(200, 12, replace=False)
    values[lost] = 213.15
    fault = found(values)
    assert fault.suspicion.kind == "filled"
    assert "−60.00 degC comes 12 times" in fault.suspicion.sentence
    assert sorted(np.flatnonzero(fault.useless).tolist()) == sorted(lost.tolist())


def test_readings_that_stop_at_the_end_of_a_range_are_told_with_it():
    fault = found(np.minimum(telemetry(), 294.0))
    assert (fault.suspicion.kind, fault.suspicion.title) == ("clipped", "body_temp shows nothing above 20.85 degC")
    assert fault.useless.sum() > 50
    low = found(np.maximum(telemetry(), 286.0))
    assert (low.suspicion.kind, "below" in low.suspicion.title) == ("clipped", True)


def test_readings_that_stop_at_the_windows_ends_are_clipped_too():
    swing = 290.0 + 8.0 * np.cos(np.arange(200) / 32.0)
    values = np.minimum(np.round(swing / 0.1) * 0.1, 294.0)
    assert values[0] == values[-1] == 294.0
    fault = found(values, swing)
    assert (fault.suspicion.kind, int(fault.useless.sum())) == ("clipped", int((values == 294.0).sum()))
    assert found(np.round(swing / 0.1) * 0.1, swing) is None


def test_short_peaks_that_rise_fast_and_fall_slowly_are_clipped_where_the_model_goes_on():
    since = np.arange(200) % 50.0
    peaks = 288.0 + 8.0 * np.minimum(since / 2.0, np.exp(-(since - 2.0).clip(0.0) / 12.0))
    noise = 0.05 * np.random.default_rng(0).standard_normal(200)
    read = np.round((peaks + noise) / 0.1) * 0.1
    fault = found(np.minimum(read, 292.0), peaks)
    assert (fault.suspicion.kind, fault.suspicion.title) == ("clipped", "body_temp shows nothing above 18.85 degC")
    assert found(read, peaks) is None
    # A model that is half as large again is no sensor that stops.
    assert found(read, 288.0 + 1.5 * (peaks - 288.0)) is None


@pytest.mark.parametrize("known", [True, False])
def test_a_panel_that_is_steady_in_sunlight_is_not_clipped(known):
    places = np.arange(200) % 50
    panel = 300.0 - 90.0 * np.where(places < 12, 1.0 - np.exp(-places / 4.0), np.exp(-(places - 12) / 0.8))
    panel[places < 12] += np.random.default_rng(0).normal(0.0, 1.0, 200)[places < 12]
    modelled = panel - 6.0 if known else np.full(200, np.nan)
    assert found(np.round(panel), modelled) is None


def test_a_flat_top_within_a_step_is_not_clipped():
    assert found(telemetry(step=2.0, noise=0.0)) is None


def test_samples_that_are_not_there_do_not_matter():
    values = telemetry()
    values[::3] = np.nan
    assert found(values) is None


def test_a_panel_that_cools_in_a_short_eclipse_has_no_spike():
    values = np.full(200, 314.65)
    values[60:72] -= [0.5, 2.0, 9.5, 17.0, 19.0, 14.0, 7.0, 4.0, 2.0, 1.0, 0.5, 0.5]
    assert broken("array_temp", TIMES, values, np.full(200, np.nan)) is None


@pytest.mark.parametrize("step", [0.2, 0.5])
def test_negative_counts_that_are_read_without_a_sign_are_told(step):
    """Below 0 degC a byte reads 256 counts more."""
    rng = np.random.default_rng(5)
    celsius = 6.0 * np.sin(np.arange(200) / 12.0) + 3.0 + rng.normal(0.0, 0.1, 200)
    counts = np.round(celsius / step)
    read = np.where(counts < 0.0, counts + 256.0, counts) * step + 273.15
    suspicion = found(read, celsius + 273.15)
    assert suspicion.suspicion.kind == "wrapped"
    assert f"{256 * step:.3g} K, 256 of its steps" in suspicion.suspicion.sentence
    assert (suspicion.useless == (counts < 0.0)).all()


def test_a_step_that_is_no_whole_number_of_counts_is_not_told_as_one():
    rng = np.random.default_rng(6)
    celsius = np.round((3.0 + rng.normal(0.0, 0.3, 200)) / 0.2) * 0.2
    celsius[60:90] += 47.0
    told = found(celsius + 273.15)
    assert told is None or told.suspicion.kind != "wrapped"
