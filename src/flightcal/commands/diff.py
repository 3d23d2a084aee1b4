"""`flightcal diff`: two runs side by side, from their files alone."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from copy import deepcopy
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .printing import say, table_of

if TYPE_CHECKING:
    from rich.console import Console

    from ..calibration import Calibrated
    from .finished_run import FinishedRun

_FEW = 20
"""Differences between scenarios that are told."""
_SCORES = ("rmse", "crps", "picp", "mpiw")
_TO_95 = 1.96
"""Deviations of a normal distribution from its mean to an end of its 95% interval."""
_SEVERAL = 2.0
"""Deviations from which on a difference is marked."""


def diff(
    first: Annotated[Path, typer.Argument(help="Folder of a run.", show_default=False)],
    second: Annotated[Path, typer.Argument(help="Folder of another run of the satellite.", show_default=False)],
    every: Annotated[
        bool, typer.Option("--all", help="Every quantity and every difference between the scenarios.")
    ] = False,
) -> None:
    """Compare two runs of a satellite: verdicts, what differs in their scenarios, parameters and scores.

    Example: `flightcal diff runs/march runs/april`
    """
    from rich.console import Console

    print_difference(first, second, Console(), every=every)


def print_difference(first: Path, second: Path, console: Console, *, every: bool = False) -> None:
    """Two finished runs of a satellite side by side. Raises RunError, also where they have nothing in common."""
    from .finished_run import read_finished

    one, two = read_finished(first), read_finished(second)
    _check_comparable(one, two)
    for label, run in (("A", one), ("B", two)):
        say(console, f"{label}: {run.title}")
        say(console, f"   {run.verdict['use']}")
    _print_answers(one, two, console)
    _print_scenarios(one, two, console, every)
    _print_parameters(one, two, console, every)
    _print_scores(one, two, console)


def in_deviations(one: Calibrated, two: Calibrated) -> float:
    """Difference of two medians over the root of the sum of their variances, in the same unit; NaN: no deviation.

    A variance is that of a normal distribution whose 95% interval reaches as far towards the other one: a posterior may
    have a long tail on its other side.
    """
    low, high = sorted((one, two), key=lambda quantity: quantity.median)
    deviation = math.hypot(high.median - high.lower, low.upper - low.median) / _TO_95
    return (two.median - one.median) / deviation if deviation > 0.0 else math.nan


def differences(one: Any, two: Any, place: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Where two nested values differ: dotted place, and what stands there in each; None: nothing."""
    pair = (one, two)
    if all(isinstance(value, Mapping) for value in pair):
        for key in dict.fromkeys([*one, *two]):
            yield from differences(one.get(key), two.get(key), f"{place}.{key}".lstrip("."))
    elif all(isinstance(value, list) for value in pair) and len(one) == len(two):
        for k, (left, right) in enumerate(zip(one, two, strict=True)):
            yield from differences(left, right, f"{place}[{k}]")
    elif one != two:
        yield place, one, two


def changed_files(one: Mapping[str, str], two: Mapping[str, str]) -> list[str]:
    """Names of the files that are not in both with the same content. one, two: hashes by path."""
    only = set(one.values()) ^ set(two.values())
    found = sorted({*one.items(), *two.items()})
    return list(dict.fromkeys(Path(path).name for path, content in found if content in only))


def in_terms_of(one: FinishedRun, two: FinishedRun, quantity: Calibrated) -> Calibrated:
    """A quantity of the second run as one of the first: a factor is one of the first run's numbers."""
    from ..scenario import number_in

    parameter = (two.scenario.get("parameters") or {}).get(quantity.name, {})
    if parameter.get("sets") or not parameter.get("scales"):
        return quantity
    base, other = (number_in(run.text, parameter["scales"][0]) for run in (one, two))
    if not base or not other:
        return quantity
    return quantity.rescaled(lambda value: value * other / base, other / base, quantity.unit)


def in_unit_of(one: Calibrated, two: Calibrated) -> Calibrated:
    """The second quantity in the unit of the first."""
    from ..scenario import si_unit, written_unit

    if one.unit == two.unit:
        return two
    si = si_unit(one.unit)
    first_unit, other = written_unit(one.unit, si), written_unit(two.unit, si)
    return two.rescaled(lambda value: first_unit.of(other.si(value)), other.factor / first_unit.factor, one.unit)


def _check_comparable(one: FinishedRun, two: FinishedRun) -> None:
    from ..errors import RunError

    for what, block in (("channel", "observations"), ("parameter", "parameters")):
        names = [list(run.scenario.get(block) or ()) for run in (one, two)]
        if any(names) and not set(names[0]) & set(names[1]):
            places = zip(names, (one, two), strict=True)
            found = " and ".join(f"{', '.join(place[:3]) or 'none'} in {run.folder}" for place, run in places)
            raise RunError(f"found no {what} in common ({found}), expected two runs of one satellite")


