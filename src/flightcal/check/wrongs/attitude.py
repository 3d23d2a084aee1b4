"""What the scenario writes of the attitude."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from datetime import datetime, timedelta
from functools import partial
from itertools import combinations, product
from typing import Any

import numpy as np
from scipy.signal import lombscargle
from scipy.spatial.transform import Rotation

from ...scenario import (
    AlignedAttitude,
    AttitudeTimeline,
    InertialAttitude,
    Pointing,
    SampledAttitude,
    Scenario,
    SpinningAttitude,
    Target,
)
from ...simulator import FloatArray
from ...words import number
from ..network_view import View
from . import normals
from .wrong import Words, Wrong, attitude_of, closer, driven_otherwise, elsewhere, minutes, off, span_of

_ORDERS = ((0, 1, 2, 3), (3, 0, 1, 2), (1, 2, 3, 0))
"""Where the real part and the other three stand in a quaternion as written: in their order; the real part last; first
in a file where it was taken to be last."""
_LATE = tuple(sign * 60.0 * m for m in (5, 10, 15, 20, 30, 40, 50, 60, 90, 120, 300, 1440) for sign in (-1.0, 1.0))
"""s, by which a timeline of attitudes may be late or early: minutes, hours of another zone, a day."""
_CHANGE_LATE = tuple(sign * 60.0 * m for m in (5, 10, 20, 40) for sign in (-1.0, 1.0))
"""s, by which one change of attitude may be."""
_SLEWS = (0.1, 0.25, 0.5, 2.0, 4.0, 10.0)
"""Factors by which the time of a slew is off."""
_SPIN_RATES = (1.0 / 60.0, 1.0 / 6.0, 0.5, 2.0, 6.0, 60.0)
"""Factors by which the period of a spin is off: a unit, rpm for deg/s, or about half."""
_SWUNG = np.deg2rad((-120.0, -90.0, -60.0, -30.0, 30.0, 60.0, 90.0, 120.0, 180.0))
"""rad, by which the direction of a spin is turned about an inertial axis."""
_PHASES, _TURNS = 30.0, 24
"""deg, by which a body that spins at another rate may be turned; ways in which it may."""
_OF_ORBIT, _OTHERWISE, _FINELY, _CLEARLY = 4.0, 4.0, 8, 30.0
"""Turns in an orbit from which a rhythm is no orbit's; times the rate that is written, up to which one is looked for;
rates that are looked at to one turn in the window; times the usual power that a spin has."""
_FEWEST, _WORK = 50, 2e7
"""Samples that have a rhythm; samples times rates: of more, the beginning tells it."""
_NAMED, _SELDOM = 2.0, 150.0
"""Attitudes that have a name, and others, each of which is ten times as seldom."""
_OTHER_WAY = {"turned": 2.0, "tilted": 1.0}
"""How an attitude is the other way, and how rare that is: half a turn about the first axis does the same as a tilt to
the other side to what is alike fore and aft."""
_Axis = tuple[float, float, float]


def attitudes(view: View) -> Iterator[Wrong]:
    """Another attitude than the scenario's."""
    written = attitude_of(view)
    if written is None:
        return
    flipped = [other for other, *_ in _mirrored(written)] if isinstance(written, AlignedAttitude) else []
    for attitude, text in _OTHERS.items():
        if attitude == written or attitude in flipped:
            continue
        as_written = _as_written(attitude)
        words = Words(
            f"The satellite flew {text}",
            f"With the attitude {as_written}, sunlight and Earth's heat explain the telemetry.",
            f"Write 'attitude: {as_written}' in 'environment', or check the quaternions",
        )
        # What points two axes by their names is seldom another attitude altogether.
        is_usual = isinstance(attitude, str) and not isinstance(written, AlignedAttitude)
        about, tries = as_written if isinstance(attitude, str) else text, _NAMED if is_usual else _SELDOM
        scenario = elsewhere(view, attitude=attitude)
        yield from driven_otherwise("attitude", about, words, view, tries=tries, scenario=scenario)


def _aligned(axis: _Axis, towards: Target, other: _Axis, second: Target) -> AlignedAttitude:
    return AlignedAttitude(
        aligned=Pointing(axis=axis, towards=towards), constrained=Pointing(axis=other, towards=second)
    )


