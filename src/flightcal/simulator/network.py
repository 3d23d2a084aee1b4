"""The thermal network: the heat balance of every node of a scenario, written as entries of the canonical form.

A node whose capacity depends on temperature, C (1 + s (T - T0)), has two states: its heat over C, u, and its
temperature, which is massless and follows from it:

    C du/dt = heat into the node        0 = u - T - s (T - T0)^2 / 2

So heat is conserved exactly, and the integration knows nothing of it. A thermostat watches u, as u grows with T.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

import numpy as np

from ..scenario import DEEP_SPACE, Conductor, Node, Scenario, settable
from .assembly import Terms
from .elimination import Elimination, eliminate
from .system import FloatArray, IntArray, Structure, elimination_order, make_structure

STEFAN_BOLTZMANN = 5.670374419e-8  # W m^-2 K^-4, CODATA 2018 (exact)


@dataclass(frozen=True)
class Network:
    """Everything about a network that does not depend on theta."""

    nodes: tuple[str, ...]
    """The states [n], in elimination order: what lagging sensors show, then nodes with a capacity and massless ones,
    and heat where a capacity depends on temperature."""
    columns: tuple[str, ...]
    """Names of the input series w [q]: ``one``, ``solar.<face>``, ``mode.<mode>``, ``driver.<load>``, ..."""
    paths: tuple[str, ...]
    """Dotted paths of the scenario's settable numbers [V]."""
    values: FloatArray
    """The numbers [V] as the scenario writes them, SI."""
    heaters: tuple[str, ...]
    """Those with a thermostat [H]."""
    structure: Structure
    terms: Terms
    lagging: int = 0
    """How many of the states are sensors that follow their node with a lag."""
    heated: tuple[str, ...] = ()
    """Nodes into which heat may be injected that no block describes; of the input series the last, ``heat.<node>``."""
    switched: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Heaters without a thermostat, by the one that they are switched with."""
    heat_states: Mapping[int, int] = field(default_factory=dict)
    """State of a node whose capacity depends on temperature -> that of its heat, whose row is its heat balance."""

    @cached_property
    def diffusive(self) -> IntArray:
        """Nodes that have a capacity, and so an initial temperature."""
        return _diffusive(self.structure.mass, self.heat_states)[self.lagging :]

    def eliminated(self, read: Collection[int]) -> Elimination | None:
        """The structure without massless states that act linearly, but for those that are `read`; None: it has none."""
        key = frozenset(read)
        if key not in self._eliminated:
            self._eliminated[key] = eliminate(self.structure, key)
        return self._eliminated[key]

    @cached_property
    def _eliminated(self) -> dict[frozenset[int], Elimination | None]:
        """Many simulators of a network look at the same states."""
        return {}

    @property
    def own_nodes(self) -> tuple[str, ...]:
        """The states that are temperatures of the scenario's nodes."""
        heat = self.heat_states.values()
        return tuple(name for k, name in enumerate(self.nodes) if k >= self.lagging and k not in heat)

    @property
    def watched(self) -> IntArray:
        """[H] states whose temperatures the thermostats watch."""
        nodes = {heat: node for node, heat in self.heat_states.items()}
        return np.array([nodes.get(k, k) for k in self.structure.sensor.tolist()], np.int64)

    def balance(self, node: str) -> int:
        """The state whose row is the heat balance of a node."""
        k = self.nodes.index(node)
        return self.heat_states.get(k, k)

    def position(self, path: str) -> int:
        """Where the number at a dotted path lies in `values`."""
        return self.paths.index(path)


FIELDS = ("linear", "radiative", "quadratic", "forcing", "heating", "lower", "upper")
"""Of a packed system, without the initial state."""


Term = tuple[float, Sequence[int]]
"""A constant, and the positions of the numbers that it is multiplied by; -1 - k: by the reciprocal of number k."""


@dataclass
class _Balance:
    """Collects the terms by entry: A is "linear", N "radiative", Q "quadratic", B "forcing", g "heating"."""

    positions: dict[str, int]
    capacities: dict[int, int]
    """State -> position of its capacity (of a lagging sensor: of its time constant); massless states have none."""
    heat_states: Mapping[int, int]
    terms: dict[str, dict[tuple[int, int], list[Term]]] = field(
        default_factory=lambda: {kind: defaultdict(list) for kind in FIELDS}
    )

    def add(self, kind: str, state: int, other: int, constant: float, *paths: str) -> None:
        """Heat into `state`: constant x product of the numbers at `paths` x (state, series or heater `other`)."""
        factors = [self.positions[path] for path in paths]
        state = self.heat_states.get(state, state)
        if state in self.capacities:
            # Negative: the reciprocal of the number there.
            factors.append(-1 - self.capacities[state])
        place = (other, state) if kind == "heating" else (state, other)
        self.terms[kind][place].append((constant, factors))


