"""The simulator that a scenario describes, whatever its kind, with its error where it has one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import xarray

from ..external import build_external
from ..reduction import load, network_for, shapes
from ..scenario import Scenario, SimulatorModel
from ..simulator import FloatArray, NetworkSimulator, Simulator, Switch, Times, Trajectory, network_simulator


@dataclass(frozen=True)
class InexactSimulator:
    """A network in the place of a slower simulator, with its error at any theta."""

    exact: NetworkSimulator
    error_basis: FloatArray
    """[T, N, r] K"""
    error_variance: FloatArray
    """[r]"""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of theta's entries."""
        return self.exact.parameters

    @property
    def channels(self) -> tuple[str, ...]:
        """Temperature channels."""
        return self.exact.channels

    @property
    def heaters(self) -> tuple[str, ...]:
        """Names of the heaters."""
        return self.exact.heaters

    def heater_power(self, theta: FloatArray) -> FloatArray:
        """Power [H] W of each heater while it is on, at theta [d]."""
        return self.exact.heater_power(theta)

    def simulate(self, theta: FloatArray) -> Trajectory:
        """One simulation at theta [d]."""
        return replace(self.exact.simulate(theta), error_variance=self.error_variance)

    def simulate_many(self, thetas: FloatArray) -> list[Trajectory | None]:
        """Simulations at thetas [S, d], in parallel; None where one failed."""
        return self._with_error(self.exact.simulate_many(thetas))

    def simulate_scattered(self, thetas: FloatArray, rng: np.random.Generator) -> list[Trajectory | None]:
        """As that of the network."""
        return self._with_error(self.exact.simulate_scattered(thetas, rng))

    def _with_error(self, runs: list[Trajectory | None]) -> list[Trajectory | None]:
        return [None if run is None else replace(run, error_variance=self.error_variance) for run in runs]

    def linearise(self, theta: FloatArray) -> tuple[Trajectory, Callable[..., FloatArray]]:
        """A simulation and its vector-Jacobian product; the error's variances do not depend on theta."""
        trajectory, cotangent = self.exact.linearise(theta)

        def product(
            temperatures_bar: FloatArray, error_variance_bar: FloatArray, switches_bar: FloatArray | None = None
        ) -> FloatArray:
            return cotangent(temperatures_bar, switches_bar=switches_bar)

        return replace(trajectory, error_variance=self.error_variance), product

    def threshold_excess(
        self, theta: FloatArray, switches: Switch
    ) -> tuple[FloatArray, Callable[[FloatArray], FloatArray]]:
        """As that of the network."""
        return self.exact.threshold_excess(theta, switches)


def build_simulator(
    scenario: Scenario,
    telemetry: xarray.Dataset,
    start: np.datetime64,
    end: np.datetime64,
    samples: Times,
    *,
    period: float,
) -> Simulator:
    """The simulator of a scenario on the window [start, end], observed at `samples` [T] (UTC).

    Raises ScenarioError and TelemetryError.
    """
    model = scenario.simulator
    if not isinstance(model, SimulatorModel):
        return build_external(scenario, telemetry, start, end, samples, period=period)
    network = None
    if model.reduced_model is not None:
        network = network_for(load(scenario.folder / model.reduced_model).model, scenario)
    exact = network_simulator(scenario, telemetry, start, end, samples, period=period, network=network)
    if not model.errors:
        return exact
    seconds: FloatArray = (samples - start) / np.timedelta64(1, "ns") * 1e-9
    return InexactSimulator(exact, *shapes(model.errors, exact.channels, seconds))
