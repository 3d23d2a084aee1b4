"""From theta to the entries of the canonical form, and back for the derivative.

A parameter sets or scales some of the scenario's numbers. Every entry of A, Q, N, B and g is a sum of terms, each a
constant times a product of a few numbers (or the reciprocal of a capacity): absorptivity x area / capacity, say.
So two tables are the whole assembly, its derivative follows from the product rule, and any number of the scenario can
be a parameter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .kernels import assembly as kernels
from .system import FloatArray, IntArray


class Terms(NamedTuple):
    """Entry [t] += constant [t] x product of the numbers at factors [t, f], as many as the longest product has.

    Positions refer to the scenario's V numbers, followed by a one, the reciprocals of the numbers at `inverse`, and the
    initial temperatures in theta. Entries are numbered through A, N, Q, B, g, the heaters' lower and upper thresholds
    and the initial states, as in a packed system.
    """

    entry: IntArray
    constant: FloatArray
    factors: IntArray
    inverse: IntArray
    """Positions of the numbers whose reciprocals may be factors."""
    entries: int
    """How many entries there are, without the initial states."""
    initial: IntArray
    """[n] which of theta's initial temperatures each state starts from, besides its terms; -1: none, its temperature is
    only guessed."""


class ParameterMap(NamedTuple):
    """Which of a network's numbers each parameter sets or scales."""

    parameters: int
    """How many there are."""
    written: FloatArray
    """The numbers [V] as the scenario writes them, SI."""
    set_positions: IntArray
    set_by: IntArray
    """Parameter that sets the number at each of `set_positions`."""
    scaled_positions: IntArray
    scaled_by: IntArray


def own_initial(mass: FloatArray) -> IntArray:
    """`Terms.initial` [n] where every state has an initial temperature of its own, but those without mass [n]."""
    return np.where(mass > 0.0, np.cumsum(mass > 0.0) - 1, -1)


def assemble(mapping: ParameterMap, terms: Terms, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The scenario's numbers [S, V] and the packed system [S, P] at thetas [S, d] (or without S, for one theta [d]).

    theta: the parameters, then the initial temperatures that `terms.initial` refers to.
    """
    thetas = np.array(theta, float, ndmin=2)
    count, written = len(thetas), len(mapping.written)
    numbers, packed = np.empty((count, written)), np.empty((count, terms.entries + len(terms.initial)))
    none = np.empty((0, 0), np.int64)
    call = kernels.AssembleCall(
        np.array([count]), mapping, terms, none, thetas, assembly_memory(mapping, terms), numbers, packed,
        np.empty((count, 0, 0)),
    )  # fmt: skip
    kernels.assemble(call)
    return (numbers[0], packed[0]) if theta.ndim == 1 else (numbers, packed)


def assembly_memory(mapping: ParameterMap, terms: Terms) -> FloatArray:
    """What the kernels of assembly work in."""
    temperatures = int(terms.initial.max(initial=-1)) + 1
    return np.empty(2 * (len(mapping.written) + 1 + len(terms.inverse) + temperatures) + terms.factors.shape[1])
