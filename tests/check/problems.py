"""Problems whose answers are known: formulas in the place of a simulator, on the small satellite's window."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import timedelta
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from flightcal.check.centre import Centre
from flightcal.commands.folder import parameter_records
from flightcal.problem import Entry, Problem, Window, build_problem
from flightcal.report.run_files import ParameterInfo, parameter_info
from flightcal.scenario import Prior
from flightcal.simulator import Trajectory
from flightcal.simulator.system import Switch
from tests import small

NOISE = 0.1  # K
NO_SWITCHES = Switch(np.empty(0), np.empty(0, np.int64), np.empty(0))


@dataclass(frozen=True)
class Formula:
    """Temperatures as a formula of theta; a `Simulator`, with derivatives by differences."""

    parameters: tuple[str, ...]
    channels: tuple[str, ...]
    temperatures: Callable[[Any], Any]
    """theta [d] -> [T, N] K."""
    switches: Callable[[Any], Switch] = lambda theta: NO_SWITCHES
    heaters: tuple[str, ...] = ()
    samples: int = 180

    error_basis = None

    def heater_power(self, theta: Any) -> Any:
        return np.zeros(len(self.heaters))

    def simulate(self, theta: Any) -> Trajectory:
        nothing = np.zeros((self.samples, len(self.heaters)))
        return Trajectory(self.temperatures(theta), nothing, np.zeros(len(self.heaters)), self.switches(theta))

    def simulate_many(self, thetas: Any) -> list[Trajectory | None]:
        return [self.simulate(theta) for theta in thetas]

    def linearise(self, theta: Any) -> Any:
        steps = 1e-6 * np.maximum(np.abs(theta), 1.0) * np.eye(len(theta))
        columns = [
            (self.temperatures(theta + step) - self.temperatures(theta - step)) / (2.0 * step.sum()) for step in steps
        ]
        return self.simulate(theta), lambda bar: np.array([np.sum(bar * column) for column in columns])


@cache
def _small() -> Problem:
    with TemporaryDirectory() as folder:
        written = small.content()
        written["observations"]["body_temp"]["noise"] = "0.1 K"
        return build_problem(*small.closed_loop(Path(folder), written))


def samples() -> int:
    return len(_small().windows[0].times)


def formula_problem(
    priors: dict[str, Prior],
    temperatures: Callable[[Any], Any],
    truth: dict[str, float],
    *,
    seed: int = 0,
    **more: Any,
) -> Problem:
    """A problem whose telemetry is the formula [T, 2] at the truth, with a noise of 0.1 K that is known."""
    base = _small().windows[0]
    simulator = Formula(tuple(priors), base.simulator.channels, temperatures, samples=samples(), **more)
    exact = temperatures(np.array([truth[name] for name in priors]))
    window = replace(
        base,
        observed=exact + NOISE * np.random.default_rng(seed).standard_normal(exact.shape),
        status=np.full((len(exact), len(simulator.heaters)), np.nan),
        simulator=simulator,
        reads=priors,
    )
    entries = tuple(Entry(name, "K", prior, "parameter") for name, prior in priors.items())
    return Problem(base.scenario, entries, (window,))


def observing(problem: Problem, observed: Any) -> Problem:
    """A problem of one window with other temperatures [T, 2]."""
    return replace(problem, windows=(replace(problem.windows[0], observed=observed),))


def several(**problems: Problem) -> Problem:
    """The windows of several problems of the same parameters as one, a day after each other, by their labels."""
    scenario = next(iter(problems.values())).scenario
    windows: list[Window] = []
    spans = {}
    for day, (label, problem) in enumerate(sorted(problems.items())):
        (window,) = problem.windows
        span = scenario.windows[window.name]
        later = {end: getattr(span, end) + timedelta(days=day) for end in ("start", "end")}
        spans[f"train.{label}"] = span.model_copy(update=later)
        after = np.timedelta64(day, "D")
        windows.append(replace(window, name=f"train.{label}", start=window.start + after, times=window.times + after))
    windows.sort(key=lambda window: list(problems).index(window.label))
    scenario = scenario.model_copy(update={"windows": spans})
    return replace(
        problem, scenario=scenario, windows=tuple(replace(shifted, scenario=scenario) for shifted in windows)
    )


def centre_at(problem: Problem, **theta: float) -> Centre:
    """The centre at the given theta."""
    z = problem.to_z(np.array([theta[name] for name in problem.names]))
    return Centre(z, problem.log_density(z), problem.gauss_newton_hessian(z), True, "the truth")


def infos(problem: Problem) -> tuple[ParameterInfo, ...]:
    return tuple(parameter_info(record) for record in parameter_records(problem))
