"""Whole calibrations by two checkouts of flightcal, short ones: equal to the bit, or what differs.

    python -m benchmarks.unchanged.runs make CHECKOUT OUT [--telemetry FOLDER] [--only NAME ...]
    python -m benchmarks.unchanged.runs compare OUT OUT

`make` runs the examples of a checkout with its own code (two chains of 100 draws, ten generations) into OUT. Real
telemetry is read from FOLDER. Set FLIGHTCAL_STRICT=1 for both where compiled code was cut up anew: without it the
compiler fuses products and sums as it likes.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import xarray
from ruamel.yaml import YAML

RUNS = {
    "validation": ("examples/validation/scenario.yaml", None),
    "leo_observer": ("examples/leo_observer/scenario.yaml", None),
    "published": ("examples/leo_observer/published.yaml", None),
    "with_discrepancy": ("examples/leo_observer/with_discrepancy.yaml", None),
    "bupt1": ("examples/bupt1/scenario.yaml", "bupt1"),
    "several_windows": ("examples/bupt1/several_windows.yaml", "bupt1"),
    "funcube1": ("examples/funcube1/scenario.yaml", "funcube1/funcube1_2016-02-04_first.csv"),
    "funcube1_with_discrepancy": (
        "examples/funcube1/with_discrepancy.yaml",
        "funcube1/funcube1_2016-02-04_first.csv",
    ),
    "executable": ("examples/executable/scenario.yaml", None),
}
SHORT = {
    "genetic": {"runs": 2, "population": 16, "generations": 10},
    "nuts": {"chains": 2, "draws": 100, "warmup": 100},
    "prediction": {"simulations": 50},
}


def make(checkout: Path, out: Path, telemetry: Path | None, only: list[str]) -> None:
    """Run the examples of a checkout with its own code."""
    for name, (file, data) in RUNS.items():
        if (only and name not in only) or (data and telemetry is None) or not (checkout / file).exists():
            continue
        yaml = YAML()
        scenario = yaml.load((checkout / file).read_text(encoding="utf-8"))
        scenario.setdefault("calibration", {}).update(SHORT)
        written = (checkout / file).with_name(".short.yaml")
        with written.open("w", encoding="utf-8") as stream:
            yaml.dump(scenario, stream)
        place = [] if data is None or telemetry is None else ["--telemetry", str(telemetry / data)]
        command = [sys.executable, "-m", "flightcal.cli", "calibrate", str(written), "--out", str(out / name), *place]
        print(name, flush=True)
        try:
            done = subprocess.run(command, env=os.environ | {"PYTHONPATH": str(checkout / "src")})
        finally:
            written.unlink()
        if done.returncode not in (0, 3):
            raise SystemExit(f"{name}: flightcal ended with {done.returncode}, expected 0 or 3")


def compare(first: Path, second: Path) -> bool:
    """Print how the runs in two folders differ; whether nothing does."""
    equal = True
    for folder in sorted(path for path in first.iterdir() if (second / path.name).exists()):
        found = [*_json(folder, second / folder.name), *_arrays(folder, second / folder.name)]
        print(f"{folder.name}: {'; '.join(found) or 'equal to the bit'}")
        equal = equal and not found
    return equal


def _json(first: Path, second: Path) -> list[str]:
    names = [
        name
        for name in ("metrics.json", "diagnostics.json", "priors.json", "parameters.json")
        if (first / name).exists()
    ]
    return [f"{name} differs" for name in names if _load(first / name) != _load(second / name)]


def _load(file: Path) -> object:
    return json.loads(file.read_text(encoding="utf-8"))


def _arrays(first: Path, second: Path) -> list[str]:
    found = []
    for name in ("genetic.nc", "posterior.nc", "prediction.nc"):
        with (
            xarray.open_datatree(first / name, engine="h5netcdf") as one,
            xarray.open_datatree(second / name, engine="h5netcdf") as two,
        ):
            for node in one.subtree:
                for variable in node.to_dataset().data_vars:
                    left, right = node[variable].values, two[node.path][variable].values
                    if left.dtype.kind == "f" and left.shape == right.shape:
                        if not np.array_equal(left, right, equal_nan=True):
                            largest = np.nanmax(np.abs(left - right) / np.maximum(np.abs(left), 1e-300))
                            found.append(f"{name}{node.path}/{variable} by {largest:.1e} of its value")
                    elif not np.array_equal(left, right):
                        found.append(f"{name}{node.path}/{variable} differs")
    return found


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    making = verbs.add_parser("make")
    making.add_argument("checkout", type=Path)
    making.add_argument("out", type=Path)
    making.add_argument("--telemetry", type=Path)
    making.add_argument("--only", nargs="*", default=[])
    comparing = verbs.add_parser("compare")
    comparing.add_argument("first", type=Path)
    comparing.add_argument("second", type=Path)
    arguments = parser.parse_args()
    if arguments.verb == "make":
        make(arguments.checkout.resolve(), arguments.out.resolve(), arguments.telemetry, arguments.only)
    elif not compare(arguments.first, arguments.second):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
