"""What a user sees of a running calibration: a line for each stage with a bar, and the summary at the end."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rich.progress
from rich.console import Console
from rich.markup import escape
from rich.padding import Padding
from rich.progress import BarColumn, TaskID, TextColumn, TimeElapsedColumn
from rich.text import Text

from ..prediction import (
    ANY,
    GENETIC_RUNS,
    MAY_BE,
    Extreme,
    Metric,
    Unseen,
    by_place,
    comparison_table,
    simulator_errors,
)
from ..progress import Lines, Progress
from ..scenario import is_trained
from ..words import listed
from .printing import say, table_of

if TYPE_CHECKING:
    from rich.table import Table

    from ..check import CheckSummary
    from ..report import Finding
    from ..report import Table as PageTable
    from .calibrate import Summary

_METRICS = {"rmse": "RMSE, K", "mape_kelvin": "MAPE, % of K", "mape_celsius": "MAPE, % of °C", "crps": "CRPS, K"}
_WORST = 3
"""Nodes whose unmodelled heat is told."""
_WORTH_SAYING = 0.05
"""Share of a window's time, of what was not trained on."""
_NAMED = 4
_MOST_LIMITS = 12
"""Limits that are told, the likeliest to be passed first."""
_BETWEEN = 2
"""Characters between two columns."""
_COLOURS = {"good": "green", "warn": "yellow", "bad": "bold red", "none": "dim"}


@contextmanager
def display(console: Console | None = None) -> Iterator[Progress]:
    """Whom to tell how work goes on: a bar for each stage on a terminal, else lines."""
    console = console or Console(stderr=True)
    if not console.is_terminal:
        yield Lines(lambda line: say(console, line))
        return
    columns = (
        TextColumn("{task.description:<28}", markup=False),
        BarColumn(bar_width=30),
        TextColumn("{task.fields[note]}", markup=False),
    )
    with rich.progress.Progress(*columns, TimeElapsedColumn(), console=console) as bars:
        yield _Bars(bars)


@dataclass(frozen=True)
class _Bars:
    """A bar for each stage, which the stages inside of it share."""

    bars: rich.progress.Progress
    task: TaskID | None = None
    before: str = ""
    """What stands before a note."""

    @contextmanager
    def stage(self, title: str, total: float | None = None) -> Iterator[Progress]:
        if self.task is not None:
            self.bars.update(self.task, total=total, completed=0)
            yield _Bars(self.bars, self.task, f"{self.before}{title}: ")
            return
        task = self.bars.add_task(title, total=total, note="")
        yield _Bars(self.bars, task)
        whole = self.bars.tasks[task].total or 1.0
        self.bars.update(task, total=whole, completed=whole)

    def at(self, done: float, note: str = "") -> None:
        if self.task is not None:
            self.bars.update(self.task, completed=done, note=f"{self.before}{note}" if note else "")

    def say(self, line: str) -> None:
        self.bars.console.print(line, highlight=False, markup=False)


def print_summary(summary: Summary, console: Console | None = None) -> None:
    """The comparison of the methods, and at the end what the page begins with: the verdict and the parameters."""
    from .finished_run import chosen, parameter_table

    console = console or Console()
    _print_scores(summary.metrics, console)
    _print_channels(summary.metrics, console)
    for metric in summary.metrics:
        if (metric.method, metric.metric) == (GENETIC_RUNS, "converged"):
            runs = f"{_number(metric.value)} {metric.note.partition(';')[0]} converged"
            console.print(f"genetic algorithm: {runs}", highlight=False)
    if summary.heat:
        worst = ", ".join(f"{node} {share:.1%}" for node, share in list(summary.heat.items())[:_WORST])
        words = "unmodelled heat at its largest, as a share of what flows through the node"
        say(console, f"{words}: {worst}")
    _print_checked(summary, console)
    for window, found in summary.unseen.items():
        if words := unseen_in_words(found):
            say(console, f"{window}: {words}", "yellow")
    print_verdict(summary.verdict.record, summary.run, console)
    if rows := chosen(summary.parameters, every=False):
        console.print(parameter_table(rows, console))
    for error in simulator_errors(summary.metrics):
        say(console, str(error))
    print_limits(summary.limits, console)
    say(console, f"report: {summary.report}")


