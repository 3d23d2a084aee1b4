"""What the scenario writes of the orbit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import timedelta
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from ...environment import orbital_period
from ...scenario import AttitudeTimeline, CircularOrbit, Earth, KeplerianOrbit, Orbit, SampledAttitude, TleOrbit
from ...simulator import FloatArray
from ...words import listed
from ..network_view import View
from ..sunlight import ZONES
from .wrong import Words, Wrong, closer, driven_otherwise, elsewhere, minutes

_STEPS = {
    "altitude": (-0.4, -0.3, -0.2, -0.1, -0.04, -0.02, -0.01, 0.01, 0.02, 0.04, 0.1, 0.2, 0.35, 0.5, 0.75, 1.0),
    "inclination": tuple(np.deg2rad(15.0 * k) for k in (-5, -4, -3, -2, -1, 1, 2, 3, 4, 5)),
}
"""Shares of the height, and rad. The period tells it to a part of a percent, in hours or in many orbits."""
_SHAPES = tuple(np.arange(0.0, 0.95, 0.05).tolist())
"""Eccentricities that are tried first."""
_NODES = tuple(np.deg2rad([-4.0, -2.0, -1.0, 1.0, 2.0, 4.0]).tolist())
"""rad, by which a node, or a place in an ellipse, is off a little."""
_KINDS = 5
"""Of numbers of an orbit that are tried."""
_FIRST_PLACES = 1200.0
"""s, between places in an orbit that are tried first: a shadow lasts longer."""
_AROUND = {"altitude": (0.05, 8), "semi_major_axis": (0.05, 8), "mean_motion": (0.05, 8), "eccentricity": (0.04, 4)}
"""Around a step, others are tried as far away as this, and nearer by halves, so many."""
_CLOSE = 2.0
"""s, in which a satellite goes through an angle that matters no more: light panels warm by a kelvin."""
_ROUND = 0.02
"""Eccentricity up to which the place of the perigee matters to nothing."""
_ONCE_A_DAY = 42241.1e3
"""m, semi-major axis of an orbit that takes 86,400 s."""
_LOWEST = 150e3
"""m, of an orbit."""
_GROUND = Earth().radius
"""m, from which heights count."""
_OF_LINE_2 = {
    "mean_motion": slice(52, 63), "inclination": slice(8, 16), "raan": slice(17, 25), "mean_anomaly": slice(43, 51),
}  # fmt: skip
"""Columns of two-line elements, in which a number stands."""
_BOUNDS = {"inclination": (0.0, np.pi), "beta_angle": (-0.5 * np.pi, 0.5 * np.pi)}
"""rad, of angles that do not go round."""
_ANGLES = ("inclination", "raan", "argument_of_perigee", "mean_anomaly", "argument_of_latitude")
"""Keys that may be taken for one another."""
_OF_A_PLACE = ("epoch", "argument_of_latitude", "mean_anomaly", "tle", "positions")
"""Keys that say where in its orbit the satellite is."""
_BOTH = (-1.0, 1.0)
_EPOCHS = tuple(sign * days for days in (0.5, *map(float, range(1, 15)), 21.0, 30.0, 365.0) for sign in _BOTH)
"""By how many days an epoch is off: elements of another day; two-line elements of another year are refused."""
_EQUATORIAL = 0.1
"""Sine of an inclination, below which the node and a place in the orbit are all but the same."""
_ABOUT = 90.0
"""s, by which a shift that is found may be beside the whole hours of a time zone."""
_DAY_OF_YEAR = slice(20, 32)
"""Columns of the first of two-line elements."""


_Orbit = CircularOrbit | KeplerianOrbit | TleOrbit


def orbits(view: View) -> Iterator[Wrong]:
    """Another plane of the orbit, another height or, of an ellipse, another shape or place in it."""
    orbit = view.window.scenario.environment.orbit
    if not isinstance(orbit, CircularOrbit | KeplerianOrbit | TleOrbit) or not view.window.scenario.network.faces:
        return
    # Where attitudes come at times of their own, `places` would move these with the satellite.
    of_its_own = isinstance(view.window.scenario.environment.attitude, AttitudeTimeline | SampledAttitude)
    between = _between_places(view)
    places = tuple((between * np.arange(1, round(2.0 * np.pi / between))).tolist())
    nodes = (*_NODES, *places)
    if isinstance(orbit, TleOrbit):
        of_line = {"mean_motion": _STEPS["altitude"], "raan": nodes, "mean_anomaly": places} | _STEPS
        for name in _OF_LINE_2:
            if name == "mean_anomaly" and not of_its_own:
                continue
            for step in of_line[name]:
                yield from _other_orbit(view, orbit, name, step, tries=_KINDS * len(nodes))
        return
    node = next(name for name in ("raan", "beta_angle", "ltan") if getattr(orbit, name, None) is not None)
    tried = [("inclination", _STEPS["inclination"]), (node, _STEPS["inclination"] if node == "beta_angle" else nodes)]
    if isinstance(orbit, CircularOrbit):
        tried += [("altitude", _STEPS["altitude"]), ("argument_of_latitude", places if of_its_own else ())]
    else:
        tried += _in_its_plane(orbit, nodes, places if of_its_own else ())
    for name, steps in tried:
        for step in steps:
            yield from _other_orbit(view, orbit, name, step, tries=_KINDS * len(steps))
    if isinstance(orbit, CircularOrbit) and orbit.altitude > _GROUND:
        yield from _other_orbit(view, orbit, "altitude", -_GROUND / orbit.altitude, tries=1.0)


def _in_its_plane(
    orbit: KeplerianOrbit, nodes: tuple[float, ...], places: tuple[float, ...]
) -> list[tuple[str, tuple[float, ...]]]:
    """Numbers of an orbit but those of its plane, with the steps that are tried; places: where it is as good as round.

    An apogee may stand for the axis.
    """
    least = 0.5 * _AROUND["eccentricity"][0]
    shapes = tuple(shape - orbit.eccentricity for shape in _SHAPES if abs(shape - orbit.eccentricity) > least)
    of_apogee = (orbit.semi_major_axis / (1.0 + orbit.eccentricity) - _GROUND) / (orbit.semi_major_axis - _GROUND) - 1.0
    tried = [("semi_major_axis", (*_STEPS["altitude"], of_apogee)), ("eccentricity", shapes)]
    if orbit.eccentricity <= _ROUND:
        return [*tried, ("mean_anomaly", places)]
    return [*tried, ("argument_of_perigee", nodes), ("mean_anomaly", nodes)]


def _period(view: View) -> float:
    """s, of the orbit."""
    scenario = view.window.scenario
    return orbital_period(scenario.environment, scenario.folder)


def _between_places(view: View) -> float:
    """rad, between the places in an orbit that are tried first, a whole number of which go round."""
    return 2.0 * np.pi / max(24, int(np.ceil(_period(view) / _FIRST_PLACES)))


def _other_orbit(view: View, orbit: _Orbit, name: str, step: float, tries: float) -> Iterator[Wrong]:
    """The orbit with one number changed: altitude by a factor, angles by rad."""
    value, text = _changed(orbit, name, step)
    if value is None:
        return
    written = "tle" if isinstance(orbit, TleOrbit) else name
    near_equator = name == "raan" and not isinstance(orbit, TleOrbit) and np.sin(orbit.inclination) < _EQUATORIAL
    scenario = elsewhere(view, orbit=orbit.model_copy(update={written: value}))
    words = Words(
        f"The orbit has another {name.replace('_', ' ')}",
        f"The telemetry agrees with {name} {text}: its sunlight and eclipses are those of the telemetry.",
        f"Check 'environment: orbit' ({name.replace('_', ' ')}: {text})"
        + (", and that the two lines are of this satellite" if written == "tle" else "")
        + (", and the other angles in its plane, which do as much near the equator" if near_equator else ""),
    )

    def around() -> Iterator[Wrong]:
        between = 0.5 * _between_places(view)
        of_angle = between, int(np.log2(between * _period(view) / (2.0 * np.pi * _CLOSE)))
        farthest, count = _AROUND.get(name, of_angle)
        for more in farthest * 0.5 ** np.arange(count):
            for sign in (-1.0, 1.0):
                yield from _other_orbit(view, orbit, name, step + sign * float(more), tries)

    yield from driven_otherwise("orbit", name, words, view, tries=tries, closer=around, scenario=scenario)


def _changed(orbit: _Orbit, name: str, step: float) -> tuple[Any, str]:
    """A number of the orbit, otherwise, and in words; of two-line elements the lines. None: there is no such orbit."""
    if isinstance(orbit, TleOrbit):
        return _other_lines(orbit, name, step)
    if name == "altitude" and isinstance(orbit, CircularOrbit):
        height = orbit.altitude * (1.0 + step)
        return (height if height > _LOWEST else None), f"{height / 1e3:.0f} km"
    if name == "semi_major_axis" and isinstance(orbit, KeplerianOrbit):
        axis = _raised(orbit.semi_major_axis, step)
        lowest = axis * (1.0 - orbit.eccentricity) - _GROUND
        return (axis if lowest > _LOWEST else None), f"{axis / 1e3:.0f} km"
    if name == "ltan" and isinstance(orbit, CircularOrbit):
        hour, minute = (int(part) for part in (orbit.ltan or "0:0").split(":"))
        of_day = round(60 * hour + minute + np.rad2deg(step) * 4.0) % 1440
        text = f"{of_day // 60:02d}:{of_day % 60:02d}"
        return text, text
    if name == "eccentricity" and isinstance(orbit, KeplerianOrbit):
        shape = orbit.eccentricity + step
        lowest = orbit.semi_major_axis * (1.0 - shape) - _GROUND
        return (shape if shape >= 0.0 and lowest > _LOWEST else None), f"{shape:.3f}"
    angle = float(getattr(orbit, name)) + step
    bounds = _BOUNDS.get(name, (-np.inf, np.inf))
    if name not in _BOUNDS:
        angle %= 2.0 * np.pi
    return (angle if bounds[0] < angle < bounds[1] else None), f"{np.rad2deg(angle):.1f} deg"


def _raised(axis: float, step: float) -> float:
    """m, semi-major axis of an orbit whose height is larger by a share."""
    return _GROUND + (axis - _GROUND) * (1.0 + step)


def _other_lines(orbit: TleOrbit, name: str, step: float) -> tuple[tuple[str, ...] | None, str]:
    """Two-line elements with a number changed in each second line, and that of the first in words."""
    place, (low, high) = _OF_LINE_2[name], {"inclination": (0.0, 180.0)}.get(name, (-np.inf, np.inf))
    lines, texts = list(orbit.tle), []
    for k in range(1, len(lines), 2):
        value = float(lines[k][place])
        if name == "mean_motion":
            axis = _ONCE_A_DAY * value ** (-2.0 / 3.0)
            other = _raised(axis, step)
            value *= (axis / other) ** 1.5 if other - _GROUND > _LOWEST else np.nan
            written, text = f"{value:11.8f}", f"{value:.2f} revolutions a day"
        else:
            value += np.rad2deg(step)
            written, text = f"{value % 360.0:8.4f}", f"{value % 360.0:.1f} deg"
        if not low < value < high:
            return None, ""
        lines[k] = lines[k][: place.start] + written + lines[k][place.stop :]
        texts.append(text)
    return tuple(lines), texts[0]


def epochs(view: View) -> Iterator[Wrong]:
    """The elements are of some day before or after that which is written, of midnight for noon, or of another year."""
    orbit = view.window.scenario.environment.orbit
    if not isinstance(orbit, CircularOrbit | KeplerianOrbit | TleOrbit) or not view.window.scenario.network.faces:
        return
    for days in _EPOCHS:
        how = "a year" if abs(days) == 365.0 else f"{abs(days):g} day{'s' if abs(days) != 1.0 else ''}"
        how += " earlier" if days < 0.0 else " later"
        update: dict[str, Any]
        if isinstance(orbit, TleOrbit):
            update, text = {"tle": _of_another_day(orbit.tle, days)}, "the first line"
        else:
            epoch = orbit.epoch + timedelta(days=days)
            update, text = {"epoch": epoch}, epoch.isoformat(sep=" ")
        other = orbit.model_copy(update=update)
        words = Words(
            "The orbit's elements are of another epoch",
            f"With an epoch {how}, sunlight and eclipses are those of the telemetry.",
            f"Check the epoch in 'environment: orbit' ({text}), and that all elements are of it",
        )
        yield from driven_otherwise(
            "orbit", "epoch", words, view, tries=len(_EPOCHS), scenario=elsewhere(view, orbit=other)
        )


def misread_angles(view: View) -> Iterator[Wrong]:
    """Two angles of the orbit are each other's, or its mean anomaly is a true one."""
    orbit = view.window.scenario.environment.orbit
    if not isinstance(orbit, CircularOrbit | KeplerianOrbit) or not view.window.scenario.network.faces:
        return
    changed: list[tuple[str, str, dict[str, float]]] = []
    for a, b in combinations(_keys(orbit, _ANGLES), 2):
        exchanged = {a: getattr(orbit, b), b: getattr(orbit, a)}
        changed.append((f"{a} and {b} of the orbit are exchanged", f"{a} and {b}", exchanged))
    if isinstance(orbit, KeplerianOrbit) and orbit.eccentricity > _ROUND:
        mean = {"mean_anomaly": _mean_anomaly(orbit.mean_anomaly, orbit.eccentricity)}
        changed.append(("The mean_anomaly of the orbit is its true anomaly", "mean_anomaly", mean))
    for title, what, update in changed:
        if not 0.0 < update.get("inclination", 1.0) < np.pi:
            continue
        texts = (f"{name}: {np.rad2deg(angle):.4g} deg" for name, angle in update.items())
        words = Words(
            title,
            f"With {listed(list(texts))}, sunlight and eclipses are those of the telemetry.",
            f"Check {what} in 'environment: orbit'",
        )
        scenario = elsewhere(view, orbit=orbit.model_copy(update=update))
        yield from driven_otherwise("orbit", what, words, view, tries=len(changed), scenario=scenario)


