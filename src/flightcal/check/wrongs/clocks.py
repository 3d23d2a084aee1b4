"""Time tags that are late or early: of all telemetry, of the status, of one channel, driver or packet."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from math import comb

import numpy as np

from ...errors import FlightcalError
from ...problem import Window, pinned_nodes
from ...scenario import SpinningAttitude
from ...simulator import FloatArray
from ...words import listed, number
from ..compared_window import ComparedWindow
from ..network_view import View
from ..sunlight import FINE, REACH, ZONES
from .wrong import (
    NARROWER,
    SHIFT,
    SHIFTS,
    Words,
    Wrong,
    as_long,
    closer,
    driven,
    driven_otherwise,
    load_series,
    minutes,
    off,
    put,
    status_channels,
)

_ZONES = tuple(h for k in range(1, round(ZONES / 1800.0) + 1) for h in (-1800.0 * k, 1800.0 * k) if abs(h) > REACH)
"""s, between a time zone and UTC."""
_OF_A_TURN, _OF_SPIN = 1.0 / 12.0, 1800.0
"""Of a body that spins: shifts are so much of a turn apart, up to so many s."""
_WHOLE_ORBITS = 4.0
"""Times less likely is a clock that is off by more than half an orbit: the same with an orbit less fits as well."""
_NEAR = 0.48
"""Hours from the middle between two whole ones: about a minute from one of them."""
_MOSTLY_LATE = 3.0
"""Times what a clock gains in the window, from which one that is late by more is said to be late."""
_RATES = tuple(sign * share for share in (0.005, 0.01, 0.02, 0.04, 0.08) for sign in (-1.0, 1.0))
_FASTEST = 0.1
"""Of the time, by which a clock gains or loses at most: no clock is worse, and a slower orbit looks like it."""
_FEW_SHIFTS = tuple(shift for m in (3, 5, 7, 10, 15, 20, 30, 40) for shift in (-60.0 * m, 60.0 * m))
_FAR_SHIFTS = tuple(shift for m in (60, 90, 120, 180, 240) for shift in (-60.0 * m, 60.0 * m))
"""... and beyond, where orbits are long enough for it."""
_LEFT = 0.7
"""Share of its samples that moved telemetry has left at least."""
_HOURS = (-86400.0, -7200.0, -3600.0, 3600.0, 7200.0, 86400.0)
"""s, by which a packet may be of another zone or day; of one channel so much explains what is slow."""


def clocks(view: View, seconds: Sequence[float] | FloatArray | None = None, apart: float = SHIFT) -> Iterator[Wrong]:
    """All time tags are late (positive) or early, by more than what lies between two samples of a driver.

    Here and below apart is how far around a shift that helps others are tried.
    """
    least = view.apart(load.driver for load in view.window.scenario.network.loads.values())
    for late in map(float, _shifts(view) if seconds is None else seconds):
        if abs(late) < least:
            continue
        hour = _an_hour(late, view.window.period)
        agrees = (
            "sunlight, eclipses and modes; whole orbits more or less may be as good"
            f"{f', such as {hour}' if hour else ''}"
        )
        check = "Check the time column: its zone, its leap seconds, the epoch of the orbit"
        if view.window.scenario.environment.orbit is None:
            agrees = "the timeline of modes"
            check = "Check the zone of the time column, its leap seconds, and the timeline's"
        words = Words(
            f"The telemetry's clock is {off(late)}",
            f"Moved {minutes(late)} {'back' if late > 0 else 'on'}, the telemetry agrees with {agrees}.",
            f"{check}; shift it by {-late:+.0f} s",
        )
        less = late - round(late / view.window.period) * view.window.period
        near = partial(clocks, view, np.union1d(closer(late, apart), closer(less, apart)), NARROWER * apart)
        tries = len(SHIFTS) * (_WHOLE_ORBITS if abs(late) > 0.5 * view.window.period else 1.0)
        yield from driven_otherwise("clock", "time", words, view, tries=tries, closer=near, sunlight=late, modes=late)


def _shifts(view: View) -> Sequence[float] | FloatArray:
    """s, by which time tags may be off: the turns of a body that spins are not stepped over."""
    attitude = view.window.scenario.environment.attitude
    period = attitude.period if isinstance(attitude, SpinningAttitude) else None
    step = SHIFT if period is None else max(FINE, _OF_A_TURN * period)
    if step >= SHIFT:
        return SHIFTS
    each = step * np.arange(1.0, _OF_SPIN // step + 1.0)
    return np.union1d(SHIFTS, np.concatenate([-each, each]))


def _an_hour(late: float, period: float) -> str:
    """In words, the fewest whole hours that time tags are off by if they are off by orbits more or less."""
    orbits = np.arange(1.0, ZONES // period + 1.0)
    others = (late + period * np.concatenate([-orbits, orbits])) / 3600.0
    hours = np.round(others[np.abs(others % 1.0 - 0.5) > _NEAR]).astype(int)
    whole = min((hour for hour in hours.tolist() if hour), key=abs, default=None)
    return "" if whole is None else f"{abs(whole)} h {'late' if whole > 0 else 'early'}"


def zones(view: View, seconds: Sequence[float] | FloatArray = _ZONES) -> Iterator[Wrong]:
    """All time tags are of another time zone, farther off than `clocks` looks."""
    for late in map(float, seconds):
        words = Words(
            f"The telemetry's clock is {off(late)}",
            f"Moved {minutes(late)} {'back' if late > 0 else 'on'}, as from another time zone, the telemetry "
            "agrees with sunlight, eclipses and modes.",
            f"Check the zone of the time column; shift it by {-late:+.0f} s",
        )
        tries = _WHOLE_ORBITS * len(_ZONES)
        yield from driven_otherwise("clock", "zone", words, view, tries=tries, sunlight=late, modes=late)


def rates(view: View, shares: Sequence[float] | FloatArray = _RATES, late: float = 0.0) -> Iterator[Wrong]:
    """All time tags go too fast (positive) or too slowly, and are right, or `late` by some s, at the beginning."""
    for share in map(float, shares):
        if abs(late) > _MOSTLY_LATE * abs(share) * view.network.drive.times[-1]:
            continue
        how = "fast" if share > 0 else "slowly"
        words = Words(
            f"The telemetry's clock goes {number(abs(100.0 * share), 2)}% too {how}",
            f"With times {number(abs(share) * 3600.0, 3)} s an hour {'shorter' if share > 0 else 'longer'}, the "
            "telemetry agrees with sunlight, eclipses and modes.",
            "Check how the time column counts, and its unit",
        )
        yield from driven_otherwise(
            "clock", "rate", words, view, tries=len(_RATES), closer=partial(_about_rate, view, share),
            sunlight=late, modes=late, gaining=share,
        )  # fmt: skip


def _about_rate(view: View, share: float) -> Iterator[Wrong]:
    """Clocks that go about so fast, and were set right before or after the window's beginning."""
    for late in np.linspace(-600.0, 600.0, 11):
        shares = share * np.array([0.6, 0.8, 1.0, 1.25, 1.6])
        yield from rates(view, shares[np.abs(shares) <= _FASTEST], float(late))


