from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightcal.telemetry.stale import repeats, row_content

from .files import CHANNELS, frame, read, seconds, text

STALE, FROZEN = 8, {"TT_BAT": 21.5, "I_SA": 120.0, "HTR": 1}


def test_repeats_carry_the_length_of_their_run_and_the_first_row_is_genuine():
    keys = np.array([1, 2, 2, 2, 3, 4, 5, 5, 6], dtype=np.uint64)
    np.testing.assert_array_equal(repeats(keys, np.full(9, 0.001)), [0, 0, 3, 3, 0, 0, 0, 2, 0])
    np.testing.assert_array_equal(repeats(keys, np.where(np.arange(9) == 2, 0.001, 1.0)), [0, 0, 3, 3, 0, 0, 0, 0, 0])


@pytest.mark.parametrize(("length", "masked"), [(5, 0), (6, 5), (20, 19)])
def test_runs_from_stale_after_on_are_masked_but_for_their_first_row(tmp_path: Path, length: int, masked: int):
    table = frame(60)
    table.loc[10 : 9 + length, list(FROZEN)] = list(FROZEN.values())
    flags = read(tmp_path, table)["flags"].to_numpy()
    expected = np.zeros_like(flags)
    expected[11 : 11 + masked] = STALE
    np.testing.assert_array_equal(flags, expected)


def test_equal_rows_are_frozen_only_where_they_do_not_come_by_chance():
    keys = np.append(np.zeros(6), np.arange(1, 995)).astype(np.uint64)
    assert repeats(keys, np.full(1000, 0.05)).sum() == 5 * 6
    assert not repeats(keys, np.full(1000, 0.3)).any()


@pytest.mark.parametrize("seed", range(3))
def test_samples_that_are_close_and_coarse_repeat_by_chance(tmp_path: Path, seed: int):
    """Two thermistors that are read every 10 s for a day, in steps as large as their noise: a row in four repeats."""
    rng, rows = np.random.default_rng(seed), 8640
    table = frame(rows, 10.0).drop(columns="HTR")
    for name, step, period in (("TT_BAT", 0.1, 540.0), ("I_SA", 0.25, 560.0)):
        value = 20.0 + 5.0 * np.sin(2 * np.pi * np.arange(rows) / period) + 0.07 * rng.standard_normal(rows)
        table[name] = (np.round(value / step) * step).round(2)
    channels = {"battery": CHANNELS["battery"], "sun": CHANNELS["sun"]}
    assert not read(tmp_path, table, channels=channels)["flags"].any()
    table.loc[4000:4030, ["TT_BAT", "I_SA"]] = table.loc[4000, ["TT_BAT", "I_SA"]].to_numpy()
    found = read(tmp_path, table, channels=channels)["flags"].to_numpy()
    np.testing.assert_array_equal(np.flatnonzero(found[:, 0] == STALE), np.arange(4001, 4031))


def test_each_channel_has_its_own_stale_after(tmp_path: Path):
    table = frame(40)
    table.loc[10:17, list(FROZEN)] = list(FROZEN.values())
    changes = {"battery": {"stale_after": None}, "sun": {"stale_after": 9}, "heater": {"stale_after": 8}}
    channels = {name: channel | changes[name] for name, channel in CHANNELS.items()}
    assert (read(tmp_path, table, channels=channels)["flags"] == STALE).sum("time").to_numpy().tolist() == [0, 0, 7]


def test_a_row_in_which_an_unused_column_moves_is_not_frozen(tmp_path: Path):
    table = frame(40)
    table.loc[10:30, list(FROZEN)] = list(FROZEN.values())
    table["noise"] = np.random.default_rng(2).normal(size=40)
    assert not read(tmp_path, table)["flags"].any()


@pytest.mark.parametrize(
    "counter",
    ["frames", "wrapping frames", "clock", "clock as text", "falling"],
    ids=lambda name: name.replace(" ", "-"),
)
def test_counters_that_go_on_do_not_hide_a_frozen_row(tmp_path: Path, counter: str):
    table = frame(100)
    table.loc[10:30, list(FROZEN)] = list(FROZEN.values())
    index = np.arange(100)
    table["counter"] = {
        "frames": index + 7,
        "wrapping frames": index % 32,
        "clock": text(seconds(*(60.0 * index + 0.1))),
        "clock as text": [f"061/{minute // 60:02d}h{minute % 60:02d}" for minute in index],
        "falling": 1e4 - index**1.5,
    }[counter]
    assert (read(tmp_path, table)["flags"] == STALE).sum("time").to_numpy().tolist() == [20, 20, 20]


def test_a_constant_coarse_temperature_is_not_frozen(tmp_path: Path):
    coarse = pd.DataFrame({"time": frame(300, 1.0)["time"], "TT_BAT": np.repeat([20, 21, 20, 22, 21], 60)})
    battery = {"battery": CHANNELS["battery"]}
    dataset = read(tmp_path, coarse, channels=battery)
    assert not dataset["flags"].any()
    assert dataset.attrs["stale_checked"] == 0
    varying = coarse.assign(I_SA=frame(300)["I_SA"])
    dataset = read(tmp_path, varying, channels=battery)
    assert not dataset["flags"].any()
    assert dataset.attrs["stale_checked"] == 1


