from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flightcal.errors import TelemetryError
from flightcal.scenario import TimeColumn
from flightcal.telemetry import quality_table

from .files import read

NOON = np.datetime64("2024-03-01T12:00:00", "ns")
HALF = np.timedelta64(500, "ms")
NO_TIMES = {
    "iso8601": [
        "",
        "noon",
        "12:00:00",
        "2024-02-30T00:00:00",
        "2024-03-01T24:01:00",
        "2024-061T12:00:00",
        "1709294400",
    ],
    "unix-ms": ["", "noon", "2024-03-01T12:00:00", "inf", "1709294400", "1709294400000000"],
    "unix": ["", "noon", "2024-03-01T12:00:00", "inf", "-1e12", "1709294400000"],
    "year-doy": [
        "",
        "noon",
        "2024-03-01T12:00:00",
        "2023-366",
        "2024-000",
        "2024-061T24:00",
        "2024-061T12:60",
        "20240301",
        "2024-03-01 12:00:00",
        "2024/03/01 12:00",
        "2024-03-01-12-00-00",
        "2024 03 01 12 00 00",
        "366/2023 12:00:00",
        "2024061250000",
        "24061.500000",
    ],
    "decimal-doy": ["", "noon", "2024-061T12:00:00", "24000.5", "23366.5", "60370.5", "24061.5.5"],
}
INSTANTS = st.integers(-300_000_000, 4_000_000_000).flatmap(
    lambda second: st.integers(0, 999).map(lambda milli: np.datetime64(second * 1000 + milli, "ms"))
)


def parsed(folder: Path, written: str, cell: str) -> np.datetime64:
    """The time that `cell` stands for, in a file with an earlier time of the same kind."""
    digits = {"unix": 0, "unix-ms": 3, "unix-us": 6, "unix-ns": 9}
    earlier = cell.replace("2024", "2020").replace("24-", "20-").replace("24/", "20/").replace("24061", "20061", 1)
    earlier = f"315532800{'0' * digits[written]}" if written in digits else earlier.replace("98-001", "97-001")
    channels = {"x": {"column": "x", "kind": "driver"}}
    table = f'time,x\n"{earlier}",1\n"{cell}",2\n'
    return read(folder, table, channels=channels, time={"column": "time", "format": written})["time"].to_numpy()[1]


