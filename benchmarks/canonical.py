"""The canonical form of the benchmarks' problem for the peers, in JAX from z on: flightcal's very equations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from tests.oracle import dense, jax, jnp

from flightcal.problem import Problem
from flightcal.scenario import LogNormal, Normal, Prior, TruncatedNormal, Uniform
from flightcal.simulator import Drive, NetworkSimulator, Structure, System
from flightcal.simulator.sampling import locate
from flightcal.simulator.system import packed_bounds

from .problem import drives_of_peers

ndtr, ndtri = jax.scipy.special.ndtr, jax.scipy.special.ndtri


@dataclass(frozen=True)
class Canonical:
    """The problem as the peers get it: JAX functions of theta, and the drive."""

    problem: Problem
    structure: Structure
    drive: Drive
    """Linear between grid points, as peers take it; the telemetry's times are grid points."""
    exact: Drive
    """With the inputs as they are known at most: of the reference."""

    @property
    def simulator(self) -> NetworkSimulator:
        """flightcal's simulator, for its numbers only."""
        assert isinstance(self.problem.windows[0].simulator, NetworkSimulator)
        return self.problem.windows[0].simulator

    def system(self, theta: Any) -> System:
        """The entries at theta [d], differentiable by JAX: the same table of terms that flightcal's assembly reads."""
        simulator = self.simulator
        theta = theta[self.problem.windows[0].simulated]
        network, mapping, terms = simulator.network, simulator.mapping, simulator.network.terms
        values = jnp.asarray(network.values).at[mapping.set_positions].set(theta[mapping.set_by])
        values = values.at[mapping.scaled_positions].multiply(theta[mapping.scaled_by], unique_indices=True)
        extended = jnp.concatenate([values, jnp.ones(1), 1.0 / values[terms.inverse]])
        products = terms.constant * jnp.prod(extended[terms.factors], axis=1)
        entries = jnp.zeros(terms.entries).at[terms.entry].add(products)
        s = self.structure
        return System(*jnp.split(jnp.concatenate([entries, theta[mapping.parameters :]]), packed_bounds(s)))

    def dense(self, theta: Any) -> tuple[Any, Any, Any, Any, Any, Any, Any]:
        """A, N [n, n], heat [K+1, n] on the drive's grid, g [H, n], lower, upper [H], x0 [n]; K and seconds."""
        system = self.system(theta)
        A, N, _, B, g = dense(self.structure, system)
        inputs = np.concatenate([self.drive.inputs[:1, 0], self.drive.inputs[:, 1]])
        heat = jnp.asarray(inputs[:, : B.shape[1]]) @ B.T
        return A, N, heat, g, system.lower, system.upper, system.initial

    def observe(self, states: Any) -> Any:
        """Temperatures [T, N] of states [K+1, n] on the grid."""
        observation = self.simulator.observation
        place, channels = locate(observation.times, self.drive.times), observation.sensors.state
        weight = place.weight[:, None]
        return (1 - weight) * states[place.point][:, channels] + weight * states[place.point + 1][:, channels]

    def to_theta(self, z: Any) -> Any:
        """Physical theta [d] of z [d]; every prior here is N(0, 1) in z (see `flightcal.probability.priors`)."""
        return jnp.stack([_quantile(prior, z[k]) for k, prior in enumerate(self.problem.priors.priors)])

    def log_density(self, z: Any, temperatures: Any) -> Any:
        """Log density of z [d]; `temperatures`: theta -> [T, N]. No sample of this problem is missing."""
        theta = self.to_theta(z)
        scaled = (self.problem.windows[0].observed - temperatures(theta)) / self.problem.windows[0].noise(
            self.problem.priors.median()
        )
        constant = self.problem.windows[0].observed.shape[0] * np.sum(
            np.log(self.problem.windows[0].noise(self.problem.priors.median()) * np.sqrt(2 * np.pi))
        )
        log_prior = jnp.sum(jax.scipy.stats.norm.logpdf(z))
        return log_prior - 0.5 * jnp.sum(scaled**2) - constant


def _quantile(prior: Prior, score: Any) -> Any:
    """theta where the standard normal has `score`."""
    match prior:
        case Uniform():
            return prior.lower + (prior.upper - prior.lower) * ndtr(score)
        case Normal():
            return prior.mean + prior.standard_deviation * score
        case LogNormal():
            return jnp.exp(np.log(prior.median) + np.log(prior.factor) * score)
        case TruncatedNormal():
            low, high = (ndtr((end - prior.mean) / prior.standard_deviation) for end in (prior.lower, prior.upper))
            return prior.mean + prior.standard_deviation * ndtri(low + (high - low) * ndtr(score))
        case _:
            raise NotImplementedError(f"the benchmarks' problem has no {type(prior).__name__} prior")


def canonical(problem: Problem) -> Canonical:
    """The canonical form of a problem whose noise is fixed and whose nodes all have a capacity."""
    simulator = problem.windows[0].simulator
    assert isinstance(simulator, NetworkSimulator)
    assert len(problem.simulated) == len(problem.names)
    assert simulator.network.structure.mass.all()
    return Canonical(problem, simulator.network.structure, *drives_of_peers(problem))
