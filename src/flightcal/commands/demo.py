"""`flightcal demo`: the bundled satellite, calibrated in three ways."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import INTERRUPTED
from ..progress import SILENT, Progress
from .calibrate import run_experiment

if TYPE_CHECKING:
    from .calibrate import Summary

DEMO = Path(__file__).parents[1] / "demo"
"""The bundled satellite."""
BESIDE = "beside.json"
"""Scores of other models, in the folder of a run of the same satellite."""
BESIDE_OURS = {
    "published": ("published.yaml", "the same as published: independent noise, no unmodelled heat", True),
    "reduced": ("reduce.yaml", "the full simulator through a reduced model", False),
}
"""Of the demonstration, by folder: file, what is told, whether it takes over what the first run searched."""
_BESIDE_SCORES = ("rmse", "mape_kelvin", "mape_celsius", "crps", "picp", "mpiw")


def demo(out: Annotated[Path, typer.Option(help="Folder for the run.")] = Path("runs/leo_observer")) -> None:
    """Calibrate the bundled satellite with unmodelled heat and, in folders of the folder, in two other ways.

    `published`: as published. `reduced`: the full simulator through a reduced model. The exit code is that of the
    first.

    Example: `flightcal demo --out runs/demo`
    """
    from .display import display, print_beside, print_summary

    with display() as progress:
        runs = run_demo(out, progress=progress)
    summary, others = runs["flightcal"], {name: run for name, run in runs.items() if name != "flightcal"}
    if others:
        print_beside(summary, others)
    print_summary(summary)
    if len(others) < len(BESIDE_OURS) or any(run.interrupted for run in runs.values()):
        raise typer.Exit(INTERRUPTED)
    raise typer.Exit(summary.verdict.exit_code)


def run_demo(out: Path, folder: Path = DEMO, *, progress: Progress = SILENT) -> dict[str, Summary]:
    """The runs of a folder's files by name: `flightcal` in `out`, the others of `BESIDE_OURS` in folders there.

    After one that is interrupted no other begins. The scores of the others are kept beside the first, for its page,
    which is written again after each of them.
    """
    runs = {"flightcal": run_experiment(folder / "scenario.yaml", out, progress=progress)}
    summary, channels = runs["flightcal"], _channels_by_column(folder / "scenario.yaml")
    for name, (file, words, shares_search) in BESIDE_OURS.items():
        if any(run.interrupted for run in runs.values()):
            break
        progress.say(words)
        searched = summary.run if shares_search else None
        runs[name] = run_experiment(folder / file, out / name, searched=searched, progress=progress)
        _put_beside(summary.run, runs, channels)
    return runs


def _channels_by_column(scenario_file: Path) -> dict[str, str]:
    """Names of a scenario's channels by their columns in the telemetry."""
    from ..scenario import load_scenario

    channels = load_scenario(scenario_file).telemetry.channels
    return {column: name for name, channel in channels.items() for column in channel.column}


def _put_beside(path: Path, runs: dict[str, Summary], channels: dict[str, str]) -> None:
    """Keep the scores of the other runs in the first one's folder, and write its page again."""
    from ..report import write_report
    from ..run import hold

    fields = ("method", "window", "metric", "value")
    records = [
        {"model": name, "channel": channels.get(metric.channel, metric.channel)}
        | {field: getattr(metric, field) for field in fields}
        for name in BESIDE_OURS
        if name in runs
        for metric in runs[name].metrics
        if metric.method in ("genetic", "stochastic") and metric.metric in _BESIDE_SCORES
    ]
    with hold(path) as folder:
        folder.write_json(BESIDE, records)
        write_report(path)
