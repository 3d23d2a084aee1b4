"""Do the intervals hold on orbits that the run has not seen?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...prediction import AGES, HELD, Holding
from ...words import listed, minute, number, percent
from ..panels.duty import CLOSED, duties
from ..panels.parameters import shortened
from ..panels.picture import holdings, wide_intervals
from ..panels.prediction import unseen, unseen_share
from ..run_files import RunFiles
from .finding import AGAIN, CHECK, Finding, State, duty_of, temperatures_of

_FEW = 0.85
"""Share inside 95% intervals, from below which it is said with what chance may leave."""
STRIKING = 0.6
"""Share inside the interval that no reader takes for 95%, though errors as long as the window can make it by chance."""
_OUTSIDE = 0.05
"""Share of a window's time outside of what training contained, above which a title says so."""
_CONSTANT = 0.9
"""Share of the root mean square of an error that is its mean, above which it is there all the time."""
_FAR, _MOSTLY = 2.0, 0.8
"""Half widths of an interval, and share of the samples, that make a stretch in which something else was flown."""
_OF_DUTY = {"inside": "", "beside": ", beside it, as may be by chance", "outside": ", which leaves telemetry out"}
"""What is added of a duty cycle by where it lies."""


@dataclass(frozen=True)
class _Case:
    """A channel in a window that was not trained on."""

    window: str
    channel: str
    share: float
    """Of its telemetry inside the interval,"""
    least: float
    """and what chance may leave of it."""
    room: float
    """Below 0 it does not hold."""
    how: str
    """What does not hold, in words; else ""."""
    words: str

    @property
    def is_few(self) -> bool:
        """Whether it holds, though no reader takes its share for that of the interval."""
        return self.room >= 0.0 and self.share < STRIKING


def holding(run: RunFiles) -> Finding:
    """Whether intervals hold on windows that were not trained on, all channels and windows together."""
    judged = holdings(run)
    if not run.windows:
        text = "There is no prediction in this run (prediction.nc), so nothing says whether it can be trusted."
        return Finding("bad", "Nothing is predicted: the run did not finish", text, then=AGAIN)
    if not judged:
        text = "The scenario has no window that was not trained on: nothing says how well it predicts unseen telemetry."
        then = "Add a window: windows: {test: {start: ..., end: ...}}"
        return Finding("none", "No unseen telemetry", text, not_for=("windows that it was not trained on",), then=then)
    # A plan has nothing to be scored by.
    judged = {name: held for name, held in judged.items() if np.isfinite(held.coverage).any()} or judged
    windows = {name: run.windows[name] for name in judged}
    cases = [case for name, held in judged.items() for case in _cases(name, windows[name], held)]
    details = tuple(_details(windows, cases))
    text = (
        f"Share of the telemetry inside the {run.interval}, and in brackets where the share of a right "
        f"prediction lies: in all channels and windows together with {HELD:.0%} probability. Samples that follow each "
        "other share their errors. Where these are larger than any of a right prediction, it does not hold either."
    )
    if not cases:
        over = listed([f"“{name}”" for name in windows])
        return Finding("none", f"No sample of {over} is scored", text, details, ("unseen windows",))
    failed = [case for case in cases if case.room < 0.0]
    few = [case for case in cases if case.is_few]
    if failed:
        return _fails(run, judged, cases, failed, few, text, details)
    if few:
        case = min(few, key=lambda case: (case.share, case.window))
        window = windows[case.window]
        title = (
            f"Only {percent(case.share)} of {case.channel} in “{case.window}” is inside: too short to tell whether by "
            f"chance{_outside(window)}"
        )
        then = _then(case.window, window, "Add longer windows to test on: windows: {test: {start: ..., end: ...}}")
        return Finding("warn", title, text, details, tuple(map(temperatures_of, _channels(few))), then)
    return _holds(windows, cases, f"{text}{_told(list(judged.values()))}", details)


