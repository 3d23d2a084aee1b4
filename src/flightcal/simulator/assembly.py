"""From the scenario's numbers to the entries of the canonical form, and back for the derivative.

Every entry of A, N, B and g is a sum of terms, each a constant times a product of at most six of the scenario's
numbers (or the reciprocal of a capacity): absorptivity x area / capacity, say. So one table of terms is the whole
assembly, its derivative follows from the product rule, and any number of the scenario can be a parameter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from .system import FloatArray, IntArray, Structure, System

MOST_FACTORS = 6

_compiled: Any = njit(nogil=True, cache=True, error_model="numpy")


@dataclass(frozen=True)
class Terms:
    """Entry [t] += constant [t] x product of the numbers at factors [t, 6].

    Positions refer to the scenario's V numbers, followed by a one and by the reciprocals of the numbers at `inverse`.
    """

    entry: IntArray
    constant: FloatArray
    factors: IntArray
    inverse: IntArray
    """Positions of the numbers whose reciprocals may be factors."""
    entries: int
    """How many entries A, N, B and g have together."""


def assemble(
    terms: Terms, structure: Structure, values: FloatArray, thresholds: IntArray, initial: FloatArray
) -> System:
    """The system at the scenario's numbers `values` [V] (SI) with initial states `initial` [n] (K).

    thresholds: [2, H] positions of each heater's switch-on and switch-off temperature.
    """
    entries = np.zeros(terms.entries)
    _evaluate(terms.entry, terms.constant, terms.factors, _extended(terms, values), entries)
    linear, radiative, forcing, heating = np.split(entries, _bounds(structure))
    return System(linear, radiative, forcing, heating, values[thresholds[0]], values[thresholds[1]], initial)


def pull_back_assembly(terms: Terms, values: FloatArray, thresholds: IntArray, bar: System) -> FloatArray:
    """Cotangent [V] of the scenario's numbers from that of the system: the adjoint of `assemble`."""
    count = len(values)
    entries_bar = np.concatenate([bar.linear, bar.radiative, bar.forcing, bar.heating])
    extended = _extended(terms, values)
    extended_bar = np.zeros_like(extended)
    _evaluate_adjoint(terms.entry, terms.constant, terms.factors, extended, entries_bar, extended_bar)
    values_bar = extended_bar[:count]
    inverse = extended[count + 1 :]
    np.add.at(values_bar, terms.inverse, -extended_bar[count + 1 :] * inverse**2)
    np.add.at(values_bar, thresholds[0], bar.lower)
    np.add.at(values_bar, thresholds[1], bar.upper)
    return values_bar


def _bounds(structure: Structure) -> IntArray:
    """Where N's, B's and g's entries begin among all."""
    return np.cumsum([len(structure.linear_column), len(structure.radiative_column), len(structure.forcing_row)])


def _extended(terms: Terms, values: FloatArray) -> FloatArray:
    return np.concatenate([values, [1.0], 1.0 / values[terms.inverse]])


@_compiled
def _evaluate(entry, constant, factors, values, entries):
    for t in range(entry.shape[0]):
        product = constant[t]
        for k in range(factors.shape[1]):
            product *= values[factors[t, k]]
        entries[entry[t]] += product


@_compiled
def _evaluate_adjoint(entry, constant, factors, values, entries_bar, values_bar):
    for t in range(entry.shape[0]):
        bar = constant[t] * entries_bar[entry[t]]
        for k in range(factors.shape[1]):
            product = bar
            for other in range(factors.shape[1]):
                if other != k:
                    product *= values[factors[t, other]]
            values_bar[factors[t, k]] += product
