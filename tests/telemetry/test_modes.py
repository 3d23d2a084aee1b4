"""Columns that tell the satellite's mode."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from flightcal.telemetry import FoundModes, detect

from .files import seconds, text

TIMES = seconds(*(60.0 * np.arange(8)))


def modes_of(folder: Path, *tables: pd.DataFrame) -> FoundModes | None:
    for k, table in enumerate(tables):
        table.to_csv(folder / f"{k}.csv", index=False)
    (found,) = detect([folder / f"{k}.csv" for k in range(len(tables))])
    return found.modes


def table_of(name: str, cells: list, times: np.ndarray = TIMES) -> pd.DataFrame:
    return pd.DataFrame({"UTC": text(times), "TT_BAT": np.linspace(0, 9, len(cells)), name: cells})


@pytest.mark.parametrize("name", ["mode", "ADCS_MODE", "OBC Mode", "opMode", "modes.id"])
@pytest.mark.parametrize("cells", [["safe"] * 3 + ["nominal"] * 5, [0, 0, 0, 4, 4, 4, 4, 4]], ids=["words", "numbers"])
def test_a_column_of_modes_is_found_with_its_changes(tmp_path: Path, name: str, cells: list):
    found = modes_of(tmp_path, table_of(name, cells))
    assert found is not None
    assert found.column == name
    start = TIMES[0].astype("datetime64[s]").astype(float)
    assert [(change.at - start, change.within) for change in found.changes] == [(0.0, 0.0), (150.0, 60.0)]
    assert tuple(change.name for change in found.changes) in (("safe", "nominal"), ("mode 0", "mode 4"))


@pytest.mark.parametrize(
    ("name", "cells"),
    [
        ("mode", ["safe"] * 8),  # which tells nothing
        ("remark", ["safe"] * 4 + ["nominal"] * 4),
        ("heater_mode", ["ON"] * 4 + ["OFF"] * 4),
        ("heater_mode", [0, 0, 0, 0, 1, 1, 1, 1]),
        ("mode", ["a", "b"] * 4),  # with every sample
        ("mode current [mA]", [0.5, 0.5, 0.5, 7.5, 7.5, 7.5, 7.5, 7.5]),
    ],
)
def test_other_columns_tell_no_mode(tmp_path: Path, name: str, cells: list):
    assert modes_of(tmp_path, table_of(name, cells)) is None


def test_a_file_of_modes_alone_may_have_a_row_for_each_change(tmp_path: Path):
    found = modes_of(tmp_path, table_of("OBC mode", ["safe", "nominal"] * 4).drop(columns="TT_BAT"))
    assert found is not None
    assert tuple(change.name for change in found.changes) == ("safe", "nominal") * 4
    assert not any(change.within for change in found.changes)


def test_changes_go_on_from_file_to_file_in_any_order_and_empty_cells_change_nothing(tmp_path: Path):
    later = table_of("mode", ["nominal", "", "nominal", "nominal", "safe", "safe"], TIMES[:6] + np.timedelta64(8, "m"))
    found = modes_of(tmp_path, later, table_of("mode", ["safe"] * 2 + ["nominal"] * 6))
    assert found is not None
    assert tuple(change.name for change in found.changes) == ("safe", "nominal", "safe")
    start = TIMES[0].astype("datetime64[s]").astype(float)
    assert [(change.at - start, change.within) for change in found.changes] == [(0.0, 0.0), (90.0, 60.0), (690.0, 60.0)]


LOG = {"activity": ["IMG", "DL", "IMG"], "orbit": [3, 3, 4]}


@pytest.mark.parametrize(
    ("starts", "ends"), [("start_utc", "end_utc"), ("AOS", "LOS"), ("begin", "stop"), ("TIME_FROM", "TIME_UNTIL")]
)
@pytest.mark.parametrize("is_reversed", [False, True])
def test_a_log_of_activities_tells_modes(tmp_path: Path, starts: str, ends: str, is_reversed: bool):
    first = TIMES[:3] + np.timedelta64(600, "s") * np.arange(3)
    last = first + np.array([120, 600, 60]).astype("timedelta64[s]")
    last[1] = first[2]  # one activity follows another at once
    table = pd.DataFrame({"activity": LOG["activity"], starts: text(first), ends: text(last), "orbit": LOG["orbit"]})
    if is_reversed:
        table = table[[ends, "orbit", "activity", starts]].iloc[::-1]
    found = modes_of(tmp_path, table)
    assert found is not None
    assert (found.column, found.of_activities, found.sampled) == ("activity", True, False)
    expected = [(first[0], "IMG"), (last[0], "nominal"), (first[1], "DL"), (first[2], "IMG"), (last[2], "nominal")]
    assert list(zip(found.times.astype("datetime64[ns]").tolist(), found.names, strict=True)) == [
        (at.astype("datetime64[ns]").item(), name) for at, name in expected
    ]


@pytest.mark.parametrize("last", [[120, 1300, 60], [120, -5, 60]], ids=["that overlap", "that end before they start"])
def test_activities_are_no_modes(tmp_path: Path, last: list[int]):
    first = TIMES[:3] + np.timedelta64(600, "s") * np.arange(3)
    table = pd.DataFrame({"start": text(first), "end": text(first + np.array(last).astype("timedelta64[s]")), **LOG})
    assert modes_of(tmp_path, table) is None
