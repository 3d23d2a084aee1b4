"""Which parameters unmodelled heat can imitate, in the linear approximation around one point."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np
from scipy.linalg import solve_triangular

from ..errors import FlightcalError
from ..probability import DEVIATION, shape_of, through_noise
from ..problem import Entry, Problem, Window, heat_in_prior, held_by, hold, responses, sampled_windows, unit_heats
from ..scenario import heat_of
from ..simulator import FloatArray, SimulationFailure

ALIKE = 0.9
"""Cosine from which heat can imitate a parameter, or one heat two of them."""
WIDER = 4.0
"""Times as wide as without heat, from which it matters."""
_NOTICED = 1.25
"""The same below which a parameter that heat can imitate is not worth a word."""
_KNOWN = 0.1
"""Of its prior's width, up to which a parameter is told well beside heat."""
_DEPENDENT = 1e-6
"""Of the largest singular value."""

Kind = Literal["surface", "power", "path", "other"]
_KINDS: dict[str, Kind] = {
    "absorptivity": "surface", "emissivity": "surface", "area": "surface", "modes": "power", "loads": "power",
    "heaters": "path", "conductors": "path", "capacity": "path",
}  # fmt: skip


@dataclass(frozen=True)
class Imitated:
    """What heat takes from a parameter."""

    name: str
    kind: Kind
    """What would tell it from heat: surface (of a face), power (of modes and loads), path (of heat: links,
    capacities, heaters), other."""
    node: str
    """Whose heat is most like it."""
    cosine: float
    """Between its effect on the temperatures and what heat of that node, of its prior's size, can do; 1: the same."""
    without: float
    """Posterior deviation without heat, in those of the prior,"""
    beside: float
    """and with heat of all nodes integrated out."""

    @property
    def growth(self) -> float:
        """How many times as wide the posterior is with heat."""
        return self.beside / self.without

    @property
    def matters(self) -> bool:
        """Whether heat can imitate it and does, or takes much of what is known of it, and leaves little."""
        taken = self.growth > WIDER or (self.cosine > ALIKE and self.growth > _NOTICED)
        return taken and self.beside > _KNOWN


@dataclass(frozen=True)
class BesideHeat:
    """What heat takes from the parameters."""

    parameters: tuple[Imitated, ...]
    """Those that move temperatures; the most alike first."""
    pairs: tuple[tuple[str, str, str, float], ...]
    """Two parameters that heat of one node imitates in the same way, the node, and the cosine between the two."""


def beside_heat(problem: Problem, z: FloatArray) -> BesideHeat | None:
    """What heat takes from the parameters of a problem of thermal networks at z [d]; None where there is no heat.

    Heat has its prior's size, and noise is that of z. Where heaters have a measured status, they are driven by it.
    Raises FlightcalError where a simulation next to z fails.
    """
    if heat_of(problem.scenario) is None or any(
        not window.is_network or not window.network.network.heated for window in problem.windows
    ):
        return None
    theta = problem.to_theta(z)
    windows = [_held(window, problem.at(window, theta)) for window in sampled_windows(problem)]
    driven = replace(problem, windows=tuple(windows), open_loop=None)
    thetas = [problem.at(window, theta) for window in windows]
    try:
        model = heat_in_prior(problem, windows)
        assert model is not None
        units = [unit_heats(model, window) for window in windows]
        effects = driven.jacobians(z)
        heats = [responses(window, at, model, heat) for window, at, heat in zip(windows, thetas, units, strict=True)]
    except SimulationFailure as failure:
        raise FlightcalError(f"simulations next to the mode fail: {failure}") from None
    most = [max(series.shape[2] for series in of_group) for of_group in zip(*heats, strict=True)]
    sizes = np.repeat([group.size for group in model.groups], most)
    # That of a switch's time is the heater's, which the telemetry has; that of a gap is the driver's; and an error of
    # the simulator is no heat. None is like what is inferred.
    node = np.concatenate(
        [
            np.full(count, -1) if group.part in ("switches", "changes", "gaps", "error") else group_units.node
            for group, group_units, count in zip(model.groups, units[0], most, strict=True)
        ]
    )
    whitened = [_whitening(window, at) for window, at in zip(windows, thetas, strict=True)]
    effect = np.concatenate([whiten(jacobian) for whiten, jacobian in zip(whitened, effects, strict=True)])
    heat = np.concatenate(
        [whiten(_padded(window_heats, most)) for whiten, window_heats in zip(whitened, heats, strict=True)]
    )
    by_node = {name: heat[:, node == k] * sizes[node == k] for k, name in enumerate(model.nodes)}
    return _compared(problem.entries, effect * problem.priors.spread(), heat * sizes, by_node)


