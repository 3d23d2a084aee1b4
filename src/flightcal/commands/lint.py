"""`flightcal lint`: everything that is wrong, at once."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from typing import TYPE_CHECKING

import typer

from ..errors import USER_ERROR, FlightcalError
from .advice import advice, of_steps
from .options import ScenarioFile, TelemetryPlace

if TYPE_CHECKING:
    from ..problem import Window

_MOST_GAPS = 3
"""Gaps of a driver that are told, the longest."""
_MILLI = 1.0
"""K, up to which an error is told in mK."""


def lint(scenario: ScenarioFile, telemetry: TelemetryPlace = None) -> None:
    """List everything that is wrong with a scenario and its telemetry, each with its place.

    Example: `flightcal lint scenario.yaml`
    """
    from ..scenario import lint as findings_in
    from ..scenario import load_scenario

    findings = findings_in(scenario, telemetry=telemetry)
    for finding in findings:
        typer.echo(str(finding))
    problems = sum(not finding.warning for finding in findings)
    if problems:
        typer.echo(f"{problems} problem{'s' if problems > 1 else ''} found", err=True)
        raise typer.Exit(USER_ERROR)
    import numpy as np

    from ..problem import build_window, open_windows
    from ..telemetry import bridged, quality_table, read

    loaded = load_scenario(scenario, telemetry=telemetry)
    data = read(loaded)
    windows: dict[str, Window] = {}
    refused: list[str] = []
    for name in loaded.windows:
        try:
            windows[name] = build_window(loaded, data, name)
        except FlightcalError as error:
            refused.append(str(error))
    for words in dict.fromkeys(refused):
        typer.echo(f"error: {words}", err=True)
    if refused:
        raise typer.Exit(USER_ERROR)
    open_windows([windows[name] for name in loaded.train_windows], data)
    for window, built in windows.items():
        accuracy = built.network.accuracy if built.is_network else None
        steps = "" if accuracy is None else f"; {accuracy.steps} steps, error {_kelvin(accuracy.error)}"
        valid = "" if np.isfinite(built.observed).any() else ", no valid temperature"
        count = len(built.simulator.channels)
        typer.echo(f"window {window}: {len(built.times)} samples of {count} channels{valid}{steps}")
    told: dict[str, list[str]] = {}
    gaps = sorted(bridged(loaded, data), key=lambda record: (record.channel, -record.samples))
    of_channels = [list(records) for _, records in groupby(gaps, key=lambda record: record.channel)]
    for record in (*quality_table(data), *(gap for of_channel in of_channels for gap in of_channel[:_MOST_GAPS])):
        text = f"{record.finding}, {record.samples} samples; {record.detail}"
        told.setdefault(text, []).append(record.channel or "file")
    for text, channels in told.items():
        # Channels of a packet have the same gaps.
        typer.echo(f"telemetry {', '.join(channels)}: {text}")
    for of_channel in of_channels:
        if len(of_channel) > _MOST_GAPS:
            typer.echo(
                f"telemetry {of_channel[0].channel}: {len(of_channel) - _MOST_GAPS} more gaps, shorter than these, "
                "are bridged"
            )
    trained = [windows[name] for name in loaded.train_windows]
    unseen = [window for name, window in windows.items() if name not in loaded.train_windows]
    told_of = (*advice(loaded, data, trained), *of_steps(unseen), *_guesses(scenario.read_text(encoding="utf-8")))
    for line in told_of:
        typer.echo(f"advice: {line}")
    typer.echo(f"{scenario}: no problems found")


def _kelvin(error: float) -> str:
    return f"{error:.2g} K" if error > _MILLI else f"{1e3 * error:.2g} mK"


def _guesses(text: str) -> Iterator[str]:
    """What `flightcal init` could not know, while the scenario's text says so."""
    for number, line in enumerate(text.splitlines(), 1):
        _, found, what = line.partition("# PLACEHOLDER:")
        if found:
            yield f"line {number} says PLACEHOLDER:{what.rstrip('.')}; write your numbers and remove the comment"
