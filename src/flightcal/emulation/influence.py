"""What an emulator's error does to a posterior, and the runs from which that shrinks most."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.linalg import eigh

from ..problem import Problem, Window
from ..simulator import FloatArray
from .emulator import EmulatedSimulator

_CANDIDATES = 300
_JUDGED = 12
"""Posterior draws at which the emulator's share in the posterior is judged."""


def emulated(window: Window) -> EmulatedSimulator:
    """The simulator of a window that has an emulator in its place."""
    assert isinstance(window.simulator, EmulatedSimulator)
    return window.simulator


def influence(problem: Problem, draws: FloatArray, rng: np.random.Generator) -> tuple[float, float]:
    """The emulators' standard deviation over the noise, and by how much it is expected to shift the posterior.

    Where the emulator's error adds E to the covariance V of a posterior that is otherwise the same, it has moved its
    mean by about sqrt(E / V) standard deviations; the direction with the largest, averaged over draws z [S, d].
    """
    sure = [replace(window, simulator=replace(emulated(window), certain=True)) for window in problem.windows]
    certain = replace(problem, windows=tuple(sure))
    shares, shifts = [], []
    for z in rng.choice(draws, min(_JUDGED, len(draws)), replace=False):
        with_error, without = problem.gauss_newton_hessian(z), certain.gauss_newton_hessian(z)
        shifts.append(max(0.0, float(eigh(without, with_error, eigvals_only=True)[-1]) - 1.0))
        theta = problem.to_theta(z)
        deviations = []
        for window, run in zip(problem.windows, problem.simulate(theta), strict=True):
            variance = np.einsum("tnr,r->tn", emulated(window).emulator.error_basis ** 2, run.error_variance)
            deviations.append((variance / window.noise(problem.at(window, theta)) ** 2)[window.valid])
        shares.append(float(np.concatenate(deviations).mean()))
    return math.sqrt(float(np.mean(shares))), math.sqrt(float(np.mean(shifts)))


def most_telling(problem: Problem, draws: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """z [count, d] of those posterior draws [S, d] from whose runs the emulators' part in the posterior shrinks most.

    One after the other, each the draw that most reduces the processes' variance averaged over all draws (Cohn 1996,
    Neural Networks 9, 1071-1083), with the ones before it as if they were run: so they keep apart. A process counts by
    how far its error shifts the posterior, and by its share in the noise.
    """
    drawn = draws[rng.choice(len(draws), min(_CANDIDATES, len(draws)), replace=False)]
    thetas = problem.to_theta(drawn)
    covariances, nuggets, weights = [], [], []
    for window, link, weight in zip(
        problem.windows, problem.links, importance(problem, draws.mean(axis=0)), strict=True
    ):
        emulator = emulated(window).emulator
        z = link.coordinates(drawn, thetas)[:, window.simulated]
        covariances.append(emulator.processes.covariance(emulator.inputs(z)))
        nuggets.append(emulator.processes.nugget * emulator.processes.scale)
        weights.append(weight[: len(nuggets[-1])])
    covariance, nugget, of_process = (np.concatenate(parts) for parts in (covariances, nuggets, weights))
    chosen: list[int] = []
    for _ in range(count):
        variance = np.einsum("rpp->rp", covariance) + nugget[:, None]
        gain = np.einsum("r,rpq,rpq,rq->q", of_process, covariance, covariance, 1.0 / variance)
        gain[chosen] = -np.inf
        best = int(np.argmax(gain))
        chosen.append(best)
        column = covariance[:, :, best]
        covariance = covariance - column[:, :, None] * column[:, None, :] / variance[:, best, None, None]
    return drawn[chosen]


def importance(problem: Problem, z: FloatArray) -> list[FloatArray]:
    """[r] of each window: what a variance of one of each error shape does at z [d] to the mean and to temperatures."""
    theta = problem.to_theta(z)
    hessian, samples = np.diag(problem.priors.precision(z)), sum(window.valid.sum() for window in problem.windows)
    bases, pulled = [], []
    for window, slopes in zip(problem.windows, problem.jacobians(z), strict=True):
        noise = window.noise(problem.at(window, theta))[:, None]
        basis = np.where(window.valid[..., None], emulated(window).emulator.error_basis / noise, 0.0)
        jacobian = np.where(window.valid[..., None], slopes / noise, 0.0)
        hessian = np.einsum("tnd,tne->de", jacobian, jacobian) + hessian
        bases.append(basis)
        pulled.append(np.einsum("tnd,tnr->dr", jacobian, basis))
    return [
        np.einsum("dr,dr->r", part, np.linalg.solve(hessian, part)) + np.einsum("tnr,tnr->r", basis, basis) / samples
        for part, basis in zip(pulled, bases, strict=True)
    ]
