"""SciPy's solve_ivp: with events from switch to switch, as its documentation shows; and the tight reference."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from ..canonical import Canonical


class _Network:
    """Right-hand side, Jacobian and thermostat of one theta."""

    def __init__(self, model: Canonical, theta: Any) -> None:
        self.A, self.N, self.heat, self.g, self.lower, self.upper, self.initial = map(np.asarray, model.dense(theta))
        self.times = model.drive.times
        lasting = np.diff(self.times) > 0.0
        self.slope = np.zeros((len(lasting), self.heat.shape[1]))
        self.slope[lasting] = np.diff(self.heat, axis=0)[lasting] / np.diff(self.times)[lasting, None]
        self.knots = self.times.tolist()
        self.sensor = int(model.structure.sensor[0])
        on = model.drive.initially_on[0] > 0.5
        start = self.initial[self.sensor]
        self.on = bool(start < self.lower[0] or (on and start <= self.upper[0]))

    def rate(self, t: float, x: Any) -> Any:
        k = min(bisect_right(self.knots, t) - 1, len(self.slope) - 1)
        return self.A @ x + self.N @ x**4 + self.heat[k] + self.slope[k] * (t - self.knots[k]) + self.on * self.g[0]

    def jacobian(self, _: float, x: Any) -> Any:
        return self.A + self.N * (4.0 * x**3)

    def event(self) -> Any:
        threshold, direction = (self.upper[0], 1.0) if self.on else (self.lower[0], -1.0)

        def passed(_: float, x: Any) -> float:
            return x[self.sensor] - threshold

        passed.terminal, passed.direction = True, direction  # type: ignore[attr-defined]
        return passed

    def solve(self, begin: float, end: float, x: Any, at: Any, method: str, rtol: float, atol: float) -> Any:
        """The solution from x at `begin` until `end` or the next switch, sampled at `at`."""
        stiff = {"jac": self.jacobian} if method in ("Radau", "BDF", "LSODA") else {}
        event = self.event()
        return solve_ivp(
            self.rate, (begin, end), x, method=method, t_eval=at, events=event, rtol=rtol, atol=atol, **stiff
        )


def solve_with_events(model: Canonical, theta: Any, method: str, rtol: float, atol: float) -> Any:
    """States [K+1, n] on the drive's grid: one solve_ivp from each switch to the next, inputs interpolated."""
    network = _Network(model, theta)
    times, t, x = network.times, network.times[0], network.initial
    states = np.empty((len(times), len(x)))
    states[0], filled = x, 1
    while filled < len(times):
        found = network.solve(t, times[-1], x, times[filled:], method, rtol, atol)
        states[filled : filled + len(found.t)] = found.y.T
        filled += len(found.t)
        if found.status == 1:
            t, x = found.t_events[0][0], found.y_events[0][0]
            network.on = not network.on
    return states


def solve_by_pieces(model: Canonical, theta: Any, rtol: float, atol: float) -> Any:
    """States [K+1, n]: Radau started anew at each grid point, where the inputs have kinks, and at each switch."""
    network = _Network(model, theta)
    states = [network.initial]
    for begin, end in zip(network.times[:-1], network.times[1:], strict=True):
        t, x = begin, states[-1]
        while t < end:
            found = network.solve(t, end, x, [end], "Radau", rtol, atol)
            if found.status == 1:
                t, x = found.t_events[0][0], found.y_events[0][0]
                network.on = not network.on
            else:
                t, x = end, found.y[:, -1]
        states.append(x)
    return np.array(states)


def tight_reference(model: Canonical, theta: Any) -> Any:
    """Temperatures [T, N] (K) to about 1e-8 K: SciPy's Radau between grid points and switches, rtol 1e-10."""
    exact = replace(model, drive=model.exact)
    return exact.observe(solve_by_pieces(exact, theta, rtol=1e-10, atol=1e-10))
