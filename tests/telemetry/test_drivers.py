from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flightcal.errors import TelemetryError
from flightcal.telemetry import driver_corners, driver_gaps, driver_jumps, driver_series, status_fraction

from .files import frame, read, seconds, text

MINUTE = 60.0
PERIOD = 100 * MINUTE


def orbit(minutes: np.ndarray) -> np.ndarray:
    """A driver that repeats after 100 minutes, in mA."""
    return np.clip(300.0 * np.cos(2 * np.pi * minutes / 100.0) + 100.0, 0.0, None)


def driver(folder: Path, minutes: np.ndarray, **changes: object) -> xr.Dataset:
    table = pd.DataFrame({"time": text(seconds(*(MINUTE * minutes))), "I": orbit(minutes)})
    return read(
        folder, table, channels={"sun": {"column": "I", "kind": "driver", "unit": "mA"} | changes}, period=PERIOD
    )


def test_values_between_samples_are_interpolated(tmp_path: Path):
    dataset = driver(tmp_path, np.arange(0.0, 300.0))
    at = np.array([0.0, 0.5, 10.25, 299.0])
    expected = np.interp(at, np.arange(300.0), orbit(np.arange(300.0)) / 1000)
    np.testing.assert_allclose(driver_series(dataset, "sun", seconds(*(MINUTE * at))), expected)


def test_a_gap_of_up_to_three_intervals_is_interpolated_whatever_the_fill(tmp_path: Path):
    minutes = np.delete(np.arange(0.0, 300.0), [150, 151])
    dataset = driver(tmp_path, minutes, fill="previous_orbit")
    value = driver_series(dataset, "sun", seconds(150.5 * MINUTE))
    np.testing.assert_allclose(value, np.interp(150.5, minutes, orbit(minutes)) / 1000)


