"""Many simulations: a posterior's in batch, and the genetic algorithm's, each against one by one."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from flightcal.calibration import calibrate_genetic, climb
from flightcal.problem import Problem
from flightcal.scenario import GeneticSettings

from ..problem import benchmark_problem
from ..report import Section, Table
from ..timing import Timing, busy, interleaved, ratio_text, ratios


class OneByOne:
    """A simulator whose batch is a loop; everything else is the wrapped one's."""

    def __init__(self, simulator: Any) -> None:
        self._simulator = simulator

    def __getattr__(self, name: str) -> Any:
        return getattr(self._simulator, name)

    def simulate_many(self, thetas: Any) -> list[Any]:
        """The loop."""
        return [self._simulator.simulate(theta) for theta in thetas]


def laplace_draws(problem: Problem, theta: Any, count: int) -> Any:
    """Thetas [count, d] from the normal approximation of the posterior at its mode."""
    z = climb(problem, problem.to_z(theta)).z
    coordinates = problem.coordinates(z)
    rng = np.random.default_rng(1)
    return problem.to_theta(coordinates.to_z(rng.standard_normal((count, len(z)))))


def measure_batch(quick: bool) -> Section:
    """1,000 simulations from the posterior."""
    problem, theta = benchmark_problem()
    thetas = laplace_draws(problem, theta, 200 if quick else 1000)
    together, single = problem.windows[0].simulate_many(thetas), [problem.windows[0].simulate(row) for row in thetas]
    apart = max(
        float(np.abs(run.temperatures - other.temperatures).max())
        for run, other in zip(together, single, strict=True)
        if run is not None
    )
    if not apart < 1e-6:
        raise AssertionError(f"batch and one by one differ by {apart:.2g} K")
    runs = {
        "batch": lambda: problem.windows[0].simulate_many(thetas),
        "one by one": lambda: [problem.windows[0].simulate(row) for row in thetas],
    }
    timings = interleaved(runs, 5 if quick else 11)
    over = ratios(timings, "batch")
    _, wall, processor = busy(runs["batch"])
    rows = [[name, str(timings[name]), ratio_text(over[name])] for name in runs]
    return Section(
        "Simulations of the posterior",
        f"{len(thetas)} thetas drawn around the posterior's mode; `simulate_many` against `simulate` in a loop.",
        [Table(["", f"{len(thetas)} simulations", "over batch"], rows)],
        [
            f"Both give the same temperatures (largest difference {apart:.1e} K).",
            f"The batch keeps {processor / wall:.2f} cores busy.",
        ],
    )


def measure_genetic(quick: bool) -> Section:
    """Evaluations per second of the genetic algorithm."""
    problem, _ = benchmark_problem()
    (window,) = problem.windows
    one_by_one = dataclasses.replace(window, simulator=OneByOne(window.simulator))
    looped = dataclasses.replace(problem, windows=(one_by_one,))
    settings = GeneticSettings(runs=1, population=64, generations=10 if quick else 30)
    results = {name: calibrate_genetic(chosen, settings) for name, chosen in (("a", problem), ("b", looped))}
    if not np.allclose(results["a"]["rmse"], results["b"]["rmse"], rtol=1e-6):
        raise AssertionError("the genetic algorithm finds something else in batch")
    evaluations = int(results["a"].attrs["evaluations"])
    timings = interleaved(
        {
            "batch": lambda: calibrate_genetic(problem, settings),
            "one by one": lambda: calibrate_genetic(looped, settings),
        },
        3 if quick else 7,
    )
    over = ratios(timings, "one by one")
    rows = [
        [name, f"{evaluations / timing.median:,.0f}", str(timing), ratio_text(_inverse(over[name]))]
        for name, timing in timings.items()
    ]
    columns = ["", "evaluations a second", f"{evaluations} evaluations", "speed over one by one"]
    return Section(
        "Genetic algorithm",
        f"One run, {settings.population} individuals, {settings.generations} generations, of the same problem: "
        "everything included, the algorithm's own work too.",
        [Table(columns, rows)],
    )


def _inverse(ratio: Timing) -> Timing:
    return Timing(tuple(1.0 / value for value in ratio.samples))
