"""A reduced order model: small dense matrices for each product of free numbers, and its canonical form.

    (M dx/dt, 0) = sum_k p_k (L_k (x, q, v) + R_k (x, q, y)^4 + B_k w + sum_h u_h g_kh) + P h
    y = E (x, q) + e,    M = sum_k p_k M_k

The states x [r] are temperatures of nodes of the full network, so thermostats and observations look at states, and
initial states are temperatures. q are temperatures that settle at once; each has a balance, in which the rates of the
states stand for its own. v [s] are amplitudes of the fourth powers of what follows at once, such as the outer
layer of insulation: its balance is linear in them, whatever the step. h is heat into nodes of the full network that
no block describes.

In the canonical form y [m], v and q are massless states. Where no parameter touches M, the balances are solved for
dx/dt once and for all. Otherwise the rates z = dx/dt [r] are massless states too. Eliminating a massless state that
enters linearly gives the same Rosenbrock step as eliminating it from the equations first, so nothing is lost by it;
and with y first, then v, q, x and z the pivots of an implicit step are those of definite matrices, in the end
M - h/2 J, so that the kernel's factorisation needs no pivoting.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..scenario import FaceNormal
from ..simulator import FIELDS, FloatArray, IntArray, Network, Term, canonical_form, own_initial
from .affine import Kind, Product
from .names import node_name


@dataclass(frozen=True)
class ReducedModel:
    """Everything that a simulation needs, whatever the window and theta."""

    states: tuple[str, ...]
    """Nodes [r] of the full network whose temperatures are the states."""
    settled: tuple[str, ...]
    """Nodes [f] whose temperatures q settle at once."""
    mixed: tuple[str, ...]
    """Nodes [m] whose temperatures y are mixed from those of states and settled nodes: where radiation acts, and
    sensors."""
    mixing: FloatArray
    """E [m, r+f]"""
    mixing_offset: FloatArray
    """e [m] K"""
    free: tuple[str, ...]
    """Names of the free numbers; see `affine.Affine`."""
    values: FloatArray
    """SI, as written or prior medians."""
    columns: tuple[str, ...]
    """Input series w, as a network's; faces are the ways that faces look."""
    ways: dict[str, FaceNormal]
    """Name -> how faces look."""
    heaters: tuple[str, ...]
    sensors: tuple[int, ...]
    """[H] state that each thermostat watches."""
    capacity: dict[Product, FloatArray]
    """M_k [r+f, r] J/K."""
    matrices: dict[Kind, dict[Product, FloatArray]]
    """linear L_k [r+f+s, r+f+s], radiative R_k [r+f+s, r+f+m], forcing B_k [r+f+s, w], heating g_k [r+f+s, H]; W."""
    followers: int
    """s"""
    full: tuple[str, ...]
    """Nodes [n] of the full network that have a capacity."""
    entering: FloatArray
    """P^T [n, r+f+s]: what a watt into each of these adds to the balances."""
    initial: FloatArray
    """[r] K, typical."""
    initial_covariance: FloatArray
    """[r, r] K^2, of the states over the training runs."""
    shifts: tuple[tuple[float, float], ...] = ()
    """[H] (on, off) K: how far from its thresholds the on-board software switches each heater; none: not at all."""

    @property
    def massless(self) -> int:
        """How many massless states it has in the canonical form."""
        rates = 0 if self.constant_capacity else len(self.states)
        return len(self.settled) + len(self.mixed) + self.followers + rates

    @property
    def constant_capacity(self) -> bool:
        """Whether no parameter touches M."""
        return set(self.capacity) == {()}

    @property
    def solved(self) -> FloatArray:
        """[r+f+s, r+f+s]: what makes of the balances those of dx/dt, and of q and v without the states' rates."""
        r, f = len(self.states), len(self.settled)
        stored, of_settled = np.split(self.capacity[()], [r])
        inverse = np.linalg.inv(stored)
        found = np.eye(r + f + self.followers)
        found[:r, :r] = inverse
        found[r : r + f, :r] = -of_settled @ inverse
        return found


