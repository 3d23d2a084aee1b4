"""The stochastic update with unmodelled heat: around what all is linear, and how parameters and sizes are sampled."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from threadpoolctl import threadpool_limits

from ..problem import Problem, Whitening, as_sampled, at_sizes, mixed
from ..progress import Progress, about
from ..scenario import NutsSettings
from ..simulator import FloatArray
from .diagnostics import LINEAR, Diagnostics, Gate, diagnose, gate, with_gate
from .enough_draws import sample_enough
from .find_heat import find_heat
from .heat_check import HeatCheck, check_heat
from .heat_point import HeatPoint, bend, draw_sizes, follow, moved, spread_sizes, start_with_heat
from .mode import check_simulated, climb, find_mode
from .nuts import Draws, sample_problem
from .posterior import Posterior, prior_scores
from .rough import draws_in_turn, seconds_of_a_gradient
from .thresholds import with_thresholds

_OF_NOISE = 0.1
"""So far off linear, over its noise, a channel may be whatever the weights: no interval shows it."""
_NEAR = 200
"""Draws at which it is looked at how far the response to heat differs."""
_STRAIGHT = 0.25
"""Of the log density, to second order: so far off the response may be taken as the same for all theta."""
_MOST_FOLLOWED = 400
"""Weights: each gradient takes the cube of their number, so 280 take minutes, and many more would take hours."""
_PILOTS, _PILOT_CHAINS = 10, 2
_PILOT_WARMUP, _PILOT_DRAWS = 150, 150
_PILOT_DEPTH = 7
"""Of a pilot's trees: about 3 are enough. Where most draws reach it, the density is one that no chain gets through."""
_USUAL_PILOTS, _FOLLOWED_GRADIENTS = 6, 30
"""Pilots that it usually takes, and evaluations a draw, to say how long all take."""
_STAYS = 0.25
"""Of its deviation, within which the middle of each quantity is to be found again."""
_REMEMBERED = 3
"""Places of the middle that say where to look for it next."""
_NOT_LINEAR = (
    "Temperatures respond to the unmodelled heat otherwise than linearly, so that its weights are not to be "
    "believed. Describe more of it in the scenario (a load, a mode, a face), or narrow the priors of heat."
)
_SWITCHING = " Heaters whose status is not measured switch with it: give them a status ('measured_by')."
_CHECKED = 200
"""Draws that are simulated with their heat."""
MOST_PARETO_K = 0.7
"""Above it importance weights cannot be relied on (Vehtari et al. 2024, JMLR 25, 72)."""


@threadpool_limits.wrap(limits=1)
def calibrate_with_heat(
    problem: Problem,
    settings: NutsSettings,
    seed: int,
    starts: Sequence[tuple[str, FloatArray]],
    random_starts: int,
    progress: Progress,
) -> Posterior:
    """`calibrate_nuts` with unmodelled heat: sampled at the most probable sizes of noise and heat, then spread.

    Where the response to heat bends, it follows the parameters, and sizes are sampled with them.

    The mode is sought without heat, in open loop where heaters have a measured status.
    """
    rng = np.random.default_rng(seed)
    with progress.stage("mode search") as search:
        simple = as_sampled(problem).independent()
        modes = find_mode(simple, starts, rng=rng, random_starts=random_starts, progress=search)
    check_simulated(modes)
    with progress.stage("unmodelled heat") as search:
        point = find_heat(problem, problem.to_theta(modes[0].z), progress=search)
        heated, z = start_with_heat(problem, point)
        known = at_sizes(heated, heated.to_theta(z))
        mode = climb(known, _parts(z, heated, known), modes[0].origin)
        # Linear around where the draws will be.
        theta = _with_parts(heated.to_theta(z), heated, known, mode.z)
        point = moved(point, heated, theta)
        heated, z = start_with_heat(problem, point)
        known = at_sizes(heated, heated.to_theta(z))
        mode = climb(known, _parts(z, heated, known), modes[0].origin)
    coordinates = known.coordinates(mode.z)
    theta = _with_parts(theta, heated, known, mode.z)
    around = coordinates.to_z(rng.standard_normal((1, _NEAR, len(mode.z))))
    sizes = draw_sizes(point, rng)
    near = spread_sizes(problem, heated, point, known, around, sizes, rng)[0]
    with progress.stage("response to heat") as search:
        following = follow(problem, point, heated, theta)
        ahead, start = start_with_heat(problem, following)
        bent = bend(following, ahead, near)
        found = None
        if bent >= _STRAIGHT and len(point.model.centre) <= _MOST_FOLLOWED:
            seconds = _rough_seconds(ahead, start, settings)
            progress.say(f"the response to heat changes with the parameters and is followed: {about(seconds)} more")
            found = _followed(problem, following, ahead, start, settings, seed, search)
    target = known
    if found is not None:
        bent = 0.0
        point, heated, coordinates = found
        target = heated
    sampler = partial(sample_problem, target, progress=progress)

    def judge(draws: Draws) -> tuple[FloatArray, Diagnostics]:
        if found is None:
            theta = spread_sizes(problem, heated, point, known, draws.z, sizes, rng)
        else:
            theta = heated.to_theta(draws.z)
        theta = with_thresholds(heated, theta.reshape(-1, theta.shape[-1]), rng).reshape(theta.shape)
        by_name = {name: theta[..., k] for k, name in enumerate(heated.names)}
        return theta, diagnose(by_name, draws.statistics, settings, prior_scores(heated, theta))

    draws, theta, judged = sample_enough(sampler, coordinates, settings, seed, judge, progress)
    flat = theta.reshape(-1, theta.shape[-1])
    chosen = rng.choice(len(flat), min(_CHECKED, len(flat)), replace=False)
    checked = check_heat(heated, flat[chosen], rng)
    judged = with_gate(judged, _linear_gate(problem, checked, bent, len(point.model.centre)))
    return Posterior(heated.names, theta, draws, modes, judged, heated, point, checked)


