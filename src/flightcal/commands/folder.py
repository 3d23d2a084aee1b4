"""A run's folder as `calibrate` and `check` share it: what binds it to a scenario, and what was read for it."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
import xarray

from ..errors import FlightcalError
from ..problem import Problem
from ..progress import Progress
from ..run import INPUT_FILES, OtherRunError, Run, Stage, hash_of, hash_of_file, open_run, plain
from ..scenario import (
    Scenario,
    default_noise,
    discrepancy_of,
    heat_of,
    input_files,
    is_trained,
    load_scenario,
    resolved_yaml,
    time_error_of,
)
from ..telemetry import bridged, quality_table, window_bounds
from .diff import differences

K = TypeVar("K")

_SCENARIO = "the scenario"
_FEW = 3
"""Places that are named where two scenarios differ."""

_SLEW = np.timedelta64(1, "h")
"""By which a change of attitude may act before its time, at most."""


@contextmanager
def open_for(
    scenario: Scenario,
    out: Path,
    progress: Progress,
    trained: xarray.Dataset | None = None,
    more: Mapping[str, str] = MappingProxyType({}),
) -> Iterator[Run]:
    """The run of a scenario in the folder `out`, which is held during the block.

    The folder is bound to what is calibrated on: the scenario without its method settings, its place and the windows
    that are only predicted, and the input files. more: hashes of what else it is bound to, by name.

    trained: the telemetry, where the windows to train on are all that is learnt from it. It may then grow in other
    windows, and so may timelines after the last of these. None: every byte of the files counts.
    Raises RunError where the folder holds something else, or another process holds the folder.
    """
    inputs = {str(name): hash_of_file(Path(name)) for name in input_files(scenario)}
    content = _bound(scenario)
    windows = {name: window for name, window in content.pop("windows").items() if is_trained(name)}
    for window in windows.values():
        # No window to train on is planned, and runs from before there were plans stay what they are.
        del window["planned"]
    parts, last = {"the windows to train on": hash_of(windows), **more}, None
    if trained is None:
        parts[f"the telemetry and other {INPUT_FILES}"] = hash_of(sorted(inputs.values()))
    else:
        last = _last_of(scenario, trained)
        _cut_after(content, last)
        read = {str(scenario.folder / name) for name in scenario.telemetry.files}
        parts["the telemetry of the windows to train on"] = _hash_of_windows(scenario, trained)
        parts[f"the other {INPUT_FILES}"] = hash_of(
            sorted(digest for name, digest in inputs.items() if name not in read)
        )
    parts[_SCENARIO] = hash_of(content)
    text = resolved_yaml(scenario, absolute=True)
    try:
        with open_run(out, parts, text, inputs, scenario.calibration.seed, progress) as folder:
            yield Run(folder, progress)
    except OtherRunError as error:
        places = _places(out, content, last)
        named = f"{_SCENARIO}: {', '.join(places)}"
        names = [named if name == _SCENARIO and places else name for name in error.names]
        raise OtherRunError(out, names) from None


def _places(out: Path, content: Mapping[str, Any], last: np.datetime64 | None) -> list[str]:
    """The first places at which a scenario, as a run is bound to it, differs from that of the run in a folder.

    last: see `_cut_after`.
    """
    try:
        before = _bound(load_scenario(out / "scenario.yaml"))
    except FlightcalError:  # its files are elsewhere now
        return []
    del before["windows"]
    if last is not None:
        _cut_after(before, last)
    return [place for place, *_ in differences(before, content)][:_FEW]


def _bound(scenario: Scenario) -> dict[str, Any]:
    """What of a scenario a run is bound to, as JSON."""
    # What is left out of these hangs together, and on the version of flightcal.
    meant = {
        "heat": heat_of(scenario) or "none",
        "noise": default_noise(scenario),
        "discrepancy": discrepancy_of(scenario),
        "time_error": time_error_of(scenario) or "none",
    }
    content: dict[str, Any] = scenario.model_copy(update=meant).model_dump(
        mode="json", exclude={"calibration", "description", "folder"}
    )
    for packet in (content["telemetry"], *content["telemetry"]["packets"].values()):
        del packet["file"]
    for channel in content["telemetry"]["channels"].values():
        del channel["limits"]
    for parameter in content["parameters"].values():
        # Runs from before there were trends stay what they are.
        if parameter["trend"] is None:
            del parameter["trend"]
    return content


def _cut_after(content: dict[str, Any], end: np.datetime64) -> None:
    """Leave out what a scenario says of later times: changes of mode and attitude, and which samples are used."""
    for block in (content["simulator"], content["environment"].get("attitude")):
        if isinstance(block, dict) and isinstance(block.get("timeline"), list):
            block["timeline"] = [change for change in block["timeline"] if np.datetime64(change["at"], "ns") <= end]
            block.pop("timeline_file", None)
    # What was read tells what they do in the windows to train on.
    for channel in content["telemetry"]["channels"].values():
        for key in ("leave_out", "invalid", "valid_range", "valid_where", "stale_after"):
            channel.pop(key, None)


def _bounds(scenario: Scenario, telemetry: xarray.Dataset) -> list[tuple[np.datetime64, np.datetime64]]:
    """Of the windows to train on."""
    period = telemetry.attrs.get("period_s")
    return [window_bounds(scenario.windows[name], period) for name in scenario.train_windows]


def _last_of(scenario: Scenario, telemetry: xarray.Dataset) -> np.datetime64:
    """When the last window to train on ends; a slew may begin before the change that it is of."""
    return max(end for _, end in _bounds(scenario, telemetry)) + _SLEW


def _hash_of_windows(scenario: Scenario, telemetry: xarray.Dataset) -> str:
    """Of all samples in the windows to train on, drivers' too."""
    times = telemetry["time"].to_numpy()
    inside = np.zeros(len(times), bool)
    for start, end in _bounds(scenario, telemetry):
        inside |= (times >= start) & (times < end)
    content = hashlib.sha256(times[inside].astype("datetime64[ns]").tobytes())
    for name in sorted(map(str, telemetry["channel"].to_numpy())):
        values = telemetry[name].to_numpy()[inside].astype(float)
        content.update(name.encode())
        content.update(np.where(np.isfinite(values), values, np.nan).tobytes())
    return content.hexdigest()


