"""The compiled integration without what is around it, as the sampler runs it: alone, and with its adjoint."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from flightcal.compiled import Program
from flightcal.problem import Problem
from flightcal.simulator import Drive, NetworkSimulator, Structure
from flightcal.simulator.integrate import NOTHING, Integration


def integration_alone(problem: Problem, z: Any) -> Callable[[], Any]:
    """What `problem.log_density_and_gradient(z)` spends its time in: the same integration and adjoint, nothing else."""
    assert isinstance(problem.windows[0].simulator, NetworkSimulator)
    calls = problem.windows[0].simulator.calls()
    calls.simulate(problem.to_theta(z)[problem.windows[0].simulated])
    calls.temperatures_bar[:] = 1.0
    calls.run_backward.run()
    return Program([calls.integration.forward, calls.integration.adjoint]).run


def forward_alone(structure: Structure, packed: Any, drive: Drive) -> Callable[[], Any]:
    """A function that simulates a packed system [P] and returns states [K+1, n].

    Everything that is not the simulation is done here, once: its memory and arguments are prepared.
    """
    run = Integration(structure, drive, NOTHING)
    run.packed[0] = packed
    return lambda: (run.forward(), run.states)[1]
