"""Scores a run of with_discrepancy.yaml on more flights of the satellite: other imaging, other noise of thermistors.

One flight has few independent events; over ten it shows whether 95% intervals hold 95%, of heater duty too.

    python examples/leo_observer/more_flights.py runs/compared/phase+ar1 10
"""

from __future__ import annotations

import sys
import tempfile
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from datetime import datetime, timedelta
from itertools import pairwise
from pathlib import Path

import make_telemetry
import numpy as np
import xarray
from ruamel.yaml import YAML

from flightcal.calibration import posterior_draws, with_kept_heat
from flightcal.prediction import predict, score
from flightcal.problem import build_problem
from flightcal.scenario import Scenario, load_scenario
from flightcal.telemetry import read

FOLDER = Path(__file__).parent
FIRST_ROW = datetime.fromisoformat(make_telemetry.FIRST_ROW)
LEAD = timedelta(hours=8)
"""From the start of the spacecraft file to the first row."""
SINCE = FIRST_ROW + timedelta(hours=9, minutes=30)
"""From then on, after the window that is trained on, imaging is at other times."""


def imaging(rng: np.random.Generator, contacts: list[tuple[datetime, datetime]]) -> list[tuple[datetime, str]]:
    """Changes of mode: imaging once in each orbit, for 6 to 18 minutes, and never while in contact."""
    changes = []
    for orbit in range(8):
        while True:
            start = SINCE + timedelta(minutes=98.7 * orbit // 1 + int(rng.integers(0, 80)))
            end = start + timedelta(minutes=int(rng.integers(6, 19)))
            if not any(start <= until and since <= end for since, until in contacts):
                break
        changes += [(start, "imaging"), (end, "nominal")]
    return changes


def another_flight(scenario: Scenario, folder: Path, number: int) -> Scenario:
    """Flies the satellite once more: the scenario with that flight's modes and telemetry, which is in the folder."""
    spacecraft = YAML().load(FOLDER / "spacecraft.yaml")
    timeline = [(FIRST_ROW - LEAD + timedelta(seconds=_seconds(item)), item["mode"]) for item in _timeline(spacecraft)]
    pairs = [(first, second) for first, second in pairwise(timeline) if first[1] == "contact"]
    changes = imaging(np.random.default_rng(number), [(first[0], second[0]) for first, second in pairs])
    contacts = [change for pair in pairs for change in pair if pair[0][0] >= SINCE]
    flown = [change for change in timeline if change[0] < SINCE] + sorted([*changes, *contacts])
    _timeline(spacecraft)[:] = [
        {"at": f"{(at - FIRST_ROW + LEAD).total_seconds():.0f} s", "mode": mode} for at, mode in flown
    ]
    spacecraft["seed"] = number
    YAML().dump(spacecraft, folder / "spacecraft.yaml")
    make_telemetry.FOLDER = folder
    make_telemetry.main(folder / "telemetry.csv")
    _as_known_until(SINCE, folder / "telemetry.csv")

    known = [change for change in scenario.network.timeline if change.at < SINCE]
    modes = [type(known[0])(at=at, mode=mode) for at, mode in changes]
    network = scenario.network.model_copy(update={"timeline": (*known, *modes)})
    telemetry = scenario.telemetry.model_copy(update={"file": (str(folder / "telemetry.csv"),)})
    return scenario.model_copy(update={"simulator": network, "telemetry": telemetry})


def _as_known_until(end: datetime, file: Path) -> None:
    """Puts the rows of the example's own telemetry before `end`: the posterior has learnt from these, and no others."""
    header, *flown = file.read_text().splitlines(keepends=True)
    known = (FOLDER / "telemetry.csv").read_text().splitlines(keepends=True)[1:]
    at = end.isoformat()
    file.write_text(header + "".join(row for row in known if row < at) + "".join(row for row in flown if row >= at))


def _timeline(spacecraft: dict[str, dict[str, list[dict[str, str]]]]) -> list[dict[str, str]]:
    return spacecraft["software"]["timeline"]


def _seconds(item: dict[str, str]) -> int:
    return int(item["at"].removesuffix(" s"))


def duty_cycles(prediction: xarray.Dataset) -> np.ndarray:
    """Of each heater, percentage points: telemetry's minus the mean, and the 95% interval's bounds minus it, [3, H].

    On the telemetry's samples, the predicted ones as the measured ones.
    """
    draws = prediction["sampled_duty_cycle"].values
    low, high = np.quantile(draws, [0.025, 0.975], axis=0)
    return 100 * (np.stack([prediction["observed_duty_cycle"].values, low, high]) - draws.mean(axis=0))


def main(run: Path, flights: int) -> None:
    """Prints coverage and CRPS of each channel, and coverage of each heater's duty cycles, over the flights."""
    flown = load_scenario(run / "scenario.yaml")
    posterior = xarray.open_datatree(run / "posterior.nc", engine="h5netcdf")
    scores: dict[tuple[str, str], list[float]] = {}
    duty = []
    for number in range(1, flights + 1):
        with tempfile.TemporaryDirectory() as folder:
            scenario = another_flight(flown, Path(folder), number)
            telemetry = read(scenario)
        problem = with_kept_heat(build_problem(scenario, telemetry), posterior)
        draws = posterior_draws(posterior, problem.names, 300, seed=number)
        windows = [name for name in scenario.windows if name.startswith("test")]
        predictions = [predict(problem, telemetry, name, {}, draws, seed=number)[0] for name in windows]
        duty += [duty_cycles(prediction) for prediction in predictions]
        found = [score(prediction, name) for prediction, name in zip(predictions, windows, strict=True)]
        for metric in ("picp", "mpiw", "crps"):
            for channel in {item.channel for item in found[0] if item.metric == metric}:
                values = [
                    item.value
                    for window_scores in found
                    for item in window_scores
                    if (item.channel, item.metric) == (channel, metric)
                ]
                scores.setdefault((channel, metric), []).append(np.mean(np.array(values, float)))
        print(f"flight {number} of {flights}", file=sys.stderr)
    for channel in [*flown.observations, "all"]:
        if (channel, "picp") not in scores:
            continue
        covered, width, crps = (np.array(scores[channel, metric]) for metric in ("picp", "mpiw", "crps"))
        inside = np.mean((covered >= 0.92) & (covered <= 0.98))
        print(
            f"{channel:26s} PICP {covered.mean():.1%}, from {covered.min():.1%} to {covered.max():.1%}, in 92..98% "
            f"{inside:.0%} of flights; MPIW {width.mean():.3f} K, CRPS {crps.mean():.4f} K"
        )
    for k, heater in enumerate(predictions[0]["heater"].values):
        error, low, high = np.stack(duty)[:, :, k].T
        print(
            f"{heater:26s} {np.mean((low <= error) & (error <= high)):.0%} of {len(error)} duty cycles inside their "
            f"95%; off by {error.mean():+.2f} points in the mean, {error.min():+.2f} to {error.max():+.2f}; interval "
            f"{np.mean(high - low):.2f} points wide"
        )


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder of a run")
    parser.add_argument("flights", type=int, help="how many flights")
    arguments = parser.parse_args()
    if not (arguments.run / "posterior.nc").exists():
        parser.error(f"{arguments.run}: found no posterior.nc, expected the folder of a finished run")
    main(arguments.run, arguments.flights)
