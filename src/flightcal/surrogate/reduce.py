"""From a reduction file to reduced models: runs of the full network, a search for the order, the chosen model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import xarray

from ..errors import FlightcalError
from ..probability.priors import Priors
from ..scenario import Scenario
from ..simulator import Network, NetworkSimulator, build_network, network_simulator
from ..simulator.inputs import Times
from ..simulator.system import FloatArray
from .affine import Affine, decompose
from .candidate import Candidate, Errors, errors_of
from .condensation import Condensed, condense, restriction_of
from .file import Task
from .full_order import FullRuns, run_full
from .grouping import merge_alike, name_groups
from .patterns import matching
from .projection import choose_shapes, collect, project
from .reduced_model import ReducedModel
from .reduced_scenario import reduced_scenario, simulate_reduced

MARGIN = 0.4
"""Of the tolerance that training runs must keep. Unseen ones may be worse."""
_JUDGING_DRAWS = 8
"""Training runs of each window that a size is judged on."""

Progress = Callable[[str, float], None]
"""Told what is being done, and the share of it that is done."""


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

    candidate: Candidate
    model: ReducedModel | Condensed
    tried: tuple[Tried, ...]
    held_out: tuple[Errors, ...]
    runs: tuple[FullRuns, ...]
    """Held out."""


def reduce(task: Task, on_progress: Progress = lambda *_: None) -> Reduced:
    """Run the full network, choose the smallest model that keeps the tolerance, and judge it on held-out runs.

    Raises FlightcalError where groups or sizes do not fit the network.
    """
    training = run_full(task, task.reduction.training, partial(on_progress, "full network, training"))
    network = build_network(task.scenario)
    tried: list[Tried] = []
    best: tuple[float, Candidate, ReducedModel | Condensed] | None = None
    count, models = _models(task, network, training)
    for k, (candidate, model) in enumerate(models):
        error = _judged(task, errors_of(candidate, training, _JUDGING_DRAWS))
        tried.append(Tried(candidate.states, candidate.massless, error))
        if best is None or error < best[0]:
            best = (error, candidate, model)
        on_progress("choosing the order", (k + 1) / count)
        if error <= MARGIN * task.reduction.tolerance:
            break
    assert best is not None  # there is at least one size
    held_out = run_full(task, task.reduction.held_out, partial(on_progress, "full network, held out"))
    errors = errors_of(best[1], held_out)
    return Reduced(best[1], best[2], tuple(tried), tuple(errors), tuple(held_out))


def _models(
    task: Task, network: Network, training: Sequence[FullRuns]
) -> tuple[int, Iterator[tuple[Candidate, ReducedModel | Condensed]]]:
    """How many models are tried, and these, by size."""
    sizes = list(_sizes(task, network))
    if task.reduction.method == "condensation":
        return len(sizes), _condensations(task, network, training, sizes)
    shapes = [(states, settled) for states in sizes for settled in _settled(task)]
    return len(shapes), _projections(task, network, training, shapes)


def _judged(task: Task, errors: Sequence[Errors]) -> float:
    if any(item.failed for item in errors):
        return float("inf")
    everything = np.concatenate([np.abs(item.temperatures).ravel() for item in errors])
    return float(np.quantile(everything, task.reduction.quantile))


def _own_nodes(task: Task) -> list[str]:
    """Nodes that are to be states of any reduced model: of thermostats, then of sensors."""
    watched = [heater.sensor for heater in task.scenario.network.heaters.values()]
    observed = [item.node or "" for item in task.scenario.observations.values()]
    return list(dict.fromkeys([*watched, *observed]))


def _sizes(task: Task, network: Network) -> Iterator[int]:
    """What is tried, in this order: numbers of states, or of nodes."""
    reduction, most = task.reduction, len(network.diffusive)
    if reduction.method == "projection":
        heaters = {heater.sensor for heater in task.scenario.network.heaters.values()}
        settings = reduction.projection
        highest = min(settings.most_states if settings.states is None else settings.states, most)
        if highest < len(heaters):
            raise FlightcalError(
                f"projection: found at most {highest} states, expected {len(heaters)}: one for each thermostat's node"
            )
        first = min(max(len(_own_nodes(task)), 1), highest)
        yield from [highest] if settings.states is not None else range(first, highest + 1)
        return
    wanted = reduction.condensation.nodes
    highest = min(reduction.condensation.most_nodes, most)
    yield from [wanted] if wanted is not None else sorted({int(k) for k in np.linspace(0.3 * highest, highest, 8)})


# --- projection ---------------------------------------------------------------------------------------------


def medians_of(scenario: Scenario) -> FloatArray:
    """Prior medians of the parameters [d]."""
    return Priors(tuple(scenario.parameters), tuple(item.prior for item in scenario.parameters.values())).median()


def _settled(task: Task) -> list[int]:
    """How many shapes settle at once in the models of a size: none, and as many as the file allows.

    Either can be the better one: a shape that settles is there, but what it stores is not, and the quickest ways to
    move are not those that move least.
    """
    return sorted({0, task.reduction.projection.settled})


def _projections(
    task: Task, network: Network, training: Sequence[FullRuns], sizes: Sequence[tuple[int, int]]
) -> Iterator[tuple[Candidate, ReducedModel]]:
    affine = decompose(network, task.scenario, medians_of(task.scenario))
    own, settings = _own_nodes(task), task.reduction.projection
    most = max(states + settled for states, settled in sizes)
    snapshots = collect(network, affine, training, own, most, settings.follow_within)
    for states, settled in sizes:
        shapes = choose_shapes(snapshots, own, min(states + settled, snapshots.basis.shape[1]))
        sampled = settings.sampled_nodes or states + 2
        model = project(network, affine, task.scenario, shapes, snapshots, sampled, own, states)
        yield projected(task, network, model)


def projected(task: Task, network: Network, model: ReducedModel) -> tuple[Candidate, ReducedModel]:
    """A projected model, to be judged."""

    def build(scenario: Scenario, start: np.datetime64, end: np.datetime64, times: Times) -> NetworkSimulator:
        reduced = reduced_scenario(scenario, model, task.reduction.step)
        return simulate_reduced(model, reduced, start, end, times, task.period)

    restriction = np.zeros((len(model.states), len(network.nodes)))
    for k, name in enumerate(model.states):
        restriction[k, network.nodes.index(name)] = 1.0
    massless = len(model.settled) + len(model.mixed) + model.followers + len(model.states)
    return Candidate(build, restriction, len(model.states), massless), model


# --- condensation -------------------------------------------------------------------------------------------


def _condensations(
    task: Task, network: Network, training: Sequence[FullRuns], sizes: Sequence[int]
) -> Iterator[tuple[Candidate, Condensed]]:
    affine = decompose(network, task.scenario, medians_of(task.scenario))
    capacity = np.sum(list(affine.capacity.values()), axis=0)
    snapshots = np.concatenate([run.temperatures[:, ::4].reshape(-1, len(network.nodes)) for run in training])
    nominal = dict(zip(network.nodes, snapshots.mean(axis=0).tolist(), strict=True))
    nodes = task.scenario.network.nodes
    nominal |= {name: float(node.boundary) for name, node in nodes.items() if isinstance(node.boundary, float)}
    for size in sizes:
        groups = _groups(task, network, affine, snapshots, capacity, size)
        yield _condensed(task, network, condense(task.scenario, groups, nominal), capacity)


def _groups(
    task: Task, network: Network, affine: Affine, snapshots: FloatArray, capacity: FloatArray, size: int
) -> dict[str, list[str]]:
    """Groups by hand, and the rest merged until there are `size` in all."""
    groups: dict[str, list[str]] = {}
    for group, patterns in task.reduction.condensation.groups.items():
        groups[group] = [name for pattern in patterns for name in matching(pattern, network.nodes)]
        if not groups[group]:
            raise FlightcalError(f"condensation.groups.{group}: found {list(patterns)}, which fit no node")
    by_hand = {name for names in groups.values() for name in names}
    rest = [k for k, name in enumerate(network.nodes) if name not in by_hand]
    own = {*_own_nodes(task), *(heater.node for heater in task.scenario.network.heaters.values())}
    touched = _touched_nodes(task.scenario)
    kind = [
        (touched.get(network.nodes[k]), next((p for p, c in affine.capacity.items() if c[k] > 0.0), None)) for k in rest
    ]
    fixed = [place for place, k in enumerate(rest) if network.nodes[k] in own]
    merged = merge_alike(snapshots[:, rest], capacity[rest], kind, fixed, max(size - len(groups), 1))
    automatic = name_groups([[network.nodes[rest[k]] for k in group] for group in merged], groups)
    return groups | automatic


def _touched_nodes(scenario: Scenario) -> dict[str, str]:
    """Nodes whose own numbers parameters set or whose dissipation they touch: these are merged with none."""
    touched = {}
    for parameter in scenario.parameters.values():
        for path in (*parameter.sets, *(path for path in parameter.scales if path.startswith("modes."))):
            section, _, rest = path.partition(".")
            if section == "modes":
                touched[rest.partition(".")[2]] = rest.partition(".")[2]
            elif section == "nodes":
                touched[rest.removesuffix(".capacity")] = rest
    return touched


def _condensed(task: Task, network: Network, condensed: Condensed, capacity: FloatArray) -> tuple[Candidate, Condensed]:
    model = condensed.scenario.network

    def build(scenario: Scenario, start: np.datetime64, end: np.datetime64, times: Times) -> NetworkSimulator:
        timed = model.model_copy(update={"timeline": scenario.network.timeline, "step": task.reduction.step})
        chosen = condensed.scenario.model_copy(update={"simulator": timed})
        return network_simulator(chosen, xarray.Dataset(), start, end, times, period=task.period)

    reduced = build_network(condensed.scenario)
    restriction = restriction_of(condensed, network, reduced, capacity)
    massless = len(reduced.nodes) - len(reduced.diffusive)
    return Candidate(build, restriction, len(reduced.diffusive), massless), condensed
