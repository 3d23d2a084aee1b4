"""Parametric POD-Galerkin: the full network projected on the shapes that its temperatures take.

Snapshots of runs over prior draws and windows give a basis by SVD, in the norm of the heat capacities with the
sensors' nodes, and those next to them, weighted up (without either: ten times the error). Its
coordinates are changed so that the states are temperatures of nodes: the sensors', the thermostats', and those that a
pivoted QR decomposition of the basis picks. The network's matrices are projected for each product of free numbers
(Benner, Gugercin & Willcox 2015, SIAM Review 57, 483-531, sec. 3).

Units on weak links have a shape each of their own. Of the shapes only the slowest store heat; the others settle at
once: their temperatures T_f change as dT_f/dt = G dT_s/dt with those of the states, G the static response (Guyan 1965,
AIAA J. 3, 380), but stand in the balances as what they are, so heat that goes in moves them at once. (Draws of
leo_observer that it was not fitted to, twelve states, 95%: 0.20 K without, 0.15 K with six settled shapes; sixteen
states: 0.06 K without, 0.14 K with. So `reduce` tries both.)

T^4 is interpolated from a few nodes (Q-DEIM: Drmac & Gugercin 2016, SIAM J. Sci. Comput. 38, A631-A648): the basis is
that of T^4 of projected snapshots, the nodes are the pivots. Where enough of the model's own nodes radiate, they are
the points: a temperature elsewhere is one more unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eig, qr

from ..scenario import FaceNormal, Scenario
from ..simulator import FloatArray, IntArray, Network
from .affine import Affine, Product, product_of
from .full_order import FullRuns
from .reduced_model import ReducedModel

FOURTH = 1e8  # K^4, the unit of the followers' amplitudes
_EVERY = 2
"""Of the times of a run that are snapshots, one in so many."""
_FOLLOWERS_LOST = 1e-6
"""Share of the followers' T^4 (its squares) that their amplitudes leave out."""


@dataclass(frozen=True)
class Snapshots:
    """What the training runs say, prepared once for any order."""

    nodes: tuple[str, ...]
    """Of the network [n]."""
    stored: IntArray
    """[k] nodes whose heat is stored: all but the followers."""
    following: IntArray
    """[n - k] nodes so light that their temperature follows the heat at once."""
    temperatures: FloatArray
    """[s, k] K, of the stored."""
    mean: FloatArray
    """[k] K"""
    basis: FloatArray
    """[k, most] orthonormal after weighting, by decreasing share."""
    follower_basis: FloatArray
    """[n - k, s] of the followers' T^4 / FOURTH."""


@dataclass(frozen=True)
class Shapes:
    """T = offset + lift x: temperatures of all stored nodes [k] from those of a few [r]."""

    nodes: tuple[str, ...]
    lift: FloatArray
    """[k, r]"""
    offset: FloatArray
    """[k] K"""


def collect(
    network: Network, affine: Affine, runs: Sequence[FullRuns], sensors: Sequence[str], most: int, light: float
) -> Snapshots:
    """Snapshots of training runs. light: time constant (s) up to which a node that only radiates follows at once."""
    temperatures = np.concatenate([run.temperatures[:, ::_EVERY].reshape(-1, len(network.nodes)) for run in runs])
    following = _followers(network, affine, temperatures.mean(axis=0), set(sensors), light)
    stored = np.setdiff1d(np.arange(len(network.nodes)), following)
    capacity = np.sum(list(affine.capacity.values()), axis=0)[stored]
    alone = _keeping_heat(network, affine, temperatures.mean(axis=0), sensors, light)
    rest = np.flatnonzero(~np.isin(stored, alone))
    weight = capacity / capacity.sum()
    important = _with_neighbours(affine, {network.nodes.index(name) for name in sensors})
    weight[np.isin(stored, important)] += 1.0 / len(important)
    root = np.sqrt(weight)
    mean = temperatures[:, stored].mean(axis=0)
    _, _, shapes = np.linalg.svd(((temperatures[:, stored] - mean) * root)[:, rest], full_matrices=False)
    basis = np.zeros((len(stored), len(alone) + len(shapes)))
    basis[np.searchsorted(stored, alone), np.arange(len(alone))] = 1.0
    basis[rest, len(alone) :] = shapes.T / root[rest, None]
    fourth = temperatures[:, following] ** 4 / FOURTH
    _, sizes, followers = np.linalg.svd(fourth, full_matrices=False)
    share = np.cumsum(sizes**2) / max((sizes**2).sum(), 1e-300)
    count = int(np.searchsorted(share, 1.0 - _FOLLOWERS_LOST)) + 1 if len(following) else 0
    return Snapshots(
        network.nodes,
        stored,
        following,
        temperatures[:, stored],
        mean,
        basis[:, :most],
        followers[:count].T,
    )