@pytest.mark.parametrize(
    ("written", "cell", "expected"),
    [
        ("iso8601", "2024-03-01T12:00:00", NOON),
        ("iso8601", "2024-03-01 12:00:00", NOON),
        ("iso8601", " 2024-03-01T12:00:00Z ", NOON),
        ("iso8601", "2024-03-01T12:00Z", NOON),
        ("iso8601", "20240301T120000Z", NOON),
        ("iso8601", "2024-03-01 12:00:00 UTC", NOON),
        ("iso8601", "2024/03/01 12:00:00", NOON),
        ("iso8601", "2024-03-01T13:00:00+01:00", NOON),
        ("iso8601", "2024-03-01T17:30:00+0530", NOON),
        ("iso8601", "2024-03-01T07:00:00-05:00", NOON),
        ("iso8601", "2024-03-01T12:00:00.5Z", NOON + HALF),
        ("iso8601", "2024-03-01T12:00:00.500000", NOON + HALF),
        ("iso8601", "2024-03-01T12:00:00,5Z", NOON + HALF),
        ("iso8601", "2024-03-01T12:00:00.000000001", NOON + np.timedelta64(1, "ns")),
        ("unix", "1709294400", NOON),
        ("unix", "1709294400.5", NOON + HALF),
        ("unix", "1.7092944E9", NOON),
        ("unix", "1709294400.123456", NOON + np.timedelta64(123456, "us")),
        ("year-doy", "2024-061T12:00:00", NOON),
        ("year-doy", "2024-061T12:00:00.5Z", NOON + HALF),
        ("year-doy", "2024-061T12:00:00.123", NOON + np.timedelta64(123, "ms")),
        ("year-doy", "2024/061 12:00:00", NOON),
        ("year-doy", "2024.061.12.00.00", NOON),
        ("year-doy", "2024.061.12.00.00.5", NOON + HALF),
        ("year-doy", "2024-61T12:00", NOON),
        ("unix-ms", "1709294400500", NOON + HALF),
        ("unix-ms", "1709294400000.25", NOON + np.timedelta64(250, "us")),
        ("unix-us", "1709294400500000", NOON + HALF),
        ("unix-ns", "1709294400500000000", NOON + HALF),
        ("year-doy", "2024:061:12:00:00.500", NOON + HALF),
        ("year-doy", "2024:061:12:00:00", NOON),
        ("year-doy", "2024/061-12:00:00", NOON),
        ("year-doy", "2024/061/12:00:00.5", NOON + HALF),
        ("year-doy", "2024-061/12:00:00", NOON),
        ("year-doy", "2024-061 12:00:00,5", NOON + HALF),
        ("year-doy", "2024 061 12:00:00", NOON),
        ("year-doy", "2024-061T12:00:00+00:00", NOON),
        ("year-doy", "2024-061t12:00:00z", NOON),
        ("year-doy", "2024-061 12:00:00 UTC", NOON),
        ("year-doy", "2024-061T120000", NOON),
        ("year-doy", "2024-061 - 12:00:00", NOON),
        ("year-doy", "2024-061_12:00:00", NOON),
        ("year-doy", "2024061T12:00:00", NOON),
        ("year-doy", "2024061T120000.5", NOON + HALF),
        ("year-doy", "24-061/12:00:00", NOON),
        ("year-doy", "24/061 12:00:00", NOON),
        ("year-doy", "24061T120000", NOON),
        ("year-doy", "2024 061 12 00 00", NOON),
        ("year-doy", "2024-061-12-00-00", NOON),
        ("year-doy", "2024/061/12/00/00.5", NOON + HALF),
        ("year-doy", "2024_061_12_00_00", NOON),
        ("year-doy", "2024,061,12:00:00", NOON),
        ("year-doy", "2024-061 // 12:00:00", NOON),
        ("year-doy", "2024:061:12:00:00:500", NOON + HALF),
        ("year-doy", "061/2024 12:00:00", NOON),
        ("year-doy", "061-2024T12:00:00.5", NOON + HALF),
        ("year-doy", "2024D061T12:00:00", NOON),
        ("year-doy", "2024 DOY 061 12:00", NOON),
        ("year-doy", "2024-061T12h00m00.5s", NOON + HALF),
        ("year-doy", "2024061120000", NOON),
        ("year-doy", "2024061120000.5", NOON + HALF),
        ("year-doy", "24061120000", NOON),
        ("year-doy", "2024061.120000", NOON),
        ("year-doy", "2024061.120000500", NOON + HALF),
        ("decimal-doy", "24061.50000000", NOON),
        ("decimal-doy", "2024061.5", NOON),
        ("decimal-doy", "2024-061.5", NOON),
        ("decimal-doy", "2024/61.5", NOON),
        ("decimal-doy", "24061.50000579", NOON + np.timedelta64(500_256, "us")),
        ("decimal-doy", "24061", NOON - np.timedelta64(12, "h")),
        ("unix", "0x65E1C340", NOON),
        ("%d.%m.%Y %H:%M:%S", "01.03.2024 12:00:00", NOON),
        ("%m/%d/%Y %I:%M %p", "3/1/2024 12:00 PM", NOON),
        ("%d-%b-%Y %H:%M:%S.%f", "01-Mar-2024 12:00:00.5", NOON + HALF),
        ("%Y%m%d_%H%M%S", "20240301_120000", NOON),
        ("%H:%M:%S %j %Y", "12:00:00 061 2024", NOON),
        ("%Y-%m-%d %H:%M:%S%z", "2024-03-01 13:00:00+0100", NOON),
        ("year-doy", "98-001T00:00:00", np.datetime64("1998-01-01", "ns")),
        ("year-doy", "2024-061", NOON - np.timedelta64(12, "h")),
        ("year-doy", "2024-366T00:00:00", np.datetime64("2024-12-31", "ns")),
    ],
)
def test_every_way_of_writing_a_time_is_read(tmp_path: Path, written: str, cell: str, expected: np.datetime64):
    assert parsed(tmp_path, written, cell) == expected


