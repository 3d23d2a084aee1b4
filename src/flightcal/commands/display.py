"""What a user sees of a running calibration: a line for each stage with a bar, and the summary at the end."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.padding import Padding
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from ..prediction import comparison_table
from ..validation import INTERVALS
from .calibrate import Summary

if TYPE_CHECKING:
    from .check import CheckSummary
    from .compare import Comparison as ModelComparison
    from .validate import Validation

_TITLES = {
    "read": "reading telemetry",
    "compile": "compiling (long only once)",
    "emulator": "learning an emulator",
    "genetic": "genetic algorithm",
    "nuts": "stochastic update (NUTS)",
    "predict": "predicting and scoring",
    "report": "writing the report",
}


EVERY = 60.0
"""s between two lines on one stage, where there is no terminal."""


@contextmanager
def bar(title: str) -> Iterator[Callable[..., None]]:
    """A bar on a terminal; what it yields is told the share (0..1) that is done and may be told a note.

    Elsewhere it prints the note for each tenth that is done.
    """
    console = Console(stderr=True)
    note_column = TextColumn("{task.fields[note]}")
    progress = Progress(TextColumn(title), BarColumn(bar_width=30), note_column, TimeElapsedColumn(), console=console)
    task = progress.add_task(title, total=1.0, note="")
    if console.is_terminal:
        with progress:
            yield lambda share, note="": progress.update(task, completed=share, note=note)
        return
    tenths = 0

    def advance(share: float, note: str = "") -> None:
        nonlocal tenths
        if note and int(10 * share) > tenths:
            tenths = int(10 * share)
            console.print(f"{title}: {note}", highlight=False, soft_wrap=True)

    yield advance


@contextmanager
def bars() -> Iterator[Callable[[str, float], None]]:
    """A bar for each of several stages on a terminal, else a line; what it yields is told stage and share (0..1)."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description:<28}"), BarColumn(bar_width=30), TimeElapsedColumn())
    tasks: dict[str, TaskID] = {}
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:

        def advance(stage: str, share: float) -> None:
            if stage not in tasks:
                tasks[stage] = progress.add_task(stage, total=1.0)
                if not console.is_terminal:
                    console.print(stage, highlight=False)
            progress.update(tasks[stage], completed=share)

        yield advance


class Display:
    """Progress for `experiment.run_experiment` (a Listener): bars on a terminal, else lines.

    A line for each stage, and in a long one another each minute, so that a log shows how far it is.
    """

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or Console(stderr=True)
        self._progress = Progress(
            TextColumn("{task.description:<26}"),
            BarColumn(bar_width=30),
            TextColumn("{task.fields[note]}"),
            TimeElapsedColumn(),
            console=self._console,
        )
        self._task: TaskID | None = None
        self._said = monotonic()

    def __enter__(self) -> Display:
        if self._console.is_terminal:
            self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._console.is_terminal:
            self._progress.stop()

    def stage(self, name: str, done_before: bool) -> None:
        """Finish the last bar and begin the stage's."""
        self.finish()
        note = "done before" if done_before else ""
        self._task = self._progress.add_task(_TITLES.get(name, name), total=1 if done_before else None, note=note)
        if done_before:
            self._progress.update(self._task, completed=1)
        if not self._console.is_terminal:
            self._console.print(f"{_TITLES.get(name, name)} {note}".rstrip(), highlight=False)
            self._said = monotonic()

    def finish(self) -> None:
        """Fill the current bar."""
        if self._task is not None:
            total = self._progress.tasks[self._task].total or 1
            self._progress.update(self._task, total=total, completed=total)

    def generation(self, run: int, generation: int, best: float) -> None:
        """Show run, generation and best cost."""
        self._update(note=f"run {run + 1}, generation {generation + 1}, RMSE {best:.3f} K")

    def learning(self, said: str) -> None:
        """A line for each round of the active learning."""
        self._progress.console.print(said, highlight=False)

    def search(self, what: str) -> None:
        """Show what the mode search is at."""
        self._update(note=f"mode search: {what}")

    def sampling(self, chains: Any) -> None:
        """Show the draws of all chains together."""
        drawn, total = sum(chain.draws for chain in chains), sum(chain.total for chain in chains)
        gradients = sum(chain.gradients for chain in chains)
        self._update(total=total, completed=drawn, note=f"{drawn}/{total} draws, {gradients} gradients")

    def _update(self, note: str, **fields: Any) -> None:
        if self._task is not None:
            self._progress.update(self._task, note=note, **fields)
        if not self._console.is_terminal and monotonic() - self._said >= EVERY:
            self._console.print(f"  {note}", highlight=False, soft_wrap=True)
            self._said = monotonic()


