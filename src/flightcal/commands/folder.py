"""A run's folder as `calibrate` and `check` share it: what binds it to a scenario, and what was read for it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import xarray

from ..problem import SLOW, Problem
from ..progress import Progress
from ..run import Run, Stage, hash_of, hash_of_file, open_run, plain
from ..scenario import Scenario, default_noise, heat_of, input_files, is_trained, resolved_yaml, time_error_of
from ..telemetry import bridged, quality_table

K = TypeVar("K")


@contextmanager
def open_for(scenario: Scenario, out: Path, progress: Progress, **more: str) -> Iterator[Run]:
    """The run of a scenario in the folder `out`, which is held during the block.

    The folder is bound to what is calibrated on: the scenario without its method settings, its place and the windows
    that are only predicted, and the input files. more: hashes of what else it is bound to, by name.
    Raises RunError where the folder holds something else, or another process holds the folder.
    """
    inputs = {str(name): hash_of_file(Path(name)) for name in input_files(scenario)}
    # What is left out of these hangs together, and on the version of flightcal.
    meant = {
        "heat": heat_of(scenario) or "none",
        "noise": default_noise(scenario),
        "time_error": time_error_of(scenario) or "none",
    }
    content = scenario.model_copy(update=meant).model_dump(
        mode="json", exclude={"calibration", "description", "folder"}
    )
    for packet in (content["telemetry"], *content["telemetry"]["packets"].values()):
        del packet["file"]
    trained = {name: window for name, window in content.pop("windows").items() if is_trained(name)}
    parts = {
        "the scenario": hash_of(content),
        "the windows to train on": hash_of(trained),
        "the telemetry and other input files": hash_of(sorted(inputs.values())),
        **more,
    }
    text = resolved_yaml(scenario, absolute=True)
    with open_run(out, parts, text, inputs, scenario.calibration.seed, progress) as folder:
        yield Run(folder, progress)


def keep_what_was_read(run: Run, data: xarray.Dataset, problem: Problem) -> None:
    """Write what telemetry and problem are like, as JSON; they are what stages may be made from."""
    gaps = tuple(bridged(problem.scenario, data))
    for record in gaps:
        run.progress.say(record.detail)
    with run.folder.stage("read", run.folder.identity):
        run.folder.write_json("telemetry_quality.json", plain((*quality_table(data), *gaps)))
        run.folder.write_json("priors.json", parameter_records(problem))
        run.folder.write_json("integration.json", integration_records(problem))
    run.given(run.folder.identity, data, problem)


def integration_records(problem: Problem) -> list[dict[str, Any]]:
    """integration.json: the steps of each training window's integration and their error, K; empty without a network."""
    found = [(window.name, window.network.accuracy) for window in problem.windows if window.network is not None]
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


def heat_shares(posterior: xarray.DataTree) -> dict[str, float]:
    """Size of unmodelled heat over the heat that flows through its node, by node, largest first.

    Size: root of the sum of squares of the posterior means of its parts; empty: calibrated without heat.
    """
    if "heat" not in posterior.children:
        return {}
    model = json.loads(str(posterior["heat"]["model"].item()))
    sizes = posterior["posterior"].to_dataset()
    shares = {}
    for node, flow in zip(model["nodes"], model["flow"], strict=True):
        names = [name for part in ("constant", "pattern", *SLOW) if (name := f"heat.{node}.{part}") in sizes]
        shares[node] = math.hypot(*(float(sizes[name].mean()) for name in names)) / flow
    return dict(sorted(shares.items(), key=lambda item: -item[1]))