def test_a_coarse_temperature_is_not_frozen_at_a_value_that_it_once_only_touched(tmp_path: Path):
    degrees = np.repeat([20, 21, 22, 21, 20, 21, 20], [60, 60, 1, 60, 60, 60, 60])
    degrees[200:240] = 22
    table = pd.DataFrame({"time": frame(len(degrees), 1.0)["time"], "TT_BAT": degrees})
    assert not read(tmp_path, table, channels={"battery": CHANNELS["battery"]})["flags"].any()


@pytest.mark.parametrize("orbits", [1, 3])
@pytest.mark.parametrize("dark", [0.0, 2.5])
def test_a_driver_that_is_constant_in_eclipse_is_not_frozen(tmp_path: Path, orbits: int, dark: float):
    sunlit = frame(60 * orbits)["I_SA"].to_numpy() + 10.0
    current = np.where(np.arange(60 * orbits) % 60 < 30, sunlit, dark)
    table = pd.DataFrame({"time": frame(60 * orbits)["time"], "I_SA": current})
    frozen = (read(tmp_path, table, channels={"sun": CHANNELS["sun"]})["flags"] > 0).to_numpy()
    # A dark current that is not zero, seen in one eclipse only, looks like a frozen row.
    assert frozen.sum() == (29 if orbits == 1 and dark else 0)


def test_a_row_frozen_in_sunlight_is_found_beside_eclipses(tmp_path: Path):
    table = frame(180)
    table.loc[np.arange(180) % 60 >= 30, ["TT_BAT", "I_SA", "HTR"]] = [3.0, 0.0, 0]
    table.loc[70:85, list(FROZEN)] = list(FROZEN.values())
    flags = read(tmp_path, table)["flags"].to_numpy()
    np.testing.assert_array_equal(np.flatnonzero(flags[:, 0]), np.arange(71, 86))


def test_a_frozen_row_goes_on_into_the_next_file(tmp_path: Path):
    table = frame(60)
    table.loc[26:33, list(FROZEN)] = list(FROZEN.values())
    whole = read(tmp_path, table)
    table[:30].to_csv(tmp_path / "first.csv", index=False)
    table[30:].to_csv(tmp_path / "second.csv", index=False)
    both = read(tmp_path, table, file=["first.csv", "second.csv"])
    np.testing.assert_array_equal(both["flags"], whole["flags"])
    np.testing.assert_array_equal(np.flatnonzero(whole["flags"][:, 0]), np.arange(27, 34))


def test_rows_stored_more_often_than_sampled_are_not_frozen(tmp_path: Path):
    table = frame(40).iloc[np.arange(400) // 10].reset_index(drop=True).assign(time=frame(400)["time"])
    dataset = read(tmp_path, table)
    assert not dataset["flags"].any()
    assert dataset.attrs["stale_checked"] == 0


def test_empty_rows_are_missing_and_not_stale(tmp_path: Path):
    table = frame(40)
    table.loc[10:30, list(FROZEN)] = np.nan
    flags = read(tmp_path, table.astype({"HTR": "Int64"}))["flags"].to_numpy()
    assert (flags[10:31] == 1).all()
    assert not flags[:10].any()
    assert not flags[31:].any()


def test_a_channel_that_is_missing_in_a_frozen_row_is_missing_and_not_stale(tmp_path: Path):
    table = frame(40)
    table.loc[10:30, list(FROZEN)] = [np.nan, 120.0, 1]
    flags = read(tmp_path, table)["flags"].to_numpy()
    np.testing.assert_array_equal(flags[11:31], np.tile([1, STALE, STALE], (20, 1)))


@given(
    values=st.lists(st.tuples(st.integers(-5, 5), st.sampled_from(["a", "b", None])), min_size=2, max_size=20),
    column=st.sampled_from(["number", "word"]),
)
def test_row_keys_are_equal_exactly_for_rows_of_equal_content(values: list, column: str):
    table = pd.DataFrame(values, columns=["number", "word"])
    times = np.arange(len(table), dtype=np.int64)
    key = row_content(table, times, {"number", "word"}).keys
    same = [[a == b for b in values] for a in values]
    np.testing.assert_array_equal(key[:, np.newaxis] == key, same)
    one = row_content(table[[column]], times, {column}).keys
    index = ["number", "word"].index(column)
    np.testing.assert_array_equal(one[:, np.newaxis] == one, [[a[index] == b[index] for b in values] for a in values])


def test_equal_readings_of_one_sensor_as_counts_and_as_a_value_are_no_frozen_rows(tmp_path: Path):
    """A thermistor that turns slowly, in coarse steps: at its extremes it reads the same for many samples."""
    at = np.arange(3000)
    counts = np.round(100.0 + 60.0 * np.sin(at / 60.0) + 0.1 * np.sin(at / 7.0)).astype(int)
    table = pd.DataFrame({"time": text(seconds(*(64.0 * at))), "RAW": counts, "TT_BAT": counts * 0.25})
    channels = {"battery": CHANNELS["battery"]}
    assert not read(tmp_path, table, channels=channels)["flags"].any()
    other = table.assign(TT_RAD=np.round(50.0 + 60.0 * np.cos(at / 60.0 + 1.0)))
    other.loc[400:430, ["RAW", "TT_BAT", "TT_RAD"]] = other.loc[400, ["RAW", "TT_BAT", "TT_RAD"]].to_numpy()
    found = np.flatnonzero(read(tmp_path, other, channels=channels)["flags"].to_numpy()[:, 0] == STALE)
    np.testing.assert_array_equal(found, np.arange(401, 431))
