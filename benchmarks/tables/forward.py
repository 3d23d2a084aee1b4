"""One simulation: flightcal, the C program, SciPy, diffrax."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from tests.oracle import jax

from flightcal.simulator import integrate
from flightcal.simulator.system import pack

from ..apart import measured_apart
from ..canonical import canonical
from ..peers import c_program, diffrax_ode, scipy_ode
from ..problem import benchmark_problem
from ..report import Section, Table
from ..share import forward_alone
from ..timing import duration, interleaved, ratio_text, ratios

_PREPARED = "flightcal, arguments prepared"
_SCIPY = (("LSODA", 1e-7, 1e-5), ("Radau", 1e-6, 1e-4))
_AGREEMENT = 1e-6  # K
_PROCESSES = 9


def measure(quick: bool) -> Section:
    """The table."""
    problem, theta = benchmark_problem()
    model = canonical(problem)
    structure, drive = model.structure, model.drive
    system = model.simulator.system(theta[problem.windows[0].simulated])
    packed = pack(system)
    reference = scipy_ode.tight_reference(model, theta)
    notes = []
    runs: dict[str, Callable[[], Any]] = {
        _PREPARED: forward_alone(structure, packed, drive),
        "flightcal, called from Python": lambda: integrate(structure, system, drive, derivative=False).states,
    }
    if c_program.compiler_version():
        runs["C program of the same scheme"] = c_program.forward(structure, system, drive)
        apart = float(np.abs(runs["C program of the same scheme"]() - integrate(structure, system, drive).states).max())
        if not apart < _AGREEMENT:
            raise AssertionError(f"the C program and flightcal differ by {apart:.2g} K")
        notes.append(
            f"The C program (`peers/rodas3.c`, gcc {' '.join(c_program.FLAGS[:2])}) agrees with flightcal to "
            f"{apart:.1e} K; "
            "both keep the states on the grid, flightcal also the segments, which heater duty and switches follow from."
        )
    else:
        notes.append("No gcc was found, so the C program is left out.")
    observed = {name: lambda run=run: model.observe(run()) for name, run in runs.items()}
    runs["flightcal, theta to temperatures"] = lambda: problem.windows[0].simulate(theta).temperatures
    for method, rtol, atol in _SCIPY:
        runs[f"SciPy solve_ivp, {method} with events"] = lambda method=method, rtol=rtol, atol=atol: model.observe(
            scipy_ode.solve_with_events(model, theta, method, rtol, atol)
        )
    for solver in ("Tsit5", "Kvaerno3"):
        configuration = diffrax_ode.Configuration(solver, rtol=1e-7, atol=1e-4)
        compiled = diffrax_ode.temperatures(model, configuration)
        runs[f"diffrax {solver}"] = lambda compiled=compiled: jax.block_until_ready(compiled(theta))[0]
    errors = {name: np.asarray({**runs, **observed}[name]()) - reference for name in runs}
    timings = interleaved(runs, 5 if quick else 21, budget=20 if quick else 60)
    over = ratios(timings, _PREPARED)
    rows = [
        [
            name,
            str(timings[name]),
            ratio_text(over[name]),
            f"{np.sqrt(np.mean(errors[name] ** 2)):.2g}",
            f"{np.abs(errors[name]).max():.2g}",
        ]
        for name in runs
    ]
    z = problem.to_z(theta)
    both = interleaved(
        {
            "forward": lambda: problem.windows[0].simulate(theta),
            "gradient": lambda: problem.log_density_and_gradient(z),
        },
        5 if quick else 21,
    )
    gradient = ratios(both, "forward")["gradient"]
    notes += [
        f"flightcal's gradient takes {ratio_text(gradient)} times its forward run (theta to temperatures).",
        "SciPy runs from switch to switch with the Jacobian given; diffrax's thermostat is smoothed, as above.",
    ]
    columns = ["", "one run", "over flightcal, prepared", "RMS, K", "max, K"]
    tables = [Table(columns, rows)]
    if c_program.compiler_version():
        tables.append(_over_c_program(3 if quick else _PROCESSES))
        notes.append(
            "The ratios to the C program differ from process to process, with what else the machine runs, so they are "
            "measured in several. Prepared: called through a C pointer with arguments and memory made once, as the C "
            "program is, and as the sampler calls it. From Python: with all arrays made anew and handed over."
        )
    return Section("Forward run", "The same problem, simulated once.", tables, notes)


def _over_c_program(processes: int) -> Table:
    found = [measured_apart("forward", 41) for _ in range(processes)]
    rows = [
        [
            str(k + 1),
            duration(one["C"]),
            f"{one['prepared']:.3g}",
            f"{one['Python']:.3g}",
        ]
        for k, one in enumerate(found)
    ]
    medians = {name: float(np.median([one[name] for one in found])) for name in found[0]}
    rows.append(["median", duration(medians["C"]), f"{medians['prepared']:.3g}", f"{medians['Python']:.3g}"])
    return Table(["process", "C program", "flightcal prepared, over C", "flightcal from Python, over C"], rows)