def _print_answers(one: FinishedRun, two: FinishedRun, console: Console) -> None:
    from ..report import MARKS

    for left, right in zip(one.verdict["answers"], two.verdict["answers"], strict=False):
        if (left["state"], left["answer"]) == (right["state"], right["answer"]):
            say(console, f"   {left['question']} both {MARKS[left['state']]}: {left['answer']}")
            continue
        say(console, f"   {left['question']}")
        for label, answer in (("A", left), ("B", right)):
            say(console, f"      {label} {MARKS[answer['state']]}: {answer['answer']}")


def _print_scenarios(one: FinishedRun, two: FinishedRun, console: Console, every: bool) -> None:
    left, right = (_compared(run.scenario) for run in (one, two))
    found = sorted(differences(left, right), key=lambda item: _weight(item[0]))
    if changed := changed_files(one.provenance.get("inputs", {}), two.provenance.get("inputs", {})):
        found.append((f"content of {', '.join(changed)}", "", ""))
    console.print(f"\nScenarios: {f'{len(found)} differences' if found else 'the same'}", highlight=False)
    for place, before, other in found if every else found[:_FEW]:
        say(console, f"  {place}: {_short(before)} -> {_short(other)}" if (before, other) != ("", "") else f"  {place}")
    if not every and len(found) > _FEW:
        console.print(f"  and {len(found) - _FEW} more with --all", highlight=False)


def _print_parameters(one: FinishedRun, two: FinishedRun, console: Console, every: bool) -> None:
    from rich.markup import escape

    from ..words import interval
    from .finished_run import chosen

    title = "Parameters, mean [95%], and B - A in deviations"
    table = table_of(title, ("name, unit",), ("A", "B", "B - A"), overflow="fold")
    left, right = ({quantity.name: quantity for quantity in chosen(run.parameters, every)} for run in (one, two))
    for name in dict.fromkeys([*left, *right]):
        a, b = left.get(name), right.get(name)
        unit = (a or right[name]).unit
        named = f"{name}, {unit}" if unit else name
        b = in_unit_of(a, in_terms_of(one, two, b)) if a is not None and b is not None else b
        cells = [
            "-" if quantity is None else interval(quantity.mean, quantity.lower, quantity.upper) for quantity in (a, b)
        ]
        off = in_deviations(a, b) if a is not None and b is not None else math.nan
        mark = "" if not abs(off) >= _SEVERAL else "yellow"
        table.add_row(
            escape(named), *map(escape, cells), "-" if math.isnan(off) else f"{round(off, 1) + 0.0:+.1f}", style=mark
        )
    if table.row_count:
        console.print(table)


def _print_scores(one: FinishedRun, two: FinishedRun, console: Console) -> None:
    """Scores of the stochastic update over all channels, in the windows of either."""
    from rich.markup import escape

    title = "Stochastic update, all channels"
    table = table_of(title, ("window", "metric", "unit"), ("A", "B"), overflow="fold")
    left, right = (
        {(m.window, m.metric): m for m in run.metrics if (m.method, m.channel) == ("stochastic", "all")}
        for run in (one, two)
    )
    for place in dict.fromkeys([*left, *right]):
        pair = [scores.get(place) for scores in (left, right)]
        if place[1] in _SCORES:
            unit = next(m.unit for m in pair if m is not None)
            cells = ["-" if m is None or m.value is None else f"{m.value:.4g}" for m in pair]
            table.add_row(escape(place[0]), place[1], unit, *cells)
    console.print(table)
    of_windows = [run.scenario.get("windows") or {} for run in (one, two)]
    others = [name for name in of_windows[0] if of_windows[0][name] != of_windows[1].get(name, of_windows[0][name])]
    if others:
        say(console, f"Scores of {', '.join(others)} are of different times in A and B.")


def _compared(scenario: Mapping[str, Any]) -> dict[str, Any]:
    """A scenario without where its telemetry lies, for its content is compared; with no word on heat, the default's.

    Conductors have the names that parameters call them by.
    """
    telemetry = deepcopy(scenario.get("telemetry", {}))
    for packet in (telemetry, *telemetry.get("packets", {}).values()):
        packet.pop("file", None)
    simulator = dict(scenario.get("simulator") or {})
    if "conductors" in simulator:
        simulator["conductors"] = _named(simulator["conductors"])
    return {**scenario, "simulator": simulator, "telemetry": telemetry, "heat": scenario.get("heat") or "default"}


def _named(conductors: list[Any]) -> dict[str, Any]:
    """Conductors by their labels; the second of a label has its number behind it."""
    found: dict[str, Any] = {}
    seen: Counter[str] = Counter()
    for conductor in conductors:
        label = str(conductor.get("name") or "-".join(map(str, conductor.get("between", ()))))
        seen[label] += 1
        found[label if seen[label] == 1 else f"{label} {seen[label]}"] = conductor
    return found


def _weight(place: str) -> int:
    """Windows come first: scores are of other telemetry there. Where nodes begin comes last."""
    return 0 if place.startswith("windows.") else 2 if place.endswith(".initial") else 1


def _short(value: Any) -> str:
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
