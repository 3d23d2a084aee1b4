"""What a run directory holds, read once; a file that is not there is None and named in `missing`."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flightcal.errors import RunError
from flightcal.scenario import is_trained
from flightcal.validation import Metric

Record = dict[str, Any]

ABSOLUTE = frozenset({"on_below", "off_above", "initial", "boundary"})
"""Fields of a scenario that are a temperature; other fields in kelvin, such as `bias`, are differences."""

STAGES = {
    "genetic.nc": "the genetic algorithm",
    "posterior.nc": "the stochastic calibration",
    "diagnostics.json": "the diagnosis of the chains",
    "prediction.nc": "the prediction",
    "metrics.json": "the scores",
    "parameters.json": "the list of parameters",
    "telemetry_quality.json": "the quality of the telemetry",
    "provenance.json": "the provenance",
    "scenario.yaml": "the scenario",
}
"""Files of a run directory that the report reads, and what each is the result of."""


@dataclass(frozen=True)
class ParameterInfo:
    """An uncertain quantity: what parameters.json says about it, and how it is shown."""

    name: str
    kind: str
    """parameter, noise or initial"""
    unit: str
    """As shown: SI, except degrees Celsius for an absolute temperature."""
    offset: float
    """To add to the SI value before it is shown: -273.15 for an absolute temperature."""
    target: tuple[str, ...]
    mode: str
    prior: str
    prior_quantiles: tuple[float, float, float]
    """At 2.5, 50 and 97.5 percent, SI."""


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
    emulator: Record | None
    """Of a simulator without derivatives only, as is the next."""
    emulator_check: Record | None
    full_check: Record | None
    """Of a calibration through a reduced model only."""
    missing: tuple[str, ...]

    @property
    def test_windows(self) -> dict[str, xr.Dataset]:
        """Windows that were not calibrated on."""
        return {name: window for name, window in self.windows.items() if not is_trained(name)}


def read_run(folder: Path) -> RunFiles:
    """Reads a run directory. Raises RunError where it is none, or where a file in it cannot be read."""
    if not folder.is_dir():
        raise RunError(f"{folder}: no such directory; expected the directory that `flightcal calibrate` wrote")
    missing = tuple(name for name in STAGES if not (folder / name).is_file())
    if len(missing) == len(STAGES):
        raise RunError(f"{folder}: none of {', '.join(STAGES)} is there; expected a run directory")
    posterior, prediction = _tree(folder / "posterior.nc"), _tree(folder / "prediction.nc")
    windows = {n: group.to_dataset() for n, group in prediction.children.items()} if prediction else {}
    scenario = folder / "scenario.yaml"
    return RunFiles(
        folder=folder,
        scenario=scenario.read_text(encoding="utf-8") if scenario.is_file() else None,
        provenance=_json(folder / "provenance.json"),
        genetic=_dataset(folder / "genetic.nc"),
        posterior=posterior,
        windows=dict(sorted(windows.items(), key=lambda item: not is_trained(item[0]))),
        metrics=_records(folder / "metrics.json", _metric),
        diagnostics=_json(folder / "diagnostics.json"),
        parameters=_records(folder / "parameters.json", _parameter),
        quality=_json(folder / "telemetry_quality.json"),
        emulator=_json(folder / "emulator.json"),
        emulator_check=_json(folder / "emulator_check.json"),
        full_check=_json(folder / "full_simulator_check.json"),
        missing=missing,
    )


def read_content(folder: Path, kind: str) -> Record:
    """Content of `<kind>.json` in the folder of a comparison or validation. Raises RunError."""
    file = folder / f"{kind}.json"
    try:
        content: Record = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise RunError(f"{folder}: found no {file.name}, expected the folder of a {kind}") from None
    except ValueError as error:
        raise RunError(f"{file}: not JSON: {error}") from None
    return content


def draws(posterior: xr.DataTree, group: str, names: list[str]) -> np.ndarray:
    """Draws of scalar quantities from a group of posterior.nc: [chain, draw, quantity], SI."""
    dataset = posterior[group].to_dataset()
    return np.stack([dataset[n].transpose("chain", "draw").values for n in names], axis=-1)


def _metric(record: Record) -> Metric:
    return Metric(**{k: record[k] for k in Metric.__dataclass_fields__ if k in record})


def _parameter(record: Record) -> ParameterInfo:
    target = tuple(record["target"])
    fields = {path.rsplit(".", 1)[-1] for path in target}
    sets_temperature = record["mode"] == "sets" and bool(fields) and fields <= ABSOLUTE
    absolute = record["unit"] == "K" and (record["kind"] == "initial" or sets_temperature)
    in_orbits = record["name"].startswith("discrepancy.phase.lengthscale")
    return ParameterInfo(
        name=record["name"],
        kind=record["kind"],
        unit="degC" if absolute else "orbits" if in_orbits else record["unit"],
        offset=-273.15 if absolute else 0.0,
        target=target,
        mode=record["mode"],
        prior=record["prior"],
        prior_quantiles=tuple(record["prior_quantiles"]),
    )


def _json(path: Path) -> Any:
    """Content of a JSON file, None where there is no file."""
    if not path.is_file():
        return None
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise RunError(f"{path}: not JSON: {error}") from None


def _records(path: Path, read: Any) -> list[Any]:
    """Records of a JSON list, each through `read`; empty where there is no file."""
    try:
        return [read(record) for record in _json(path) or []]
    except KeyError as error:
        raise RunError(f"{path}: a record has no field {error}") from None
    except TypeError as error:
        raise RunError(f"{path}: a record is not as expected: {error}") from None


def _dataset(path: Path) -> xr.Dataset | None:
    if not path.is_file():
        return None
    try:
        return xr.load_dataset(path, engine="h5netcdf")
    except (OSError, ValueError) as error:
        raise RunError(f"{path}: not a netCDF file: {error}") from None


def _tree(path: Path) -> xr.DataTree | None:
    if not path.is_file():
        return None
    try:
        with xr.open_datatree(path, engine="h5netcdf") as tree:
            return tree.load()
    except (OSError, ValueError) as error:
        raise RunError(f"{path}: not a netCDF file: {error}") from None


def bins(run: RunFiles) -> int:
    """Stretches into which a figure divides a long series: fewer for many plots, so that the page stays small."""
    plots = sum(window.sizes["channel"] for window in run.windows.values())
    return int(np.clip(6_000 // max(plots, 1), 40, 400))


def has_prediction(window: xr.Dataset, method: str) -> bool:
    """Whether a window's prediction has a method, with numbers in it."""
    return method in window["method"].values and bool(np.isfinite(window["mean"].sel({"method": method}).values).any())
