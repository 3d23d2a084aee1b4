"""What flows in the full network where a reduced model may take heat that no block describes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..simulator import FloatArray, flow_through, heat_of_inputs
from .file import Task
from .full_order import window_simulator
from .names import node_name
from .projection import merged_columns
from .spacecraft import medians_of


@dataclass(frozen=True)
class FullHeat:
    """Of the full network at the priors' medians; sizes of unmodelled heat are relative to it."""

    nodes: tuple[str, ...]
    """[n] that have a capacity, by their plain names, in the order of `ReducedModel.full`."""
    flow: FloatArray
    """[n] W, mean absolute heat through each."""
    brought: FloatArray
    """[n, w] W that a unit of each of the reduced model's input series brings to each."""


def full_heat(task: Task) -> FullHeat:
    """In the first training window, after the settling. Raises SimulationFailure."""
    window = next(iter(task.reduction.training.windows.values()))
    scenario, (start, end) = task.with_timeline(window), task.bounds(window)
    medians = medians_of(scenario)
    whole, times = window_simulator(scenario, start, end, task.period, every_node=True)
    network = whole.network
    names = [network.nodes[k] for k in network.diffusive]
    written = [scenario.network.nodes[name].initial for name in names]
    run = whole.simulate(np.concatenate([medians, np.array(written, float)]))
    first = int(np.searchsorted(times, start + np.timedelta64(round(task.settling * 1e9), "ns")))
    settled, _ = window_simulator(scenario, times[first], end, task.period)
    settled = replace(settled, drive=replace(settled.drive, initially_on=run.status[first]))
    theta = np.concatenate([medians, run.temperatures[first, network.diffusive]])
    _, _, gather = merged_columns(network, scenario)
    return FullHeat(
        tuple(map(node_name, names)),
        flow_through(settled, scenario, names, theta),
        heat_of_inputs(settled, names, theta) @ gather,
    )