def _as_written(attitude: str | AlignedAttitude) -> str:
    """In a line of YAML."""
    if isinstance(attitude, str):
        return attitude

    def one(pointing: Pointing) -> str:
        return f"{{axis: {normals.written(pointing.axis)}, towards: {pointing.towards}}}"

    return f"{{aligned: {one(attitude.aligned)}, constrained: {one(attitude.constrained)}}}"


_SIDES = {normals.named(way): way for way in normals.WAYS}
_OTHERS: dict[str | AlignedAttitude, str] = {
    "nadir": "nadir",
    "sun_pointing": "sun-pointing",
    **{
        _aligned(_SIDES["+z"], "nadir", side, "sun"): f"with +z to the Earth and turned about it with {name} to the Sun"
        for name, side in _SIDES.items()
        if name[1] != "z"
    },
    **{
        _aligned(side, "sun", _SIDES["+x" if name[1] == "y" else "+y"], "ecliptic_north"): f"with {name} to the Sun"
        for name, side in _SIDES.items()
        if name != "+z"
    },
}
"""Attitudes that satellites have, in words: yaw steering, and each side to the Sun."""


def mirrored(view: View) -> Iterator[Wrong]:
    """An attitude of two axes is turned, or tilted, the other way: an axis has the wrong sign."""
    written = attitude_of(view)
    found: dict[str, Any] = {"": written}
    if isinstance(written, AttitudeTimeline):
        found = dict(written.named)
    aligned = {name: kind for name, kind in found.items() if isinstance(kind, AlignedAttitude)}
    for name, attitude in aligned.items():
        subject = f"'{name}'" if name else "The satellite"
        where = f"'{name}'" if name else "'environment: attitude'"
        for other, how, pointing in _mirrored(attitude):
            words = Words(
                f"{subject} is {how} the other way",
                f"With the axis {normals.written(pointing.axis)} towards {pointing.towards}, sunlight and Earth's heat "
                "explain the telemetry.",
                f"Check the sign of 'axis' towards {pointing.towards} in {where}",
            )
            changed: dict[str, Any] = {"attitude": other}
            if isinstance(written, AttitudeTimeline):
                changed = {"attitude": written.model_copy(update={"named": {**written.named, name: other}})}
            yield from driven_otherwise(
                "attitude", f"{name} {how}".strip(), words, view, tries=len(aligned) * _OTHER_WAY[how],
                scenario=elsewhere(view, **changed),
            )  # fmt: skip


def _mirrored(attitude: AlignedAttitude) -> Iterator[tuple[AlignedAttitude, str, Pointing]]:
    """An attitude with one of its axes the other way, how that turns it, and that axis."""
    second = _flipped(attitude.constrained, range(3))
    yield attitude.model_copy(update={"constrained": second}), "turned", second
    largest = int(np.argmax(np.abs(attitude.aligned.axis)))
    others = [k for k in range(3) if k != largest]
    if any(attitude.aligned.axis[k] for k in others):
        first = _flipped(attitude.aligned, others)
        yield attitude.model_copy(update={"aligned": first}), "tilted", first


def _flipped(pointing: Pointing, places: Collection[int]) -> Pointing:
    """With some of the numbers of its axis the other way."""
    axis = tuple(-value if k in places and value else value for k, value in enumerate(pointing.axis))
    return pointing.model_copy(update={"axis": axis})


def quaternions(view: View) -> Iterator[Wrong]:
    """Quaternions are the other way round, or their real part stands elsewhere."""
    written = attitude_of(view)
    if written is None:
        return
    others = [order for order in product(_ORDERS, (False, True)) if order != (_ORDERS[0], False)]
    for order, inverse in others:
        attitude = _each(written, partial(_read_otherwise, order=order, inverse=inverse))
        if attitude == written:
            return
        how = [f"the real part in {'wxyz'[order[0]]} as it is written"] if order[0] else []
        how += ["quaternions that turn inertial vectors into the body's"] if inverse else []
        words = Words(
            "The quaternions are of another convention",
            f"With {', and '.join(how)}, sunlight and Earth's heat explain the telemetry.",
            "Check 'environment: attitude': 'columns' of a file says where the real part is, 'turns' what they turn",
        )
        scenario = elsewhere(view, attitude=attitude)
        yield from driven_otherwise("attitude", "quaternions", words, view, tries=len(others), scenario=scenario)


