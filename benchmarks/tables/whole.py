"""The whole experiment, leo_observer from start to report, stage by stage."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from ruamel.yaml import YAML

from ..report import Section, Table
from ..timing import duration

_EXAMPLE = Path(__file__).parents[2] / "examples" / "leo_observer" / "scenario.yaml"
_LATER_RUNS = 3


def measure(quick: bool) -> Section:
    """A first run with an empty compilation cache, and later ones with the cache that it leaves."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        scenario = _scenario(place, quick)
        written = YAML(typ="safe").load(scenario.read_text(encoding="utf-8"))["calibration"]
        first = _run(scenario, place / "first", place / "cache")
        later = [_run(scenario, place / f"run_{k}", place / "cache") for k in range(1 if quick else _LATER_RUNS)]
    stages = [name for name in first if name not in ("passed", "all", "compilation")]
    typical = {name: sorted(run[name] for run in later)[len(later) // 2] for name in first}
    rows = [[name, duration(first[name]), duration(typical[name])] for name in [*stages, "all", "compilation"]]
    spread = f"{duration(min(run['all'] for run in later))} .. {duration(max(run['all'] for run in later))}"
    return Section(
        "Whole experiment",
        f"`examples/leo_observer`, start to report, each run in a new process. Genetic algorithm: "
        f"{written['genetic']['runs']} runs of {written['genetic']['population']} individuals and "
        f"{written['genetic']['generations']} generations; NUTS: {written['nuts']['chains']} chains of "
        f"{written['nuts']['draws']} draws; the stages' times are those of provenance.json.",
        [Table(["stage", "first run", "later run (median)"], rows)],
        [
            "Compilation is what Numba measures of itself, within the stages' times.",
            f"The first run finds an empty compilation cache; {len(later)} later ones took {spread}.",
            "All gates passed." if all(run["passed"] for run in later) else "Some gates failed; see the report.",
        ],
    )


def _scenario(folder: Path, quick: bool) -> Path:
    """The example with its telemetry; with less to do if `quick`."""
    written = YAML(typ="safe").load(_EXAMPLE.read_text(encoding="utf-8"))
    written["telemetry"]["file"] = str(_EXAMPLE.with_name("telemetry.csv"))
    if quick:
        written["calibration"]["genetic"] = {"runs": 2, "population": 32, "generations": 10}
        written["calibration"]["nuts"] = {"chains": 2, "draws": 100, "warmup": 100}
        written["calibration"]["prediction"] = {"simulations": 100}
    file = folder / "scenario.yaml"
    with file.open("w", encoding="utf-8") as stream:
        yaml = YAML(typ="safe")
        yaml.sort_base_mapping_type_on_output = False
        yaml.dump(written, stream)
    return file


def _run(scenario: Path, out: Path, cache: Path) -> dict[str, float]:
    command = [sys.executable, "-m", "benchmarks.children", "experiment", str(scenario), str(out)]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if done.returncode:
        raise AssertionError(f"the experiment failed: {done.stderr.strip().splitlines()[-1:]}")
    result: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return result
