"""A run whose page can be passed on: names are neutral, and each temperature is less a constant that is not told."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr

from ..calibration import Calibrated, heat_content
from ..prediction import Metric
from ..scenario import ICE_POINT, is_trained
from .run_files import Record, RunFiles

MASKED: Final = "masked"
REMARK: Final = (
    "Masked: names are replaced, and the temperatures of each channel are shown less a constant that is not told, as "
    "are all other absolute temperatures. Relative errors (MAPE), inputs and the scenario are left out."
)
_KINDS: Final = {
    "channels": "channel", "observations": "channel", "heaters": "heater", "parameters": "parameter", "nodes": "node",
    "faces": "face", "modes": "mode", "loads": "load", "boundaries": "node", "windows": "window", "drivers": "driver",
    "inputs": "input", "outputs": "output", "reduced": "number", "errors": "error",
}  # fmt: skip
"""Mappings of a scenario whose keys are names, and what the names are of."""
_TEMPERATURES: Final = (
    "observed",
    "mean",
    "lower",
    "upper",
    "model_lower",
    "model_upper",
    "lowest",
    "highest",
    "lower_limit",
    "upper_limit",
)
"""Variables of a window that are absolute temperatures."""
_WORDS: Final = frozenset({"kind", "part", "finding", "metric", "method", "mode", "unit"})
"""Fields whose values are flightcal's words and no names."""
_NEUTRAL: Final = frozenset({"train", "test"})
_NUMBER: Final = r"[-−]?\d+(?:\.\d+)?"
_ABSOLUTE: Final = re.compile(
    rf"(?:{_NUMBER}(?:\.\.|\s+to\s+))?{_NUMBER}\s*(?:°C|degC)|(?<![\d.])(?:[5-9]\d|\d{{3,}})(?:\.\d+)?\s*K\b"
)
"""Temperatures in a text, or both ends of a range of them: in kelvin from 50 on, for less is a difference."""
_OF_USER: Final = frozenset({"posterior", "prior", "windows"})
"""Groups of posterior.nc whose variables have the user's names."""
_OF_RECORD: Final = ("created", "flightcal", "python", "packages", "seed", "stages")
"""What of the provenance is told."""

Rename = Callable[[str], str]


def masked(run: RunFiles) -> RunFiles:
    """The run with neutral names and without absolute temperatures."""
    rename = _renaming(_names(run))
    told = _told(rename)
    offsets = _offsets(run)
    infos = [
        replace(
            info, name=rename(info.name), target=(), prior="" if info.offset else info.prior,
            unit="K" if info.offset else info.unit, offset=-info.prior_quantiles[1] if info.offset else 0.0,
        )
        for info in run.parameters
    ]  # fmt: skip
    absolute = {info.name for info in run.parameters if info.offset}
    return replace(
        run,
        folder=Path(MASKED),
        scenario=None if run.scenario is None else f"name: {MASKED}",
        provenance={key: (run.provenance or {}).get(key) for key in _OF_RECORD} if run.provenance else None,
        genetic=None if run.genetic is None else _dataset(run.genetic, rename, told),
        posterior=None if run.posterior is None else _tree(run.posterior, rename, told),
        windows={
            rename(name): _dataset(_less(window, offsets), rename, told).assign_attrs({MASKED: 1})
            for name, window in run.windows.items()
        },
        metrics=_metrics(run.metrics, rename),
        diagnostics=told(run.diagnostics),
        parameters=infos,
        quality=None if run.quality is None else [_finding(told(record)) for record in run.quality],
        integration=told(run.integration),
        emulator=told(run.emulator),
        emulator_check=told(run.emulator_check),
        full_check=told(run.full_check),
        suspects=told(run.suspects),
        beside={model: _metrics(metrics, rename) for model, metrics in run.beside.items()},
        backtest=None,
        calibrated=tuple(_row(quantity, rename, absolute) for quantity in run.calibrated),
        fixed_numbers=None if run.fixed_numbers is None else replace(run.fixed_numbers, footings=()),
        files=(),
    )


def _names(run: RunFiles) -> dict[str, str]:
    """Every name of the user's, and what stands for it."""
    found: dict[str, str] = {}
    counts: dict[str, int] = {}
    for kind, name in _named(run):
        if name and name not in found and name not in _NEUTRAL:
            counts[kind] = counts.get(kind, 0) + 1
            found[name] = f"{kind} {counts[kind]}"
    return found


def _named(run: RunFiles) -> Iterator[tuple[str, str]]:
    """Names with their kinds: those of the results, in their order, then all others of the scenario."""
    for window in run.windows.values():
        for kind in ("channel", "heater"):
            yield from ((kind, str(name)) for name in window.coords.get(kind, xr.DataArray([])).values)
    # Of several inputs that have one gap, all.
    yield from (("channel", name) for record in run.quality or () for name in str(record["channel"]).split(", "))
    yield from (("channel", metric.channel) for metric in run.metrics if metric.channel != "all")
    yield from (("parameter", info.name) for info in run.parameters if info.kind == "parameter")
    yield from (("node", info.name.partition(".")[2]) for info in run.parameters if info.kind == "initial")
    yield from (("node", str(name)) for name in (run.heat or {}).get("nodes", []))
    yield from (("window", name.partition(".")[2] or name) for name in run.windows if not name.endswith("."))
    yield "satellite", str(run.written.get("name") or "")
    yield from _in_blocks(run.written)


