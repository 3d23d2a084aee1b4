"""Orbits: position and velocity at any time, and the orbital period.

Inertial frame: Earth-centred, true equator and equinox of date. SGP4 works in TEME, which shares the
equator and differs by the equation of the equinoxes: under 0.005 deg in right ascension, nothing to a
heat flux.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import erfa
import numpy as np
from scipy.interpolate import CubicSpline
from sgp4.api import SGP4_ERRORS, Satrec

from ..errors import OrbitError
from ..scenario import CircularOrbit, Environment, KeplerianOrbit, Orbit, SampledOrbit, TleOrbit
from ._samples import read_samples, state_of, within_span
from ._time import Floats, Times, julian_dates, seconds_since
from .sun import sun_position

EARTH_MU = 3.986004418e14
"""m3/s2 (WGS 84)."""
EARTH_RADIUS = 6378.137e3
"""m, equatorial (WGS 84): of the sphere that altitudes count from, that shines and that casts the shadow."""
EARTH_J2 = 1.08262668e-3
"""Second zonal harmonic, unnormalised (EGM96)."""
_DAY = 86400.0
_LONGEST_TLE_AGE = 30.0
"""days from the epoch of two-line elements: drag makes them useless long before a year."""
_COARSEST_SAMPLING = 0.1
"""of a period between position samples: there a cubic spline errs by up to 4e-4 of the orbit's radius."""

Propagator = Callable[[Times], tuple[Floats, Floats]]
"""Times [T] -> position [T, 3] m and velocity [T, 3] m/s."""


def propagator(orbit: Orbit, folder: Path = Path()) -> Propagator:
    """The function that gives position and velocity on `orbit`; sample files are read from `folder`.

    Raises OrbitError: unreadable samples, times outside their span.
    """
    if isinstance(orbit, SampledOrbit):
        return _sampled(orbit, folder)[0]
    if isinstance(orbit, TleOrbit):
        return _tle(orbit)
    return _secular(_keplerian(orbit) if isinstance(orbit, CircularOrbit) else orbit)


def orbital_period(environment: Environment, folder: Path = Path()) -> float:
    """Orbital period in s: `environment.period` where it is given, else the nodal period of the orbit.

    Nodal (draconitic) means from ascending node to ascending node, which
    makes two windows of whole orbits alike. Elements: from the secular rates of mean anomaly and perigee
    (TLE: SGP4's). Samples: the mean over their whole orbits or, where they hold less than one, Kepler's
    period of the mean vis-viva semi-major axis (0.5%). With neither, as of a probe: a day, by which lengths are told.
    """
    if environment.period is not None:
        return environment.period
    orbit = environment.orbit
    if orbit is None:
        return _DAY
    if isinstance(orbit, SampledOrbit):
        return _sampled(orbit, folder)[1]
    if isinstance(orbit, TleOrbit):
        rates = [satellite.mdot + satellite.argpdot for satellite in _satellites(orbit)]
        return float(2 * np.pi / np.mean(rates) * 60.0)
    elements = _keplerian(orbit) if isinstance(orbit, CircularOrbit) else orbit
    _, perigee_rate, anomaly_rate = secular_rates(elements)
    return 2 * np.pi / (perigee_rate + anomaly_rate)


def argument_of_latitude(position: Floats, velocity: Floats) -> Floats:
    """Angle from the ascending node [T] rad, in (-pi, pi]; of an equatorial orbit, from right ascension 0.

    position, velocity: [T, 3] m, m/s.
    """
    momentum = np.cross(position, velocity)
    momentum /= np.linalg.norm(momentum, axis=-1, keepdims=True)
    node = np.stack([-momentum[:, 1], momentum[:, 0], np.zeros(len(momentum))], axis=-1)
    size = np.linalg.norm(node, axis=-1, keepdims=True)
    node = np.where(size > 1e-9, node / np.maximum(size, 1e-9), [1.0, 0.0, 0.0])
    return angle_from(node, position, velocity)