def print_summary(summary: Summary, console: Console | None = None) -> None:
    """The verdict, the comparison of the methods, and where the report is."""
    console = console or Console()
    style = "green" if summary.passed else "bold red"
    console.print(f"\n[{style}]{summary.diagnostics['verdict']}[/{style}]", highlight=False)
    if summary.interrupted:
        console.print("[bold red]Sampling was interrupted; the draws so far are saved.[/bold red]")
    table = Table(title="Scores over all channels", title_justify="left")
    for heading in ("window", "metric", "genetic", "stochastic", "ratio", "published ratio"):
        table.add_column(heading, justify="left" if heading in ("window", "metric") else "right")
    for row in comparison_table([metric for metric in summary.metrics if metric.channel == "all"]):
        table.add_row(
            row.window,
            row.metric,
            _number(row.genetic),
            _number(row.stochastic),
            _number(row.ratio),
            _number(row.published),
        )
    console.print(table)
    for metric in summary.metrics:
        if metric.method == "stochastic" and metric.channel == "all" and metric.metric in ("picp", "mpiw"):
            share = metric.metric == "picp" and metric.value is not None
            value = f"{metric.value:.1%}" if share else f"{_number(metric.value)} {metric.unit}"
            console.print(f"{metric.window}: {metric.metric.upper()} {value}", highlight=False)
    console.print(f"report: {summary.report}", highlight=False, soft_wrap=True)


def print_check(summary: CheckSummary, console: Console | None = None) -> None:
    """The verdict of a check, its findings in words, and where the page is."""
    console = console or Console()
    style = "green" if summary.passed else "bold red"
    console.print(f"\n[{style}]{summary.verdict}[/{style}]", highlight=False)
    colours = {"good": "green", "warn": "yellow", "bad": "bold red", "none": "dim"}
    for finding in summary.findings:
        console.print()
        console.print(f"{finding.mark}: {finding.title}", style=colours[finding.state], markup=False, highlight=False)
        for line in (finding.text, *(f"- {detail}" for detail in finding.details)):
            console.print(Padding(Text(line), (0, 0, 0, 2), expand=False), highlight=False)
    console.print(f"\npage: {summary.page}", highlight=False, soft_wrap=True, markup=False)


def print_validation(validation: Validation, console: Console | None = None) -> None:
    """The verdict, the quantities, and where the page is."""
    console = console or Console()
    outside = [check.name for check in validation.checks if not check.inside]
    words = f"not uniform: {', '.join(outside)}" if outside else "uniform, as they are where the posterior is right"
    style = "bold red" if outside else "green"
    console.print(f"\n[{style}]Ranks of {len(validation.repeats)} repeats: {words}[/{style}]", highlight=False)
    table = Table()
    shares = [f"{share:.0%} covers" for share in INTERVALS]
    for heading in ("quantity", "p", *shares, "contraction", "score"):
        table.add_column(heading, justify="left" if heading == "quantity" else "right")
    for check in validation.checks:
        covered = [f"{share:.1%}" for share in check.coverage]
        contraction = "-" if math.isnan(check.contraction) else f"{check.contraction:.1%}"
        table.add_row(check.name, f"{check.p_value:.3f}", *covered, contraction, f"{check.score:.2f}")
    console.print(table)
    console.print(f"page: {validation.folder / 'validation.html'}", highlight=False, soft_wrap=True)


def print_comparison(comparison: ModelComparison, console: Console | None = None) -> None:
    """The models side by side on the unseen windows, what is recommended, and where the page is."""
    console = console or Console()
    table = Table(title="Means over unseen windows, all channels", title_justify="left")
    for heading in ("model", "RMSE K", "MAPE %", "PICP", "MPIW K", "CRPS K", "log score"):
        table.add_column(heading, justify="left" if heading == "model" else "right")
    for model, means in comparison.content["means"].items():
        shown = [
            "-" if value is None else f"{value:.1%}" if metric == "picp" else f"{value:.4g}"
            for metric, value in means.items()
        ]
        table.add_row(model, *shown)
    console.print(table)
    for model, windows in comparison.content["left_out"].items():
        for window, scores in windows.items():
            words = f"PICP {scores['picp']:.1%}, CRPS {scores['crps']:.4g} K, log score {scores['log_score']:.4g}"
            note = "" if scores["passed"] else " (not converged)"
            console.print(f"{model}, {window} predicted by the others: {words}{note}", highlight=False, soft_wrap=True)
    console.print(f"recommended: [bold]{comparison.content['recommended']}[/bold]", highlight=False)
    console.print(comparison.content["reason"], highlight=False, markup=False)
    console.print(f"page: {comparison.folder / 'comparison.html'}", highlight=False, soft_wrap=True, markup=False)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"
