"""Networks of any size in the canonical form, for the scaling tables."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from flightcal.scenario.body import Body, Box, Coating, Material, Side
from flightcal.scenario.geometry import box_joints, box_plates, mesh_plates
from flightcal.simulator import Drive, Structure, System
from flightcal.simulator.system import elimination_order, make_structure

from .problem import NOISE, START

ORBIT = 5910.0  # s, at 690 km
STEP = 60.0  # s
_SIGMA = 5.670374419e-8  # W m^-2 K^-4, CODATA 2018
_PER_BOX = 96
_CAPACITY, _CONDUCTANCE, _AREA = 1000.0, 0.5, 0.02  # J/K, W/K, m^2 (times emissivity)

Case = tuple[Structure, System, Drive]


def chain(nodes: int, heaters: int = 1, orbits: int = 2) -> Case:
    """Nodes in a row."""
    return _network(nodes, [(i, i + 1) for i in range(nodes - 1)], heaters, orbits)


def plate(nodes: int, heaters: int = 1, orbits: int = 2) -> Case:
    """Nodes on a square, each linked to its neighbours."""
    side = round(nodes**0.5)
    at = np.arange(side * side).reshape(side, side)
    pairs = [
        *zip(at[:, :-1].ravel(), at[:, 1:].ravel(), strict=True),
        *zip(at[:-1].ravel(), at[1:].ravel(), strict=True),
    ]
    return _network(side * side, [(int(i), int(j)) for i, j in pairs], heaters, orbits)


def boxes(nodes: int, heaters: int = 1, orbits: int = 2) -> Case:
    """Spacecraft units: boxes of six plates of 4 x 4 nodes, joined along their edges, each box bolted to the next.

    So large networks come about: by more units, not by one ever finer plate.
    """
    count = max(1, round(nodes / _PER_BOX))
    materials, coatings = {"aluminium": Material(150.0, 2700.0, 900.0)}, {"black": Coating(0.9, 0.9)}
    unit = Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.003, "aluminium", 4, Side("black"), "black", joints=10.0)
    bare = {name: replace(p, positive=None, negative=None) for name, p in box_plates("unit", unit).items()}
    mesh = mesh_plates(
        Body(materials=materials, coatings=coatings, plates=bare, joints=tuple(box_joints("unit", unit)))
    )
    place = {name: k for k, name in enumerate(mesh.nodes)}
    assert len(place) == _PER_BOX
    within = [(place[a], place[b]) for a, b in (conductor.between for conductor in mesh.conductors)]
    corners = [(place[f"unit.x+[{i},{j}]"], place[f"unit.x-[{i},{j}]"]) for i in (0, 3) for j in (0, 3)]
    links = [(k * _PER_BOX + i, k * _PER_BOX + j) for k in range(count) for i, j in within]
    links += [(k * _PER_BOX + i, (k + 1) * _PER_BOX + j) for k in range(count - 1) for i, j in corners]
    return _network(count * _PER_BOX, links, heaters, orbits)


def _network(n: int, links: list[tuple[int, int]], heaters: int, orbits: int) -> Case:
    order = elimination_order(n, links)
    place = {node: k for k, node in enumerate(order)}
    linear: dict[tuple[int, int], float] = {(i, i): 0.0 for i in range(n)}
    for first, second in links:
        for i, j in ((place[first], place[second]), (place[second], place[first])):
            linear[i, j] = _CONDUCTANCE / _CAPACITY
            linear[i, i] -= _CONDUCTANCE / _CAPACITY
    places = sorted(linear)
    heated = [place[int(node)] for node in np.linspace(0, n - 1, heaters + 2)[1:-1]] if heaters else []
    lit = sorted(place[node] for node in range(0, n, 2))
    # A constant 5 W everywhere, and 14 W of sunlight on every second node.
    forcing = sorted([*((i, 0) for i in range(n)), *((i, 1) for i in lit)])
    watts = (4.0, 5.0)
    times = np.linspace(0.0, orbits * ORBIT, round(orbits * ORBIT / STEP) + 1)
    sun = np.maximum(np.sin(2.0 * np.pi * times / ORBIT), 0.0)
    structure = make_structure(
        np.ones(n), places, [(i, i) for i in range(n)], [], forcing, [(k, i) for k, i in enumerate(heated)], heated
    )
    system = System(
        linear=np.array([linear[entry] for entry in places]),
        radiative=np.full(n, -_SIGMA * _AREA / _CAPACITY),
        quadratic=np.empty(0),
        forcing=np.array([watts[column] / _CAPACITY for _, column in forcing]),
        heating=np.full(len(heated), 12.0 / _CAPACITY),
        lower=np.full(len(heated), 283.15),
        upper=np.full(len(heated), 286.15),
        initial=np.full(n, 284.65),
    )
    points = np.stack([np.ones_like(times), sun], axis=1)
    drive = Drive(
        times=times,
        inputs=np.stack([points[:-1], points[1:]], axis=1),
        measured=np.full((len(times) - 1, len(heated)), np.nan),
        initially_on=np.zeros(len(heated)),
    )
    return structure, system, drive


def with_parameters(count: int, nodes: int = 100) -> dict[str, Any]:
    """A scenario of a chain of nodes of which `count` numbers are parameters: capacities first, then conductances."""
    names = [f"node_{k}" for k in range(nodes)]
    watched = names[:: nodes // 10]
    paths = [
        *((f"nodes.{name}.capacity", f"{_CAPACITY} J/K") for name in names),
        *((f"conductors.{a}-{b}.conductance", f"{_CONDUCTANCE} W/K") for a, b in pairwise(names)),
        ("heaters.heater.power", "12 W"),
    ]
    return {
        "name": "scaling",
        "telemetry": {
            "file": "telemetry.csv",
            "time": {"column": "time"},
            "channels": {name: {"column": name, "unit": "degC", "kind": "temperature"} for name in watched},
        },
        "environment": {"period": f"{ORBIT} s"},
        "simulator": {
            "step": f"{STEP} s",
            "nodes": {
                **{name: {"capacity": f"{_CAPACITY} J/K", "initial": "11.5 degC"} for name in names},
                "space": {"boundary": "4 K"},
            },
            "conductors": [
                *({"between": [a, b], "conductance": f"{_CONDUCTANCE} W/K"} for a, b in pairwise(names)),
                *({"between": [name, "space"], "radiative": f"{_AREA} m^2"} for name in names),
            ],
            "heaters": {
                "heater": {
                    "node": names[50],
                    "power": "12 W",
                    "sensor": names[50],
                    "on_below": "10 degC",
                    "off_above": "13 degC",
                }
            },
            "modes": {"nominal": dict.fromkeys(names, "5 W")},
        },
        "parameters": {
            f"p{k}": {"sets": path, "prior": {"lognormal": {"median": median, "factor": 1.2}}}
            for k, (path, median) in enumerate(paths[:count])
        },
        "observations": {name: {"node": name, "noise": f"{NOISE} K"} for name in watched},
        "heat": "none",
        "windows": {
            "train": {"start": str(START)[:19], "orbits": 2},
            "test": {"start": str(START + np.timedelta64(12000, "s"))[:19], "orbits": 2},
        },
        "calibration": {"seed": 1},
    }
