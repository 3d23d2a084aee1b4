"""Eight satellites of the independent simulation, each with a scenario that is right and sensible priors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pandas as pd

from .simulation import EPOCH, SOLAR, Array, Craft, Face, Orbit, Thermostat, fly

_EARTH = 6378137.0
_SUN_AT_EPOCH = 342.0
"""deg, right ascension of the Sun."""
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Satellite:
    """What flies, and how it is seen."""

    name: str
    craft: Craft
    observed: Sequence[str]
    every: float = 60.0
    """s between samples."""
    noise: float = 0.1
    step: float = 0.1
    """K of a digit."""
    orbits: float = 2.0
    """Of the training."""
    settling: float = 86400.0
    seed: int = 0

    @property
    def windows(self) -> Mapping[str, tuple[float, float]]:
        """s from `EPOCH`, and orbits."""
        period = self.craft.orbit.period
        return {
            "train": (3600.0, self.orbits),
            "soon": (3600.0 + 3.0 * period, 1.0),
            "late": (3600.0 + 9.0 * period, 1.0),
        }

    @property
    def last(self) -> float:
        return 3600.0 + 10.1 * self.craft.orbit.period


def _low(altitude: float, inclination: float, local_time: float) -> Orbit:
    node = (_SUN_AT_EPOCH + 15.0 * (local_time - 12.0)) % 360.0
    return Orbit(_EARTH + altitude, 0.0, inclination, node)


def _minus(v: Sequence[float]) -> tuple[float, ...]:
    return tuple(-x for x in v)


def _box(nodes: Sequence[str], sizes: Sequence[float], absorptivity: float, emissivity: float) -> dict[str, Face]:
    """Six faces, in the order +x -x +y -y +z -z."""
    normals = [X, _minus(X), Y, _minus(Y), Z, _minus(Z)]
    names = ["xp", "xm", "yp", "ym", "zp", "zm"]
    return {
        f"face_{name}": Face(node, size, normal, absorptivity, emissivity)
        for name, node, size, normal in zip(names, nodes, sizes, normals, strict=True)
    }


def _switching(
    apart: float, lasting: float, until: float, modes: tuple[str, str], seed: int
) -> list[tuple[float, str]]:
    """The second mode comes again and again, not quite regularly."""
    rng, at, found = np.random.default_rng(seed), -4.0 * 86400.0, []
    while at < until:
        found += [(at, modes[0]), (at + apart * rng.uniform(0.5, 1.2), modes[1])]
        at = found[-1][0] + lasting * rng.uniform(0.6, 1.4)
    return found


def satellites() -> dict[str, Satellite]:
    """By name."""
    day = 86400.0
    idle, busy = "idle", "busy"
    one = Craft(
        {"body": 9000.0, "panel": 1500.0, "payload": 2500.0},
        {("body", "panel"): 0.5, ("body", "payload"): 0.8},
        _box(["panel", "body", "body", "body", "payload", "body"], [0.20, 0.12, 0.12, 0.12, 0.10, 0.10], 0.45, 0.7),
        _low(420e3, 51.6, 14.0), "nadir",
        {idle: {"body": 18.0}, busy: {"body": 18.0, "payload": 20.0}},
        _switching(4000.0, 1500.0, 3 * day, (idle, busy), 1),
        {"heater_payload": Thermostat("payload", 12.0, 281.0, 284.0)},
    )  # fmt: skip
    two = Craft(
        {"array": 4000.0, "bus": 30000.0, "battery": 12000.0, "radiator": 6000.0, "camera": 5000.0},
        {("array", "bus"): 0.15, ("bus", "battery"): 0.6, ("bus", "radiator"): 1.5, ("bus", "camera"): 0.4},
        {
            "cells": Face("array", 1.2, Z, 0.75, 0.82), "back": Face("array", 1.2, _minus(Z), 0.3, 0.85),
            "cold": Face("radiator", 0.55, _minus(X), 0.2, 0.85), "top": Face("bus", 0.5, Y, 0.2, 0.1),
            "eye": Face("camera", 0.08, _minus(Y), 0.3, 0.8),
        },
        _low(600e3, 97.8, 18.0), "sun_pointing",
        {idle: {"bus": 90.0}, busy: {"bus": 100.0, "camera": 25.0}},
        _switching(7000.0, 900.0, 3 * day, (idle, busy), 2),
        {
            "heater_battery": Thermostat("battery", 20.0, 300.0, 302.0),
            "heater_camera": Thermostat("camera", 15.0, 283.0, 285.0),
        },
    )  # fmt: skip
    three = Craft(
        {"structure": 60000.0, "radiator": 15000.0, "optics": 20000.0, "detector": 3000.0, "battery": 18000.0,
         "panel": 5000.0},
        {("structure", "radiator"): 3.0, ("structure", "optics"): 0.5, ("optics", "detector"): 0.3,
         ("structure", "battery"): 0.7, ("structure", "panel"): 0.2, ("radiator", "detector"): 0.25},
        {
            "earth": Face("optics", 0.25, Z, 0.25, 0.8), "cold": Face("radiator", 0.9, Y, 0.15, 0.82),
            "array_front": Face("panel", 1.0, (-0.3, -1.0, 0.0), 0.7, 0.8),
            "array_back": Face("panel", 1.0, (0.3, 1.0, 0.0), 0.4, 0.85),
            "mli": Face("structure", 3.0, _minus(Z), 0.03, 0.02),
        },
        _low(700e3, 98.2, 10.5), "nadir",
        {idle: {"structure": 110.0, "detector": 1.0}, busy: {"structure": 120.0, "detector": 9.0, "optics": 10.0}},
        _switching(3500.0, 1200.0, 3 * day, (idle, busy), 3),
        {
            "heater_battery": Thermostat("battery", 25.0, 306.0, 309.0),
            "heater_optics": Thermostat("optics", 30.0, 291.0, 293.0),
        },
    )  # fmt: skip
    geo = Craft(
        {"bus": 150000.0, "north": 60000.0, "south": 60000.0, "antenna": 8000.0},
        {("bus", "north"): 15.0, ("bus", "south"): 15.0, ("bus", "antenna"): 0.4},
        {
            "osr_n": Face("north", 2.5, Y, 0.15, 0.82), "osr_s": Face("south", 2.5, _minus(Y), 0.15, 0.82),
            "east": Face("bus", 3.0, X, 0.05, 0.03), "west": Face("bus", 3.0, _minus(X), 0.05, 0.03),
            "dish": Face("antenna", 0.8, Z, 0.4, 0.8), "dish_back": Face("antenna", 0.8, _minus(Z), 0.4, 0.8),
        },
        Orbit(42164e3, 0.0002, 0.05, 40.0, 0.0, 30.0), "nadir",
        {idle: {"bus": 700.0, "north": 150.0, "south": 150.0}, busy: {"bus": 780.0, "north": 330.0, "south": 150.0}},
        _switching(9.0 * 3600.0, 4.0 * 3600.0, 14 * day, (idle, busy), 4),
        {
            "heater_south": Thermostat("south", 180.0, 277.0, 281.0),
            "heater_antenna": Thermostat("antenna", 120.0, 233.0, 241.0),
        },
    )  # fmt: skip
    elliptic = Craft(
        {"body": 15000.0, "tank": 40000.0, "panel": 3000.0},
        {("body", "tank"): 0.6, ("body", "panel"): 0.3},
        {
            "front": Face("panel", 0.6, Z, 0.7, 0.8), "rear": Face("panel", 0.6, _minus(Z), 0.4, 0.8),
            "sides": Face("body", 0.5, X, 0.3, 0.6), "other": Face("body", 0.5, _minus(Y), 0.3, 0.6),
        },
        Orbit(20000e3, 0.62, 28.0, 150.0, 60.0, 0.0), "sun_pointing",
        {idle: {"body": 60.0}, busy: {"body": 100.0}},
        _switching(6000.0, 2500.0, 5 * day, (idle, busy), 5),
        {"heater_tank": Thermostat("tank", 30.0, 290.0, 292.0)},
    )  # fmt: skip
    cube = Craft(
        {"shell": 700.0, "core": 1100.0},
        {("shell", "core"): 0.35},
        _box(["shell"] * 6, [0.02] * 6, 0.7, 0.75),
        _low(500e3, 97.4, 13.5), "spinning",
        {idle: {"core": 1.2}, busy: {"core": 3.5}},
        _switching(4500.0, 1200.0, 3 * day, (idle, busy), 6),
    )  # fmt: skip
    large = Craft(
        {"bus": 80000.0, "earth_panel": 20000.0, "zenith": 20000.0, "ram": 15000.0, "wake": 15000.0,
         "radiator": 12000.0, "radar": 25000.0, "receiver": 6000.0},
        {("bus", "earth_panel"): 1.5, ("bus", "zenith"): 1.5, ("bus", "ram"): 1.0, ("bus", "wake"): 1.0,
         ("bus", "radiator"): 4.0, ("earth_panel", "radar"): 0.8, ("radar", "receiver"): 0.5,
         ("radiator", "receiver"): 0.3},
        {
            "f_earth": Face("earth_panel", 1.2, Z, 0.3, 0.5), "f_zenith": Face("zenith", 1.5, _minus(Z), 0.35, 0.3),
            "f_ram": Face("ram", 0.8, X, 0.35, 0.4), "f_wake": Face("wake", 0.8, _minus(X), 0.35, 0.4),
            "f_cold": Face("radiator", 1.2, Y, 0.2, 0.83), "f_radar": Face("radar", 0.7, Z, 0.4, 0.7),
        },
        _low(800e3, 74.0, 8.5), "nadir",
        {idle: {"bus": 250.0}, busy: {"bus": 260.0, "radar": 120.0, "receiver": 12.0}},
        _switching(5000.0, 900.0, 4 * day, (idle, busy), 7),
        {
            "heater_radar": Thermostat("radar", 60.0, 278.0, 281.0),
            "heater_receiver": Thermostat("receiver", 12.0, 284.0, 286.0),
            "heater_bus": Thermostat("bus", 80.0, 287.0, 289.0),
        },
    )  # fmt: skip
    boxed = Craft(
        {"frame": 5000.0, "lid": 2000.0, "unit": 4000.0, "cover": 900.0},
        {("frame", "lid"): 0.4, ("frame", "unit"): 0.25, ("lid", "cover"): 0.1},
        _box(["frame", "frame", "cover", "frame", "frame", "lid"], [0.09, 0.09, 0.1, 0.1, 0.08, 0.08], 0.4, 0.6),
        _low(550e3, 65.0, 21.0), "nadir",
        {idle: {"unit": 8.0}, busy: {"unit": 16.0}},
        _switching(5000.0, 2000.0, 3 * day, (idle, busy), 8),
        radiative={("unit", "lid"): 0.06, ("unit", "frame"): 0.08},
    )  # fmt: skip
    made = [
        Satellite("small low", one, list(one.capacities), 60.0, 0.1, 0.5),
        Satellite("dawn-dusk", two, list(two.capacities), 30.0, 0.1, 0.25),
        Satellite("morning", three, list(three.capacities), 120.0, 0.05, 0.1),
        Satellite("geostationary", geo, list(geo.capacities), 300.0, 0.1, 0.5, settling=3.0 * 86400.0),
        Satellite("elliptic", elliptic, list(elliptic.capacities), 60.0, 0.1, 0.1, settling=2.0 * 86400.0),
        Satellite("cube", cube, list(cube.capacities), 180.0, 0.2, 0.5, orbits=3.0),
        Satellite(
            "large", large, [n for n in large.capacities if n != "wake"], 60.0, 0.05, 0.05, settling=2.0 * 86400.0
        ),
        Satellite("boxed", boxed, list(boxed.capacities), 20.0, 0.15, 0.1),
    ]
    return {member.name: replace(member, seed=k) for k, member in enumerate(made)}


@cache
def _noise(seed: int, samples: int, channels: int) -> Array:
    return np.random.default_rng([91, seed]).standard_normal((samples, channels))


def telemetry(satellite: Satellite) -> pd.DataFrame:
    """As a file has it: degC, and status 0 or 1."""
    seconds, states, status = fly(satellite.craft, -satellite.settling, satellite.last)
    at = np.arange(0.0, satellite.last, satellite.every)
    nodes = list(satellite.craft.capacities)
    place = np.searchsorted(seconds, at)
    noise = _noise(satellite.seed, len(at), len(satellite.observed))
    table: dict[str, Any] = {"time": np.datetime_as_string(EPOCH + at.astype("timedelta64[s]"), unit="s")}
    for k, node in enumerate(satellite.observed):
        read = states[place, nodes.index(node)] - 273.15 + satellite.noise * noise[:, k]
        table[f"{node}_temp"] = np.round(np.round(read / satellite.step) * satellite.step, 6)
    for k, heater in enumerate(satellite.craft.heaters):
        table[f"{heater}_status"] = status[place, k]
    return pd.DataFrame(table)


def written(satellite: Satellite) -> dict[str, Any]:
    """The right scenario: priors hold the truth, about half a deviation off; what is fixed is true."""
    craft, rng = satellite.craft, np.random.default_rng([92, satellite.seed])
    heaters = {
        name: {
            "node": h.node, "sensor": h.node, "power": f"{h.power} W", "on_below": f"{h.below} K",
            "off_above": f"{h.above} K", "measured_by": f"{name}_status",
        }
        for name, h in craft.heaters.items()
    }  # fmt: skip
    orbit, temperature = craft.orbit, {"unit": "degC", "kind": "temperature"}
    attitude: Any = craft.attitude
    if attitude == "spinning":
        attitude = {"spin_axis": [0, 0, 1], "direction": list(craft.spin), "period": f"{craft.spin_period} s"}
    parameters: dict[str, Any] = {}

    def around(name: str, path: str | list[str], value: float, unit: str, factor: float) -> None:
        median = value * math.exp(0.5 * math.log(factor) * rng.standard_normal())
        prior = {"lognormal": {"median": f"{median:.5g} {unit}", "factor": factor}}
        parameters[name] = {"sets": path, "prior": prior}

    for a, b in craft.links:
        around(f"link_{a}_{b}", f"conductors.{a}-{b}.conductance", craft.links[a, b], "W/K", 1.5)
    for node in list(craft.capacities)[:3]:
        around(f"capacity_{node}", f"nodes.{node}.capacity", craft.capacities[node], "J/K", 1.3)
    coated: dict[tuple[str, float, float], list[str]] = {}
    for name, face in craft.faces.items():
        coated.setdefault((face.node, face.absorptivity, face.emissivity), []).append(name)
    for (_, alpha, epsilon), names in coated.items():
        if alpha > 0.16:
            low = round(alpha - 0.12 + 0.06 * rng.uniform(-1, 1), 3)
            paths = [f"faces.{name}.absorptivity" for name in names]
            prior = {"uniform": [max(low, 0.02), round(min(low + 0.24, 1.0), 3)]}
            parameters[f"absorptivity_{names[0]}"] = {"sets": paths, "prior": prior}
        if epsilon > 0.2:
            mean = round(epsilon + 0.02 * rng.standard_normal(), 3)
            prior = {"truncated_normal": {"mean": mean, "standard_deviation": 0.04, "lower": 0.02, "upper": 0.98}}
            paths = [f"faces.{name}.emissivity" for name in names]
            parameters[f"emissivity_{names[0]}"] = {"sets": paths, "prior": prior}
    return {
        "name": satellite.name,
        "telemetry": {
            "file": "telemetry.csv",
            "time": {"column": "time"},
            "channels": {
                f"{n}_temp": {"column": f"{n}_temp", "stale_after": None, **temperature} for n in satellite.observed
            }
            | {f"{h}_status": {"column": f"{h}_status", "kind": "status"} for h in heaters},
        },
        "environment": {
            "orbit": {
                "semi_major_axis": f"{orbit.axis} m", "eccentricity": orbit.eccentricity,
                "inclination": f"{orbit.inclination} deg", "raan": f"{orbit.node} deg",
                "argument_of_perigee": f"{orbit.perigee} deg", "mean_anomaly": f"{orbit.anomaly} deg",
                "epoch": str(EPOCH),
            },
            "attitude": attitude,
            "solar_constant": f"{SOLAR} W/m^2",
        },
        "simulator": {
            "nodes": {
                n: {"capacity": f"{c} J/K"} | ({} if n in satellite.observed else {"initial": "288 K"})
                for n, c in craft.capacities.items()
            },
            "conductors": [
                *({"between": [a, b], "conductance": f"{g} W/K"} for (a, b), g in craft.links.items()),
                *({"between": [a, b], "radiative": f"{r} m^2"} for (a, b), r in craft.radiative.items()),
            ],
            "faces": {
                name: {
                    "node": f.node, "area": f"{f.area} m^2", "normal": list(f.normal),
                    "absorptivity": f.absorptivity, "emissivity": f.emissivity,
                }
                for name, f in craft.faces.items()
            },
            "modes": {mode: {n: f"{w} W" for n, w in powers.items()} for mode, powers in craft.modes.items()},
            "timeline": [
                {"at": str(EPOCH + np.timedelta64(round(at), "s")), "mode": mode} for at, mode in craft.timeline
            ],
            "heaters": heaters,
        },
        "parameters": parameters,
        "observations": {f"{n}_temp": {"node": n} for n in satellite.observed}
        | {f"{h}_status": {"heater": h} for h in heaters},
        "windows": {
            name: {"start": str(EPOCH + np.timedelta64(round(first), "s")), "orbits": count}
            for name, (first, count) in satellite.windows.items()
        },
        "calibration": {"seed": 1, "prediction": {"simulations": 300}},
    }  # fmt: skip