def _in_blocks(block: Any) -> Iterator[tuple[str, str]]:
    """Names in a block of a scenario."""
    if isinstance(block, list):
        for line in block:
            yield from _in_blocks(line)
    elif isinstance(block, Mapping):
        for key, value in block.items():
            if key in _KINDS and isinstance(value, Mapping):
                yield from ((_KINDS[key], str(name)) for name in value)
            yield from _in_blocks(value)


def _renaming(names: Mapping[str, str]) -> Rename:
    """Replaces names where they stand alone in a text, longer ones first."""
    if not names:
        return str
    longest = sorted(names, key=len, reverse=True)
    found = re.compile(rf"(?<![\w-])({'|'.join(map(re.escape, longest))})(?![\w-])")
    return lambda text: found.sub(lambda match: names[match[1]], text)


def _told(rename: Rename) -> Callable[[Any], Any]:
    """Replaces names and absolute temperatures in all that a record says."""

    def told(value: Any) -> Any:
        if isinstance(value, str):
            return _ABSOLUTE.sub("a temperature", rename(value))
        if isinstance(value, Mapping):
            return {key: inner if key in _WORDS else told(inner) for key, inner in value.items()}
        return [told(inner) for inner in value] if isinstance(value, list | tuple) else value

    return told


def _offsets(run: RunFiles) -> dict[str, float]:
    """Mean of each channel's telemetry in what was trained on, K."""
    found: dict[str, list[float]] = {}
    for window in (run.windows[name] for name in sorted(run.windows, key=lambda name: not is_trained(name))):
        observed = window["observed"].transpose("time", "channel").values
        for channel, values in zip(map(str, window["channel"].values), observed.T, strict=True):
            if np.isfinite(values).any():
                found.setdefault(channel, []).append(float(np.nanmean(values)))
    return {channel: means[0] for channel, means in found.items()}


def _less(window: xr.Dataset, offsets: Mapping[str, float]) -> xr.Dataset:
    """A window whose temperatures are less their channel's offset; zero is at 0 degC, so that figures show it so."""
    shifts = [offsets.get(str(name), ICE_POINT) - ICE_POINT for name in window["channel"].values]
    offset = xr.DataArray(shifts, dims="channel")
    return window.assign({name: window[name] - offset for name in _TEMPERATURES if name in window})


def _dataset(dataset: xr.Dataset, rename: Rename, told: Callable[[Any], Any]) -> xr.Dataset:
    coordinates = {
        name: (values.dims, [rename(str(value)) for value in values.values])
        for name, values in dataset.coords.items()
        if values.dtype.kind in "UO" and name != "by"
    }
    return dataset.assign_coords(coordinates).assign_attrs(_attributes(dataset.attrs, told))


def _attributes(attributes: Mapping[Any, Any], told: Callable[[Any], Any]) -> dict[Any, Any]:
    """Attributes; those that are records in JSON, as such."""
    found = {}
    for key, value in attributes.items():
        records = isinstance(value, str) and value[:1] in ("[", "{")
        found[key] = json.dumps(told(json.loads(value))) if records else told(value)
    return found


def _tree(tree: xr.DataTree, rename: Rename, told: Callable[[Any], Any]) -> xr.DataTree:
    """The posterior; its numbers are as they were, for the offset of a quantity is in how it is shown."""
    groups = {name: _dataset(group.to_dataset(), rename, told) for name, group in tree.children.items()}
    for name in _OF_USER & groups.keys():
        groups[name] = groups[name].rename_vars(
            {data_var: rename(str(data_var)) for data_var in groups[name].data_vars}
        )
    if (heat := heat_content(tree)) is not None:
        groups["heat"] = groups["heat"].assign(model=json.dumps(told(heat)))
    found = xr.DataTree.from_dict(groups)
    status = {rename(name): form for name, form in json.loads(tree.attrs.get("status_likelihood", "{}")).items()}
    found.attrs = _attributes(tree.attrs | {"status_likelihood": json.dumps(status)}, told)
    return found


def _metrics(metrics: list[Metric], rename: Rename) -> list[Metric]:
    """Without relative errors, which tell how warm it is."""
    return [
        replace(metric, window=rename(metric.window), channel=rename(metric.channel))
        for metric in metrics
        if not metric.metric.startswith("mape")
    ]


def _finding(record: Record) -> Record:
    """A finding about the telemetry; what it says in detail may be a temperature."""
    return record if record.get("finding") == "bridged" else record | {"detail": ""}


def _row(quantity: Calibrated, rename: Rename, absolute: set[str]) -> Calibrated:
    if quantity.name not in absolute and quantity.unit != "degC":
        return replace(quantity, name=rename(quantity.name))
    return replace(quantity.rescaled(lambda value: value - quantity.before, 1.0, "K"), name=rename(quantity.name))
