"""From theta to the entries of the canonical form, and back for the derivative.

A parameter sets or scales some of the scenario's numbers. Every entry of A, N, B and g is a sum of terms, each a
constant times a product of at most six numbers (or the reciprocal of a capacity): absorptivity x area / capacity, say.
So two tables are the whole assembly, its derivative follows from the product rule, and any number of the scenario can
be a parameter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiled import compiled, inlined
from .system import FloatArray, IntArray

MOST_FACTORS = 6


class Terms(NamedTuple):
    """Entry [t] += constant [t] x product of the numbers at factors [t, 6].

    Positions refer to the scenario's V numbers, followed by a one and by the reciprocals of the numbers at `inverse`.
    Entries are numbered through A, N, B, g and the heaters' lower and upper thresholds, as in a packed system.
    """

    entry: IntArray
    constant: FloatArray
    factors: IntArray
    inverse: IntArray
    """Positions of the numbers whose reciprocals may be factors."""
    entries: int
    """How many entries there are."""
    initial: IntArray
    """[n] which of theta's initial temperatures each state starts from; -1: none, its temperature is only guessed."""


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
    thetas = np.atleast_2d(theta)
    numbers = np.empty((len(thetas), len(mapping.written)))
    packed = np.empty((len(thetas), terms.entries + len(terms.initial)))
    extended = np.empty(len(mapping.written) + 1 + len(terms.inverse))
    assemble_compiled(mapping, terms, thetas, extended, numbers, packed)
    return (numbers[0], packed[0]) if theta.ndim == 1 else (numbers, packed)


def pull_back_assembly(
    mapping: ParameterMap,
    terms: Terms,
    theta: FloatArray,
    numbers: FloatArray,
    packed_bar: FloatArray,
    used: IntArray,
    used_bar: FloatArray,
) -> FloatArray:
    """Cotangent of theta [d] from that of the packed system [P] and of some numbers: the adjoint of `assemble`.

    used, used_bar: [., .] positions of numbers that are used elsewhere too, and their cotangents from there.
    """
    theta_bar = np.empty(len(theta))
    memory = np.empty(2 * (len(numbers) + 1 + len(terms.inverse)) + MOST_FACTORS)
    pull_back_compiled(mapping, terms, theta, numbers, packed_bar, used, used_bar, memory, theta_bar)
    return theta_bar


@compiled
def assemble_compiled(mapping, terms, thetas, extended, numbers, packed):
    """`assemble` in compiled code, at thetas [S, d]; extended: workspace for the numbers, a one and the reciprocals."""
    parameters = mapping.parameters
    for s in range(thetas.shape[0]):
        for k in range(numbers.shape[1]):
            numbers[s, k] = mapping.written[k]
        for k in range(mapping.set_positions.shape[0]):
            numbers[s, mapping.set_positions[k]] = thetas[s, mapping.set_by[k]]
        for k in range(mapping.scaled_positions.shape[0]):
            numbers[s, mapping.scaled_positions[k]] *= thetas[s, mapping.scaled_by[k]]
        _extend(terms, numbers[s], extended)
        packed[s] = 0.0
        for t in range(terms.entry.shape[0]):
            product = terms.constant[t]
            for k in range(terms.factors.shape[1]):
                product *= extended[terms.factors[t, k]]
            packed[s, terms.entry[t]] += product
        # A massless state's temperature is only guessed.
        guess = 0.0
        for k in range(parameters, thetas.shape[1]):
            guess += thetas[s, k] / (thetas.shape[1] - parameters)
        for i in range(terms.initial.shape[0]):
            place = terms.initial[i]
            packed[s, terms.entries + i] = thetas[s, parameters + place] if place >= 0 else guess


@inlined
def _extend(terms, numbers, extended):
    """The numbers, a one, and the reciprocals."""
    count = numbers.shape[0]
    for k in range(count):
        extended[k] = numbers[k]
    extended[count] = 1.0
    for k in range(terms.inverse.shape[0]):
        extended[count + 1 + k] = 1.0 / numbers[terms.inverse[k]]


@compiled
def pull_back_compiled(mapping, terms, theta, numbers, packed_bar, used, used_bar, memory, theta_bar):
    """`pull_back_assembly` in compiled code; memory: twice the workspace of `assemble_compiled` and MOST_FACTORS."""
    size = numbers.shape[0] + 1 + terms.inverse.shape[0]
    count = numbers.shape[0]
    extended, extended_bar, before = memory[:size], memory[size : 2 * size], memory[2 * size :]
    theta_bar[:] = 0.0
    _extend(terms, numbers, extended)
    extended_bar[:] = 0.0
    for kind in range(used.shape[0]):
        for k in range(used.shape[1]):
            extended_bar[used[kind, k]] += used_bar[kind, k]
    for t in range(terms.entry.shape[0]):
        # The product of all other factors, without a division: those before times those after.
        product = terms.constant[t] * packed_bar[terms.entry[t]]
        for k in range(terms.factors.shape[1]):
            before[k] = product
            product *= extended[terms.factors[t, k]]
        after = 1.0
        for back in range(terms.factors.shape[1]):
            k = terms.factors.shape[1] - 1 - back
            extended_bar[terms.factors[t, k]] += before[k] * after
            after *= extended[terms.factors[t, k]]
    for k in range(terms.inverse.shape[0]):
        inverse = extended[count + 1 + k]
        extended_bar[terms.inverse[k]] -= extended_bar[count + 1 + k] * inverse * inverse
    for k in range(mapping.set_positions.shape[0]):
        theta_bar[mapping.set_by[k]] += extended_bar[mapping.set_positions[k]]
    for k in range(mapping.scaled_positions.shape[0]):
        position, parameter = mapping.scaled_positions[k], mapping.scaled_by[k]
        if theta[parameter] != 0.0:
            others = numbers[position] / theta[parameter]
        else:
            others = mapping.written[position]
            for other in range(mapping.scaled_positions.shape[0]):
                if other != k and mapping.scaled_positions[other] == position:
                    others *= theta[mapping.scaled_by[other]]
        theta_bar[parameter] += extended_bar[position] * others
    for i in range(terms.initial.shape[0]):
        if terms.initial[i] >= 0:
            theta_bar[mapping.parameters + terms.initial[i]] += packed_bar[terms.entries + i]
