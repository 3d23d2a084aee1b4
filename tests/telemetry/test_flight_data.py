"""Real flight data, read as their examples read them."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
import xarray as xr

from flightcal.scenario import TelemetryFile, Window
from flightcal.telemetry import driver_series, quality_table, read_telemetry, select_window

from .files import flight_data

FUNCUBE = "funcube1/funcube1_2016-02-04_first.csv"
FUNCUBE_PERIOD = 97.4 * 60
FUNCUBE_CHANNELS: dict[str, Any] = {
    "panels_mean": {
        "column": [f"Solar Panel {face} deg. C" for face in ("+X", "-X", "+Y", "-Y")],
        "combine": "mean",
        "kind": "temperature",
        "unit": "degC",
    },
    "black_chassis": {"column": "Black Chassis deg. C", "kind": "temperature", "unit": "degC"},
    "photo_current": {"column": "Tot. Photo Curr. mA", "kind": "driver", "unit": "mA", "fill": "previous_orbit"},
    "system_power": {
        "column": ["Battery mV", "Tot. System Curr. mA"],
        "combine": "product",
        "kind": "driver",
        "unit": "mV * mA",
        "fill": "previous_orbit",
    },
}
FUNCUBE_GAPS = [("00:24", "00:43"), ("02:28", "02:41"), ("04:26", "04:45"), ("08:13", "08:50")]

BUPT = ["200B_Sun_FULL_1T_180", "200B_Sun_FULL_4T_180", "200B_Sun_LOW_1T_180", "PiA_Sun_1C_StressTest_180"]
BUPT_CHANNELS: dict[str, Any] = {
    "payload": {"column": "TEMP", "kind": "temperature", "unit": "degC", "invalid": [-1]},
    "sun": {"column": ["MPPT1_Iin", "MPPT2_Iin"], "combine": "sum", "kind": "driver", "unit": "mA", "invalid": [-1]},
    "bus_power": {
        "column": ["Total_I", "Total_U"],
        "combine": "product",
        "kind": "driver",
        "unit": "mA * mV",
        "invalid": [-1],
    },
}


def at(clock: str) -> np.datetime64:
    return np.datetime64(f"2016-02-04T{clock}:00", "ns")


@pytest.fixture(scope="module")
def funcube() -> xr.Dataset:
    file = flight_data(FUNCUBE)
    specification = TelemetryFile(file=file.name, time={"column": "Satellite Date/Time UTC"}, channels=FUNCUBE_CHANNELS)
    return read_telemetry(specification, file.parent, period=FUNCUBE_PERIOD)


def bupt(name: str, **changes: Any) -> xr.Dataset:
    file = flight_data(f"bupt1/{name}.csv.gz")
    clock = {"column": "TIME", "format": "unix"}
    return read_telemetry(
        TelemetryFile(**({"file": file.name, "time": clock, "channels": BUPT_CHANNELS} | changes)), file.parent
    )


def test_funcube_has_700_minutes_and_two_pairs_of_rows_of_the_same_time(funcube: xr.Dataset):
    np.testing.assert_array_equal(funcube["time"], at("00:00") + np.arange(700) * np.timedelta64(60, "s"))
    found = {name: funcube.attrs[name] for name in ("rows_read", "duplicates", "conflicts", "unsorted")}
    assert found == {"rows_read": 702, "duplicates": 0, "conflicts": 2, "unsorted": 0}
    assert funcube.attrs["conflict_times"] == "2016-02-04T06:29:00 2016-02-04T10:34:00"
    assert float(funcube["black_chassis"].sel(time=at("06:29"))) == pytest.approx(0.82 + 273.15)


def test_funcube_has_four_downlink_gaps_filled_with_the_last_row(funcube: xr.Dataset):
    stale = (funcube["flags"] == 8).all("channel").to_numpy()
    times = funcube["time"].to_numpy()
    starts = times[1:][stale[1:] & ~stale[:-1]]
    ends = times[:-1][stale[:-1] & ~stale[1:]]
    assert list(zip(starts, ends, strict=True)) == [(at(first), at(last)) for first, last in FUNCUBE_GAPS]
    assert stale.sum() == 20 + 14 + 20 + 38
    assert not funcube["flags"].to_numpy()[~stale].any()
    (record,) = (record for record in quality_table(funcube) if record.channel == "panels_mean")
    assert record.detail == (
        "4 runs of samples: 20 from 2016-02-04T00:24:00, 14 from 2016-02-04T02:28:00, "
        "20 from 2016-02-04T04:26:00, 38 from 2016-02-04T08:13:00"
    )


def test_funcube_photo_current_is_bridged_with_the_eclipses_of_another_orbit(funcube: xr.Dataset):
    times = at("00:00") + np.arange(0, 699 * 60, 30) * np.timedelta64(1, "s")
    current = driver_series(funcube, "photo_current", times)

    def filled(first: str, last: str) -> np.ndarray:
        return current[(times >= at(first)) & (times <= at(last))]

    # Two gaps lie in sunlight; the spacecraft enters eclipse in one and leaves it in another.
    for sunlit in (("00:24", "00:43"), ("08:13", "08:50"), ("02:28", "02:30"), ("04:40", "04:45")):
        assert filled(*sunlit).min() > 0.2
    for eclipse in (("02:34", "02:41"), ("04:26", "04:36")):
        assert filled(*eclipse).max() < 0.01


def test_two_orbits_of_funcube_are_a_window(funcube: xr.Dataset):
    window = select_window(funcube, Window(start="2016-02-04T01:37:00", orbits=2))
    assert window.sizes["time"] == 195
    assert int((window["flags"].sel(channel="panels_mean") == 8).sum()) == 14 + 20


@pytest.mark.parametrize(
    ("name", "rows", "findings"),
    [
        (BUPT[0], 16930, {}),
        (BUPT[1], 16923, {}),
        (BUPT[2], 16632, {("sun", "invalid_marker"): 2, ("bus_power", "invalid_marker"): 2}),
        (BUPT[3], 16747, {("", "conflicts"): 2, ("", "gaps"): 1}),
    ],
)
def test_bupt_holds_whole_degrees_for_minutes_and_no_row_of_it_is_stale(name: str, rows: int, findings: dict):
    dataset = bupt(name)
    assert dataset.attrs["rows_read"] == rows
    assert dataset.attrs["sampling_interval_s"] == 1.0
    assert {(record.channel, record.finding): record.samples for record in quality_table(dataset)} == findings
    constant = np.diff(np.flatnonzero(np.diff(dataset["payload"].to_numpy(), prepend=np.nan, append=np.nan) != 0))
    assert constant.max() > 60


def test_a_bupt_file_is_read_in_less_than_a_second():
    bupt(BUPT[1])
    start = time.perf_counter()
    bupt(BUPT[1], average="30 s")
    assert time.perf_counter() - start < 1.0


def test_minute_means_of_bupt_are_means_of_its_seconds():
    seconds, minutes = bupt(BUPT[1]), bupt(BUPT[1], average="60 s")
    assert minutes.sizes["time"] == 283
    half = np.timedelta64(30, "s")
    for k in (1, 100, 250):
        centre = minutes["time"].to_numpy()[k]
        block = seconds.sel(time=slice(centre - half, centre + half - np.timedelta64(1, "ns")))
        assert block.sizes["time"] == 60
        for name in BUPT_CHANNELS:
            assert float(minutes[name][k]) == pytest.approx(float(block[name].mean()), rel=1e-12)
