"""CSV files of samples in time: positions and quaternions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from ..errors import OrbitError
from ._time import Floats, Times


def read_samples(path: Path, columns: tuple[str, ...], place: str, at_least: int) -> tuple[Times, Floats]:
    """Times [T], strictly increasing, and the values of `columns` [T, K] of a CSV file with a column `time`.

    place: what the error message begins with. Raises OrbitError when the file is not so.
    """
    try:
        table = pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise OrbitError(f"{place}: {error}") from None
    missing = [name for name in ("time", *columns) if name not in table.columns]
    if missing:
        raise OrbitError(f"{place}: found columns {list(table.columns)}, expected also {missing}")
    try:
        stamps = pd.to_datetime(table["time"], format="ISO8601", utc=True)
        times = stamps.dt.tz_localize(None).to_numpy("datetime64[ns]")
        values = table[list(columns)].to_numpy(np.float64)
    except ValueError as error:
        raise OrbitError(f"{place}: {error}") from None
    if len(times) < at_least:
        raise OrbitError(f"{place}: found {len(times)} samples, expected at least {at_least}")
    wrong = ~np.isfinite(values).all(axis=1) | np.isnat(times)
    wrong[1:] |= ~(np.diff(times) > np.timedelta64(0, "ns"))
    if wrong.any():
        line = np.argmax(wrong) + 2
        raise OrbitError(f"{place}: line {line}: expected finite numbers and a time after the line before")
    return times, values


def state_of(path: Path, place: str) -> tuple[int, int]:
    """When a file was last written, and its size: what is made of it may be kept until these change.

    place: what the error message begins with. Raises OrbitError when there is no such file.
    """
    try:
        found = path.stat()
    except OSError as error:
        raise OrbitError(f"{place}: {error}") from None
    return found.st_mtime_ns, found.st_size


def within_span(at: Times, times: Times, place: str) -> None:
    """Raise OrbitError unless every time of `at` lies between the first and the last of `times`."""
    if at.size and (at.min() < times[0] or at.max() > times[-1]):
        first, last, begin, end = np.datetime_as_string([times[0], times[-1], at.min(), at.max()], unit="ms")
        raise OrbitError(f"{place}: found samples from {first} to {last}, expected them to cover {begin} to {end}")
