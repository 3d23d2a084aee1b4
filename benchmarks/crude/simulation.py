"""Satellites flown by a simulation of its own: nothing here is flightcal's.

Kepler's orbit with the secular drifts of J2, the Sun of the Astronomical Almanac, an Earth of a few hundred patches,
a conical shadow, and fourth-order Runge-Kutta steps of some seconds with thermostats that act once in each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_MU, _RADIUS, _J2 = 3.986004418e14, 6378137.0, 1.08262668e-3
_SUN_RADIUS, _AU = 6.957e8, 1.495978707e11
_SIGMA = 5.670374419e-8
_OBLIQUITY = math.radians(23.4393)
EPOCH = np.datetime64("2024-03-01T00:00:00", "s")
_SINCE_2000 = float((EPOCH - np.datetime64("2000-01-01T12:00:00")) / np.timedelta64(1, "s"))
"""s from noon of 1 January 2000 to `EPOCH`."""
ALBEDO, INFRARED, SOLAR = 0.3, 237.0, 1361.0
_SKY = 20.0
"""s, how far apart heat from outside is reckoned."""


@dataclass(frozen=True)
class Orbit:
    """Keplerian elements at `EPOCH`, m and degrees."""

    axis: float
    eccentricity: float
    inclination: float
    node: float
    perigee: float = 0.0
    anomaly: float = 0.0

    @property
    def period(self) -> float:
        return 2.0 * math.pi * math.sqrt(self.axis**3 / _MU)


@dataclass(frozen=True)
class Face:
    node: str
    area: float
    normal: Sequence[float]
    absorptivity: float
    emissivity: float
    shaded: float = 0.0
    """Share of direct sunlight that something before it keeps away while the Sun stands on the body's +x side."""


@dataclass(frozen=True)
class Thermostat:
    node: str
    power: float
    below: float
    above: float


@dataclass(frozen=True)
class Craft:
    """What flies; temperatures in K."""

    capacities: Mapping[str, float]
    links: Mapping[tuple[str, str], float]
    faces: Mapping[str, Face]
    orbit: Orbit
    attitude: str
    """nadir, sun_pointing or spinning (about +z, along `spin`)."""
    modes: Mapping[str, Mapping[str, float]]
    timeline: Sequence[tuple[float, str]]
    """s from `EPOCH`, and the mode from then on."""
    heaters: Mapping[str, Thermostat] = field(default_factory=dict)
    radiative: Mapping[tuple[str, str], float] = field(default_factory=dict)
    """m^2"""
    spin: tuple[float, float, float] = (0.1, 0.3, 1.0)
    spin_period: float = 1200.0
    turned: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """rad, by which the body is turned about its own axes beside the attitude."""
    more: Callable[[Array, Array], Mapping[str, Array]] | None = None
    """Further heat, W: of seconds [M] and the sunlit share [M], by node."""
    stiffening: float = 0.0
    """Share by which every link grows a kelvin above 290 K."""
    bus: float = 0.0
    """Share by which heaters are stronger in sunlight than in shadow."""


def sun(seconds: Array) -> Array:
    """[M, 3] m: Astronomical Almanac, low precision."""
    days = (seconds + _SINCE_2000) / 86400.0
    g = np.radians(357.528 + 0.9856003 * days)
    along = np.radians(280.460 + 0.9856474 * days) + np.radians(1.915) * np.sin(g) + np.radians(0.020) * np.sin(2 * g)
    distance = _AU * (1.00014 - 0.01671 * np.cos(g) - 0.00014 * np.cos(2.0 * g))
    towards = np.stack([np.cos(along), np.cos(_OBLIQUITY) * np.sin(along), np.sin(_OBLIQUITY) * np.sin(along)], axis=1)
    return distance[:, None] * towards


def flown(orbit: Orbit, seconds: Array) -> tuple[Array, Array]:
    """Position and direction of flight [M, 3]."""
    n, e, i = math.sqrt(_MU / orbit.axis**3), orbit.eccentricity, math.radians(orbit.inclination)
    shape = math.sqrt(1.0 - e * e)
    f = 1.5 * _J2 * n * (_RADIUS / (orbit.axis * shape**2)) ** 2
    node = math.radians(orbit.node) - f * math.cos(i) * seconds
    perigee = math.radians(orbit.perigee) + f * (2.0 - 2.5 * math.sin(i) ** 2) * seconds
    mean = math.radians(orbit.anomaly) + (n + f * shape * (1.0 - 1.5 * math.sin(i) ** 2)) * seconds
    big = mean.copy()
    for _ in range(30):
        big = big - (big - e * np.sin(big) - mean) / (1.0 - e * np.cos(big))
    u = 2.0 * np.arctan2(math.sqrt(1 + e) * np.sin(big / 2), math.sqrt(1 - e) * np.cos(big / 2)) + perigee
    r = orbit.axis * (1.0 - e * np.cos(big))

    def placed(angle: Array) -> Array:
        c, s = np.cos(angle), np.sin(angle)
        return np.stack(
            [
                np.cos(node) * c - np.sin(node) * s * math.cos(i),
                np.sin(node) * c + np.cos(node) * s * math.cos(i),
                s * math.sin(i),
            ],
            axis=1,
        )

    return r[:, None] * placed(u), placed(u + math.pi / 2.0)


