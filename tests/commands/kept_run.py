"""A finished run made up: the files that `show` and `diff` read."""

import csv
import json
import re
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from tests import small

ANSWERS = ("Did the sampling converge?", "Is the model right?", "Do its intervals hold?")


def cells_of(line: str) -> list[str]:
    """Of a line of a table that is printed."""
    return re.split(r"\s{2,}", line.strip())


def write_kept(folder: Path, *, name: str = "small", scenario: dict[str, Any] | None = None, **means: float) -> Path:
    """A run of `small` with these posterior means; its deviations are 0.03 and its windows have a score each."""
    folder.mkdir()
    content = scenario or small.content()
    content["name"] = name
    with (folder / "scenario.yaml").open("w") as file:
        YAML(typ="safe").dump(content, file)
    (folder / "calibrated.yaml").write_text("name: small\n")
    records = [record(parameter, mean) for parameter, mean in ({"link": 0.65, "initial.body": 11.9} | means).items()]
    write_json(folder / "parameters.json", {"interval": 0.95, "parameters": records})
    with (folder / "parameters.csv").open("w") as file:
        csv.writer(file).writerow(records[0])
    answers = [{"question": words, "state": "good", "answer": "Yes [all]", "findings": []} for words in ANSWERS]
    write_json(
        folder / "verdict.json",
        {
            "use": "Use it.",
            "state": "good",
            "exit_code": 0,
            "answers": answers,
            "next": "flightcal backtest scenario.yaml --out backtest",
        },
    )
    score = {"method": "stochastic", "channel": "all", "metric": "rmse", "value": means.get("link", 0.65), "unit": "K"}
    write_json(folder / "metrics.json", [score | {"window": window} for window in ("train", "test")])
    write_json(
        folder / "provenance.json",
        {"identity": "ab" * 32, "created": "2024-05-02T09:30:00+00:00", "flightcal": "0.1.0",
         "stage_inputs": dict.fromkeys(("nuts", "predict", "results"), "x"), "inputs": {"telemetry.csv": "1"}},
    )  # fmt: skip
    return folder


def record(name: str, mean: float) -> dict[str, Any]:
    kind, unit = ("initial", "degC") if name.startswith("initial") else ("parameter", "W/K")
    return {
        "name": name, "kind": kind, "unit": unit, "before": 0.6, "before_lower": 0.36, "before_upper": 1.0,
        "mean": mean, "median": mean, "deviation": 0.03, "lower": mean - 0.06, "upper": mean + 0.06, "from_data": 0.97,
        "considered_lower": mean - 0.1, "considered_upper": mean + 0.1,
    }  # fmt: skip


def write_json(file: Path, content: Any) -> None:
    file.write_text(json.dumps(content))


def change(file: Path, **values: Any) -> None:
    """Replace values in a JSON file."""
    write_json(file, json.loads(file.read_text()) | values)
