"""Optimisation-based calibration: the genetic algorithm on a problem, and the points that it gives."""

from __future__ import annotations

import numpy as np
import xarray

from ..probability import DEVIATION
from ..problem import Problem
from ..progress import SILENT, Progress
from ..run import labelled
from ..scenario import GeneticSettings
from ..simulator import FloatArray
from .genetic import minimise
from .posterior import thetas_of
from .table import EACH

_SEARCH_BOX = 0.998
"""Share of each prior inside the box that the genetic algorithm searches."""
_POOR = 0.75
"""Share of the draws from the priors that fit better than the one that is shown as poorly calibrated."""
_LEAST_NOISE = 1e-3  # K, so that a perfect fit still has a noise level


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
    searched = _searched(problem)
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
    "history": ("K", "root mean square error of the best so far"),
    "best": (EACH, "best of a run"),
    "mean_theta": (EACH, "mean of the runs' best"),
    "best_theta": (EACH, "best of all runs"),
    "poor_theta": (EACH, "plausible wrong calibration"),
    "unit": ("", "SI unit of each quantity"),
}
"""Variable of genetic.nc -> its unit and what it is."""


def _searched(problem: Problem) -> list[int]:
    """Positions in theta of what the genetic algorithm searches: as published, time tags are right."""
    return [k for k in problem.simulated.tolist() if problem.entries[k].kind != "time"]


def _poor(problem: Problem, count: int, seed: int) -> FloatArray:
    """A plausible wrong calibration: values [parameter] of what the genetic algorithm searches.

    Of so many draws of the parameters from their priors it is the one whose RMSE three in four do not reach. Initial
    temperatures stay at their priors' medians, where telemetry has them: these are not what is wrong.
    """
    searched = _searched(problem)
    wrong = [k for k in searched if problem.entries[k].kind != "initial"]
    # The same whatever noise or heat there is beside: runs of the genetic algorithm are taken over.
    shares = np.full((count, len(problem.names)), 0.5)
    shares[:, wrong] = np.random.default_rng([seed, count]).random((count, len(wrong)))
    thetas = problem.priors.quantile(shares)
    rmse = problem.rmse(thetas)
    succeeded = int(np.isfinite(rmse).sum())
    place = np.argsort(rmse)[round(_POOR * (succeeded - 1))] if succeeded else 0
    return np.asarray(thetas[place, searched])


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


def posterior_mean(problem: Problem, posterior: xarray.DataTree) -> FloatArray:
    """The posterior's mean, theta [d], as a point estimate: what calibrated.yaml has. ``noise.*`` as in
    `genetic_points`.

    problem: without unmodelled heat. The posterior may have it, and then no noise: that matters to no simulation.
    """
    theta = problem.priors.median()
    known = [k for k, name in enumerate(problem.names) if name in posterior["posterior"]]
    theta[known] = thetas_of(posterior, [problem.names[k] for k in known]).mean(axis=0)
    return with_residual_noise(problem, theta)


def best_fit(problem: Problem, runs: xarray.Dataset) -> FloatArray:
    """theta [d] of `calibrate_genetic`'s best run, priors' medians where it does not search; nothing is simulated."""
    return _found(problem, runs["best_theta"])


def _found(problem: Problem, values: xarray.DataArray) -> FloatArray:
    """theta [d] with the values [parameter] that a genetic algorithm found."""
    theta = problem.priors.median()
    theta[[problem.names.index(name) for name in values["parameter"].values]] = values
    return theta


def _whole_point(problem: Problem, values: xarray.DataArray) -> FloatArray:
    """The same, with the noise that it leaves."""
    return with_residual_noise(problem, _found(problem, values))


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
