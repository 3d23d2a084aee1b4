"""Environments and times that several tests use, and where the flight data lie."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from flightcal.environment.geometry import geometry_of
from flightcal.environment.orbit import local_time_to_raan
from flightcal.scenario import Environment

EPOCH = np.datetime64("2024-03-20T03:06:00", "ns")
"""March equinox of 2024, so the Sun is at right ascension and declination 0 (Astronomical Almanac)."""


def environment(orbit=None, **more) -> Environment:
    return Environment.model_validate({"orbit": orbit, **more} if orbit else more)


def circular(altitude="693 km", inclination="98.18 deg", epoch=EPOCH, **more) -> dict:
    node = {} if {"ltan", "raan"} & more.keys() else {"raan": "0 deg"}
    return {"altitude": altitude, "inclination": inclination, "epoch": str(epoch), **node, **more}


def seconds_after(start, seconds) -> np.ndarray:
    return start + np.round(np.asarray(seconds) * 1e9).astype("timedelta64[ns]")


def beta_angle(scene: Environment, times: np.ndarray) -> np.ndarray:
    """Angle of the Sun above the orbit plane, [T] rad, positive on the side of the angular momentum."""
    at = geometry_of(scene)(times)
    momentum = np.cross(at.position, at.velocity)
    height = np.sum(momentum * at.sun, axis=-1)
    return np.arcsin(height / np.linalg.norm(momentum, axis=-1) / np.linalg.norm(at.sun, axis=-1))


def raan_to_local_time(raan: float, epoch: np.datetime64) -> float:
    """Mean local solar time, hours, of a node at `raan` rad."""
    return float(((raan - local_time_to_raan("00:00", epoch)) % (2 * np.pi)) * 12 / np.pi)


def random_units(rng, *shape) -> np.ndarray:
    vectors = rng.normal(size=(*shape, 3))
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def reference_data(*parts: str) -> Path:
    """A file of the flight data and reference results that are kept outside the repository."""
    beside = Path(__file__).resolve().parents[2] / ".." / "shared" / "data"
    path = Path(os.environ.get("FLIGHTCAL_DATA", beside), *parts)
    if not path.exists():
        pytest.skip(f"no {'/'.join(parts)} in ../shared/data or FLIGHTCAL_DATA")
    return path