def angle_from(direction: Floats, position: Floats, velocity: Floats) -> Floats:
    """Angle [T] rad, in (-pi, pi], in the orbit's plane, from where it is nearest to a direction [T, 3] of any length.

    position, velocity: [T, 3] m, m/s.
    """
    momentum = np.cross(position, velocity)
    momentum /= np.linalg.norm(momentum, axis=-1, keepdims=True)
    ahead = np.cross(momentum, direction)
    # What of the direction is across the plane is across the position too.
    angle: Floats = np.arctan2(np.sum(position * ahead, axis=-1), np.sum(position * direction, axis=-1))
    return angle


def eccentricity_vector(position: Floats, velocity: Floats) -> Floats:
    """[T, 3] towards the perigee, as long as the eccentricity, of a body at positions [T, 3] m, m/s.

    Vallado (2013), Fundamentals of Astrodynamics and Applications, eq. 2-78.
    """
    height = np.linalg.norm(position, axis=-1, keepdims=True)
    vector: Floats = np.cross(velocity, np.cross(position, velocity)) / EARTH_MU - position / height
    return vector


# --- elements -----------------------------------------------------------------------------------------------


def secular_rates(orbit: KeplerianOrbit) -> tuple[float, float, float]:
    """Rates of node, argument of perigee and mean anomaly, rad/s, to first order in J2.

    The mean anomaly's includes the two-body mean motion. Vallado (2013), Fundamentals of Astrodynamics and
    Applications, ch. 9, secular effects of the zonal harmonics.
    """
    mean_motion = np.sqrt(EARTH_MU / orbit.semi_major_axis**3)
    shape = np.sqrt(1 - orbit.eccentricity**2)
    factor = 1.5 * EARTH_J2 * mean_motion * (EARTH_RADIUS / (orbit.semi_major_axis * shape**2)) ** 2
    sine_squared = np.sin(orbit.inclination) ** 2
    node = -factor * np.cos(orbit.inclination)
    perigee = factor * (2 - 2.5 * sine_squared)
    anomaly = mean_motion + factor * shape * (1 - 1.5 * sine_squared)
    return float(node), float(perigee), float(anomaly)


def local_time_to_raan(local_time: str, epoch: np.datetime64) -> float:
    """Right ascension in rad of a node with mean local solar time ``"HH:MM"`` at `epoch` (UTC).

    Mean local solar time, as missions state it, is UT plus longitude, so the mean Sun's right ascension
    enters through sidereal time; the apparent local time differs by the equation of time, up to 16 min.
    UT1 is taken as UTC (0.9 s).
    """
    hours, minutes = (int(part) for part in local_time.split(":"))
    whole, days = julian_dates(np.array([epoch]))
    sidereal = erfa.gst00b(whole, days[0])
    midnight_to_now = (whole + days[0] + 0.5) % 1.0
    longitude = 2 * np.pi * ((hours + minutes / 60) / 24 - midnight_to_now)
    return float((sidereal + longitude) % (2 * np.pi))


def beta_to_raan(beta_angle: float, inclination: float, epoch: np.datetime64) -> float:
    """Right ascension in rad of the node, on the day side, whose orbit has this beta angle (rad) at `epoch`.

    The Sun's direction on the orbit's normal (sin raan sin i, -cos raan sin i, cos i) is the sine of beta. Raises
    OrbitError where no orbit of this inclination has it then.
    """
    x, y, z = sun_position(np.array([epoch]))[0]
    ascension, declination = np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
    across = np.cos(declination) * np.sin(inclination)
    along = np.sin(declination) * np.cos(inclination)
    wanted = np.sin(beta_angle) - along
    if abs(wanted) > abs(across) + 1e-9:
        low, high = np.degrees(np.arcsin(np.clip([along - abs(across), along + abs(across)], -1.0, 1.0)))
        raise OrbitError(
            f"environment.orbit.beta_angle: found {np.degrees(beta_angle):.4g} deg, expected {low:.1f} to {high:.1f} "
            f"deg: an orbit of this inclination has no other on {np.datetime_as_string(epoch, 'D')}"
        )
    return float((ascension + np.arcsin(np.clip(wanted / max(across, 1e-9), -1.0, 1.0))) % (2 * np.pi))


