"""Outputs at the telemetry's own times, from the states on the grid."""

from __future__ import annotations

from typing import Any, NamedTuple

from ...compiled import inlined, kernel

GAIN, BIAS, TIME_OFFSET = range(3)
"""Of the errors; K, and s."""
ICE_POINT = 273.15  # K
_SHORTEST = 1e-3  # s; shorter steps bring massless nodes into balance, their slope is not one in time


@inlined
def observe(sampling, sensors, errors, times, simulation, lane, record, outputs):
    """From a lane's `Record` of a simulation to its row of `Outputs`; errors [S, 3, N], see `Sensors`."""
    heaters = record.heater.shape[2]
    segments = record.segments[lane]
    segment = 0
    interpolate(sampling, sensors, times, record.states[lane], errors[simulation], outputs.temperatures[simulation])
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
def interpolate(sampling, sensors, times, on_grid, errors, at_samples):
    """Fill at_samples [T, N] with what the sensors, with errors [3, N], say of the grid's [K+1, n] states.

    Temperatures are linear between grid points.
    """
    for t in range(at_samples.shape[0]):
        k, share = sampling.point[t], sampling.weight[t]
        for c in range(sensors.state.shape[0]):
            left, right = on_grid[k, sensors.state[c]], on_grid[k + 1, sensors.state[c]]
            at_samples[t, c] = _reading(errors, c, (1.0 - share) * left + share * right)
    for c in range(sensors.state.shape[0]):
        if sensors.moved[c]:
            _interpolate_moved(sampling, sensors.state[c], times, on_grid, errors, c, at_samples)


@inlined
def _reading(errors, c, temperature):
    return errors[GAIN, c] * temperature + (1.0 - errors[GAIN, c]) * ICE_POINT + errors[BIAS, c]


@inlined
def _interpolate_moved(sampling, state, times, on_grid, errors, c, at_samples):
    """`interpolate` of channel c, with its time offset."""
    k = 0
    for t in range(at_samples.shape[0]):
        k, share, _ = _place(sampling, times, errors[TIME_OFFSET, c], t, k)
        at_samples[t, c] = _reading(errors, c, (1.0 - share) * on_grid[k, state] + share * on_grid[k + 1, state])


class SpreadCall(NamedTuple):
    """What `spread` takes; the first of `errors` is meant."""

    sampling: Any
    sensors: Any
    times: Any
    record: Any
    errors: Any
    """[S, 3, N], see `Sensors`."""
    temperatures_bar: Any
    """[T, N]"""
    states_bar: Any
    """[K+1, n]"""
    errors_bar: Any
    """[3, N]"""


@kernel
def spread(call):
    """The derivative of `interpolate` backwards: states_bar and errors_bar from temperatures_bar."""
    sampling, sensors, times, errors = call.sampling, call.sensors, call.times, call.errors[0]
    on_grid, at_samples = call.record.states[0], call.temperatures_bar
    on_grid_bar, errors_bar = call.states_bar, call.errors_bar
    on_grid_bar[:] = 0.0
    errors_bar[:] = 0.0
    for t in range(at_samples.shape[0]):
        k, share = sampling.point[t], sampling.weight[t]
        for c in range(sensors.state.shape[0]):
            if not sensors.moved[c]:
                _spread(sensors.state[c], on_grid, errors, c, k, share, at_samples[t, c], on_grid_bar, errors_bar)
    for c in range(sensors.state.shape[0]):
        if sensors.moved[c]:
            k, state = 0, sensors.state[c]
            for t in range(at_samples.shape[0]):
                k, share, rate = _place(sampling, times, errors[TIME_OFFSET, c], t, k)
                _spread(state, on_grid, errors, c, k, share, at_samples[t, c], on_grid_bar, errors_bar)
                slope = (on_grid[k + 1, state] - on_grid[k, state]) * rate
                errors_bar[TIME_OFFSET, c] += errors[GAIN, c] * at_samples[t, c] * slope
    return 0


@inlined
def _spread(state, on_grid, errors, c, k, share, cotangent, on_grid_bar, errors_bar):
    on_grid_bar[k, state] += (1.0 - share) * errors[GAIN, c] * cotangent
    on_grid_bar[k + 1, state] += share * errors[GAIN, c] * cotangent
    temperature = (1.0 - share) * on_grid[k, state] + share * on_grid[k + 1, state]
    errors_bar[GAIN, c] += cotangent * (temperature - ICE_POINT)
    errors_bar[BIAS, c] += cotangent


@inlined
def _place(sampling, times, offset, t, k):
    """Where sample t lies with an offset: a grid point, the share of the way to the next, and its derivative (1/s).

    k: a grid point not after it, such as that of the sample before.
    """
    point = sampling.point[t]
    time = times[point] + sampling.weight[t] * (times[point + 1] - times[point]) + offset
    while k + 2 < times.shape[0] and times[k + 1] <= time:
        k += 1
    length = times[k + 1] - times[k]
    share = (time - times[k]) / length
    if share < 0.0 or share > 1.0:
        return k, min(max(share, 0.0), 1.0), 0.0
    return k, share, 1.0 / length if length > _SHORTEST else 0.0
