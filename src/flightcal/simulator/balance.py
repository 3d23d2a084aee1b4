"""From which temperatures massless nodes begin: those at which their heat balances, at one theta.

The steps in which they settle do the rest at every other theta. From the mean of all other nodes they do not always: an
outer layer in sunlight that begins at room temperature is thrown far off, since what it radiates grows as the fourth
power.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array

from .network import Network
from .simulate import NetworkSimulator
from .system import FloatArray, IntArray, Structure, System

_STEPS, _FARTHEST, _NEAR = 100, 0.3, 1e-3
"""Newton steps at most, each no farther than this share of a temperature, until none is farther than so many K."""


def balanced(simulator: NetworkSimulator, theta: FloatArray) -> Network:
    """The simulator's network, whose massless nodes begin in balance at theta [d].

    As it is where there are none, or no balance is found.
    """
    network, drive = simulator.network, simulator.drive
    free = np.flatnonzero(network.terms.initial < 0)
    if not len(free):
        return network
    system = simulator.system(theta)
    begun = np.asarray(system.initial, float)
    known = drive.measured[0]
    on = np.where(np.isfinite(known), known, drive.initially_on)
    found = _in_balance(network.structure, system, begun, free, drive.inputs[0, 0], np.nan_to_num(on))
    if found is None:
        return network
    terms = network.terms
    # What a product of no number is: the one that stands behind the numbers.
    nothing = np.full((len(free), terms.factors.shape[1]), len(network.values))
    added = terms._replace(
        entry=np.concatenate([terms.entry, terms.entries + free]),
        constant=np.concatenate([terms.constant, found - begun[free]]),
        factors=np.concatenate([terms.factors, nothing]),
    )
    return replace(network, terms=added)


def _in_balance(
    structure: Structure, system: System, begun: FloatArray, free: IntArray, inputs: FloatArray, on: FloatArray
) -> FloatArray | None:
    """Temperatures [f] of free states at which nothing heats them, from states [n], inputs [q] and heaters [H]."""
    count = len(begun)
    linear = csr_array((system.linear, structure.linear_column, structure.linear_start), (count, count))
    radiative = csr_array((system.radiative, structure.radiative_column, structure.radiative_start), (count, count))
    places = structure.quadratic_row, structure.quadratic_column
    quadratic = csr_array((system.quadratic, places), (count, count))
    linear, radiative, quadratic = linear[free], radiative[free], quadratic[free]
    forcing = np.bincount(structure.forcing_row, system.forcing * inputs[structure.forcing_column], count)
    forcing += np.bincount(structure.heating_row, system.heating * on[structure.heating_heater], count)
    x = begun.copy()
    for _ in range(_STEPS):
        heat = linear @ x + radiative @ x**4 + quadratic @ x**2 + forcing[free]
        slope = linear[:, free] + 4.0 * radiative[:, free] * x[free] ** 3 + 2.0 * quadratic[:, free] * x[free]
        try:
            step = -np.linalg.solve(slope.toarray(), heat)
        except np.linalg.LinAlgError:
            return None
        step = np.clip(step, -_FARTHEST * x[free], _FARTHEST * x[free])
        x[free] += step
        if np.abs(step).max() < _NEAR:
            return x[free]
    return None
