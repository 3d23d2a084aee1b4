"""`flightcal simulate`: one simulation of a window, beside the telemetry, as a CSV file that any tool reads."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import ScenarioError
from .options import ScenarioFile, TelemetryPlace

if TYPE_CHECKING:
    from ..problem import Problem
    from ..simulator import FloatArray


def simulate(
    scenario: ScenarioFile,
    window: Annotated[str | None, typer.Option(help="Window of the scenario; default: the first to train on.")] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="name=value of a parameter or of initial.NODE, in SI; the rest is as the scenario writes it.",
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="CSV file to write; default: WINDOW_simulated.csv.")] = None,
    telemetry: TelemetryPlace = None,
) -> None:
    """Simulate one window and write temperatures and heater status beside the telemetry.

    Example: `flightcal simulate scenario.yaml --window test --set radiator_absorptivity=0.2`
    """
    for line in simulate_to_csv(scenario, window, settings or [], out, telemetry):
        typer.echo(line)


def simulate_to_csv(
    scenario_file: Path, name: str | None, assignments: list[str], file: Path | None, telemetry: Path | None = None
) -> list[str]:
    """Simulate the scenario as it is written, but for what is assigned ("name=value", SI); write `file`.

    name: of a window; None: the first to train on. file: None: called after the window.
    What parameters set has the number that stands there, and they scale by 1. Temperatures start where `initial` says,
    else at the telemetry's first samples.
    Columns: time, then per channel simulated and measured temperature (degC), then per heater simulated and measured
    status. Returns lines that say what was done. Raises ScenarioError and TelemetryError.
    """
    import numpy as np
    import pandas

    from ..problem import build_window, problem_of
    from ..run import write_text
    from ..scenario import ICE_POINT, load_scenario
    from ..simulator import SimulationFailure
    from ..telemetry import read

    scenario = load_scenario(scenario_file, telemetry=telemetry)
    name = name or scenario.train_windows[0]
    file = file or Path(f"{name}_simulated.csv")
    problem = problem_of(scenario, [build_window(scenario, read(scenario), name)])
    theta = _assigned(problem, assignments)
    (window,) = problem.windows
    try:
        (run,) = problem.simulate(theta)
    except SimulationFailure as failure:
        raise ScenarioError(f"{scenario_file}: the simulation of window '{name}' fails: {failure}") from None
    table = pandas.DataFrame({"time": window.times})
    for k, channel in enumerate(window.simulator.channels):
        table[f"{channel} simulated degC"] = run.temperatures[:, k] - ICE_POINT
        table[f"{channel} measured degC"] = window.observed[:, k] - ICE_POINT
    for k, heater in enumerate(window.simulator.heaters):
        table[f"{heater} simulated"] = run.status[:, k]
        table[f"{heater} measured"] = window.status[:, k]
    write_text(file, table.to_csv(index=False, float_format="%.4f"))
    lines = []
    for channel, residual in zip(window.simulator.channels, window.residual(run).T, strict=True):
        known = residual[np.isfinite(residual)]
        lines.append(f"{channel}: RMSE {np.sqrt(np.mean(known**2)):.3f} K" if len(known) else f"{channel}: no sample")
    lines += [f"{h}: duty cycle {d:.1%}" for h, d in zip(window.simulator.heaters, run.duty_cycle, strict=True)]
    if name not in scenario.train_windows:
        lines += _starts(problem, theta)
    return [*lines, f"wrote {file}"]


def _starts(problem: Problem, theta: FloatArray) -> Iterator[str]:
    """The nodes that start where the scenario writes it, which may be right in another window only."""
    from ..problem import initial_temperatures
    from ..scenario import ICE_POINT

    written = [node for node, initial in initial_temperatures(problem.scenario).items() if initial is not None]
    if written:
        starts = [theta[problem.names.index(f"initial.{node}")] - ICE_POINT for node in written]
        listed = ", ".join(f"{node} {start:.1f} degC" for node, start in zip(written, starts, strict=True))
        yield f"starts in every window where 'initial' says: {listed}; '--set initial.{written[0]}=...' (K) changes it"


def _assigned(problem: Problem, assignments: list[str]) -> FloatArray:
    from ..problem import initial_temperatures
    from ..scenario import written_values

    theta = problem.priors.median()
    initial = {f"initial.{name}": written for name, written in initial_temperatures(problem.scenario).items()}
    for name, written in {**written_values(problem.scenario), **initial}.items():
        if written is not None:
            theta[problem.names.index(name)] = written
    # What moves a parameter from window to window does nothing to the only one.
    settable = [entry.name for entry in problem.entries if entry.kind != "drift"]
    for text in assignments:
        name, _, value = text.partition("=")
        if name not in settable:
            near = difflib.get_close_matches(name, settable, 1)
            hint = f"; did you mean '{near[0]}'?" if near else f", expected one of {', '.join(settable)}"
            raise ScenarioError(f"--set {text}: found unknown parameter '{name}'{hint}")
        try:
            theta[problem.names.index(name)] = float(value)
        except ValueError:
            raise ScenarioError(f"--set {text}: found '{value}', expected a number in SI units") from None
    return theta
