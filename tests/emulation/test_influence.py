"""What an emulator's error does to a posterior, on the small satellite."""

from dataclasses import replace

import numpy as np
import pytest

from flightcal.emulation import gaussian_process
from flightcal.emulation.active import simulated_priors, start_design
from flightcal.emulation.emulator import EmulatedSimulator, fit_emulator
from flightcal.emulation.influence import importance, influence, most_telling
from tests import derivative_free


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    return derivative_free.problem(tmp_path_factory.mktemp("influence"), heater=False)


@pytest.fixture(scope="module")
def rough(problem):
    """A problem with an emulator of few runs through the priors, and draws that stand in for a posterior."""
    scale = simulated_priors(problem)
    runs = derivative_free.empty(problem).add(
        derivative_free.evaluator(problem.simulator)(start_design(scale, 30, seed=1)), 0
    )
    emulator = fit_emulator(runs, scale.to_z(runs.theta), np.array([0.05, 0.05]))
    emulated = replace(problem, simulator=EmulatedSimulator(emulator, scale), open_loop=None)
    z = 0.5 * np.random.default_rng(4).standard_normal((200, len(problem.names)))
    z[:, problem.names.index("noise.body_temp")] -= 3.0
    return emulated, z


def test_the_chosen_runs_lessen_the_emulators_error_more_than_draws_at_random(rough):
    problem, draws = rough
    emulator = problem.simulator.emulator
    processes = emulator.processes
    weight = importance(problem, draws.mean(axis=0))[: len(processes.scale)]
    z = draws[:, problem.simulated]

    def error_with(new):
        """Error of the draws after runs at `new`; a Gaussian process's variance does not depend on what they give."""
        inputs = np.concatenate([processes.inputs, emulator.inputs(new)])
        terms, target = gaussian_process.trend(inputs), np.zeros(len(inputs))
        fields = [
            gaussian_process._condition(inputs, terms, target, processes.lengthscales[j], processes.nugget[j])
            for j in range(len(processes.scale))
        ]
        lengthscales, nugget, _, *rest = (np.ascontiguousarray(np.stack(part)) for part in zip(*fields, strict=True))
        conditioned = gaussian_process.GaussianProcesses(inputs, lengthscales, nugget, processes.scale, *rest)
        return sum(conditioned.predict(x)[1] @ weight for x in emulator.inputs(z))

    chosen = error_with(most_telling(problem, draws, 6, np.random.default_rng(0)))
    at_random = [error_with(z[6 * k : 6 * k + 6]) for k in range(10)]
    assert chosen < min(at_random)
    assert chosen < 0.5 * error_with(z[:0])


def test_the_expected_shift_is_the_share_of_the_emulators_error_in_the_posterior(rough):
    problem, draws = rough
    simulator = problem.simulator
    processes = simulator.emulator.processes

    def shift(factor):
        smaller = replace(processes, scale=factor * processes.scale)
        principal = replace(
            simulator.emulator.principal, tail_variance=factor * simulator.emulator.principal.tail_variance
        )
        emulator = replace(simulator.emulator, processes=smaller, principal=principal)
        changed = replace(problem, simulator=replace(simulator, emulator=emulator))
        return influence(changed, draws, np.random.default_rng(1))

    (share, moved), (less_share, less_moved) = shift(1e-4), shift(1e-6)
    assert share == pytest.approx(10.0 * less_share, rel=1e-6)
    assert moved == pytest.approx(10.0 * less_moved, rel=0.1)
    z = draws[0]
    certain = replace(problem, simulator=replace(simulator, certain=True))
    assert np.linalg.eigvalsh(certain.gauss_newton_hessian(z) - problem.gauss_newton_hessian(z))[-1] > 0.0
