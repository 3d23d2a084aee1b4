"""The two calibration methods on a problem: the genetic algorithm, and the stochastic update with NUTS."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from html import escape
from typing import Any

import numpy as np
import xarray

from ..errors import FlightcalError
from ..probability import DEVIATION
from ..problem import Problem, Runs, Whitening, at_sizes, patterns_of, places_of, sampled_windows, whitening
from ..progress import SILENT, Progress
from ..run import labelled, plain
from ..scenario import GeneticSettings, NutsSettings, heat_of
from ..simulator import FloatArray, Trajectory
from .confounding import confounding
from .diagnostics import Diagnostics, Gate, diagnose, gate, with_gate
from .explanations import Explanation, other_explanations
from .genetic import minimise
from .heat import HeatCheck, HeatPoint, bend, check_heat, find_heat, follow, moved, spread_sizes, start_with_heat
from .heat_file import HEAT_GROUP, heat_dataset
from .mode import Mode, climb, find_mode
from .nuts import Draws, sample
from .table import Calibrated, calibrated, html_table

_SEARCH_BOX = 0.998
"""Share of each prior inside the box that the genetic algorithm searches."""
_POOR = 0.75
"""Share of the draws from the priors that fit better than the one that is shown as poorly calibrated."""
_LEAST_NOISE = 1e-3  # K, so that a perfect fit still has a noise level
_PLACES = 73
"""Of an orbit, at which patterns of heat are kept."""
_OF_NOISE = 0.1
"""So far off linear, over its noise, a channel may be whatever the weights: no interval shows it."""
_NEAR = 200
"""Draws at which it is looked at how far the response to heat differs."""
_STRAIGHT = 0.25
"""Of the log density, to second order: so far off the response may be taken as the same for all theta."""
_MOST_FOLLOWED = 250
"""Weights, of which more would take hours: each gradient takes the cube of their number."""
_PILOTS, _PILOT_CHAINS = 4, 2
_PILOT_WARMUP, _PILOT_DRAWS = 300, 150
_CAREFUL = 0.95
"""Acceptance where sizes are sampled: towards small ones the density narrows like a funnel."""
_STAYS = 0.5
"""Of its deviation, within which the middle of each quantity is to be found again."""
_CHECKED = 200
"""Draws that are simulated with their heat."""
MOST_PARETO_K = 0.7
"""Above it importance weights cannot be relied on (Vehtari et al. 2024, JMLR 25, 72)."""


_EACH = "SI"
"""In the place of a unit: each quantity has its own."""


def calibrate_genetic(
    problem: Problem,
    settings: GeneticSettings | None = None,
    seed: int | None = None,
    *,
    progress: Progress = SILENT,
) -> xarray.Dataset:
    """Minimise the RMSE over the channels with the genetic algorithm (optimisation-based calibration).

    settings, seed: None: the scenario's.
    Returns what `genetic.minimise` does, its cost as rmse [run] (K), with the seed among the attributes; and
    poor_theta [parameter], see `_poor`.
    """
    settings = settings or problem.scenario.calibration.genetic
    seed = problem.scenario.calibration.seed if seed is None else seed
    searched = problem.simulated
    median = problem.priors.median()
    lower, upper = (bound[searched] for bound in problem.priors.bounds(_SEARCH_BOX))

    def whole(part: FloatArray) -> FloatArray:
        thetas = np.tile(median, (len(part), 1))
        thetas[:, searched] = part
        return thetas

    found = minimise(
        lambda part: problem.rmse(whole(part), settings.heater_status_weight),
        lower,
        upper,
        settings,
        seed,
        progress=progress,
        words="RMSE {:.3f} K".format,
    )
    names = [problem.names[k] for k in searched]
    found = found.assign(poor_theta=("parameter", _poor(problem, settings.population, seed)))
    units = [problem.entries[k].unit or "1" for k in searched]
    found = found.rename(cost="rmse").assign_coords(parameter=names, unit=("parameter", units))
    return labelled(found.assign_attrs(seed=seed), _OF_SEARCH)


_OF_SEARCH = {
    "rmse": ("K", "root mean square error of a run's best"),
    "generations": ("1", "generations that a run took"),
    "converged": ("1", "whether a run converged"),
    "history": ("K", "root mean square error of the best of each generation"),
    "best": (_EACH, "best of a run"),
    "first_generation_best": (_EACH, "best of a run's first generation"),
    "mean_theta": (_EACH, "mean of the runs' best"),
    "best_theta": (_EACH, "best of all runs"),
    "spread_theta": (_EACH, "standard deviation of the runs' best"),
    "poor_theta": (_EACH, "plausible wrong calibration"),
    "unit": ("", "SI unit of each quantity"),
}
"""Variable of genetic.nc -> its unit and what it is."""


def _poor(problem: Problem, count: int, seed: int) -> FloatArray:
    """A plausible wrong calibration: values [parameter] of what the genetic algorithm searches.

    Of so many draws of the parameters from their priors it is the one whose RMSE three in four do not reach. Initial
    temperatures stay at their priors' medians, where telemetry has them: these are not what is wrong.
    """
    wrong = [k for k in problem.simulated if not problem.names[k].startswith("initial.")]
    # The same whatever noise or heat there is beside: runs of the genetic algorithm are taken over.
    shares = np.full((count, len(problem.names)), 0.5)
    shares[:, wrong] = np.random.default_rng([seed, count]).random((count, len(wrong)))
    thetas = problem.priors.quantile(shares)
    rmse = problem.rmse(thetas)
    succeeded = int(np.isfinite(rmse).sum())
    place = np.argsort(rmse)[round(_POOR * (succeeded - 1))] if succeeded else 0
    return np.asarray(thetas[place, problem.simulated])


def genetic_points(problem: Problem, runs: xarray.Dataset) -> dict[str, FloatArray]:
    """The point estimates of `calibrate_genetic` by method name: thetas [d] ordered as `Problem.names`.

    genetic: the mean of the runs' best, as published; it can leave the ridge of good fits, hence genetic_best;
    poorly_calibrated: a plausible wrong calibration. ``noise.*`` is the RMSE of each channel.
    """
    chosen = {
        "poorly_calibrated": runs["poor_theta"],
        "genetic": runs["mean_theta"],
        "genetic_best": runs["best_theta"],
    }
    return {method: _whole_point(problem, values) for method, values in chosen.items()}


def genetic_run_points(problem: Problem, runs: xarray.Dataset) -> dict[str, FloatArray]:
    """The best of each run of `calibrate_genetic` that did not fail, as in `genetic_points`, by ``genetic_run_1`` etc.

    They tell how far the runs differ.
    """
    succeeded = np.flatnonzero(np.isfinite(runs["rmse"].values))
    return {f"genetic_run_{k + 1}": _whole_point(problem, runs["best"].isel(run=k)) for k in succeeded}


def _whole_point(problem: Problem, values: xarray.DataArray) -> FloatArray:
    """theta [d] with the values [parameter] that a genetic algorithm found, and the noise that it leaves."""
    theta = problem.priors.median()
    theta[[problem.names.index(name) for name in values["parameter"].values]] = values
    return with_residual_noise(problem, theta)


def with_residual_noise(problem: Problem, theta: FloatArray) -> FloatArray:
    """theta [d] with its ``noise.*`` entries set to the RMSE of each channel (K); prior median where it fails."""
    theta = theta.copy()
    runs = problem.simulate_many(theta[None])[0]
    if runs is not None:
        rmse = np.sqrt(np.nanmean(problem.residual(runs) ** 2, axis=0))
        channels, columns, positions = problem.places
        of_noise = columns == DEVIATION
        theta[positions[of_noise]] = np.maximum(rmse[channels[of_noise]], _LEAST_NOISE)
    return theta


@dataclass(frozen=True)
class Posterior:
    """Result of the stochastic update."""

    names: tuple[str, ...]
    theta: FloatArray
    """[chain, draw, d]."""
    draws: Draws
    modes: tuple[Mode, ...]
    """Local optima that were found before sampling, best first; chains start around the first."""
    diagnostics: Diagnostics
    problem: Problem
    """What the draws are of: that which was given, or with unmodelled heat as it was found."""
    heat: HeatPoint | None = None
    """Around what unmodelled heat is linear; None: there is none."""
    checked: HeatCheck | None = None
    """Draws that were simulated with their heat."""

    def __repr__(self) -> str:
        chains, draws = self.theta.shape[:2]
        passed = "all gates passed" if self.diagnostics.passed else "a gate failed"
        return f"<Posterior of {self.problem.scenario.name!r}: {chains} x {draws} draws of {len(self.names)}; {passed}>"

    def _repr_html_(self) -> str:
        return f"<p>{escape(repr(self))}</p>{html_table(self.table)}"

    @property
    def table(self) -> tuple[Calibrated, ...]:
        """Every quantity before and after."""
        return calibrated(self.problem, self.flat)

    @property
    def flat(self) -> FloatArray:
        """All draws [S, d], chain after chain."""
        return self.theta.reshape(-1, self.theta.shape[-1])


def calibrate_nuts(
    problem: Problem,
    settings: NutsSettings | None = None,
    seed: int | None = None,
    *,
    starts: Sequence[tuple[str, FloatArray]] = (),
    random_starts: int = 6,
    progress: Progress = SILENT,
) -> Posterior:
    """Sample the posterior with NUTS: find the mode, whiten with the Gauss-Newton Hessian, run the chains.

    settings, seed: None: the scenario's. starts: named thetas [d] from which the mode is sought too, such as the
    genetic algorithm's. random_starts: prior draws from which it is sought.
    Raises FlightcalError when no start has a finite density, and KeyboardInterrupt where sampling is interrupted before
    the first draw.
    """
    settings = settings or problem.scenario.calibration.nuts
    seed = problem.scenario.calibration.seed if seed is None else seed
    rng = np.random.default_rng(seed)
    if heat_of(problem.scenario) is not None and problem.heat is None:
        return _calibrate_with_heat(problem, settings, seed, starts, random_starts, progress)
    with progress.stage("mode search") as search:
        modes = find_mode(problem, starts, rng=rng, random_starts=random_starts, progress=search)
    _check_simulated(modes)
    coordinates = whitening(modes[0].z, problem.gauss_newton_hessian(modes[0].z))
    draws = _drawn(
        sample(
            problem.log_density_and_gradient,
            coordinates,
            settings,
            seed,
            native=problem.native_density,
            progress=progress,
        )
    )
    theta = problem.to_theta(draws.z)
    by_name = {name: theta[..., k] for k, name in enumerate(problem.names)}
    judged = diagnose(by_name, draws.statistics, settings, _prior_scores(problem, theta))
    return Posterior(problem.names, theta, draws, modes, judged, problem)


def _prior_scores(problem: Problem, theta: FloatArray) -> dict[str, float]:
    """Normal score of each median of draws [chain, draw, d] in its prior."""
    scores = problem.priors.to_z(np.median(theta, axis=(0, 1)))
    return dict(zip(problem.names, scores.tolist(), strict=True))


def _drawn(draws: Draws) -> Draws:
    """The draws. Raises KeyboardInterrupt where sampling was interrupted before the first one."""
    if not draws.z.shape[1]:
        raise KeyboardInterrupt
    return draws


def _check_simulated(modes: Sequence[Mode]) -> None:
    if not np.isfinite(modes[0].log_density):
        raise FlightcalError(
            "no start of the calibration can be simulated: every simulation fails or is not finite; "
            "check the priors with 'flightcal simulate'"
        )


def _calibrate_with_heat(
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
    sampled = sampled_windows(problem)
    simple = problem if sampled is problem.windows else replace(problem, windows=sampled, open_loop=None)
    with progress.stage("mode search") as search:
        modes = find_mode(simple.independent(), starts, rng=rng, random_starts=random_starts, progress=search)
    _check_simulated(modes)
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
    coordinates = whitening(mode.z, known.gauss_newton_hessian(mode.z))
    theta = _with_parts(theta, heated, known, mode.z)
    around = coordinates.to_z(rng.standard_normal((1, _NEAR, len(mode.z))))
    near = spread_sizes(problem, heated, point, known, around, rng)[0]
    with progress.stage("response to heat") as search:
        following = follow(problem, point, heated, theta)
        ahead, start = start_with_heat(problem, following)
        bent = bend(following, ahead, near)
        straight = bent < _STRAIGHT or len(point.model.centre) > _MOST_FOLLOWED
        if not straight:
            bent = 0.0
            point, heated, coordinates = _followed(problem, following, ahead, start, settings, seed, search)
    if straight:
        density = known.log_density_and_gradient
        draws = _drawn(sample(density, coordinates, settings, seed, native=known.native_density, progress=progress))
        theta = spread_sizes(problem, heated, point, known, draws.z, rng)
    else:
        density = heated.log_density_and_gradient
        careful = settings.model_copy(update={"target_acceptance": max(settings.target_acceptance, _CAREFUL)})
        draws = _drawn(sample(density, coordinates, careful, seed, native=heated.native_density, progress=progress))
        theta = heated.to_theta(draws.z)
    by_name = {name: theta[..., k] for k, name in enumerate(heated.names)}
    judged = diagnose(by_name, draws.statistics, settings, _prior_scores(heated, theta))
    flat = theta.reshape(-1, theta.shape[-1])
    chosen = rng.choice(len(flat), min(_CHECKED, len(flat)), replace=False)
    checked = check_heat(heated, flat[chosen], rng)
    judged = with_gate(judged, _linear_gate(checked, bent))
    return Posterior(heated.names, theta, draws, modes, judged, heated, point, checked)


def _followed(
    problem: Problem,
    point: HeatPoint,
    heated: Problem,
    z: FloatArray,
    settings: NutsSettings,
    seed: int,
    progress: Progress,
) -> tuple[HeatPoint, Problem, Whitening]:
    """The point in the middle of the posterior, the problem there, and coordinates to sample it in.

    The response to heat follows the parameters only near where it was looked at; so a few draws say where the middle
    is, and it is looked at there again, until the middle stays. heated, z: the problem around the point, and where to
    begin.
    """
    few = settings.model_copy(
        update={
            "chains": min(settings.chains, _PILOT_CHAINS),
            "warmup": min(settings.warmup, _PILOT_WARMUP),
            "draws": min(settings.draws, _PILOT_DRAWS),
        }
    )
    for trial in range(_PILOTS):
        progress.at(trial / _PILOTS, f"where it is, trial {trial + 1}")
        coordinates = whitening(z, heated.gauss_newton_hessian(z))
        pilot = sample(heated.log_density_and_gradient, coordinates, few, seed, native=heated.native_density)
        if pilot.interrupted:
            raise KeyboardInterrupt
        drawn = pilot.z.reshape(-1, len(z))
        middle = drawn.mean(axis=0)
        stays = bool((np.abs(middle - z) < _STAYS * drawn.std(axis=0)).all())
        point = follow(problem, point, heated, heated.to_theta(middle))
        heated, z = start_with_heat(problem, point)
        if stays:
            break
    return point, heated, whitening(z, heated.gauss_newton_hessian(z))


def _parts(z: FloatArray, heated: Problem, known: Problem) -> FloatArray:
    """Of z of a problem, that of one with fewer entries."""
    return np.array([z[heated.names.index(name)] for name in known.names])


def _with_parts(theta: FloatArray, heated: Problem, known: Problem, z: FloatArray) -> FloatArray:
    """theta of a problem, with what z of one with fewer entries says."""
    theta = theta.copy()
    theta[[heated.names.index(name) for name in known.names]] = known.to_theta(z)
    return theta


def _linear_gate(checked: HeatCheck, bent: float) -> Gate:
    return gate(
        "response to heat",
        bent < _STRAIGHT and (checked.pareto_k < MOST_PARETO_K or checked.relative < _OF_NOISE),
        f"Pareto k {checked.pareto_k:.2f}; {checked.draws} draws simulated with their heat are "
        f"{1e3 * checked.difference:.0f} mK from linear, {100 * checked.relative:.0f}% of a channel's noise at worst"
        + (f"; the log density is off by {bent:.1f}" if bent >= _STRAIGHT else ""),
        f"Pareto k below {MOST_PARETO_K:g}, or less than {100 * _OF_NOISE:.0f}% of the noise; the log density off by "
        f"less than {_STRAIGHT:g}",
        "Temperatures respond to the unmodelled heat otherwise than linearly, so that its weights are not to be "
        "believed: the heat is large, or heaters whose status is not measured switch with it. Give these a status "
        "('measured_by'), or narrow the priors of heat.",
    )


def search_record(problem: Problem, modes: Sequence[Mode]) -> dict[str, Any]:
    """How the mode was sought, in words, and what was found: for the log and the report."""
    opened = problem.open_loop
    if problem.heat is not None:
        driven = any(window.switching is not None for window in problem.windows)
        where = "in open loop, heaters driven by their measured status" if driven else "in closed loop"
        how = f"without unmodelled heat, {where}; then heat was looked at around it"
    elif opened is None:
        measured = getattr(problem.scenario.simulator, "heater_input", "simulated") == "measured"
        how = "in open loop alone, heaters driven by their measured status" if measured else "in closed loop"
    else:
        how = (
            "in open loop, heaters driven by their measured status, and finished in closed loop, thermostats simulated"
        )
        if opened.windows[0].measured_switches is not None:
            how += "; in open loop sensors are held to their thresholds when heaters are seen to switch"
    kept = ("origin", "log_density", "converged")
    return {"sought": how, "modes": [{name: plain(getattr(mode, name)) for name in kept} for mode in modes]}


def _status_forms(problem: Problem) -> dict[str, str]:
    """Status channels that count in the likelihood, and as what."""
    forms = {name: item.likelihood for name, item in problem.scenario.observations.items() if item.likelihood}
    return {name: "switch times" if form.switch_times else "duty cycle" for name, form in forms.items()}


def mean_and_some(thetas: FloatArray, count: int, seed: int) -> FloatArray:
    """The mean of posterior draws thetas [S, d] and at most `count` of them: [1 + count, d]."""
    chosen = np.random.default_rng(seed).choice(len(thetas), min(count, len(thetas)), replace=False)
    return np.concatenate([thetas.mean(axis=0)[None], thetas[chosen]])


def _drifting(problem: Problem, theta: FloatArray) -> xarray.Dataset | None:
    """What the parameters that drift are in each window, at draws [chain, draw, d]; None: there are none."""
    values = problem.window_values(theta)
    labels = [window.label for window in problem.windows]
    dims = ("chain", "draw", "window")
    if not values:
        return None
    own = xarray.Dataset({name: (dims, of) for name, of in values.items()}, {"window": labels})
    return labelled(own, _words(problem))


def _sequences(runs: Sequence[Trajectory]) -> dict[str, float]:
    """In how many orders heaters switched in simulations of a window, and how common the most common one is."""
    found = Counter(tuple(zip(run.switches.heater.tolist(), run.switches.on.tolist(), strict=True)) for run in runs)
    return {"sequences": len(found), "share_of_most_common": max(found.values()) / found.total() if found else 1.0}


def posterior_tree(
    problem: Problem, posterior: Posterior, *, seed: int, most_predictions: int = 250
) -> xarray.DataTree:
    """The posterior in ArviZ's groups: posterior, sample_stats, prior, posterior_predictive, observed_data.

    Where there is a discrepancy, also that: what it is on the window, and how far parameters stand in for it. Where
    parameters drift from window to window, `windows`: what they are in each.
    """
    rng = np.random.default_rng(seed)
    names, channels = posterior.names, list(problem.channels)
    prior = problem.priors.sample(rng, 2000)
    chains, draws = posterior.theta.shape[:2]
    every = max(1, -(-chains * draws // most_predictions))
    kept = np.arange(0, draws, every)
    thetas = posterior.theta[:, kept].reshape(-1, len(names))
    runs = problem.simulate_many(thetas)
    times, observed, status = (
        np.concatenate([getattr(window, what) for window in problem.windows])
        for what in ("times", "observed", "status")
    )
    missing = np.full(observed.shape, np.nan)
    predicted = [
        missing if of_theta is None else problem.replicate(theta, of_theta, rng)
        for theta, of_theta in zip(thetas, runs, strict=True)
    ]
    by_draw, by_sample = ("chain", "draw"), ("time", "channel")
    sampled = np.stack(predicted).reshape(chains, len(kept), *missing.shape)
    samples = {"time": times, "channel": channels}
    groups = {
        "discrepancy": confounding(problem, thetas, runs),
        "windows": _drifting(problem, posterior.theta),
        "posterior": labelled(_variables(names, posterior.theta), _words(problem)),
        "sample_stats": labelled(
            xarray.Dataset({name: (by_draw, values) for name, values in posterior.draws.statistics.items()}),
            _OF_SAMPLER,
        ),
        "prior": labelled(_variables(names, prior[None]), _words(problem)),
        "posterior_predictive": labelled(
            xarray.Dataset({"temperature": ((*by_draw, *by_sample), sampled)}, samples | {"draw": kept}),
            {"temperature": ("K", "temperature, drawn from the posterior predictive distribution")},
        ),
        "observed_data": labelled(
            xarray.Dataset(
                {"temperature": (by_sample, observed), "status": (("time", "heater"), status)},
                samples | {"heater": list(problem.heaters)},
            ),
            {"temperature": ("K", "measured temperature"), "status": ("1", "measured status of the heater")},
        ),
        HEAT_GROUP: None if posterior.heat is None else labelled(_kept_heat(posterior, posterior.heat), _OF_HEAT),
        "/": xarray.Dataset(attrs=_attributes(problem, posterior, runs)),
    }
    return xarray.DataTree.from_dict({name: group for name, group in groups.items() if group is not None})


def _kept_heat(posterior: Posterior, point: HeatPoint) -> xarray.Dataset:
    """What unmodelled heat is, and for the report its patterns, and parameters' deviations if it were known."""
    checked = posterior.checked
    kept = heat_dataset(point.model, point.names, point.theta)
    around = point.around
    sizes = np.array([point.sizes[name] for name in around.sizes.names])
    places = around.moving
    slope = posterior.problem.priors.at(_in_order(point, posterior)).slope
    place = {name: k for k, name in enumerate(posterior.names)}
    names = [point.names[k] for k in places]
    known = around.known_heat(sizes) * np.array([slope[place[name]] for name in names])
    kept = kept.assign(deviation_without_heat=("parameter", known)).assign_coords(parameter=names)
    if checked is None:
        return kept
    along = places_of(point.model, _PLACES)
    patterns = patterns_of(point.model, checked.weights, along)
    of_nodes = {"node": list(point.model.nodes), "place": along}
    return kept.assign(pattern=(("heat_draw", "node", "place"), patterns)).assign_coords(of_nodes)


