"""The same scheme and switching as the compiled integration, differentiated by JAX itself."""

from __future__ import annotations

from typing import Any

import numpy as np

from flightcal.scenario import ICE_POINT
from flightcal.simulator.kernels.sampling import BEYOND, BIAS, GAIN, TIME_OFFSET
from flightcal.simulator.system import Drive, Structure, System

from .double import jax, jnp

_LOCATION_ITERATIONS = 60


def dense(structure: Structure, system: System) -> tuple[Any, Any, Any, Any, Any]:
    """A [n, n], N [n, n], Q [n, n], B [n, q] and g [H, n] as dense arrays."""
    n = len(structure.mass)

    def by_rows(start: Any, column: Any, values: Any) -> Any:
        row = np.repeat(np.arange(n), np.diff(start))
        return jnp.zeros((n, n)).at[row, column].set(values)

    inputs = int(structure.forcing_column.max()) + 1 if len(structure.forcing_column) else 0
    return (
        by_rows(structure.linear_start, structure.linear_column, system.linear),
        by_rows(structure.radiative_start, structure.radiative_column, system.radiative),
        jnp.zeros((n, n)).at[structure.quadratic_row, structure.quadratic_column].set(system.quadratic),
        jnp.zeros((n, inputs)).at[structure.forcing_row, structure.forcing_column].set(system.forcing),
        jnp.zeros((len(structure.sensor), n)).at[structure.heating_heater, structure.heating_row].set(system.heating),
    )


def rosenbrock_step(A: Any, N: Any, Q: Any, mass: Any, x: Any, h: Any, b0: Any, b1: Any) -> Any:
    """One RODAS3 step of length h [s] from x [n], with all heat inputs b0 and b1 [n] at its ends (see `step`)."""
    return _step_and_output(A, N, Q, mass, x, h, b0, b1, False)[0]


def _step_and_output(
    A: Any, N: Any, Q: Any, mass: Any, x: Any, h: Any, b0: Any, b1: Any, balanced: Any
) -> tuple[Any, Any]:
    """The step's end [n], and what the dense output is made of (see `sampling`): [6, n] h f1 or
    what takes its place, h v, and k1 to k4. balanced: whether massless nodes are in balance at the start."""

    def rate(state: Any, heat: Any) -> Any:
        return A @ state + Q @ state**2 + N @ state**4 + heat

    jacobian = jax.jacfwd(rate)(x, b0)
    # The inverse, and not factors: its derivative compiles faster.
    inverse = jnp.linalg.inv(jnp.diag(mass) - 0.5 * h * jacobian)

    def solve(r: Any) -> Any:
        return inverse @ r

    k1 = solve(0.5 * h * (rate(x, b0) + 0.5 * (b1 - b0)))
    k2 = solve(0.5 * h * (rate(x, b0) + 1.5 * (b1 - b0)) + 2.0 * mass * k1)
    x3 = x + 2.0 * k1
    k3 = solve(0.5 * h * rate(x3, b1) + 0.5 * mass * (k1 - k2))
    x4 = x3 + k3
    k4 = solve(0.5 * h * rate(x4, b1) + 0.5 * mass * (k1 - k2 - 8.0 / 3.0 * k3))
    ended = 2.0 * k4 - k1 + k2 + 8.0 / 3.0 * k3
    begun = jnp.where((mass > 0.0).all() | balanced, h * rate(x, b0), 5.0 * k1 - k2)
    return x4 + k4, jnp.stack([begun, ended, k1, k2, k3, k4])


def integrate(structure: Structure, system: System, drive: Drive, *, max_segments: int = 4) -> tuple[Any, Any]:
    """States [K+1, n] (K) and heater status [K+1, H] just after each point of the drive's grid.

    At most `max_segments` - 1 switches happen in one grid step; more would be lost, so compare with `integrate`.
    """
    return _run(structure, system, drive, max_segments)[:2]


