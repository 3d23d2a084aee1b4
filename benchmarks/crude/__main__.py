"""`python -m benchmarks.crude`: what is said first of satellites of an independent simulation, and of ways to be wrong.

With `--verdicts` whole calibrations are made: their exit codes, the least share of a channel's unseen telemetry inside
the 95% intervals, its largest error, and how many parameters have their true value outside of theirs.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.attack.files import looked_at, not_well, put
from flightcal.commands.calibrate import Summary, run_experiment
from flightcal.errors import FlightcalError

from .satellites import Satellite, satellites
from .variants import VARIANTS, Variant, fits

_CALIBRATION: dict[str, Any] = {
    "seed": 1,
    "genetic": {"runs": 2, "population": 32, "generations": 20},
    "prediction": {"simulations": 300},
}
"""A shorter search than by default: the verdict is about the posterior."""


def main() -> None:
    """A line for each satellite and variant."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.crude", description=__doc__)
    parser.add_argument("--only", nargs="*", default=[], help="satellites, variants or their groups")
    parser.add_argument("--verdicts", action="store_true", help="calibrate, too")
    given = parser.parse_args()
    known = satellites()
    names = [word for word in given.only if word in known] or list(known)
    words = [word for word in given.only if word not in known]
    for name in names:
        for variant in VARIANTS:
            if fits(variant, known[name]) and (not words or variant.group in words or variant.name in words):
                line = _verdict(known[name], variant) if given.verdicts else _first(known[name], variant)
                print(f"{name:14} {variant.group:9} {variant.name:34} {line}", flush=True)


def _first(satellite: Satellite, variant: Variant) -> str:
    begin = time.perf_counter()
    try:
        made = variant.make(satellite)
        found = looked_at(made.scenario, made.table)
    except FlightcalError as error:
        return f"error: {error}"[:150]
    seconds = time.perf_counter() - begin
    if not found.found:
        beside = f" ({found.misfit.words})" if found.misfit else ""
        return f"{'right' if variant.group == 'right' else ''} {seconds:5.1f} s  nothing{beside}"
    first = found.found[0]
    return f"{'right' if first.kind in variant.kinds else ''} {seconds:5.1f} s  {first.title}"


def _verdict(satellite: Satellite, variant: Variant) -> str:
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        try:
            made = variant.make(satellite)
            made.scenario["calibration"] = _CALIBRATION
            summary = run_experiment(put(Path(folder), made.scenario, made.table), Path(folder) / "run")
        except FlightcalError as error:
            return f"error: {error}"[:150]
        why = "; ".join(not_well(summary.verdict, "bad", "warn", "none"))
        return f"{_told(satellite, summary)}  {time.perf_counter() - begin:4.0f} s  {why[:220]}"


def _told(satellite: Satellite, summary: Summary) -> str:
    unseen = [m for m in summary.metrics if m.window in ("soon", "late") and m.method == "stochastic"]
    inside = min((m.value for m in unseen if m.metric == "picp"), default=np.nan)
    error = max((m.value for m in unseen if m.metric == "rmse"), default=np.nan)
    truth = _truth(satellite)
    ends = [(p, truth[p.name]) for p in summary.parameters if p.name in truth]
    outside = [p.name for p, value in ends if not p.lower <= value <= p.upper]
    code = summary.verdict.exit_code
    return f"exit {code}  inside {inside:4.0%}  rmse {error:5.2f} K  outside {len(outside)}/{len(ends)}"


def _truth(satellite: Satellite) -> dict[str, float]:
    """Parameter -> true value, SI."""
    craft = satellite.craft
    found = {f"link_{a}_{b}": size for (a, b), size in craft.links.items()}
    found |= {f"capacity_{node}": size for node, size in craft.capacities.items()}
    for name, face in craft.faces.items():
        found |= {f"absorptivity_{name}": face.absorptivity, f"emissivity_{name}": face.emissivity}
    return found


if __name__ == "__main__":
    main()
