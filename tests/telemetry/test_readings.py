"""Files with a row for each reading: time, name, value."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from flightcal.errors import TelemetryError
from flightcal.telemetry import detect, quality_table, read_telemetry

from .files import seconds, specification, text

CHANNELS: dict[str, Any] = {
    "battery": {"column": "TM.T_BAT", "kind": "temperature", "unit": "degC"},
    "camera": {"column": "TM.T_CAM", "kind": "temperature", "unit": "K"},
    "heater": {"column": "TM.HTR", "kind": "status"},
    "power": {"column": ["TM.U", "TM.I"], "combine": "product", "kind": "driver", "unit": "V * A"},
}
READINGS = {"name": "parameter", "value": "value"}


def rows(name: str, every: float, first: float, values: list, unit: str = "") -> pd.DataFrame:
    at = text(seconds(*(first + every * np.arange(len(values)))))
    return pd.DataFrame({"time": at, "parameter": name, "value": [str(value) for value in values], "unit": unit})


def table() -> pd.DataFrame:
    return pd.concat(
        [
            rows("TM.T_BAT", 30.0, 3.0, [20.0 + k // 10 for k in range(40)], "degC"),
            rows("TM.T_CAM", 16.0, 1.0, (280.0 + np.sin(np.arange(75.0))).round(2).tolist(), "K"),
            rows("TM.HTR", 10.0, 5.0, ["ON" if k % 20 < 7 else "OFF" for k in range(120)]),
            rows("TM.U", 20.0, 0.0, [8.0] * 60, "V"),
            rows("TM.I", 20.0, 0.0, (0.5 + 0.01 * np.arange(60)).round(2).tolist(), "A"),
            rows("TM.MODE", 400.0, 2.0, ["idle", "busy", "idle"]),
        ]
    ).sort_values("time", kind="stable")


def written(folder: Path, rows: pd.DataFrame) -> Path:
    rows.to_csv(folder / "data.csv", index=False)
    return folder / "data.csv"


def read(folder: Path, rows: pd.DataFrame, channels: dict[str, Any] = CHANNELS) -> xr.Dataset:
    written(folder, rows)
    return read_telemetry(specification(channels, readings=READINGS), folder)


def test_each_channel_has_its_readings_and_their_times(tmp_path: Path):
    dataset = read(tmp_path, table())
    counts = {name: int(dataset[name].notnull().sum()) for name in CHANNELS}
    assert counts == {"battery": 40, "camera": 75, "heater": 120, "power": 60}
    battery = dataset["battery"].dropna("time")
    np.testing.assert_array_equal(battery["time"], seconds(*(3.0 + 30.0 * np.arange(40))))
    assert battery.values[[0, -1]] == pytest.approx([293.15, 296.15])
    assert dataset["heater"].dropna("time").values[:8].tolist() == [1.0] * 7 + [0.0]
    assert dataset["power"].dropna("time").values[2] == pytest.approx(8.0 * 0.52)
    # That a channel's rows are equal, or lie apart from those of others, is nothing wrong.
    assert quality_table(dataset) == ()


def test_rows_that_come_again_or_out_of_order_are_told_by_channel(tmp_path: Path):
    rows = table()
    dataset = read(tmp_path, pd.concat([rows, rows[rows["parameter"] == "TM.T_BAT"][:5]]))
    found = [(record.finding, record.samples, record.detail) for record in quality_table(dataset)]
    assert found == [
        ("duplicates", 5, "packet 'battery': rows that repeat a row of the same time; dropped"),
        ("unsorted", 5, "packet 'battery': rows after a row of a later time; sorted"),
    ]


@pytest.mark.parametrize(
    ("column", "message"),
    [
        ("TM.T_BATT", "data.csv: column 'parameter': found no 'TM.T_BATT'; nearest: 'TM.T_BAT'"),
        ("TM.T_BAT_A", "data.csv: column 'parameter': found no 'TM.T_BAT_A'; nearest: 'TM.T_BAT'"),
        (["TM.T_BAT", "TM.U"], "data.csv: found no time that 'TM.T_BAT', 'TM.U' share"),
        ("TM.MODE", "data.csv: line 5: channel 'battery', column 'TM.MODE': found 'idle'"),
    ],
)
def test_a_reading_that_is_none_is_told(tmp_path: Path, column: str | list[str], message: str):
    channel = CHANNELS["battery"] | {"column": column} | ({"combine": "mean"} if isinstance(column, list) else {})
    with pytest.raises(TelemetryError) as caught:
        read(tmp_path, table(), {"battery": channel})
    assert str(caught.value).startswith(message)


def test_all_readings_that_are_missing_are_told(tmp_path: Path):
    wrong = {name: CHANNELS[name] | {"column": f"{CHANNELS[name]['column']}_X"} for name in ("battery", "camera")}
    with pytest.raises(TelemetryError) as caught:
        read(tmp_path, table(), wrong)
    assert str(caught.value) == (
        "2 things are wrong with the telemetry:\n"
        "  data.csv: column 'parameter': found no 'TM.T_BAT_X'; nearest: 'TM.T_BAT'\n"
        "  data.csv: column 'parameter': found no 'TM.T_CAM_X'; nearest: 'TM.T_CAM'"
    )


def test_they_are_found_with_units_of_their_own_and_the_modes(tmp_path: Path):
    (found,) = detect([written(tmp_path, table())])
    assert found.readings is not None
    assert (found.readings.name, found.readings.value) == (("parameter",), "value")
    assert {column.name: (column.kind, column.unit) for column in found.columns} == {
        "TM.T_BAT": ("temperature", "degC"),
        "TM.T_CAM": ("temperature", "K"),
        "TM.HTR": ("status", None),
        "TM.U": ("driver", "V"),
        "TM.I": ("driver", "A"),
    }
    assert found.modes is not None
    assert (found.modes.column, found.modes.names) == ("TM.MODE", ("idle", "busy", "idle"))


def test_a_table_of_all_channels_beside_a_name_is_no_table_of_readings(tmp_path: Path):
    wide = pd.DataFrame({"time": text(seconds(*(60.0 * np.arange(40)))), "sensor name": ["A"] * 40})
    wide["value [degC]"] = np.linspace(0.0, 9.0, 40)
    (found,) = detect([written(tmp_path, wide)])
    assert found.readings is None
    assert [column.name for column in found.columns] == ["value [degC]"]


@pytest.mark.parametrize("count", [2, 3, 5])
def test_parameters_may_have_all_their_times_in_common(tmp_path: Path, count: int):
    names = ["TM.T_BAT", "TM.T_CAM", "TM.T_OBC", "TM.T_PX", "TM.T_PY"][:count]
    each = [rows(name, 60.0, 0.0, (20.0 + np.arange(30) % 7).tolist(), "degC") for name in names]
    together = pd.concat(each).sort_values("time", kind="stable")
    (found,) = detect([written(tmp_path, together)])
    assert (found.clock, [column.name for column in found.columns]) == (("time",), names)


def of_two_columns(in_turns: bool) -> pd.DataFrame:
    """Readings of three subsystems, each of which has a `temp`."""
    times = text(seconds(*(60.0 * np.arange(30))))
    parts = [
        pd.DataFrame({"time": times, "sat": "S1", "subsystem": system, "field": field, "value": value})
        for system, field, value in (
            ("EPS", "temp", [str(20 + k % 5) for k in range(30)]),
            ("EPS", "heater", ["true" if k % 3 else "false" for k in range(30)]),
            ("OBC", "temp", [str(30 + k % 7) for k in range(30)]),
        )
    ]
    rows = pd.concat(parts)
    return rows.sort_values("time", kind="stable") if in_turns else rows


@pytest.mark.parametrize("in_turns", [True, False])
def test_a_name_may_stand_in_two_columns(tmp_path: Path, in_turns: bool):
    rows = of_two_columns(in_turns)
    (found,) = detect([written(tmp_path, rows)])
    assert found.readings is not None
    assert found.readings.name == ("subsystem", "field")
    assert {column.name: column.kind for column in found.columns} == {
        "EPS temp": "temperature", "EPS heater": "status", "OBC temp": "temperature",
    }  # fmt: skip
    channels = {
        "eps": {"column": "EPS temp", "kind": "temperature", "unit": "degC"},
        "heater": {"column": "EPS heater", "kind": "status"},
        "obc": {"column": "OBC temp", "kind": "temperature", "unit": "degC"},
    }
    dataset = read_telemetry(specification(channels, readings=found.readings), tmp_path)
    np.testing.assert_allclose(dataset["eps"], 293.15 + np.arange(30) % 5)
    np.testing.assert_allclose(dataset["obc"], 303.15 + np.arange(30) % 7)
    np.testing.assert_array_equal(dataset["heater"], np.arange(30) % 3 > 0)
    assert quality_table(dataset) == ()


def test_readings_that_are_marked_invalid_are_not_used(tmp_path: Path):
    rows = of_two_columns(in_turns=True)
    rows["quality"] = ["BAD" if (name, k) == ("OBC", 4) else "GOOD" for k, name in enumerate(rows["subsystem"])]
    bad = np.flatnonzero(rows["subsystem"] == "OBC")[::5]
    rows.iloc[bad, list(rows).index("quality")] = "BAD"
    (found,) = detect([written(tmp_path, rows)])
    assert found.valid_where == {"quality": "GOOD"}
    channels = {name: {"column": f"{name} temp", "kind": "temperature", "unit": "degC"} for name in ("EPS", "OBC")}
    settings = specification(channels, readings=found.readings, valid_where=found.valid_where)
    dataset = read_telemetry(settings, tmp_path)
    assert dataset["EPS"].notnull().all()
    np.testing.assert_array_equal(dataset["OBC"].isnull(), np.arange(30) % 5 == 0)
    assert [(record.channel, record.finding, record.samples) for record in quality_table(dataset)] == [
        ("OBC", "invalid_marker", 6)
    ]


def test_readings_may_come_in_segments_of_one_channel_each(tmp_path: Path):
    """As data sets of labelled segments have them: each a channel for some time, those of other channels beside it."""
    times, segments = seconds(*(60.0 * np.arange(120))), []
    for start in range(0, 120, 40):
        for name, level in (("CADC0872", 20.0), ("CADC0873", 5.0)):
            part = pd.DataFrame({"timestamp": text(times[start : start + 40]), "channel": name})
            part["value"], part["segment"], part["label"] = level + np.arange(40) % 7, len(segments), "anomaly"
            segments.append(part)
    (found,) = detect([written(tmp_path, pd.concat(segments))])
    assert found.readings is not None
    assert (found.readings.name, found.readings.value) == (("channel",), "value")
    assert [column.name for column in found.columns] == ["CADC0872", "CADC0873"]
