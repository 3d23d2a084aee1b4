from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightcal.errors import TelemetryError

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
    "unix": ["", "noon", "2024-03-01T12:00:00", "inf", "-1e12", "1709294400000"],
    "year-doy": ["", "noon", "2024-03-01T12:00:00", "2023-366", "2024-000", "2024-061T24:00", "2024-061T12:60"],
}
INSTANTS = st.integers(-300_000_000, 4_000_000_000).flatmap(
    lambda second: st.integers(0, 999).map(lambda milli: np.datetime64(second * 1000 + milli, "ms"))
)


def parsed(folder: Path, written: str, cell: str) -> np.datetime64:
    """The time that `cell` stands for, in a file with an earlier time of the same kind."""
    earlier = "1577880000" if written == "unix" else cell.replace("2024", "2020")
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
        ("year-doy", "2024-061", NOON - np.timedelta64(12, "h")),
        ("year-doy", "2024-366T00:00:00", np.datetime64("2024-12-31", "ns")),
    ],
)
def test_every_way_of_writing_a_time_is_read(tmp_path: Path, written: str, cell: str, expected: np.datetime64):
    assert parsed(tmp_path, written, cell) == expected


@pytest.mark.parametrize(("written", "cell"), [(written, cell) for written in NO_TIMES for cell in NO_TIMES[written]])
def test_what_is_no_time_is_an_error_at_its_line(tmp_path: Path, written: str, cell: str):
    good = {"iso8601": "2024-03-01T12:00:00", "unix": "1709294400", "year-doy": "2024-061T12:00:00"}[written]
    table = f"time,x\n{good},1\n{good[:-1]}1,2\n{cell},3\n"
    with pytest.raises(TelemetryError, match=r"^data\.csv: line 4: found (no time|the time '.+'), expected "):
        read(
            tmp_path,
            table,
            channels={"x": {"column": "x", "kind": "driver"}},
            time={"column": "time", "format": written},
        )


@settings(deadline=None)
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