def _held(window: Window, theta: FloatArray) -> Window:
    """A window in which no thermostat acts, if it is in open loop."""
    held = held_by(window, theta)
    return window if held is None else hold(window, held)


def _padded(of_groups: Sequence[FloatArray], most: Sequence[int]) -> FloatArray:
    """Responses [T, N, f] of all groups side by side; a window without a group's functions does not answer to them."""
    wide = [
        np.pad(columns, ((0, 0), (0, 0), (0, count - columns.shape[2])))
        for columns, count in zip(of_groups, most, strict=True)
    ]
    return np.concatenate(wide, axis=2)


def _whitening(window: Window, theta: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """What makes of a window's temperatures [T, N, c] at theta [q] independent ones [N T, c], in deviations.

    They are zero where there is no sample.
    """
    terms, numbers = window.residuals.terms, window.numbers(theta)
    shapes = tuple(map(shape_of, terms.kinds, numbers))
    through = through_noise(replace(terms, kinds=shapes, heat=None))
    deviation = numbers[:, DEVIATION, None, None]
    return lambda columns: np.asarray((through(columns) / deviation).reshape(-1, columns.shape[2]))


def _compared(
    entries: Sequence[Entry], effect: FloatArray, heat: FloatArray, by_node: Mapping[str, FloatArray]
) -> BesideHeat:
    """Of effects [R, d] of a deviation of each prior, and of heat [R, m] and by node [R, .] of one weight's each."""
    aside = np.array([not entry.is_of_network for entry in entries])
    without = _widths(effect.T @ effect)
    beside = _widths(effect.T @ effect - _shared(effect, heat))
    basis = _basis(effect[:, aside])
    left = effect - basis @ (basis.T @ effect)
    told = np.einsum("rd,rd->d", left, left)
    shared = {name: _shared(left, columns - basis @ (basis.T @ columns)) for name, columns in by_node.items()}
    found: dict[int, Imitated] = {}
    for k, entry in enumerate(entries):
        if entry.kind == "parameter" and told[k] > 0.0:
            node = max(shared, key=lambda name: float(shared[name][k, k]))
            cosine = float(np.sqrt(np.clip(shared[node][k, k] / told[k], 0.0, 1.0)))
            found[k] = Imitated(entry.name, _kind(entry), node, cosine, float(without[k]), float(beside[k]))
    pairs = []
    for i, j in combinations([k for k, imitation in found.items() if imitation.cosine > ALIKE], 2):
        if found[i].node == found[j].node:
            shared_by = shared[found[i].node]
            cosine = float(abs(shared_by[i, j]) / np.sqrt(shared_by[i, i] * shared_by[j, j]))
            if cosine > ALIKE:
                pairs.append((entries[i].name, entries[j].name, found[i].node, cosine))
    parameters = sorted(found.values(), key=lambda imitation: -imitation.cosine)
    return BesideHeat(tuple(parameters), tuple(sorted(pairs, key=lambda pair: -pair[3])))


def _widths(information: FloatArray) -> FloatArray:
    """Posterior deviations [d] with an information [d, d] beside the prior's."""
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(information + np.eye(len(information))))))


def _shared(effect: FloatArray, heat: FloatArray) -> FloatArray:
    """Information [d, d] that heat with weights N(0, 1) takes, by Woodbury's identity."""
    factor = np.linalg.cholesky(np.eye(heat.shape[1]) + heat.T @ heat)
    half = solve_triangular(factor, heat.T @ effect, lower=True)
    return np.asarray(half.T @ half)


def _basis(columns: FloatArray) -> FloatArray:
    """Orthonormal, of the columns' span."""
    norms = np.linalg.norm(columns, axis=0)
    directions, sizes, _ = np.linalg.svd(columns[:, norms > 0.0] / norms[norms > 0.0], full_matrices=False)
    return np.asarray(directions[:, sizes > _DEPENDENT * sizes.max(initial=0.0)])


def _kind(entry: Entry) -> Kind:
    """By the numbers that a parameter sets or scales."""
    for path in (*entry.sets, *entry.scales):
        first, *_, last = path.split(".")
        if first in _KINDS or last in _KINDS:
            return _KINDS[last if last in _KINDS else first]
    return "other"