def build_network(scenario: Scenario, heated: Sequence[str] = ()) -> Network:
    """The network of a scenario that has been linted; heated: nodes that take heat that no block describes."""
    model = scenario.network
    quantities = settable(scenario)
    positions = {path: k for k, path in enumerate(quantities)}
    names = [name for name, node in model.nodes.items() if node.boundary is None]
    numbers = {name: k for k, name in enumerate(names)}
    links = [
        (numbers[first], numbers[second])
        for first, second in (conductor.between for conductor in model.conductors)
        if first in numbers and second in numbers
    ]
    # Nothing depends on a sensor, so eliminating it first fills in nothing.
    lagging = {sensor_state(name): item for name, item in scenario.observations.items() if item.lag is not None}
    sloped = [name for name in names if model.nodes[name].capacity_slope is not None]
    links += [(numbers[name], len(names) + k) for k, name in enumerate(sloped)]
    states = [*names, *map(_heat_state, sloped)]
    nodes = (*lagging, *(states[k] for k in elimination_order(len(states), links)))
    state = {name: k for k, name in enumerate(nodes)}
    heat_states = {state[name]: state[_heat_state(name)] for name in sloped}
    columns = (
        "one",
        *(f"{kind}.{face}" for kind in flux_kinds(scenario) for face in model.faces),
        *(f"mode.{mode}" for mode in model.modes),
        *(f"driver.{load}" for load in model.loads),
        *(
            f"{kind}.{name}"
            for kind in ("temperature", "temperature4")
            for name, node in model.nodes.items()
            if isinstance(node.boundary, str)
        ),
        *(f"temperature2.{name}" for name in dict.fromkeys(_measured_ends(scenario))),
        *(f"heat.{name}" for name in heated),
    )
    column = {name: k for k, name in enumerate(columns)}
    capacities = {state[name]: positions[f"{name}.lag"] for name in lagging}
    capacities |= {
        heat_states.get(state[name], state[name]): positions[f"nodes.{name}.capacity"]
        for name in names
        if model.nodes[name].capacity is not None
    }
    balance = _Balance(positions, capacities, heat_states)
    for name, item in lagging.items():
        balance.add("linear", state[name], state[name], -1.0)
        balance.add("linear", state[name], state[item.node or ""], 1.0)
    _add_conductors(balance, scenario, state, column)
    _add_faces(balance, scenario, state, column)
    for mode, powers in model.modes.items():
        for name in powers:
            if name in state:
                balance.add("forcing", state[name], column[f"mode.{mode}"], 1.0, f"modes.{mode}.{name}")
    for name, load in model.loads.items():
        if load.node in state:
            balance.add("forcing", state[load.node], column[f"driver.{name}"], 1.0, f"loads.{name}.coefficient")
    for name in heated:
        balance.add("forcing", state[name], column[f"heat.{name}"], 1.0)
    for k, name in enumerate(model.switches):
        for other, heater in model.on_switch(name).items():
            balance.add("heating", state[heater.node], k, 1.0, f"heaters.{other}.power")
        for side, number in (("lower", "on_below"), ("upper", "off_above")):
            threshold = positions[f"heaters.{name}.{number}"]
            sensor = model.switches[name].sensor
            balance.terms[side][k, 0] += [(1.0, [threshold]), *_beyond(positions, model.nodes, sensor, threshold)]

    mass = np.array([float(k in capacities) for k in range(len(nodes))])
    initial = np.full(len(nodes), -1)
    diffusive = _diffusive(mass, heat_states)[len(lagging) :].tolist()
    first = len(positions) + 1 + len(capacities)
    warmed = {}
    for place, k in enumerate(diffusive):
        initial[[k, heat_states.get(k, k)]] = place
        if k in heat_states:
            warmed[heat_states[k]] = _beyond(positions, model.nodes, nodes[k], first + place)
    initial[: len(lagging)] = initial[[state[item.node or ""] for item in lagging.values()]]
    for name in sloped:
        _add_heat(balance, model.nodes[name], state[name], positions[f"nodes.{name}.capacity_slope"], column["one"])
    sensors = [state[heater.sensor] for heater in model.switches.values()]
    structure, terms = canonical_form(
        balance.terms,
        mass,
        [heat_states.get(k, k) for k in sensors],
        len(positions),
        initial,
        list(capacities.values()),
        warmed,
    )
    return Network(
        nodes=nodes,
        columns=columns,
        paths=tuple(positions),
        values=np.array([quantity.value for quantity in quantities.values()]),
        heaters=tuple(model.switches),
        structure=structure,
        terms=terms,
        lagging=len(lagging),
        heated=tuple(heated),
        switched={name: tuple(other for other in model.on_switch(name) if other != name) for name in model.switches},
        heat_states=heat_states,
    )


