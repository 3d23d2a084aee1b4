"""Which simple wrong explains the telemetry best, where a thermal network is looked into.

Every wrong is tried: how probable is the telemetry with it, and how probable with nothing wrong but parameters,
unmodelled heat and noise? A first look takes the network as linear; the likeliest are looked at closely.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, islice

import numpy as np
from numpy.typing import NDArray

from ..progress import Progress
from ..report import UNEXPLAINED
from ..simulator import FloatArray, SimulationFailure, in_parallel
from .evidence import Fit, Gaussian, climbed, gaussian
from .network_view import WIDENED, Memory, Point, View
from .suspicion import CLEAR
from .wrongs import Wrong, all_wrongs
from .wrongs.heat import now_and_then
from .wrongs.pointing import otherwise_pointed
from .wrongs.timeline import otherwise_in_mode

_PROMISING = 2.0
"""Nats of a first look from which a wrong is looked at closely."""
_AT_ONCE = 64
"""Wrongs of which the windows to simulate are held at once."""
_FINALISTS = 12
_OF_A_KIND, _OF_A_SUBJECT = 3, 2
"""So many of a kind, and about one subject, are looked at closely, and beside them as many whose size is then found:"""
_BY_SIZE = frozenset({"number", "link", "heater", "driver", "attitude", "orbit", "constant heat"})
"""of these kinds, and one about each subject."""
_OTHER_KINDS = 0.4
"""Share of the nats of the likeliest, from which the best of every other kind is looked at closely."""
_LARGEST = 2
"""So many more are looked at closely that explain most whatever their odds: a first look sees a part of the nats."""
_ROUNDS, _SUBJECTS = 6, 2
"""Closer looks at one wrong, each at what it may be about that is likeliest."""
_EQUAL = 1e-9
"""Nats by which what is gained by two wrongs differs at most that are the same to the simulator."""
_BLURRED = 0.7
"""K, error of a model that is linear about one point, when all wrongs are looked at first."""
_FIRST_SIZES = (1.0, 3.0)
OF_THERMOSTATS = frozenset({
    "bias", "unit", "swapped", "other node", "doubled", "unrelated", UNEXPLAINED, "status inverted", "statuses swapped",
    "same status", "status clock", "thresholds", "thresholds exchanged", "thermostat", "stuck", "filled", "clock",
    "channel clock",
})  # fmt: skip
"""Kinds of wrongs that explain why a status does not do what thresholds say."""
_PART = 0.25
"""Of a number's factor, in what it does, from which it is looked at closely for how large it is."""
_READ = 1.0
"""K, root mean square: what a sensor reads otherwise by less, a model may lack and be right."""


@dataclass(frozen=True)
class _Look:
    """All wrongs are first looked at from here."""

    around: Gaussian
    back: FloatArray
    """[R] K from the point to the centre of the prior, in the linear approximation."""
    left: FloatArray
    """[R] K, of the telemetry with nothing wrong."""
    nothing: float
    """Evidence with nothing wrong."""


def compared(
    view: View, base: Point, nothing: Fit, odd: Collection[str], progress: Progress
) -> list[tuple[Fit, Wrong, float]]:
    """What is far better than nothing wrong, each once and with its nats, the best first.

    odd: heaters that do not what their thresholds say, and what their sensors read: there something is wrong.
    """
    known = np.isfinite(view.as_read)
    looks = [_look(view, point, known) for point in (base, view.point(view.window, nothing.z, base))]
    looks = [replace(look, around=look.around.in_modes()) for look in looks]
    chosen = finalists(*_promising(view, looks, odd, progress), odd)

    def named(k: int) -> tuple[Fit, Wrong, float] | None:
        try:
            best, fit = _closely(view, chosen[k], base)
            matters = _matters(view, best, fit) and _is_nearer(view, best, fit, nothing)
        except (SimulationFailure, np.linalg.LinAlgError):
            return None
        finally:
            _release(chosen[k])
        nats = float(fit.evidence - nothing.evidence - best.odds)
        certain = best.about in odd and best.kind in OF_THERMOSTATS
        if not matters or nats <= (_PROMISING if certain else CLEAR):
            return None
        return fit, best, nats

    found = [fit for fit in in_parallel(named, len(chosen)) if fit is not None]
    once: dict[tuple[str, str], tuple[Fit, Wrong, float]] = {}
    for item in sorted(found, key=lambda item: -item[2]):
        once.setdefault((item[1].kind, item[1].about), item)
    return list(once.values())


