"""What an emulator's error does to a posterior, and the runs from which that shrinks most."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.linalg import eigh

from ..problem import Problem
from ..simulator import FloatArray
from .emulator import EmulatedSimulator

_CANDIDATES = 300
_JUDGED = 12
"""Posterior draws at which the emulator's share in the posterior is judged."""


def emulated(problem: Problem) -> EmulatedSimulator:
    """The simulator of a problem that has an emulator in its place."""
    assert isinstance(problem.simulator, EmulatedSimulator)
    return problem.simulator


def influence(problem: Problem, draws: FloatArray, rng: np.random.Generator) -> tuple[float, float]:
    """The emulator's standard deviation over the noise, and by how much it is expected to shift the posterior.

    Where the emulator's error adds E to the covariance V of a posterior that is otherwise the same, it has moved its
    mean by about sqrt(E / V) standard deviations; the direction with the largest, averaged over draws z [S, d].
    """
    simulator = emulated(problem)
    basis = simulator.emulator.error_basis[simulator.window]
    certain = replace(problem, simulator=replace(simulator, certain=True))
    shares, shifts = [], []
    for z in rng.choice(draws, min(_JUDGED, len(draws)), replace=False):
        with_error, without = problem.gauss_newton_hessian(z), certain.gauss_newton_hessian(z)
        shifts.append(max(0.0, float(eigh(without, with_error, eigvals_only=True)[-1]) - 1.0))
        theta = problem.to_theta(z)
        variance = problem.simulate(theta).error_variance
        deviation = np.einsum("tnr,r->tn", basis**2, variance) / problem.noise(theta) ** 2
        shares.append(float(deviation[problem.valid].mean()))
    return math.sqrt(float(np.mean(shares))), math.sqrt(float(np.mean(shifts)))


def most_telling(problem: Problem, draws: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """z [count, d] of those posterior draws [S, d] from whose runs the emulator's part in the posterior shrinks most.

    One after the other, each the draw that most reduces the processes' variance averaged over all draws (Cohn 1996,
    Neural Networks 9, 1071-1083), with the ones before it as if they were run: so they keep apart. A process counts by
    how far its error shifts the posterior, and by its share in the noise.
    """
    simulator = emulated(problem)
    drawn = draws[rng.choice(len(draws), min(_CANDIDATES, len(draws)), replace=False)]
    processes = simulator.emulator.processes
    z = drawn[:, problem.simulated]
    covariance = processes.covariance(simulator.emulator.inputs(z))
    nugget = processes.nugget * processes.scale
    weight = importance(problem, draws.mean(axis=0))[: len(nugget)]
    chosen: list[int] = []
    for _ in range(count):
        variance = np.einsum("rpp->rp", covariance) + nugget[:, None]
        gain = np.einsum("r,rpq,rpq,rq->q", weight, covariance, covariance, 1.0 / variance)
        gain[chosen] = -np.inf
        best = int(np.argmax(gain))
        chosen.append(best)
        column = covariance[:, :, best]
        covariance = covariance - column[:, :, None] * column[:, None, :] / variance[:, best, None, None]
    return z[chosen]


def importance(problem: Problem, z: FloatArray) -> FloatArray:
    """[r] what a variance of one of each error shape does at z [d] to the posterior's mean and to temperatures."""
    noise = problem.noise(problem.to_theta(z))
    simulator = emulated(problem)
    basis = simulator.emulator.error_basis[simulator.window] / noise[:, None]
    basis = np.where(problem.valid[..., None], basis, 0.0)
    jacobian = np.where(problem.valid[..., None], problem.jacobian(z) / noise[:, None], 0.0)
    pulled = np.einsum("tnd,tnr->dr", jacobian, basis)
    hessian = np.einsum("tnd,tne->de", jacobian, jacobian) + np.diag(problem.priors.precision(z))
    shift = np.einsum("dr,dr->r", pulled, np.linalg.solve(hessian, pulled))
    return shift + np.einsum("tnr,tnr->r", basis, basis) / problem.valid.sum()