def _cases(name: str, window: xr.Dataset, held: Holding) -> Iterator[_Case]:
    """The channels of a window that are scored."""
    for k, channel in enumerate(map(str, window["channel"].values)):
        share, lower, upper = held.coverage[k], held.lower[k], held.upper[k]
        if not np.isfinite(share):
            continue
        words, how = f"{channel} {percent(share)} ({percent(lower)} to {percent(upper)})", ""
        if held.room[k] < 0.0:
            how = f"{percent(share)} inside"
            if held.lasting[k] > held.most_lasting[k]:
                when, kelvins = _farthest(window, channel)
                how += f", {kelvins} at {when} and {held.lasting[k]:.0f} deviations for five minutes or more"
            elif held.error[k] > held.most_error[k]:
                how += f" and {held.error[k]:.1f} deviations off"
            words += f", does not hold: {held.why(k)}; on average {_on_average(window, channel)}"
        elif share < STRIKING:
            words += ", which may be by chance"
        elif share > upper:
            words += ", wider than need be"
        yield _Case(name, channel, share, lower, held.room[k], how, words)


def _details(windows: Mapping[str, xr.Dataset], cases: Sequence[_Case]) -> Iterator[str]:
    """Every channel of each window, and what of it was not trained on."""
    for name, window in windows.items():
        if words := [case.words for case in cases if case.window == name]:
            yield f"“{name}”: {listed(words)}."
        if outside := unseen(window):
            yield f"“{name}”: {outside}"


def _channels(cases: Sequence[_Case]) -> list[str]:
    """Each once."""
    return list(dict.fromkeys(case.channel for case in cases))


def _holds(windows: Mapping[str, xr.Dataset], cases: Sequence[_Case], text: str, details: tuple[str, ...]) -> Finding:
    """All intervals hold."""
    over = listed([f"“{name}”" for name in windows])
    lowest = min(cases, key=lambda case: (case.share, case.least))
    title = f"Intervals hold on {over}, in every channel: {percent(lowest.share)} inside or more"
    if lowest.share < _FEW:
        by_chance = f"where chance may leave {percent(lowest.least)}"
        title += f", {by_chance if lowest.least > 1.0 - STRIKING else 'which so short a window may leave by chance'}"
    farthest = max(windows, key=lambda name: unseen_share(windows[name]))
    return Finding("good", title + _outside(windows[farthest], f"“{farthest}”"), text, details)


def _fails(
    run: RunFiles,
    judged: Mapping[str, Holding],
    cases: Sequence[_Case],
    failed: Sequence[_Case],
    few: Sequence[_Case],
    text: str,
    details: tuple[str, ...],
) -> Finding:
    """Some intervals do not hold."""
    worst = min(failed, key=lambda case: case.room)
    window, of_all, fail = run.windows[worst.window], len(_channels(cases)), _channels(failed)
    how = f"{worst.channel} in “{worst.window}”, {worst.how}"
    title = f"Intervals do not hold in {len(fail)} of {of_all} channels, worst {how}"
    if of_all == 1:
        title = f"Intervals do not hold: {how}"
    title += _outside(window)
    doubtful = [case for case in few if case.channel not in fail]
    others = _channels(doubtful)
    if doubtful:
        case = min(doubtful, key=lambda case: (case.share, case.window))
        more = f" and {len(others) - 1} more" if len(others) > 1 else ""
        title += f"; {case.channel}{more} may not either (only {percent(case.share)} in “{case.window}”)"
    state: State = "bad" if 2 * (len(fail) + len(others)) >= of_all else "warn"
    there = window["channel"].values[judged[worst.window].room < 0.0].tolist()
    there = sorted(there, key=lambda channel: channel != worst.channel)
    then = _beside_throughout(worst.window, window, there, _days_after(run, window)) or _for_a_while(window, there)
    then = _then(worst.window, window, then or CHECK)
    if state == "bad" and unseen_share(window) > _OUTSIDE:
        then = CHECK
    return Finding(state, title, text, details, tuple(map(temperatures_of, [*fail, *others])), then)


