"""Which simple wrong explains best what telemetry and prior disagree about: before any sampling, in seconds.

Every wrong of `wrongs` is tried: how probable is the telemetry with it, and how probable with nothing wrong but
parameters, unmodelled heat and noise? One is named only where it is better by far. What a channel shows by itself
(`broken`) comes first, and is left out of the rest.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import astuple, dataclass, replace
from typing import Any, Final

import numpy as np
import xarray
from numpy.typing import NDArray

from ..errors import FlightcalError, TelemetryError
from ..problem import Problem, Window
from ..report import UNEXPLAINED
from ..run import Run, Stage, plain, read_json, typed
from ..simulator import FloatArray, SimulationFailure, in_parallel
from ..telemetry import select_window
from .black_box import Ensemble, compared, ensemble_of, no_temperatures, told_by_status
from .broken import Broken, broken
from .evaluate import PriorRuns
from .evidence import Fit, Gaussian, climbed, gaussian
from .jumps import Jump, in_words, jumps
from .misfit import Misfit, misfit
from .prepared import prepared
from .thermostat import copied, disobeyed, exchanged
from .view import WIDENED, Memory, Point, View, known_thermostats
from .wrongs import Wrong, all_wrongs
from .wrongs.heat import now_and_then

SUSPECTS_FILE = "suspects.json"
NOT_COMPARED = "wrong clocks, units, biases, swapped channels, status, heaters, modes, drivers and orbit"
"""What only a comparison with the simulator tells,"""
INSIDE = "wrong heaters, modes, drivers, faces, attitude and orbit"
"""and what only a simulator that is looked into."""
_RUN_ONLY = "the simulator is no thermal network, or a reduced one: it is run, and not looked into"
_CLEAR = 10.0
"""Nats by which a wrong has to be better than nothing wrong, odds counted, to be named."""
_PROMISING = 2.0
"""Nats of a first look from which a wrong is looked at closely."""
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
_BAD, _WORSE = 2.0, 4.0
"""Mean squares of deviations from which a scenario is beside its telemetry altogether: where simple wrongs help, and
where none does."""
_LEFT = 0.2
"""Share of what a right model has in more than nothing wrong, that one wrong may lack and still be what is named."""
_FAR = 5.0
"""Deviations of its prior, beyond which no parameter and no unmodelled heat is where a wrong is put right: of a hundred
of them, one is there about as seldom as `_CLEAR` says."""
_LEFT_BY_RUNS, _FAR_BY_RUNS = 0.5, 8.0
"""The same two beside a simulator that is only run: where a wrong is put right, how it begins is linear there."""
_HELPS = 30.0
"""Nats from which what does not explain the telemetry there is worth a word."""
_SHOWN, _NEAR = 3, 0.2
"""So many are named at most, and only if the best is not better by `_CLEAR` and by so much of what it explains."""
_FIRST_SIZES = (1.0, 3.0)
_OF_THERMOSTATS = frozenset({
    "bias", "unit", "swapped", "other node", "unrelated", UNEXPLAINED, "status inverted", "statuses swapped",
    "same status", "status clock", "thresholds", "thresholds exchanged", "thermostat", "stuck", "filled", "clock",
    "channel clock",
})  # fmt: skip
"""Kinds of wrongs that explain why a status does not do what thresholds say,"""
_OF_READINGS = frozenset({"gain", "drift", "curve", "slow"})
"""and why one that changes does not."""
_NEARER = 0.7
"""Share of its misfit that a channel has left, as it was read, which another unit is worth a word of."""
_READ = 1.0
"""K, root mean square: what a sensor reads otherwise by less, a model may lack and be right."""


@dataclass(frozen=True)
class Suspicion:
    """A simple wrong that explains the telemetry far better than the scenario as it is."""

    kind: str
    about: str
    """A channel, a heater, a node, ..."""
    title: str
    sentence: str
    advice: str
    """What to do, in a line."""
    nats: float | None = None
    """How much more probable the telemetry is with it, log; None: the telemetry shows it by itself."""


@dataclass(frozen=True)
class Suspects:
    """What was found, the likeliest first."""

    found: tuple[Suspicion, ...] = ()
    looked: bool = False
    """Whether the telemetry was compared with the simulator, beside what it shows by itself."""
    why_not: str = ""
    """Why it was not, where it was not, or why not in all."""
    misfit: Misfit | None = None
    """Where the model is farthest off, if it is beyond what is usual and nothing says why."""

    @property
    def lines(self) -> tuple[str, ...]:
        """What was found, as lines, and what was not looked for."""
        alike = sum(own.nats is not None for own in self.found)

        def mark(own: Suspicion) -> str:
            one_of = f", one of {alike}" if alike > 1 and own.nats is not None else ""
            return "" if own.kind == UNEXPLAINED else f"likely wrong{one_of}: "

        found = tuple(f"{mark(own)}{own.title}. {own.sentence} Next: {own.advice}." for own in self.found)
        return (*found, f"not looked for: {self.left_out}; {self.why_not}") if self.why_not else found

    @property
    def left_out(self) -> str:
        """What nobody looked for."""
        return INSIDE if self.looked else NOT_COMPARED


def suspects(problem: Problem, telemetry: xarray.Dataset, prior_runs: PriorRuns | None = None) -> Suspects:
    """What is likely to be wrong with a scenario or its telemetry, by its first training window.

    What a channel shows by itself is looked for in every window. telemetry: what the problem was built from.
    prior_runs: of a simulator that is no thermal network; None: it is simulated here.
    """
    window, why_not = problem.windows[0], _RUN_ONLY
    modelled, ensemble = np.full(window.observed.shape, np.nan), None
    try:
        view = prepared(problem.scenario, telemetry)
        if view is not None:
            simulated = view.simulated(view.window, view.middle)
            modelled[: len(simulated)] = simulated
        else:
            ensemble = _ensemble(problem, telemetry, prior_runs or PriorRuns(problem))
            modelled = ensemble.simulated.mean(axis=0)
    except (FlightcalError, SimulationFailure) as error:
        view, why_not = None, str(error)
    seen = _seen(window.simulator.channels, window.times, window.observed, modelled)
    of_channels = [*seen, *_elsewhere(problem, telemetry)]
    found = [Suspicion(own.kind, own.channel, own.title, own.sentence, own.advice) for own in of_channels]
    found += [Suspicion("same status", pair, *astuple(words)) for pair, words in copied(window)]
    found += [Suspicion("thresholds exchanged", pair, *astuple(words)) for pair, words in exchanged(window)]
    jumped = in_words(_jumps(window, modelled, {own.channel for own in seen}))
    found = [*(Suspicion(kind, about, *astuple(words)) for kind, about, words in jumped), *found]
    if any(kind == "order" for kind, _, _ in jumped):
        why_not = "telemetry that is not in order is not compared with the simulator"
        view = None
        ensemble = None
    if ensemble is not None:
        return _beside_runs(replace(ensemble, telemetry=_known(telemetry, window.times, seen)), found)
    if view is None:
        return Suspects(tuple(found), False, why_not)
    view = replace(view, telemetry=_known(view.telemetry, window.times, seen))
    if not np.isfinite(view.observed).any():
        return Suspects(tuple(found), True)
    try:
        base = view.point(view.window, view.middle)
        nothing = climbed(view, view.window, view.observed, base)
    except SimulationFailure as failure:
        return Suspects(tuple(found), False, str(failure))
    odd = list(disobeyed(view.window))
    helps = _compared(view, base, nothing, _concerned(view, [name for name, _, _ in odd]))
    likely, where = ranked(helps, nothing), None
    if not likely and not nothing.is_usual:
        where = misfit(view, nothing.z)
        likely = unexplained(nothing, where, helps)
    kinds = {own.kind for own in (*found, *likely)}
    for name, words, constant in odd:
        if not kinds & (_OF_THERMOSTATS if constant else _OF_THERMOSTATS | _OF_READINGS):
            found.append(Suspicion("thermostat", name, *astuple(words)))
    return Suspects((*found, *likely), True, "", where)


def _seen(
    channels: Sequence[str], times: NDArray[np.datetime64], observed: FloatArray, modelled: FloatArray
) -> list[Broken]:
    """What channels show by themselves; observed, modelled: [T, C] K."""
    looks = (broken(name, times, observed[:, k], modelled[:, k]) for k, name in enumerate(channels))
    return [own for own in looks if own is not None]


def _elsewhere(problem: Problem, telemetry: xarray.Dataset) -> Iterator[Broken]:
    """What channels show by themselves in all windows but the first to train on."""
    scenario, first = problem.scenario, problem.windows[0]
    for name, own in scenario.windows.items():
        if name == first.name:
            continue
        try:
            samples = select_window(telemetry, own, first.period, name)
        except TelemetryError:  # it is told where the window is used
            continue
        channels = first.simulator.channels
        values = np.stack([samples[channel].to_numpy() for channel in channels], axis=1)
        yield from _seen(channels, samples["time"].to_numpy(), values, np.full(values.shape, np.nan))


def _jumps(window: Window, modelled: FloatArray, known: Collection[str]) -> list[Jump]:
    """Of channels of which nothing is known yet."""
    chosen = [k for k, channel in enumerate(window.simulator.channels) if channel not in known]
    names = [window.simulator.channels[k] for k in chosen]
    return jumps(names, window.times, window.observed[:, chosen], modelled[:, chosen])


def _known(data: xarray.Dataset, times: NDArray[np.datetime64], seen: list[Broken]) -> xarray.Dataset:
    """Telemetry without the samples that are known to be of no use."""
    for own in seen:
        useless = np.isin(data["time"].to_numpy(), times[own.useless])
        data = data.assign({own.channel: ("time", np.where(useless, np.nan, data[own.channel].to_numpy()))})
    return data


def _ensemble(problem: Problem, telemetry: xarray.Dataset, prior_runs: PriorRuns) -> Ensemble:
    """Simulations of a simulator that is run and not looked into. Raises SimulationFailure where too few finish."""
    ensemble = ensemble_of(problem, telemetry, prior_runs.thetas, prior_runs.runs)
    if ensemble is None:
        raise SimulationFailure("too few simulations at draws of the prior finish")
    return ensemble


def _beside_runs(ensemble: Ensemble, found: list[Suspicion]) -> Suspects:
    """What was found, and what explains the telemetry of a simulator that is run and not looked into."""
    strange = [Suspicion("unit", channel, *astuple(words)) for channel, words in no_temperatures(ensemble)]
    if strange or not np.isfinite(ensemble.observed).any():
        return Suspects((*strange, *found), False, "temperatures that no satellite has are not compared")
    told = told_by_status(ensemble, _CLEAR)
    found = [*found, *(Suspicion(kind, about, *astuple(words)) for kind, about, words in told)]
    nothing, better = compared(ensemble, _CLEAR)
    helps = [(fit, _suspicion(wrong, fit, nats)) for fit, wrong, nats in better]
    named = ranked(helps, nothing, _LEFT_BY_RUNS, _FAR_BY_RUNS, _BAD)
    if not named and not nothing.is_usual:
        named = unexplained(nothing, None, helps, run_only=True)
    if not named and helps and (helps[0][1].nats or 0.0) > _HELPS:
        sentence = f"What helps most explains a part of it: {helps[0][1].title}."
        advice = "Check that first; then what the simulator has otherwise"
        named = [_nothing_simple(sentence, advice)]
    return Suspects((*found, *named), True, _RUN_ONLY)


def _suspicion(wrong: Wrong, fit: Fit, nats: float) -> Suspicion:
    words = wrong.words(fit) if callable(wrong.words) else wrong.words
    return Suspicion(wrong.kind, wrong.about, words.title, words.sentence, words.advice, nats)


@dataclass(frozen=True)
class _Look:
    """All wrongs are first looked at from here."""

    around: Gaussian
    back: FloatArray
    """[R] K from the point to the centre of the prior, in the linear approximation."""
    nothing: float
    """Evidence with nothing wrong."""


def _concerned(view: View, heaters: Collection[str]) -> set[str]:
    """Heaters and the channels of their sensors."""
    known = {name: channel for name, _, channel in known_thermostats(view.window)}
    return {*heaters, *(known[name] for name in heaters)}


def _compared(view: View, base: Point, nothing: Fit, odd: Collection[str]) -> list[tuple[Fit, Suspicion]]:
    """What is far better than nothing wrong, the best first and each once.

    odd: heaters that do not what their thresholds say, and what their sensors read: there something is wrong.
    """
    known = np.isfinite(view.as_read)
    looks = [_look(view, point, known) for point in (base, view.point(view.window, nothing.z, base))]
    looks = [replace(look, around=look.around.in_modes()) for look in looks]
    wrongs = [*all_wrongs(view), *_now_and_then(view, looks[1])]

    def gained(k: int) -> float:
        try:
            return max(_gain(view, wrongs[k], look) for look in looks)
        except SimulationFailure:
            return -np.inf
        finally:
            _release(wrongs[k])

    chosen = finalists(in_parallel(gained, len(wrongs)), wrongs, odd)

    def named(k: int) -> tuple[Fit, Suspicion] | None:
        try:
            best, fit = _closely(view, chosen[k], base)
            matters = _matters(view, best, fit) and _is_nearer(view, best, fit, nothing)
        except (SimulationFailure, np.linalg.LinAlgError):
            return None
        finally:
            _release(chosen[k])
        nats = float(fit.evidence - nothing.evidence - best.odds)
        certain = best.about in odd and best.kind in _OF_THERMOSTATS
        if not matters or nats <= (_PROMISING if certain else _CLEAR):
            return None
        return fit, _suspicion(best, fit, nats)

    found = [own for own in in_parallel(named, len(chosen)) if own is not None]
    once: list[tuple[Fit, Suspicion]] = []
    for item in sorted(found, key=lambda item: -(item[1].nats or 0.0)):
        if (item[1].kind, item[1].about) not in [(own.kind, own.about) for _, own in once]:
            once.append(item)
    return once


def _release(wrong: Wrong) -> None:
    """Give back what a wrong's window keeps for more simulations: thousands are simulated once or twice each."""
    if wrong.window is not None and wrong.window.network is not None:
        wrong.window.network.release()


