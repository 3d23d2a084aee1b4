"""The gradient of a reduced model beside that of networks with about as many states."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from flightcal.commands.demo import DEMO
from flightcal.problem import Problem, build_problem
from flightcal.reduction import scenario_of
from flightcal.scenario import Window, load_scenario
from flightcal.telemetry import read

from ..report import Section, Table
from ..timing import interleaved, ratio_text, ratios

_REFERENCE = "network of 12 nodes"
_WINDOW = {"train": Window.model_validate({"start": "2024-03-01T01:42:00", "orbits": 2})}


def _problem(file: Path, folder: Path) -> Problem:
    """Of the bundled satellite's first window, with independent noise and without heat."""
    content: dict[str, Any] = YAML(typ="safe").load(file)
    for block in ("discrepancy", "noise"):
        content.pop(block, None)
    content |= {"heat": "none", "noise": {"model": "iid"}}
    changed = folder / f"{file.stem}.yaml"
    with changed.open("w") as opened:
        YAML().dump(content, opened)
    scenario = load_scenario(changed, telemetry=DEMO / "telemetry.csv").model_copy(update={"windows": _WINDOW})
    return build_problem(scenario, read(scenario))


def measure(quick: bool) -> Section:
    """The table."""
    with tempfile.TemporaryDirectory() as name:
        reduced = scenario_of(DEMO / "reduce.yaml", Path(name))
        problems = {
            _REFERENCE: _problem(DEMO / "with_discrepancy.yaml", Path(name)),
            "network of 9 nodes": _problem(DEMO / "published.yaml", Path(name)),
            "reduced model of 12 states": _problem(reduced, reduced.parent),
        }
    points = {name: np.zeros(len(problem.names)) for name, problem in problems.items()}
    timings = interleaved(
        {
            name: lambda problem=problem, z=points[name]: problem.log_density_and_gradient(z)
            for name, problem in problems.items()
        },
        9 if quick else 41,
    )
    relative = ratios(timings, _REFERENCE)
    rows = []
    for name, problem in problems.items():
        network = problem.windows[0].network
        unknowns, steps = len(network.integrated.mass), len(network.drive.times) - 1
        rows.append([name, str(unknowns), str(steps), str(timings[name]), ratio_text(relative[name])])
    columns = ("", "unknowns", "steps", "one gradient", "over the 12 nodes")
    return Section(
        "Gradient of a reduced model",
        "The bundled satellite, two orbits, three thermostats in closed loop, independent noise, no heat.",
        [Table(columns, rows)],
    )