def _keplerian(orbit: CircularOrbit) -> KeplerianOrbit:
    epoch = np.datetime64(orbit.epoch)
    if orbit.ltan is not None:
        raan = local_time_to_raan(orbit.ltan, epoch)
    elif orbit.beta_angle is not None:
        raan = beta_to_raan(orbit.beta_angle, orbit.inclination, epoch)
    else:
        assert orbit.raan is not None  # the schema wants one of the three
        raan = orbit.raan
    return KeplerianOrbit.model_construct(
        semi_major_axis=EARTH_RADIUS + orbit.altitude,
        eccentricity=0.0,
        inclination=orbit.inclination,
        raan=raan,
        argument_of_perigee=0.0,
        mean_anomaly=orbit.argument_of_latitude,
        epoch=orbit.epoch,
    )


def _secular(orbit: KeplerianOrbit) -> Propagator:
    """Kepler's ellipse with secular drifts; the velocity is the exact derivative of the position."""
    axis, eccentricity = orbit.semi_major_axis, orbit.eccentricity
    node_rate, perigee_rate, anomaly_rate = secular_rates(orbit)
    epoch = np.datetime64(orbit.epoch)
    shape = np.sqrt(1 - eccentricity**2)

    def state(times: Times) -> tuple[Floats, Floats]:
        elapsed = seconds_since(times, epoch)
        anomaly = eccentric_anomaly(orbit.mean_anomaly + anomaly_rate * elapsed, eccentricity)
        anomaly_speed = anomaly_rate / (1 - eccentricity * np.cos(anomaly))
        along, across = axis * (np.cos(anomaly) - eccentricity), axis * shape * np.sin(anomaly)
        along_speed = -axis * np.sin(anomaly) * anomaly_speed
        across_speed = axis * shape * np.cos(anomaly) * anomaly_speed

        perigee = orbit.argument_of_perigee + perigee_rate * elapsed
        in_plane = _turn(along, across, perigee)
        in_plane_speed = _turn(along_speed - perigee_rate * across, across_speed + perigee_rate * along, perigee)

        node = orbit.raan + node_rate * elapsed
        cosine, sine = np.cos(orbit.inclination), np.sin(orbit.inclination)
        x, y = _turn(in_plane[0], in_plane[1] * cosine, node)
        x_speed, y_speed = _turn(in_plane_speed[0], in_plane_speed[1] * cosine, node)
        position = np.stack([x, y, in_plane[1] * sine], axis=-1)
        velocity = np.stack([x_speed - node_rate * y, y_speed + node_rate * x, in_plane_speed[1] * sine], axis=-1)
        return position, velocity

    return state


def _turn(x: Floats, y: Floats, angle: Floats) -> tuple[Floats, Floats]:
    cosine, sine = np.cos(angle), np.sin(angle)
    return x * cosine - y * sine, x * sine + y * cosine


def eccentric_anomaly(mean_anomaly: Floats, eccentricity: float) -> Floats:
    """Solution E of Kepler's equation M = E - e sin E, rad, for e in [0, 1); error under 1e-12 rad.

    Newton's iteration from E = M + 0.85 e sign(sin M) (Danby 1987), which converges for every M and e < 1.
    """
    mean = np.asarray(mean_anomaly) % (2 * np.pi)
    anomaly = mean + 0.85 * eccentricity * np.sign(np.sin(mean))
    for _ in range(50):
        correction = (anomaly - eccentricity * np.sin(anomaly) - mean) / (1 - eccentricity * np.cos(anomaly))
        anomaly = anomaly - correction
        if np.max(np.abs(correction), initial=0.0) < 1e-13:
            break
    return anomaly


# --- two-line elements --------------------------------------------------------------------------------------


