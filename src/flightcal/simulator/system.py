"""The canonical form: what every built-in simulator becomes before it is integrated.

    mass * dx/dt = A x + N (E x)^4 + b(t) + sum_h u_h(t) g_h

x [n] states in kelvin, the massless ones (mass 0) held by their heat balance at every instant; (E x)^4 the radiating
temperatures; b(t) = B w(t) heat inputs, linear in time between the points of the solver's grid; u_h the state of
heater h, switched by hysteresis: on when its sensor s_h = S x falls to `lower`, off when it rises to `upper`.
Rows of massless states are heat balances in watts; all other rows are divided by the capacity.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class System(NamedTuple):
    """The part of the canonical form that depends on theta (JAX or NumPy arrays; a JAX pytree).

    With a leading axis [S] on every array it is a batch of systems.
    """

    linear: Any
    """A [n, n], 1/s (W/K in massless rows)."""
    radiative: Any
    """N [n, m], K^-3/s; m = 0 without radiation."""
    forcing: Any
    """B [n, q], from the input series w to K/s (W in massless rows)."""
    heating: Any
    """g [H, n], K/s while the heater is on."""
    lower: Any
    """[H] K, the heater goes on."""
    upper: Any
    """[H] K, the heater goes off."""
    initial: Any
    """x0 [n], K."""


@dataclass(frozen=True)
class Drive:
    """The part that does not depend on theta: grid, inputs, and how heaters are wired.

    Two grid points at the same time mark a jump of the inputs: the step between them has length zero.
    """

    times: FloatArray
    """[K+1] s from the window's start, not decreasing."""
    inputs: FloatArray
    """w [K+1, q]."""
    mass: FloatArray
    """[n] 1 for states with a capacity, 0 for massless ones."""
    sensors: FloatArray
    """S [H, n]."""
    mixing: FloatArray
    """E [m, n]; of shape [0, n] where E is the identity."""
    measured: FloatArray
    """[K, H] share of each step that a heater driven by its measured status is on; NaN: the thermostat acts."""
    initially_on: FloatArray
    """[H] 0 or 1, state before the first step; a sensor outside its band overrules it."""


class Switch(NamedTuple):
    """Thermostat events of one run, in order of time."""

    time: FloatArray
    """[E] s from the window's start."""
    heater: NDArray[np.int64]
    """[E]."""
    on: FloatArray
    """[E] 1: went on, 0: went off."""
