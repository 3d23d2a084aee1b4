"""The whole experiment as published, leo_observer from start to report, stage by stage."""

from __future__ import annotations

import tempfile
from pathlib import Path

from ruamel.yaml import YAML

from ..apart import measured_apart
from ..report import Section, Table
from ..timing import duration

_EXAMPLE = Path(__file__).parents[2] / "examples" / "leo_observer" / "published.yaml"
_LATER_RUNS = 3


def measure(quick: bool) -> Section:
    """A first run with an empty compilation cache, and later ones with the cache that it leaves."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        scenario = _scenario(place, quick)
        written = YAML(typ="safe").load(scenario.read_text(encoding="utf-8"))["calibration"]
        first = measured_apart("experiment", scenario, place / "first", cache=place / "cache")
        later = [
            measured_apart("experiment", scenario, place / f"run_{k}", cache=place / "cache")
            for k in range(1 if quick else _LATER_RUNS)
        ]
    stages = [name for name in first if name not in ("passed", "all", "compilation")]
    typical = {name: sorted(run[name] for run in later)[len(later) // 2] for name in first}
    rows = [[name, duration(first[name]), duration(typical[name])] for name in [*stages, "all", "compilation"]]
    spread = f"{duration(min(run['all'] for run in later))} .. {duration(max(run['all'] for run in later))}"
    return Section(
        "Whole experiment",
        f"`examples/leo_observer/published.yaml`, start to report, each run in a new process. Genetic algorithm: "
        f"{written['genetic']['runs']} runs of {written['genetic']['population']} individuals, until they "
        f"converge, and of {written['genetic']['generations']} generations at most; NUTS: {written['nuts']['chains']} "
        f"chains of {written['nuts']['draws']} draws; the stages' times are those of provenance.json.",
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