def _body(craft: Craft, seconds: Array, position: Array, ahead: Array, towards: Array) -> Array:
    """[M, 3, 3], columns are the body's axes."""
    if craft.attitude == "nadir":
        z = -position / np.linalg.norm(position, axis=1, keepdims=True)
        y = -np.cross(position, ahead)
    elif craft.attitude == "sun_pointing":
        z = towards
        y = np.broadcast_to([0.0, -math.sin(_OBLIQUITY), math.cos(_OBLIQUITY)], z.shape)
    else:
        d = np.array(craft.spin) / np.linalg.norm(craft.spin)
        axis = np.cross([0.0, 0.0, 1.0], d)
        first = _turn(axis / np.linalg.norm(axis), np.full(1, math.acos(d[2])))[0]
        turns = (seconds + _SINCE_2000) / craft.spin_period % 1.0
        return _turn(d, 2.0 * np.pi * turns) @ first @ _offset(craft)
    x = np.cross(y, z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2) @ _offset(craft)


def _offset(craft: Craft) -> Array:
    angle = float(np.linalg.norm(craft.turned))
    return np.eye(3) if angle == 0.0 else _turn(np.array(craft.turned) / angle, np.full(1, angle))[0]


def _turn(axis: Array, angle: Array) -> Array:
    """Rodrigues, [M, 3, 3]."""
    x, y, z = axis
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + s * k + (1.0 - c) * (k @ k)


def shadow(position: Array, to_sun: Array) -> Array:
    """[M] share of the Sun that is seen, linear through the penumbra."""
    distance = np.linalg.norm(to_sun - position, axis=1)
    r = np.linalg.norm(position, axis=1)
    cosine = np.einsum("tx,tx->t", -position, to_sun - position) / (r * distance)
    apart = np.arccos(np.clip(cosine, -1.0, 1.0))
    earth, star = np.arcsin(_RADIUS / r), _SUN_RADIUS / distance
    return np.asarray(np.clip((apart - earth + star) / (2.0 * star), 0.0, 1.0))