def choose_shapes(snapshots: Snapshots, first: Sequence[str], order: int) -> Shapes:
    """The basis of `order` shapes in coordinates that are temperatures of nodes, those of `first` among them."""
    names = [snapshots.nodes[k] for k in snapshots.stored]
    basis = snapshots.basis[:, :order]
    chosen = [names.index(name) for name in dict.fromkeys(first)][:order]
    # What the chosen nodes already tell is taken out of the basis.
    q, _ = np.linalg.qr(basis[chosen].T)
    rest = basis - (basis @ q) @ q.T
    rest[chosen] = 0.0
    _, _, pivots = qr(rest.T, pivoting=True, mode="economic")
    chosen += [int(k) for k in pivots[: order - len(chosen)]]
    lift: FloatArray = np.asarray(np.linalg.solve(basis[chosen].T, basis.T).T, float)
    lift[chosen] = np.eye(order)
    offset: FloatArray = snapshots.mean - lift @ snapshots.mean[chosen]
    offset[chosen] = 0.0
    return Shapes(tuple(names[k] for k in chosen), lift, offset)


def project(
    network: Network,
    affine: Affine,
    scenario: Scenario,
    shapes: Shapes,
    snapshots: Snapshots,
    sampled: int,
    observed: Sequence[str] = (),
    states: int | None = None,
) -> ReducedModel:
    """The network on `shapes`, with T^4 from `sampled` nodes.

    states: how many of the shapes' nodes store heat, the `observed` first; the others settle at once. None: all store.
    """
    order, response = _split(affine, shapes, snapshots, observed, len(shapes.nodes) if states is None else states)
    slow = response.shape[1]
    chosen = tuple(shapes.nodes[k] for k in order)
    stored, following, lift, offset = snapshots.stored, snapshots.following, shapes.lift[:, order], shapes.offset
    names = [network.nodes[k] for k in stored]
    place = [names.index(name) for name in chosen]
    reached = snapshots.temperatures[:, place]
    radiating = _radiating(affine, stored)
    radiators = [int(k) for k in np.flatnonzero(np.isin(radiating, place))]
    points, spread = _interpolation(offset[radiating] + reached @ lift[radiating].T, sampled, radiators)
    sampled_nodes = [int(radiating[k]) for k in points]
    seen = [names.index(name) for name in observed]
    mixed = [k for k in dict.fromkeys([*sampled_nodes, *seen]) if k not in place]
    # T^4 of all nodes, from that of the states and of the mixed ones, and from the followers' amplitudes.
    fourth = np.zeros((len(network.nodes), len(place) + len(mixed)))
    fourth[np.ix_(stored[radiating], np.array([[*place, *mixed].index(k) for k in sampled_nodes]))] = spread
    followed = np.zeros((len(network.nodes), snapshots.follower_basis.shape[1]))
    followed[following] = FOURTH * snapshots.follower_basis
    # Heat into the states' shapes, and into the followers'.
    test = np.zeros((len(network.nodes), len(place) + followed.shape[1]))
    test[stored, : len(place)] = lift
    test[following, len(place) :] = snapshots.follower_basis
    whole_lift, whole_offset = np.zeros((len(network.nodes), len(place))), np.zeros(len(network.nodes))
    whole_lift[stored], whole_offset[stored] = lift, offset

    columns, ways, gather = merged_columns(network, scenario)
    none = np.zeros((test.shape[1], len(columns)))
    linear: dict[Product, FloatArray] = {}
    forcing = {p: test.T @ (matrix @ gather) for p, matrix in affine.matrices["forcing"].items()}
    for p, matrix in affine.matrices["linear"].items():
        linear[p] = np.hstack([test.T @ (matrix @ whole_lift), np.zeros((test.shape[1], followed.shape[1]))])
        forcing[p] = forcing.get(p, none).copy()
        forcing[p][:, columns.index("one")] += test.T @ (matrix @ whole_offset)
    for p, matrix in affine.matrices["radiative"].items():
        by_followers = np.hstack([np.zeros((test.shape[1], len(place))), test.T @ (matrix @ followed)])
        linear[p] = linear.get(p, 0.0) + by_followers
    heaters = scenario.network.switches
    return ReducedModel(
        states=chosen[:slow],
        settled=chosen[slow:],
        mixed=tuple(names[k] for k in mixed),
        mixing=lift[mixed],
        mixing_offset=offset[mixed],
        free=affine.free,
        values=affine.values,
        columns=columns,
        ways=ways,
        heaters=network.heaters,
        sensors=tuple(chosen.index(heaters[name].sensor) for name in network.heaters),
        capacity={p: lift.T @ (c[stored, None] * (lift @ response)) for p, c in affine.capacity.items()},
        matrices={
            "linear": linear,
            "radiative": {p: test.T @ (matrix @ fourth) for p, matrix in affine.matrices["radiative"].items()},
            "forcing": forcing,
            "heating": {p: test.T @ matrix.toarray() for p, matrix in affine.matrices["heating"].items()},
        },
        followers=followed.shape[1],
        full=tuple(network.nodes[k] for k in network.diffusive),
        entering=test[network.diffusive],
        initial=reached[:, :slow].mean(axis=0),
        initial_covariance=np.cov(reached[:, :slow], rowvar=False).reshape(slow, slow),
    )


