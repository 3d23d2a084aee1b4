"""What a run directory holds, read once; a file that is not there is None and named in `missing`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import xarray as xr
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from ..calibration import (
    BEST_FIT_FILE,
    CALIBRATED_FILE,
    RESULTS_FILE,
    TABLE_FILE,
    Calibrated,
    FixedNumbers,
    PriorScore,
    heat_content,
    read_calibrated,
    read_fixed_numbers,
)
from ..errors import RunError
from ..prediction import Metric
from ..run import check_whole, read_dataset, read_json, read_records, read_tree, typed
from ..scenario import ICE_POINT, is_trained
from ..validation import ResidualCheck, check_window

Record = dict[str, Any]

K = TypeVar("K")
N = TypeVar("N", xr.Dataset, xr.DataTree)

_KEPT = 9
"""Files of netCDF: those of the three runs of the demonstration."""

ABSOLUTE = frozenset({"on_below", "off_above", "initial", "boundary"})
"""Fields of a scenario that are a temperature; other fields in kelvin, such as `bias`, are differences."""

STAGES = {
    "genetic.nc": "the genetic algorithm",
    "posterior.nc": "the stochastic calibration",
    "diagnostics.json": "the diagnosis of the chains",
    "prediction.nc": "the prediction",
    "metrics.json": "the scores",
    "priors.json": "the list of parameters",
    "telemetry_quality.json": "the quality of the telemetry",
    "provenance.json": "the provenance",
    "scenario.yaml": "the scenario",
}
"""Files of a run directory that the report reads, and what each is the result of."""


_TAKEN_AWAY = {
    CALIBRATED_FILE: "the scenario with these numbers",
    BEST_FIT_FILE: "that with the numbers that alone fit best",
    TABLE_FILE: "every quantity",
    RESULTS_FILE: "and correlations",
}


@dataclass(frozen=True)
class ParameterInfo:
    """An uncertain quantity: what priors.json says about it, and how it is shown."""

    name: str
    kind: str
    """parameter, drift, noise, discrepancy, heat, timing, error_rate, time or initial"""
    unit: str
    """As shown: SI, except degrees Celsius for an absolute temperature."""
    offset: float
    """To add to the SI value before it is shown: -273.15 for an absolute temperature."""
    target: tuple[str, ...]
    mode: str
    prior: str
    prior_quantiles: tuple[float, float, float]
    """At 2.5, 50 and 97.5 percent, SI."""
    observed: bool = True
    """Of an initial temperature: whether a channel sees it, so that its prior is no guess."""


@dataclass(frozen=True)
class RunFiles:
    """The files of a run directory."""

    folder: Path
    scenario: str | None
    provenance: Record | None
    genetic: xr.Dataset | None
    posterior: xr.DataTree | None
    windows: dict[str, xr.Dataset]
    """Groups of prediction.nc in its order, the training window first; empty without that file."""
    metrics: list[Metric]
    diagnostics: Record | None
    parameters: list[ParameterInfo]
    quality: list[Record] | None
    integration: list[Record]
    """Steps of the training windows and their error; empty without a thermal network."""
    emulator: Record | None
    """Of a simulator without derivatives only, as is the next."""
    emulator_check: Record | None
    full_check: Record | None
    """Of a calibration through a reduced model only."""
    suspects: list[Record]
    """Simple wrongs that explain the telemetry better than the scenario as it is, the likeliest first."""
    beside: dict[str, list[Metric]]
    """Scores of other models of the same satellite by their names, of the demonstration only."""
    backtest: Record | None
    """Of a backtest in the folder `backtest` of the run."""
    calibrated: tuple[Calibrated, ...]
    """Every quantity before and after; empty of a run that did not finish."""
    fixed_numbers: FixedNumbers | None
    """What values depend on that is fixed; None: nobody looked."""
    files: tuple[tuple[str, str], ...]
    """What lies in the folder to be taken away, and what each is."""
    missing: tuple[str, ...]
    stretches: int = 1_500
    """Into which figures divide long series, all plots together."""

    @property
    def test_windows(self) -> dict[str, xr.Dataset]:
        """Windows that were not calibrated on."""
        return {name: window for name, window in self.windows.items() if not is_trained(name)}

    @cached_property
    def written(self) -> Mapping[str, Any]:
        """The scenario as it is written; empty where there is none, or where it cannot be read."""
        try:
            content = YAML(typ="safe", pure=True).load(self.scenario or "")
        except YAMLError:
            return {}
        return content if isinstance(content, Mapping) else {}

    @property
    def nominal(self) -> float:
        """Probability of the intervals of temperatures."""
        return next((float(window.attrs["interval"]) for window in self.windows.values()), 0.95)

    @property
    def interval(self) -> str:
        """What they are called, such as ``95% interval``."""
        return f"{100 * self.nominal:g}% interval"

    @property
    def sampled(self) -> list[ParameterInfo]:
        """Parameters of which the posterior has draws; none without a posterior."""
        known = self.posterior["posterior"].data_vars if self.posterior is not None else {}
        return [info for info in self.parameters if info.name in known]

    @cached_property
    def prior_scores(self) -> dict[str, PriorScore]:
        """Where posteriors lie in their priors, as far as the diagnosis of the chains says it."""
        return {
            record["name"]: PriorScore(float(record["prior_score"]), float(record.get("usual_score") or 1.0))
            for record in (self.diagnostics or {}).get("parameters", [])
            if record.get("prior_score") is not None
        }

    @cached_property
    def heat(self) -> Record | None:
        """What unmodelled heat is made of, as the calibration kept it; None without any."""
        return None if self.posterior is None else heat_content(self.posterior)

    @cached_property
    def checks(self) -> dict[str, list[ResidualCheck]]:
        """Tests of the residuals by window, where there is a stochastic prediction."""
        return {
            name: check_window(window, unseen=not is_trained(name), heat=self.heat is not None)
            for name, window in self.windows.items()
            if has_prediction(window, "stochastic")
        }

    @property
    def checks_of_training(self) -> dict[str, list[ResidualCheck]]:
        """Tests of the residuals in windows that were trained on; of all where none was."""
        return {name: check for name, check in self.checks.items() if is_trained(name)} or self.checks


def read_run(folder: Path) -> RunFiles:
    """Reads a run directory. Raises RunError where it is none, or where a file in it cannot be read."""
    if not folder.is_dir():
        raise RunError(f"{folder}: no such directory; expected the directory that `flightcal calibrate` wrote")
    missing = tuple(name for name in STAGES if not (folder / name).is_file())
    # A scenario lies in other folders, too.
    if not {*STAGES} - {*missing, "scenario.yaml"}:
        raise RunError(f"{folder}: found no run, expected the directory that `flightcal calibrate` wrote")
    check_whole(folder)

    def kept(name: str, read: Callable[[Path], K]) -> K | None:
        return read(folder / name) if (folder / name).is_file() else None

    prediction = kept("prediction.nc", partial(_as_before, read_tree))
    windows = {n: group.to_dataset() for n, group in prediction.children.items()} if prediction else {}
    looked = kept("suspects.json", read_json) or {}
    return RunFiles(
        folder=folder,
        scenario=kept("scenario.yaml", lambda file: file.read_text(encoding="utf-8")),
        provenance=kept("provenance.json", read_json),
        genetic=kept("genetic.nc", partial(_as_before, read_dataset)),
        posterior=kept("posterior.nc", partial(_as_before, read_tree)),
        windows=dict(sorted(windows.items(), key=lambda item: not is_trained(item[0]))),
        metrics=kept("metrics.json", partial(read_records, read=partial(typed, Metric))) or [],
        diagnostics=kept("diagnostics.json", read_json),
        parameters=kept("priors.json", partial(read_records, read=parameter_info)) or [],
        quality=kept("telemetry_quality.json", read_json),
        integration=kept("integration.json", read_json) or [],
        emulator=kept("emulator.json", read_json),
        emulator_check=kept("emulator_check.json", read_json),
        full_check=kept("full_simulator_check.json", read_json),
        suspects=looked.get("found", []),
        beside=kept("beside.json", _beside) or {},
        backtest=kept("backtest/backtest.json", read_json),
        calibrated=kept(RESULTS_FILE, read_calibrated) or (),
        fixed_numbers=kept(RESULTS_FILE, read_fixed_numbers),
        files=tuple(file for file in _TAKEN_AWAY.items() if (folder / file[0]).is_file()),
        missing=missing,
    )


def _as_before(read: Callable[[Path], N], file: Path) -> N:
    """The same where the file is the one that was read last: a run is read for its verdict and again for its page."""
    found = file.stat()
    data: N = _read_once(read, file.absolute(), found.st_ino, found.st_size, found.st_mtime_ns)
    return data.copy()


@lru_cache(maxsize=_KEPT)
def _read_once(read: Callable[[Path], N], file: Path, *version: int) -> N:
    return read(file)


def read_content(folder: Path, kind: str) -> Record:
    """Content of `<kind>.json` in the folder of a comparison or validation. Raises RunError."""
    file = folder / f"{kind}.json"
    if not file.is_file():
        raise RunError(f"{folder}: found no {file.name}, expected the folder of a {kind}")
    content: Record = read_json(file)
    return content


_ENDLESS = 1e30
"""Its square is a number, and it is one in a figure's single precision."""


