"""Ten thousand simulations in JAX, on its default device, against the compiled lanes on all cores."""

from __future__ import annotations

import os

import numpy as np

from flightcal._jax import jax
from flightcal.simulator import NetworkSimulator, integrate
from flightcal.simulator.accelerated import integrate_thousands
from flightcal.simulator.assembly import assemble
from flightcal.simulator.system import unpack

from ..problem import benchmark_problem
from ..report import Section, Table
from ..timing import interleaved, ratio_text, ratios
from .batch import laplace_draws

_AGREEMENT = 1e-6  # K
_CHECKED = 200


def measure(quick: bool) -> Section:
    """The table."""
    problem, theta = benchmark_problem()
    simulator = problem.simulator
    assert isinstance(simulator, NetworkSimulator)
    count = 1000 if quick else 10_000
    thetas = laplace_draws(problem, theta, count)
    structure, drive = simulator.network.structure, simulator.drive
    _, packed = assemble(simulator.mapping, simulator.network.terms, thetas[:, problem.simulated])

    def in_jax() -> object:
        return jax.block_until_ready(integrate_thousands(structure, packed, drive).states)

    found = integrate_thousands(structure, packed, drive)
    states = np.asarray(found.states)
    chosen = np.linspace(0, count - 1, _CHECKED).astype(int)
    apart = max(
        float(np.abs(states[:, :, k] - integrate(structure, unpack(structure, packed[k]), drive).states).max())
        for k in chosen
    )
    if not apart < _AGREEMENT:
        raise AssertionError(f"JAX and the compiled integration differ by {apart:.2g} K")
    device = jax.devices()[0]
    name = f"JAX on {device.device_kind} ({device.platform})"
    lanes = f"compiled lanes on {os.cpu_count()} cores"
    timings = interleaved({lanes: lambda: problem.simulate_many(thetas), name: in_jax}, 3 if quick else 7, budget=60)
    over = ratios(timings, lanes)
    # Read: the state, the entries, and about twenty numbers of where a simulation is; written: all but the entries.
    numbers = packed.shape[1] + 4 * len(structure.mass) + 40
    traffic = 8.0 * numbers * count * found.rounds
    rows = [
        [key, str(timings[key]), f"{1e6 * timings[key].median / count:.1f} us", ratio_text(over[key])]
        for key in timings
    ]
    return Section(
        "Accelerator path",
        f"{count} simulations of two orbits, thetas drawn around the posterior's mode.",
        [Table(["", f"{count} simulations", "each", "over the lanes"], rows)],
        [
            f"The same states on {_CHECKED} of them to {apart:.1e} K.",
            f"The loop goes round {found.rounds} times and moves at least {traffic / 1e9:.1f} GB: "
            f"{traffic / 1e9 / timings[name].median:.1f} GB/s here.",
        ],
    )