def _run(structure: Structure, system: System, drive: Drive, max_segments: int) -> tuple[Any, Any, Any]:
    """As `integrate`, and of every segment whether there is one, its start, length, end states, `_step_and_output`."""
    A, N, Q, B, g = dense(structure, system)
    mass = jnp.asarray(structure.mass)
    heat = jnp.asarray(drive.inputs[:, :, : B.shape[1]]) @ B.T
    durations = jnp.diff(jnp.asarray(drive.times))
    measured = jnp.asarray(drive.measured)
    heaters = jnp.arange(len(structure.sensor))
    sensor = jnp.asarray(structure.sensor)

    def segment(carry: Any, _: Any, start: Any, stop: Any, duration: Any, simulated: Any) -> Any:
        x, u, begin, before = carry
        active = begin < duration
        now = jnp.append(u, 1.0)  # the one: there is a segment before
        balanced = (now == before).all()
        before = jnp.where(active, now, before)
        h = jnp.where(active, duration - begin, 1.0)
        slope = (stop - start) / duration
        b0 = start + slope * begin + u @ g

        def advance(length: Any) -> Any:
            return rosenbrock_step(A, N, Q, mass, x, length, b0, b0 + slope * length)

        def segment_of(length: Any) -> Any:
            x1, made_of = _step_and_output(A, N, Q, mass, x, length, b0, b0 + slope * length, balanced)
            return active, begin, length, x, x1, made_of

        if len(heaters) == 0:
            whole = segment_of(h)
            return (jnp.where(active, whole[4], x), u, jnp.where(active, duration, begin), before), whole
        x1 = advance(h)
        threshold = jnp.where(u > 0.5, system.upper, system.lower)
        sign = jnp.where(u > 0.5, 1.0, -1.0)
        crossed = simulated & (sign * (x1[sensor] - threshold) > 0.0) & active

        def crossing(k: Any) -> Any:
            def overshoot(length: Any) -> Any:
                return sign[k] * (advance(length)[sensor[k]] - threshold[k])

            def halve(_: Any, bracket: Any) -> Any:
                low, high = bracket
                middle = 0.5 * (low + high)
                past = overshoot(middle) > 0
                return jnp.where(past, low, middle), jnp.where(past, middle, high)

            low, high = jax.lax.fori_loop(0, _LOCATION_ITERATIONS, halve, (jnp.zeros_like(h), h))
            located = jax.lax.stop_gradient(0.5 * (low + high))
            past, speed = jax.jvp(overshoot, (located,), (jnp.ones_like(located),))
            # One Newton step that changes the value by rounding only, and carries the implicit derivative.
            return located - past / jnp.where(crossed[k], jax.lax.stop_gradient(speed), 1.0)

        lengths = jnp.where(crossed, jax.vmap(crossing)(heaters), jnp.inf)
        event = jnp.argmin(lengths)
        switched = jnp.any(crossed)
        length = jnp.where(switched, lengths[event], h)
        found = segment_of(length)
        x_next = jnp.where(active, found[4], x)
        u_next = jnp.where(switched, u.at[event].set(1.0 - u[event]), u)
        begin_next = jnp.where(active, jnp.where(switched, begin + length, duration), begin)
        return (x_next, u_next, begin_next, before), found

    def step(carry: Any, row: Any) -> Any:
        x, u, driven, before = carry
        start, stop, duration, given = row
        simulated = jnp.isnan(given)
        entered = jnp.where(simulated, jnp.where(driven, started(x, u), u), given)
        (x, u, _, before), segments = jax.lax.scan(
            lambda c, s: segment(c, s, start, stop, duration, simulated),
            (x, entered, jnp.zeros_like(duration), before),
            None,
            length=max_segments,
        )
        return (x, u, ~simulated, before), (x, entered, segments)

    def started(x: Any, status: Any) -> Any:
        on = jnp.where(status > 0.5, 1.0, 0.0)
        return jnp.where(x[sensor] < system.lower, 1.0, jnp.where(x[sensor] > system.upper, 0.0, on))

    driven = ~jnp.isnan(measured[0])
    u0 = jnp.where(driven, measured[0], started(system.initial, jnp.asarray(drive.initially_on)))
    rows = (heat[:, 0], heat[:, 1], durations, measured)
    (_, last, *_), (states, status, segments) = jax.lax.scan(
        step, (system.initial, u0, driven, jnp.zeros(len(u0) + 1)), rows
    )
    active, begin, *rest = segments
    begin = jnp.asarray(drive.times)[:-1, None] + begin
    flat = [part.reshape(-1, *part.shape[2:]) for part in (active, begin, *rest)]
    return jnp.concatenate([system.initial[None], states]), jnp.concatenate([status, last[None]]), flat


def simulate(
    structure: Structure, system: System, drive: Drive, samples: Any, state: Any, errors: Any, *, max_segments: int = 4
) -> Any:
    """What sensors of the states `state` [N] with errors [3, N] say at `samples` [T] s; see `Sensors`."""
    _, _, (active, begin, length, x0, x1, made_of) = _run(structure, system, drive, max_segments)

    mass = jnp.asarray(structure.mass)

    def channel(i: Any, error: Any) -> Any:
        def reading(sample: Any) -> Any:
            time = jnp.clip(sample + error[TIME_OFFSET], -BEYOND, drive.times[-1] + BEYOND)
            before = active & (begin <= time)
            k = jnp.where(before.any(), jnp.max(jnp.where(before, jnp.arange(len(begin)), -1)), jnp.argmax(active))
            first, last, k1, k2, k3, k4 = made_of[k, :, i]

            def inside(s: Any) -> Any:
                value = s**2 * (3.0 - 2.0 * s)
                massive = value * (x1[k, i] - x0[k, i]) + s * (1.0 - s) ** 2 * first - s**2 * (1.0 - s) * last
                massless = s * (5.0 - 3.0 * s) * k1 - s * (1.0 - s) * k2 + s**2 * k3 + value * k4
                return x0[k, i] + jnp.where(mass[i] > 0.0, massive, massless)

            # Beyond the window's ends in a straight line.
            s = (time - begin[k]) / length[k]
            end = jnp.where(s < 0.0, 0.0, 1.0)
            straight = inside(end) + (s - end) * jax.grad(inside)(end)
            seen = jnp.where((s < 0.0) | (s > 1.0), straight, inside(s))
            return error[GAIN] * (seen - ICE_POINT) + ICE_POINT + error[BIAS]

        return jax.vmap(reading)(jnp.asarray(samples))

    return jax.vmap(channel, in_axes=(0, 1), out_axes=1)(jnp.asarray(state), jnp.asarray(errors))
