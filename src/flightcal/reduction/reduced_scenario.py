"""A reduced order model in a scenario: what of the scenario stays, and its simulator on a window."""

from __future__ import annotations

from collections.abc import Sequence

from ..scenario import Face, Node, Parameter, Scenario, SimulatorModel, settable
from ..simulator import Network
from .affine import KEPT
from .names import node_name
from .reduced_model import ReducedModel, network_of


def reduced_scenario(scenario: Scenario, model: ReducedModel, step: float | None) -> Scenario:
    """The full network's scenario with the model in its place: parameters set the model's numbers."""
    return scenario.model_copy(
        update={
            "simulator": simulator_block(scenario.network, model, step),
            "observations": {
                name: item.model_copy(update={"node": node_name(item.node or "")})
                for name, item in scenario.observations.items()
            },
            "parameters": {name: _rewritten(name, parameter, model) for name, parameter in scenario.parameters.items()},
        }
    )


def simulator_block(full: SimulatorModel, model: ReducedModel, step: float | None) -> SimulatorModel:
    """What a scenario says of the simulator: the states as nodes, a face for each way, heaters and modes."""
    states = {
        node_name(name): Node.model_construct(capacity=1.0, initial=float(value), arithmetic=False, boundary=None)
        for name, value in zip(model.states, model.initial, strict=True)
    }
    mixed = {
        node_name(name): Node.model_construct(capacity=None, initial=None, arithmetic=True, boundary=None)
        for name in (*model.settled, *model.mixed)
    }
    faces = {
        way: Face.model_construct(
            node=node_name(model.states[0]), area=1.0, normal=normal, absorptivity=1.0, emissivity=1.0
        )
        for way, normal in model.ways.items()
    }
    heaters = {
        # Where its heat goes is in the model's matrices; its node is one of the full network.
        name: heater.model_copy(update={"node": node_name(heater.node), "sensor": node_name(heater.sensor)})
        for name, heater in full.switches.items()
    }
    return full.model_copy(
        update={
            "step": step,
            "nodes": {**states, **mixed},
            "conductors": (),
            "faces": faces,
            "heaters": heaters,
            "loads": {},
            "full_nodes": tuple(map(node_name, model.full)),
        }
    )


def network_for(model: ReducedModel, scenario: Scenario, heated: Sequence[str] = ()) -> Network:
    """The model's network with the numbers that the scenario has: its own, those of heaters, modes and the like.

    heated: as in `network_of`.
    """
    numbers = settable(scenario)
    kept = (*KEPT, "observations.", "reduced.")
    return network_of(model, {path: item.value for path, item in numbers.items() if path.startswith(kept)}, heated)


def _rewritten(name: str, parameter: Parameter, model: ReducedModel) -> Parameter:
    """The parameter sets its own number in the model, and touches heaters, modes and environment as before."""
    names = (f"reduced.{name}",) if f"reduced.{name}" in model.free else ()
    return parameter.model_copy(
        update={
            "sets": (*names, *(path for path in parameter.sets if path.startswith(KEPT))),
            "scales": tuple(path for path in parameter.scales if path.startswith(KEPT)),
        }
    )
