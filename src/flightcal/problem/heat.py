"""A problem with unmodelled heat: its windows, linearised around a point, as calibration and prediction see them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..probability import DEVIATION, Gains, Shaped, Sizes, WindowHeat
from ..scenario import heat_of, thermostats_act
from ..simulator import FloatArray
from .entries import entries_of
from .heat_model import Followed, HeatModel, heat_model
from .heat_units import errors_of_weights, heat_of_weights, responses_in, split, unit_heats
from .held import hold
from .problem import Problem, Runs
from .window import Window

_CORRECTIONS, _STALLED = 30, 3
"""Steps at most; so many that bring all draws next to nothing end it."""
_LITTLE = 0.02
"""Of what is missed: next to nothing."""
_REMEMBERED = 5
"""Points of a search for a fixed point."""
_TURNED = 0.05
"""Of z, by which responses to heat are looked at again."""
_FAR = 8.0
"""Of z, at the end of what a prior allows."""


def rehearsals(problem: Problem) -> tuple[Problem, Problem]:
    """Problems like those that are sampled with heat, of known sizes and of others, to compile what these need."""
    return _rehearsal(problem, known=True), _rehearsal(problem, known=False)


def _rehearsal(problem: Problem, *, known: bool) -> Problem:
    windows = []
    for window in sampled_windows(problem):
        samples, channels = window.observed.shape
        shapes = tuple(Shaped(1.0, 1.0) for _ in range(channels))
        deviations = np.ones(channels) if known else None
        sizes = Sizes(np.ones(channels), np.ones(1)) if known else None
        scales = () if known else ("",)
        none = np.zeros((samples, channels))
        heat = WindowHeat(none[..., None], np.zeros(1, np.int64), scales, none, sizes)
        windows.append(replace(window.with_known_shape(shapes, {}, deviations), heat=heat))
    return Problem(problem.scenario, entries_of(problem.scenario, windows), tuple(windows))


def sampled_windows(problem: Problem) -> tuple[Window, ...]:
    """The windows that parameters and heat are learnt in: in open loop, where heaters have a measured status.

    What its switches say of thresholds is said after all else: see `calibration.thresholds`.
    """
    if problem.open_loop is None or thermostats_act(problem.scenario):
        return problem.windows
    opened = problem.open_loop.windows
    if all(window.measured_switches is None for window in opened):
        return opened
    return tuple(replace(window, measured_switches=None) for window in opened)


def as_sampled(problem: Problem) -> Problem:
    """The problem with these windows, where its scenario has unmodelled heat."""
    windows = problem.windows if heat_of(problem.scenario) is None else sampled_windows(problem)
    return problem if windows is problem.windows else replace(problem, windows=windows, open_loop=None)


def heat_in_prior(problem: Problem, windows: Sequence[Window] = ()) -> HeatModel | None:
    """Unmodelled heat as the priors have it, in windows (none: the problem's), where the scenario has it."""
    written, windows = heat_of(problem.scenario), windows or problem.windows
    if written is None:
        return None
    median = problem.at(windows[0], problem.priors.median())
    return heat_model(problem.scenario, written, windows, median)


def functions_of_heat(problem: Problem) -> int:
    """How many functions of time the heat of a problem's scenario is made of, in all nodes; 0: it has none."""
    windows = sampled_windows(problem)
    model = heat_in_prior(problem, windows)
    if model is None:
        return 0
    return max(sum(len(group_units.series) for group_units in unit_heats(model, window)) for window in windows)


def dressed(window: Window, model: HeatModel) -> Window:
    """A window that reads what a calibration with heat knows: noise of known shape, scales of heat."""
    return window.with_known_shape(model.shapes, model.priors)


def at_sizes(problem: Problem, theta: FloatArray) -> Problem:
    """A problem with heat in which the sizes of noise and heat are known: those of theta [d]."""
    windows = []
    for window in problem.windows:
        inside = problem.at(window, theta)
        assert window.heat is not None
        deviations = window.numbers(inside)[:, DEVIATION]
        heat = replace(window.heat, scales=(), sizes=Sizes(deviations, window.roots(inside)), follows=None)
        held = window.with_known_shape(window.residuals.terms.kinds, {}, deviations)
        reads = {name: prior for name, prior in held.reads.items() if not name.startswith("heat.")}
        windows.append(replace(held, reads=reads, heat=heat))
    return replace(problem, entries=entries_of(problem.scenario, windows), windows=tuple(windows), flown=())


def with_heat(problem: Problem, model: HeatModel, theta: FloatArray) -> Problem:
    """The problem around theta [d] of its own and the heat that the model has at its centre.

    Raises SimulationFailure.
    """
    held = {held_window.window: held_window for held_window in model.held}
    sampled = (
        hold(sampled_window, held[sampled_window.name]) if sampled_window.name in held else sampled_window
        for sampled_window in sampled_windows(problem)
    )
    windows = tuple(_linearised(window, model, problem.at(window, theta)) for window in sampled)
    flown = tuple(dressed(window, model) for window in problem.windows)
    return Problem(problem.scenario, entries_of(problem.scenario, windows), windows, None, model, flown)


def followed(problem: Problem, theta: FloatArray) -> dict[str, Followed]:
    """How the response to each weight of heat grows with the parameters, of a problem linearised at theta [d].

    What a parameter does is looked at by a small step of it: by the share of the response's own shape that it adds.
    Raises SimulationFailure.
    """
    z = problem.to_z(theta)
    positive = problem.to_theta(np.full(len(z), -_FAR)) > 0.0
    precision = np.split(problem.heat_sizes(theta[None])[0][0] ** -2.0, len(problem.windows))
    white = problem.weighed.white
    whole = sum(
        np.einsum("kti,kti,k->i", response, response, of) for response, of in zip(white, precision, strict=True)
    )
    found = {}
    for k in problem.simulated.tolist():
        if not problem.entries[k].is_of_network:
            continue
        there = z.copy()
        there[k] += _TURNED
        moved = problem.to_theta(there)
        along = sum(
            np.einsum("kti,kti,k->i", response, turned - response, of, optimize=True)
            for response, turned, of in zip(white, _whitened(problem, moved), precision, strict=True)
        )
        x, at = (np.log(values[k]) if positive[k] else values[k] for values in (moved, theta))
        slope = np.divide(along, whole * (x - at), out=np.zeros_like(whole), where=whole > 0.0)
        found[problem.names[k]] = Followed(bool(positive[k]), float(at), slope)
    return found


def _whitened(problem: Problem, theta: FloatArray) -> list[FloatArray]:
    """The response to each weight at theta [d], through noise of deviation one, [N, T, m] of each window."""
    model, found = problem.heat, []
    assert model is not None
    for window, whitens in zip(problem.windows, problem.weighed.filters, strict=True):
        here = responses_in(window, problem.at(window, theta), model, unit_heats(model, window), model.kept)
        found.append(whitens.whiten(np.moveaxis(here, 1, 0), window.terms.valid))
    return found


@dataclass(frozen=True)
class ExactHeat:
    """Weights of heat of S draws, with which simulations do what the linear response says."""

    weights: FloatArray
    """[S, m]"""
    temperatures: tuple[FloatArray, ...]
    """Of each window [S, T, N] K, simulated with them; with the simulator's error, where it has one."""
    linear: tuple[FloatArray, ...]
    """The same as the linear response has it."""


def exact_heat(
    problem: Problem, runs: Sequence[Runs], thetas: FloatArray, rng: np.random.Generator, *, within: float = 0.0
) -> ExactHeat:
    """Draws of weights given the telemetry, with which simulations at thetas [S, d] do what the linear response says.

    runs: the simulations at thetas, of the heat at the model's centre. How temperatures respond to heat depends on
    theta, and linearisation has one response for all: so each draw's weights are corrected, step by step, for what its
    own simulation misses. Draws whose simulation fails keep theirs, and have NaN. within: K, root mean square over all
    draws, that may be missed; as little as can be reached where it is zero.
    """
    model = problem.heat
    assert model is not None
    gains = Gains([window.terms for window in problem.windows], problem.weighed, *problem.heat_sizes(thetas))
    growth = problem.heat_growth(thetas)
    weights = gains.draw(problem.heat_left(runs, thetas), rng) / growth
    units = [unit_heats(model, window) for window in problem.windows]
    linear = []
    for window, of_window in zip(problem.windows, zip(*runs, strict=True), strict=True):
        assert window.heat is not None
        base = np.stack([run.temperatures for run in of_window])
        does = growth * (weights - model.centre)
        linear.append(base + np.einsum("tnm,sm->stn", window.heat.response, does, optimize=True))
    samples = sum(linearised[0].size for linearised in linear)
    best, kept, stalled = np.full(len(thetas), np.inf), weights.copy(), 0
    kept_runs = [np.full(linearised.shape, np.nan) for linearised in linear]
    points: list[FloatArray] = []
    steps: list[FloatArray] = []
    for _ in range(_CORRECTIONS + 1):
        simulated = []
        for window, of_window in zip(problem.windows, units, strict=True):
            functions = split(model, weights - model.centre)
            found = window.simulate_many(problem.at(window, thetas), heat_of_weights(model, of_window, functions))
            missing = np.full(window.observed.shape, np.nan)
            with_heat = np.stack([missing if run is None else run.temperatures for run in found])
            simulated.append(with_heat + errors_of_weights(of_window, functions))
        left = [wanted - found_runs for wanted, found_runs in zip(linear, simulated, strict=True)]
        missed = sum((residual**2).sum(axis=(1, 2)) for residual in left)
        better = missed < best
        # Of a draw that has not been simulated yet nobody knows how much it gains.
        known = np.isfinite(best)
        gained = best[known].sum() - np.fmin(best, missed)[known].sum()
        little = bool(known.any() and gained < _LITTLE * best[known].sum())
        stalled = stalled + 1 if little else 0
        best = np.where(better, missed, best)
        kept[better] = weights[better]
        for kept_run, new in zip(kept_runs, simulated, strict=True):
            kept_run[better] = new[better]
        reached = best[np.isfinite(best)]
        if stalled == _STALLED or (len(reached) and reached.mean() < samples * within**2):
            break
        points = [*points, weights][-_REMEMBERED:]
        steps = [*steps, gains([np.nan_to_num(residual) for residual in left]) / growth][-_REMEMBERED:]
        weights = mixed(np.stack(points, axis=1), np.stack(steps, axis=1))
    return ExactHeat(kept, tuple(kept_runs), tuple(linear))


def whole_weights(
    problem: Problem, thetas: FloatArray, kept: FloatArray, rng: np.random.Generator
) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
    """Weights [S, f] of all functions of each group from those [S, m] of the kept directions, and scales [S].

    What the telemetry does not tell is drawn from its prior, at thetas [S, d].
    """
    model, window = problem.heat, problem.windows[0]
    assert model is not None
    of_scales = np.stack([window.scales(theta) for theta in problem.at(window, thetas)])
    scales = tuple(of_scales[:, model.scales.index(group.scale)] for group in model.groups)
    weights = []
    for known, basis, scale in zip(split(model, kept), model.kept, scales, strict=True):
        new = rng.standard_normal(known.shape)
        weights.append(known + scale[:, None] * (new - new @ basis @ basis.T))
    return tuple(weights), scales


def mixed(points: FloatArray, steps: FloatArray) -> FloatArray:
    """Next points [S, m] from the last ones [S, k, m] and their steps: Anderson's mixing (1965, J. ACM 12, 547).

    That combination of the points is moved on whose steps cancel best, with coefficients that sum to one.
    """
    products = np.einsum("sim,sjm->sij", steps, steps)
    scale = np.trace(products, axis1=1, axis2=2)[:, None, None]
    regular = products + (1e-10 * scale + 1e-300) * np.eye(steps.shape[1])
    shares = np.linalg.solve(regular, np.ones((*steps.shape[:2], 1)))
    shares /= shares.sum(axis=1, keepdims=True)
    return np.asarray(((points + steps) * shares).sum(axis=1))


def _linearised(window: Window, model: HeatModel, theta: FloatArray) -> Window:
    """A window around theta [q] of its own."""
    units = unit_heats(model, window)
    heated = window.network.with_heat(heat_of_weights(model, units, split(model, model.centre)))
    around = replace(window, simulator=heated)
    response = responses_in(around, theta, model, units, model.kept)
    centre = response @ model.centre
    follows = model.follows_of(window.names)
    heat = WindowHeat(np.ascontiguousarray(response), model.group, model.scales, centre, follows=follows)
    return replace(dressed(around, model), heat=heat)
