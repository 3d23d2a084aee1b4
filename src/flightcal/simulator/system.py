"""The canonical form: what every built-in simulator becomes before it is integrated.

    mass * dx/dt = A x + Q x^2 + N x^4 + B w(t) + sum_h u_h(t) g_h

x [n] states in kelvin; w(t) input series, linear in time in each step of the grid; u_h the state of heater h,
switched by hysteresis: on when its sensor falls to `lower`, off when it rises to `upper`. A massless state (mass 0)
obeys its heat balance at every instant. Rows of massless states are in watts, all others are divided by the capacity.

A, Q, N, B and g are sparse. Which entries they have is in `Structure` and never changes; their values are in `System`,
which is all that depends on theta. States are numbered in the order in which they are eliminated from the linear
systems of an implicit step, so that few new entries appear (minimum degree).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from heapq import heappop, heappush
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.integer]

Index = np.uint32
"""Of the patterns: indices that cannot be negative spare compiled code the test for it, a third of its time."""


class System(NamedTuple):
    """Values of the entries, in the order of `Structure`."""

    linear: Any
    """A's entries, 1/s (W/K in massless rows)."""
    radiative: Any
    """N's entries, K^-3/s (W/K^4 in massless rows)."""
    quadratic: Any
    """Q's entries, 1/(K s) (W/K^2 in massless rows)."""
    forcing: Any
    """B's entries, from an input series to K/s (W in massless rows)."""
    heating: Any
    """g's entries, K/s while the heater is on."""
    lower: Any
    """[H] K, the heater goes on."""
    upper: Any
    """[H] K, the heater goes off."""
    initial: Any
    """x0 [n], K; massless states are only guessed here, the grid's settling steps bring them into balance."""


class Structure(NamedTuple):
    """Where the entries are. A and N are stored by rows: row i has the entries start[i] to start[i+1]."""

    mass: FloatArray
    """[n] 1 for states with a capacity, 0 for massless ones."""
    linear_start: IntArray
    linear_column: IntArray
    linear_slot: IntArray
    """Place of each entry of A among the entries of the factorised matrix."""
    radiative_start: IntArray
    radiative_column: IntArray
    radiative_slot: IntArray
    quadratic_row: IntArray
    """A list, not by rows: most networks have none, and then it costs nothing."""
    quadratic_column: IntArray
    quadratic_slot: IntArray
    factor_start: IntArray
    factor_column: IntArray
    """Columns of the factorised matrix, ascending in each row: entries of A, N and Q, the diagonal, what fills in."""
    factor_diagonal: IntArray
    """[n] place of each diagonal entry."""
    forcing_row: IntArray
    forcing_column: IntArray
    heating_heater: IntArray
    heating_row: IntArray
    sensor: IntArray
    """[H] state that each thermostat watches."""


@dataclass(frozen=True)
class Drive:
    """What acts on the system from outside, on the grid of the integration."""

    times: FloatArray
    """[K+1] s from the window's start, increasing."""
    inputs: FloatArray
    """w [K, 2, q] at the start and at the end of each step, linear in between."""
    measured: FloatArray
    """[K, H] share of each step that a heater driven by its measured status is on; NaN: the thermostat acts."""
    initially_on: FloatArray
    """[H] 0 or 1, state before the first step; a sensor outside its band overrules it."""

    @cached_property
    def series(self) -> FloatArray:
        """The inputs by series [q, 2 K], each contiguous."""
        return np.ascontiguousarray(self.inputs.reshape(-1, self.inputs.shape[2]).T)

    @cached_property
    def known_until(self) -> IntArray:
        """[K, H] the point up to which a measured heater's state is known, of steps within which it switches.

        Of others where they begin.
        """
        either = (self.measured > 0.0) & (self.measured < 1.0)
        begins = ~either | ~np.concatenate([np.zeros_like(either[:1]), either[:-1]])
        return np.maximum.accumulate(np.where(begins, np.arange(len(either))[:, None], 0), axis=0)


