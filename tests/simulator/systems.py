"""Systems in canonical form for the tests of the integrator."""

import numpy as np

from flightcal.simulator.network import STEFAN_BOLTZMANN
from flightcal.simulator.system import Drive, System


def random_system(seed, *, nodes=6, heaters=2, massless=1, steps=150, step=30.0, mixing=False, measured_heaters=0):
    """A chain of nodes with radiation, sunlight that comes and goes, a jump of dissipation, and thermostats."""
    rng = np.random.default_rng(seed)
    capacity = rng.uniform(300.0, 1500.0, nodes)
    mass = np.ones(nodes)
    if massless:
        mass[-massless:], capacity[-massless:] = 0.0, 1.0
    linear, radiative = np.zeros((nodes, nodes)), np.zeros((nodes, nodes))
    for i in range(nodes - 1):
        linear[i, i + 1] = linear[i + 1, i] = rng.uniform(0.2, 3.0)
    radiative[0, -1] = radiative[-1, 0] = 0.02 * STEFAN_BOLTZMANN
    A = linear - np.diag(linear.sum(axis=1))
    N = radiative - np.diag(radiative.sum(axis=1) + rng.uniform(0.005, 0.03, nodes) * STEFAN_BOLTZMANN)
    times = np.linspace(0.0, steps * step, steps + 1)
    jump = steps // 3
    times = np.insert(times, jump + 1, [times[jump], times[jump] + 0.01])
    inputs = np.stack(
        [
            np.ones(len(times)),
            np.maximum(np.sin(2 * np.pi * times / 5800.0), 0.0),
            (np.arange(len(times)) > jump) * 1.0,
        ],
        axis=1,
    )
    B = rng.uniform(0.0, 2.5, (nodes, 3))
    B[:, 1] *= 3.0
    heating, sensors = np.zeros((heaters, nodes)), np.zeros((heaters, nodes))
    for k in range(heaters):
        heating[k, k] = 60.0
        sensors[k, k] = 1.0
    lower = 281.0 + np.arange(heaters) * 0.7
    E = np.zeros((0, nodes))
    if mixing:
        E = rng.normal(size=(nodes + 2, nodes)) * 0.1
        E[:nodes] += np.eye(nodes)
        N = np.concatenate([N, -0.01 * STEFAN_BOLTZMANN * rng.uniform(0, 1, (nodes, 2))], axis=1)
    measured = np.full((len(times) - 1, heaters), np.nan)
    measured[:, :measured_heaters] = (rng.random((len(times) - 1, measured_heaters)) > 0.8) * 0.75
    system = System(
        A / capacity[:, None],
        N / capacity[:, None],
        B / capacity[:, None],
        heating / capacity,
        lower,
        lower + 2.0,
        np.full(nodes, 284.0) + rng.normal(size=nodes),
    )
    drive = Drive(times, inputs, mass, sensors, E, measured, np.zeros(heaters))
    return system, drive


def linear_network(capacity, conductances, heat, initial, times):
    """A conducting network: capacities [n] J/K, conductances {(i, j): W/K}, constant heat [n] W, no heaters."""
    n = len(capacity)
    G = np.zeros((n, n))
    for (i, j), conductance in conductances.items():
        G[i, j] = G[j, i] = conductance
    A = (G - np.diag(G.sum(axis=1))) / np.asarray(capacity)[:, None]
    system = System(
        A,
        np.zeros((n, 0)),
        (np.asarray(heat) / capacity)[:, None],
        np.zeros((0, n)),
        np.zeros(0),
        np.zeros(0),
        np.asarray(initial, float),
    )
    times = np.asarray(times, float)
    drive = Drive(
        times,
        np.ones((len(times), 1)),
        np.ones(n),
        np.zeros((0, n)),
        np.zeros((0, n)),
        np.zeros((len(times) - 1, 0)),
        np.zeros(0),
    )
    return system, drive