def _satellites(orbit: TleOrbit) -> list[Satrec]:
    """One of each epoch."""
    return [Satrec.twoline2rv(*lines) for lines in zip(orbit.tle[::2], orbit.tle[1::2], strict=True)]


def _tle(orbit: TleOrbit) -> Propagator:
    satellites = _satellites(orbit)
    epochs = np.array([satellite.jdsatepoch + satellite.jdsatepochF for satellite in satellites])

    def state(times: Times) -> tuple[Floats, Floats]:
        whole, days = julian_dates(times)
        ages = np.abs((whole + days)[:, None] - epochs)
        nearest = ages.argmin(axis=1)
        age = ages.min(axis=1).max(initial=0.0)
        if age > _LONGEST_TLE_AGE:
            raise OrbitError(
                f"environment.orbit.tle: found elements {age:.0f} days away from the time asked for, "
                f"expected at most {_LONGEST_TLE_AGE:.0f}"
            )
        position, velocity = np.empty((2, len(times), 3))
        for k, satellite in enumerate(satellites):
            rows = nearest == k
            errors, position[rows], velocity[rows] = satellite.sgp4_array(np.full(rows.sum(), whole), days[rows])
            if errors.any():
                first = np.flatnonzero(errors)[0]
                message = SGP4_ERRORS[int(errors[first])]
                raise OrbitError(f"environment.orbit.tle: SGP4 at {times[rows][first]}: {message}")
        if not np.isfinite(position).all():
            raise OrbitError(f"environment.orbit.tle: found elements that SGP4 cannot read: {orbit.tle!r}")
        return position * 1e3, velocity * 1e3

    return state


# --- position samples ---------------------------------------------------------------------------------------


def _sampled(orbit: SampledOrbit, folder: Path) -> tuple[Propagator, float]:
    """Propagator (cubic spline through the samples) and orbital period in s of a file of positions."""
    place = f"environment.orbit.positions: {orbit.positions}"
    path = folder / orbit.positions
    return _interpolated(path, place, state_of(path, place))


@lru_cache(maxsize=4)
def _interpolated(path: Path, place: str, _: tuple[int, int]) -> tuple[Propagator, float]:
    """Kept while the file is as it is: attitudes and faces are tried on the same orbit."""
    times, positions = read_samples(path, ("x", "y", "z"), place, at_least=4)
    radius = np.linalg.norm(positions, axis=1)
    if radius.min() < EARTH_RADIUS:
        raise OrbitError(
            f"{place}: found a distance of {radius.min():.4g} m from the Earth's centre, "
            "expected a position above its surface, in metres"
        )
    seconds = seconds_since(times, times[0])
    spline = CubicSpline(seconds, positions)
    speed = spline.derivative()
    steps, longest = np.diff(seconds), _COARSEST_SAMPLING * _kepler_period(radius.mean())
    if steps.max() > longest:
        raise OrbitError(
            f"{place}: found {steps.max():.0f} s without a sample after {times[np.argmax(steps)]}, "
            f"expected at most {longest:.0f} s, a tenth of the period"
        )

    def state(at: Times) -> tuple[Floats, Floats]:
        within_span(at, times, place)
        elapsed = seconds_since(at, times[0])
        return spline(elapsed), speed(elapsed)

    return state, _mean_period(seconds, positions, speed(seconds))


def _mean_period(seconds: Floats, positions: Floats, velocities: Floats) -> float:
    angle = np.unwrap(argument_of_latitude(positions, velocities))
    orbits = int((angle[-1] - angle[0]) // (2 * np.pi))
    if orbits > 0:
        return float(np.interp(angle[0] + 2 * np.pi * orbits, angle, seconds) / orbits)
    distances, speeds = np.linalg.norm(positions, axis=1), np.linalg.norm(velocities, axis=1)
    return _kepler_period(1 / np.mean(2 / distances - speeds**2 / EARTH_MU))


def _kepler_period(semi_major_axis: float) -> float:
    return float(2 * np.pi * np.sqrt(semi_major_axis**3 / EARTH_MU))
