"""An external simulator as a calibration sees it: theta in, telemetry out, and a record of every run."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from time import perf_counter

import numpy as np

from ..errors import ScenarioError
from ..scenario import ExternalModel, Numbers, Scenario, kind_of_simulator, numbers_of
from ..simulator import FloatArray, IntArray, SimulationFailure, Switch, Trajectory, cores
from ._processes import kill_all
from .program import ExternalProgram, RunFailure, checked
from .record import FINISHED, Outcome, Record

_WORTH_ANOTHER_TRY = ("crashed", "timed out", "partial output", "unreachable")


@dataclass(frozen=True)
class Inputs:
    """From theta to what the simulator takes, and back for derivatives."""

    names: tuple[str, ...]
    """[I] as the simulator calls them."""
    numbers: Numbers
    """[I + N] the inputs, then the channels' biases."""
    factors: FloatArray
    """[I] from SI to the simulator's units: factor * SI + offset."""
    offsets: FloatArray

    def given(self, values: FloatArray) -> dict[str, float]:
        """What the simulator gets, by its own names and in its own units."""
        numbers = self.factors * values[: len(self.names)] + self.offsets
        return dict(zip(self.names, numbers.tolist(), strict=True))


@dataclass(frozen=True)
class ExternalSimulator:
    """A simulator that is not ours, on one window; a `Simulator`.

    theta is the scenario's parameters followed by ``initial.<output>`` for every input that is an initial temperature.
    Plain data, so that it can be sent to another machine.
    """

    kind: str
    parameters: tuple[str, ...]
    inputs: Inputs
    program: ExternalProgram
    times: FloatArray
    """[T] s from the window's start."""
    duration: float
    """Of the window, s."""
    outputs: tuple[str, ...]
    """All that the simulator gives, as the scenario calls them."""
    output_offsets: FloatArray
    """Kelvin to add to each."""
    channels: tuple[str, ...]
    channel_outputs: IntArray
    """[N] the output that each channel measures."""
    heaters: tuple[str, ...]
    heater_inputs: IntArray
    """[H] the input that is the heater's power; -1: see `powers`."""
    powers: FloatArray
    """[H] W; NaN where it is not known."""
    timeout: float
    retries: int

    @property
    def error_basis(self) -> FloatArray | None:
        """None: it stands in for no other simulator."""
        return None

    def heater_power(self, theta: FloatArray) -> FloatArray:
        """Power [H] W of each heater while it is on, at theta [d]; NaN where it is not known."""
        return np.where(self.heater_inputs >= 0, self.inputs.numbers.at(theta)[self.heater_inputs], self.powers)

    def run(self, theta: FloatArray) -> Record:
        """One run at theta [d], tried again as often as the scenario says; failures are in the record, not raised."""
        return self._run(theta, lambda: False)

    def _run(self, theta: FloatArray, stopped: Callable[[], bool]) -> Record:
        values = self.inputs.numbers.at(theta)
        attempts = 0
        while True:
            attempts += 1
            started = perf_counter()
            try:
                temperatures, status = self._attempt(values)
                return Record(theta, FINISHED, "", attempts, perf_counter() - started, temperatures, status)
            except RunFailure as failure:
                if attempts <= self.retries and failure.outcome in _WORTH_ANOTHER_TRY and not stopped():
                    continue
                seconds, samples = perf_counter() - started, len(self.times)
                nothing = np.full((samples, len(self.channels)), np.nan), np.full((samples, len(self.heaters)), np.nan)
                return Record(theta, failure.outcome, failure.message, attempts, seconds, *nothing)

    def run_many(self, thetas: FloatArray) -> list[Record]:
        """Runs at thetas [S, d], at most one for each core at a time; their order is kept."""
        stop = threading.Event()
        pool = ThreadPoolExecutor(max(1, min(cores(), len(thetas))))
        try:
            # The threads only wait; each run is a process of its own.
            return [future.result() for future in [pool.submit(self._run, theta, stop.is_set) for theta in thetas]]
        except KeyboardInterrupt:
            stop.set()
            pool.shutdown(wait=False, cancel_futures=True)
            kill_all()
            raise
        finally:
            pool.shutdown()

    def simulate(self, theta: FloatArray) -> Trajectory:
        """One simulation at theta [d]. Raises SimulationFailure with what the record says."""
        record = self.run(theta)
        if record.outcome != FINISHED:
            raise self._failure(record.outcome, record.message)
        return self.trajectory(record)

    def simulate_many(self, thetas: FloatArray) -> list[Trajectory | None]:
        """Simulations at thetas [S, d], in parallel; None where one failed."""
        return [self.trajectory(record) if record.outcome == FINISHED else None for record in self.run_many(thetas)]

    def linearise(self, theta: FloatArray) -> tuple[Trajectory, Callable[..., FloatArray]]:
        """A simulation and its vector-Jacobian product, where the simulator gives a gradient.

        Raises SimulationFailure, and ScenarioError where there is no gradient.
        """
        try:
            has_gradient = self.program.has_gradient
        except RunFailure as failure:
            raise self._failure(failure.outcome, failure.message) from None
        if not has_gradient:
            message = f"simulator: found no gradient ({self.kind}), expected one: NUTS needs it. Calibrate through"
            raise ScenarioError(f"{message} an emulator of this simulator")
        trajectory = self.simulate(theta)
        values = self.inputs.numbers.at(theta)

        def cotangent(temperatures_bar: FloatArray) -> FloatArray:
            outputs_bar = np.zeros((len(self.times), len(self.outputs)))
            np.add.at(outputs_bar.T, self.channel_outputs, temperatures_bar.T)
            try:
                given_bar = self.program.pull_back(self.inputs.given(values), outputs_bar, self.timeout)
            except RunFailure as failure:
                raise self._failure(failure.outcome, failure.message) from None
            if given_bar.shape != self.inputs.factors.shape or not np.isfinite(given_bar).all():
                wanted = f"{len(self.inputs.factors)} finite numbers"
                raise SimulationFailure(f"the {self.kind} gives a gradient of {given_bar}, expected {wanted}")
            values_bar = np.concatenate([given_bar * self.inputs.factors, temperatures_bar.sum(axis=0)])
            return self.inputs.numbers.pull_back(theta, values_bar)

        return trajectory, cotangent

    def trajectory(self, record: Record) -> Trajectory:
        """A finished run as a trajectory; heaters switch where their status at the samples changes."""
        return Trajectory(
            temperatures=record.temperatures,
            status=record.status,
            duty_cycle=self._sample_weights @ record.status,
            switches=status_switches(self.times, record.status),
        )

    @cached_property
    def _sample_weights(self) -> FloatArray:
        """[T] share of the window that each sample stands for: from halfway to its neighbours."""
        edges = np.concatenate([[0.0], (self.times[1:] + self.times[:-1]) / 2, [max(self.duration, self.times[-1])]])
        weights: FloatArray = np.diff(edges) / (edges[-1] - edges[0])
        return weights

    def _failure(self, outcome: Outcome, message: str) -> SimulationFailure:
        return SimulationFailure(f"{self.kind}: {outcome}: {message}")

    def _attempt(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        outputs = self.program.run(self.inputs.given(values), self.timeout)
        temperatures, status = checked(outputs, len(self.times), self.outputs, self.heaters)
        biases = values[len(self.inputs.names) :]
        return (temperatures + self.output_offsets)[:, self.channel_outputs] + biases, status


def build_inputs(scenario: Scenario, model: ExternalModel, channels: Sequence[str]) -> tuple[tuple[str, ...], Inputs]:
    """Names of theta's entries, and the map from theta to what the simulator takes."""
    parameters = scenario.parameters.values()
    values = {f"inputs.{name}": item.si[1] for name, item in model.inputs.items()}
    values |= {f"observations.{channel}.bias": scenario.observations[channel].bias for channel in channels}
    initial = {item.initial_of: f"inputs.{name}" for name, item in model.inputs.items() if item.initial_of is not None}
    entries = [*((item.sets, item.scales) for item in parameters), *(((path,), ()) for path in initial.values())]
    items = list(model.inputs.values())
    return (*scenario.parameters, *(f"initial.{output}" for output in initial)), Inputs(
        names=tuple(item.name or name for name, item in model.inputs.items()),
        numbers=numbers_of(values, entries),
        factors=np.array([item.scale[0] for item in items]),
        offsets=np.array([item.scale[1] for item in items]),
    )


def external_simulator(
    scenario: Scenario, model: ExternalModel, program: ExternalProgram, times: FloatArray, duration: float
) -> ExternalSimulator:
    """The simulator of a scenario on a window of `duration` s, observed at `times` [T] s from its start."""
    channels = tuple(name for name, item in scenario.observations.items() if item.output is not None)
    names, inputs = build_inputs(scenario, model, channels)
    outputs = tuple(model.outputs)
    powers = [heater.power for heater in model.heaters.values()]
    input_names = list(model.inputs)
    return ExternalSimulator(
        kind=kind_of_simulator(model) or "",
        parameters=names,
        inputs=inputs,
        program=program,
        times=times,
        duration=duration,
        outputs=outputs,
        output_offsets=np.array([output.offset for output in model.outputs.values()]),
        channels=channels,
        channel_outputs=np.array([outputs.index(scenario.observations[name].output or "") for name in channels]),
        heaters=tuple(model.heaters),
        heater_inputs=np.array([input_names.index(p) if isinstance(p, str) else -1 for p in powers], dtype=np.int64),
        powers=np.array([p if isinstance(p, float) else np.nan for p in powers]),
        timeout=model.timeout,
        retries=model.retries,
    )


def status_switches(seconds: FloatArray, status: FloatArray) -> Switch:
    """Changes in a status [T, H] at `seconds` [T], each at the first sample after it; NaN, unknown, is passed over."""
    time: list[float] = []
    heater: list[int] = []
    on: list[float] = []
    for h in range(status.shape[1]):
        known = np.flatnonzero(np.isfinite(status[:, h]))
        state = np.asarray(status[known, h] > 0.5)
        changed = 1 + np.flatnonzero(state[1:] != state[:-1])
        time += seconds[known[changed]].tolist()
        heater += [h] * len(changed)
        on += state[changed].astype(float).tolist()
    order = np.argsort(time, kind="stable")
    return Switch(np.array(time)[order], np.array(heater, dtype=np.int64)[order], np.array(on)[order])