def initial_given(model: ReducedModel, known: Mapping[str, float], spread: float) -> dict[str, tuple[float, float]]:
    """Mean and deviation (K) of each other state's temperature, where some are known (K) to a deviation `spread`.

    known: by plain names. As the training runs have them at any time.
    """
    names = [node_name(name) for name in model.states]
    seen = [k for k, name in enumerate(names) if name in known]
    rest = [k for k, name in enumerate(names) if name not in known]
    covariance = model.initial_covariance
    within = covariance[np.ix_(seen, seen)] + spread**2 * np.eye(len(seen))
    gain = np.linalg.solve(within, covariance[np.ix_(seen, rest)]).T
    off = np.array([known[names[k]] for k in seen]) - model.initial[seen]
    variance = np.diag(covariance[np.ix_(rest, rest)] - gain @ covariance[np.ix_(seen, rest)])
    deviation = np.sqrt(np.maximum(variance, 0.0))
    mean = model.initial[rest] + gain @ off
    return {names[k]: (float(m), float(d)) for k, m, d in zip(rest, mean, deviation, strict=True)}


def network_of(model: ReducedModel, numbers: Mapping[str, float] | None = None, heated: Sequence[str] = ()) -> Network:
    """The model in the canonical form, as a network that `NetworkSimulator` runs.

    numbers: by dotted path, SI: they replace free numbers of the same path, or stand beside them (biases of channels).
    heated: nodes of the full network, by their plain names, that take heat that no block describes.
    """
    values = dict(zip(model.free, model.values.tolist(), strict=True)) | dict(numbers or {})
    r, f, m, s = len(model.states), len(model.settled), len(model.mixed), model.followers
    rates = not model.constant_capacity
    y, v, q, x, z = np.split(np.arange(m + s + f + r + rates * r), np.cumsum([m, s, f, r]))
    balances, unknowns = np.concatenate([z if rates else x, q, v]), np.concatenate([x, q, v])
    solved = np.eye(len(balances)) if rates else model.solved
    temperatures, radiating = unknowns[: r + f], np.concatenate([x, q, y])
    terms: dict[str, dict[tuple[int, int], list[Term]]] = {kind: defaultdict(list) for kind in FIELDS}
    one = model.columns.index("one")
    for i in range(m):
        terms["linear"][y[i], y[i]].append((-1.0, ()))
        terms["forcing"][y[i], one].append((model.mixing_offset[i], ()))
        for j in range(r + f):
            terms["linear"][y[i], temperatures[j]].append((model.mixing[i, j], ()))
    for i in range(len(z)):
        terms["linear"][x[i], z[i]].append((1.0, ()))
    for product, matrix in model.capacity.items() if rates else ():
        _add(terms["linear"], balances, z, -matrix, product)
    columns: dict[Kind, IntArray] = {
        "linear": unknowns,
        "radiative": radiating,
        "forcing": np.arange(len(model.columns)),
    }
    for kind, these in columns.items():
        for product, matrix in model.matrices[kind].items():
            _add(terms[kind], balances, these, solved @ matrix, product)
    names = [node_name(name) for name in model.full]
    entering = model.entering[[names.index(name) for name in heated]].T
    _add(terms["forcing"], balances, len(model.columns) + np.arange(len(heated)), solved @ entering, ())
    for product, matrix in model.matrices["heating"].items():
        _add(terms["heating"], np.arange(len(model.heaters)), balances, (solved @ matrix).T, product)
    shifts = model.shifts or ((0.0, 0.0),) * len(model.heaters)
    for k, heater in enumerate(model.heaters):
        for limit, field, shift in zip(("lower", "upper"), ("on_below", "off_above"), shifts[k], strict=True):
            terms[limit][k, 0] += [(1.0, (model.free.index(f"heaters.{heater}.{field}"),)), (shift, ())]
    mass = np.concatenate([np.zeros(m + s + f), np.ones(r), np.zeros(len(z))])
    watched = [int(x[k]) for k in model.sensors]
    structure, table = canonical_form(terms, mass, watched, len(values), own_initial(mass))
    return Network(
        nodes=(
            *map(node_name, model.mixed),
            *(f"follower.{k}" for k in range(s)),
            *map(node_name, model.settled),
            *map(node_name, model.states),
            *(f"rate.{name}" for name in model.states if rates),
        ),
        columns=(*model.columns, *(f"heat.{name}" for name in heated)),
        paths=tuple(values),
        values=np.array(list(values.values())),
        heaters=model.heaters,
        structure=structure,
        terms=table,
        heated=tuple(heated),
    )


def _add(
    entries: dict[tuple[int, int], list[Term]],
    rows: IntArray,
    columns: IntArray,
    matrix: FloatArray,
    product: Product,
) -> None:
    for i, j in zip(*np.nonzero(matrix), strict=True):
        entries[int(rows[i]), int(columns[j])].append((float(matrix[i, j]), product))
