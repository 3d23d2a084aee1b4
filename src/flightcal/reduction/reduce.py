"""From a reduction file to reduced models: runs of the full network, a search for the order, the chosen model."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import FlightcalError
from ..progress import SILENT, Progress
from ..simulator import Network, build_network
from .affine import decompose
from .candidate import Errors, errors_of
from .file import Task
from .full_order import FullRuns, run_full
from .projection import choose_shapes, collect, project
from .reduced_model import ReducedModel
from .spacecraft import medians_of

MARGIN = 0.4
"""Of the tolerance that training runs must keep. Unseen ones may be worse."""
_JUDGING_STEP = 60.0  # s; steps are chosen for the model that is
_JUDGING_DRAWS = 8
"""Training runs of each window that a size is judged on."""


@dataclass(frozen=True)
class Tried:
    """A size and how it did on training runs."""

    states: int
    massless: int
    error: float
    """K, the quantile of the absolute errors that the tolerance is for; infinite where a simulation failed."""


@dataclass(frozen=True)
class Reduced:
    """The result."""

    model: ReducedModel
    tried: tuple[Tried, ...]
    held_out: tuple[Errors, ...]
    runs: tuple[FullRuns, ...]
    """Held out."""


def reduce(task: Task, progress: Progress = SILENT) -> Reduced:
    """Run the full network, choose the smallest model that keeps the tolerance, and judge it on held-out runs.

    Raises FlightcalError where sizes do not fit the network.
    """
    with progress.stage("full network, training", 1.0) as flying:
        training = run_full(task, task.reduction.training, flying)
    network = build_network(task.scenario)
    tried: list[Tried] = []
    best: tuple[float, ReducedModel] | None = None
    # Either can be better: a shape that settles at once is there, but what it stores is not, and the quickest ways to
    # move are not those that move least.
    settled = sorted({0, task.reduction.projection.settled})
    sizes = list(itertools.product(_sizes(task, network), settled))
    with progress.stage("choosing the order", len(sizes)) as choosing:
        for k, model in enumerate(_projections(task, network, training, sizes)):
            error = _judged(task, errors_of(task, model, training, _JUDGING_DRAWS, _JUDGING_STEP))
            tried.append(Tried(len(model.states), model.massless, error))
            if best is None or error < best[0]:
                best = (error, model)
            choosing.at(k + 1)
            if error <= MARGIN * task.reduction.tolerance:
                break
    assert best is not None  # there is at least one size
    with progress.stage("full network, held out", 1.0) as flying:
        held_out = run_full(task, task.reduction.held_out, flying)
    errors = errors_of(task, best[1], held_out)
    return Reduced(best[1], tuple(tried), tuple(errors), tuple(held_out))


def _judged(task: Task, errors: Sequence[Errors]) -> float:
    if any(item.failed for item in errors):
        return float("inf")
    everything = np.concatenate([np.abs(item.temperatures).ravel() for item in errors])
    return float(np.quantile(everything, task.reduction.quantile))


def _own_nodes(task: Task) -> list[str]:
    """Nodes that are to be states of any reduced model: of thermostats, then of sensors."""
    watched = [heater.sensor for heater in task.scenario.network.switches.values()]
    observed = [item.node or "" for item in task.scenario.observations.values()]
    return list(dict.fromkeys([*watched, *observed]))


def _sizes(task: Task, network: Network) -> Sequence[int]:
    """Numbers of states that are tried, in this order."""
    heaters = {heater.sensor for heater in task.scenario.network.switches.values()}
    settings = task.reduction.projection
    highest = settings.most_states if settings.states is None else settings.states
    highest = min(highest, len(network.diffusive))
    if highest < len(heaters):
        raise FlightcalError(
            f"projection: found at most {highest} states, expected {len(heaters)}: one for each thermostat's node"
        )
    first = min(max(len(_own_nodes(task)), 1), highest)
    return [highest] if settings.states is not None else range(first, highest + 1)


def _projections(
    task: Task, network: Network, training: Sequence[FullRuns], sizes: Sequence[tuple[int, int]]
) -> Iterator[ReducedModel]:
    affine = decompose(network, task.scenario, medians_of(task.scenario))
    nodes, settings = _own_nodes(task), task.reduction.projection
    most = max(states + settled for states, settled in sizes)
    snapshots = collect(network, affine, training, nodes, most, settings.follow_within)
    for states, settled in sizes:
        shapes = choose_shapes(snapshots, nodes, min(states + settled, snapshots.basis.shape[1]))
        sampled = settings.sampled_nodes or states + 2
        yield project(network, affine, task.scenario, shapes, snapshots, sampled, nodes, states)
