"""What a calibration leaves behind: the parameters as a table, and the scenario with the calibrated numbers."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, Final

import xarray

from ..errors import FlightcalError, RunError
from ..problem import Problem
from ..run import Run, Stage, plain, read_json, read_provenance, typed
from ..scenario import (
    RewritingError,
    Scenario,
    WrittenUnit,
    calibrated_numbers,
    calibrated_text,
    load_scenario,
    parameter_units,
    resolved_yaml,
    settable,
)
from .fixed_numbers import FixedNumbers, considered
from .heat_file import with_kept_heat
from .optimisation import best_fit
from .posterior import thetas_of
from .stages import Sampled
from .table import INTERVAL, Calibrated, calibrated, correlation

RESULTS_FILE, TABLE_FILE = "parameters.json", "parameters.csv"
CALIBRATED_FILE, BEST_FIT_FILE = "calibrated.yaml", "best_fit.yaml"
_OF_MEANS: Final = "posterior means: what the satellite is likely to be."
_OF_BEST_FIT: Final = (
    "those that alone fit the training best. Where the simulator lacks something\nthey make up for it, and lie beside "
    f"the truth: {CALIBRATED_FILE} has what the satellite is likely to be."
)
_DIGITS: Final = 6
_AGREE: Final = 1e-4
"""Relative; numbers are written with six digits."""


def _make(
    run: Run,
    problem: Problem,
    genetic: xarray.Dataset,
    sampled: Sampled,
    *,
    text: str,
    about: str,
    files: Sequence[str],
) -> None:
    best = dict(zip(problem.names, best_fit(problem, genetic).tolist(), strict=True))
    problem = with_kept_heat(problem, sampled.posterior)
    thetas = thetas_of(sampled.posterior, problem.names)
    settings, units = problem.scenario.calibration, parameter_units(text, problem.scenario)
    moved, fixed = considered(problem, thetas, settings.fixed_numbers_within, settings.seed) or (None, None)
    rows = calibrated(problem, thetas, units, moved)
    content = {
        "interval": INTERVAL,
        "parameters": rows,
        "fixed_numbers": None if fixed is None else _in_units(fixed, units),
        "correlation": {"names": problem.names, "matrix": correlation(thetas)},
    }
    run.folder.write_json(RESULTS_FILE, plain(content))
    run.folder.write_text(TABLE_FILE, _csv(rows))
    means = dict(zip(problem.names, thetas.mean(axis=0).tolist(), strict=True))
    provenance = read_provenance(run.path)
    _write(run, CALIBRATED_FILE, problem.scenario, text, means, _header(provenance, problem, about, _OF_MEANS))
    _write(run, BEST_FIT_FILE, problem.scenario, text, best, _header(provenance, problem, about, _OF_BEST_FIT))


def _write(run: Run, name: str, scenario: Scenario, text: str, values: Mapping[str, float], header: str) -> None:
    """Write a scenario's text with its parameters at values (by name, SI) as a file of the run."""
    resolved = resolved_yaml(scenario, absolute=True)
    for base, otherwise in ((text, "written without the scenario's comments"), (resolved, "not as it should be")):
        try:
            run.folder.write_text(name, calibrated_text(base, scenario, values, header))
            _check(run.folder.file(name), scenario, values)
        except FlightcalError as error:
            run.progress.say(f"{name}: {otherwise}: {error}")
        else:
            return


def _in_units(fixed: FixedNumbers, units: Mapping[str, WrittenUnit]) -> FixedNumbers:
    """What parameters depend on, in the units that these are shown in."""
    kept = (footing for footing in fixed.footings if footing.name in units)
    return replace(
        fixed, footings=tuple(replace(footing, change=footing.change / units[footing.name].factor) for footing in kept)
    )


def _check(file: Path, scenario: Scenario, means: Mapping[str, float]) -> None:
    """Raises FlightcalError unless the scenario in a file has the calibrated numbers."""
    found = settable(load_scenario(file))
    for path, wanted in calibrated_numbers(scenario, means).items():
        if not math.isclose(found[path].value, wanted, rel_tol=_AGREE):
            raise RewritingError(f"{path}: found {found[path].value:g} in it, expected {wanted:g}")


def _header(provenance: Mapping[str, Any], problem: Problem, about: str, numbers: str) -> str:
    """Of a scenario with other numbers: which run it is from, what it is good for, and what its numbers are."""
    created, identity = str(provenance.get("created", ""))[:19], str(provenance.get("identity", ""))[:12]
    scenario = problem.scenario
    windows = ", ".join(scenario.train_windows)
    heat = "The run also found unmodelled heat. Its predictions have it, simulations of this file do not.\n"
    return (
        f"Calibrated by flightcal {provenance.get('flightcal', '')}: run {identity} of {created} UTC, "
        f"seed {scenario.calibration.seed}, trained on {windows}.\n"
        f"{about}\n"
        f"Numbers that parameters set or scale are {numbers}\n"
        "What is believed of them before telemetry is as it was: the prior of a factor is divided by what its numbers\n"
        "were multiplied with.\n"
        f"{'' if problem.heat is None else heat}"
        f"Deviations, intervals and correlations stand in {RESULTS_FILE} of the run.\n"
    )


def _csv(rows: Sequence[Calibrated]) -> str:
    """The table, a line for each quantity, numbers with six digits."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = [field.name for field in fields(Calibrated)]
    writer.writerow(names)
    for row in rows:
        values = (getattr(row, name) for name in names)
        writer.writerow([f"{value:.{_DIGITS}g}" if isinstance(value, float) else value for value in values])
    return text.getvalue()


def read_calibrated(file: Path) -> tuple[Calibrated, ...]:
    """The quantities in a parameters.json. Raises RunError where it is damaged, or of an earlier flightcal."""
    content = read_json(file)
    try:
        return tuple(typed(Calibrated, record) for record in content["parameters"])
    except (KeyError, TypeError):
        found = "found another content than this flightcal writes"
        raise RunError(f"{file}: {found}; run the calibration again, which makes it anew") from None


def read_fixed_numbers(file: Path) -> FixedNumbers | None:
    """By how much fixed numbers were taken to be off in a parameters.json; None: nobody looked."""
    content = read_json(file).get("fixed_numbers")
    return None if content is None else typed(FixedNumbers, content)


def _read(run: Run, *_: Any) -> tuple[Calibrated, ...]:
    return read_calibrated(run.folder.file(RESULTS_FILE))


RESULTS: Final = Stage("results", "", (RESULTS_FILE, TABLE_FILE, CALIBRATED_FILE, BEST_FIT_FILE), _make, _read)
"""Of a problem and what the genetic algorithm and NUTS gave; text: of the scenario's file, about: lines of what the
result is worth, files: that the scenario names."""