@pytest.mark.parametrize(
    ("kept", "turns"),
    [
        (lambda m: ~((m > 130) & (m < 160)), "one orbit earlier"),
        (lambda m: ~((m > 230) & (m < 260) | (m > 130) & (m < 160)), "two orbits earlier"),
        (lambda m: ~((m > 30) & (m < 60)), "one orbit later"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_long_gap_takes_the_value_of_another_orbit(tmp_path: Path, kept, turns: str):
    minutes = np.arange(0.0, 400.0)
    dataset = driver(tmp_path, minutes[kept(minutes)], fill="previous_orbit")
    at = np.arange(0.0, 399.0, 0.5)
    assert not kept(at).all()
    expected = np.interp(at, minutes, orbit(minutes)) / 1000
    np.testing.assert_allclose(driver_series(dataset, "sun", seconds(*(MINUTE * at))), expected, atol=1e-12)


def test_a_longer_gap_is_bridged_where_the_channel_says_so(tmp_path: Path):
    minutes = np.arange(0.0, 300.0)
    table = pd.DataFrame({"time": text(seconds(*(MINUTE * minutes))), "I": minutes})
    table = table[~((minutes > 130) & (minutes < 160))]
    known = {"column": "I", "kind": "driver"}
    at = seconds(145 * MINUTE)
    longer = read(tmp_path, table, channels={"sun": known | {"longest_gap": "30 min"}}, period=PERIOD)
    np.testing.assert_allclose(driver_series(longer, "sun", at), 145.0)
    shorter = read(tmp_path, table, channels={"sun": known | {"longest_gap": "29 min"}}, period=PERIOD)
    with pytest.raises(TelemetryError, match=r"bridges at most 29\.0 min"):
        driver_series(shorter, "sun", at)


def test_an_earlier_orbit_goes_before_a_later_one(tmp_path: Path):
    minutes = np.arange(0.0, 300.0)
    table = pd.DataFrame({"time": text(seconds(*(MINUTE * minutes))), "I": minutes})[
        ~((minutes > 130) & (minutes < 160))
    ]
    channels = {"sun": {"column": "I", "kind": "driver", "fill": "previous_orbit"}}
    dataset = read(tmp_path, table, channels=channels, period=PERIOD)
    np.testing.assert_allclose(driver_series(dataset, "sun", seconds(145 * MINUTE)), 45.0)
    np.testing.assert_allclose(
        driver_series(dataset, "sun", seconds(145 * MINUTE), fill="interpolate", period=1e5), 145.0
    )


@pytest.mark.parametrize(
    ("fill", "period", "at", "message"),
    [
        (
            "interpolate",
            PERIOD,
            145.0,
            r"at 2024-03-01T02:25:00, a gap of 30.0 min; 'fill: interpolate' bridges at most 10.0 min",
        ),
        ("previous_orbit", 15 * MINUTE, 307.0, r"before the first or after the last sample; no other orbit"),
        ("interpolate", PERIOD, 260.0, r"before the first or after the last sample"),
        ("interpolate", PERIOD, -2.0, r"before the first or after the last sample"),
    ],
)
def test_a_gap_that_cannot_be_bridged_is_an_error(tmp_path: Path, fill, period: float, at: float, message: str):
    minutes = np.arange(0.0, 250.0)
    dataset = driver(tmp_path, minutes[~((minutes > 130) & (minutes < 160))])
    if fill == "previous_orbit":
        dataset = dataset.isel(time=slice(0, 3))
    with pytest.raises(TelemetryError, match=rf"channel 'sun': found no sample .*{message}"):
        driver_series(dataset, "sun", seconds(at * MINUTE), fill=fill, period=period)


def test_a_time_less_than_an_interval_outside_takes_the_nearest_sample(tmp_path: Path):
    dataset = driver(tmp_path, np.arange(0.0, 250.0))
    found = driver_series(dataset, "sun", seconds(-0.9 * MINUTE, 249.9 * MINUTE))
    np.testing.assert_allclose(found, orbit(np.array([0.0, 249.0])) / 1000)


def heater(folder: Path, at: list[float], status: list[int]) -> xr.Dataset:
    table = pd.DataFrame({"time": text(seconds(*at)), "HTR": status, "n": frame(len(at))["I_SA"]})
    return read(folder, table, channels={"heater": {"column": "HTR", "kind": "status"}})


def test_a_status_holds_from_halfway_to_its_neighbours(tmp_path: Path):
    dataset = heater(tmp_path, [0, 10, 20, 30, 40], [0, 1, 1, 0, 0])
    share = status_fraction(dataset, "heater", seconds(0, 4, 6, 20, 24, 26, 40))
    np.testing.assert_allclose(share, [0.0, 0.5, 1.0, 1.0, 0.5, 0.0])
    np.testing.assert_allclose(status_fraction(dataset, "heater", seconds(0, 40)), [0.5])


def test_a_status_holds_through_a_short_gap(tmp_path: Path):
    dataset = heater(tmp_path, [0, 10, 20, 50, 60, 70], [0, 0, 1, 0, 0, 1])
    np.testing.assert_allclose(
        status_fraction(dataset, "heater", seconds(0, 20, 40, 50, 60, 70)), [0.25, 1, 0.5, 0, 0.5]
    )


def test_a_status_is_unknown_in_a_long_gap(tmp_path: Path):
    dataset = heater(tmp_path, [0, 10, 20, 100, 110, 120], [0, 0, 1, 0, 0, 1])
    np.testing.assert_allclose(
        status_fraction(dataset, "heater", seconds(0, 20, 25, 30, 90, 100, 110, 120)),
        [0.25, 1, 1, np.nan, np.nan, 0, 0.5],
    )


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    status=st.lists(st.integers(0, 1), min_size=3, max_size=20),
    cuts=st.lists(st.floats(1.0, 1000.0), min_size=2, max_size=12, unique=True),
)
def test_on_time_does_not_depend_on_how_the_span_is_cut(tmp_path: Path, status: list[int], cuts: list[float]):
    dataset = heater(tmp_path, [10.0 * i for i in range(len(status))], status)
    span = 10.0 * (len(status) - 1)
    at = seconds(0.0, *sorted(np.unique(np.round(np.array(cuts) / 1001.0 * span, 3))), span)
    lengths = np.diff(at) / np.timedelta64(1, "s")
    share = status_fraction(dataset, "heater", at)
    assert ((share >= 0) & (share <= 1)).all()
    whole = sum(status) * 10.0 - 5.0 * (status[0] + status[-1])
    np.testing.assert_allclose(share @ lengths, whole, atol=1e-5)


def test_status_outside_the_telemetry_is_an_error(tmp_path: Path):
    dataset = heater(tmp_path, [0, 10, 20, 30], [0, 1, 1, 0])
    with pytest.raises(
        TelemetryError,
        match=r"channel 'heater': found no status from .* to 2024-03-01T00:01:00, .*within the telemetry",
    ):
        status_fraction(dataset, "heater", seconds(0, 60))


def test_a_value_that_is_held_stays_until_the_next_sample_and_to_the_end_of_the_telemetry(tmp_path: Path):
    table = pd.DataFrame({"time": text(seconds(*(MINUTE * np.arange(60.0))))}).assign(I=np.nan, other=1.0)
    table.loc[[0, 10, 30], "I"] = [100.0, 300.0, 200.0]
    channels = {
        "sun": {"column": "I", "kind": "driver", "unit": "mA", "fill": "hold"},
        "other": {"column": "other", "kind": "driver", "unit": "mA"},
    }
    dataset = read(tmp_path, table, channels=channels)
    at = seconds(*(MINUTE * np.array([0.0, 9.999, 10.0, 29.9, 30.0, 59.0])))
    np.testing.assert_allclose(driver_series(dataset, "sun", at), [0.1, 0.1, 0.3, 0.3, 0.2, 0.2])
    corners = driver_corners(dataset, "sun", "hold", None)
    off = corners - seconds(599.999, 600.0, 1799.999, 1800.0)
    assert (abs(off) <= np.timedelta64(1, "us")).all()
    assert driver_gaps(dataset, "sun", "hold")[0].size == 0
    with pytest.raises(TelemetryError, match=r"'sun': found no sample at .*'fill: hold' needs a sample"):
        driver_series(dataset, "sun", seconds(-120.0))


@pytest.mark.parametrize("fill", ["20 mA", 20.0])
def test_a_value_is_what_a_driver_has_where_there_are_no_samples(tmp_path: Path, fill: object):
    minutes = np.array([30.0, 31.0, 32.0, 90.0, 91.0, 92.0])
    table = pd.DataFrame({"time": text(seconds(*(MINUTE * minutes))), "I": [100.0, 300.0, 200.0, 100.0, 200.0, 300.0]})
    unit, one = ("mA", 1e-3) if isinstance(fill, str) else ("1", 1.0)
    dataset = read(tmp_path, table, channels={"sun": {"column": "I", "kind": "driver", "unit": unit, "fill": fill}})
    at = np.array([0.0, 29.4, 29.6, 30.5, 32.0, 32.4, 32.6, 60.0, 89.4, 89.6, 91.5, 92.6, 500.0])
    found = [20.0, 20.0, 100.0, 200.0, 200.0, 200.0, 20.0, 20.0, 20.0, 100.0, 250.0, 20.0, 20.0]
    np.testing.assert_allclose(driver_series(dataset, "sun", seconds(*(MINUTE * at))), one * np.array(found))
    corners = driver_corners(dataset, "sun", 20.0 * one, None)
    for jump in (29.5, 32.5, 89.5, 92.5):
        around = np.abs((corners - seconds(MINUTE * jump)) / np.timedelta64(1, "s"))
        assert np.sum(around < 2e-3) == 2
    assert driver_gaps(dataset, "sun", 20.0 * one)[0].size == 0


def switched(folder: Path, *, keep=slice(None), **changes: object) -> xr.Dataset:
    """A driver with a ripple that is switched on after 10 min, off after 20, and on for one sample after 30."""
    minutes = np.arange(60.0)
    on = (minutes >= 10) & (minutes < 20) | (minutes == 30)
    table = pd.DataFrame({"time": text(seconds(*(MINUTE * minutes))), "I": 50.0 + 300.0 * on + minutes % 2})
    packet = {key: changes.pop(key) for key in ("average",) if key in changes}
    channels = {"sun": {"column": "I", "kind": "driver", "unit": "mA"} | changes}
    return read(folder, table.loc[keep], channels=channels, **packet)


def test_a_driver_jumps_where_it_is_switched(tmp_path: Path):
    spans, sizes = driver_jumps(switched(tmp_path), "sun", "interpolate")
    np.testing.assert_array_equal(spans[:, 0], seconds(*(MINUTE * np.array([9.0, 19.0, 29.0, 30.0]))))
    np.testing.assert_array_equal(spans[:, 1], seconds(*(MINUTE * np.array([10.0, 20.0, 30.0, 31.0]))))
    np.testing.assert_allclose(sizes, 0.3, atol=3e-3)


def test_twice_the_square_of_a_driver_jumps_as_that_does(tmp_path: Path):
    _, sizes = driver_jumps(switched(tmp_path), "sun", "interpolate", lambda values: 2.0 * values**2)
    np.testing.assert_allclose(sizes, 2.0 * (0.35**2 - 0.05**2), rtol=0.01)


def test_a_smooth_driver_does_not_jump(tmp_path: Path):
    assert not len(driver_jumps(driver(tmp_path, np.arange(0.0, 300.0)), "sun", "interpolate")[0])


def test_a_value_that_is_held_a_mean_and_a_long_gap_leave_no_jump(tmp_path: Path):
    assert not len(driver_jumps(switched(tmp_path), "sun", "hold")[0])
    assert not len(driver_jumps(switched(tmp_path, average="3 min"), "sun", "interpolate")[0])
    beside_a_gap = np.delete(np.arange(60), np.arange(10, 15))
    spans, _ = driver_jumps(switched(tmp_path, keep=beside_a_gap), "sun", "interpolate")
    assert seconds(9.0 * MINUTE)[0] not in spans[:, 0]
    assert len(spans) == 3


def test_a_status_with_one_sample_holds_all_the_time(tmp_path: Path):
    table = frame(10)
    table["HTR"] = [np.nan] * 4 + [1.0] + [np.nan] * 5
    dataset = read(tmp_path, table)
    assert status_fraction(dataset, "heater", seconds(0.0, 120.0, 540.0)).tolist() == [1.0, 1.0]