def _followed(
    problem: Problem,
    point: HeatPoint,
    heated: Problem,
    z: FloatArray,
    settings: NutsSettings,
    seed: int,
    progress: Progress,
) -> tuple[HeatPoint, Problem, Whitening] | None:
    """The point in the middle of the posterior, the problem there, and coordinates to sample it in.

    None: chains do not get on, as where noise of no size at all explains a channel.

    The response to heat follows the parameters only near where it was looked at; so a few draws say where the middle
    is, and it is looked at there again, until the middle stays. Found from one place the middle may lie beyond the one
    that stays, or short of it: the places so far say where to look next. heated, z: the problem around the point, and
    where to begin.
    """
    points: list[FloatArray] = []
    steps: list[FloatArray] = []
    few = _of_a_pilot(settings)
    for trial in range(_PILOTS):
        progress.at(trial / _PILOTS, f"where it is, trial {trial + 1}")
        coordinates = heated.coordinates(z)
        pilot = sample_problem(heated, coordinates, few, seed, depth=_PILOT_DEPTH)
        if pilot.interrupted:
            raise KeyboardInterrupt
        if np.median(pilot.statistics["depth"]) >= _PILOT_DEPTH:
            return None
        drawn = pilot.z.reshape(-1, len(z))
        middle, deviation = drawn.mean(axis=0), drawn.std(axis=0)
        stays = bool((np.abs(middle - z) < _STAYS * deviation).all())
        # The first place is a mode, where sizes of heat are far from their middle: it says nothing of the others.
        if trial:
            points, steps = [*points, z], [*steps, middle - z]
            middle = next_place(points, steps, deviation)
        point = follow(problem, point, heated, heated.to_theta(middle))
        heated, z = start_with_heat(problem, point)
        if stays:
            break
    return point, heated, heated.coordinates(z)


def _of_a_pilot(settings: NutsSettings) -> NutsSettings:
    return settings.model_copy(
        update={
            "chains": min(settings.chains, _PILOT_CHAINS),
            "warmup": min(settings.warmup, _PILOT_WARMUP),
            "draws": min(settings.draws, _PILOT_DRAWS),
        }
    )


def _rough_seconds(heated: Problem, z: FloatArray, settings: NutsSettings) -> float:
    """Seconds that pilots and sampling will take from here, to a factor of two."""
    draws = _USUAL_PILOTS * draws_in_turn(_of_a_pilot(settings)) + draws_in_turn(settings)
    return seconds_of_a_gradient(heated, z) * _FOLLOWED_GRADIENTS * draws


def next_place(points: Sequence[FloatArray], steps: Sequence[FloatArray], deviation: FloatArray) -> FloatArray:
    """Where to look for a middle [d] that has been found `steps` [d] away from the points [d] where it was looked for.

    A middle that is found on the other side each time is half way, and of three places Anderson's mixing says the rest.
    deviation: [d], in which steps are compared.
    """
    last = slice(-_REMEMBERED, None)
    share = 1.0 if len(points) > 1 else 0.5
    known, found = (np.stack(sequence[last])[None] / deviation for sequence in (points, steps))
    return np.asarray(deviation * mixed(known, share * found)[0])


def _parts(z: FloatArray, heated: Problem, known: Problem) -> FloatArray:
    """Of z of a problem, that of one with fewer entries."""
    return np.array([z[heated.names.index(name)] for name in known.names])


def _with_parts(theta: FloatArray, heated: Problem, known: Problem, z: FloatArray) -> FloatArray:
    """theta of a problem, with what z of one with fewer entries says."""
    theta = theta.copy()
    theta[[heated.names.index(name) for name in known.names]] = known.to_theta(z)
    return theta


def _linear_gate(problem: Problem, checked: HeatCheck, bent: float, weights: int) -> Gate:
    switches = problem.scenario.network.switches.values()
    advice = _NOT_LINEAR + ("" if all(heater.measured_by for heater in switches) else _SWITCHING)
    is_linear = checked.pareto_k < MOST_PARETO_K or checked.relative < _OF_NOISE
    return gate(
        LINEAR,
        bent < _STRAIGHT and is_linear,
        f"Pareto k {checked.pareto_k:.2f}; {checked.draws} draws simulated with their heat are "
        f"{1e3 * checked.difference:.0f} mK from linear, {100 * checked.relative:.1f}% of a channel's noise at worst"
        + (f"; the log density is off by {bent:.1f}" if bent >= _STRAIGHT else ""),
        f"Pareto k below {MOST_PARETO_K:g}, or less than {100 * _OF_NOISE:.0f}% of the noise; the log density off by "
        f"less than {_STRAIGHT:g}",
        _too_many(weights) if is_linear and weights > _MOST_FOLLOWED else advice,
    )


def _too_many(weights: int) -> str:
    return (
        "What unmodelled heat does to temperatures changes with the parameters. With up to "
        f"{_MOST_FOLLOWED} weights of heat this is followed, and here there are {weights}: of the time, of the nodes, "
        "and of every switch of a heater. Train on a shorter window, or write fewer 'nodes' or 'harmonics', or a "
        "longer time of what is slow, in 'heat'. Narrower priors of the parameters help too."
    )