def _split(
    affine: Affine, shapes: Shapes, snapshots: Snapshots, first: Sequence[str], count: int
) -> tuple[list[int], FloatArray]:
    """Order of the shapes' nodes, those that store heat first, and the rates of all [k] from theirs [k, count].

    `first` store heat, and then one by one the nodes that move most in the slowest way to move while those held so far
    stay as they are.
    """
    capacity, conductance = _linearised(affine, shapes, snapshots)
    total = len(shapes.nodes)
    slow = [shapes.nodes.index(name) for name in dict.fromkeys(first) if name in shapes.nodes][:count]
    while len(slow) < min(count, total):
        free = [k for k in range(total) if k not in slow]
        rates, ways = eig(conductance[np.ix_(free, free)], capacity[np.ix_(free, free)])
        way = np.abs(ways[:, np.argmin(rates.real)]) * np.sqrt(np.diag(capacity)[free])
        slow.append(free[int(np.argmax(way))])
    settled = [k for k in range(total) if k not in slow]
    follow = -np.linalg.solve(conductance[np.ix_(settled, settled)], conductance[np.ix_(settled, slow)])
    return [*slow, *settled], np.vstack([np.eye(len(slow)), follow])


def _linearised(affine: Affine, shapes: Shapes, snapshots: Snapshots) -> tuple[FloatArray, FloatArray]:
    """Capacity and conductance [k, k] of the shapes at the medians and mean temperatures, followers in balance."""
    stored, following = snapshots.stored, snapshots.following
    size, count = len(snapshots.nodes), len(shapes.nodes)
    lift, test = np.zeros((size, count)), np.zeros((size, count + snapshots.follower_basis.shape[1]))
    lift[stored] = test[stored, :count] = shapes.lift
    test[following, count:] = snapshots.follower_basis
    slope = np.zeros((size, test.shape[1]))  # of sigma T^4, but for the constant, by each unknown
    slope[stored, :count] = 4.0 * snapshots.mean[:, None] ** 3 * shapes.lift
    slope[following, count:] = FOURTH * snapshots.follower_basis
    balance = np.zeros((test.shape[1], test.shape[1]))
    for product, matrix in affine.matrices["linear"].items():
        balance[:, :count] += product_of(affine.values, product) * (test.T @ (matrix @ lift))
    for product, matrix in affine.matrices["radiative"].items():
        balance += product_of(affine.values, product) * (test.T @ (matrix @ slope))
    inner = balance[:count, :count].copy()
    if test.shape[1] > count:
        inner -= balance[:count, count:] @ np.linalg.solve(balance[count:, count:], balance[count:, :count])
    capacity = np.sum([product_of(affine.values, p) * c for p, c in affine.capacity.items()], axis=0)[stored]
    return shapes.lift.T @ (capacity[:, None] * shapes.lift), -inner