def _matters(view: View, wrong: Wrong, fit: Fit) -> bool:
    """Whether a wrong is large enough to be worth a word."""
    if wrong.memory is None or not wrong.matters(fit):
        return wrong.matters(fit)
    simulated = view.simulated(view.window, fit.z)
    otherwise = _reading(view, wrong).read(simulated) - view.read(simulated)
    return float(np.sqrt(np.sum(otherwise**2) / len(view.rows.kept))) > _READ


def _is_nearer(view: View, wrong: Wrong, fit: Fit, nothing: Fit) -> bool:
    """Whether channels that are read in a smaller unit leave less of what they read: else they are only smaller."""
    if wrong.scale.factor >= 1.0 or wrong.observed is None:
        return True
    kept = view.rows.kept
    read = wrong.read(view.observed)
    left = read - view.simulated(view.window, fit.z)[kept]
    before = view.observed - view.simulated(view.window, nothing.z)[kept]
    changed = np.any(np.abs(read - view.observed) > 0.0, axis=0)
    squares = np.nanmean(left[:, changed] ** 2) / wrong.scale.factor**2
    return bool(squares < _NEARER**2 * np.nanmean(before[:, changed] ** 2))


def _now_and_then(view: View, look: _Look) -> list[Wrong]:
    """Heat that comes and goes where nothing wrong leaves something of the telemetry."""
    point = look.around.point
    left = view.as_read - point.temperatures - look.back
    try:
        return list(now_and_then(view, point.z, lambda effects: look.around.fit(left, effects).added))
    except SimulationFailure:
        return []