class Switch(NamedTuple):
    """Thermostat events of one run, in order of time."""

    time: FloatArray
    """[E] s from the window's start."""
    heater: IntArray
    """[E]."""
    on: FloatArray
    """[E] 1: went on, 0: went off."""


def pack(system: System) -> FloatArray:
    """All numbers of a system [P], one field after the other: the form in which compiled code passes them on."""
    return np.concatenate(system)


def unpack(structure: Structure, packed: FloatArray) -> System:
    """The system whose fields are views of packed [P]."""
    return System(*np.split(packed, packed_bounds(structure)))


def packed_bounds(structure: Structure) -> IntArray:
    """Where the fields of a packed system begin, but the first."""
    heaters = len(structure.sensor)
    return np.cumsum(
        [
            len(structure.linear_column),
            len(structure.radiative_column),
            len(structure.quadratic_column),
            len(structure.forcing_row),
            len(structure.heating_row),
            heaters,
            heaters,
        ]
    )


def packed_size(structure: Structure) -> int:
    """How many numbers P a packed system has."""
    return int(packed_bounds(structure)[-1]) + len(structure.mass)


def elimination_order(count: int, links: Iterable[tuple[int, int]]) -> list[int]:
    """Minimum-degree order of a symmetric pattern (Tinney & Walker 1967): the least connected state goes first."""
    neighbours: list[set[int]] = [set() for _ in range(count)]
    for i, j in links:
        if i != j:
            neighbours[i].add(j)
            neighbours[j].add(i)
    left, order = set(range(count)), []
    while left:
        chosen = min(left, key=lambda i: (len(neighbours[i]), i))
        left.remove(chosen)
        order.append(chosen)
        for i in neighbours[chosen]:
            neighbours[i] |= neighbours[chosen]
            neighbours[i] -= {i, chosen}
    return order


def make_structure(
    mass: FloatArray,
    linear: Sequence[tuple[int, int]],
    radiative: Sequence[tuple[int, int]],
    quadratic: Sequence[tuple[int, int]],
    forcing: Sequence[tuple[int, int]],
    heating: Sequence[tuple[int, int]],
    sensor: Sequence[int],
) -> Structure:
    """The structure of entries given as (row, column) pairs, sorted and without repetition ((heater, row) for heating).

    States are taken as numbered in elimination order.
    """
    n = len(mass)
    rows: list[set[int]] = [{i} for i in range(n)]
    for i, j in {*linear, *radiative, *quadratic}:
        rows[i].add(j)
    for i in range(n):  # eliminating k from row i adds what stands in row k beyond its diagonal
        left = sorted(j for j in rows[i] if j < i)
        while left:
            k = heappop(left)
            for j in rows[k]:
                if j > k and j not in rows[i]:
                    rows[i].add(j)
                    if j < i:
                        heappush(left, j)
    ordered = [sorted(row) for row in rows]
    factor_start = np.cumsum([0, *map(len, ordered)])
    place = {(i, j): factor_start[i] + k for i, row in enumerate(ordered) for k, j in enumerate(row)}

    def by_rows(entries: Sequence[tuple[int, int]]) -> tuple[IntArray, IntArray, IntArray]:
        start = np.searchsorted([i for i, _ in entries], np.arange(n + 1))
        return start.astype(Index), _integers(j for _, j in entries), _integers(place[entry] for entry in entries)

    return Structure(
        np.asarray(mass, float),
        *by_rows(linear),
        *by_rows(radiative),
        _integers(i for i, _ in quadratic),
        _integers(j for _, j in quadratic),
        _integers(place[entry] for entry in quadratic),
        factor_start.astype(Index),
        _integers(j for row in ordered for j in row),
        _integers(place[i, i] for i in range(n)),
        _integers(i for i, _ in forcing),
        _integers(j for _, j in forcing),
        _integers(heater for heater, _ in heating),
        _integers(row for _, row in heating),
        _integers(sensor),
    )


def _integers(values: Iterable[int]) -> IntArray:
    return np.fromiter(values, dtype=Index)
