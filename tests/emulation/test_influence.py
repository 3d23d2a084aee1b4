"""What an emulator's error does to a posterior, on the small satellite."""

from dataclasses import replace

import numpy as np
import pytest

from flightcal.emulation import gaussian_process
from flightcal.emulation.design import start_design
from flightcal.emulation.emulator import fit_emulator, simulated_priors, with_emulator
from flightcal.emulation.influence import importance, influence, most_telling
from tests import derivative_free


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    return derivative_free.problem(tmp_path_factory.mktemp("influence"), heater=False)


@pytest.fixture(scope="module")
def rough(problem):
    """A problem with an emulator of few runs through the priors, and draws that stand in for a posterior."""
    (window,) = problem.windows
    scale = simulated_priors(window)
    runs = derivative_free.runs_at(window, start_design(scale, 30, seed=1))
    emulator = fit_emulator(runs, scale, np.array([0.05, 0.05]))
    emulated = replace(problem, windows=(with_emulator(window, emulator),), open_loop=None)
    z = 0.5 * np.random.default_rng(4).standard_normal((200, len(problem.names)))
    z[:, problem.names.index("noise.body_temp")] -= 3.0
    return emulated, z


def test_the_chosen_runs_lessen_the_emulators_error_more_than_draws_at_random(rough):
    problem, draws = rough
    emulator = problem.windows[0].simulator.emulator
    processes = emulator.processes
    weight = importance(problem, draws.mean(axis=0))[0][: len(processes.scale)]
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

    chosen = error_with(most_telling(problem, draws, 6, np.random.default_rng(0))[:, problem.simulated])
    at_random = [error_with(z[6 * k : 6 * k + 6]) for k in range(10)]
    assert chosen < min(at_random)
    assert chosen < 0.5 * error_with(z[:0])


def test_the_expected_shift_is_the_share_of_the_emulators_error_in_the_posterior(rough):
    problem, draws = rough
    (window,) = problem.windows
    simulator = window.simulator
    processes = simulator.emulator.processes

    def simulated_by(other):
        return replace(problem, windows=(replace(window, simulator=other),))

    def shift(factor):
        smaller = replace(processes, scale=factor * processes.scale)
        principal = replace(
            simulator.emulator.principal, tail_variance=factor * simulator.emulator.principal.tail_variance
        )
        emulator = replace(simulator.emulator, processes=smaller, principal=principal)
        return influence(simulated_by(replace(simulator, emulator=emulator)), draws, np.random.default_rng(1))

    (share, moved), (less_share, less_moved) = shift(1e-4), shift(1e-6)
    assert share == pytest.approx(10.0 * less_share, rel=1e-6)
    assert moved == pytest.approx(10.0 * less_moved, rel=0.1)
    z = draws[0]
    certain = simulated_by(replace(simulator, certain=True))
    assert np.linalg.eigvalsh(certain.gauss_newton_hessian(z) - problem.gauss_newton_hessian(z))[-1] > 0.0
