"""The thermal network: from the scenario's blocks to index arrays, and from theta to the canonical form.

Every number that a parameter may set or scale lies in one vector, `values`, in the order of
`scenario.settable`. A parameter therefore is a handful of positions in that vector, whatever it touches, and
`assemble` is plain JAX from that vector to the matrices: any parameter of anything is differentiable.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._jax import jax, jnp
from ..scenario import Scenario, settable
from .system import System

STEFAN_BOLTZMANN = 5.670374419e-8  # W m^-2 K^-4, CODATA 2018 (exact)
DEEP_SPACE = 2.725  # K, cosmic background (Fixsen 2009)

_MASSLESS_NEWTON_STEPS = 30

IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Link:
    """A conductor between states, or between a state and a boundary."""

    position: int
    """Of its conductance in `values`."""
    state: int
    other: int
    """The other state, or -1 when it is a boundary."""
    boundary: str
    """Name of the boundary node, or ""."""


@dataclass(frozen=True)
class Network:
    """Names and positions: everything about the network that does not depend on theta."""

    nodes: tuple[str, ...]
    """The states: nodes with a capacity first, massless ones after them."""
    diffusive: int
    """How many states have a capacity."""
    columns: tuple[str, ...]
    """Names of the input series w: ``one``, ``solar.<face>``, ``mode.<mode>``, ``driver.<load>``, ..."""
    paths: tuple[str, ...]
    values: NDArray[np.float64]
    """[V] SI, as the scenario writes them."""
    heaters: tuple[str, ...]
    linear: tuple[Link, ...]
    radiative: tuple[Link, ...]
    faces: tuple[tuple[str, int], ...]
    """Face and the state it belongs to."""
    dissipations: tuple[tuple[str, int, int], ...]
    """Mode, state, position of the power in `values`."""
    loads: tuple[tuple[str, int], ...]
    """Load and the state it heats."""
    heater_nodes: tuple[int, ...]
    sensor_nodes: tuple[int, ...]

    def position(self, path: str) -> int:
        """Where the number at a dotted path lies in `values`."""
        return self.paths.index(path)

    @property
    def mass(self) -> NDArray[np.float64]:
        """[n] 1 for states with a capacity, 0 for massless ones."""
        return (np.arange(len(self.nodes)) < self.diffusive).astype(float)

    @property
    def sensors(self) -> NDArray[np.float64]:
        """S [H, n]."""
        return np.eye(len(self.nodes))[list(self.sensor_nodes)].reshape(-1, len(self.nodes))


def build_network(scenario: Scenario) -> Network:
    """Number the nodes of a scenario that has been linted, and find what touches which state."""
    model = scenario.simulator
    quantities = settable(scenario)
    paths = tuple(quantities)
    position = {path: k for k, path in enumerate(paths)}
    diffusive = [name for name, node in model.nodes.items() if node.capacity is not None]
    massless = [name for name, node in model.nodes.items() if node.arithmetic]
    nodes = (*diffusive, *massless)
    state = {name: k for k, name in enumerate(nodes)}

    def links(kind: str) -> tuple[Link, ...]:
        found = []
        for conductor in model.conductors:
            if getattr(conductor, kind) is None:
                continue
            first, second = conductor.between
            if first not in state:
                first, second = second, first
            if first in state:
                boundary = "" if second in state else second
                found.append(
                    Link(
                        position[f"conductors.{conductor.label}.{kind}"],
                        state[first],
                        state.get(second, -1),
                        boundary,
                    )
                )
        return tuple(found)

    faces = tuple((name, state[face.node]) for name, face in model.faces.items() if face.node in state)
    measured_boundaries = [name for name, node in model.nodes.items() if isinstance(node.boundary, str)]
    columns = (
        "one",
        *(f"{kind}.{name}" for kind in ("solar", "albedo", "infrared") for name, _ in faces),
        *(f"mode.{mode}" for mode in model.modes),
        *(f"driver.{name}" for name in model.loads),
        *(f"{kind}.{name}" for kind in ("temperature", "temperature4") for name in measured_boundaries),
    )
    return Network(
        nodes=nodes,
        diffusive=len(diffusive),
        columns=columns,
        paths=paths,
        values=np.array([quantity.value for quantity in quantities.values()]),
        heaters=tuple(model.heaters),
        linear=links("conductance"),
        radiative=links("radiative"),
        faces=faces,
        dissipations=tuple(
            (mode, state[node], position[f"modes.{mode}.{node}"])
            for mode, powers in model.modes.items()
            for node in powers
            if node in state
        ),
        loads=tuple((name, state[load.node]) for name, load in model.loads.items()),
        heater_nodes=tuple(state[heater.node] for heater in model.heaters.values()),
        sensor_nodes=tuple(state[heater.sensor] for heater in model.heaters.values()),
    )


def assemble(network: Network, values: Any, initial: Any, first_inputs: Any) -> System:
    """The canonical form of the network (JAX).

    values: [V] SI; initial: [diffusive] K; first_inputs: w at the first grid point [q], for massless nodes at the start.
    """
    n = len(network.nodes)
    column = {name: k for k, name in enumerate(network.columns)}

    def value(*path: str) -> Any:
        return values[network.position(".".join(path))]

    A, N, B = jnp.zeros((n, n)), jnp.zeros((n, n)), jnp.zeros((n, len(column)))
    for links, scale, power in ((network.linear, 1.0, 1), (network.radiative, STEFAN_BOLTZMANN, 4)):
        matrix = A if power == 1 else N
        for link in links:
            conductance = scale * values[link.position]
            matrix = matrix.at[link.state, link.state].add(-conductance)
            if link.other >= 0:
                matrix = matrix.at[link.other, link.other].add(-conductance)
                matrix = matrix.at[link.state, link.other].add(conductance)
                matrix = matrix.at[link.other, link.state].add(conductance)
            elif f"temperature.{link.boundary}" in column:
                series = "temperature" if power == 1 else "temperature4"
                B = B.at[link.state, column[f"{series}.{link.boundary}"]].add(conductance)
            else:
                fixed = value("nodes", link.boundary, "boundary")
                B = B.at[link.state, column["one"]].add(conductance * fixed**power)
        A, N = (matrix, N) if power == 1 else (A, matrix)
    for face, state in network.faces:
        area = value("faces", face, "area")
        absorbing = area * value("faces", face, "absorptivity")
        emitting = area * value("faces", face, "emissivity")
        N = N.at[state, state].add(-STEFAN_BOLTZMANN * emitting)
        B = B.at[state, column["one"]].add(STEFAN_BOLTZMANN * emitting * DEEP_SPACE**4)
        B = B.at[state, column[f"solar.{face}"]].add(absorbing)
        B = B.at[state, column[f"albedo.{face}"]].add(absorbing * value("environment", "albedo"))
        B = B.at[state, column[f"infrared.{face}"]].add(emitting * value("environment", "earth_infrared"))
    for mode, state, position in network.dissipations:
        B = B.at[state, column[f"mode.{mode}"]].add(values[position])
    for load, state in network.loads:
        B = B.at[state, column[f"driver.{load}"]].add(value("loads", load, "coefficient"))

    heating = jnp.zeros((len(network.heaters), n))
    for k, heater in enumerate(network.heaters):
        heating = heating.at[k, network.heater_nodes[k]].set(value("heaters", heater, "power"))

    capacities = [value("nodes", node, "capacity") for node in network.nodes[: network.diffusive]]
    per_capacity = 1.0 / jnp.stack([*capacities, *[jnp.ones(())] * (n - network.diffusive)])
    no_radiation = not network.radiative and not network.faces
    system = System(
        linear=A * per_capacity[:, None],
        radiative=jnp.zeros((n, 0)) if no_radiation else N * per_capacity[:, None],
        forcing=B * per_capacity[:, None],
        heating=heating * per_capacity,
        lower=jnp.array([value("heaters", heater, "on_below") for heater in network.heaters]),
        upper=jnp.array([value("heaters", heater, "off_above") for heater in network.heaters]),
        initial=jnp.concatenate([initial, jnp.full(n - network.diffusive, jnp.mean(initial))]),
    )
    if network.diffusive == n:
        return system
    return system._replace(initial=_balance_massless(system, network.diffusive, first_inputs))


def _balance_massless(system: System, diffusive: int, first_inputs: Any) -> Any:
    """Initial state [n] in which the massless states (those from `diffusive` on) have no net heat."""
    held = system.initial[:diffusive]
    heat = system.forcing[diffusive:] @ first_inputs

    def imbalance(massless: Any, system: System, held: Any, heat: Any) -> Any:
        x = jnp.concatenate([held, massless])
        total = system.linear[diffusive:] @ x + heat
        return total + system.radiative[diffusive:] @ x**4 if system.radiative.shape[1] else total

    def newton(massless: Any, *data: Any) -> Any:
        slope = jax.jacfwd(imbalance)(massless, *data)
        return massless - jnp.linalg.solve(slope, imbalance(massless, *data))

    frozen = jax.lax.stop_gradient((system, held, heat))
    start = jax.lax.stop_gradient(system.initial[diffusive:])
    solution = jax.lax.fori_loop(0, _MASSLESS_NEWTON_STEPS, lambda _, x: newton(x, *frozen), start)
    # The last step changes nothing but carries the implicit derivative (its slope is at a root of the imbalance).
    return jnp.concatenate([held, newton(jax.lax.stop_gradient(solution), system, held, heat)])
