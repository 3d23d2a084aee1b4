"""Scenarios of the small satellite, and what is suspected of them."""

import numpy as np

from flightcal.check import suspects
from flightcal.problem import build_problem
from tests import small


def named(scenario, data):
    found = suspects(build_problem(scenario, data), data)
    assert found.looked
    print([(f.title, f.nats) for f in found.found])
    return found.found


def sunlit():
    """The small satellite with a face, in an orbit with eclipses."""
    written = small.content()
    written["environment"] = {
        "orbit": {"altitude": "600 km", "inclination": "97.8 deg", "ltan": "12:00", "epoch": "2024-03-01T00:00:00"}
    }
    looks = {"area": "0.05 m^2", "normal": [0, 0, -1], "absorptivity": 0.6, "emissivity": 0.8}
    written["simulator"]["faces"] = {"outside": {"node": "panel", **looks}}
    written["simulator"]["loads"]["sun"]["coefficient"] = "0.1 W/A"
    written["windows"] = {"train": {"start": "2024-03-01T01:00:00", "end": "2024-03-01T04:00:00"}}
    return written


def spoilt(data, **columns):
    return data.assign({name: ("time", np.asarray(values)) for name, values in columns.items()})


def silent(written):
    """A scenario whose heater has no status."""
    del written["simulator"]["heaters"]["heater"]["measured_by"]
    del written["telemetry"]["channels"]["heater_status"]
    del written["observations"]["heater_status"]
    return written


def two_faced():
    """The satellite with two faces that look along other axes."""
    written = sunlit()
    looks = {"area": "0.03 m^2", "normal": [1, 0, 0], "absorptivity": 0.5, "emissivity": 0.7}
    written["simulator"]["faces"]["ahead"] = {"node": "body", **looks}
    return written


def boxed():
    """The satellite with a face on each side, of two nodes."""
    written = two_faced()
    looks = {"absorptivity": 0.5, "emissivity": 0.7}
    for name, node, normal in (
        ("back", "panel", [-1, 0, 0]),
        ("left", "panel", [0, 1, 0]),
        ("down", "body", [0, 0, 1]),
    ):
        written["simulator"]["faces"][name] = {"node": node, "area": "0.04 m^2", "normal": normal, **looks}
    return written


def of_three():
    """The satellite with a second sensor of its panel, each of another packet than the body's."""
    written = sunlit()
    written["telemetry"]["channels"]["other_temp"] = {"column": "panel", "unit": "degC", "kind": "temperature"}
    written["observations"]["other_temp"] = {"node": "panel"}
    return written


def in_three():
    """The satellite in orbit with a third node, a tray that is linked with the body."""
    written = sunlit()
    model = written["simulator"]
    model["nodes"]["tray"] = {"capacity": "400 J/K"}
    model["conductors"].append({"between": ["body", "tray"], "conductance": "0.4 W/K"})
    written["telemetry"]["channels"]["tray_temp"] = {"column": "tray", "unit": "degC", "kind": "temperature"}
    written["observations"]["tray_temp"] = {"node": "tray"}
    return written


TRAY = {"tray": 5.0}
"""Of what is read of it; see `small.load`."""


def pointed(quaternion):
    """Three attitudes, one after another, that differ from this one by turns."""
    w, x, y, z = quaternion
    named = {
        "one": {"inertial": [w, x, y, z]},
        "other": {"inertial": [-x, w, -z, y]},
        "third": {"inertial": [y, z, -w, -x]},
    }
    at = ["2024-03-01T00:00:00", "2024-03-01T01:10:00", "2024-03-01T02:20:00"]
    return {"named": named, "timeline": [{"at": time, "attitude": name} for time, name in zip(at, named, strict=True)]}


def switching(**modes):
    """The satellite with two modes that take turns."""
    written = small.content()
    at = [f"2024-03-01T0{hour}:{minute}:00" for hour in range(3) for minute in ("05", "35")]
    written["simulator"]["modes"] = modes
    written["simulator"]["timeline"] = [
        {"at": "2024-02-29T00:00:00", "mode": "idle"},
        *({"at": time, "mode": ("busy", "idle")[k % 2]} for k, time in enumerate(at)),
    ]
    return written