def finalists(gains: Sequence[float], wrongs: Sequence[Wrong], odd: Collection[str] = ()) -> list[Wrong]:
    """Wrongs whose first look is promising, the likeliest first, odds counted, and few of a kind.

    Then the best of kinds that none of these is of, those that explain most, odds or not, and of each kind that
    explains why a status does not do what thresholds say, the likeliest about one of `odd`.
    """
    found: list[Wrong] = []
    likely = _unlike(sorted(zip(gains, wrongs, strict=True), key=lambda item: item[1].odds - item[0]))
    enough = _OTHER_KINDS * (likely[0][0] - likely[0][1].odds) if likely else 0.0
    for gain, wrong in likely:
        alike = [own for own in found if own.kind == wrong.kind]
        like_it = [own for own in alike if _sized(own) == _sized(wrong)]
        looked_at = sum(own.about == wrong.about for own in like_it) >= (1 if _sized(wrong) else _OF_A_SUBJECT)
        wanted = len(like_it) < _OF_A_KIND if len(found) < _FINALISTS else not alike and gain - wrong.odds > enough
        if gain > _PROMISING and wanted and not looked_at:
            found.append(wrong)
    by_gain = sorted(likely, key=lambda item: -item[0])
    largest = [wrong for gain, wrong in by_gain[:_LARGEST] if gain > _PROMISING]
    explaining: dict[str, Wrong] = {}
    for _, wrong in likely:
        if wrong.kind in _OF_THERMOSTATS and wrong.about in odd:
            explaining.setdefault(wrong.kind, wrong)
    for wrong in (*largest, *explaining.values()):
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


