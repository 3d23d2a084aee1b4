"""Finding unmodelled heat, and what heaters did whose status is not measured.

Both are found together: heat from what is left over a simulation in open loop, in which heaters do what is held; what
is held from the temperatures, of which the heat is a part. Where all heaters have a status nothing is held but over
gaps in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..errors import FlightcalError
from ..problem import Held, Problem, Window, heat_in_prior, held_by, hold, sampled_windows, shifts_of_weights, split
from ..progress import SILENT, Progress
from ..scenario import heat_of
from ..simulator import FloatArray, SimulationFailure
from ..telemetry import quiet_noise
from .heat_point import HeatPoint
from .heat_search import Point, Search
from .switches import HeaterTimes, exchanged, heater_times, with_shifts, with_states

_HOLDS = 10
"""Looks at what heaters do whose status is not measured."""
_GAINED = 0.5
"""Of the log density, for which it is worth to look again."""
_SETTLES = 8
"""Looks at what these do before sizes of noise and heat are looked for."""
_QUIETEST = 1e-3
"""K, of the noise then."""


def find_heat(problem: Problem, theta: FloatArray, *, progress: Progress = SILENT) -> HeatPoint:
    """Look at heat around theta [d] of a problem whose scenario has it. Raises FlightcalError where that fails.

    Where the status of heaters is not measured, what they do is held: first as thermostats do without heat, then as
    the telemetry is most probable.
    """
    windows = sampled_windows(problem)
    try:
        held = [held_by(window, problem.at(window, theta)) for window in windows]
        if not _are_silent(windows):
            return _looked(problem, windows, held, theta, progress).best
        held, theta = _settled(problem, windows, held, theta)
        look = _looked(problem, windows, held, theta, progress)
        numbers = iter(range(1, _HOLDS + 1))

        def better(change: Callable[[_Look], list[Held | None]]) -> bool:
            """Whether a change makes the telemetry more probable; it is made as often as it does."""
            nonlocal look
            is_better = False
            while (tried := change(look)) != look.held and (number := next(numbers, None)):
                which = f"heaters without a status, look {number}, "
                found = _looked(problem, windows, tried, theta, progress, which)
                if found.point.evidence <= look.point.evidence + _GAINED:
                    break
                look, is_better = found, True
            return is_better

        better(_exchanged)
        # Where times were coarse an exchange may have stayed away: once they are known all are looked at again.
        while better(_shifted) and better(partial(_exchanged, keeps=True)):
            pass
        return look.best
    except SimulationFailure as failure:
        raise FlightcalError(f"heat: {failure}, next to the point that fits the telemetry best") from None


def with_found_states(problem: Problem, theta: FloatArray) -> Problem | None:
    """A problem as it is sampled with heat, in which heaters without a status do what the telemetry shows.

    None where nothing is to be found: all have one, or their thermostats act. theta: [d], next to which it is looked
    for. Raises FlightcalError where simulations fail there.
    """
    windows = sampled_windows(problem)
    if heat_of(problem.scenario) is None or not _are_silent(windows):
        return None
    try:
        held, _ = _settled(problem, windows, [held_by(window, problem.at(window, theta)) for window in windows], theta)
    except SimulationFailure as failure:
        raise FlightcalError(f"heaters without a status: {failure}, next to the mode") from None
    return replace(problem, windows=_holding(windows, held), open_loop=None)


def _are_silent(windows: Sequence[Window]) -> bool:
    """Whether nobody knows what some heater did that is driven."""
    return any(window.switching is not None and window.unmeasured for window in windows)


def _holding(windows: Sequence[Window], held: Sequence[Held | None]) -> tuple[Window, ...]:
    """Windows whose heaters do what is held."""
    return tuple(
        window if of_own is None else hold(window, of_own) for window, of_own in zip(windows, held, strict=True)
    )


@dataclass(frozen=True)
class _Look:
    """What heaters do, and the heat that was found with that."""

    held: list[Held | None]
    search: Search
    point: HeatPoint

    @property
    def best(self) -> HeatPoint:
        """What is sampled around."""
        return self.search.tilted(self.point)


def _looked(
    problem: Problem,
    windows: Sequence[Window],
    held: list[Held | None],
    theta: FloatArray,
    progress: Progress,
    which: str = "",
) -> _Look:
    search = _search(problem, windows, held)
    return _Look(held, search, search.run(theta, progress, which))


def _settled(
    problem: Problem, windows: Sequence[Window], held: list[Held | None], theta: FloatArray
) -> tuple[list[Held | None], FloatArray]:
    """What heaters do, and theta [d], where noise is as small as neighbouring samples say.

    A thermostat that is simulated out of step leaves errors that sizes of noise and heat would be fitted to.
    """
    z, search = problem.to_z(theta), _search(problem, windows, held)
    for _ in range(_SETTLES):
        sizes = _quiet(search)
        point = search.linear(z, np.zeros(len(search.group)))
        tried = _better_held(search, held, point, sizes, search.much_told(point.each, sizes))
        is_settled = tried == held
        if not is_settled:
            held, search = tried, _search(problem, windows, tried)
            point = search.linear(z, np.zeros(len(search.group)))
        z, _, _ = search.step(point.each, z, point.weights, sizes)
        if is_settled:
            break
    return held, problem.to_theta(z)


def _search(problem: Problem, windows: Sequence[Window], held: Sequence[Held | None]) -> Search:
    """In windows whose heaters do what is held."""
    known = _holding(windows, held)
    model = heat_in_prior(problem, known)
    assert model is not None
    return Search(problem, known, replace(model, held=tuple(in_window for in_window in held if in_window is not None)))


def _quiet(search: Search) -> FloatArray:
    """Sizes [s]: of noise as small as neighbouring samples say, of heat as the prior has it."""
    sizes = search.sizes.median()
    observed = np.concatenate([window.observed for window in search.windows])
    for entry in search.entries:
        if entry.size in ("noise", "white"):
            least = quiet_noise(observed[:, entry.channel])
            sizes[search.noise.index(entry.name)] = max(least, search.floor[entry.channel], _QUIETEST)
    for k in range(len(search.noise), len(sizes)):
        sizes[k] = next(group.size for group in search.model.groups if group.scale == search.names[k])
    return sizes


def _better_held(
    search: Search,
    held: Sequence[Held | None],
    point: Point,
    sizes: FloatArray,
    bases: tuple[FloatArray, ...],
    *,
    keeps: bool = False,
) -> list[Held | None]:
    """What heaters do without a measured status, as makes the telemetry most probable next to a point.

    sizes: [s]; bases: the directions of heat that count; keeps: see `with_states`.
    """
    found: list[list[HeaterTimes]] = []
    for in_window, around in zip(held, point.each, strict=True):
        theta = search.problem.at(around.window, search.problem.to_theta(point.z))
        found.append([] if in_window is None else heater_times(around.window, in_window, theta, search.model))
    everything = [times for of_window in found for times in of_window]
    if not everything:
        return list(held)
    states = iter(exchanged(everything, *_by_power(search, point, found, sizes, bases)))
    better = list(held)
    for k, of_window in enumerate(found):
        for times in of_window:
            known = better[k]
            assert known is not None
            better[k] = with_states(known, times, next(states), keeps=keeps)
    return better


def _by_power(
    search: Search,
    point: Point,
    found: Sequence[Sequence[HeaterTimes]],
    sizes: FloatArray,
    bases: tuple[FloatArray, ...],
) -> tuple[FloatArray, FloatArray]:
    """Slope and curvature of the log density, for power added in the times of heaters; all else integrated out."""
    mean, deviation = search.prior_of_z(point.z)
    from_prior = np.concatenate([search.of_bases(point.weights, bases), point.z[search.moving] - mean])
    kept = [base.shape[1] for base in bases]
    # How uncertain a switch is that is there now is no matter of where it had better be.
    stays = np.repeat([*(group.part != "switches" for group in search.model.groups), True], [*kept, len(mean)])
    roots = np.concatenate([np.repeat(search.roots(sizes), kept), deviation])[stays]
    counts = [sum(heater_times.response.shape[2] for heater_times in of_window) for of_window in found]
    gram = np.zeros((len(roots) + sum(counts) + 1,) * 2)
    for k, (linearised, wide) in enumerate(zip(point.each, search.columns(point.each, bases), strict=True)):
        shape = wide.shape[:2]
        powers = np.zeros((*shape, sum(counts)))
        if counts[k]:
            powers[..., sum(counts[:k]) : sum(counts[: k + 1])] = np.concatenate(
                [of_heater.response for of_heater in found[k]], axis=2
            )
        left = np.where(linearised.window.valid, linearised.left + wide @ from_prior, 0.0)
        both = np.concatenate([wide[..., stays], powers, left[..., None]], axis=2)
        white = linearised.through(search.shapes(sizes))(both) / search.numbers(sizes)[:, :1, None]
        flat = white.reshape(-1, both.shape[2])
        gram += flat.T @ flat
    known, power = slice(0, len(roots)), slice(len(roots), -1)
    inner = gram[known, known] + np.diag(roots**-2.0)
    explained = np.linalg.solve(inner, gram[known, len(roots) :])
    rest = gram[power, len(roots) :] - gram[power, known] @ explained
    return rest[:, -1], rest[:, :-1]


def _exchanged(look: _Look, *, keeps: bool = False) -> list[Held | None]:
    """What heaters do where states are exchanged; keeps: see `with_states`."""
    search, point = look.search, look.point
    return _better_held(search, look.held, search.at(point), point.most_probable, point.around.bases, keeps=keeps)


def _shifted(look: _Look) -> list[Held | None]:
    """The same with switches of heaters without a status where the weights have them."""
    found, model = list(look.held), look.point.model
    weights = split(model, model.centre)
    for k, (window, held_window) in enumerate(zip(look.search.windows, look.held, strict=True)):
        if held_window is not None:
            # What is held stands behind what is measured.
            longer = shifts_of_weights(look.search.model, window, weights)
            longer = longer[len(longer) - len(held_window.switches) :]
            found[k] = with_shifts(held_window, longer, window.unmeasured, window.interval)
    return found
