"""The kernel's slow, obvious twin in plain JAX: the same scheme and switching, differentiated by JAX itself.

It judges the compiled kernel in the tests, and runs where Numba does not (GPUs, very large batches).
"""

from __future__ import annotations

from typing import Any

from .._jax import jax, jnp
from .system import Drive, System

_LOCATION_ITERATIONS = 60


def rate(system: System, mixing: Any, x: Any, heat: Any) -> Any:
    """mass * dx/dt [n] at state x [n] with heat inputs b + sum u g [n]."""
    radiating = mixing @ x if mixing.shape[0] else x
    total = system.linear @ x + heat
    return total + system.radiative @ radiating**4 if system.radiative.shape[-1] else total


def rosenbrock_step(system: System, drive: Drive, x: Any, h: Any, b0: Any, b1: Any, heaters: Any) -> Any:
    """One RODAS3 step of length h [s] (see `kernel`)."""
    mass, mixing = jnp.asarray(drive.mass), jnp.asarray(drive.mixing)
    heating = heaters @ system.heating
    f0 = rate(system, mixing, x, b0 + heating)
    jacobian = jax.jacfwd(lambda state: rate(system, mixing, state, b0 + heating))(x)
    W = jnp.diag(mass) - 0.5 * h * jacobian
    factors = jax.scipy.linalg.lu_factor(W)

    def solve(r: Any) -> Any:
        return jax.scipy.linalg.lu_solve(factors, r)

    k1 = solve(0.5 * h * (f0 + 0.5 * (b1 - b0)))
    k2 = solve(0.5 * h * (f0 + 1.5 * (b1 - b0)) + 2.0 * mass * k1)
    x3 = x + 2.0 * k1
    k3 = solve(0.5 * h * rate(system, mixing, x3, b1 + heating) + 0.5 * mass * (k1 - k2))
    x4 = x3 + k3
    k4 = solve(0.5 * h * rate(system, mixing, x4, b1 + heating) + 0.5 * mass * (k1 - k2 - 8.0 / 3.0 * k3))
    return x4 + k4


def integrate(system: System, drive: Drive, *, max_segments: int = 4) -> tuple[Any, Any]:
    """States [K+1, n] (K) and heater status [K+1, H] on the drive's grid.

    At most `max_segments` - 1 switches happen in one grid step; more would be lost, so compare with the kernel.
    """
    inputs = jnp.asarray(drive.inputs) @ system.forcing.T
    durations = jnp.diff(jnp.asarray(drive.times))
    sensors = jnp.asarray(drive.sensors)
    measured = jnp.asarray(drive.measured)
    heater_count = sensors.shape[0]

    def segment(carry: Any, _: Any, b_start: Any, b_stop: Any, duration: Any, simulated: Any) -> Any:
        x, u, begin = carry
        active = begin < duration
        h = jnp.where(active, duration - begin, 1.0)
        safe_duration = jnp.where(duration > 0, duration, 1.0)
        slope = (b_stop - b_start) / safe_duration
        b0 = b_start + slope * begin

        def advance(length: Any) -> Any:
            return rosenbrock_step(system, drive, x, length, b0, b0 + slope * length, u)

        x1 = advance(h)
        if heater_count == 0:
            return (jnp.where(active, x1, x), u, jnp.where(active, duration, begin)), None
        threshold = jnp.where(u > 0.5, system.upper, system.lower)
        sign = jnp.where(u > 0.5, 1.0, -1.0)
        crossed = simulated & (sign * (sensors @ x1 - threshold) > 0.0) & active

        def crossing(k: Any) -> Any:
            def overshoot(length: Any) -> Any:
                return sign[k] * (sensors[k] @ advance(length) - threshold[k])

            def halve(_: Any, bracket: Any) -> Any:
                low, high = bracket
                middle = 0.5 * (low + high)
                past = overshoot(middle) > 0
                return jnp.where(past, low, middle), jnp.where(past, middle, high)

            low, high = jax.lax.fori_loop(0, _LOCATION_ITERATIONS, halve, (jnp.zeros_like(h), h))
            located = jax.lax.stop_gradient(0.5 * (low + high))
            slope_there = jax.lax.stop_gradient(jax.jvp(overshoot, (located,), (jnp.ones_like(located),))[1])
            # One Newton step that changes the value by rounding only, and carries the implicit derivative.
            return located - overshoot(located) / jnp.where(crossed[k], slope_there, 1.0)

        lengths = jnp.where(crossed, jax.vmap(crossing)(jnp.arange(heater_count)), jnp.inf)
        event = jnp.argmin(lengths)
        switched = jnp.any(crossed)
        length = jnp.where(switched, lengths[event], h)
        x_next = jnp.where(active, advance(length), x)
        u_next = jnp.where(switched, u.at[event].set(1.0 - u[event]), u)
        begin_next = jnp.where(active, jnp.where(switched, begin + length, duration), begin)
        return (x_next, u_next, begin_next), None

    def step(carry: Any, row: Any) -> Any:
        x, u = carry
        b_start, b_stop, duration, given = row
        simulated = jnp.isnan(given)
        u = jnp.where(simulated, u, given)
        (x, u, _), _ = jax.lax.scan(
            lambda c, s: segment(c, s, b_start, b_stop, duration, simulated),
            (x, u, jnp.zeros_like(duration)),
            None,
            length=max_segments,
        )
        return (x, u), (x, u)

    sensed = sensors @ system.initial
    u0 = jnp.where(sensed < system.lower, 1.0, jnp.where(sensed > system.upper, 0.0, jnp.asarray(drive.initially_on)))
    u0 = jnp.where(jnp.isnan(measured[0]), u0, measured[0]) if measured.shape[0] else u0
    _, (states, status) = jax.lax.scan(step, (system.initial, u0), (inputs[:-1], inputs[1:], durations, measured))
    return jnp.concatenate([system.initial[None], states]), jnp.concatenate([u0[None], status])