def _keys(orbit: Orbit | None, names: Sequence[str]) -> list[str]:
    """Those of the keys of an orbit that it has."""
    return [name for name in names if getattr(orbit, name, None) is not None]


def _mean_anomaly(true_anomaly: float, eccentricity: float) -> float:
    """rad, by Kepler's equation."""
    half = np.sqrt((1.0 - eccentricity) / (1.0 + eccentricity)) * np.tan(0.5 * true_anomaly)
    eccentric = 2.0 * np.arctan(half)
    return float((eccentric - eccentricity * np.sin(eccentric)) % (2.0 * np.pi))


def _of_another_day(lines: Sequence[str], days: float) -> tuple[str, ...]:
    """Two-line elements whose epochs are so many days later; a year's end is not passed."""
    changed = list(lines)
    for k in range(0, len(lines), 2):
        day = f"{float(lines[k][_DAY_OF_YEAR]) + days:012.8f}"
        changed[k] = lines[k][: _DAY_OF_YEAR.start] + day + lines[k][_DAY_OF_YEAR.stop :]
    return tuple(changed)


def places(view: View, shifts: Sequence[float] | FloatArray | None = None) -> Iterator[Wrong]:
    """The satellite is at another place of its orbit than the scenario says, while modes are right."""
    if not view.window.scenario.network.faces or not view.window.scenario.network.timeline:
        return
    count, keys = 24, _keys(view.window.scenario.environment.orbit, _OF_A_PLACE)
    around = [(k if k <= count // 2 else k - count) * view.window.period / count for k in range(1, count)]
    for late in map(float, around if shifts is None else shifts):
        how = "later" if late > 0 else "earlier"
        words = Words(
            f"Sunlight and eclipses come {minutes(late)} {how} than the orbit says",
            f"With the orbit moved by {minutes(late)}, and the timeline of modes as it is, the model explains the "
            "telemetry.",
            f"Check {listed([repr(key) for key in keys])} in 'environment: orbit'{_time_zone(late)}",
        )
        near = partial(places, view, closer(late, view.window.period / count))
        yield from driven_otherwise("orbit", "place", words, view, tries=count, closer=near, sunlight=late)


def _time_zone(late: float) -> str:
    """What else may be where times are off by about so many hours (s)."""
    hours = round(abs(late) / 3600.0)
    if not 0.0 < 3600.0 * hours <= ZONES or abs(abs(late) - 3600.0 * hours) > _ABOUT:
        return ""
    return f"; about {hours} h may also be a time zone of the telemetry and the timeline"


def eclipses(view: View) -> Iterator[Wrong]:
    """The measured shadow is not that of the orbit."""
    scenario = view.window.scenario
    if scenario.environment.eclipse is None or scenario.environment.orbit is None:
        return
    flag = scenario.environment.eclipse.measured_by
    words = Words(
        f"{flag} is not the shadow of this orbit",
        f"With the shadow that follows from the orbit, in the place of {flag}, the model explains the telemetry.",
        f"Check {flag}, and how it says that the satellite is in the shadow; or leave 'eclipse' out",
    )
    yield from driven_otherwise("eclipse", flag, words, view, tries=1.0, scenario=scenario)


WRONGS = (orbits, epochs, misread_angles, places, eclipses)
"""What looks for them."""