def _diffusive(mass: FloatArray, heat_states: Mapping[int, int]) -> IntArray:
    """States that have an initial temperature: those with a capacity, and of heat the temperature that it makes."""
    return np.array(sorted({*np.flatnonzero(mass > 0.0).tolist(), *heat_states} - {*heat_states.values()}), np.int64)


def _heat_state(node: str) -> str:
    """Name of the state that is the heat of a node whose capacity depends on temperature."""
    return f"nodes.{node}.heat"


def _beyond(positions: Mapping[str, int], nodes: Mapping[str, Node], name: str, temperature: int) -> list[Term]:
    """u - T of a node at the temperature T that stands at a position; none where its capacity is constant."""
    at = nodes[name].written_at
    if nodes[name].capacity_slope is None:
        return []
    slope = positions[f"nodes.{name}.capacity_slope"]
    return [(0.5, [slope, temperature, temperature]), (-at, [slope, temperature]), (0.5 * at * at, [slope])]


def _add_heat(balance: _Balance, node: Node, state: int, slope: int, one: int) -> None:
    """The massless row of a temperature that follows from the node's heat (see the module)."""
    at, terms = node.written_at, balance.terms
    terms["linear"][state, balance.heat_states[state]].append((1.0, []))
    terms["linear"][state, state] += [(-1.0, []), (at, [slope])]
    terms["quadratic"][state, state].append((-0.5, [slope]))
    terms["forcing"][state, one].append((-0.5 * at * at, [slope]))


def flux_kinds(scenario: Scenario) -> tuple[str, ...]:
    """Input series of each face: fluxes, and with an attitude offset their derivatives by it (``solar_x``; per rad)."""
    kinds = ("solar", "albedo", "infrared")
    axes = ("x", "y", "z") if scenario.environment.attitude_offset is not None else ()
    return (*kinds, *(f"{kind}_{axis}" for kind in kinds for axis in axes))


def sensor_state(channel: str) -> str:
    """Name of the state that a channel measures whose sensor lags behind its node."""
    return f"observations.{channel}"


def _add_conductors(balance: _Balance, scenario: Scenario, state: dict[str, int], column: dict[str, int]) -> None:
    nodes = scenario.network.nodes
    for conductor in scenario.network.conductors:
        kind, law, scale, power = (
            ("linear", "conductance", 1.0, 1)
            if conductor.conductance is not None
            else ("radiative", "radiative", STEFAN_BOLTZMANN, 4)
        )
        path = f"conductors.{conductor.label}.{law}"
        for here, there in (conductor.between, conductor.between[::-1]):
            if here not in state:
                continue
            balance.add(kind, state[here], state[here], -scale, path)
            if there in state:
                balance.add(kind, state[here], state[there], scale, path)
            elif isinstance(nodes[there].boundary, str):
                series = "temperature" if power == 1 else "temperature4"
                balance.add("forcing", state[here], column[f"{series}.{there}"], scale, path)
            else:
                balance.add("forcing", state[here], column["one"], scale, path, *[f"nodes.{there}.boundary"] * power)
            if conductor.conductance_slope is not None:
                _add_slope(balance, conductor, (here, there), nodes, state, column)