def draws(posterior: xr.DataTree, group: str, names: Sequence[str]) -> np.ndarray:
    """Draws of scalar quantities from a group of posterior.nc: [chain, draw, quantity], SI.

    A chain that runs away may have numbers without end; they are cut.
    """
    dataset = posterior[group].to_dataset()
    found = np.stack([dataset[n].transpose("chain", "draw").values for n in names], axis=-1)
    return found.clip(-_ENDLESS, _ENDLESS)


def parameter_info(record: Record) -> ParameterInfo:
    """What a record of priors.json says, as it is shown."""
    fields = {path.rsplit(".", 1)[-1] for path in record["target"]}
    sets_temperature = record["mode"] == "sets" and bool(fields) and fields <= ABSOLUTE
    absolute = record["unit"] == "K" and (record["kind"] == "initial" or sets_temperature)
    in_orbits = record["name"].startswith("discrepancy.phase.lengthscale")
    unit = "degC" if absolute else "orbits" if in_orbits else record["unit"]
    return typed(ParameterInfo, record | {"unit": unit, "offset": -ICE_POINT if absolute else 0.0})


def _beside(file: Path) -> dict[str, list[Metric]]:
    """Scores of other runs by the names of their models; their records have no units."""
    found: dict[str, list[Metric]] = {}
    for record in read_records(file, read=dict):
        fields = {"unit": ""} | {name: value for name, value in record.items() if name != "model"}
        found.setdefault(record["model"], []).append(typed(Metric, fields))
    return found


def bins(run: RunFiles) -> int:
    """Stretches of a series of which a figure has the extremes: fewer for many plots, so that the page stays small."""
    plots = sum(window.sizes["channel"] for window in run.windows.values())
    return int(np.clip(run.stretches // max(plots, 1), 10, 400))


def has_prediction(window: xr.Dataset, method: str) -> bool:
    """Whether a window's prediction has a method, with numbers in it."""
    return method in window["by"].values and bool(np.isfinite(window["mean"].sel({"by": method}).values).any())