@pytest.mark.parametrize(("written", "cell"), [(written, cell) for written in NO_TIMES for cell in NO_TIMES[written]])
def test_what_is_no_time_is_an_error_at_its_line(tmp_path: Path, written: str, cell: str):
    good = {
        "iso8601": "2024-03-01T12:00:00",
        "unix": "1709294400",
        "unix-ms": "1709294400000",
        "year-doy": "2024-061T12:00:00",
        "decimal-doy": "24061.50",
    }[written]
    table = f'time,x\n{good},1\n{good[:-1]}1,2\n"{cell}",3\n'
    with pytest.raises(TelemetryError, match=r"^data\.csv: line 4: found (no time|the time '.+'), expected "):
        read(
            tmp_path,
            table,
            channels={"x": {"column": "x", "kind": "driver"}},
            time={"column": "time", "format": written},
        )


@given(instants=st.lists(INSTANTS, min_size=2, max_size=20, unique=True))
@pytest.mark.parametrize("written", ["iso8601", "unix", "year-doy"])
def test_times_survive_the_way_through_every_format(tmp_path_factory, written: str, instants: list[np.datetime64]):
    def write(instant: np.datetime64) -> str:
        iso = str(instant)
        if written == "unix":
            return f"{instant.astype(np.int64) / 1000:.3f}"
        day = (instant.astype("datetime64[D]") - instant.astype("datetime64[Y]").astype("datetime64[D]")).astype(
            int
        ) + 1
        return iso if written == "iso8601" else f"{iso[:4]}-{day:03d}{iso[10:]}"

    table = "time,x\n" + "".join(f"{write(instant)},{i}\n" for i, instant in enumerate(instants))
    channels = {"x": {"column": "x", "kind": "driver"}}
    folder = tmp_path_factory.mktemp("times")
    dataset = read(folder, table, channels=channels, time={"column": "time", "format": written})
    np.testing.assert_array_equal(dataset["time"], np.sort(np.array(instants, dtype="datetime64[ns]")))


@pytest.mark.parametrize(
    ("written", "cells"),
    [
        ("iso8601", {"DATE": "2024-03-01", "TIME": "12:00:00.5"}),
        ("year-doy", {"DATE": "2024-061", "TIME": "12:00:00.5"}),
        ("year-doy", {"YEAR": "2024", "DOY": "61", "UTC": "12:00:00.5"}),
        ("year-doy", {"YEAR": "2024", "DOY": "61", "H": "12", "M": "0", "S": "0.5"}),
        ("year-doy", {"YEAR": "24", "DOY": "061", "H": "12", "M": "00", "S": "00.5"}),
        ("clock", {"coarse": "5227200", "fine": "128"}),
    ],
)
def test_a_time_in_several_columns_is_put_together(tmp_path: Path, written: str, cells: dict[str, str]):
    clock = {"epoch": "2024-01-01", "fine": 256} if written == "clock" else {}
    rows = "".join(f"{','.join(cells.values()).replace('.5', tail)},{k}\n" for k, tail in enumerate((".5", ".75")))
    if written == "clock":
        rows += "5227200,192,2\n"
    dataset = read(
        tmp_path,
        f"{','.join(cells)},x\n{rows}",
        channels={"x": {"column": "x", "kind": "driver"}},
        time={"column": list(cells), "format": written} | clock,
    )
    np.testing.assert_array_equal(dataset["time"], [NOON + HALF, NOON + HALF * 1.5])


