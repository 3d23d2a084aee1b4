"""diffrax, as its documentation advises: adaptive steps, output by SaveAt(ts), the adjoint by its default or forward.

diffrax has one terminating event and no repeated ones, so a thermostat that switches again and again cannot be
written with `diffrax.Event` in one solve. Here it is a state of its own, m, with two stable values, about -1 and +1,
that is pushed over where a threshold, with a smoothed edge, is passed; the heater is on where m is positive:

    dm/dt = hold (m - m^3) + push ((1 - u) s((lower - T)/w) - u s((T - upper)/w))
    u     = s(sharp m)                                                  s: the logistic function

The smaller w and the larger the rates, the closer to the relay, the stiffer, and the more steps are needed. (A u that
follows the smoothed edges directly, without the sharp second function, slides along a threshold half on.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import diffrax
import numpy as np
from tests.oracle import jax, jnp

from ..canonical import Canonical

WIDTH = 0.01  # K, w
SHARP_WIDTH = 0.001  # K, with which the smoothing's error is near flightcal's
HOLD, PUSH = 0.02, 0.3  # 1/s
SHARP = 40.0
LONGEST_STEP = 30.0
"""s. With sharper smoothing and no bound, derivatives of explicit solvers came out up to 1e19 times too large; why was
not settled. With this one and rtol 1e-8 Tsit5's agree to a few percent; at rtol 1e-7 they do not."""


_ADJOINTS: dict[str, Callable[[int], Any]] = {
    "RecursiveCheckpointAdjoint": lambda _: diffrax.RecursiveCheckpointAdjoint(),
    # "it makes sense to set as many checkpoints as you have memory for" (diffrax's documentation)
    "every step a checkpoint": lambda steps: diffrax.RecursiveCheckpointAdjoint(checkpoints=min(steps, 2048)),
    "ForwardMode": lambda _: diffrax.ForwardMode(),
}


@dataclass(frozen=True)
class Configuration:
    """A solver and what its documentation lets one choose."""

    solver: str
    rtol: float = 1e-8
    atol: float = 1e-5
    adjoint: str = "RecursiveCheckpointAdjoint"
    max_steps: int = 4096
    width: float = WIDTH
    """K, of the thermostat's edge; the rates grow as it becomes sharper."""

    @property
    def label(self) -> str:
        """How the tables call it."""
        edge = "" if self.width == WIDTH else f", edge {self.width:g} K"
        return f"diffrax {self.solver}, {self.adjoint}, rtol {self.rtol:.0e}{edge}"


def states(model: Canonical, configuration: Configuration) -> Callable[[Any], Any]:
    """theta [d] -> states [K+1, n] on the drive's grid."""
    times, known = jnp.asarray(model.drive.times), jnp.asarray(model.exact.times)
    assert (np.diff(model.exact.times) > 0).all(), "the inputs of this problem have kinks, but no jumps"
    exact, faster = replace(model, drive=model.exact), WIDTH / configuration.width
    sensor = int(model.structure.sensor[0])
    solver = getattr(diffrax, configuration.solver)()
    controller = diffrax.PIDController(rtol=configuration.rtol, atol=configuration.atol, dtmax=LONGEST_STEP)
    adjoint = _ADJOINTS[configuration.adjoint](configuration.max_steps)

    def solve(theta: Any) -> Any:
        A, N, heat, g, lower, upper, initial = exact.dense(theta)
        on = jnp.asarray(model.drive.initially_on[0])
        u0 = jnp.where(initial[sensor] < lower[0], 1.0, jnp.where(initial[sensor] > upper[0], 0.0, on))

        def rate(t: Any, y: Any, arguments: Any) -> Any:
            A, N, inputs, g, lower, upper = arguments
            x, memory = y[:-1], y[-1]
            on = jax.nn.sigmoid(SHARP * memory)
            push = (1.0 - on) * jax.nn.sigmoid((lower - x[sensor]) / configuration.width)
            push -= on * jax.nn.sigmoid((x[sensor] - upper) / configuration.width)
            heat = inputs.evaluate(t) + on * g
            change = faster * (HOLD * (memory - memory**3) + PUSH * push)
            return jnp.append(A @ x + N @ x**4 + heat, change)

        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(rate),
            solver,
            t0=times[0],
            t1=times[-1],
            dt0=1.0,
            y0=jnp.append(initial, 2.0 * u0 - 1.0),
            args=(A, N, diffrax.LinearInterpolation(known, heat), g[0], lower[0], upper[0]),
            saveat=diffrax.SaveAt(ts=times),
            stepsize_controller=controller,
            adjoint=adjoint,
            max_steps=configuration.max_steps,
        )
        return solution.ys[:, :-1], solution.stats["num_steps"]

    return solve


def temperatures(model: Canonical, configuration: Configuration) -> Callable[[Any], Any]:
    """theta [d] -> temperatures [T, N] and the number of steps, compiled."""
    solve = states(model, configuration)

    def observed(theta: Any) -> Any:
        x, steps = solve(theta)
        return model.observe(x), steps

    return jax.jit(observed)


def log_density(model: Canonical, configuration: Configuration) -> Callable[[Any], Any]:
    """z [d] -> log density, in JAX."""
    solve = states(model, configuration)
    return lambda z: model.log_density(z, lambda theta: model.observe(solve(theta)[0]))


def log_density_and_gradient(model: Canonical, configuration: Configuration) -> Callable[[Any], Any]:
    """z [d] -> log density and its gradient [d], compiled; returns when the numbers are there."""
    density = log_density(model, configuration)
    if configuration.adjoint == "ForwardMode":

        def both(z: Any) -> Any:
            value, gradient = jax.vmap(lambda v: jax.jvp(density, (z,), (v,)))(jnp.eye(len(z)))
            return value[0], gradient

        compiled = jax.jit(both)
    else:
        compiled = jax.jit(jax.value_and_grad(density))

    def evaluate(z: Any) -> Any:
        return jax.block_until_ready(compiled(z))

    return evaluate
