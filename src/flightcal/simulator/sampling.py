"""Outputs at the telemetry's own times, from the states on the grid."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled, inlined
from .system import FloatArray


class Sampling(NamedTuple):
    """Where samples lie on the grid: between `point` and the next, a share `weight` of the way."""

    point: NDArray[np.int64]
    """[T], not decreasing."""
    weight: FloatArray
    """[T] 0..1."""


def locate(samples: FloatArray, grid: FloatArray) -> Sampling:
    """Where samples (s, ascending) lie on a grid with possible double points."""
    index = np.clip(np.searchsorted(grid, samples + 1e-9, side="right") - 1, 0, len(grid) - 2)
    length = grid[index + 1] - grid[index]
    weight = np.divide(samples - grid[index], length, out=np.zeros_like(samples), where=length > 0)
    return Sampling(index, np.clip(weight, 0.0, 1.0))


@compiled
def observe(sampling, channel_states, offsets, times, simulation, lane, record, outputs):
    """From a lane's `Record` of a simulation to its row of `Outputs`.

    Temperatures are those of the states [N] that the channels measure, linear between grid points, plus offsets [S, N].
    """
    heaters = record.heater.shape[2]
    segments = record.segments[lane]
    segment = 0
    interpolate(sampling, record.states[lane], channel_states, offsets[simulation], outputs.temperatures[simulation])
    for t in range(sampling.point.shape[0]):
        if heaters > 0:
            k = sampling.point[t]
            time = times[k] + sampling.weight[t] * (times[k + 1] - times[k])
            while segment + 1 < segments and record.start[lane, segment + 1] <= time:
                segment += 1
            for h in range(heaters):
                outputs.status[simulation, t, h] = record.heater[lane, segment, h]
    first = outputs.noted[0]
    switches = first
    total = 0.0
    for h in range(heaters):
        outputs.duty_cycle[simulation, h] = 0.0
    for s in range(segments):
        length = record.length[lane, s]
        total += length
        for h in range(heaters):
            outputs.duty_cycle[simulation, h] += length * record.heater[lane, s, h]
        event = record.event[lane, s]
        if event >= 0:
            outputs.switch_time[switches] = record.start[lane, s] + length
            outputs.switch_heater[switches] = event
            outputs.switch_on[switches] = 1.0 - record.heater[lane, s, event]
            switches += 1
    for h in range(heaters):
        outputs.duty_cycle[simulation, h] /= total
    outputs.switches[simulation] = switches - first
    outputs.switch_first[simulation] = first
    outputs.noted[0] = switches


@inlined
def interpolate(sampling, on_grid, states, offsets, at_samples):
    """Fill at_samples [T, N] with the grid's [K+1, n] `states` [N], linear between points, plus offsets [N]."""
    for t in range(at_samples.shape[0]):
        k, share = sampling.point[t], sampling.weight[t]
        for c in range(states.shape[0]):
            left, right = on_grid[k, states[c]], on_grid[k + 1, states[c]]
            at_samples[t, c] = (1.0 - share) * left + share * right + offsets[c]


@compiled
def spread(sampling, at_samples, states, on_grid, offsets):
    """The transpose of `interpolate`: fill on_grid [K+1, n] and offsets [N] from at_samples [T, N]."""
    on_grid[:] = 0.0
    offsets[:] = 0.0
    for t in range(at_samples.shape[0]):
        k, share = sampling.point[t], sampling.weight[t]
        for c in range(states.shape[0]):
            on_grid[k, states[c]] += (1.0 - share) * at_samples[t, c]
            on_grid[k + 1, states[c]] += share * at_samples[t, c]
            offsets[c] += at_samples[t, c]