def _promising(
    view: View, looks: Sequence[_Look], odd: Collection[str], progress: Progress
) -> tuple[list[float], list[Wrong]]:
    """Nats of a first look of the wrongs that may be looked at closely, and these.

    The others are let go: a thousand windows to simulate would take gigabytes.
    """

    def gained(some: Sequence[Wrong], k: int) -> float:
        try:
            return max(_gain_or_none(view, some[k], look) for look in looks)
        finally:
            _release(some[k])

    gains: list[float] = []
    kept: list[Wrong] = []
    tried = 0
    wrongs = chain(all_wrongs(view), _by_what_is_left(view, looks[1]))
    while some := list(islice(wrongs, _AT_ONCE)):
        for gain, wrong in zip(in_parallel(partial(gained, some), len(some)), some, strict=True):
            if gain > _PROMISING or (wrong.kind in OF_THERMOSTATS and wrong.about in odd):
                gains.append(gain)
                kept.append(wrong)
        tried += len(some)
        progress.at(tried, f"{tried} tried, {len(kept)} to look at closely")
    return gains, kept


def _release(wrong: Wrong) -> None:
    """Give back what a wrong's window keeps for more simulations: thousands are simulated once or twice each."""
    if wrong.window is not None and wrong.window.is_network:
        wrong.window.network.release()


def _matters(view: View, wrong: Wrong, fit: Fit) -> bool:
    """Whether a wrong is large enough to be worth a word."""
    if wrong.memory is None or not wrong.matters(fit):
        return wrong.matters(fit)
    simulated = view.simulated(view.window, fit.z)
    otherwise = _reading(view, wrong).read(simulated) - view.read(simulated)
    return float(np.sqrt(np.sum(otherwise**2) / len(view.rows.kept))) > _READ


def _is_nearer(view: View, wrong: Wrong, fit: Fit, nothing: Fit) -> bool:
    """Whether another unit is worth a word, if it is one."""
    if not wrong.is_smaller:
        return True
    kept = view.rows.kept
    left = wrong.read(view.observed) - view.simulated(view.window, fit.z)[kept]
    before = view.observed - view.simulated(view.window, nothing.z)[kept]
    return wrong.leaves_less(left, before, view.observed)


def _by_what_is_left(view: View, look: _Look) -> Iterator[Wrong]:
    """What comes and goes where nothing wrong leaves something of the telemetry: heat, another attitude or mode."""
    point = look.around.point

    def weights(effects: FloatArray) -> FloatArray:
        return look.around.fit(look.left, effects).added

    def nats(effects: FloatArray) -> tuple[FloatArray, FloatArray]:
        return look.around.gained(look.left, effects)

    with suppress(SimulationFailure):
        yield from now_and_then(view, point.z, weights)
    with suppress(SimulationFailure):
        yield from otherwise_pointed(view, point.z, nats)
    with suppress(SimulationFailure):
        yield from otherwise_in_mode(view, point.z, nats)


