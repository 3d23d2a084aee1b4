"""The posterior that the stochastic update gives, and its groups as ArviZ has them."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from html import escape
from typing import Any

import numpy as np
import xarray

from ..problem import Problem, Runs, patterns_of, pinned_heaters, places_of
from ..run import labelled, plain
from ..scenario import status_likelihoods
from ..simulator import FloatArray, Trajectory
from .confounding import confounding
from .diagnostics import Diagnostics, PriorScore
from .explanations import Explanation, other_explanations
from .heat_check import HeatCheck
from .heat_file import HEAT_GROUP, heat_dataset
from .heat_point import HeatPoint
from .mode import Mode
from .nuts import Draws
from .table import EACH, Calibrated, calibrated, html_table

_LEAST_MOVED = 0.25
"""Of a prior's variance, that a posterior's mean may have at least. Where either a parameter or heat of unknown size
explains the telemetry, a posterior is off, and as wide as the two together."""
_PLACES = 73
"""Of an orbit, at which patterns of heat are kept."""


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


def prior_scores(problem: Problem, theta: FloatArray) -> dict[str, PriorScore]:
    """Where the posteriors of draws [chain, draw, d] lie in their priors, and how far out a right prior lets them be.

    On the scale on which a prior is N(0, 1), a posterior's variance and that of its mean from one telemetry to the next
    add up to 1 (the law of total variance). So telemetry that narrows a prior little moves it little, and a posterior
    that is off and hardly narrower has a wrong prior, or makes up for something else that is wrong: its z-score beside
    its contraction (Schad, Betancourt and Vasishth 2021, Psychological Methods 26).
    """
    priors = problem.priors
    scores = (priors.to_z(theta) - priors.to_z(priors.median())).reshape(-1, theta.shape[-1]) / priors.spread()
    usual = np.sqrt(np.maximum(1.0 - scores.var(axis=0), _LEAST_MOVED))
    found = zip(problem.names, np.median(scores, axis=0).tolist(), usual.tolist(), strict=True)
    return {name: PriorScore(score, most) for name, score, most in found}


def search_record(problem: Problem, modes: Sequence[Mode]) -> dict[str, Any]:
    """How the mode was sought, in words, and what was found: for the log and the report."""
    opened = problem.open_loop
    if problem.heat is not None:
        driven = any(window.switching is not None for window in problem.windows)
        where = "in open loop, heaters driven by their measured status" if driven else "in closed loop"
        window = problem.windows[0]
        if driven and window.unmeasured:
            names = ", ".join(window.simulator.heaters[k] for k in window.unmeasured)
            where += f" ({names}, without one, as the telemetry shows best)"
        held = pinned_heaters(window.scenario)
        if held:
            where += f", and what {', '.join(held)} heats held at its measured temperature, for telemetry "
            where += "does not show each switch"
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
    forms = status_likelihoods(problem.scenario)
    return {name: "switch times" if form.switch_times else "duty cycle" for name, form in forms.items()}


def _by_window(problem: Problem, theta: FloatArray) -> xarray.Dataset | None:
    """What the parameters that move are in each window, at draws [chain, draw, d]; None: there are none."""
    values = problem.window_values(theta)
    labels = [window.label for window in problem.windows]
    dims = ("chain", "draw", "window")
    if not values:
        return None
    dataset = xarray.Dataset({name: (dims, of) for name, of in values.items()}, {"window": labels})
    return labelled(dataset, _words(problem))


def _sequences(runs: Sequence[Trajectory]) -> dict[str, float]:
    """In how many orders heaters switched in simulations of a window, and how common the most common one is."""
    found = Counter(tuple(zip(run.switches.heater.tolist(), run.switches.on.tolist(), strict=True)) for run in runs)
    return {"sequences": len(found), "share_of_most_common": max(found.values()) / found.total() if found else 1.0}


def posterior_tree(
    problem: Problem, posterior: Posterior, *, seed: int, most_predictions: int = 250
) -> xarray.DataTree:
    """The posterior in ArviZ's groups: posterior, sample_stats, prior, posterior_predictive, observed_data.

    Where there is a discrepancy, also that: what it is on the window, and how far parameters stand in for it. Where
    parameters are not the same in all windows, `windows`: what they are in each.
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
    done = [k for k, run in enumerate(runs) if run is not None]
    predicted = np.full((len(thetas), *observed.shape), np.nan)
    if done:
        predicted[done] = problem.replicates(thetas[done], [run for run in runs if run is not None], rng)
    by_draw, by_sample = ("chain", "draw"), ("time", "channel")
    sampled = predicted.reshape(chains, len(kept), *observed.shape)
    samples = {"time": times, "channel": channels}
    groups = {
        "discrepancy": confounding(problem, thetas, runs),
        "windows": _by_window(problem, posterior.theta),
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
    sizes = point.most_probable
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
    "deviation_without_heat": (EACH, "posterior standard deviation if heat were known"),
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


def thetas_of(posterior: xarray.DataTree, names: Sequence[str]) -> FloatArray:
    """All draws [S, d] of a kept posterior, chain after chain."""
    group = posterior["posterior"].to_dataset()
    return np.stack([group[name].values.ravel() for name in names], axis=1)


def mean_and_some(thetas: FloatArray, count: int, seed: int) -> FloatArray:
    """The mean of posterior draws thetas [S, d] and at most `count` of them: [1 + count, d]."""
    return np.concatenate([thetas.mean(axis=0)[None], some_of(thetas, count, seed)])


def some_of(thetas: FloatArray, count: int, seed: int) -> FloatArray:
    """At most `count` of posterior draws thetas [S, d], at random without repetition, in their order."""
    chosen = np.random.default_rng(seed).choice(len(thetas), min(count, len(thetas)), replace=False)
    return np.asarray(thetas[np.sort(chosen)])
