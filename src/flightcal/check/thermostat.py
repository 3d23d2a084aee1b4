"""What thermostats do by the telemetry of their own sensor, and whether their status says the same."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np
import xarray
from numpy.typing import NDArray

from ..problem import Window, pinned_heaters
from ..scenario import ICE_POINT, Scenario, SimulatorModel
from ..simulator import FloatArray
from ..words import moment, number
from .compared_window import known_thermostats
from .samples import noise_of
from .suspicion import Suspicion

_BEYOND, _NOISES = 2.0, 4.0
"""K, and deviations of the noise, by which a sensor has to be beyond a threshold."""
_OFTEN, _LEAST = 0.05, 10
"""Share of the samples, and samples, from which it is no matter of when a sample was taken."""
_GAP = 3.0
"""Usual times between samples, over which a status that is the same at both ends was so all the time."""
_SWITCHES = 4
"""Which two thermostats do not share by chance, and which tell where one switches."""
_CHANGED, _TIMES = 1.0, 4.0
"""K and deviations of both parts, beyond which the switches of a part of the window are off those of the rest."""
_APART, _MENDED = 1.0, 0.3
"""K in the mean of its switches, from which a sensor is off its thresholds, and what share of it is left at most with
those of another heater, where they are exchanged."""


def inferred(scenario: Scenario, telemetry: xarray.Dataset, name: str) -> FloatArray:
    """How probable it is that a heater is on [T], by its sensor: 1 where this is too cold for anything else.

    0 where it is too warm; a half near the thresholds, and where nothing is read. When a thermostat switches is not
    told well enough by its sensor alone: it turns between two samples, and before these read a threshold.
    """
    heater, unknown = scenario.network.switches[name], np.full(telemetry.sizes["time"], 0.5)
    channel = next((read_by for read_by, item in scenario.observations.items() if item.node == heater.sensor), None)
    if channel is None or channel not in telemetry:
        return unknown
    observation, read = scenario.observations[channel], telemetry[channel].to_numpy()
    read = ICE_POINT + (read - observation.bias - ICE_POINT) / observation.gain
    known, margin = np.isfinite(read), _BEYOND + _NOISES * noise_of(read)
    if not known.any():
        return unknown
    # One that is never switched on, or never off, is so also where nothing is read.
    if np.nanmin(read) > heater.on_below + margin:
        return np.zeros(len(read))
    if np.nanmax(read) < heater.on_below - margin:
        return np.ones(len(read))
    beyond = np.select([read < heater.on_below - margin, read > heater.off_above + margin], [1.0, 0.0], 0.5)
    return np.nan_to_num(_between(telemetry["time"].to_numpy(), np.where(known, beyond, np.nan)), nan=0.5)


def disobeyed(window: Window) -> Iterator[tuple[Suspicion, bool]]:
    """Heaters that are often off where they should be on, or on where they should be off, or switch elsewhere.

    Each with whether its status never changes.
    """
    for name, place, channel in known_thermostats(window):
        heater, read = window.scenario.network.switches[name], _readings(window, channel)
        on, margin = _between(window.times, window.status[:, place]), _BEYOND + _NOISES * noise_of(read)
        known = np.isfinite(read) & np.isfinite(on)
        for state, beyond, limit, word in (
            ("off", (on < 0.5) & (read < heater.on_below - margin), heater.on_below, "below 'on_below'"),
            ("on", (on > 0.5) & (read > heater.off_above + margin), heater.off_above, "above 'off_above'"),
        ):
            count = int((beyond & known).sum())
            if count < max(_LEAST, _OFTEN * known.sum()):
                continue
            far = float(np.abs(read[beyond & known] - limit).max())
            suspicion = Suspicion(
                "thermostat",
                name,
                f"{name} does not do what its thresholds say",
                f"Its status says '{state}' in {count} of {int(known.sum())} samples in which {channel} is {word} "
                f"({number(limit - ICE_POINT, 3)} degC), by up to {number(far, 2)} K.",
                f"Check the status, the 'sensor' and the thresholds of {name}, and {channel}",
            )
            yield suspicion, bool(np.ptp(on[known]) == 0.0)
            break
        else:
            beside = _beside_thresholds(window, name, place, channel)
            if beside is not None:
                yield beside, False


def _beside_thresholds(window: Window, name: str, place: int, channel: str) -> Suspicion | None:
    """What is said of a heater that switches beside its thresholds, or from a time on at others than before."""
    heater, read = window.scenario.network.switches[name], _readings(window, channel)
    at, off = _at_switches(window.times, read, window.status[:, place], heater.on_below, heater.off_above)
    mean, noise = float(off.mean()) if len(off) else 0.0, noise_of(read)
    least = _BEYOND + _NOISES * noise / max(len(off), 1) ** 0.5
    if len(off) >= _SWITCHES and abs(mean) > least and ((off > 0.0).all() or (off < 0.0).all()):
        return Suspicion(
            "thermostat",
            name,
            f"{name} does not do what its thresholds say",
            f"At all of its {len(off)} switches {channel} is {'above' if mean > 0.0 else 'below'} its "
            f"thresholds, by {number(abs(mean), 2)} K in the mean.",
            f"Check the 'sensor' and the thresholds of {name}, and {channel}",
        )
    first = _changed(off, _CHANGED + _NOISES * noise)
    if first is None:
        return None
    before, later = (number(float(some.mean()), 2) for some in (off[:first], off[first:]))
    return Suspicion(
        "thermostat",
        name,
        f"{name} switches at other temperatures from {moment(at[first])} UTC on",
        f"At the {first} switches before, {channel} is off them by {before} K in the mean, and at the "
        f"{len(off) - first} from then on by {later} K.",
        f"Ask when the thresholds of {name} were changed on board; train after that, with those that hold since",
    )


def _changed(off: FloatArray, least: float) -> int | None:
    """From which of the switches [s] on they are off their thresholds by so many K more or less; None: from none on.

    Those before are alike, and those from then on.
    """

    def spread(first: int) -> float:
        return float(np.sum((off[:first] - off[:first].mean()) ** 2) + np.sum((off[first:] - off[first:].mean()) ** 2))

    found = min(range(_SWITCHES, len(off) - _SWITCHES + 1), key=spread, default=None)
    if found is None:
        return None
    step = abs(float(off[found:].mean() - off[:found].mean()))
    alike = float(np.sqrt(spread(found) / len(off)))
    return found if step > max(least, _TIMES * alike) else None


def exchanged(window: Window) -> Iterator[Suspicion]:
    """Pairs of heaters that each switch at the other one's thresholds."""
    for one, other in combinations(known_thermostats(window), 2):
        off = {
            (thermostat[0], of[0]): _off(window, thermostat, of[0])
            for thermostat in (one, other)
            for of in (one, other)
        }
        (a, _, at_a), (b, _, at_b) = one, other
        apart = np.min([off[a, a], off[b, b]])  # NaN where one is
        if not (apart >= _APART and np.max([off[a, b], off[b, a]]) <= _MENDED * apart):
            continue
        yield Suspicion(
            "thresholds exchanged",
            f"{a} {b}",
            f"The thresholds of {a} and {b} are exchanged",
            f"At their switches {at_a} and {at_b} are off their own thresholds by {number(off[a, a], 2)} and "
            f"{number(off[b, b], 2)} K in the mean, off each other's by {number(off[a, b], 2)} and "
            f"{number(off[b, a], 2)} K.",
            f"Exchange 'on_below' and 'off_above' of {a} and {b}",
        )


