"""Log density and gradient: flightcal, diffrax, plain JAX, finite differences."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..canonical import Canonical, canonical
from ..peers import diffrax_ode, jax_scan, scipy_ode
from ..problem import benchmark_problem
from ..report import Section, Table
from ..share import integration_alone
from ..timing import duration, interleaved, ratio_text, ratios

DIFFRAX = (
    diffrax_ode.Configuration("Tsit5"),
    diffrax_ode.Configuration("Tsit5", adjoint="every step a checkpoint"),
    diffrax_ode.Configuration("Tsit5", adjoint="ForwardMode"),
    diffrax_ode.Configuration("Tsit5", adjoint="ForwardMode", rtol=1e-7, atol=1e-4),
    diffrax_ode.Configuration("Tsit5", adjoint="ForwardMode", width=diffrax_ode.SHARP_WIDTH),
    diffrax_ode.Configuration("Tsit5", adjoint="ForwardMode", rtol=1e-7, atol=1e-4, width=diffrax_ode.SHARP_WIDTH),
    diffrax_ode.Configuration("Kvaerno3", rtol=1e-7, atol=1e-4),
    diffrax_ode.Configuration("Kvaerno3", adjoint="ForwardMode", rtol=1e-7, atol=1e-4),
    diffrax_ode.Configuration("Heun", rtol=1e-6, atol=1e-3, adjoint="ForwardMode"),
)
_DIFFERENCE = 1e-4
_USABLE = 0.2


@dataclass(frozen=True)
class Contender:
    """One way to the gradient."""

    name: str
    temperatures: Callable[[Any], Any]
    """theta [d] -> [T, N] K."""
    gradient: Callable[[Any], Any]
    """z [d] -> log density, gradient [d]."""
    most_rms: float
    """K, against the tight reference; more is a mistake of the benchmark."""


def contenders(model: Canonical) -> list[Contender]:
    """All of the table, flightcal first."""
    problem = model.problem

    def scan(name: str, states: Any, most_rms: float) -> Contender:
        return Contender(
            name, jax_scan.temperatures(model, states), jax_scan.log_density_and_gradient(model, states), most_rms
        )

    def diffrax(configuration: Any) -> Contender:
        compiled = diffrax_ode.temperatures(model, configuration)
        return Contender(
            configuration.label,
            lambda theta: compiled(theta)[0],
            diffrax_ode.log_density_and_gradient(model, configuration),
            0.1,
        )

    def flightcal(theta: Any) -> Any:
        return problem.windows[0].simulate(theta).temperatures

    finite = Contender("central differences of flightcal's forward", flightcal, _differences(model), 0.01)
    return [
        Contender("flightcal", flightcal, problem.log_density_and_gradient, 0.01),
        *(diffrax(configuration) for configuration in DIFFRAX),
        scan("lax.scan, RODAS3, switch located (the oracle)", jax_scan.located(model), 0.01),
        scan("lax.scan, RODAS3, switch at the step's end", jax_scan.rodas3_end_of_step(model, 1), 0.5),
        scan("lax.scan, Runge-Kutta 4, at the step's end", jax_scan.runge_kutta_end_of_step(model, 1), 0.5),
        scan("the same, each step in 20", jax_scan.runge_kutta_end_of_step(model, 20), 0.1),
        finite,
    ]


def _differences(model: Canonical) -> Callable[[Any], Any]:
    """z [d] -> log density and gradient from 2 d + 1 simulations, run as one batch."""
    problem = model.problem

    def evaluate(z: Any) -> Any:
        steps = _DIFFERENCE * np.eye(len(z))
        points = np.concatenate([z[None], z + steps, z - steps])
        thetas = problem.to_theta(points)
        (window,) = problem.windows
        prior = np.asarray(problem.priors.at(points).log_density)
        values = np.array(
            [window.of_residuals(theta, run) for run, theta in zip(window.simulate_many(thetas), thetas, strict=True)]
        )
        values += prior
        d = len(z)
        return values[0], (values[1 : d + 1] - values[d + 1 :]) / (2.0 * _DIFFERENCE)

    return evaluate


def measure(quick: bool) -> Section:
    """The table."""
    problem, theta = benchmark_problem()
    model = canonical(problem)
    reference = scipy_ode.tight_reference(model, theta)
    z = problem.to_z(theta) + 0.05 * np.random.default_rng(1).standard_normal(len(theta))
    _, exact = problem.log_density_and_gradient(z)
    found = contenders(model)
    errors, gradients = {}, {}
    failed: list[str] = []
    for one in list(found):
        try:
            error = np.asarray(one.temperatures(theta)) - reference
            gradient = np.asarray(one.gradient(z)[1])
        except RuntimeError as failure:  # a peer that gives up is left out, and said to be
            failed.append(f"{one.name}: no result ({_reason(failure)}).")
            found.remove(one)
            continue
        rms, most = float(np.sqrt(np.mean(error**2))), float(np.abs(error).max())
        if not rms <= one.most_rms:
            raise AssertionError(f"{one.name}: {rms:.2g} K RMS from the reference")
        errors[one.name] = (rms, most)
        gradients[one.name] = float(np.linalg.norm(gradient - exact) / np.linalg.norm(exact))
    timings = interleaved(
        {one.name: lambda one=one: one.gradient(z) for one in found}, 5 if quick else 21, budget=30 if quick else 120
    )
    timings_of = ratios(timings, "flightcal")
    alone = integration_alone(problem, z)
    parts = interleaved({"flightcal": lambda: problem.log_density_and_gradient(z), "integration": alone}, 41, budget=20)
    outside = 1.0 - ratios(parts, "flightcal")["integration"].median
    rows = [
        [
            one.name,
            str(timings[one.name]),
            ratio_text(timings_of[one.name]),
            f"{errors[one.name][0]:.2g}",
            f"{errors[one.name][1]:.2g}",
            f"{gradients[one.name]:.1e}" if one.name != "flightcal" else "0",
        ]
        for one in found
    ]
    by_time = sorted((one.name for one in found if one.name.startswith("diffrax")), key=lambda n: timings[n].median)
    columns = ["", "one gradient", "over flightcal", "RMS, K", "max, K", "gradient differs by"]
    (window,) = problem.windows
    return Section(
        "Gradient of the log density",
        f"Two orbits, 8 nodes, 1 thermostat that switches {len(window.simulate(theta).switches.time)} times, "
        f"{len(model.drive.times) - 1} grid steps, {len(problem.names)} parameters (10, and 8 initial temperatures), "
        f"{window.observed.size} samples of telemetry. RMS and max: of the temperatures at the telemetry's times "
        "against SciPy's Radau with events (rtol 1e-10). The last column is the norm of the difference from "
        "flightcal's gradient, over the norm of that, a little off the parameters that the telemetry was made with.",
        [Table(columns, rows)],
        [
            f"Fastest {what}: {best.removeprefix('diffrax ')}, {duration(timings[best].median)}, "
            f"{timings_of[best].median:.3g} times flightcal's time."
            for what, best in (
                *(("diffrax configuration", name) for name in by_time[:1]),
                *(
                    (f"one whose gradient is within {_USABLE:.0%} of flightcal's", name)
                    for name in [name for name in by_time if gradients[name] <= _USABLE][:1]
                ),
                *(
                    ("one whose temperatures are as right as flightcal's (within a fifth)", name)
                    for name in [name for name in by_time if errors[name][0] <= 1.2 * errors["flightcal"][0]][:1]
                ),
            )
        ]
        + [
            f"Outside of the compiled integration and its adjoint (priors, assembly, likelihood, calls): {outside:.0%} "
            "of flightcal's time.",
            "diffrax has no repeated events, so its thermostat is smoothed: a bistable memory state "
            f"(`peers/diffrax_ode.py`; edge {diffrax_ode.WIDTH} K). Its error is mostly that of the smoothing.",
            "diffrax is compiled with jit, with PID-controlled steps (rtol and atol in `Configuration`) and "
            "RecursiveCheckpointAdjoint (its default, or with as many checkpoints as steps) or ForwardMode over all "
            "parameters at once. Looser tolerances give the same states but other derivatives: see the last column.",
            "A thermostat checked at the step's end makes the log density jump, so no sampler can use its gradient; "
            "Runge-Kutta's explicit steps hold only while no node is fast (here none is). Both are shown for speed.",
            *failed,
        ],
    )


def _reason(failure: Exception) -> str:
    found = re.search(r"(?:_EquinoxRuntimeError|RuntimeError): ([^\n.]+)", str(failure))
    return found.group(1) if found else type(failure).__name__
