"""Temperatures that jump as no heat makes them."""

import numpy as np

from flightcal.check.jumps import in_turns, in_words, jumps

TIMES = np.datetime64("2024-03-01T00:00:00", "ns") + np.arange(200) * np.timedelta64(60, "s")
MODELLED = np.stack([290.0 + 8.0 * np.sin(np.arange(200) / 16.0), 280.0 + 2.0 * np.sin(np.arange(200) / 16.0)], axis=1)
"""K, what a simulator has."""
NAMES = ("panel_temp", "body_temp")


def telemetry(seed=0):
    return MODELLED + 0.1 * np.random.default_rng(seed).standard_normal(MODELLED.shape)


def found(values, modelled=MODELLED):
    return jumps(NAMES, TIMES, values, modelled)


def test_sound_telemetry_does_not_jump():
    assert [jump for seed in range(5) for jump in found(telemetry(seed))] == []


def test_a_spike_is_no_jump():
    values = telemetry()
    values[100, 0] += 30.0
    assert found(values) == []


def test_a_light_node_that_the_sun_heats_does_not_jump():
    values = telemetry()
    values[:, 0] = 250.0 + np.where(np.arange(200) > 100, 60.0 * (1.0 - np.exp(-(np.arange(200) - 100) / 1.5)), 0.0)
    assert found(values) == []


def test_what_the_model_does_too_is_no_jump():
    values, modelled = telemetry(), MODELLED.copy()
    values[100:, 0] += 30.0
    modelled[100:, 0] += 20.0
    assert found(values, modelled) == []


def test_a_sensor_that_changes_is_named_alone():
    values = telemetry()
    values[100:, 0] += 9.0
    (suspicion,) = in_words(found(values))
    assert (suspicion.kind, suspicion.about) == ("jump", "panel_temp")
    assert "At 2024-03-01 01:40:00 UTC it goes by 9" in suspicion.sentence


def test_each_sensor_that_changes_is_named_with_its_own_jumps():
    values = telemetry()
    values[100:, 0] += 9.0
    values[40:, 1] += 5.0
    values[150:, 1] += 6.0
    told = {suspicion.about: suspicion.sentence for suspicion in in_words(found(values))}
    assert set(told) == set(NAMES)
    assert "other moment" not in told["panel_temp"]
    assert "at 1 other moment." in told["body_temp"]


def test_channels_that_jump_at_once_are_a_matter_of_time():
    """The slow one by little."""
    values = telemetry()
    values[100:] = values[40:140]
    (suspicion,) = in_words(found(values))
    assert (suspicion.kind, suspicion.about) == ("order", "time")
    assert "panel_temp and body_temp jump at once" in suspicion.sentence


def test_channels_of_packets_with_times_of_their_own_jump_all_the_same():
    values = telemetry()
    values[100:] += (20.0, 8.0)
    times = np.repeat(TIMES, 2) + np.tile([0, 1_000_000_000], 200).astype("timedelta64[ns]")
    apart = np.full((400, 2), np.nan)
    apart[::2, 0], apart[1::2, 1] = values.T
    (jump,) = jumps(NAMES, times, apart, np.repeat(MODELLED, 2, axis=0))
    assert jump.time == TIMES[100]
    assert jump.channels == NAMES


def test_old_telemetry_that_is_sent_again_is_not_out_of_order():
    values = telemetry()
    values[100:110] = values[99]
    values[110:] += 9.0
    assert found(values) == []


def test_nothing_is_said_where_nothing_jumps():
    assert in_words([]) == []


def of_two_satellites(apart):
    """Rows of a satellite and of one that is so many samples behind it, in turns; some are lost."""
    rng = np.random.default_rng(4)
    rows = np.arange(apart, 200)
    both = np.stack([telemetry(1)[rows], telemetry(2)[rows - apart]], axis=1).reshape(-1, 2)
    kept = rng.random(len(both)) > 0.05
    return both[kept], np.repeat(MODELLED[rows], 2, axis=0)[kept]


def test_rows_of_two_satellites_that_take_turns_are_named():
    values, modelled = of_two_satellites(apart=40)
    assert in_turns(NAMES, values, modelled) == ["panel_temp", "body_temp"]
    (suspicion,) = in_words([], in_turns(NAMES, values, modelled))
    assert (suspicion.kind, suspicion.about, suspicion.title) == ("order", "rows", "Rows of two sources take turns")


def test_sound_telemetry_does_not_take_turns():
    assert in_turns(NAMES, telemetry(), MODELLED) == []


def test_a_spinning_body_that_is_sampled_twice_a_turn_does_not_take_turns():
    spin = 20.0 * (np.arange(200) % 2)[:, None]
    assert in_turns(NAMES, telemetry() + spin, MODELLED + spin) == []


def test_one_sensor_that_goes_to_and_fro_is_no_matter_of_rows():
    values = telemetry()
    values[::2, 0] += 20.0
    assert in_turns(NAMES, values, MODELLED) == []