def _readings(window: Window, channel: str) -> FloatArray:
    """[T] K, of a thermostat's sensor less its bias."""
    bias = window.scenario.observations[channel].bias
    return np.asarray(window.observed[:, window.simulator.channels.index(channel)] - bias)


def _off(window: Window, thermostat: tuple[str, int, str], of: str) -> float:
    """K by which a thermostat's sensor is off the thresholds of the heater `of` in the mean of its switches.

    own: see `known_thermostats`. NaN: there are too few switches.
    """
    _, place, channel = thermostat
    heater, read = window.scenario.network.switches[of], _readings(window, channel)
    _, off = _at_switches(window.times, read, window.status[:, place], heater.on_below, heater.off_above)
    return abs(float(off.mean())) if len(off) >= _SWITCHES // 2 else np.nan


def _at_switches(
    times: NDArray[np.datetime64], read: FloatArray, status: FloatArray, on_below: float, off_above: float
) -> tuple[NDArray[np.datetime64], FloatArray]:
    """Times [s] of changes of a status [T], and K [s] by which readings [T] are above the threshold there.

    Readings and status may be of different times.
    """
    seconds = (times - times[0]) / np.timedelta64(1, "s")
    known, valid = np.flatnonzero(np.isfinite(status)), np.flatnonzero(np.isfinite(read))
    if min(len(known), len(valid)) < 2:
        return times[:0], np.empty(0)
    before = np.flatnonzero(np.diff(status[known]) != 0.0)
    first, last = seconds[known[before]], seconds[known[before + 1]]
    at = 0.5 * (first + last)
    after = np.clip(np.searchsorted(seconds[valid], at), 1, len(valid) - 1)
    apart = seconds[valid[after]] - seconds[valid[after - 1]]
    near = (apart <= _GAP * np.median(np.diff(seconds[valid]))) & (
        last - first <= _GAP * np.median(np.diff(seconds[known]))
    )
    threshold = np.where(status[known[before + 1]] > 0.5, on_below, off_above)
    off = np.interp(at, seconds[valid], read[valid]) - threshold
    return times[known[before + 1]][near], np.asarray(off[near])


