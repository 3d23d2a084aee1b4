"""Which parameters the outputs and the likelihood depend on, over the whole prior.

Variance-based indices by SALib: a parameter's first-order index is the share of an output's variance that it causes
alone, its total index the share that it takes part in (Saltelli et al. 2010, Comput. Phys. Commun. 181, 259). Where a
simulation is dear there is no design for the total index; the first-order index then comes from the prior's draws
(random balance designs with Tissot and Prieur's correction, 2012, Reliab. Eng. Syst. Saf. 107, 205).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import rankdata

from ..calibration import Problem
from ..simulator.system import FloatArray
from .evaluate import Advance, Effort, Runs, in_batches, log_likelihoods

LIKELIHOOD = "log likelihood"
_HARMONICS = 6
_RESAMPLES = 100


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
    """[O] channels (RMS temperature change), heaters (duty cycle), the log likelihood (its rank)."""
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
    prior_runs: tuple[FloatArray, Runs],
    advance: Advance = lambda _: None,
) -> Sensitivity:
    """Indices over the prior of what the simulator takes; noise levels and the like stay as at z [d].

    prior_runs: prior thetas [S, d] and their simulations, from which the indices come where `effort.base` is 0.
    """
    reference = problem.simulate(problem.to_theta(z)).temperatures
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
            advance(part.stop / len(share))
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
        outputs=(*problem.simulator.channels, *problem.simulator.heaters, LIKELIHOOD),
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
    from SALib.analyze import sobol as analysis
    from SALib.sample import sobol as design

    names = [str(k) for k in range(dimension)]
    description = {"num_vars": dimension, "names": names, "bounds": [[0.0, 1.0]] * dimension}
    points = design.sample(description, base, calc_second_order=False, seed=np.random.default_rng(seed))
    outputs = outputs_of(points)
    blocks = outputs.reshape(base, dimension + 2, -1)
    whole = blocks[np.isfinite(blocks).all(axis=(1, 2))].reshape(-1, outputs.shape[1])
    results = []
    for column in whole.T:
        if len(column) < 4 * (dimension + 2) or np.ptp(column) == 0.0:
            results.append(np.zeros((4, dimension)))
            continue
        # A seed of zero is no seed to SALib.
        found = analysis.analyze(description, column, calc_second_order=False, num_resamples=_RESAMPLES, seed=seed + 1)
        results.append(np.array([found[key] for key in ("S1", "S1_conf", "ST", "ST_conf")]))
    return Indices(*np.stack(results, axis=1)), outputs


def given_data(inputs: FloatArray, outputs: FloatArray, seed: int) -> Indices:
    """First-order indices from any sample of inputs [S, d] and outputs [S, O]; samples with NaN are left out."""
    from SALib.analyze import rbd_fast

    whole = np.isfinite(outputs).all(axis=1)
    dimension = inputs.shape[1]
    names = [str(k) for k in range(dimension)]
    description = {"num_vars": dimension, "names": names, "bounds": [[0.0, 1.0]] * dimension}
    results = []
    for column in outputs[whole].T:
        if len(column) < 4 * _HARMONICS or np.ptp(column) == 0.0:
            results.append(np.zeros((2, dimension)))
            continue
        found = rbd_fast.analyze(
            description, inputs[whole], column, M=_HARMONICS, num_resamples=_RESAMPLES, seed=seed + 1
        )
        results.append(np.array([found["S1"], found["S1_conf"]], float))
    first, error = np.stack(results, axis=1)
    return Indices(first, error, np.full_like(first, np.nan), np.full_like(first, np.nan))


def _outputs(problem: Problem, reference: FloatArray, likelihoods: FloatArray, runs: Runs) -> FloatArray:
    """RMS temperature change of each channel, duty of each heater and log likelihood: [S, N + H + 1]."""
    outputs = np.full((len(runs), reference.shape[1] + len(problem.simulator.heaters) + 1), np.nan)
    for row, likelihood, run in zip(outputs, likelihoods, runs, strict=True):
        if run is not None:
            change = np.sqrt(np.mean((run.temperatures - reference) ** 2, axis=0))
            row[:] = [*change, *run.duty_cycle, likelihood]
    return outputs


def _ranked(outputs: FloatArray) -> FloatArray:
    """Outputs [S, O] with the last, the log likelihood, as its rank from 0 to 1: its values span decades."""
    ranks = rankdata(outputs[:, -1], nan_policy="omit") / len(outputs)
    return np.column_stack([outputs[:, :-1], ranks])