def _in_order(point: HeatPoint, posterior: Posterior) -> FloatArray:
    """z [d] of the point around which heat is linear."""
    known = dict(zip(point.names, point.theta, strict=True)) | point.sizes
    return posterior.problem.to_z(np.array([known[name] for name in posterior.names]))


def _words(problem: Problem) -> dict[str, tuple[str, str]]:
    """Unit and long name of each entry of theta."""
    return {entry.name: (entry.unit, entry.long_name) for entry in problem.entries}


_OF_SAMPLER = {
    "diverging": ("1", "whether the trajectory broke off"),
    "depth": ("1", "depth of the trajectory's tree"),
    "n_steps": ("1", "steps of the trajectory"),
    "energy": ("1", "energy of the trajectory"),
    "step_size": ("1", "size of a step"),
    "acceptance": ("1", "mean probability of acceptance"),
    "log_density": ("1", "logarithm of the posterior density, up to a constant"),
}
"""Variable of sample_stats -> its unit and what it is."""
_OF_HEAT = {
    "model": ("", "what unmodelled heat is made of, as JSON"),
    "deviation_without_heat": (_EACH, "posterior standard deviation if heat were known"),
    "pattern": ("W", "unmodelled heat that comes again"),
}
"""Variable of the group heat -> its unit and what it is."""


def _variables(names: Sequence[str], values: FloatArray) -> xarray.Dataset:
    """Values [chain, draw, d] as a variable of each name."""
    return xarray.Dataset({name: (("chain", "draw"), values[..., k]) for k, name in enumerate(names)})


def _attributes(problem: Problem, posterior: Posterior, runs: Sequence[Runs | None]) -> dict[str, str]:
    """What posterior.nc says beside its arrays, as JSON; runs: simulations at some of the draws."""
    of_windows = zip(*(found for found in runs if found is not None), strict=True)
    sequences = [
        {"window": window.name} | _sequences(of_window)
        for window, of_window in zip(problem.windows, of_windows, strict=False)
    ]
    others: tuple[Explanation, ...] = ()
    if posterior.heat is None:
        others = other_explanations(problem, posterior.modes, posterior.draws.z.reshape(-1, len(problem.names)))
    content = {
        "interrupted": posterior.draws.interrupted,
        "mode_search": search_record(problem, posterior.modes),
        "other_explanations": [asdict(other) for other in others],
        "status_likelihood": _status_forms(problem),
        "switch_sequences": sequences,
    }
    return {name: json.dumps(value) for name, value in content.items()}
