"""Random small satellites in low orbits with eclipses, as scenarios with priors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

ATTITUDES = ["nadir", "sun_pointing", {"spin_axis": [0, 0, 1], "direction": [0.1, 0.3, 1], "period": "20 min"}]
NORMALS = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
START = np.datetime64("2024-03-01T00:00:00", "s")
"""Of the training."""
SETTLING = np.timedelta64(12, "h")
"""That a satellite flies before."""
SAMPLING = np.timedelta64(60, "s")
WINDOWS = {"train": (0.0, 2.0), "soon": (3.0, 1.0), "late": (10.0, 1.0)}
"""Orbits after `START`, and how long each is in orbits."""

_EARTH_RADIUS, _GRAVITY = 6378.137e3, 3.986004418e14  # m, m^3/s^2 (WGS 84)
_MANY_ORBITS = 13


@dataclass(frozen=True)
class Sensor:
    """What a channel's telemetry differs by from the temperature, K."""

    noise: float
    step: float
    """To which it is rounded."""

    @property
    def deviation(self) -> float:
        """Of both together."""
        return math.hypot(self.noise, self.step / math.sqrt(12.0))


@dataclass(frozen=True)
class Satellite:
    """A scenario to calibrate, with priors, and its sensors."""

    written: dict[str, Any]
    """The scenario as its file has it."""
    sensors: dict[str, Sensor]
    """Of each temperature channel."""
    period: float
    """Of the orbit, s."""

    @property
    def times(self) -> Any:
        """[T] of the telemetry, UTC."""
        first, length = WINDOWS["late"]
        return np.arange(START, START + seconds((first + length) * self.period) + SAMPLING, SAMPLING)


def random_satellite(rng: np.random.Generator) -> Satellite:
    """Two to five nodes, at most one of them unobserved, up to two heaters, two modes, four to eight parameters."""
    count = int(rng.integers(2, 6))
    names = [f"node_{k}" for k in range(count)]
    capacities = np.exp(rng.uniform(np.log(300.0), np.log(6000.0), count))
    links = {(int(rng.integers(0, k)), k): rng.uniform(0.2, 2.0) for k in range(1, count)}
    if count > 2 and rng.random() < 0.5:
        links.setdefault((0, count - 1), rng.uniform(0.05, 0.5))
    outside = rng.permutation(6)[: int(rng.integers(3, 7))]
    owners = [names[k % count] for k in rng.permutation(len(outside))]
    coatings = {
        name: {
            "absorptivity": round(float(rng.uniform(0.25, 0.8)), 3),
            "emissivity": round(float(rng.uniform(0.6, 0.88)), 3),
        }
        for name in names
    }
    faces = {
        f"face_{k}": {"node": owner, "area": f"{rng.uniform(0.03, 0.15):.4f} m^2", "normal": NORMALS[k]}
        | coatings[owner]
        for k, owner in zip(outside, owners, strict=True)
    }
    altitude = rng.uniform(400e3, 800e3)
    period = 2.0 * np.pi * math.sqrt((_EARTH_RADIUS + altitude) ** 3 / _GRAVITY)
    bus, payload = rng.uniform(4.0, 15.0), rng.uniform(4.0, 20.0)
    busy = names[int(rng.integers(1, count))]
    heated = [names[k] for k in rng.permutation(count)[: int(rng.integers(0, 3))]]
    hidden = [name for name in names if name not in heated]
    unobserved = {str(rng.choice(hidden))} if count > 2 and hidden and rng.random() < 1 / 3 else set()
    observed = [name for name in names if name not in unobserved]
    simulator: dict[str, Any] = {
        "nodes": {name: {"capacity": f"{c:.1f} J/K"} for name, c in zip(names, capacities, strict=True)},
        "conductors": [{"between": [names[a], names[b]], "conductance": f"{g:.4f} W/K"} for (a, b), g in links.items()],
        "faces": faces,
        "modes": {
            "idle": {names[0]: f"{bus:.2f} W"},
            "busy": {names[0]: f"{bus:.2f} W", busy: f"{payload:.2f} W"},
        },
        "timeline": _timeline(rng, period),
        "heaters": {
            f"heater_{name}": {
                "node": name, "sensor": name, "power": f"{rng.uniform(6.0, 25.0):.1f} W",
                "on_below": "0 degC", "off_above": "3 degC", "measured_by": f"heater_{name}_status",
            }
            for name in heated
        },
    }  # fmt: skip
    temperature = {"unit": "degC", "kind": "temperature", "stale_after": None}
    written = {
        "name": "random",
        "telemetry": {
            "file": "telemetry.csv",
            "time": {"column": "time"},
            "channels": {f"{name}_temp": {"column": f"{name}_temp", **temperature} for name in observed}
            | {f"heater_{name}_status": {"column": f"heater_{name}_status", "kind": "status"} for name in heated},
        },
        "environment": {
            "orbit": {
                "altitude": f"{altitude:.0f} m", "inclination": f"{rng.uniform(45.0, 98.0):.2f} deg",
                # Hours about noon and midnight: an orbit over the terminator may have no eclipse.
                "ltan": f"{int(rng.integers(9, 16) + 12 * rng.integers(0, 2)) % 24:02d}:30", "epoch": _iso(START),
            },
            "attitude": ATTITUDES[int(rng.integers(0, len(ATTITUDES)))],
        },
        "simulator": simulator,
        "parameters": _parameters(rng, simulator, busy),
        "observations": {f"{name}_temp": {"node": name} for name in observed}
        | {f"heater_{name}_status": {"heater": f"heater_{name}"} for name in heated},
        "windows": {
            name: {"start": _iso(START + seconds(first * period)), "orbits": length}
            for name, (first, length) in WINDOWS.items()
        },
        "calibration": {"seed": 1, "prediction": {"simulations": 300}},
    }  # fmt: skip
    sensors = {
        f"{name}_temp": Sensor(float(rng.uniform(0.05, 0.2)), float(rng.choice([0.05, 0.1, 0.2, 0.5])))
        for name in observed
    }
    return Satellite(written, sensors, period)


