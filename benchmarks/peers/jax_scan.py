"""Plain JAX: `lax.scan` over the grid, differentiated by JAX, in the versions that a user would write."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tests import oracle
from tests.oracle import jax, jnp

from ..canonical import Canonical


def located(model: Canonical) -> Callable[[Any], Any]:
    """theta [d] -> states [K+1, n] by flightcal's own oracle: the switch located inside the step."""

    def states(theta: Any) -> Any:
        return oracle.integrate(model.structure, model.system(theta), model.drive, max_segments=2)[0]

    return states


def rodas3_end_of_step(model: Canonical, substeps: int = 1) -> Callable[[Any], Any]:
    """theta -> states by the same scheme, with the thermostat checked at the end of each step."""
    mass = jnp.asarray(model.structure.mass)

    def advance(A: Any, N: Any, x: Any, h: Any, b0: Any, b1: Any) -> Any:
        return oracle.rosenbrock_step(A, N, jnp.zeros_like(A), mass, x, h, b0, b1)

    return _end_of_step(model, advance, substeps)


def runge_kutta_end_of_step(model: Canonical, substeps: int = 1) -> Callable[[Any], Any]:
    """theta -> states by the classical Runge-Kutta method, the fastest to write and to run while nothing is stiff."""

    def advance(A: Any, N: Any, x: Any, h: Any, b0: Any, b1: Any) -> Any:
        def rate(state: Any, heat: Any) -> Any:
            return A @ state + N @ state**4 + heat

        middle = 0.5 * (b0 + b1)
        k1 = rate(x, b0)
        k2 = rate(x + 0.5 * h * k1, middle)
        k3 = rate(x + 0.5 * h * k2, middle)
        k4 = rate(x + h * k3, b1)
        return x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)

    return _end_of_step(model, advance, substeps)


def _end_of_step(model: Canonical, advance: Callable[..., Any], substeps: int) -> Callable[[Any], Any]:
    drive, sensor = model.drive, jnp.asarray(model.structure.sensor)
    durations = jnp.diff(jnp.asarray(drive.times))

    def states(theta: Any) -> Any:
        A, N, heat, g, lower, upper, initial = model.dense(theta)

        def switched(x: Any, u: Any) -> Any:
            return jnp.where(x[sensor] < lower, 1.0, jnp.where(x[sensor] > upper, 0.0, u))

        def step(carry: Any, row: Any) -> Any:
            x, u = carry
            b0, b1, h = row
            for k in range(substeps):
                left, right = (b0 + (b1 - b0) * (share / substeps) for share in (k, k + 1))
                heating = u @ g
                x = advance(A, N, x, h / substeps, left + heating, right + heating)
                u = switched(x, u)
            return (x, u), x

        u0 = switched(initial, jnp.asarray(drive.initially_on))
        _, later = jax.lax.scan(step, (initial, u0), (heat[:-1], heat[1:], durations))
        return jnp.concatenate([initial[None], later])

    return states


def temperatures(model: Canonical, states: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """theta -> temperatures [T, N], compiled."""
    return jax.jit(lambda theta: model.observe(states(theta)))


def log_density_and_gradient(model: Canonical, states: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """z [d] -> log density and its gradient [d], compiled; returns when the numbers are there."""
    compiled = jax.jit(jax.value_and_grad(lambda z: model.log_density(z, lambda theta: model.observe(states(theta)))))

    def evaluate(z: Any) -> Any:
        return jax.block_until_ready(compiled(z))

    return evaluate
