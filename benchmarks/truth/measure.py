"""One satellite: its calibration against the truth."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from flightcal.calibration import Posterior, calibrate_nuts
from flightcal.errors import FlightcalError
from flightcal.prediction import predict, score
from flightcal.problem import Problem, build_problem
from flightcal.run import each, plain
from flightcal.scenario import NutsSettings
from flightcal.simulator import FloatArray, SimulationFailure

from .flight import KINDS, Flight, fly, priors_of, read_flight
from .imitation import cosines
from .satellites import WINDOWS
from .variants import VARIANTS

NUTS = NutsSettings(chains=2, draws=300, warmup=300, max_r_hat=1.05, min_ess=50.0)
RANDOM_STARTS = 3
_TAILS = (0.025, 0.975)
_STREAM = 2
"""Of random numbers, beside those of the flight."""

Record = dict[str, Any]
"""What one satellite came to, as JSON."""


@dataclass(frozen=True)
class Parameter:
    """One true parameter and its posterior.

    Scores are log densities, at the truth, of z: the normal score of the prior.
    """

    name: str
    truth: float
    lower: float
    upper: float
    inside: bool
    """Whether the truth is in the 95% interval."""
    rank: float
    """Share of the draws below the truth."""
    error: float
    """Posterior mean minus truth, of z: in deviations of the prior."""
    deviation: float
    """Of z: 1 where nothing was learnt."""
    score: float
    """Of the normal distribution that has the draws' mean and deviation."""
    prior_score: float
    cosine: float
    """With the span of all heats; see `imitation.cosines`."""
    cosine_of_one: float
    """With the single heat that is nearest."""


@dataclass(frozen=True)
class Predicted:
    """A channel in a window."""

    window: str
    channel: str
    coverage: float
    width: float
    rmse: float
    crps: float


@dataclass(frozen=True)
class Duty:
    """A heater in a window."""

    window: str
    heater: str
    truth: float
    lower: float
    upper: float
    inside: bool


def run(
    count: int,
    seed: int,
    variant: str,
    out: Path,
    *,
    workers: int = 2,
    settings: NutsSettings = NUTS,
    random_starts: int = RANDOM_STARTS,
) -> list[Record]:
    """The records of the first `count` satellites of a seed with a variant; those that `out` lacks are measured."""
    known = {record["satellite"] for record in read(out) if (record["seed"], record["variant"]) == (seed, variant)}
    left = [number for number in range(count) if number not in known]

    def done(number: int, record: Record) -> None:
        if "failed" in record:
            print(f"satellite {number}: {record['failed']}", flush=True)
            return
        with out.open("a", encoding="utf-8") as file:
            file.write(json.dumps(record) + "\n")
        print(f"{variant} {number}: {_said(record)}", flush=True)

    task = partial(_tried, seed, variant, settings, random_starts)
    if workers == 1 or len(left) < 2:
        for number in left:
            done(number, task(number))
    else:
        each(task, left, workers, done=done, lost=lambda number: {"failed": "its process was killed"})
    of_variant = (record for record in read(out) if (record["seed"], record["variant"]) == (seed, variant))
    return [record for record in of_variant if record["satellite"] < count]


def read(file: Path) -> list[Record]:
    """The records in a file; none where there is none."""
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()] if file.exists() else []


def measure(seed: int, variant: str, settings: NutsSettings, random_starts: int, number: int) -> Record:
    """One satellite. Raises FlightcalError and SimulationFailure."""
    begin = perf_counter()
    kind = KINDS[1 + number % (len(KINDS) - 1)] if VARIANTS[variant].missing else KINDS[0]
    with tempfile.TemporaryDirectory() as folder:
        flight = fly(seed, number, kind, Path(folder))
        imitated = cosines(flight, Path(folder))
        scenario, data = read_flight(flight, flight.satellite.written | VARIANTS[variant].written, Path(folder))
        flown = perf_counter()
        problem = build_problem(scenario, data)
        own_seed = int(np.random.default_rng([seed, number, _STREAM]).integers(2**32))
        posterior = calibrate_nuts(problem, settings, own_seed, random_starts=random_starts)
        calibrated = perf_counter()
        # With unmodelled heat the draws are of the problem as the calibration found it.
        found: Problem = getattr(posterior, "problem", problem)
        windows = [(name, *_predicted(found, flight, data, name, posterior, own_seed)) for name in list(WINDOWS)[1:]]
    parameters, joint = _parameters(flight, problem, posterior, imitated)
    diagnostics = posterior.diagnostics
    return {
        "seed": seed,
        "satellite": number,
        "variant": variant,
        "kind": kind,
        "size": flight.size,
        "nodes": len(flight.satellite.written["simulator"]["nodes"]),
        "heaters": len(flight.on),
        "parameters": [asdict(parameter) for parameter in parameters],
        "joint_score": joint,
        "joint_prior_score": sum(parameter.prior_score for parameter in parameters),
        "predicted": [asdict(item) for _, items, _ in windows for item in items],
        "duty": [asdict(item) for _, _, items in windows for item in items],
        "failed_gates": [gate.name for gate in diagnostics.gates if not gate.passed],
        "gates": {gate.name: gate.found for gate in diagnostics.gates},
        "gradients": posterior.draws.gradients,
        "seconds": {
            "flight": flown - begin,
            "calibration": calibrated - flown,
            "prediction": perf_counter() - calibrated,
        },
    }