def _patches(count: int = 900) -> Array:
    """[P, 3] evenly over a sphere."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, math.pi * (1.0 + math.sqrt(5.0)) * k
    flat = np.sqrt(1.0 - z * z)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)


def outside(craft: Craft, seconds: Array) -> tuple[Array, Array]:
    """What each face absorbs [M, F] W, and the sunlit share [M]."""
    position, ahead = flown(craft.orbit, seconds)
    star = sun(seconds)
    towards = (star - position) / np.linalg.norm(star - position, axis=1, keepdims=True)
    body = _body(craft, seconds, position, ahead, towards)
    lit = shadow(position, star)
    flux = SOLAR * (_AU / np.linalg.norm(star - position, axis=1)) ** 2
    faces = list(craft.faces.values())
    normals = np.array([np.array(f.normal) / np.linalg.norm(f.normal) for f in faces])
    turned = np.einsum("txb,fb->tfx", body, normals)
    direct = np.maximum(np.einsum("tfx,tx->tf", turned, towards), 0.0) * (lit * flux)[:, None]
    shade = np.array([f.shaded for f in faces]) * (np.einsum("tx,tx->t", body[:, :, 0], towards) > 0.0)[:, None]
    direct *= 1.0 - shade
    patches = _patches()
    area = 4.0 * math.pi * _RADIUS**2 / len(patches)
    albedo, infrared = np.zeros_like(direct), np.zeros_like(direct)
    day = np.maximum(star / np.linalg.norm(star, axis=1, keepdims=True) @ patches.T, 0.0)
    for m in range(len(seconds)):
        way = _RADIUS * patches - position[m]
        far = np.linalg.norm(way, axis=1)
        way /= far[:, None]
        seen = np.maximum(-np.einsum("px,px->p", way, patches), 0.0) * area / (math.pi * far**2)
        on = np.maximum(turned[m] @ way.T, 0.0) * seen
        albedo[m], infrared[m] = on @ day[m], on.sum(axis=1)
    size = np.array([f.area for f in faces])
    alpha, epsilon = np.array([f.absorptivity for f in faces]), np.array([f.emissivity for f in faces])
    heat = size * (alpha * (direct + ALBEDO * flux[:, None] * albedo) + epsilon * INFRARED * infrared)
    return heat, lit


@numba.njit(cache=True)
def _rates(x, heat, conduct, radiate, away, capacity, stiffening):  # type: ignore[no-untyped-def]
    n = len(x)
    out = np.empty(n)
    for i in range(n):
        q = heat[i] - away[i] * x[i] ** 4
        for j in range(n):
            link = conduct[i, j] * (1.0 + stiffening * (0.5 * (x[i] + x[j]) - 290.0))
            q += link * (x[j] - x[i]) + radiate[i, j] * (x[j] ** 4 - x[i] ** 4)
        out[i] = q / capacity[i]
    return out


@numba.njit(cache=True)
def _fly(x, heat, conduct, radiate, away, capacity, stiffening, at, power, below, above, step):  # type: ignore
    count = len(heat) - 1
    states, status = np.empty((count + 1, len(x))), np.empty((count + 1, len(at)))
    on = np.zeros(len(at))
    for k in range(count + 1):
        for h in range(len(at)):
            if x[at[h]] < below[h]:
                on[h] = 1.0
            elif x[at[h]] > above[h]:
                on[h] = 0.0
        states[k], status[k] = x, on
        if k == count:
            break
        middle = 0.5 * (heat[k] + heat[k + 1])
        first, second, third = heat[k].copy(), middle.copy(), heat[k + 1].copy()
        for h in range(len(at)):
            for q in (first, second, third):
                q[at[h]] += on[h] * power[k, h]
        a = _rates(x, first, conduct, radiate, away, capacity, stiffening)
        b = _rates(x + 0.5 * step * a, second, conduct, radiate, away, capacity, stiffening)
        c = _rates(x + 0.5 * step * b, second, conduct, radiate, away, capacity, stiffening)
        d = _rates(x + step * c, third, conduct, radiate, away, capacity, stiffening)
        x = x + step / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    return states, status


def fly(craft: Craft, first: float, last: float, step: float = 5.0) -> tuple[Array, Array, Array]:
    """Seconds from `EPOCH` [M], temperatures [M, n] K and status [M, H] of a flight."""
    seconds = np.arange(first, last + step, step)
    sky = np.arange(first, last + _SKY + step, _SKY)
    absorbed, lit = outside(craft, sky)
    nodes = list(craft.capacities)
    place = {name: k for k, name in enumerate(nodes)}
    heat = np.zeros((len(seconds), len(nodes)))
    away = np.zeros(len(nodes))
    for k, face in enumerate(craft.faces.values()):
        heat[:, place[face.node]] += np.interp(seconds, sky, absorbed[:, k])
        away[place[face.node]] += _SIGMA * face.area * face.emissivity
    begins = np.array([at for at, _ in craft.timeline])
    now = np.maximum(np.searchsorted(begins, seconds, side="right") - 1, 0)
    for mode, powers in craft.modes.items():
        active = np.array([craft.timeline[k][1] == mode for k in range(len(begins))])[now]
        for node, power in powers.items():
            heat[:, place[node]] += power * active
    share = np.interp(seconds, sky, lit)
    if craft.more is not None:
        for node, watts in craft.more(seconds, share).items():
            heat[:, place[node]] += watts
    conduct, radiate = np.zeros((len(nodes),) * 2), np.zeros((len(nodes),) * 2)
    for table, found, factor in ((craft.links, conduct, 1.0), (craft.radiative, radiate, _SIGMA)):
        for (a, b), size in table.items():
            found[place[a], place[b]] = found[place[b], place[a]] = factor * size
    heaters = list(craft.heaters.values())
    power = (
        np.array([h.power for h in heaters]) * (1.0 + craft.bus * share[:, None])
        if heaters
        else np.zeros((len(seconds), 0))
    )
    states, status = _fly(
        np.full(len(nodes), 288.0), heat, conduct, radiate, away, np.array(list(craft.capacities.values())),
        craft.stiffening, np.array([place[h.node] for h in heaters], np.int64), power,
        np.array([h.below for h in heaters]), np.array([h.above for h in heaters]), step,
    )  # fmt: skip
    return seconds, states, status
