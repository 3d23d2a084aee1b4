"""Makes `scenario/template.csv`, made-up telemetry of the template's satellite to try a new scenario with.

Deliberately not flightcal's own simulator: an explicit Euler scheme, a cylindrical shadow, and numbers of the
satellite that differ from the template's, so that there is something to calibrate.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from datetime import datetime, timedelta

_STEFAN_BOLTZMANN = 5.670374419e-8  # W m^-2 K^-4, CODATA 2018
_SOLAR_CONSTANT = 1361.0  # W/m2 at one astronomical unit, Kopp & Lean 2011
_ICE_POINT = 273.15  # K

_EPOCH = datetime(2024, 3, 1)
_PERIOD = 5684.4  # s, nodal, at 500 km and 97.4 deg with J2
_INCLINATION, _LOCAL_TIME_OF_NODE = math.radians(97.4), 10.5
_BATTERY_CAPACITY, _RADIATOR_CAPACITY, _LINK = 2200.0, 1000.0, 0.6
_AREA, _ABSORPTIVITY, _EMISSIVITY = 0.08, 0.22, 0.8
_DISSIPATION, _HEATER_POWER, _ON_BELOW, _OFF_ABOVE = 10.0, 15.0, 12.0 + _ICE_POINT, 15.0 + _ICE_POINT
_NOISE = 0.1  # K

_STEP, _SAMPLING, _DURATION, _SPIN_UP = 5, 60, 8 * 3600, 12 * 3600  # s


def example_telemetry() -> str:
    """CSV text: time, battery and radiator temperature (degC) and heater status, a row a minute for eight hours."""
    noise = random.Random(1)
    lines = ["time,TT_BAT,TT_RAD,HTR_BAT"]
    for elapsed, battery, radiator, heater_on in _simulate():
        if elapsed >= 0 and elapsed % _SAMPLING == 0:
            stamp = (_EPOCH + timedelta(seconds=elapsed)).isoformat()
            measured = (temperature - _ICE_POINT + noise.gauss(0.0, _NOISE) for temperature in (battery, radiator))
            lines.append(",".join([stamp, *(f"{value:.2f}" for value in measured), str(int(heater_on))]))
    return "\n".join(lines) + "\n"


def _simulate() -> Iterator[tuple[int, float, float, bool]]:
    """Seconds since the epoch, battery and radiator in K, and whether the heater is on, at every step."""
    battery, radiator, heater_on = _ICE_POINT + 15.0, _ICE_POINT, False
    for elapsed in range(-_SPIN_UP, _DURATION + 1, _STEP):
        heater_on = battery <= _ON_BELOW if not heater_on else battery < _OFF_ABOVE
        yield elapsed, battery, radiator, heater_on
        conducted = _LINK * (battery - radiator)
        absorbed = _AREA * _ABSORPTIVITY * sunlight_on_zenith_face(elapsed)
        emitted = _STEFAN_BOLTZMANN * _AREA * _EMISSIVITY * radiator**4
        battery += _STEP * (_DISSIPATION + _HEATER_POWER * heater_on - conducted) / _BATTERY_CAPACITY
        radiator += _STEP * (absorbed + conducted - emitted) / _RADIATOR_CAPACITY


def sunlight_on_zenith_face(elapsed: float) -> float:
    """Direct solar flux, W/m2, on a face that looks away from the Earth; sun by the Astronomical Almanac's formula."""
    days = ((_EPOCH - datetime(2000, 1, 1, 12)).total_seconds() + elapsed) / 86400.0
    mean_longitude = math.radians(280.460 + 0.9856474 * days)
    anomaly = math.radians(357.528 + 0.9856003 * days)
    longitude = mean_longitude + math.radians(1.915 * math.sin(anomaly) + 0.020 * math.sin(2 * anomaly))
    obliquity = math.radians(23.439)
    distance = 1.00014 - 0.01671 * math.cos(anomaly)  # au
    sun = (
        math.cos(longitude),
        math.cos(obliquity) * math.sin(longitude),
        math.sin(obliquity) * math.sin(longitude),
    )
    along = 2 * math.pi * elapsed / _PERIOD
    node = mean_longitude + math.radians(15.0) * (_LOCAL_TIME_OF_NODE - 12.0)  # of the mean sun, which keeps local time
    x, y = math.cos(along), math.sin(along) * math.cos(_INCLINATION)
    zenith = (
        x * math.cos(node) - y * math.sin(node),
        x * math.sin(node) + y * math.cos(node),
        math.sin(along) * math.sin(_INCLINATION),
    )
    cosine = sum(a * b for a, b in zip(zenith, sun, strict=True))
    # A zenith face that sees the Sun is never in the Earth's shadow.
    return _SOLAR_CONSTANT / distance**2 * max(0.0, cosine)
