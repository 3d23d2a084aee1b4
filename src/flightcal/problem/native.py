"""The log density of thermal networks on one window or several, and its gradient, as one C function.

Nothing of Python is in it: chains run side by side without a common lock, and no time goes into handing arrays over.
It is a Program of kernels in three phases: all windows forwards, what they have in common, all windows backwards.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numba import types

from ..compiled import CallType, Program, Row, Stored, c_function
from ..probability import (
    NO_STATUS,
    Priors,
    StatusCall,
    WindowMemory,
    likelihood_calls,
    status_work,
    switching,
    window_memory,
)
from ..simulator import NOT_FINITE, TOO_MANY_SWITCHES, FloatArray
from .coordinates import Whitening
from .entries import Link
from .kernels.density import (
    DENSITY_NOT_FINITE,
    DRAWS,
    FAILURES,
    GRADIENTS,
    REASON,
    STOP,
    STOPPED,
    DensityCall,
    LinkCall,
    Place,
    begin,
    density,
    end,
    gather,
    move,
    record,
    scatter,
)
from .window import Window

__all__ = ["DENSITY_NOT_FINITE", "REASONS", "STOPPED", "NativeDensity", "native_density"]

REASONS = {
    NOT_FINITE: "a temperature is not finite",
    TOO_MANY_SWITCHES: "heaters switch too often: a thermostat chatters",
    DENSITY_NOT_FINITE: "the log density or its gradient is not finite",
}


class NativeDensity:
    """A density of its own memory, for one thread at a time."""

    def __init__(self, program: Program, place: Place) -> None:
        self.dimensions = len(place.w)
        self.program, self._place, self._control = program, place, np.zeros(5, np.int64)

    @cached_property
    def _call(self) -> Stored:
        return Stored(DensityCall(self.program.table, self._control, self._place))

    @property
    def address(self) -> int:
        """What the C functions take last."""
        return self._call.address

    @cached_property
    def function(self) -> int:
        """Address of a C function (d, w, gradient, log density, `address`) -> 0, or another number: no density."""
        return c_function(density, _signature(1, self._call.kind))

    @cached_property
    def record(self) -> int:
        """The same of (d, d, w, copy of w, `address`) -> 0; called for every draw."""
        return c_function(record, _signature(2, self._call.kind))

    @cached_property
    def _function(self) -> Any:
        return ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_uint64, *[ctypes.c_void_p] * 4)(self.function)

    def __call__(self, w: FloatArray) -> tuple[float, FloatArray]:
        """Log density at w [d] and its gradient [d]; (-inf, 0) where there is none."""
        w, gradient, value = np.ascontiguousarray(w, float), np.zeros(self.dimensions), np.empty(1)
        if self._function(self.dimensions, w.ctypes.data, gradient.ctypes.data, value.ctypes.data, self.address):
            return -np.inf, np.zeros(self.dimensions)
        return float(value[0]), gradient

    @property
    def draws(self) -> int:
        """Draws recorded."""
        return int(self._control[DRAWS])

    @property
    def gradients(self) -> int:
        """Evaluations."""
        return int(self._control[GRADIENTS])

    @property
    def failures(self) -> int:
        """Evaluations without a density."""
        return int(self._control[FAILURES])

    @property
    def last_failure(self) -> str | None:
        """Why the last of these had none."""
        return REASONS.get(int(self._control[REASON]))

    def stop(self) -> None:
        """From now on every trajectory ends at once."""
        self._control[STOP] = 1


def _signature(sizes: int, kind: Any) -> Any:
    """Of a C function that takes so many sizes, arrays, and a call."""
    arrays = [types.CPointer(types.double)] * (4 - sizes)
    return types.int64(*[types.uint64] * sizes, *arrays, CallType(kind))


def native_density(
    windows: Sequence[Window], links: Sequence[Link], priors: Priors, coordinates: Whitening
) -> NativeDensity:
    """The log density at w, up to a constant: the priors' and the likelihood of windows of thermal networks.

    links: how each window's theta follows from that of the priors. Thresholds are left out.
    """
    d = len(priors.names)
    z, theta, slope, z_bar = np.empty((4, 1, d))
    place = Place(
        np.array(coordinates.mean), np.array(coordinates.factor, order="C"), np.empty(d), z, theta, slope, z_bar,
        np.zeros(1 + 2 * len(windows)), np.empty(1), np.empty(d),
    )  # fmt: skip
    made = [
        _Window(window, link, place, place.values[1 + 2 * k :])
        for k, (window, link) in enumerate(zip(windows, links, strict=True))
    ]
    bent = () if coordinates.straight is None else coordinates.straight.rows(z, z_bar)
    likelihood = likelihood_calls([window.terms for window in windows], [window.memory for window in made])
    rows = [begin.row(place), *bent[:1], priors.row(z, theta, slope, z_bar, place.values[:1])]
    for window, of_temperatures in zip(made, likelihood.forward, strict=True):
        rows += [*window.forward, *of_temperatures, *window.status]
    rows += likelihood.close
    for window, of_temperatures in zip(made, likelihood.backward, strict=True):
        rows += [*of_temperatures, *window.backward]
    return NativeDensity(Program([*rows, *bent[1:], end.row(place)]), place)


class _Window:
    """Rows of one window, and memory for them."""

    forward: tuple[Row, ...]
    """From the problem's theta to temperatures,"""
    status: tuple[Row, ...]
    """what the heaters' status says,"""
    backward: tuple[Row, ...]
    """and from the derivatives by all these to that by the problem's z."""
    memory: WindowMemory
    """Of the likelihood of the temperatures."""

    def __init__(self, window: Window, link: Link, place: Place, values: FloatArray) -> None:
        """values: [at least 2], to be filled: log likelihood of temperatures and of heater status."""
        calls, fixed = window.network.calls(), window.residuals.fixed
        outputs = calls.outputs
        numbers, numbers_bar = np.zeros((2, len(window.written.values)))
        first, last = window.bounds
        of_noise, of_noise_bar = (array[:first].reshape(fixed.shape) for array in (numbers, numbers_bar))
        made = window_memory(
            np.ascontiguousarray(window.target), outputs.temperatures[0], of_noise, window.network.error_variance,
            numbers[last:], simulated_bar=calls.temperatures_bar,
        )  # fmt: skip
        self.memory = made._replace(numbers_bar=of_noise_bar, scales_bar=numbers_bar[last:], value=values[:1])
        status = window.heater_status if window.measured_switches is None else None
        data, settings = status.data if status else NO_STATUS, numbers[first:last]
        work = status_work(data, len(settings), len(calls.switches_bar))
        work = work._replace(settings=settings, settings_bar=numbers_bar[first:last])
        of_status = StatusCall(
            data, work, outputs.switches, outputs.switch_time, outputs.switch_heater, outputs.switch_on,
            outputs.status[0], calls.switches_bar, values[1:2],
        )  # fmt: skip
        self.status = (switching.row(of_status),) if status is not None else ()
        moving = link.moving
        z, theta, slope, unused = np.empty((4, 1, len(moving)))
        window_theta, window_slope = np.empty((2, len(link.columns)))
        linked = LinkCall._make([
            place, *_places(link.columns, *link.moves[:3]), link.moves.by, *_places(moving),
            z, theta, slope, window_theta, window_slope,
            *_places(window.simulated), calls.thetas, calls.theta_bar,
            *_places(*window.written.sets.T), np.array(window.written.values), numbers, numbers_bar,
        ])  # fmt: skip
        moved = (move.row(linked), link.priors.row(z, theta, slope, unused, np.empty(1))) if len(moving) else ()
        self.forward = (*moved, gather.row(linked), *calls.forward)
        self.backward = (*calls.backward, scatter.row(linked))


def _places(*found: Any) -> list[Any]:
    return [np.array(places, np.int64) for places in found]