def _each(attitude: Any, change: Callable[[Any], Any]) -> Any:
    """An attitude with each that it is made of changed."""
    if not isinstance(attitude, AttitudeTimeline):
        return change(attitude)
    named = {name: change(kind) for name, kind in attitude.named.items()}
    timeline = tuple(entry.model_copy(update={"attitude": change(entry.attitude)}) for entry in attitude.timeline)
    return attitude.model_copy(update={"named": named, "timeline": timeline})


def _read_otherwise(attitude: Any, order: Sequence[int], inverse: bool) -> Any:
    """The components of quaternions in another order, and perhaps the turn back; anything else as it is."""
    if isinstance(attitude, SampledAttitude):
        back = {"body_to_inertial": "inertial_to_body", "inertial_to_body": "body_to_inertial"}
        update: dict[str, Any] = {"columns": tuple(attitude.columns[k] for k in order)}
        update |= {"turns": back[attitude.turns]} if inverse else {}
        return attitude.model_copy(update=update)
    if isinstance(attitude, InertialAttitude):
        w, *rest = (attitude.inertial[k] for k in order)
        return attitude.model_copy(update={"inertial": (w, *(-angle if inverse else angle for angle in rest))})
    return attitude


def spins(view: View) -> Iterator[Wrong]:
    """A spinner's axis points another way, or it turns at another rate; another axis of the body is a tilt."""
    attitude = attitude_of(view)
    if not isinstance(attitude, SpinningAttitude):
        return
    direction = np.array(attitude.direction)
    ways = [Rotation.from_rotvec(angle * axis).apply(direction) for axis, angle in product(np.eye(3), _SWUNG)]
    others: list[tuple[str, Any, str]] = []
    for way in (-direction, *ways):
        others.append(("direction", tuple(way.tolist()), "[" + ", ".join(f"{number:.2f}" for number in way) + "]"))
    if attitude.period is not None:
        others.append(("period", None, "null (the mean over a turn)"))
        for factor in _SPIN_RATES:
            others.append(("period", attitude.period * factor, f"{number(attitude.period * factor, 3)} s"))
    for name, value, text in others:
        scenario = elsewhere(view, attitude=attitude.model_copy(update={name: value}))
        words = Words(
            "The satellite spins otherwise",
            f"With {name} {text}, sunlight and Earth's heat explain the telemetry.",
            f"Check '{name}' in 'environment: attitude'",
        )
        yield from driven_otherwise("attitude", name, words, view, tries=len(others), scenario=scenario)
    if attitude.period is None:
        return
    yield from _turned(view, attitude, np.arange(0.0, 360.0, _PHASES))
    period = _rhythm(view, attitude.period)
    if period is not None:
        yield from _turning(view, attitude, period, np.arange(0.0, 360.0, _PHASES))


def _turned(view: View, attitude: SpinningAttitude, phases: FloatArray, around: float = _PHASES) -> Iterator[Wrong]:
    """A spinner is turned by so many deg at its epoch."""
    for phase in phases.tolist():
        words = Words(
            f"The phase of the spin is {phase % 360.0:.0f} deg, not {np.degrees(attitude.phase) % 360.0:.0f} deg",
            f"With a phase of {phase % 360.0:.0f} deg, sunlight and Earth's heat explain the telemetry.",
            f"Write 'phase: {phase % 360.0:.0f} deg' in 'environment: attitude', or check 'epoch' and 'period'",
        )

        def near(phase: float = phase) -> Iterator[Wrong]:
            yield from _turned(view, attitude, phase + around * np.linspace(-0.5, 0.5, 5), 0.25 * around)

        changed = attitude.model_copy(update={"phase": float(np.radians(phase))})
        scenario = elsewhere(view, attitude=changed)
        yield from driven_otherwise("attitude", "phase", words, view, tries=_TURNS, closer=near, scenario=scenario)


