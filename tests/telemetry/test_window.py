from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from flightcal.errors import TelemetryError
from flightcal.scenario import Window
from flightcal.telemetry import quality_table, select_window, window_bounds

from .files import frame, read, seconds

AT = datetime(2024, 3, 1, 0, 10)


def test_a_window_counts_orbits_or_ends_at_a_time():
    start = np.datetime64("2024-03-01T00:10:00", "ns")
    assert window_bounds(Window(start=AT, orbits=1.5), 5400.0) == (start, start + np.timedelta64(8100, "s"))
    end = datetime(2024, 3, 1, 0, 30)
    assert window_bounds(Window(start=AT, end=end), None) == (start, np.datetime64(end, "ns"))


def test_windows_that_follow_one_another_share_no_sample(tmp_path: Path):
    dataset = read(tmp_path, frame(60), period=600.0)
    first = select_window(dataset, Window(start=AT, orbits=2))
    second = select_window(dataset, Window(start=datetime(2024, 3, 1, 0, 30), orbits=2), period=600.0)
    np.testing.assert_array_equal(first["time"], seconds(*(60.0 * np.arange(10, 30))))
    np.testing.assert_array_equal(second["time"], seconds(*(60.0 * np.arange(30, 50))))
    assert first.attrs == dataset.attrs


def test_a_window_may_reach_one_sampling_interval_beyond_the_telemetry(tmp_path: Path):
    dataset = read(tmp_path, frame(60))
    assert select_window(dataset, Window(start=AT, end=datetime(2024, 3, 1, 1, 0))).sizes["time"] == 50
    with pytest.raises(TelemetryError, match=r"in a part of it only.*telemetry runs from 2024-03-01T00:00:00 to"):
        select_window(dataset, Window(start=AT, end=datetime(2024, 3, 1, 1, 0, 1)))
    before = datetime(2024, 2, 29, 23, 59)
    assert select_window(dataset, Window(start=before, end=AT)).sizes["time"] == 10
    with pytest.raises(TelemetryError, match=r"in a part of it only.*telemetry runs from 2024-03-01T00:00:00 to"):
        select_window(dataset, Window(start=before - timedelta(seconds=1), end=AT))


def test_a_window_without_a_valid_sample_is_an_error(tmp_path: Path):
    table = frame(60).astype({"HTR": "Int64"})
    table.loc[10:29, ["TT_BAT", "I_SA", "HTR"]] = np.nan
    window = Window(start=AT, end=datetime(2024, 3, 1, 0, 30))
    with pytest.raises(TelemetryError, match=r"window 2024-03-01T00:10:00 to .* found 20 samples, none valid"):
        select_window(read(tmp_path, table), window)
    with pytest.raises(TelemetryError, match="window test, 2024-03-01T00:10:00 to"):
        select_window(read(tmp_path, table), window, called="test")


def test_the_quality_of_a_window_is_its_own(tmp_path: Path):
    table = frame(60)
    table.loc[[5, 20, 21], "TT_BAT"] = np.nan
    dataset = read(tmp_path, table)
    window = select_window(dataset, Window(start=AT, end=datetime(2024, 3, 1, 0, 30)))
    (record,) = quality_table(window)
    assert (record.finding, record.samples, record.share) == ("missing", 2, 0.1)


def test_a_plan_that_has_begun_goes_on_after_the_telemetry(tmp_path: Path):
    dataset = read(tmp_path, frame(60))
    for minute, samples in ((50, 10), (59, 1)):
        start = datetime(2024, 3, 1, 0, minute)
        found = select_window(dataset, Window(start=start, end=datetime(2024, 3, 1, 2, 0), planned=True))
        np.testing.assert_array_equal(found["time"], seconds(*(60.0 * np.arange(minute, 120))))
        assert np.isfinite(found["battery"][:samples]).all()
        assert not np.isfinite(found["battery"][samples:]).any()


def test_a_plan_has_times_as_far_apart_as_the_telemetry_s(tmp_path: Path):
    dataset = read(tmp_path, frame(60))
    start, end = datetime(2024, 3, 1, 1, 20), datetime(2024, 3, 1, 2, 0)
    with pytest.raises(TelemetryError, match="'planned: true' of a time to come"):
        select_window(dataset, Window(start=start, end=end))
    plan = Window(start=start, end=end, planned=True)
    found = select_window(dataset, plan)
    np.testing.assert_array_equal(found["time"], seconds(*(60.0 * np.arange(80, 120))))
    assert not any(np.isfinite(found[name]).any() for name in ("battery", "heater", "sun"))
    assert found.attrs == dataset.attrs
    long = Window(start=start, end=datetime(2025, 3, 1), planned=True)
    assert select_window(dataset, long).sizes["time"] <= 5001


def test_what_is_flown_of_a_plan_is_telemetry(tmp_path: Path):
    dataset = read(tmp_path, frame(60))
    window = Window(start=AT, end=datetime(2024, 3, 1, 0, 30))
    flown = select_window(dataset, window.model_copy(update={"planned": True}))
    assert flown.identical(select_window(dataset, window))
