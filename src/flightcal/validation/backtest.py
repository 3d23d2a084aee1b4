"""Rolling origins: train up to an origin, predict what follows, and see whether intervals held."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from time import perf_counter
from typing import Any

import xarray

from ..calibration import calibrate_nuts, some_of, warm
from ..emulation import needs_emulator
from ..errors import RunError
from ..prediction import Holding, hold_together, predict, replicates_of
from ..problem import build_problem
from ..run import Run, Stage, plain
from ..scenario import ExternalModel, NutsSettings, PredictionSettings, Scenario
from .horizon import BANDS, band_scores, duty_scores
from .origins import AHEAD, Origin, Plan

_FOLDER = "origins"


def check_simulator(scenario: Scenario, telemetry: Callable[[], xarray.Dataset]) -> None:
    """Raises RunError where a scenario's simulator cannot be calibrated from each origin.

    telemetry: reads it; only an external simulator asks for it.
    """
    if isinstance(scenario.simulator, ExternalModel) and needs_emulator(build_problem(scenario, telemetry())):
        raise RunError(
            "backtest: simulator: found one without derivatives, expected a thermal network or one with a gradient: "
            "each origin would need an emulator of its own"
        )


def origin_stage(scenario: Scenario, origin: Origin, title: str) -> Stage[xarray.Dataset]:
    """Calibrate up to an origin and predict from there; of the telemetry, with `origin_settings`."""
    file = f"{_FOLDER}/{origin.label}.nc"

    def make(
        run: Run, data: xarray.Dataset, *, span: Any, nuts: NutsSettings, prediction: PredictionSettings, seed: int
    ) -> None:
        run.folder.file(_FOLDER).mkdir(exist_ok=True)
        run.folder.write_netcdf(file, _backtested(run, scenario, data, origin))

    return Stage(origin.label, title, (file,), make, lambda run, data: run.folder.read_dataset(file))


def origin_settings(scenario: Scenario, origin: Origin) -> dict[str, Any]:
    """What an origin's prediction is made with, besides the scenario and its telemetry."""
    method = scenario.calibration
    span = [str(time) for time in (origin.start, origin.time, origin.end)]
    return {"span": span, "nuts": method.nuts, "prediction": method.prediction, "seed": method.seed}


def _backtested(run: Run, scenario: Scenario, data: xarray.Dataset, origin: Origin) -> xarray.Dataset:
    started = perf_counter()
    changed = origin.scenario(scenario)
    settings = scenario.calibration
    problem = build_problem(changed, data)
    with run.progress.stage("compiling (long only once)"):
        warm(problem)
    posterior = calibrate_nuts(problem, progress=run.progress)
    if posterior.draws.interrupted:
        raise KeyboardInterrupt
    draws = some_of(posterior.flat, settings.prediction.simulations, settings.seed)
    # A window of its own, whose first minutes tell its initial temperatures and are not scored.
    prediction, _ = predict(posterior.problem, data, AHEAD, {}, draws, seed=settings.seed)
    attributes = {
        "origin": str(origin.time),
        "trained_from": str(origin.start),
        "predicted_to": str(origin.end),
        "passed": int(posterior.diagnostics.converged),
        "verdict": posterior.diagnostics.verdict,
        "failed_gates": ", ".join(gate.name for gate in posterior.diagnostics.gates if not gate.passed),
        "seconds": perf_counter() - started,
    }
    return prediction.assign_attrs(attributes)


def backtest_record(scenario: Scenario, plan: Plan, predictions: Mapping[str, xarray.Dataset]) -> dict[str, Any]:
    """Content of backtest.json: what was done, whether intervals held, and scores by origin, channel and horizon.

    predictions: groups of backtest.nc, in the order of the plan's origins.
    """
    channels = [str(name) for name in next(iter(predictions.values()))["channel"].values]
    holdings = holdings_of(predictions)
    scores = band_scores(predictions, plan.period)
    origins = [
        _origin_record(name, prediction, holding, channels)
        for (name, prediction), holding in zip(predictions.items(), holdings, strict=True)
    ]
    return {
        "name": scenario.name,
        "interval": scenario.calibration.prediction.interval,
        "period": plan.period,
        "train": plan.train,
        "horizon": plan.horizon,
        "measured": plan.measured,
        "skipped": plan.skipped,
        "channels": channels,
        "bands": BANDS,
        "holds": all(holding.holds for holding in holdings),
        "held": sum(holding.holds for holding in holdings),
        "passed": all(origin["passed"] for origin in origins),
        "worst": _worst(origins, holdings),
        "origins": origins,
        "scores": plain(scores),
        "duty": plain(duty_scores(predictions)),
    }


def holdings_of(predictions: Mapping[str, xarray.Dataset]) -> list[Holding]:
    """Whether intervals held after each origin, in one band for all of its channels (see `hold_together`)."""
    return [hold_together([replicates_of(dataset)])[0] for dataset in predictions.values()]


def _worst(origins: list[dict[str, Any]], holdings: Sequence[Holding]) -> dict[str, Any]:
    """The channel of an origin that holds least."""
    found = [(held.room[held.worst], record) for record, held in zip(origins, holdings, strict=True) if held.worst >= 0]
    if not found:
        return {}
    record = min(found, key=lambda one: one[0])[1]
    k = record["worst_place"]
    return {
        "origin": record["name"],
        "time": record["origin"],
        "channel": record["worst"],
        "coverage": record["coverage"][k],
        "lower": record["lower"][k],
        "why": record["why"][k],
    }


def _origin_record(name: str, prediction: xarray.Dataset, holding: Holding, channels: list[str]) -> dict[str, Any]:
    attributes = prediction.attrs
    return {
        "name": name,
        "origin": attributes["origin"][:19],
        "trained_from": attributes["trained_from"][:19],
        "predicted_to": attributes["predicted_to"][:19],
        "passed": bool(attributes["passed"]),
        "verdict": attributes["verdict"],
        "failed_gates": attributes["failed_gates"],
        "seconds": float(attributes["seconds"]),
        "failed_simulations": int(attributes["failed_simulations"]),
        "holds": holding.holds,
        "worst": channels[holding.worst] if holding.worst >= 0 else None,
        "worst_place": holding.worst,
        "why": [holding.why(k) for k in range(len(channels))],
        "coverage": holding.coverage,
        "lower": holding.lower,
        "upper": holding.upper,
        "error": holding.error,
        "most_error": holding.most_error,
        "lasting": holding.lasting,
        "most_lasting": holding.most_lasting,
        "too_wide": [name for name, wide in zip(channels, holding.too_wide, strict=True) if wide],
    }