def print_verdict(verdict: Mapping[str, Any], run: Path, console: Console) -> None:
    """What the run can be used for, the three answers, and what to do next: as the page has it, but with the folder.

    verdict: content of verdict.json.
    """
    from ..report import MARKS  # which takes a second, for its figures

    console.print()
    say(console, verdict["use"], _COLOURS[verdict["state"]])
    for answer in verdict["answers"]:
        say(console, f"  {answer['question']} {MARKS[answer['state']]}: {answer['answer']}")
    here = f" {shlex.quote(str(run / 'scenario.yaml'))} --out {shlex.quote(str(run))}/"
    say(console, f"  next: {verdict['next'].replace(' scenario.yaml --out ', here)}")


def print_limits(told: Sequence[Extreme], console: Console) -> None:
    """Of plans: the chances that limits are passed, where they may be; of the others how many there are."""
    may_be = [extreme for extreme in told if extreme.state != "good"]
    for extreme in may_be[:_MOST_LIMITS]:
        say(console, str(extreme), _COLOURS[extreme.state])
    if more := may_be[_MOST_LIMITS:]:
        say(console, f"and {len(more)} more, with a chance of {more[0].chance_in_words} or less: see the page")
    if hardly := len(told) - len(may_be):
        say(console, f"limits that plans pass with a chance of {MAY_BE:.0%} or less: {hardly} of {len(told)}")


def _print_scores(metrics: Sequence[Metric], console: Console) -> None:
    """Of all channels: mean (as published) and best of the genetic algorithm's runs beside the stochastic update."""
    title = "Over all channels, with ratios to the genetic algorithm (GA)"
    numbers = ("GA mean", "GA best", "stochastic", "to mean", "to best")
    table = table_of(title, ("window", "metric"), numbers, overflow="fold")
    for row in comparison_table([metric for metric in metrics if metric.channel == "all"]):
        values = (row.genetic, row.genetic_best, row.stochastic, row.ratio, row.ratio_best)
        if any(value is not None for value in values):
            table.add_row(row.window, _METRICS[row.metric], *map(_number, values))
    console.print(table)


def _print_channels(metrics: Sequence[Metric], console: Console) -> None:
    """RMSE, coverage and width of the interval by channel, of the windows that were not trained on if there are any."""
    rows = [row for row in comparison_table(metrics) if row.metric == "rmse"]
    rows = [row for row in rows if not is_trained(row.window)] or rows
    found = by_place(metrics)
    numbers = ("GA best", "stochastic", "to best", "covers", "width")
    table = table_of("RMSE and interval by channel", ("window", "channel"), numbers, overflow="fold")
    scored: set[str] = set()
    for row in rows:
        place = ("stochastic", row.window, row.channel)
        covers, width = (_score(found.get((*place, name))) for name in ("picp", "mpiw"))
        values = (row.genetic_best, row.stochastic, row.ratio_best)
        if any(value is not None for value in values):
            table.add_row(row.window, row.channel, *map(_number, values), covers, width)
            scored.add(row.window)
    console.print(table)
    if left := list(dict.fromkeys(row.window for row in rows if row.window not in scored)):
        say(console, f"{listed(left)}: there is no telemetry to score; predicted in the report and in prediction.nc")


def print_beside(summary: Summary, others: Mapping[str, Summary], console: Console | None = None) -> None:
    """Scores over all channels: the genetic algorithm, the published model, flightcal's default, and other models."""
    console = console or Console()
    runs = {"flightcal": summary, **others}
    order = ("published", *(name for name in runs if name != "published"))
    columns = [("genetic", summary, "genetic"), *((name, runs[name], "stochastic") for name in order if name in runs)]
    title = "Beside other models, over all channels"
    table = table_of(title, ("window", "metric"), [name for name, _, _ in columns])
    found = [(method, by_place(of.metrics)) for _, of, method in columns]
    windows = list(dict.fromkeys(m.window for m in summary.metrics if m.method == "stochastic"))
    for window in windows:
        for metric in ("rmse", "crps", "picp", "mpiw"):
            table.add_row(window, metric, *(_score(of.get((method, window, "all", metric))) for method, of in found))
    console.print(table)
    for window in windows:
        worst = {name: _least_covered(of.metrics, method, window) for name, of, method in columns}
        said = ", ".join(f"{name} {share}" for name, share in worst.items() if share)
        say(console, f"{window}, channel that is covered least: {said}")
    for name, run in others.items():
        say(console, f"{name}: {run.verdict.use} Its report: {run.report}")
        _print_checked(run, console)


