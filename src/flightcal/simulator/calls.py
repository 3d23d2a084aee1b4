"""The C calls that simulate a network: memory, and rows of kernels from theta to what is observed, and back."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..compiled import Program, Row
from .assembly import assembly_memory
from .integrate import Integration, check_outcome
from .kernels.assembly import AssembleCall, PullBackCall, pull_back
from .kernels.assembly import assemble as assemble_kernel
from .kernels.elimination import EliminateCall, PullBackEliminationCall, pull_back_elimination
from .kernels.elimination import eliminate as eliminate_kernel
from .system import FloatArray, packed_size

if TYPE_CHECKING:
    from .simulate import NetworkSimulator


class Calls:
    """Memory and C calls of one simulator, for one thread at a time: theta to what is observed, and back.

    Fill the first rows of `thetas` [S, d], and `simulations`; `forward` then fills `outputs`, and `backward`, where
    there is room for one simulation, `theta_bar` [d] from `temperatures_bar` [T, N] and `switches_bar`.
    """

    def __init__(
        self,
        simulator: NetworkSimulator,
        *,
        rooms: int = 1,
        lanes: int = 1,
        derivative: bool = False,
        scatter: int = 0,
        acting: int = 0,
    ) -> None:
        mapping, terms, places = simulator.mapping, simulator.network.terms, simulator.channel_errors
        self.integration = of = Integration(
            simulator.integrated, simulator.drive, simulator.looked_at,
            rooms=rooms, lanes=lanes, derivative=derivative, scatter=scatter, acting=acting,
        )  # fmt: skip
        whole, whole_bar, eliminating, uneliminating = _elimination_calls(simulator, of)
        self.simulations, self.outputs = of.simulations, of.outputs
        self.temperatures_bar, self.switches_bar = of.temperatures_bar, of.switches_bar
        self.thetas, self.theta_bar = np.empty((rooms, len(simulator.parameters))), np.empty(len(simulator.parameters))
        self.numbers = np.empty((rooms, len(mapping.written)))
        memory = assembly_memory(mapping, terms)
        assembling = AssembleCall(
            of.simulations, mapping, terms, places, self.thetas, memory, self.numbers, whole, of.errors
        )
        pulling = PullBackCall(
            mapping, terms, places, self.thetas, self.numbers, whole_bar, of.errors_bar, memory, self.theta_bar
        )
        self.forward = (assemble_kernel.row(assembling), *eliminating, of.forward)
        self.backward = (of.adjoint, *uneliminating, pull_back.row(pulling))
        self.theta: FloatArray | None = None
        """What was simulated last, the very array: where another comes in between, it is simulated again."""

    @cached_property
    def run_forward(self) -> Program:
        """`forward` as one C call."""
        return Program(self.forward)

    @cached_property
    def run_backward(self) -> Program:
        """`backward` as one C call."""
        return Program(self.backward)

    def simulate(self, theta: FloatArray) -> None:
        """One simulation at theta [d]. Raises SimulationFailure."""
        if self.theta is not theta:
            self.thetas[0], self.theta = theta, None
            check_outcome(self.run_forward.run())
            self.theta = theta


def _elimination_calls(
    simulator: NetworkSimulator, of: Integration
) -> tuple[FloatArray, FloatArray, tuple[Row, ...], tuple[Row, ...]]:
    """The network's packed systems [S, W] and their cotangent [W]; calls from these to those that are integrated, and
    back.
    """
    elimination = simulator.elimination
    if elimination is None:
        return of.packed, of.packed_bar, (), ()
    size, plan = packed_size(simulator.network.structure), elimination.plan
    whole, whole_bar = np.empty((len(of.packed), size)), np.empty(size)
    entries, entries_bar = np.empty((2, elimination.entries))
    there = EliminateCall(of.simulations, plan, whole, entries, of.packed)
    back = PullBackEliminationCall(plan, entries, entries_bar, of.packed_bar, whole_bar)
    return whole, whole_bar, (eliminate_kernel.row(there),), (pull_back_elimination.row(back),)