def _followers(network: Network, affine: Affine, mean: FloatArray, kept: set[str], light: float) -> IntArray:
    """Nodes that exchange heat by radiation only, and so little of it that they are settled within `light` s."""
    capacity = np.sum(list(affine.capacity.values()), axis=0)
    emission = np.zeros(len(mean))
    conducting, heated = np.zeros(len(mean), bool), np.zeros(len(mean), bool)
    for product, matrix in affine.matrices["radiative"].items():
        emission -= product_of(affine.values, product) * matrix.diagonal()
    for matrix in affine.matrices["linear"].values():
        conducting[np.unique(matrix.nonzero()[0])] = True
    for matrix in affine.matrices["heating"].values():
        heated[np.unique(matrix.nonzero()[0])] = True
    settled = capacity < light * 4.0 * emission * mean**3
    named = np.array([name in kept for name in network.nodes])
    return np.flatnonzero(settled & ~conducting & ~heated & ~named)


def _keeping_heat(network: Network, affine: Affine, mean: FloatArray, nodes: Sequence[str], time: float) -> list[int]:
    """Those of `nodes` that keep their heat for longer than `time` s: units on weak links."""
    leaving = np.zeros(len(mean))
    for product, matrix in affine.matrices["linear"].items():
        leaving -= product_of(affine.values, product) * matrix.diagonal()
    for product, matrix in affine.matrices["radiative"].items():
        leaving -= product_of(affine.values, product) * matrix.diagonal() * 4.0 * mean**3
    capacity = np.sum([product_of(affine.values, p) * c for p, c in affine.capacity.items()], axis=0)
    numbers = sorted({network.nodes.index(name) for name in nodes})
    return [k for k in numbers if capacity[k] > time * leaving[k]]


def _with_neighbours(affine: Affine, nodes: set[int]) -> list[int]:
    """The nodes, and those that they conduct heat to: a sensor is as good as what its heat comes from."""
    near = set(nodes)
    for matrix in affine.matrices["linear"].values():
        for node in nodes:
            near |= {int(k) for k in matrix.indices[matrix.indptr[node] : matrix.indptr[node + 1]]}
    return sorted(near)


def _radiating(affine: Affine, stored: IntArray) -> IntArray:
    """Which of the stored nodes radiate."""
    found = {int(j) for matrix in affine.matrices["radiative"].values() for j in matrix.indices}
    return np.array([k for k, node in enumerate(stored) if int(node) in found], dtype=np.int64)


def _interpolation(temperatures: FloatArray, count: int, radiators: list[int]) -> tuple[list[int], FloatArray]:
    """Of fields [s, k]: at least `count` points, and the matrix [k, points] that gives T^4 everywhere from T^4 there.

    own: points to take where they are enough.
    """
    fourth = (temperatures / 300.0) ** 4
    count = min(count, fourth.shape[1])
    if count == fourth.shape[1]:
        return list(range(count)), np.eye(count)
    _, _, shapes = np.linalg.svd(fourth, full_matrices=False)
    basis = shapes[:count].T
    _, _, pivots = qr(basis.T, pivoting=True, mode="economic")
    points = radiators if len(radiators) >= count else sorted(int(k) for k in pivots[:count])
    return points, basis @ np.linalg.pinv(basis[points])


def merged_columns(network: Network, scenario: Scenario) -> tuple[tuple[str, ...], dict[str, FaceNormal], FloatArray]:
    """Input series with one for each way that faces look; the ways; which series [q, q'] stands for which."""
    names: dict[FaceNormal, str] = {}
    for face in scenario.network.faces.values():
        names.setdefault(face.normal, f"way{len(names)}")
    merged = []
    for column in network.columns:
        kind, _, name = column.partition(".")
        look = kind in ("solar", "albedo", "infrared")
        merged.append(f"{kind}.{names[scenario.network.faces[name].normal]}" if look else column)
    columns = tuple(dict.fromkeys(merged))
    gather = np.zeros((len(network.columns), len(columns)))
    gather[np.arange(len(merged)), [columns.index(name) for name in merged]] = 1.0
    return columns, {way: normal for normal, way in names.items()}, gather