def _few_shifts(view: ComparedWindow) -> Sequence[float]:
    """Up to half an orbit: beyond, an orbit less is as good."""
    return (*_FEW_SHIFTS, *(far_shift for far_shift in _FAR_SHIFTS if abs(far_shift) <= 0.5 * view.window.period))


def status_clocks(
    view: View, seconds: Sequence[float] | FloatArray | None = None, apart: float = SHIFT
) -> Iterator[Wrong]:
    """The heaters' status is late or early beside the temperatures, by more than what lies between two samples."""
    few = _few_shifts(view)
    channels = status_channels(view)
    if not channels:
        return
    least = view.apart(channels.values())
    for late in map(float, few if seconds is None else seconds):
        if abs(late) < least:
            continue
        data = view.telemetry.assign({name: ("time", _shifted(view, name, late)) for name in channels.values()})
        words = Words(
            f"The heaters' status is {off(late)} beside the temperatures",
            f"Temperatures rise {minutes(late)} {'before' if late > 0 else 'after'} the status says that a heater is "
            "on.",
            f"Check the time tags of {listed(list(channels.values()))}",
        )
        near = partial(status_clocks, view, closer(late, apart), NARROWER * apart)
        yield from driven_otherwise("status clock", "status", words, view, tries=len(few), closer=near, telemetry=data)


def _shifted(view: View, channel: str, late: float) -> FloatArray:
    """A status [T] as it is so much later."""
    times = view.telemetry["time"].to_numpy()
    values = view.telemetry[channel].to_numpy()
    valid = np.isfinite(values)
    if not valid.any():
        return np.asarray(values)
    at = times + np.timedelta64(round(1e3 * late), "ms")
    place = np.clip(np.searchsorted(times[valid], at, side="right") - 1, 0, valid.sum() - 1)
    return np.asarray(values[valid][place])