def test_rows_with_a_mark_in_the_place_of_a_time_are_dropped_and_counted(tmp_path: Path):
    rows = "0x00000000,1\n2024-03-01T12:00:00,2\n,4\n0xFFFEFFFE,8\n2024-03-01T12:00:01,16\nnever,32\n"
    channels = {"x": {"column": "x", "kind": "driver"}}
    time = {"column": "t", "invalid": ["0x00000000", "0xFFFEFFFE", ""]}
    with pytest.raises(TelemetryError, match=r"^data\.csv: line 7: found the time 'never', expected ISO 8601"):
        read(tmp_path, f"t,x\n{rows}", channels=channels, time=time)
    dataset = read(tmp_path, f"t,x\n{rows[:-9]}", channels=channels, time=time)
    np.testing.assert_array_equal(dataset["x"], [2, 16])
    record = quality_table(dataset)[0]
    assert (record.finding, record.samples, record.share) == ("untimed", 3, 3 / 5)
    with pytest.raises(TelemetryError, match=r"^data\.csv: line 2: found the time '0x00000000'"):
        read(tmp_path, f"t,x\n{rows}", channels=channels, time={"column": "t"})
    with pytest.raises(TelemetryError, match=r"^data\.csv: found no row with a time, all are marked invalid"):
        read(tmp_path, "t,x\nnone,1\nnone,2\n", channels=channels, time={"column": "t", "invalid": "none"})


def test_a_pattern_that_does_not_fit_is_told_with_an_example(tmp_path: Path):
    with pytest.raises(TelemetryError) as caught:
        read(
            tmp_path,
            "time,x\n01.03.2024 12:00:00,1\n31.02.2024 12:00:00,2\n",
            channels={"x": {"column": "x", "kind": "driver"}},
            time={"column": "time", "format": "%d.%m.%Y %H:%M:%S"},
        )
    assert str(caught.value) == (
        "data.csv: line 3: found the time '31.02.2024 12:00:00', expected '%d.%m.%Y %H:%M:%S' such as "
        "01.03.2024 12:00:00, between 1957 and 2150"
    )


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ("iso", "expected iso8601, unix, .*, or a pattern such as '%d.%m.%Y %H:%M:%S'; did you mean 'iso8601'"),
        ("%d.%m. %H:%M", r"expected a pattern with a year \(%Y\) and a day \(%m and %d, or %j\)"),
        ("%Y %Q", "expected a pattern with a year"),
    ],
)
def test_a_format_is_known_or_tells_the_day(written: str, message: str):
    with pytest.raises(ValueError, match=message):
        TimeColumn(column="t", format=written)


def clock(folder: Path, cells: list[str], **time: object) -> np.ndarray:
    """Times of a spacecraft's clock that starts with 2024."""
    rows = "".join(f"{cell},{k}\n" for k, cell in enumerate(cells))
    written = {"column": "SCLK", "format": "clock", "epoch": "2024-01-01T00:00:00Z"} | time
    return read(folder, f"SCLK,x\n{rows}", channels={"x": {"column": "x", "kind": "driver"}}, time=written)[
        "time"
    ].to_numpy()


