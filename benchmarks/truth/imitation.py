"""How well heat at the nodes imitates what a parameter does to the temperatures that a calibration is trained on."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flightcal.environment import orbit_phase
from flightcal.problem import build_problem
from flightcal.simulator import FloatArray

from .flight import Flight, read_flight, with_drivers
from .satellites import START
from .variants import INDEPENDENT

HARMONICS = 6
_UNIT = 0.01
"""Of the heat that flows through a node: deviation of a unit heat's prior, whose step the differences take."""
_LEAST = 1e-4
"""Of the greatest singular value: what takes heats that are so much larger is not imitated."""


def cosines(flight: Flight, folder: Path) -> dict[str, tuple[float, float]]:
    """Parameter -> cosine between its effect and the span of heats at the nodes, and the greatest with a single one.

    Effects are on the temperatures in the training, at the truth, over the sensors' deviations. A heat is constant or a
    harmonic of orbit phase, 0 to `HARMONICS`, at a node. Heaters do what their status says. Initial temperatures are
    no parameters: what they can imitate is taken out of all effects first.
    """
    waves = {
        f"heat_{node}_{k}": (node, k)
        for node in flight.satellite.written["simulator"]["nodes"]
        for k in range(2 * HARMONICS + 1)
    }
    written = with_drivers(flight.satellite.written, {name: node for name, (node, _) in waves.items()}) | INDEPENDENT
    written["simulator"]["step"] = "30 s"
    if flight.on:
        written["simulator"]["heater_input"] = "measured"
    for name, (node, _) in waves.items():
        prior = {"normal": {"mean": 0.0, "standard_deviation": _UNIT * flight.flow[node]}}
        written["parameters"][name] = {"sets": f"loads.{name}.coefficient", "prior": prior}
    written["windows"] = {"train": written["windows"]["train"]}
    plain, _ = read_flight(flight, flight.satellite.written, folder)
    phase = 2.0 * np.pi * orbit_phase(plain.environment, flight.satellite.times, folder, START)
    drivers = {name: (np.sin, np.cos)[k % 2 == 0]((k + 1) // 2 * phase) for name, (_, k) in waves.items()}
    scenario, data = read_flight(flight, written, folder, drivers)
    problem = build_problem(scenario, data)
    theta = problem.priors.median()
    for name, value in flight.truth.items():
        theta[problem.names.index(name)] = value
    (jacobian,) = problem.jacobians(problem.to_z(theta))
    deviations = np.array([flight.satellite.sensors[channel].deviation for channel in problem.channels])
    white = (jacobian / deviations[:, None])[problem.windows[0].valid]
    initial = [k for k, name in enumerate(problem.names) if name.startswith("initial.")]
    free = _without(white, white[:, initial])
    heats = free[:, [problem.names.index(name) for name in waves]]
    span = _basis(heats)
    heats = heats / np.maximum(np.linalg.norm(heats, axis=0), 1e-300)
    found = {}
    for name in flight.truth:
        values = free[:, problem.names.index(name)]
        values = values / max(float(np.linalg.norm(values)), 1e-300)
        found[name] = float(np.linalg.norm(span.T @ values)), float(np.abs(heats.T @ values).max())
    return found


def _without(columns: FloatArray, basis: FloatArray) -> FloatArray:
    """Columns [m, .] without what lies in the span of a basis [m, .]."""
    orthonormal = _basis(basis)
    return np.asarray(columns - orthonormal @ (orthonormal.T @ columns))


def _basis(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of the span of columns [m, .], each of which has a size of its own."""
    lengths = np.linalg.norm(columns, axis=0)
    left, values, _ = np.linalg.svd(columns / np.where(lengths > 0.0, lengths, 1.0), full_matrices=False)
    return np.asarray(left[:, values > _LEAST * values[0]])
