"""Systems in canonical form for the tests of the integrator."""

import numpy as np

from flightcal.simulator import integrate
from flightcal.simulator.assembly import ParameterMap, assemble, assembly_memory
from flightcal.simulator.integrate import NOTHING, Integration
from flightcal.simulator.kernels.assembly import PullBackCall, pull_back
from flightcal.simulator.kernels.lanes import WIDTH
from flightcal.simulator.network import STEFAN_BOLTZMANN
from flightcal.simulator.system import Drive, System, make_structure, unpack


def from_dense(mass, A, N, B, g, sensor, lower, upper, initial, Q=None):
    """Structure and system of dense matrices; g is [H, n]; Q: none."""
    Q = np.zeros_like(np.asarray(A, float)) if Q is None else Q

    def entries(matrix):
        return [(int(i), int(j)) for i, j in zip(*np.nonzero(matrix), strict=True)]

    structure = make_structure(mass, entries(A), entries(N), entries(Q), entries(B), entries(g), sensor)
    values = [np.ascontiguousarray(matrix[np.nonzero(matrix)], float) for matrix in (A, N, Q, B, g)]
    return structure, System(*values, np.asarray(lower, float), np.asarray(upper, float), np.asarray(initial, float))


def no_parameters(numbers):
    """A map without parameters: the scenario's numbers as they are."""
    nothing = np.zeros(0, np.int64)
    return ParameterMap(0, np.asarray(numbers, float), nothing, nothing, nothing, nothing)


def assembled(network, numbers, initial):
    """The system of a network at the scenario's numbers [V], from initial temperatures [n]."""
    _, packed = assemble(no_parameters(numbers), network.terms, np.asarray(initial, float)[network.diffusive])
    return unpack(network.structure, packed)


def pull_back_assembly(mapping, terms, theta, numbers, packed_bar, used, used_bar):
    """Cotangent of theta [d] from that of the packed system [P] and of numbers [., .] that are used elsewhere too."""
    theta_bar, memory = np.empty(len(theta)), assembly_memory(mapping, terms)
    pull_back(PullBackCall(mapping, terms, used, theta[None], numbers[None], packed_bar, used_bar, memory, theta_bar))
    return theta_bar


def simulated(structure, packed, drive, observation=NOTHING, errors=None, scatter=None, *, lanes=False):
    """A run of packed systems [S, P] in lanes, or of one [P], with errors [S, 3, N] or [3, N] and scatter."""
    rooms = len(packed) if lanes else 1
    run = Integration(
        structure, drive, observation, rooms=rooms, lanes=WIDTH if lanes else 1, derivative=not lanes,
        scatter=0 if scatter is None else scatter.shape[-2],
    )  # fmt: skip
    run.simulations[0] = rooms
    run.packed[:] = packed
    run.errors[:] = 0.0 if errors is None else errors
    if scatter is not None:
        run.scatter[:] = np.asarray(scatter)[..., None, :]
    run.forward()
    return run


def drive_of(times, inputs, heaters=0, measured=None):
    """A drive of inputs [K+1, q] at grid points, in which all thermostats act and heaters start off."""
    times, inputs = np.asarray(times, float), np.asarray(inputs, float)
    measured = np.full((len(times) - 1, heaters), np.nan) if measured is None else measured
    return Drive(times, np.stack([inputs[:-1], inputs[1:]], axis=1), measured, np.zeros(heaters))


def random_system(seed, *, nodes=6, heaters=2, massless=1, steps=150, step=30.0, measured_heaters=0, slope=0.0):
    """A tree of nodes with radiation, sunlight that comes and goes, a jump of dissipation, and thermostats.

    slope: of the conductances, 1/K, around 270 K.
    """
    rng = np.random.default_rng(seed)
    capacity = rng.uniform(300.0, 1500.0, nodes)
    mass = np.ones(nodes)
    if massless:
        mass[-massless:], capacity[-massless:] = 0.0, 1.0
    linear, radiative = np.zeros((nodes, nodes)), np.zeros((nodes, nodes))
    for i in range(nodes - 1):
        j = int(rng.integers(i + 1, nodes)) if i + 2 < nodes else i + 1
        linear[i, j] = linear[j, i] = rng.uniform(0.2, 3.0)
    radiative[0, -1] = radiative[-1, 0] = 0.02 * STEFAN_BOLTZMANN
    A, Q = ((linear - np.diag(linear.sum(axis=1))) * factor for factor in (1.0 - 270.0 * slope, 0.5 * slope))
    N = radiative - np.diag(radiative.sum(axis=1) + rng.uniform(0.005, 0.03, nodes) * STEFAN_BOLTZMANN)
    times = np.linspace(0.0, steps * step, steps + 1)
    jump = steps // 3
    times = np.insert(times, [1, jump + 1], [1e-4, times[jump] + 1e-4])
    after = np.arange(len(times)) > jump + 1
    inputs = np.stack([np.ones(len(times)), np.maximum(np.sin(2 * np.pi * times / 5800.0), 0.0), after * 1.0], axis=1)
    B = rng.uniform(0.0, 2.5, (nodes, 3))
    B[:, 1] *= 3.0
    heating = np.zeros((heaters, nodes))
    heating[np.arange(heaters), np.arange(heaters)] = 60.0
    lower = 281.0 + np.arange(heaters) * 0.7
    measured = np.full((len(times) - 1, heaters), np.nan)
    measured[:, :measured_heaters] = (rng.random((len(times) - 1, measured_heaters)) > 0.8) * 0.75
    scale = capacity[:, None]
    structure, system = from_dense(
        mass, A / scale, N / scale, B / scale, heating / capacity, range(heaters), lower, lower + 2.0,
        np.full(nodes, 284.0) + rng.normal(size=nodes), Q / scale,
    )  # fmt: skip
    return structure, system, drive_of(times, inputs, heaters, measured)


def linear_network(capacity, conductances, heat, initial, times):
    """A conducting network: capacities [n] J/K, conductances {(i, j): W/K}, constant heat [n] W, no heaters."""
    n = len(capacity)
    G = np.zeros((n, n))
    for (i, j), conductance in conductances.items():
        G[i, j] = G[j, i] = conductance
    A = (G - np.diag(G.sum(axis=1))) / np.asarray(capacity)[:, None]
    structure, system = from_dense(
        np.ones(n), A, np.zeros((n, n)), (np.asarray(heat) / capacity)[:, None], np.zeros((0, n)), [], [], [], initial
    )
    return structure, system, drive_of(times, np.ones((len(times), 1)))


def derivatives_along(structure, system, drive, run, field):
    """Of a weighted sum of a run's states, as a field moves along a random direction: found, and by differences."""
    weights = np.random.default_rng(0).normal(size=run.states.shape)
    value = getattr(system, field)
    direction = np.random.default_rng(1).normal(size=value.shape) * np.abs(value)
    size = 1e-7

    def objective(amount):
        moved = integrate(structure, system._replace(**{field: value + amount * direction}), drive)
        assert len(moved.switches.time) == len(run.switches.time)
        return (moved.states * weights).sum()

    found = (getattr(run.pull_back(weights), field) * direction).sum()
    return found, (objective(size) - objective(-size)) / (2 * size)