def ranked(
    best: list[tuple[Fit, Suspicion]], nothing: Fit, left: float = _LEFT, far: float = _FAR, bad: float = np.inf
) -> list[Suspicion]:
    """What explains the telemetry, of what helps: it leaves what is usual or hardly anything, and nothing far off."""
    explains = [
        own for own in best if own[0].is_usual or (own[0].lacking < left * nothing.lacking and own[0].misfit < bad)
    ]
    named = [own for fit, own in explains if fit.farthest < far]
    most = max((own.nats or 0.0 for own in named), default=0.0)
    return [own for own in named[:_SHOWN] if most - (own.nats or 0.0) < max(_CLEAR, _NEAR * most)]


def unexplained(
    nothing: Fit, where: Misfit | None, helps: list[tuple[Fit, Suspicion]], *, run_only: bool = False
) -> list[Suspicion]:
    """That no simple wrong brings the model to the telemetry, where it is far off; else it may be only too simple."""
    if nothing.misfit <= (_BAD if helps else _WORSE):
        return []
    lacked = "what a simulator may lack" if run_only else "unmodelled heat of some percent"
    sentence = (
        f"Neither parameters nor {lacked} nor any one simple wrong do: its deviations are "
        f"{np.sqrt(nothing.misfit):.1f} times what is usual."
    )
    if not run_only:
        sentence = f"{sentence[:-1]}, beside heat of {0.05 * nothing.size:.0%} of what flows."
    if where:
        sentence += f" {where.words}"
    if helps:
        sentence += f" A part of it, at most: {helps[0][1].title}."
    advice = "Check that both are of the same satellite and time; then what the model leaves out there"
    return [_nothing_simple(sentence, advice)]