def _print_checked(summary: Summary, console: Console) -> None:
    """How far a reduced model is off the full simulator at posterior draws."""
    if summary.checked is None or not summary.checked["flights"]:
        return
    records = sorted(summary.checked["records"], key=lambda row: float(row["quantile_95"]))
    sensors = [f"{record['quantile_95']:.2f} K ({record['channel']})" for record in records if record["unit"] == "K"]
    duty = [100.0 * float(record["worst"]) for record in records if record["unit"] != "K"]
    words = (
        f"full simulator, {summary.checked['flights']} flights at the posterior's mean and draws: in 95% the reduced "
    )
    words += f"model is off by {sensors[0]} to {sensors[-1]}"
    if duty:
        words += f", and by at most {max(duty):.1f} percentage points of duty. A heater out of step shifts its sensor "
        words += "by up to its band"
    say(console, f"{words}.")


def _least_covered(metrics: Sequence[Metric], method: str, window: str) -> str:
    """The lowest coverage of a channel, and of which; "" where none is known."""
    shares = [m for m in metrics if (m.method, m.window, m.metric) == (method, window, "picp") and m.channel != "all"]
    worst = min((m for m in shares if m.value is not None), key=lambda m: m.value or 0.0, default=None)
    return "" if worst is None else f"{_score(worst)} {worst.channel}"


def _score(metric: Metric | None) -> str:
    if metric is None or metric.value is None:
        return "-"
    return f"{metric.value:.1%}" if metric.metric == "picp" else f"{_number(metric.value)} {metric.unit}"


def unseen_in_words(found: Sequence[Unseen]) -> str:
    """What of a window was not trained on; "" where it is little of its time."""
    shares = {unseen.name: unseen.share for unseen in found}
    if shares.get(ANY, 0.0) <= _WORTH_SAYING:
        return ""
    named = [f"{name} ({share:.0%})" for name, share in shares.items() if name != ANY]
    more = f" and {len(named) - _NAMED} more" if len(named) > _NAMED else ""
    return f"{shares[ANY]:.0%} of its time is outside of what was trained on: {', '.join(named[:_NAMED])}{more}"


def print_check(summary: CheckSummary, console: Console | None = None) -> None:
    """The verdict of a check, its findings in words, and where the page is."""
    console = console or Console()
    style = "green" if summary.passed else "bold red"
    console.print(f"\n{summary.verdict}", style=style, highlight=False, markup=False)
    bad = [finding for finding in summary.findings if finding.state == "bad"]
    cautions = [finding for finding in summary.findings if finding.state == "warn"]
    _print_findings(bad or summary.findings, console)
    if bad and cautions:
        console.print("\nCautions, which may follow from that; the page tells more of them:", highlight=False)
        for finding in cautions:
            console.print(Padding(_headline(finding), (0, 0, 0, 2), expand=False), highlight=False)
    say(console, f"\npage: {summary.page}")


def print_in_short(folder: Path, kind: str, page: Path, console: Console | None = None) -> None:
    """The first tables and the findings of a `backtest`, `comparison` or `validation`, and where its page is."""
    from ..report import in_short  # which takes a second, for its figures

    console = console or Console()
    tables, findings = in_short(folder, kind)
    for table in tables:
        console.print(_on_terminal(table, console.width))
    _print_findings(findings, console)
    say(console, f"\npage: {page}")


def _on_terminal(table: PageTable, width: int) -> Table:
    """A table of a page, each cell in one line: as many of its columns as fit, for the page has all."""
    rows = [[cell.partition("\n")[0] for cell in row] for row in table.rows]
    widths = [max(map(len, (*head.split(), *(row[k] for row in rows)))) for k, head in enumerate(table.header)]
    fit = sum(so_far - _BETWEEN <= width for so_far in accumulate(column_width + _BETWEEN for column_width in widths))
    shown = table_of("", table.header[:fit], ())
    for k, column in enumerate(shown.columns):
        column.justify = "right" if k in table.numbers else "left"
        column.width = widths[k]
    for row in rows:
        shown.add_row(*map(escape, row[:fit]))
    return shown


def _headline(finding: Finding) -> Text:
    return Text(f"{finding.mark}: {finding.title}", style=_COLOURS[finding.state])


def _print_findings(findings: Sequence[Finding], console: Console) -> None:
    for finding in findings:
        console.print()
        console.print(_headline(finding), highlight=False)
        for line in (finding.text, *(f"- {detail}" for detail in finding.details)):
            console.print(Padding(Text(line), (0, 0, 0, 2), expand=False), highlight=False)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"
