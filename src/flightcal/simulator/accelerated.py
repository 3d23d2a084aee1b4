"""Thousands of simulations in JAX, for a GPU: the same scheme and switching, one thread a simulation.

Everything is an array [..., S] over the simulations, and the step is written out entry by entry when it is traced (the
pattern never changes), so XLA fuses it into a few kernels without a matrix in them. As in `forward`, each simulation
has its own place on the grid: a round makes one step, or one trial of a switch, for all.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from .._jax import jax, jnp
from .kernels.crossing import CROSSING_TOLERANCE, LOCATION_ITERATIONS
from .kernels.forward import FINISHED, NOT_FINITE, TOO_MANY_SWITCHES
from .kernels.step import EIGHT_THIRDS
from .system import Drive, FloatArray, IntArray, Structure, System, packed_bounds

_ROUNDS_PER_STEP = 60
"""More trials than this a grid step on average: a thermostat chatters."""


class _Simulations(NamedTuple):
    """Where each simulation is; see `forward._Lanes`."""

    x: Any
    """[n, S]"""
    status: Any
    """[H, S]"""
    driven: Any
    step: Any
    """[S] of the grid's steps that last."""
    begin: Any
    length: Any
    heater: Any
    low: Any
    high: Any
    previous: Any
    previous_value: Any
    iterations: Any
    states: Any
    """[points, n, S]"""
    rounds: Any


class Thousands(NamedTuple):
    """What `integrate_thousands` gives."""

    states: Any
    """[K+1, n, S] K, on JAX's device."""
    outcome: IntArray
    """[S] as in `forward`."""
    rounds: int
    """How often the loop went round: each is one pass over all simulations."""


def integrate_thousands(structure: Structure, packed: FloatArray, drive: Drive) -> Thousands:
    """Integrate packed systems [S, P] over the drive's grid.

    Compiled at the first call for a structure, a grid and a number of simulations; runs where JAX's default device is.
    """
    lasting = np.flatnonzero(np.diff(drive.times) > 0.0)
    states, finished, rounds = _run(_Static(structure, drive, lasting), jnp.asarray(packed).T)
    # A point reached by a step of no length has the state of the point before.
    reached = np.searchsorted(lasting + 1, np.arange(len(drive.times)), side="right")
    finite = np.asarray(jnp.isfinite(states[-1]).all(axis=0))
    outcome = np.where(np.asarray(finished), np.where(finite, FINISHED, NOT_FINITE), TOO_MANY_SWITCHES)
    return Thousands(states[reached], outcome, int(rounds))


class _Static:
    """What the trace is made for, compared by its content."""

    def __init__(self, structure: Structure, drive: Drive, lasting: IntArray) -> None:
        self.structure, self.drive, self.lasting = structure, drive, lasting
        content = (*structure, drive.times, drive.inputs, drive.measured, drive.initially_on)
        self._key = tuple((np.shape(part), np.asarray(part).tobytes()) for part in content)

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Static) and self._key == other._key