@pytest.mark.parametrize(
    ("cells", "time"),
    [
        (["0", "5227200", "5227200.5"], {}),
        (["0", "52272000", "52272005"], {"rate": "10 Hz"}),
        (["0", "342569779200", "342569811968"], {"rate": "65536 Hz"}),
        (["0", "2613600", "2613600.25"], {"rate": "0.5 Hz"}),
        (["86400", "5313600", "5313600.5"], {"epoch": "2023-12-31T00:00:00"}),
        (["0x0", "0x9F8580", "0x9f8581"], {"rate": "2 Hz", "epoch": "2024-01-01"}),
        (["0:0", "5227200:0", "5227200:32768"], {"fine": 65536}),
        (["1/0000000000.000", "1/0005227200.000", "1/0005227200.128"], {"fine": 256}),
        (["0-0", "52272000-00000", "52272005 - 0"], {"fine": 256, "rate": "10 Hz"}),
        # Days and milliseconds of the day, modified Julian dates, days of a spreadsheet
        (["24106 0", "24166 43200000", "24166 43200500"], {"epoch": "1958-01-01", "rate": "1 1/day", "fine": 86400000}),
        (["60310", "60370.5", "60370.500005787"], {"epoch": "1858-11-17", "rate": "1 1/day"}),
        (["45292", "45352.5", "45352.500005787"], {"epoch": "1899-12-30", "rate": "1 1/day"}),
        (["0", "5227200", "5227200.5"], {"epoch": "2024-01-01T01:00:00+01:00", "leap_seconds": True}),
    ],
)
def test_a_spacecraft_clock_counts_from_its_epoch_at_its_rate(tmp_path: Path, cells: list[str], time: dict):
    expected = np.array([np.datetime64("2024-01-01", "ns"), NOON, NOON + HALF])
    off = clock(tmp_path, cells, **time) - expected
    # A day with nine decimals is known to 43 microseconds.
    assert np.abs(off).max() <= np.timedelta64(43 if "." in cells[2] and "day" in str(time) else 0, "us")


def test_a_clock_that_counts_leap_seconds_is_late_by_those_since_its_epoch(tmp_path: Path):
    gps = {"epoch": "1980-01-06T00:00:00", "leap_seconds": True}
    counts = ["0", "46828799", "46828802", "1393329618"]
    expected = ["1980-01-06T00:00:00", "1981-06-30T23:59:59", "1981-07-01T00:00:01", "2024-03-01T12:00:00"]
    np.testing.assert_array_equal(clock(tmp_path, counts, **gps), np.array(expected, dtype="datetime64[ns]"))


def test_a_clock_that_cannot_be_a_time_is_an_error_with_its_epoch(tmp_path: Path):
    with pytest.raises(TelemetryError) as caught:
        clock(tmp_path, ["0", "1709294400000"])
    assert str(caught.value) == (
        "data.csv: line 3: found the time '1709294400000', expected a counter such as 762609605.5 that gives a time up "
        "to 2150 after the epoch 2024-01-01T00:00:00; format: unix-ms would read it"
    )


def test_a_clock_with_a_fine_part_is_told_what_lacks(tmp_path: Path):
    with pytest.raises(TelemetryError) as caught:
        clock(tmp_path, ["5227200:0", "5227200:32768"])
    assert str(caught.value) == (
        "data.csv: line 2: found the time '5227200:0' (and in 1 more row), expected a counter such as 762609605.5 that "
        "gives a time up to 2150 after the epoch 2024-01-01T00:00:00; 'fine' says how many counts of the fine part are "
        "one of the coarse"
    )
    for cell in ("5227200", "5227200:256", "2/5227200:0", "5227200:0:1"):
        with pytest.raises(TelemetryError) as caught:
            clock(tmp_path, ["5227200:0", cell], fine=256)
        assert str(caught.value) == (
            f"data.csv: line 3: found the time '{cell}', expected a coarse count and a fine one below 256, such as "
            "515721623:128, that give a time up to 2150"
        )


@pytest.mark.parametrize(
    ("time", "message"),
    [
        ({"format": "clock"}, "missing key 'epoch', expected the UTC time at which the clock is at zero"),
        ({"epoch": "2024-01-01T00:00:00"}, "found 'epoch' beside the format 'iso8601', expected it of a 'clock' only"),
        ({"format": "unix", "rate": "2 Hz"}, "found 'rate' beside the format 'unix', expected it of a 'clock' only"),
    ],
)
def test_an_epoch_is_that_of_a_clock(time: dict, message: str):
    with pytest.raises(ValueError, match=message):
        TimeColumn(column="t", **time)
