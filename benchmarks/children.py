"""What must be measured in a process of its own; prints one line of JSON. `python -m benchmarks.children WHAT ...`."""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np


def chains(count: int, cores: int, draws: int) -> dict[str, float]:
    """Gradients a second of NUTS with `count` chains on `cores` cores."""
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])
    from flightcal.calibration import climb
    from flightcal.calibration.nuts import sample
    from flightcal.scenario import NutsSettings

    from .problem import benchmark_problem

    problem, theta = benchmark_problem()
    z = climb(problem, problem.to_z(theta)).z
    coordinates = problem.coordinates(z)

    def run(chains: int, draws: int, seed: int) -> Any:
        settings = NutsSettings(chains=chains, draws=draws, warmup=50)
        return sample(problem.log_density_and_gradient, coordinates, settings, seed, native=problem.native_density)

    run(2, 50, 1)
    begin = time.perf_counter()
    done = run(count, max(50, draws), 2)
    return {"rate": done.gradients / (time.perf_counter() - begin)}


def integrations(core: int, seconds: int) -> dict[str, float]:
    """Integrations with their adjoint a second on one core: what the machine gives to processes that share nothing."""
    os.sched_setaffinity(0, [sorted(os.sched_getaffinity(0))[core]])
    from .problem import benchmark_problem
    from .share import integration_alone

    problem, theta = benchmark_problem()
    integrate = integration_alone(problem, problem.to_z(theta))
    # All processes count over the same seconds of the clock, once they have had time to start.
    begin = seconds * (1 + time.time() // seconds + _START_ROUNDS)
    while time.time() < begin:
        integrate()
    done = 0
    while time.time() < begin + seconds:
        integrate()
        done += 1
    return {"rate": done / seconds}


_START_ROUNDS = 2


def forward(rounds: int) -> dict[str, float]:
    """Of the forward run, over the C program's time: called with prepared arguments as that is, and from Python."""
    from flightcal.simulator import integrate
    from flightcal.simulator.system import pack

    from .canonical import canonical
    from .peers import c_program
    from .problem import benchmark_problem
    from .share import forward_alone
    from .timing import interleaved, ratios

    problem, theta = benchmark_problem()
    model = canonical(problem)
    structure, drive = model.structure, model.drive
    system = model.simulator.system(theta[problem.windows[0].simulated])
    packed = pack(system)
    timings = interleaved(
        {
            "C": c_program.forward(structure, system, drive),
            "prepared": forward_alone(structure, packed, drive),
            "Python": lambda: integrate(structure, system, drive, derivative=False),
        },
        rounds,
    )
    over = ratios(timings, "C")
    return {"C": timings["C"].median, "prepared": over["prepared"].median, "Python": over["Python"].median}


def memory(orbits: int, nodes: int) -> dict[str, float]:
    """Peak of the process in MiB, by how much a gradient raised it, and the seconds that it took."""
    from flightcal.simulator import integrate

    from .networks import chain

    small = chain(4)
    run = integrate(*small)
    run.pull_back(np.ones_like(run.states))
    case = chain(nodes, 1, orbits)
    before = _peak()
    begin = time.perf_counter()
    run = integrate(*case)
    run.pull_back(np.ones_like(run.states))
    seconds = time.perf_counter() - begin
    peak = _peak()
    return {"peak": peak, "growth": peak - before, "seconds": seconds}


def _peak() -> float:
    """Of this process, MiB. Not getrusage's, which begins with that of the process that forked this one."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return next(float(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM")) / 1024


def experiment(scenario: str, out: str) -> dict[str, float]:
    """Seconds of each stage of the whole experiment, of the imports, and of everything since the process began."""
    begin = time.perf_counter()
    from numba.core import event

    from flightcal.commands.calibrate import run_experiment

    imported = time.perf_counter()
    compiling: list[float] = []
    with event.install_timer("numba:compile", compiling.append):
        summary = run_experiment(Path(scenario), Path(out))
    done = time.perf_counter()
    stages: dict[str, Any] = json.loads((summary.run / "provenance.json").read_text(encoding="utf-8"))["stages"]
    passed = float(summary.passed)
    return {"import": imported - begin, **stages, "all": done - begin, "compilation": sum(compiling), "passed": passed}


_MEASURES = {measure.__name__: measure for measure in (chains, integrations, forward, memory, experiment)}


if __name__ == "__main__":
    what, *given = sys.argv[1:]
    arguments = given if what == "experiment" else [int(value) for value in given]
    print(json.dumps(_MEASURES[what](*arguments)))