@partial(jax.jit, static_argnums=0)
def _run(static: _Static, packed: Any) -> tuple[Any, Any, Any]:
    """States [points, n, S] at the start and after each step that lasts; whether each [S] came to the end; rounds."""
    structure, drive, lasting = static.structure, static.drive, static.lasting
    system = System(*jnp.split(packed, packed_bounds(structure)))
    n, heaters, count = len(structure.mass), len(structure.sensor), packed.shape[1]
    durations = jnp.asarray(np.diff(drive.times)[lasting])
    first, last = jnp.asarray(drive.inputs[lasting]), jnp.asarray(drive.inputs[lasting + 1])  # at the steps' ends
    measured = jnp.asarray(drive.measured[lasting])
    sensor = np.asarray(structure.sensor, int)
    each = jnp.arange(count)

    def heat_of(inputs: Any) -> Any:
        rows: list[Any] = [jnp.zeros(count) for _ in range(n)]
        for p, (i, j) in enumerate(zip(structure.forcing_row, structure.forcing_column, strict=True)):
            rows[i] = rows[i] + system.forcing[p] * inputs[j]
        return jnp.stack(rows)

    def heating_of(status: Any) -> Any:
        rows: list[Any] = [jnp.zeros(count) for _ in range(n)]
        for p, (k, i) in enumerate(zip(structure.heating_heater, structure.heating_row, strict=True)):
            rows[i] = rows[i] + status[k] * system.heating[p]
        return jnp.stack(rows)

    def past_threshold(x: Any, status: Any) -> Any:
        return jnp.where(status > 0.5, x[sensor] - system.upper, system.lower - x[sensor])

    def started(x: Any, status: Any) -> Any:
        on = jnp.where(status > 0.5, 1.0, 0.0)
        return jnp.where(x[sensor] < system.lower, 1.0, jnp.where(x[sensor] > system.upper, 0.0, on))

    def enter(now: _Simulations) -> _Simulations:
        """Heaters and length at the start of the step that each simulation stands before."""
        given = measured[now.step].T
        simulated = jnp.isnan(given)
        status = jnp.where(simulated, jnp.where(now.driven, started(now.x, now.status), now.status), given)
        return now._replace(
            status=status, driven=~simulated, begin=jnp.zeros(count), length=durations[now.step], heater=-1 + 0 * each
        )

    def one_round(now: _Simulations) -> _Simulations:
        duration, simulated = durations[now.step], jnp.isnan(measured[now.step].T)
        left, right = heat_of(first[now.step].T), heat_of(last[now.step].T)
        ramp = (right - left) / duration
        b0 = left + ramp * now.begin + heating_of(now.status)
        x1 = rosenbrock_step(structure, system.linear, system.radiative, now.x, now.length, b0, b0 + ramp * now.length)

        # The heater being located, if any: is the trial where it switches?
        past = jnp.where(simulated, past_threshold(x1, now.status), -1.0)
        locating = now.heater >= 0
        value = past[now.heater, each] if heaters else jnp.zeros(count)
        narrow = now.high - now.low < 1e-12 * duration
        located = (jnp.abs(value) < CROSSING_TOLERANCE) | narrow | (now.iterations >= LOCATION_ITERATIONS)
        low, high = jnp.where(value > 0.0, now.low, now.length), jnp.where(value > 0.0, now.length, now.high)
        trial = now.length - value * (now.length - now.previous) / (value - now.previous_value)
        trial = jnp.where((low < trial) & (trial < high), trial, 0.5 * (low + high))
        again = locating & ~located

        # Of those past their threshold at the trial's end, the one whose straight line crosses first is located next.
        before = past_threshold(now.x, now.status)
        others = jnp.arange(heaters)[:, None] != now.heater
        crossed = others & (past > jnp.where(locating, CROSSING_TOLERANCE, 0.0))
        share = jnp.where(before < 0.0, before / (before - past), 0.0)
        chosen = jnp.argmin(jnp.where(crossed, share, jnp.inf), axis=0) if heaters else 0 * each
        begins = jnp.any(crossed, axis=0) & ~again
        if heaters:
            start = share[chosen, each] * now.length
            begun = now._replace(
                heater=jnp.where(begins, chosen, now.heater),
                low=jnp.where(begins, 0.0, low),
                high=jnp.where(begins, now.length, high),
                previous=now.length,
                previous_value=jnp.where(begins, past[chosen, each], value),
                iterations=jnp.where(begins, 0, now.iterations + 1),
                length=jnp.where(begins, start, jnp.where(again, trial, now.length)),
            )
        else:
            begun = now

        # All others accept: the state moves, the heater switches, and the rest of the step or the next follows.
        active = now.step < len(lasting)
        accepts = active & ~again & ~begins
        switches = accepts & locating
        status = now.status
        if heaters:
            flips = switches & (jnp.arange(heaters)[:, None] == now.heater)
            status = jnp.where(flips, 1.0 - status, status)
        x = jnp.where(accepts, x1, now.x)
        begin = jnp.where(switches, now.begin + now.length, now.begin)
        arrives = accepts & (~switches | (begin >= duration))
        step = now.step + arrives
        place = jnp.where(arrives, step, 0)
        states = now.states.at[place, :, each].set(jnp.where(arrives, x, now.states[0]).T)
        rest = begun._replace(
            x=x,
            status=status,
            step=step,
            begin=begin,
            length=jnp.where(switches, duration - begin, begun.length),
            heater=jnp.where(accepts, -1, begun.heater),
            states=states,
            rounds=now.rounds + 1,
        )
        entered = enter(rest._replace(step=jnp.minimum(step, len(lasting) - 1)))
        chosen_fields = {
            name: jnp.where(arrives, getattr(entered, name), getattr(rest, name))
            for name in ("status", "driven", "begin", "length", "heater")
        }
        return rest._replace(**chosen_fields)

    x0 = system.initial
    zeros = jnp.zeros(count)
    driven = ~jnp.isnan(jnp.tile(measured[0][:, None], (1, count)))
    status = jnp.tile(jnp.asarray(drive.initially_on)[:, None], (1, count))
    begin = _Simulations(
        x=x0,
        status=started(x0, status) if heaters else status,
        driven=driven,
        step=0 * each,
        begin=zeros,
        length=zeros,
        heater=-1 + 0 * each,
        low=zeros,
        high=zeros,
        previous=zeros,
        previous_value=zeros,
        iterations=0 * each,
        states=jnp.zeros((len(lasting) + 1, n, count)).at[0].set(x0),
        rounds=0,
    )
    end = jax.lax.while_loop(
        lambda now: jnp.any(now.step < len(lasting)) & (now.rounds < _ROUNDS_PER_STEP * len(lasting)),
        one_round,
        enter(begin),
    )
    return end.states, end.step >= len(lasting), end.rounds