def _add_slope(
    balance: _Balance,
    conductor: Conductor,
    ends: tuple[str, str],
    nodes: Mapping[str, Node],
    state: dict[str, int],
    column: dict[str, int],
) -> None:
    """What a conductance that grows with the mean of its ends' temperatures adds to the heat into the first end:

    G s ((Ti + Tj) / 2 - T0) (Tj - Ti) = G s (Tj^2 - Ti^2) / 2 - G s T0 (Tj - Ti).
    """
    here, there = ends
    paths = [f"conductors.{conductor.label}.{number}" for number in ("conductance", "conductance_slope")]
    for kind, series, power, factor in (
        ("quadratic", "temperature2", 2, 0.5),
        ("linear", "temperature", 1, -conductor.written_at),
    ):
        balance.add(kind, state[here], state[here], -factor, *paths)
        if there in state:
            balance.add(kind, state[here], state[there], factor, *paths)
        elif isinstance(nodes[there].boundary, str):
            balance.add("forcing", state[here], column[f"{series}.{there}"], factor, *paths)
        else:
            balance.add("forcing", state[here], column["one"], factor, *paths, *[f"nodes.{there}.boundary"] * power)


def _measured_ends(scenario: Scenario) -> Iterator[str]:
    """Nodes of measured temperature at conductors whose conductance depends on temperature."""
    nodes = scenario.network.nodes
    for conductor in scenario.network.conductors:
        if conductor.conductance_slope is not None:
            yield from (name for name in conductor.between if isinstance(nodes[name].boundary, str))


def _add_faces(balance: _Balance, scenario: Scenario, state: dict[str, int], column: dict[str, int]) -> None:
    for name, face in scenario.network.faces.items():
        if face.node not in state:
            continue
        node = state[face.node]
        area, absorptivity, emissivity = (f"faces.{name}.{number}" for number in ("area", "absorptivity", "emissivity"))
        balance.add("radiative", node, node, -STEFAN_BOLTZMANN, area, emissivity)
        balance.add("forcing", node, column["one"], STEFAN_BOLTZMANN * DEEP_SPACE**4, area, emissivity)
        # The series are those of the solar constant that is written.
        sun = "environment.solar_constant"
        share = 1.0 / (scenario.environment.solar_constant or 1.0)
        absorbed = {
            "solar": (share, (area, absorptivity, sun)),
            "albedo": (share, (area, absorptivity, sun, "environment.albedo")),
            "infrared": (1.0, (area, emissivity, "environment.earth_infrared")),
        }
        for kind in flux_kinds(scenario):
            flux, _, axis = kind.partition("_")
            constant, paths = absorbed[flux]
            offset = (f"environment.attitude_offset.{axis}",) if axis else ()
            balance.add("forcing", node, column[f"{kind}.{name}"], constant, *paths, *offset)


def canonical_form(
    terms: Mapping[str, Mapping[tuple[int, int], Sequence[Term]]],
    mass: FloatArray,
    sensors: Sequence[int],
    numbers: int,
    initial: IntArray,
    inverse: Sequence[int] = (),
    warmed: Mapping[int, Sequence[Term]] = MappingProxyType({}),
) -> tuple[Structure, Terms]:
    """Structure and terms of a heat balance from the terms of each entry of its `FIELDS`, whose places are as of
    `make_structure` ((heater, 0) for thresholds).

    numbers: how many there are; inverse: positions of those whose reciprocals are factors; warmed: state -> terms of
    its initial value, beside its initial temperature.
    """
    entries = {kind: sorted(terms[kind]) for kind in FIELDS}
    reciprocal = {position: numbers + 1 + k for k, position in enumerate(inverse)}
    entry, constants, table = [], [], []
    sums = [terms[kind][place] for kind, places in entries.items() for place in places]
    number = len(sums)
    for place, weights in (*enumerate(sums), *((number + state, of_state) for state, of_state in warmed.items())):
        for constant, factors in weights:
            entry.append(place)
            constants.append(constant)
            table.append([f if f >= 0 else reciprocal[-1 - f] for f in factors])
    most = max(map(len, table), default=0)
    structure = make_structure(
        mass,
        entries["linear"],
        entries["radiative"],
        entries["quadratic"],
        entries["forcing"],
        entries["heating"],
        sensors,
    )
    return structure, Terms(
        entry=np.array(entry, dtype=np.int64),
        constant=np.array(constants),
        factors=np.array([row + [numbers] * (most - len(row)) for row in table], np.int64).reshape(len(table), most),
        inverse=np.array(inverse, dtype=np.int64),
        entries=number,
        initial=initial,
    )