def finalists(gains: Sequence[float], wrongs: Sequence[Wrong], odd: Collection[str] = ()) -> list[Wrong]:
    """Wrongs whose first look is promising, the likeliest first, odds counted, and few of a kind.

    Then the best of kinds that none of these is of, those that explain most, odds or not, the likeliest clock, of an
    orbit that may be wrong each number, and of each kind that explains why a status does not do what thresholds say,
    the likeliest about one of `odd`.
    """
    found: list[Wrong] = []
    likely = _unlike(sorted(zip(gains, wrongs, strict=True), key=lambda item: item[1].odds - item[0]))
    enough = _OTHER_KINDS * (likely[0][0] - likely[0][1].odds) if likely else 0.0
    for gain, wrong in likely:
        alike = [candidate for candidate in found if candidate.kind == wrong.kind]
        like_it = [candidate for candidate in alike if _sized(candidate) == _sized(wrong)]
        looked_at = sum(candidate.about == wrong.about for candidate in like_it) >= (
            1 if _sized(wrong) else _OF_A_SUBJECT
        )
        wanted = len(like_it) < _OF_A_KIND if len(found) < _FINALISTS else not alike and gain - wrong.odds > enough
        if gain > _PROMISING and wanted and not looked_at:
            found.append(wrong)
    by_gain = sorted(likely, key=lambda item: -item[0])
    largest = [wrong for gain, wrong in by_gain[:_LARGEST] if gain > _PROMISING]
    clocks = [wrong for gain, wrong in likely if gain > _PROMISING and wrong.kind == "clock"]
    # An eclipse that is minutes off looks like a number of the orbit that is another.
    of_orbit: dict[str, Wrong] = {}
    explaining: dict[str, Wrong] = {}
    for gain, wrong in likely:
        if wrong.kind == "orbit" and gain - wrong.odds > enough:
            of_orbit.setdefault(wrong.about, wrong)
        if wrong.kind in OF_THERMOSTATS and wrong.about in odd:
            explaining.setdefault(wrong.kind, wrong)
    for wrong in (*largest, *clocks[:1], *of_orbit.values(), *explaining.values()):
        if not any(wrong is other for other in found):
            found.append(wrong)
    return found


def _unlike(likely: Sequence[tuple[float, Wrong]]) -> list[tuple[float, Wrong]]:
    """Wrongs, the likeliest first, each with its gain, but those that are the same as one before.

    What moves all changes of modes out of the window makes one telemetry, by however many hours.
    """
    found: list[tuple[float, Wrong]] = []
    for gain, wrong in likely:
        if not (found and _same(found[-1], (gain, wrong))):
            found.append((gain, wrong))
    return found


def _same(one: tuple[float, Wrong], other: tuple[float, Wrong]) -> bool:
    (a, first), (b, second) = one, other
    return abs(a - b) < _EQUAL and (first.kind, first.about) == (second.kind, second.about)


def _sized(wrong: Wrong) -> bool:
    """Whether a closer look finds how large its number is."""
    return wrong.kind in _BY_SIZE and wrong.closer is not None


def _look(view: View, point: Point, known: NDArray[np.bool_]) -> _Look:
    around = gaussian(view.rows, point, known, _FIRST_SIZES, _BLURRED)
    back = point.effects @ ((view.middle - point.z) / view.spread)
    left = view.as_read - point.temperatures - back
    return _Look(around, back, left, around.evidence(left))


def _gain_or_none(view: View, wrong: Wrong, look: _Look) -> float:
    """What a first look says; minus infinity where that cannot be simulated."""
    try:
        return _gain(view, wrong, look)
    except SimulationFailure:
        return -np.inf


def _gain(view: View, wrong: Wrong, look: _Look) -> float:
    """Nats by which a wrong is better than nothing, at first look. Raises SimulationFailure."""
    observed, point = wrong.read(view.observed), look.around.point
    # Most wrongs leave the telemetry as it is.
    shift = (view.middle if observed is view.observed else view.centre(observed)) - view.middle
    if wrong.memory is not None:
        temperatures = _reading(view, wrong).read(point.simulated)
    elif wrong.moved:
        moved = replace(view, moved=wrong.moved).centre(observed) - view.middle
        temperatures = view.temperatures(wrong.window or view.window, point.z + moved)
    elif wrong.window is None:
        temperatures = point.temperatures + point.effects @ (shift / view.spread)
    else:
        temperatures = view.temperatures(wrong.window, point.z + shift)
    residual = view.flat(observed) - temperatures - look.back
    columns = wrong.columns
    if wrong.widened is not None:
        columns = point.effects[:, [wrong.widened]] * np.sqrt(WIDENED**2 - 1.0)
    gained = look.around.evidence(residual, columns, wrong.scale) - look.nothing
    if wrong.kind == "number" and _sized(wrong):
        gained = max(gained, _gain_of_part(residual, look))
    # What moves the channel is read otherwise too, of which the look at all channels knows nothing.
    return gained if wrong.memory is None else max(gained, _gain_alone(view, wrong.memory, columns, look))


