"""From which temperatures massless nodes begin: those at which their heat balances, at one theta.

The steps in which they settle do the rest at every other theta. From the mean of all other nodes they do not always: an
outer layer in sunlight that begins at room temperature is thrown far off, since what it radiates grows as the fourth
power.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

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
    linear, radiative, quadratic = (np.zeros((count, count)) for _ in range(3))
    rows = [
        np.repeat(np.arange(count), np.diff(start)) for start in (structure.linear_start, structure.radiative_start)
    ]
    linear[rows[0], structure.linear_column] = system.linear
    radiative[rows[1], structure.radiative_column] = system.radiative
    quadratic[structure.quadratic_row, structure.quadratic_column] = system.quadratic
    forcing = np.bincount(structure.forcing_row, system.forcing * inputs[structure.forcing_column], count)
    forcing += np.bincount(structure.heating_row, system.heating * on[structure.heating_heater], count)
    x, own = begun.copy(), np.ix_(free, free)
    for _ in range(_STEPS):
        heat = (linear @ x + radiative @ x**4 + quadratic @ x**2 + forcing)[free]
        slope = (linear + 4.0 * radiative * x**3 + 2.0 * quadratic * x)[own]
        try:
            step = -np.linalg.solve(slope, heat)
        except np.linalg.LinAlgError:
            return None
        step = np.clip(step, -_FARTHEST * x[free], _FARTHEST * x[free])
        x[free] += step
        if np.abs(step).max() < _NEAR:
            return x[free]
    return None
