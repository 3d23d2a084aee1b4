"""How time and memory grow with the simulated time, the network, the heaters, the parameters and the chains."""

from __future__ import annotations

import os
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from flightcal.simulator import integrate

from ..apart import measured_apart
from ..networks import ORBIT, Case, boxes, chain, plate, with_parameters
from ..problem import make_problem
from ..report import Section, Table
from ..timing import duration, exponent, interleaved, larger_half

_MEMORY_CASES = ((2, 8), (100, 8), (2, 200), (20, 200), (100, 200))
"""Orbits and nodes; the last must fit in 2 GiB."""


def measure(quick: bool) -> Section:
    """All of them."""
    rounds = 3 if quick else 7
    return Section(
        "Scaling",
        "The exponent is the slope of log time over log size, fitted to all sizes and to the larger half of them. "
        "Networks are chains of nodes (each linked to the next, radiating to space, sunlit every second one), boxes of "
        "96 nodes bolted to one another, or one square plate (each node linked to four), in steps of 60 s; an orbit is "
        f"{ORBIT:.0f} s; two orbits unless said.",
        [
            _sizes("orbits", [1, 3, 10] if quick else [1, 3, 10, 30, 100], lambda k: chain(8, 1, k), rounds),
            _sizes("nodes, chain", [2, 8, 32, 128] if quick else [2, 8, 32, 125, 500, 2000], chain, rounds),
            _sizes("nodes, boxes", [96, 192] if quick else [96, 192, 480, 960, 1920], boxes, rounds),
            _sizes("nodes, plate", [4, 16, 64] if quick else [4, 16, 64, 256, 1024, 1936], plate, rounds),
            _sizes("heaters", [0, 5, 10] if quick else [0, 1, 5, 10, 20, 50], lambda k: chain(100, k), rounds),
            _parameters([2, 20] if quick else [2, 10, 20, 50, 100, 200], rounds),
            _chains(quick),
            _memory(_MEMORY_CASES[:3] if quick else _MEMORY_CASES),
        ],
        [
            "Heaters: on a chain of 100 nodes, spread evenly, each watching its own node; the number of switches grows "
            "with them.",
            "Chains: the last row is what the cores give to processes that share nothing; cores of a virtual machine "
            "may be halves of one.",
            "Memory is the peak (VmHWM) of a process of its own for each row, and by how much the gradient raised "
            "the peak of imports and compilation (0: it fits into what these had used).",
        ],
    )


def _sizes(name: str, sizes: list[int], make: Any, rounds: int) -> Table:
    cases: dict[int, Case] = {size: make(size) for size in sizes}
    functions: dict[Any, Any] = {}
    for size, case in cases.items():
        run = integrate(*case)
        bar = np.ones_like(run.states)
        functions[size, "forward"] = lambda case=case: integrate(*case, derivative=False)
        functions[size, "gradient"] = lambda case=case, bar=bar: integrate(*case).pull_back(bar)
    timings = interleaved(functions, rounds, budget=30)
    rows = [
        [
            f"{size}",
            duration(timings[size, "forward"].median),
            duration(timings[size, "gradient"].median),
            f"{timings[size, 'gradient'].median / timings[size, 'forward'].median:.2f}",
            str(len(integrate(*cases[size]).switches.time)),
        ]
        for size in sizes
    ]
    positive = [size for size in sizes if size > 0]
    rows += [[*row, "", ""] for row in _exponents(positive, timings, ("forward", "gradient"))]
    return Table([name, "forward", "gradient", "gradient over forward", "switches"], rows)


def _exponents(sizes: list[int], timings: Any, kinds: tuple[str, str]) -> list[list[str]]:
    """Rows of the exponents over all sizes and over the larger half of them."""
    times = [[timings[size, kind].median for size in sizes] for kind in kinds]
    return [
        ["exponent", *(f"{exponent(sizes, each):.2f}" for each in times)],
        ["exponent, larger half", *(f"{exponent(larger_half(sizes), larger_half(each)):.2f}" for each in times)],
    ]


def _parameters(counts: list[int], rounds: int) -> Table:
    problems = {}
    for count in counts:
        with tempfile.TemporaryDirectory() as folder:
            problems[count] = make_problem(with_parameters(count), {}, Path(folder))
    functions: dict[Any, Any] = {}
    for count, (problem, theta) in problems.items():
        z = problem.to_z(theta)
        functions[count, "density"] = lambda problem=problem, z=z: problem.log_density(z)
        functions[count, "gradient"] = lambda problem=problem, z=z: problem.log_density_and_gradient(z)
    timings = interleaved(functions, rounds, budget=30)
    rows = [[str(k), *(duration(timings[k, kind].median) for kind in ("density", "gradient"))] for k in counts]
    rows += _exponents(counts, timings, ("density", "gradient"))
    return Table(["parameters (100 nodes; besides, 100 initial temperatures)", "log density", "with gradient"], rows)


def _chains(quick: bool) -> Table:
    usable = sorted(os.sched_getaffinity(0))
    cores = [k for k in (1, 2, 4, 8, 16, 32) if k <= len(usable)]
    rows = []
    for chains in (2, 4, 8):
        rates = [measured_apart("chains", chains, used, 50 if quick else 200)["rate"] for used in cores]
        rows.append([str(chains), *(f"{rate:,.0f}" for rate in rates), f"{rates[-1] / rates[0]:.2f}"])
    rates = [sum(_together("integrations", used)) for used in cores]
    rows.append(
        [
            "the integrations alone, a process for each core",
            *(f"{rate:,.0f}" for rate in rates),
            f"{rates[-1] / rates[0]:.2f}",
        ]
    )
    columns = ["chains", *(f"gradients a second, {k} core{'s' * (k > 1)}" for k in cores), "most cores over one"]
    return Table(columns, rows)


def _memory(cases: Any) -> Table:
    rows = []
    for orbits, nodes in cases:
        found = measured_apart("memory", orbits, nodes)
        rows.append(
            [
                f"{orbits} orbits, {nodes} nodes",
                f"{found['peak']:.0f} MiB",
                f"{found['growth']:.0f} MiB",
                duration(found["seconds"]),
            ]
        )
    return Table(["gradient of a chain with one heater", "peak of the process", "raised by", "time"], rows)


def _together(what: str, processes: int, seconds: int = 5) -> list[float]:
    """Rates of so many processes at the same time, each on a core of its own."""
    with ThreadPoolExecutor(processes) as pool:
        return [found["rate"] for found in pool.map(lambda core: measured_apart(what, core, seconds), range(processes))]
