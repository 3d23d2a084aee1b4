"""A finished run as `show` and `diff` read it, and the table of its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rich.markup import escape

from ..calibration import BEST_FIT_FILE, CALIBRATED_FILE, RESULTS_FILE, TABLE_FILE, Calibrated, read_calibrated
from ..errors import RunError
from ..prediction import Metric
from ..run import check_whole, read_json, read_provenance, read_records, typed
from ..words import moment
from .printing import table_of

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

_STAGES: Final = ("nuts", "predict", "results")
_FILES: Final = ("scenario.yaml", "verdict.json", "metrics.json", RESULTS_FILE, TABLE_FILE, CALIBRATED_FILE)
_OTHERS: Final = {
    "backtest.json": "backtest",
    "comparison.json": "comparison",
    "campaign.json": "campaign",
    "check.json": "check",
}
_BEGUN: Final = "genetic"
"""A stage of calibrations: a check may stand in the folder of one."""
ABOUT: Final = {
    CALIBRATED_FILE: "the scenario with the calibrated numbers",
    BEST_FIT_FILE: "the scenario with the numbers that alone fit best",
    TABLE_FILE: "every quantity before and after",
    RESULTS_FILE: "the same, with correlations",
    "posterior.nc": "the draws, in ArviZ's netCDF",
    "report.html": "the report",
}
"""Files of a run that are to be taken away, and what each is."""
_WIDEST: Final = 1000
"""Characters, of no console: how wide a table would be."""


@dataclass(frozen=True)
class FinishedRun:
    """What a finished run says of itself."""

    folder: Path
    provenance: dict[str, Any]
    verdict: dict[str, Any]
    parameters: tuple[Calibrated, ...]
    metrics: tuple[Metric, ...]
    scenario: dict[str, Any]
    """As the run resolved it."""
    text: str
    """Of its file."""

    @property
    def title(self) -> str:
        """Which run it is."""
        name, made = self.scenario.get("name", ""), self.provenance
        created = moment(made.get("created"))
        return f"{name}, run {str(made.get('identity', ''))[:12]} of {created} UTC, flightcal {made.get('flightcal')}"


def read_finished(folder: Path) -> FinishedRun:
    """A finished run. Raises RunError where the folder holds none, or where a file in it is damaged."""
    wanted = "expected the folder of a run that 'flightcal calibrate' wrote"
    if not folder.exists():
        raise RunError(f"{folder}: found nothing there, {wanted}")
    if not folder.is_dir():
        raise RunError(f"{folder}: found a file, {wanted}")
    provenance = read_provenance(folder)
    done = provenance.get("stage_inputs", {})
    others = [kind for name, kind in _OTHERS.items() if (folder / name).is_file()]
    other = next((kind for kind in others if kind != "check" or _BEGUN not in done), None)
    if other is not None or not provenance:
        raise RunError(f"{folder}: found {f'a {other}' if other else 'no run'}, {wanted}")
    lacking = [f"stage '{name}'" for name in _STAGES if name not in done]
    lacking += [name for name in _FILES if not (folder / name).is_file()]
    if lacking:
        again = "run the same 'flightcal calibrate' again, which takes up where it stopped"
        raise RunError(f"{folder}: found an unfinished run ({lacking[0]} is missing), expected a finished one; {again}")
    check_whole(folder)
    return FinishedRun(
        folder,
        provenance,
        read_json(folder / "verdict.json"),
        read_calibrated(folder / RESULTS_FILE),
        tuple(read_records(folder / "metrics.json", partial(typed, Metric))),
        _yaml(folder / "scenario.yaml"),
        (folder / "scenario.yaml").read_text(encoding="utf-8"),
    )


def chosen(parameters: Sequence[Calibrated], every: bool) -> list[Calibrated]:
    """What a table has: the scenario's parameters, or every quantity."""
    return [quantity for quantity in parameters if every or quantity.is_parameter]


def parameter_table(parameters: Sequence[Calibrated], console: Console) -> Table:
    """Before, after, interval, that if fixed numbers are off where it is known, and how much is the data's word.

    Where the console is too narrow for all columns, the interval if fixed numbers are off is below the other.
    """
    table = _parameter_table(parameters, beside=True)
    if console.measure(table, options=console.options.update(max_width=_WIDEST)).maximum <= console.width:
        return table
    return _parameter_table(parameters, beside=False)


def _parameter_table(parameters: Sequence[Calibrated], beside: bool) -> Table:
    from ..words import interval

    is_known = any(quantity.considered is not None for quantity in parameters)
    where = "" if beside else " below it"
    of_fixed = f" if fixed numbers are exact, and{where} the interval if they are off" if is_known else ""
    title = f"Parameters: median before; mean [95%] after{of_fixed}; share from data"
    columns = ("before", "after", *(["fixed off"] if is_known and beside else []), "data")
    table = table_of(title, ("name, unit",), columns, overflow="fold")
    for quantity in parameters:
        cells = [f"{quantity.name}, {quantity.unit}" if quantity.unit else quantity.name]
        cells.append(interval(quantity.before, quantity.before_lower, quantity.before_upper).partition(" ")[0])
        cells.append(interval(quantity.mean, quantity.lower, quantity.upper))
        if is_known:
            fixed = (
                "–" if quantity.considered is None else interval(quantity.mean, *quantity.considered).partition(" ")[2]
            )
            cells[2:] = [cells[2], fixed] if beside else [f"{cells[2]}\n{fixed}"]
        table.add_row(*map(escape, (*cells, f"{quantity.from_data:.1%}")))
    return table


def _yaml(file: Path) -> dict[str, Any]:
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    try:
        content = YAML(typ="safe", pure=True).load(file.read_text(encoding="utf-8"))
    except YAMLError as error:
        raise RunError(f"{file}: not YAML: {error}") from None
    return content if isinstance(content, dict) else {}