def keep_what_was_read(run: Run, data: xarray.Dataset, problem: Problem) -> None:
    """Write what telemetry and problem are like, as JSON; they are what stages may be made from."""
    gaps = tuple(bridged(problem.scenario, data))
    for record in gaps:
        run.progress.say(record.detail)
    key = key_of_telemetry(run, problem.scenario)
    with run.folder.stage("read", key):
        run.folder.write_json("telemetry_quality.json", plain((*quality_table(data), *gaps)))
        run.folder.write_json("priors.json", parameter_records(problem))
        run.folder.write_json("integration.json", integration_records(problem))
    run.given(key, data)
    run.given(run.folder.identity, problem)


def key_of_telemetry(run: Run, scenario: Scenario) -> str:
    """Hash of what follows from all telemetry, and from what the scenario says of all times."""
    content = {name: value for name, value in _bound(scenario).items() if name != "windows"}
    files = sorted(hash_of_file(Path(name)) for name in input_files(scenario))
    return hash_of(run.folder.identity, content, files)


def integration_records(problem: Problem) -> list[dict[str, Any]]:
    """integration.json: the steps of each training window's integration and their error, K; empty without a network."""
    found = [(window.name, window.network.accuracy) for window in problem.windows if window.is_network]
    return [{"window": name, **asdict(accuracy)} for name, accuracy in found if accuracy is not None]


def parameter_records(problem: Problem) -> list[dict[str, Any]]:
    """priors.json: what each entry of theta is, its prior and its unit."""
    quantiles = np.stack([problem.priors.quantile(p) for p in (0.025, 0.5, 0.975)], axis=1)
    seen = {item.node or item.output for item in problem.scenario.observations.values()}
    records = []
    for entry, of_prior in zip(problem.entries, quantiles.tolist(), strict=True):
        values = ", ".join(f"{key} {value:.6g}" for key, value in entry.prior.model_dump(exclude={"kind"}).items())
        records.append(
            {
                "name": entry.name,
                "kind": entry.kind,
                "unit": entry.unit,
                "target": [*entry.sets, *entry.scales],
                "mode": "sets" if entry.sets else "scales" if entry.scales else "",
                "prior": f"{entry.prior.kind}: {values}",
                "prior_quantiles": of_prior,
                "observed": entry.kind != "initial" or any(entry.name.endswith(f".{place}") for place in seen),
            }
        )
    return records


def taken_over(stage: Stage[K], made: Path | None) -> Stage[K]:
    """A stage that copies its files from the run in the folder `made`, where the same stage has made them.

    None: the stage itself.
    """
    if made is None:
        return stage

    def copy(run: Run, *_: Any, **__: Any) -> None:
        for name in stage.files:
            run.folder.write(name, (made / name).read_bytes())

    return replace(stage, make=copy)
