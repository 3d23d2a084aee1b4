"""Runs of the full network: prior draws in windows of flight, every node kept."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import xarray

from ..errors import FlightcalError
from ..probability import Priors
from ..progress import SILENT, Progress
from ..scenario import Scenario
from ..simulator import FloatArray, NetworkSimulator, Observation, Sensors, Switch, Times, network_simulator
from .file import Task
from .schema import FlightWindow, Runs

SAMPLING = 60.0  # s, of the runs
_LEAST_TEMPERATURE = 3.0  # K


@dataclass(frozen=True)
class FullRuns:
    """Simulations of the full network in one window, from the end of the settling on."""

    window: str
    scenario: Scenario
    """With the window's timeline."""
    nodes: tuple[str, ...]
    """Of the network [n]."""
    start: np.datetime64
    end: np.datetime64
    times: Times
    """[T] UTC, the first at `start`."""
    parameters: FloatArray
    """[S, d] of the scenario's parameters."""
    temperatures: FloatArray
    """[S, T, n] K, of all nodes, massless ones too."""
    observed: FloatArray
    """[S, T, N] K, of the scenario's channels."""
    status: FloatArray
    """[S, T, H]."""
    duty: FloatArray
    """[S, H] share of the time from `start` to `end` that each heater is on."""


def window_simulator(
    scenario: Scenario, start: np.datetime64, end: np.datetime64, period: float, *, every_node: bool = False
) -> tuple[NetworkSimulator, Times]:
    """The full network on a window, sampled every minute; its channels are the scenario's, or all nodes."""
    count = int((end - start) / np.timedelta64(round(SAMPLING * 1e9), "ns"))
    times = start + np.arange(count + 1) * np.timedelta64(round(SAMPLING * 1e9), "ns")
    simulator = network_simulator(scenario, xarray.Dataset(), start, end, times, period=period)
    if every_node:
        nodes = simulator.network.nodes
        # Errors that are none: those of any of the sensors.
        simulator = replace(
            simulator,
            channels=nodes,
            observation=Observation(
                simulator.observation.times, Sensors(np.arange(len(nodes)), np.zeros(len(nodes), np.bool_))
            ),
            channel_errors=np.tile(simulator.channel_errors[:, :1], len(nodes)),
        )
    return simulator, times


def run_full(task: Task, runs: Runs, progress: Progress = SILENT) -> list[FullRuns]:
    """The runs that the file asks for; a draw whose simulation fails is left out.

    Raises FlightcalError where all of a window fail.
    """
    rng = np.random.default_rng(runs.seed)
    found = []
    for k, (name, window) in enumerate(runs.windows.items()):
        found.append(_run_window(task, name, window, rng, runs.draws))
        progress.at((k + 1) / len(runs.windows))
    return found


def _run_window(task: Task, name: str, window: FlightWindow, rng: np.random.Generator, draws: int) -> FullRuns:
    scenario = task.with_timeline(window)
    start, end = task.bounds(window)
    simulator, times = window_simulator(scenario, start, end, task.period, every_node=True)
    parameters = prior_draws(scenario, rng, draws)
    initial = initial_draws(scenario, simulator, rng, draws, task.reduction.initial_spread)
    trajectories = simulator.simulate_many(np.concatenate([parameters, initial], axis=1))
    kept = [k for k, trajectory in enumerate(trajectories) if trajectory is not None]
    done = [trajectory for trajectory in trajectories if trajectory is not None]
    if not done:
        raise FlightcalError(
            f"window '{name}': every simulation of the full network fails or is not finite; check the spacecraft's "
            "capacities and links, and the priors of the parameters"
        )
    first = int(np.searchsorted(times, start + np.timedelta64(round(task.settling * 1e9), "ns")))
    temperatures = np.stack([trajectory.temperatures[first:] for trajectory in done])
    sensors = [simulator.network.nodes.index(item.node or "") for item in scenario.observations.values()]
    last = times[-1]
    begin, finish = (float((time - start) / np.timedelta64(1, "s")) for time in (times[first], last))
    return FullRuns(
        name,
        scenario,
        simulator.network.nodes,
        times[first],
        last,
        times[first:],
        parameters[kept],
        temperatures,
        temperatures[..., sensors],
        np.stack([trajectory.status[first:] for trajectory in done]),
        np.stack([share_of_time(run.switches, run.status[0], begin, finish) for run in done]),
    )


def share_of_time(switches: Switch, at_start: FloatArray, first: float, last: float) -> FloatArray:
    """Share of first..last (s) that each heater is on [H]; at_start: [H] their status at the window's start, 0."""
    on, since = at_start.copy(), np.full(len(at_start), first)
    total = np.zeros(len(at_start))
    for time, heater, now in zip(*switches, strict=True):
        clipped = min(max(time, first), last)
        total[heater] += on[heater] * (clipped - since[heater])
        since[heater], on[heater] = clipped, now
    return np.asarray((total + on * (last - since)) / (last - first))


def prior_draws(scenario: Scenario, rng: np.random.Generator, draws: int) -> FloatArray:
    """Parameters [draws, d]: prior draws, spread evenly over each prior (Latin hypercube)."""
    names = tuple(scenario.parameters)
    priors = Priors(names, tuple(scenario.parameters[name].prior for name in names))
    ranks = np.stack([rng.permutation(draws) for _ in names], axis=1)
    return priors.quantile((ranks + rng.random(ranks.shape)) / draws)


def initial_draws(
    scenario: Scenario, simulator: NetworkSimulator, rng: np.random.Generator, draws: int, spread: float
) -> FloatArray:
    """Initial temperatures [draws, nodes with a capacity]: the written ones, an offset to all, and one to each."""
    names = [simulator.network.nodes[k] for k in simulator.network.diffusive]
    written = np.array([scenario.network.nodes[name].initial for name in names], float)
    offsets = spread * (rng.standard_normal((draws, 1)) + rng.standard_normal((draws, len(names))))
    return np.maximum(written + offsets, _LEAST_TEMPERATURE)