def _between(times: NDArray[np.datetime64], status: FloatArray) -> FloatArray:
    """A status [T] also between two of its samples that say the same: other packets have times of their own."""
    known = np.flatnonzero(np.isfinite(status))
    if len(known) < 2:
        return status
    after = np.clip(np.searchsorted(known, np.arange(len(status))), 1, len(known) - 1)
    first, last = known[after - 1], known[after]
    seconds = (times - times[0]) / np.timedelta64(1, "s")
    near = seconds[last] - seconds[first] <= _GAP * np.median(np.diff(seconds[known]))
    same = near & (status[first] == status[last])
    places = np.arange(len(status))
    return np.where(same & (places > first) & (places < last), status[first], status)


def unfollowed(window: Window) -> Iterator[Suspicion]:
    """Heaters that switch as fast as their status is sampled, or faster, and whose nodes are not held.

    Samples that have nothing to do with each other are on for 1 / (1 - d) in a row and off for 1 / d, where d is the
    share of them that are on: the sum of the reciprocals is 1. It is smaller where each time on and off is seen.
    """
    held = pinned_heaters(window.scenario)
    for name, place, _ in known_thermostats(window):
        if name in held:
            continue
        status = window.status[:, place]
        on = status[np.isfinite(status)] > 0.5
        turns = np.flatnonzero(np.diff(on))
        if len(turns) < _LEAST:
            continue
        lengths = np.diff(turns)  # the first and the last time may be longer than what is seen of them
        means = [float(lengths[start::2].mean()) for start in (0, 1)]
        if sum(1.0 / mean for mean in means) < 1.0:
            continue
        yield Suspicion(
            "sampling",
            name,
            f"{name} switches as fast as its status is sampled",
            f"The status changes {len(turns)} times in {len(on)} samples, and stays for {number(min(means), 2)} of "
            "them in the mean: some of its switches are missed, and the model heats at wrong times.",
            f"Ask for the status of {name} more often than it switches; else leave it out, and write a load for its "
            "heat, whose driver is the status in means over some minutes",
        )


def copied(window: Window) -> Iterator[Suspicion]:
    """Pairs of heaters with one status and two sensors."""
    if not isinstance(window.scenario.simulator, SimulatorModel):
        return
    heaters = window.scenario.simulator.switches
    for (a, first), (b, second) in combinations(enumerate(heaters), 2):
        one, other = (_between(window.times, window.status[:, k]) for k in (a, b))
        known = np.isfinite(one) & np.isfinite(other)
        switches = int((np.diff(one[known]) != 0.0).sum())
        if heaters[first].sensor == heaters[second].sensor or switches < _SWITCHES or (one != other)[known].any():
            continue
        yield Suspicion(
            "same status",
            f"{first} {second}",
            f"{first} and {second} have the same status",
            f"It is the same in all {int(known.sum())} samples, and changes {switches} times; their sensors are two.",
            f"Check which columns the status of {first} and that of {second} are",
        )