def _turning(
    view: View, attitude: SpinningAttitude, period: float, phases: FloatArray, around: float = _PHASES
) -> Iterator[Wrong]:
    """A spinner with another period, s, and by so many deg turned where the window begins."""
    begun = view.window.start.astype("datetime64[us]").item()
    whole = float(view.network.drive.times[-1])
    for phase in phases.tolist():
        changed = {"period": period, "phase": float(np.radians(phase)), "epoch": begun}
        words = Words(
            f"The satellite turns once in {number(period, 4)} s",
            f"With a period of {number(period, 4)} s, sunlight and Earth's heat explain the telemetry.",
            f"Write 'period: {number(period, 6)} s', 'phase: {phase % 360.0:.0f} deg' and 'epoch: {begun.isoformat()}' "
            "in 'environment: attitude'",
        )

        def near(phase: float = phase) -> Iterator[Wrong]:
            # By so much the period changes where the end of the window is turned by as much as its beginning.
            change = period**2 * around / 360.0 / whole
            for other in (period - 0.5 * change, period, period + 0.5 * change):
                yield from _turning(view, attitude, other, phase + around * np.array([-0.5, 0.0, 0.5]), 0.5 * around)

        scenario = elsewhere(view, attitude=attitude.model_copy(update=changed))
        yield from driven_otherwise("attitude", "period", words, view, tries=_TURNS, closer=near, scenario=scenario)


def _rhythm(view: View, written: float) -> float | None:
    """s, after which temperatures of a spinner come again, where that is clear and not the period that is written.

    By Lomb's and Scargle's periodogram, of what is too fast to come from the orbit.
    """
    window, count = view.window, len(view.window.times)
    while count > _FEWEST:
        seconds = (window.times[:count] - window.start) / np.timedelta64(1, "ns") * 1e-9
        long = seconds[-1] - seconds[0]
        fastest = min(_OTHERWISE / written, 0.5 / float(np.median(np.diff(seconds))))
        slowest = max(1.0 / (_OTHERWISE * written), _OF_ORBIT / window.period)
        rates = np.arange(slowest, fastest, 1.0 / (_FINELY * long))
        if count * len(rates) <= _WORK:
            break
        count //= 2
    if count <= _FEWEST or len(rates) < _FINELY * _OF_ORBIT:
        return None
    power = np.zeros(len(rates))
    for observed in window.observed[:count].T:
        known = np.isfinite(observed)
        if known.sum() > _FEWEST and np.ptp(observed[known]) > 0.0:
            found = lombscargle(seconds[known], observed[known], 2.0 * np.pi * rates, floating_mean=True)
            power += found / np.var(observed[known]) / known.sum()
    best = int(np.argmax(power))
    if power[best] < _CLEARLY * np.median(power) or abs(rates[best] - 1.0 / written) < 0.5 / long:
        return None
    return float(1.0 / rates[best])


def timelines(view: View, seconds: Sequence[float] | FloatArray = _LATE, exchanges: bool = True) -> Iterator[Wrong]:
    """Attitudes that follow each other do so sooner or later than written, or two of them are each other's."""
    attitude = attitude_of(view)
    if not isinstance(attitude, AttitudeTimeline):
        return
    for late in map(float, seconds):
        changes = tuple(
            change.model_copy(update={"at": change.at + timedelta(seconds=late)}) for change in attitude.timeline
        )
        scenario = _with_timeline(view, attitude, changes)
        words = Words(
            f"The timeline of attitudes is {off(-late)}",
            f"With each change of attitude {minutes(late)} {'later' if late > 0 else 'earlier'}, sunlight and Earth's "
            "heat explain the telemetry.",
            "Check the times in 'environment: attitude', and their zone",
        )
        near = partial(timelines, view, closer(late, 420.0), False)
        yield from driven_otherwise(
            "attitude", "timeline", words, view, tries=len(_LATE), closer=near, scenario=scenario
        )
    pairs = list(combinations(dict.fromkeys(change.attitude for change in attitude.timeline), 2)) if exchanges else []
    for one, other in pairs:
        turned = {one: other, other: one}
        changes = tuple(
            change.model_copy(update={"attitude": turned.get(change.attitude, change.attitude)})
            for change in attitude.timeline
        )
        scenario = _with_timeline(view, attitude, changes)
        words = Words(
            f"Attitudes '{one}' and '{other}' are exchanged",
            f"With '{one}' where the timeline says '{other}', and '{other}' where it says '{one}', the model explains "
            "the telemetry.",
            f"Exchange '{one}' and '{other}' in 'environment: attitude'",
        )
        yield from driven_otherwise("attitude", f"{one} {other}", words, view, tries=len(pairs), scenario=scenario)