def _tried(seed: int, variant: str, settings: NutsSettings, random_starts: int, number: int) -> Record:
    """A satellite that cannot be measured does not cost the others; it is tried again by the next call."""
    try:
        return dict(plain(measure(seed, variant, settings, random_starts, number)))
    except (FlightcalError, SimulationFailure, np.linalg.LinAlgError) as error:
        return {"failed": f"{type(error).__name__}: {error}"}


def _said(record: Record) -> str:
    inside = sum(item["inside"] for item in record["parameters"])
    scores = f"{record['joint_score']:.1f} (prior {record['joint_prior_score']:.1f})"
    failed = f"; failed: {', '.join(record['failed_gates'])}" if record["failed_gates"] else ""
    took = sum(record["seconds"].values())
    return f"{record['kind']}, {inside} of {len(record['parameters'])} inside, log score {scores}, {took:.0f} s{failed}"


def _parameters(
    flight: Flight, problem: Problem, posterior: Posterior, imitated: Mapping[str, tuple[float, float]]
) -> tuple[list[Parameter], float]:
    """Each parameter, and the log score of all together."""
    names = list(flight.truth)
    priors = priors_of(problem.scenario, names)
    draws = posterior.flat[:, [posterior.names.index(name) for name in names]]
    truth = np.array(list(flight.truth.values()))
    z, z_true = priors.to_z(draws), priors.to_z(truth)
    lower, upper = np.quantile(draws, _TAILS, axis=0)
    below, prior_scores = (draws < truth).mean(axis=0), _normal_scores(z_true, np.zeros_like(z_true), 1.0)
    mean, deviation = z.mean(axis=0), z.std(axis=0, ddof=1)
    scores = _normal_scores(z_true, mean, deviation)
    found = [
        Parameter(
            name=name,
            truth=float(truth[k]),
            lower=float(lower[k]),
            upper=float(upper[k]),
            inside=bool(lower[k] <= truth[k] <= upper[k]),
            rank=float(below[k]),
            error=float(mean[k] - z_true[k]),
            deviation=float(deviation[k]),
            score=float(scores[k]),
            prior_score=float(prior_scores[k]),
            cosine=imitated[name][0],
            cosine_of_one=imitated[name][1],
        )
        for k, name in enumerate(names)
    ]
    factor = np.linalg.cholesky(np.atleast_2d(np.cov(z, rowvar=False)))
    white = np.linalg.solve(factor, z_true - mean)
    joint = _normal_scores(white, np.zeros_like(white), 1.0).sum() - np.log(np.diag(factor)).sum()
    return found, float(joint)


def _normal_scores(x: FloatArray, mean: FloatArray, deviation: FloatArray | float) -> FloatArray:
    """Log density of normal distributions."""
    return np.asarray(-0.5 * ((x - mean) / deviation) ** 2 - np.log(deviation) - 0.5 * np.log(2.0 * np.pi))


def _predicted(
    problem: Problem, flight: Flight, data: Any, window: str, posterior: Posterior, seed: int
) -> tuple[list[Predicted], list[Duty]]:
    """Temperatures of each channel against the telemetry, and duty of each heater against the truth, in a window."""
    rng = np.random.default_rng([seed, *window.encode()])
    count = problem.scenario.calibration.prediction.simulations
    chosen = posterior.flat[rng.choice(len(posterior.flat), min(count, len(posterior.flat)), replace=False)]
    prediction, _ = predict(problem, data, window, {}, chosen, seed=seed)
    scores: dict[str, dict[str, float | None]] = {}
    for metric in score(prediction, window):
        scores.setdefault(metric.channel, {})[metric.metric] = metric.value
    found = [
        Predicted(window, channel, *(scores[channel][name] or 0.0 for name in ("picp", "mpiw", "rmse", "crps")))
        for channel in problem.channels
    ]
    return found, list(_duties(flight, window, prediction))


def _duties(flight: Flight, window: str, prediction: Any) -> Iterator[Duty]:
    first, length = (orbits * flight.satellite.period for orbits in WINDOWS[window])
    for heater in flight.on:
        of_heater = prediction["duty_cycle"].sel(heater=heater).values
        lower, upper = (float(bound) for bound in np.quantile(of_heater, _TAILS))
        truth = flight.duty(heater, first, first + length)
        yield Duty(window, heater, truth, lower, upper, lower <= truth <= upper)