def channel_clocks(
    view: ComparedWindow,
    seconds: Sequence[float] | FloatArray | None = None,
    groups: Sequence[Sequence[str]] | None = None,
    apart: float = SHIFT,
) -> Iterator[Wrong]:
    """Time tags of a channel, or of a group of them, are late or early, by more than lies between two samples."""
    simulated = _simulated(view)
    known = simulated if len(simulated) > 1 else []
    in_order = (sorted(group, key=view.channels.index) for group in groups or [[name] for name in known])
    tried, few = {tuple(group): view.apart(group) for group in in_order}, _few_shifts(view)
    for late in map(float, few if seconds is None else seconds):
        moved = view.readings(late)
        for group, least in tried.items():
            places = [view.channels.index(name) for name in group]
            observed = _moved(view, moved, places) if abs(late) >= least else None
            if observed is None:
                continue
            write = f"; or write 'time_offset: {-late:.0f} s' in 'observations' there" if view.are_nodes(group) else ""
            words = Words(
                f"{listed(group)} {'is' if len(group) == 1 else 'are'} {off(late)}",
                f"Moved by {minutes(late)}, {listed(group)} alone, all channels agree with the model.",
                f"Check the time tags of {listed(group)}{write}",
            )
            near = partial(_channels_like, view, group, late, apart)
            alone = as_long(late) if len(group) < len(known) else 1.0
            tries = alone * len(few) * comb(len(known), len(group))
            smoothed = view.smoothed(late, group)
            yield Wrong("channel clock", " ".join(group), words, observed, tries=tries, smoothed=smoothed, closer=near)


def _channels_like(view: ComparedWindow, names: Sequence[str], late: float, apart: float) -> Iterator[Wrong]:
    """About as late, and as late with one more channel: those of one unit are late together."""
    yield from channel_clocks(view, closer(late, apart), [names], NARROWER * apart)
    others = [name for name in _simulated(view) if name not in names]
    # All of them are the telemetry's clock.
    if len(others) > 1:
        yield from channel_clocks(view, [late], [[*names, name] for name in others], apart)


def _simulated(view: ComparedWindow) -> list[str]:
    """Channels of nodes that are not held at what is read there, whenever that is."""
    scenario = view.window.scenario
    held = pinned_nodes(scenario)
    return [name for name in view.channels if scenario.observations[name].node not in held]


def _moved(view: ComparedWindow, moved: FloatArray, places: Sequence[int]) -> FloatArray | None:
    """Telemetry [t, N] with some channels moved in time; None: too few of their samples are left."""
    observed = view.observed.copy()
    observed[:, places] = moved[:, places]
    left = np.isfinite(moved).sum(0)
    return None if len(places) and left[places].min() < _LEFT * left.max() else observed


def _enough(view: ComparedWindow, observed: FloatArray | None) -> bool:
    """Whether of all telemetry together enough is left to be compared, where all of it is moved."""
    return observed is None or bool(np.isfinite(observed).sum() >= _LEFT * np.isfinite(view.observed).sum())


def clocks_as_read(
    view: ComparedWindow, seconds: Sequence[float] | FloatArray = SHIFTS, apart: float = SHIFT
) -> Iterator[Wrong]:
    """All time tags are late or early, up to half an orbit, where telemetry is moved and not what acts on a simulator.

    Farther off other telemetry would be compared, which may be better for other reasons.
    """
    least, period = view.apart(view.channels), view.window.period
    for late in map(float, seconds):
        if not least <= abs(late) <= 0.5 * period + SHIFT:
            continue
        observed = _moved(view, view.readings(late), range(len(view.channels)))
        if observed is None or not _enough(view, observed):
            continue
        hour = _an_hour(late, period)
        words = Words(
            f"The telemetry's clock is {off(late)}{f', or {hour}' if hour else ''}",
            f"Moved {minutes(late)} {'back' if late > 0 else 'on'}, the telemetry agrees with the simulator; whole "
            "orbits more or less may be as good.",
            "Check the time column, its zone and leap seconds, and when the simulator begins; shift it by "
            f"{-late:+.0f} s",
        )
        near = partial(clocks_as_read, view, closer(late, apart), NARROWER * apart)
        smoothed = view.smoothed(late, view.channels)
        yield Wrong("clock", "time", words, observed, tries=len(SHIFTS), smoothed=smoothed, closer=near)