def width(run: RunFiles) -> list[Finding]:
    """Channels of which a prediction says less than that they read what they read in training."""
    found = wide_intervals(run)
    if not found:
        return []
    worst, *others = found
    of_all = len(held_channels(run))
    title = f"Intervals of {worst.channel} are {number(worst.width, 2)} K wide and say nothing"
    if others:
        title = (
            f"Intervals of {len(found)} of {of_all} channels say nothing, worst {worst.channel}, "
            f"{number(worst.width, 2)} K wide"
        )
    text = (
        f"In “{worst.window}” they are {number(worst.width, 2)} K wide; in training {worst.channel} varies by "
        f"{number(worst.varies, 2)} K. That it will read again what it read there is a better prediction (CRPS). So "
        "wide an interval holds whatever the model is. Heat that nobody knows does that: of a heater whose status is "
        "not measured and whose thresholds are off, of a mode, of a load."
    )
    details = tuple(
        f"{interval.channel}: {number(interval.width, 2)} K wide in “{interval.window}”, "
        f"{number(interval.varies, 2)} K in training."
        for interval in found
    )
    state: State = "bad" if 2 * len(found) >= of_all else "warn"
    not_for = tuple(temperatures_of(interval.channel) for interval in found)
    return [Finding(state, title, text, details, not_for, CHECK)]


def _told(judged: Sequence[Holding]) -> str:
    """What is told where errors may last as long as the window: not by coverage."""
    lower, error, lasting = (
        np.concatenate([getattr(held, name) for held in judged]) for name in ("lower", "most_error", "most_lasting")
    )
    short = lower < 1.0 - STRIKING
    if not short.any():
        return ""
    words = f"{error[short].max():.1f} deviations on average"
    if np.isfinite(lasting[short]).any():
        words += f" or {np.nanmax(lasting[short]):.1f} for five minutes or more"
    return (
        f" In {short.sum()} of {np.isfinite(lower).sum()} cases errors may last as long as the window, and leave "
        f"hardly any of it inside by chance. There an error of more than {words} is told, and coverage below "
        f"{percent(STRIKING, 0)}. A backtest tells more."
    )


def _farthest(window: xr.Dataset, channel: str) -> tuple[str, str]:
    """When a channel is farthest off for its interval, UTC, and by how much, in words."""
    off = _off(window, channel)
    k = int(np.nanargmax(np.abs(off) / _width(window, channel)))
    return f"{_minute(window, k)} UTC", _beside(off[k])


def _width(window: xr.Dataset, channel: str) -> NDArray[np.float64]:
    """[T] K, of a channel's interval."""
    dataset = window.sel(channel=channel, by="stochastic")
    return np.asarray((dataset["upper"] - dataset["lower"]).values, float)


def _minute(window: xr.Dataset, k: int) -> str:
    """When a sample of a window is, UTC."""
    return minute(window["time"].values[k])


def _on_average(window: xr.Dataset, channel: str) -> str:
    return _beside(float(np.nanmean(_off(window, channel))))


def _beside_throughout(name: str, window: xr.Dataset, channels: Sequence[str], days: float) -> str:
    """What to do next where some of the channels that do not hold, the worst first, are off all the time; else "".

    days: between training and the window.
    """
    off = {channel: _off(window, channel) for channel in channels}
    constant = [
        channel for channel, error in off.items() if abs(np.nanmean(error)) > _CONSTANT * np.sqrt(np.nanmean(error**2))
    ]
    if not constant:
        return ""
    first, *others = constant
    likewise = f", and {shortened(others)} likewise" if others else ""
    what = f"{first} is {_on_average(window, first)} from beginning to end{likewise}."
    if days > AGES:
        what += f" It is {days:.0f} days after training: train on both, with 'trend' at what ages."
    return f"Find what differs in “{name}”: {what}"


def _days_after(run: RunFiles, window: xr.Dataset) -> float:
    """Days from the end of training to a window."""
    trained = [dataset["time"].values[-1] for name, dataset in run.windows.items() if name not in run.test_windows]
    last = max(trained, default=window["time"].values[0])
    return float((window["time"].values[0] - last) / np.timedelta64(1, "D"))