def slews(view: View, factors: Sequence[float] | FloatArray = _SLEWS) -> Iterator[Wrong]:
    """Changes of attitude take longer than written, or less long."""
    attitude = attitude_of(view)
    if not isinstance(attitude, AttitudeTimeline):
        return
    for factor in map(float, factors):
        slew = attitude.slew * factor
        words = Words(
            f"Slews take about {number(slew, 2)} s, not {number(attitude.slew, 3)} s",
            "With slews that long, sunlight and Earth's heat explain the telemetry.",
            "Check 'slew' in 'environment: attitude'",
        )
        scenario = elsewhere(view, attitude=attitude.model_copy(update={"slew": slew}))
        near = partial(slews, view, factor * np.geomspace(0.6, 1.7, 9))
        yield from driven_otherwise("attitude", "slew", words, view, tries=len(_SLEWS), closer=near, scenario=scenario)


def pointings(view: View) -> Iterator[Wrong]:
    """One attitude of those that follow each other is another one that has a name, or one change is late or early."""
    attitude = attitude_of(view)
    if not isinstance(attitude, AttitudeTimeline):
        return
    timeline, names = (
        attitude.timeline,
        dict.fromkeys([*attitude.named, *(change.attitude for change in attitude.timeline)]),
    )
    begin, end = span_of(view)
    inside = [
        k
        for k, change in enumerate(timeline)
        if change.at < end and (k + 1 == len(timeline) or timeline[k + 1].at > begin)
    ]
    tries = len(inside) * (len(names) - 1 + len(_CHANGE_LATE))
    for k, name in product(inside, names):
        change = timeline[k]
        if name == change.attitude:
            continue
        words = Words(
            f"The attitude from {change.at.isoformat(timespec='seconds')} on is '{name}', not '{change.attitude}'",
            f"With '{name}' until the next change, the model explains the telemetry.",
            "Check that change in 'environment: attitude' against what was flown",
        )
        scenario = _with_change(view, attitude, k, {"attitude": name})
        yield from driven_otherwise("attitude", f"from {k}", words, view, tries=tries, scenario=scenario)
    for k in inside:
        yield from _change_moved(view, attitude, k, tries, _CHANGE_LATE)


def _change_moved(
    view: View, attitude: AttitudeTimeline, k: int, tries: float, seconds: Sequence[float] | FloatArray
) -> Iterator[Wrong]:
    timeline, change = attitude.timeline, attitude.timeline[k]
    for late in map(float, seconds):
        at = change.at + timedelta(seconds=late)
        after = timeline[k + 1].at if k + 1 < len(timeline) else datetime.max
        if k == 0 or not timeline[k - 1].at < at < after:
            continue
        words = Words(
            f"The change of attitude to '{change.attitude}' at {change.at.isoformat(timespec='seconds')} is "
            f"{off(-late)}",
            f"{minutes(late)} {'later' if late > 0 else 'earlier'}, it explains the telemetry.",
            "Check that change in 'environment: attitude' against what was flown",
        )
        scenario = _with_change(view, attitude, k, {"at": at})
        near = partial(_change_moved, view, attitude, k, tries, closer(late, 0.3 * abs(late)))
        yield from driven_otherwise("attitude", f"change {k}", words, view, tries=tries, closer=near, scenario=scenario)


def _with_change(view: View, attitude: AttitudeTimeline, k: int, update: dict[str, Any]) -> Scenario:
    """The scenario of a view with another change of attitude."""
    timeline = attitude.timeline
    return _with_timeline(view, attitude, (*timeline[:k], timeline[k].model_copy(update=update), *timeline[k + 1 :]))


def _with_timeline(view: View, attitude: AttitudeTimeline, changes: tuple[Any, ...]) -> Scenario:
    """The scenario of a view with other changes of attitude."""
    return elsewhere(view, attitude=attitude.model_copy(update={"timeline": changes}))


WRONGS = (attitudes, mirrored, quaternions, timelines, slews, pointings, spins)
"""What looks for them."""