def packet_clocks(
    view: View,
    seconds: Sequence[float] | FloatArray | None = None,
    only: str | None = None,
    apart: float = SHIFT,
) -> Iterator[Wrong]:
    """Time tags of a packet are late or early: of its temperatures, status and drivers, beside all that is not its."""
    scenario = view.window.scenario
    statuses, drivers = set(status_channels(view).values()), _drivers(view)
    used = [*view.channels, *sorted(statuses), *sorted(drivers)]
    packets: dict[str, list[str]] = {}
    for name in used:
        packets.setdefault(scenario.telemetry.channels[name].packet or "", []).append(name)
    # One channel alone, all status, or all telemetry is looked at elsewhere.
    tried = {
        packet: members
        for packet, members in packets.items()
        if packet and only in (None, packet) and 1 < len(members) < len(used) and set(members) != statuses
    }
    few = _few_shifts(view)
    tried_shifts = [*few, *(hour for hour in _HOURS if hour not in few)] if seconds is None else seconds
    for (packet, members), late in product(tried.items(), map(float, tried_shifts)):
        temperatures = [name for name in view.channels if name in members]
        observed = _moved(view, view.readings(late), [view.channels.index(name) for name in temperatures])
        if observed is None or abs(late) < view.apart(members):
            continue
        try:
            window = _with_late(view, members, late)
        except (FlightcalError, ValueError):
            continue
        words = Words(
            f"packet {packet} is {off(late)}",
            f"Moved by {minutes(late)}, this packet alone, all channels agree with the model.",
            f"Check the time column of packet {packet}: its zone, its epoch, its leap seconds",
        )
        near = partial(packet_clocks, view, closer(late, apart), packet, NARROWER * apart)
        tries = len(few) * len(packets)
        smoothed = view.smoothed(late, temperatures)
        about = " ".join(members)
        yield Wrong("channel clock", about, words, observed, window, tries=tries, smoothed=smoothed, closer=near)


def driver_clocks(
    view: View, seconds: Sequence[float] | FloatArray = _FEW_SHIFTS, only: str | None = None, apart: float = SHIFT
) -> Iterator[Wrong]:
    """Time tags of a driver are late or early, by more than what lies between two of its samples.

    Not by hours: so moved, a driver that hardly heats may help a model that is only too simple.
    """
    drivers = _drivers(view)
    for driver, late in product(sorted(drivers), map(float, seconds)):
        if only not in (None, driver) or abs(late) < view.apart([driver]):
            continue
        try:
            window = _with_late(view, [driver], late)
        except (FlightcalError, ValueError):
            continue
        words = Words(
            f"The driver {driver} is {off(late)}",
            f"Temperatures follow it {minutes(late)} {'before' if late > 0 else 'after'} it changes.",
            f"Check the time tags of {driver}",
        )
        near = partial(driver_clocks, view, closer(late, apart), driver, NARROWER * apart)
        tries = len(_FEW_SHIFTS) * len(drivers)
        yield Wrong("driver clock", driver, words, window=window, tries=tries, closer=near)


def temperature_clocks(view: View) -> Iterator[Wrong]:
    """Time tags of all temperatures are late or early beside the drivers, where there is no orbit to compare with.

    One channel alone is late too where its node is slower than the model: that tells nothing of a clock.
    """
    several = len(view.channels) > 1 and len(_drivers(view)) > 1
    if view.window.scenario.environment.orbit is None and several:
        yield from (wrong for wrong in channel_clocks(view, groups=[view.channels]) if _enough(view, wrong.observed))


def _drivers(view: View) -> set[str]:
    """Channels that loads follow."""
    return {load.driver for load in view.window.scenario.network.loads.values()}


def _with_late(view: View, channels: Collection[str], late: float) -> Window:
    """The view's window with the status and the drivers among some channels as they are so much later.

    Before the first sample and after the last they stay. Raises TelemetryError.
    """
    scenario, columns = view.window.scenario, view.network.network.columns
    statuses = [name for name in status_channels(view).values() if name in channels]
    data = view.telemetry.assign({name: ("time", _shifted(view, name, late)) for name in statuses})
    window = driven(view, telemetry=data if statuses else None)
    simulator = window.network
    inputs, grid = simulator.drive.inputs.copy(), simulator.drive.times
    for name, load in scenario.network.loads.items():
        if load.driver in channels:
            put(inputs, columns, grid, {f"driver.{name}": load_series(view, load, load.driver, grid + late)}, grid)
    return replace(window, simulator=replace(simulator, drive=replace(simulator.drive, inputs=inputs)))


WRONGS = (clocks, zones, rates, status_clocks, channel_clocks, temperature_clocks, packet_clocks, driver_clocks)
"""What looks for them."""