def _for_a_while(window: xr.Dataset, channels: Sequence[str]) -> str:
    """What to do next where one of the channels that do not hold, the worst first, is off in one stretch; else ""."""
    for channel in channels:
        off = _off(window, channel)
        scored = np.flatnonzero(np.isfinite(off))
        outside = (np.abs(off) > _FAR * 0.5 * _width(window, channel))[scored]
        if not outside.any():
            continue
        begin, end = scored[np.flatnonzero(outside)[[0, -1]]]
        inside = outside[(scored >= begin) & (scored <= end)]
        if inside.mean() > _MOSTLY and len(inside) < _MOSTLY * len(scored):
            how = _beside(float(np.nanmean(off[begin : end + 1])))
            return (
                f"Find what was flown otherwise from {_minute(window, begin)} to {_minute(window, end)} UTC, as a mode "
                f"or attitude that the scenario has not there: {channel} is {how}."
            )
    return ""


def _off(window: xr.Dataset, channel: str) -> NDArray[np.float64]:
    """[T] K, telemetry less prediction; NaN where it is not scored."""
    dataset = window.sel(channel=channel)
    mean = dataset["mean"].sel({"by": "stochastic"}).values
    return np.where(dataset["scored"].values, dataset["observed"].values - mean, np.nan)


def _beside(off: float) -> str:
    return f"{number(abs(off), 2)} K {'above' if off > 0.0 else 'below'} the prediction"


def _outside(window: xr.Dataset, where: str = "the window") -> str:
    """To be added to what a title says of a window, where much of it is outside of what training contained."""
    share = unseen_share(window)
    return f"; {percent(share, 0)} of {where} is outside of what training contained" if share > _OUTSIDE else ""


def _then(name: str, window: xr.Dataset, otherwise: str) -> str:
    """What to do next where intervals do not hold on a window: train on its like, where training contained none."""
    if not unseen_share(window) > _OUTSIDE:
        return otherwise
    example = "windows: {train: {first: {start: ..., end: ...}, second: {start: ..., end: ...}}}"
    return f"Train on telemetry like that of “{name}” too: {example}"


def held_channels(run: RunFiles) -> list[str]:
    """Channels that are scored on some window that was not trained on."""
    found = [
        str(channel)
        for window in run.test_windows.values()
        if "coverage" in window
        for channel, share in zip(window["channel"].values, window["coverage"].values, strict=True)
        if np.isfinite(share)
    ]
    return list(dict.fromkeys(found))


def heaters(run: RunFiles) -> list[Finding]:
    """Whether telemetry's duty cycles on unseen windows lie within what is predicted."""
    findings = []
    measured = [duty for duty in duties(run) if np.isfinite(duty.measured)]
    for name in dict.fromkeys(duty.window for duty in measured):
        found = [duty for duty in measured if duty.window == name]
        outside = [duty for duty in found if duty.where == "outside"]
        contents = run.windows[name].attrs.get("duty_cycle_contains")
        details = tuple(
            f"{duty.heater}: telemetry {percent(duty.measured)}, predicted {percent(duty.mean)} "
            f"[{percent(duty.lower)}, {percent(duty.upper)}]{_OF_DUTY[duty.where]}."
            for duty in found
        )
        title = f"All {len(found)} duty cycles in “{name}” lie within what is predicted"
        if len(found) == 1:
            title = f"The duty cycle of {found[0].heater} in “{name}” lies within what is predicted"
        if any(duty.where == "beside" for duty in found):
            title = f"No duty cycle in “{name}” is further from what is predicted than chance allows"
        if outside:
            duty, *others = outside
            title = (
                f"{duty.heater} is on for {percent(duty.measured)} of “{name}”, predicted {percent(duty.lower)} to "
                f"{percent(duty.upper)}{f'; {len(others)} more outside' if others else ''}"
            )
        findings.append(
            Finding(
                "warn" if outside else "good",
                title,
                "Share of the time on, telemetry against the mean and central 95% of what is predicted"
                f"{f', which contains {contents}' if contents else ''}. "
                f"All together leave a right prediction's bands with {1.0 - CLOSED:.0%} probability:",
                details,
                tuple(duty_of(duty.heater) for duty in outside),
                CHECK if outside else "",
            )
        )
    return findings
