"""Times as arrays: UTC datetime64 to seconds and Julian dates."""

from __future__ import annotations

from datetime import datetime

import numpy as np
from numpy.typing import NDArray

Times = NDArray[np.datetime64]
"""UTC times, datetime64 [T]."""
Floats = NDArray[np.float64]
"""Float array; its shape and unit are in the docstring that uses it."""

J2000 = np.datetime64("2000-01-01T12:00:00", "ns")
_J2000_JULIAN_DATE = 2451545.0
SECONDS_PER_DAY = 86400.0
_TT_MINUS_UTC = 69.184
"""s, since 2017; it was 32 s in 1961-72. The difference moves the Sun by less than 0.0005 deg."""


def seconds_since(times: Times, origin: np.datetime64 | Times) -> Floats:
    """Seconds from `origin`, one or [T], to `times` [T] (leap seconds are not counted, as in every datetime64)."""
    elapsed: Floats = (times - origin) / np.timedelta64(1, "s")
    return elapsed


def julian_dates(times: Times) -> tuple[float, Floats]:
    """UTC Julian date in two parts for precision: a constant and days after it [T]."""
    return _J2000_JULIAN_DATE, seconds_since(times, J2000) / SECONDS_PER_DAY


def terrestrial_julian_dates(times: Times) -> tuple[float, Floats]:
    """Terrestrial-time Julian date in two parts, good to 40 s from 1961 on; see `_TT_MINUS_UTC`."""
    whole, days = julian_dates(times)
    return whole, days + _TT_MINUS_UTC / SECONDS_PER_DAY


def seconds_later(origin: np.datetime64, seconds: Floats) -> Times:
    """`origin` plus `seconds` [T], rounded to nanoseconds."""
    return origin.astype("datetime64[ns]") + np.round(seconds * 1e9).astype("timedelta64[ns]")


def timespan(seconds: float) -> np.timedelta64:
    """So many seconds, rounded to nanoseconds."""
    return np.timedelta64(round(seconds * 1e9), "ns")


def as_datetime(time: np.datetime64) -> datetime:
    """A time as a scenario's blocks hold it, to the microsecond."""
    found: datetime = time.astype("datetime64[us]").item()
    return found