def _gain_of_part(residual: FloatArray, look: _Look) -> float:
    """Nats by which a part of a wrong is better than nothing: what is off by a third is not off by half.

    residual: [R] K, with all of it.
    """
    effect = np.where(np.isfinite(look.left), look.left - residual, 0.0)
    if not np.isfinite(effect).all():
        return -np.inf
    fit = look.around.fit(look.left, effect[:, None])
    return fit.evidence - look.nothing if fit.added[0] > _PART else -np.inf


def _gain_alone(view: View, memory: Memory, columns: FloatArray | None, look: _Look) -> float:
    """Nats by which one channel is more probable if it reads as the memory says, whatever the others read."""
    t, place = len(view.rows.kept), memory.channel
    fit_rows, point, observed = slice(place * t, (place + 1) * t), look.around.point, view.observed[:, place]
    rows, simulated = replace(view.rows, noise=view.rows.noise[[place]]), point.simulated[:, place]

    def evidence(read: FloatArray, at_rows: FloatArray, more: FloatArray | None = None) -> float:
        """read: [t] K; at_rows: [t, t] of what moves it at the rows; more: [t, k] further columns."""
        effects, heat, jitter = (at_rows @ moving[fit_rows] for moving in (point.effects, point.heat, point.jitter))
        alone = replace(point, effects=effects, heat=heat, jitter=jitter)
        around = gaussian(rows, alone, np.isfinite(observed), _FIRST_SIZES, _BLURRED)
        return around.evidence(observed - read - at_rows @ look.back[fit_rows], more)

    nearest = np.abs(view.seconds[:, None] - view.rows.seconds).argmin(axis=1)
    otherwise = evidence(
        memory.weights @ simulated, memory.weights @ np.eye(t)[nearest], None if columns is None else columns[fit_rows]
    )
    return otherwise - evidence(simulated[view.rows.kept], np.eye(t))


def _closely(view: View, wrong: Wrong, base: Point) -> tuple[Wrong, Fit]:
    """A wrong where parameters have their say too, and with the best of numbers near by. Raises SimulationFailure."""
    if wrong.widened is not None:
        return wrong, _with_wider_prior(view, wrong.widened, base)
    fit = _climbed(view, wrong, base)
    for _ in range(_ROUNDS):
        if wrong.closer is None:
            break
        point = _reading(view, wrong).point(wrong.window or view.window, fit.z, base)
        look = _look(view, point, np.isfinite(view.as_read))
        near = [
            (gain - closer.odds, closer)
            for closer in wrong.closer()
            if (gain := _gain_or_none(view, closer, look)) > -np.inf
        ]
        likely: dict[str, Wrong] = {}
        for _, near_wrong in sorted(near, key=lambda item: -item[0]):
            likely.setdefault(near_wrong.about, near_wrong)
        tried = [(_climbed(view, subject, base), subject) for subject in list(likely.values())[:_SUBJECTS]]
        again, best = max(tried, key=lambda item: item[0].evidence - item[1].odds, default=(fit, wrong))
        if again.evidence - best.odds <= fit.evidence - wrong.odds:
            break
        wrong, fit = best, again
    return wrong, fit


def _climbed(view: View, wrong: Wrong, base: Point) -> Fit:
    """The fit where a wrong is put right. Raises SimulationFailure."""
    window, seen = wrong.window or view.window, _reading(view, wrong)
    return climbed(seen, window, wrong.read(view.observed), base, wrong.columns, wrong.scale)


def _reading(view: View, wrong: Wrong) -> View:
    """The view with channels that read as they do, and priors that are of what they should be."""
    as_it_is = wrong.memory is None and not wrong.moved
    return view if as_it_is else replace(view, memory=wrong.memory, moved=wrong.moved)


def _with_wider_prior(view: View, entry: int, base: Point) -> Fit:
    """The fit where a prior is wider, and how far the entry is then off. Raises SimulationFailure."""
    wider = replace(view, widened=entry)
    fit = climbed(wider, view.window, view.observed, wider.point(view.window, base.z, base))
    off = (fit.z - view.middle)[entry] / view.spread[entry]
    return replace(fit, added=np.array([off]))