def seconds(value: float) -> np.timedelta64:
    """Rounded to whole seconds."""
    return np.timedelta64(round(value), "s")


def _iso(time: np.datetime64) -> str:
    return str(np.datetime_as_string(time, unit="s"))


def _timeline(rng: np.random.Generator, period: float) -> list[dict[str, str]]:
    """Idle for 40 to 100 minutes, then busy for 15 to 40, and so on, from before the first sample to after the last."""
    time, found = START - SETTLING, []
    while time < START + seconds(_MANY_ORBITS * period):
        for mode, least, most in (("idle", 2400.0, 6000.0), ("busy", 900.0, 2400.0)):
            found.append({"at": _iso(time), "mode": mode})
            time += seconds(rng.uniform(least, most))
    return found


def _parameters(rng: np.random.Generator, simulator: dict[str, Any], busy: str) -> dict[str, Any]:
    """Four to eight, one of them a link and one a capacity."""
    links = {
        f"link_{link['between'][0]}_{link['between'][1]}": (
            f"conductors.{'-'.join(link['between'])}.conductance",
            _around(link["conductance"], rng.uniform(1.5, 2.0)),
        )
        for link in simulator["conductors"]
    }
    capacities = {
        f"capacity_{name}": (f"nodes.{name}.capacity", _around(node["capacity"], rng.uniform(1.25, 1.5)))
        for name, node in simulator["nodes"].items()
    }
    others = {}
    coated: dict[str, list[str]] = {}
    for name, face in simulator["faces"].items():
        coated.setdefault(face["node"], []).append(name)
    for number, width in (("absorptivity", 0.15), ("emissivity", 0.1)):
        for node, names in coated.items():
            mean = simulator["faces"][names[0]][number]
            others[f"{number}_{node}"] = ([f"faces.{name}.{number}" for name in names], _share(rng, mean, width))
    first = next(iter(simulator["nodes"]))
    for mode, node in (("idle", first), ("busy", busy)):
        power = float(simulator["modes"][mode][node].split()[0])
        paths = [f"modes.{mode}.{node}"] if mode == "busy" else [f"modes.idle.{node}", f"modes.busy.{node}"]
        others[f"power_{mode}"] = (paths, _power(power, rng.uniform(0.1, 0.25)))
    pool = links | capacities | others
    chosen = [str(rng.choice(list(links))), str(rng.choice(list(capacities)))]
    left = [name for name in pool if name not in chosen]
    more = rng.permutation(len(left))[: int(rng.integers(4, 9)) - 2]
    chosen += [left[k] for k in more]
    return {name: {"sets": pool[name][0], "prior": pool[name][1]} for name in pool if name in chosen}


def _around(median: str, factor: float) -> dict[str, Any]:
    return {"lognormal": {"median": median, "factor": round(factor, 3)}}


def _share(rng: np.random.Generator, mean: float, width: float) -> dict[str, Any]:
    """Prior of an absorptivity or emissivity, one of two forms."""
    if rng.random() < 0.5:
        return {"uniform": [round(max(mean - width, 0.02), 3), round(min(mean + width, 0.98), 3)]}
    return {"truncated_normal": {"mean": mean, "standard_deviation": round(width / 2, 3), "lower": 0.02, "upper": 0.98}}


def _power(mean: float, deviation: float) -> dict[str, Any]:
    bounds = {"lower": f"{0.2 * mean:.3f} W", "upper": f"{2.0 * mean:.3f} W"}
    return {
        "truncated_normal": {"mean": f"{mean} W", "standard_deviation": f"{deviation * mean:.3f} W"} | bounds,
    }
