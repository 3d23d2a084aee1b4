"""Small telemetry files and specifications for the tests of this folder."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from flightcal.scenario import TelemetryFile
from flightcal.telemetry import read_telemetry

START = np.datetime64("2024-03-01T00:00:00", "ns")

CHANNELS: dict[str, Any] = {
    "battery": {"column": "TT_BAT", "kind": "temperature", "unit": "degC"},
    "sun": {"column": "I_SA", "kind": "driver", "unit": "mA"},
    "heater": {"column": "HTR", "kind": "status"},
}


def flight_data(name: str) -> Path:
    """A file of the real data beside the repository; skips the test where it is absent."""
    folder = Path(os.environ.get("FLIGHTCAL_DATA", Path(__file__).resolve().parents[2] / ".." / "shared" / "data"))
    if not (folder / name).is_file():
        pytest.skip(f"real flight data are not beside the repository: {name}")
    return folder / name


def seconds(*values: float) -> np.ndarray:
    """Times so many seconds after START."""
    return START + (np.array(values) * 1e9).round().astype("timedelta64[ns]")


def text(times: np.ndarray) -> list[str]:
    """Times as ISO 8601."""
    return [f"{time}Z" for time in np.datetime_as_string(times, unit="ms")]


def frame(rows: int, interval: float = 60.0, seed: int = 1) -> pd.DataFrame:
    """Rows whose values all change from row to row."""
    rng = np.random.default_rng(seed)
    return pd.DataFrame(
        {
            "time": text(seconds(*(interval * np.arange(rows)))),
            "TT_BAT": rng.normal(20.0, 5.0, rows).round(3),
            "I_SA": rng.uniform(0.0, 400.0, rows).round(2),
            "HTR": rng.integers(0, 2, rows),
        }
    )


def specification(channels: dict[str, Any] = CHANNELS, **changes: Any) -> TelemetryFile:
    """A specification of `data.csv`, unless changed."""
    return TelemetryFile(**({"file": "data.csv", "time": {"column": "time"}, "channels": channels} | changes))


def read(folder: Path, table: pd.DataFrame | str, period: float | None = None, **changes: Any) -> xr.Dataset:
    """Writes `table` as data.csv and reads it."""
    written = table if isinstance(table, str) else table.to_csv(index=False)
    (folder / "data.csv").write_text(written, encoding="utf-8")
    return read_telemetry(specification(**changes), folder, period=period)