def rosenbrock_step(structure: Structure, A: Any, N: Any, x0: Any, h: Any, b0: Any, b1: Any) -> Any:
    """x1 [n, S] of the step of `step.advance` from x0 [n, S], entry by entry; A, N [entries, S], h [S]."""
    n = len(structure.mass)
    start, column, diagonal = structure.factor_start, structure.factor_column, structure.factor_diagonal
    half = 0.5 * h
    mass = structure.mass

    def rate(x: Any, b: Any) -> list[Any]:
        rows = []
        for i in range(n):
            total = b[i]
            for p in range(structure.linear_start[i], structure.linear_start[i + 1]):
                total = total + A[p] * x[structure.linear_column[p]]
            for p in range(structure.radiative_start[i], structure.radiative_start[i + 1]):
                square = x[structure.radiative_column[p]] ** 2
                total = total + N[p] * square * square
            rows.append(total)
        return rows

    W: list[Any] = [0.0] * len(column)
    for p, slot in enumerate(structure.linear_slot):
        W[slot] = W[slot] - half * A[p]
    for p, slot in enumerate(structure.radiative_slot):
        W[slot] = W[slot] - half * N[p] * 4.0 * x0[structure.radiative_column[p]] ** 3
    for i in range(n):
        W[diagonal[i]] = W[diagonal[i]] + mass[i]
    for i in range(n):
        row = {int(column[p]): W[p] for p in range(start[i], start[i + 1])}
        for p in range(start[i], diagonal[i]):
            k = int(column[p])
            row[k] = row[k] * W[diagonal[k]]
            for q in range(diagonal[k] + 1, start[k + 1]):
                row[int(column[q])] = row[int(column[q])] - row[k] * W[q]
        for p in range(start[i], start[i + 1]):
            W[p] = row[int(column[p])]
        W[diagonal[i]] = 1.0 / W[diagonal[i]]

    def solve(r: list[Any]) -> list[Any]:
        r = list(r)
        for i in range(n):
            for p in range(start[i], diagonal[i]):
                r[i] = r[i] - W[p] * r[column[p]]
        for i in reversed(range(n)):
            for p in range(diagonal[i] + 1, start[i + 1]):
                r[i] = r[i] - W[p] * r[column[p]]
            r[i] = r[i] * W[diagonal[i]]
        return r

    states = range(n)
    f1 = rate(x0, b0)
    k1 = solve([half * (f1[i] + 0.5 * (b1[i] - b0[i])) for i in states])
    k2 = solve([half * (f1[i] + 1.5 * (b1[i] - b0[i])) + 2.0 * mass[i] * k1[i] for i in states])
    x3 = [x0[i] + 2.0 * k1[i] for i in states]
    f3 = rate(x3, b1)
    k3 = solve([half * f3[i] + 0.5 * mass[i] * (k1[i] - k2[i]) for i in states])
    x4 = [x3[i] + k3[i] for i in states]
    f4 = rate(x4, b1)
    k4 = solve([half * f4[i] + 0.5 * mass[i] * (k1[i] - k2[i] - EIGHT_THIRDS * k3[i]) for i in states])
    return jnp.stack([x4[i] + k4[i] for i in states])
