"""Excel workbooks: sheets, kinds of cells, and the rows that messages point to."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flightcal.errors import FlightcalError, TelemetryError
from flightcal.scenario import TelemetryFile
from flightcal.telemetry import detect, read_telemetry

from .files import CHANNELS, frame, read, specification

openpyxl = pytest.importorskip("openpyxl", reason="needs the extra 'excel'")


def write(path: Path, rows: list[list[Any]], title: str = "HK") -> None:
    book = openpyxl.Workbook()
    book.active.title = title
    for row in rows:
        book.active.append(row)
    book.save(path)


def cells(table: pd.DataFrame) -> list[list[Any]]:
    return [list(table.columns), *table.astype(object).to_numpy().tolist()]


@pytest.mark.parametrize("typed", [False, True])
def test_a_workbook_gives_what_the_same_table_gives_as_text(tmp_path: Path, typed: bool):
    table = frame(20)
    expected = read(tmp_path, table)
    if typed:
        table["time"] = pd.to_datetime(table["time"]).dt.tz_localize(None).dt.to_pydatetime()
        table["HTR"] = table["HTR"].map({0: "OFF", 1: "ON"})
    write(tmp_path / "data.xlsx", cells(table))
    xr.testing.assert_equal(read_telemetry(specification(file="data.xlsx"), tmp_path), expected)


def test_each_sheet_can_be_a_packet(tmp_path: Path):
    first, second = frame(10), frame(5, interval=100.0, seed=2)
    with pd.ExcelWriter(tmp_path / "data.xlsx") as writer:
        first.to_excel(writer, sheet_name="Thermal", index=False)
        second.to_excel(writer, sheet_name="Power", index=False)
    packets = {name: {"file": "data.xlsx", "sheet": name, "time": {"column": "time"}} for name in ("Thermal", "Power")}
    channels = {
        "battery": CHANNELS["battery"] | {"packet": "Thermal"},
        "sun": CHANNELS["sun"] | {"packet": "Power"},
    }
    dataset = read_telemetry(TelemetryFile(packets=packets, channels=channels), tmp_path)
    np.testing.assert_allclose(dataset["battery"].dropna("time"), first["TT_BAT"] + 273.15)
    np.testing.assert_allclose(dataset["sun"].dropna("time"), second["I_SA"] / 1000)


def test_rows_of_messages_are_those_that_the_spreadsheet_shows(tmp_path: Path):
    header, *rows = cells(frame(6))
    rows[4][1] = "ERR"
    write(tmp_path / "data.xlsx", [[], header, *rows[:2], [], *rows[2:], [None] * 4])
    with pytest.raises(TelemetryError, match=r"^data\.xlsx: row 8: channel 'battery', column 'TT_BAT': found 'ERR'"):
        read_telemetry(specification(file="data.xlsx"), tmp_path)
    with pytest.raises(TelemetryError, match=r"^data\.xlsx: sheet 'HK', row 8: channel 'battery'"):
        read_telemetry(specification(file="data.xlsx", sheet="HK"), tmp_path)


def test_a_title_above_the_header_is_passed_over_and_rows_keep_their_numbers(tmp_path: Path):
    header, *rows = cells(frame(6))
    write(tmp_path / "data.xlsx", [["Export"], [], ["from", "to"], header, *rows])
    dataset = read_telemetry(specification(file="data.xlsx", header=4), tmp_path)
    np.testing.assert_allclose(dataset["battery"], frame(6)["TT_BAT"] + 273.15)
    rows[1][1] = "ERR"
    write(tmp_path / "data.xlsx", [["Export"], [], ["from", "to"], header, *rows])
    with pytest.raises(TelemetryError, match=r"^data\.xlsx: row 6: channel 'battery', column 'TT_BAT': found 'ERR'"):
        read_telemetry(specification(file="data.xlsx", header=4), tmp_path)
    frame(6).to_parquet(tmp_path / "data.parquet")
    with pytest.raises(TelemetryError, match=r"^data\.parquet: found header 4, expected none: it is Parquet"):
        read_telemetry(specification(file="data.parquet", header=4), tmp_path)


def test_marks_notes_and_empty_cells_are_as_in_text(tmp_path: Path):
    header, *rows = cells(frame(8))
    rows[1][1], rows[2][1], rows[3][1], rows[5][1] = "N/A", None, -999, "#N/A"
    rows[4].append("a note beside the table")
    write(tmp_path / "data.xlsx", [header, *rows])
    battery = CHANNELS["battery"] | {"invalid": [-999]}
    dataset = read_telemetry(specification({"battery": battery}, file="data.xlsx"), tmp_path)
    np.testing.assert_array_equal(dataset["flags"].to_numpy()[:, 0], [0, 1, 1, 2, 0, 1, 0, 0])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"file": "data.xlsx", "sheet": "Power"}, "data.xlsx: found the sheets 'HK', expected 'Power' among them"),
        (
            {"file": "data.csv", "sheet": "HK"},
            "data.csv: found sheet 'HK', expected none: it is comma-separated UTF-8 text",
        ),
        ({"file": "empty.xlsx"}, "empty.xlsx: found an empty sheet, expected telemetry"),
        ({"file": "header.xlsx"}, "header.xlsx: found a header and no rows, expected telemetry"),
        (
            {"file": "text.xlsx"},
            "text.xlsx: cannot be read, expected an Excel workbook (File is not a zip file)",
        ),
        ({"file": "parquet.xlsx"}, "parquet.xlsx: found Parquet, expected an Excel workbook"),
    ],
)
def test_what_is_wrong_with_a_workbook_is_told(tmp_path: Path, changes: dict, message: str):
    table = frame(4)
    write(tmp_path / "data.xlsx", cells(table))
    write(tmp_path / "empty.xlsx", [])
    write(tmp_path / "header.xlsx", [list(table.columns)])
    table.to_csv(tmp_path / "data.csv", index=False)
    table.to_csv(tmp_path / "text.xlsx", index=False)
    table.to_parquet(tmp_path / "parquet.xlsx")
    with pytest.raises(TelemetryError) as caught:
        read_telemetry(specification(**changes), tmp_path)
    assert str(caught.value) == message


def test_without_its_extra_a_workbook_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write(tmp_path / "data.xlsx", cells(frame(4)))
    monkeypatch.setattr("flightcal.errors.find_spec", lambda module: None)
    with pytest.raises(FlightcalError) as caught:
        read_telemetry(specification(file="data.xlsx"), tmp_path)
    assert str(caught.value) == (
        "data.xlsx: found no package 'openpyxl', which it needs: pip install \"flightcal[excel]\""
    )
    assert "openpyxl" in sys.modules


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    damage=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.binary(min_size=1, max_size=3)), max_size=4),
    cut=st.floats(0, 1),
)
def test_a_damaged_workbook_gives_a_dataset_or_a_message(tmp_path: Path, damage: list, cut: float):
    if not (tmp_path / "whole.xlsx").exists():
        write(tmp_path / "whole.xlsx", cells(frame(12)))
    content = bytearray((tmp_path / "whole.xlsx").read_bytes())
    for place, junk in damage:
        start = int(place * len(content))
        content[start : start + len(junk)] = junk
    (tmp_path / "data.xlsx").write_bytes(content if cut > 0.2 else content[: int(5 * cut * len(content))])
    try:
        rows = read_telemetry(specification(file="data.xlsx"), tmp_path).attrs["rows_read"]
    except TelemetryError:
        return
    assert rows >= 2


@pytest.mark.parametrize(("pattern", "format"), [("%Y%m%d%H%M%S", "%Y%m%d%H%M%S"), ("%Y%j%H%M%S", "year-doy")])
def test_whole_numbers_can_be_times(tmp_path: Path, pattern: str, format: str):
    table = frame(20)
    expected = read(tmp_path, table)
    table["time"] = [int(time) for time in pd.to_datetime(table["time"]).dt.strftime(pattern)]
    write(tmp_path / "data.xlsx", cells(table))
    time = {"column": "time", "format": format}
    xr.testing.assert_equal(read_telemetry(specification(file="data.xlsx", time=time), tmp_path), expected)
    (found,) = detect([tmp_path / "data.xlsx"])
    assert found.time is not None
    assert found.time.format == format
