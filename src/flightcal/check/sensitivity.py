"""Which parameters the outputs and the likelihood depend on, over the whole prior.

Variance-based indices: a parameter's first-order index is the share of an output's variance that it causes
alone, its total index the share that it takes part in (Saltelli et al. 2010, Comput. Phys. Commun. 181, 259). Where a
simulation is dear there is no design for the total index; the first-order index then comes from the prior's draws
(random balance designs with Tissot and Prieur's correction, 2012, Reliab. Eng. Syst. Saf. 107, 205).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, qmc, rankdata

from ..problem import Problem, Runs
from ..progress import SILENT, Progress
from ..simulator import FloatArray
from .evaluate import Effort, ManyRuns, in_batches, log_likelihoods

LIKELIHOOD = "log likelihood"
_HARMONICS = 6
_RESAMPLES = 100
_HALF_95 = float(norm.ppf(0.975))
"""Half the width of a 95% interval, in standard deviations."""


@dataclass(frozen=True)
class Indices:
    """Sensitivity indices of outputs [O] by parameters [d], 0 to 1 but for their own error."""

    first: FloatArray
    """[O, d]."""
    first_error: FloatArray
    """[O, d] half the width of the 95% interval."""
    total: FloatArray
    """[O, d]; NaN where there is no design for them."""
    total_error: FloatArray


@dataclass(frozen=True)
class Sensitivity:
    """Indices of every output, and how far each moves over the prior."""

    names: tuple[str, ...]
    """[d] of what the simulator takes."""
    outputs: tuple[str, ...]
    """[O] channels (RMS temperature change), heaters (duty cycle), the log likelihood (its rank), over all windows."""
    deviation: FloatArray
    """[O] over the prior: K, share of the time, rank."""
    indices: Indices
    method: str
    runs: int
    failed: int

    @property
    def strongest(self) -> FloatArray:
        """[O, d] the total index, or where there is none the first-order one."""
        return np.where(np.isfinite(self.indices.total), self.indices.total, self.indices.first)


def sensitivity(
    problem: Problem,
    z: FloatArray,
    effort: Effort,
    seed: int,
    prior_runs: tuple[FloatArray, ManyRuns],
    progress: Progress = SILENT,
) -> Sensitivity:
    """Indices over the prior of what the simulator takes; noise levels and the like stay as at z [d].

    prior_runs: prior thetas [S, d] and their simulations, from which the indices come where `effort.base` is 0.
    """
    reference = problem.simulate(problem.to_theta(z))
    columns = problem.simulated

    def whole(share: FloatArray) -> FloatArray:
        """Points z [S, d] of quantiles [S, s]."""
        quantiles = np.full((len(share), len(z)), 0.5)
        quantiles[:, columns] = share
        points = np.tile(z, (len(share), 1))
        points[:, columns] = problem.to_z(problem.priors.quantile(quantiles))[:, columns]
        return points

    def outputs_of(share: FloatArray) -> FloatArray:
        outputs = []
        for part in in_batches(len(share)):
            values, runs = log_likelihoods(problem, whole(share[part]))
            outputs.append(_outputs(problem, reference, values, runs))
            progress.at(part.stop / len(share))
        return _ranked(np.concatenate(outputs))

    if effort.base:
        indices, outputs = sobol(outputs_of, len(columns), effort.base, seed)
        method = "Sobol indices (Saltelli design)"
    else:
        thetas, runs = prior_runs
        points = np.tile(z, (len(thetas), 1))
        points[:, columns] = problem.to_z(thetas)[:, columns]
        outputs = _ranked(_outputs(problem, reference, log_likelihoods(problem, points, runs)[0], runs))
        indices = given_data(points[:, columns], outputs, seed)
        method = "first-order indices from the prior's draws (RBD-FAST)"
    return Sensitivity(
        names=tuple(problem.names[k] for k in columns),
        outputs=(*problem.channels, *problem.heaters, LIKELIHOOD),
        deviation=np.nanstd(outputs, axis=0),
        indices=indices,
        method=method,
        runs=len(outputs),
        failed=int((~np.isfinite(outputs).all(axis=1)).sum()),
    )


def sobol(
    outputs_of: Callable[[FloatArray], FloatArray], dimension: int, base: int, seed: int
) -> tuple[Indices, FloatArray]:
    """First-order and total indices of a function of independent quantiles, by base (dimension + 2) evaluations.

    outputs_of: points [S, dimension] in the unit cube -> outputs [S, O], NaN where one fails. base: a power of two.
    Blocks of the design in which an evaluation fails are left out. Returns the outputs, too.
    """
    # Row by row of the design: a point of A, that point with one entry after the other from B, the point of B.
    a, b = np.hsplit(qmc.Sobol(2 * dimension, seed=np.random.default_rng(seed)).random(base), 2)
    crossed = np.where(np.eye(dimension, dtype=bool), b[:, None], a[:, None])
    outputs = outputs_of(np.concatenate([a[:, None], crossed, b[:, None]], axis=1).reshape(-1, dimension))
    blocks = outputs.reshape(base, dimension + 2, -1)
    whole = blocks[np.isfinite(blocks).all(axis=(1, 2))]
    results = np.zeros((4, outputs.shape[1], dimension))
    again = np.random.default_rng(seed + 1).integers(max(len(whole), 1), size=(len(whole), _RESAMPLES)).T
    for k, column in enumerate(np.moveaxis(whole, -1, 0)):
        if len(column) >= 4 and np.ptp(column) > 0.0:
            column = (column - column.mean()) / column.std()
            resampled = np.array([_estimates(column[rows]) for rows in again])
            results[::2, k] = _estimates(column)
            results[1::2, k] = _HALF_95 * resampled.std(axis=0, ddof=1)
    return Indices(*results), outputs


def _estimates(blocks: FloatArray) -> FloatArray:
    """First-order and total indices [2, d] of blocks [B, d + 2] of one output; table 2 (b, f) of Saltelli et al."""
    a, crossed, b = blocks[:, :1], blocks[:, 1:-1], blocks[:, -1:]
    variance = np.var([a, b])
    if variance <= np.finfo(float).eps:
        return np.zeros((2, crossed.shape[1]))
    return np.stack([np.mean(b * (crossed - a), axis=0), 0.5 * np.mean((a - crossed) ** 2, axis=0)]) / variance


def given_data(inputs: FloatArray, outputs: FloatArray, seed: int) -> Indices:
    """First-order indices from any sample of inputs [S, d] and outputs [S, O]; samples with NaN are left out."""
    whole = np.isfinite(outputs).all(axis=1)
    inputs, outputs = inputs[whole], outputs[whole]
    first, error = np.zeros((2, outputs.shape[1], inputs.shape[1]))
    for k, column in enumerate(outputs.T):
        if len(column) < 4 * _HARMONICS or np.ptp(column) == 0.0:
            continue
        rng = np.random.default_rng(seed + 1)
        for j, values in enumerate(inputs.T):
            first[k, j] = _share_of_harmonics(values, column)
            halves = [rng.choice(len(column), size=len(column) // 2, replace=False) for _ in range(_RESAMPLES)]
            resampled = [_share_of_harmonics(values[rows], column[rows]) for rows in halves]
            error[k, j] = _HALF_95 * np.std(resampled, ddof=1)
    return Indices(first, error, np.full_like(first, np.nan), np.full_like(first, np.nan))


def _share_of_harmonics(values: FloatArray, outputs: FloatArray) -> float:
    """How much of the variance of outputs [S] is slow along sorted values [S], up and down again; unbiased."""
    order = np.argsort(values)
    power = np.abs(np.fft.rfft(outputs[np.concatenate([order[::2], order[1::2][::-1]])])[1:]) ** 2
    if len(values) % 2 == 0:
        power[-1] /= 2.0  # the highest frequency of an even number has no twin
    share = power[:_HARMONICS].sum() / power.sum()
    bias = 2.0 * _HARMONICS / len(values)
    return float(share - bias / (1.0 - bias) * (1.0 - share))


def _outputs(problem: Problem, reference: Runs, likelihoods: FloatArray, runs: ManyRuns) -> FloatArray:
    """RMS temperature change of each channel, duty of each heater and log likelihood: [S, N + H + 1]."""
    outputs = np.full((len(runs), len(problem.channels) + len(problem.heaters) + 1), np.nan)
    spans = np.array([(window.times[-1] - window.times[0]) / np.timedelta64(1, "s") for window in problem.windows])
    shares = spans / spans.sum()
    for row, likelihood, trajectories in zip(outputs, likelihoods, runs, strict=True):
        if trajectories is not None:
            moved = [run.temperatures - base.temperatures for run, base in zip(trajectories, reference, strict=True)]
            change = np.sqrt(np.mean(np.concatenate(moved) ** 2, axis=0))
            row[:] = [*change, *(shares @ np.stack([run.duty_cycle for run in trajectories])), likelihood]
    return outputs


def _ranked(outputs: FloatArray) -> FloatArray:
    """Outputs [S, O] with the last, the log likelihood, as its rank from 0 to 1: its values span decades."""
    ranks = rankdata(outputs[:, -1], nan_policy="omit") / len(outputs)
    return np.column_stack([outputs[:, :-1], ranks])
