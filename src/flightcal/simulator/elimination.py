"""Massless states that act linearly, taken out of the equations before these are integrated.

The balance of a massless state v is 0 = a v + r. Where v neither radiates nor has a conductance that depends on
temperature, v = -r / a stands for it in every other balance: a state less in each step. A step of RODAS3 solves for v
in the same way, so only rounding changes. What is left is made once for each theta, and its derivative goes back
through it once, after that of all steps.

A state stays where something reads it: a sensor, or a thermostat.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .kernels.elimination import Plan
from .system import IntArray, Structure, make_structure, packed_bounds, packed_size

_IN_STEPS = ("linear", "radiative", "quadratic")
"""What each step reads; the rest is read once a simulation."""
_BY_ROWS = (*_IN_STEPS, "forcing", "heating")


@dataclass(frozen=True)
class Elimination:
    """What is left of a structure, and how it is made."""

    structure: Structure
    """Of the states that are left, in the same order."""
    place: IntArray
    """[n] where each state is among those that are left; -1: it is none of them."""
    plan: Plan
    entries: int
    """How many the plan works on."""


def eliminate(structure: Structure, read: Collection[int]) -> Elimination | None:
    """Without massless states that act linearly, but for those that are `read`; None: there are none.

    A step's time follows from its entries: a state stays where more would come than go with it.
    """
    open_ones = _candidates(structure, read)
    if not open_ones:
        return None
    work = _Work(structure)
    for state in sorted(open_ones, key=work.degree):
        if work.gain(state) >= 0:
            work.eliminate(state)
    return work.finished() if work.gone else None


def _candidates(structure: Structure, read: Collection[int]) -> list[int]:
    nonlinear = {*structure.radiative_column.tolist(), *structure.quadratic_column.tolist()}
    kept = {*nonlinear, *structure.sensor.tolist(), *read}
    return [state for state in np.flatnonzero(structure.mass == 0.0).tolist() if state not in kept]


class _Work:
    """A system's entries while states are eliminated from them."""

    def __init__(self, structure: Structure) -> None:
        self.structure, self.count, self.gone = structure, packed_size(structure), list[int]()
        n = len(structure.mass)
        self.rows: dict[str, list[dict[int, int]]] = {kind: [{} for _ in range(n)] for kind in _BY_ROWS}
        """By kind and row: column -> place among the entries."""
        for place, (kind, row, column) in enumerate(_entries(structure)):
            self.rows[kind][row][column] = place
        self.readers: list[set[int]] = [set() for _ in range(n)]
        """Rows with an entry of A in each column, but its own."""
        for row, position in enumerate(self.rows["linear"]):
            for column in position:
                if column != row:
                    self.readers[column].add(row)
        self.multiplier, self.pivot, self.first = list[int](), list[int](), [0]
        self.source, self.target = list[int](), list[int]()

    def degree(self, state: int) -> int:
        return len(self.readers[state])

    def gain(self, state: int) -> int:
        """By how many the entries that a step reads become fewer."""
        others = {kind: set(self.rows[kind][state]) - {state} for kind in _IN_STEPS}
        gone = 1 + sum(map(len, others.values())) + len(self.readers[state])
        return gone - sum(
            len(columns - self.rows[kind][row].keys())
            for row in self.readers[state]
            for kind, columns in others.items()
        )

    def eliminate(self, state: int) -> None:
        pivot = self.rows["linear"][state].pop(state)
        for row in sorted(self.readers[state]):
            self.multiplier.append(self.rows["linear"][row].pop(state))
            self.pivot.append(pivot)
            for kind in _BY_ROWS:
                for column, place in self.rows[kind][state].items():
                    self.source.append(place)
                    self.target.append(self._place(kind, row, column))
            self.first.append(len(self.source))
        for column in self.rows["linear"][state]:
            self.readers[column].discard(state)
        self.gone.append(state)

    def _place(self, kind: str, row: int, column: int) -> int:
        """Of an entry, which may be new."""
        if column not in self.rows[kind][row]:
            self.rows[kind][row][column] = self.count
            self.count += 1
            if kind == "linear" and column != row:
                self.readers[column].add(row)
        return self.rows[kind][row][column]

    def finished(self) -> Elimination:
        whole, n = self.structure, len(self.structure.mass)
        left = sorted({*range(n)} - {*self.gone})
        place = np.full(n, -1)
        place[left] = np.arange(len(left))
        linear, radiative, quadratic = (self._left(kind, left, place) for kind in _IN_STEPS)
        forcing = self._left("forcing", left)
        heating = sorted((heater, row, entry) for row, heater, entry in self._left("heating", left))
        listed = (linear, radiative, quadratic, forcing, heating)
        a, n4, n2, b, g = ([(first, second) for first, second, _ in entries] for entries in listed)
        structure = make_structure(whole.mass[left], a, n4, n2, b, g, place[whole.sensor].tolist())
        lower, initial = packed_bounds(whole)[[4, 6]].tolist()
        kept = [entry for entries in listed for *_, entry in entries]
        kept += [*range(lower, initial), *(initial + state for state in left)]
        made = (self.multiplier, self.pivot, self.first, self.source, self.target, kept)
        return Elimination(structure, place, Plan(*(np.array(row, np.int64) for row in made)), self.count)

    def _left(self, kind: str, left: list[int], place: IntArray | None = None) -> list[tuple[int, int, int]]:
        """(row, column, place among the entries) of entries of the rows that are left; place: [n] of their columns."""
        rows = [sorted(self.rows[kind][state].items()) for state in left]
        return [
            (k, column if place is None else int(place[column]), entry)
            for k, row in enumerate(rows)
            for column, entry in row
        ]


def _entries(structure: Structure) -> Iterator[tuple[str, int, int]]:
    """(kind, row, column) of the entries of a packed system, but for thresholds and initial states."""
    for kind in ("linear", "radiative"):
        columns = getattr(structure, f"{kind}_column").tolist()
        bounds = getattr(structure, f"{kind}_start").tolist()
        for row, (first, last) in enumerate(pairwise(bounds)):
            yield from ((kind, row, column) for column in columns[first:last])
    for kind, rows, columns in (
        ("quadratic", structure.quadratic_row, structure.quadratic_column),
        ("forcing", structure.forcing_row, structure.forcing_column),
        ("heating", structure.heating_row, structure.heating_heater),
    ):
        yield from ((kind, row, column) for row, column in zip(rows.tolist(), columns.tolist(), strict=True))