def _nothing_simple(sentence: str, advice: str) -> Suspicion:
    return Suspicion(UNEXPLAINED, "", "No simple wrong explains the telemetry", sentence, advice, 0.0)


def _look(view: View, point: Point, known: NDArray[np.bool_]) -> _Look:
    around = gaussian(view.rows, point, known, _FIRST_SIZES, _BLURRED)
    back = point.effects @ ((view.middle - point.z) / view.spread)
    level = around.evidence(view.as_read - point.temperatures - back)
    return _Look(around, back, level)


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
    # What moves the channel is read otherwise too, of which the look at all channels knows nothing.
    return gained if wrong.memory is None else max(gained, _gain_alone(view, wrong.memory, columns, look))


def _gain_alone(view: View, memory: Memory, columns: FloatArray | None, look: _Look) -> float:
    """Nats by which one channel is more probable if it reads as the memory says, whatever the others read."""
    t, place = len(view.rows.kept), memory.channel
    own, point, observed = slice(place * t, (place + 1) * t), look.around.point, view.observed[:, place]
    rows, simulated = replace(view.rows, noise=view.rows.noise[[place]]), point.simulated[:, place]

    def evidence(read: FloatArray, at_rows: FloatArray, more: FloatArray | None = None) -> float:
        """read: [t] K; at_rows: [t, t] of what moves it at the rows; more: [t, k] further columns."""
        effects, heat, jitter = (at_rows @ moving[own] for moving in (point.effects, point.heat, point.jitter))
        alone = replace(point, effects=effects, heat=heat, jitter=jitter)
        around = gaussian(rows, alone, np.isfinite(observed), _FIRST_SIZES, _BLURRED)
        return around.evidence(observed - read - at_rows @ look.back[own], more)

    nearest = np.abs(view.seconds[:, None] - view.rows.seconds).argmin(axis=1)
    otherwise = evidence(
        memory.weights @ simulated, memory.weights @ np.eye(t)[nearest], None if columns is None else columns[own]
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
        likely: dict[str, Wrong] = {}
        for own in sorted(wrong.closer(), key=lambda own: own.odds - _gain(view, own, look)):
            likely.setdefault(own.about, own)
        tried = [(_climbed(view, own, base), own) for own in list(likely.values())[:_SUBJECTS]]
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


def _make(run: Run, problem: Problem, telemetry: xarray.Dataset, prior_runs: PriorRuns | None = None) -> None:
    run.folder.write_json(SUSPECTS_FILE, plain(suspects(problem, telemetry, prior_runs)))


def _kept(run: Run, *_: Any) -> Suspects:
    content = read_json(run.folder.file(SUSPECTS_FILE))
    return typed(Suspects, content)


SUSPECTS: Final = Stage("suspects", "looking for what may be wrong", (SUSPECTS_FILE,), _make, _kept)
"""Of a problem, its telemetry and simulations at draws of its prior."""
