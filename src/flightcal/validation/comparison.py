"""Models of the residuals side by side on windows that none has seen: which there are, their scores, which to use."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import xarray

from ..prediction import Metric, values_of
from ..scenario import (
    NEEDS,
    NOISE_BESIDE_HEAT,
    Discrepancy,
    Heat,
    Noise,
    PhaseDiscrepancy,
    Scenario,
    can_have_heat,
    discrepancy_of,
    is_trained,
    noise_of,
)
from ..simulator import FloatArray
from .horizon import ALL
from .residuals import effective_samples

MODELS = ("heat", "iid", "ar1", "phase", "phase+ar1")
"""heat: unmodelled heat, the default; iid: independent noise, as published; ar1: correlated; phase: independent, and a
discrepancy that comes again in every orbit; phase+ar1: that, and correlated noise for what does not."""
USUAL = ("heat", "iid", "ar1", "phase+ar1")
"""Those that are compared if nobody says which."""

COMPARED = ("rmse", "mape_kelvin", "picp", "mpiw", "crps", "log_score")
COVERED = (0.90, 0.99)
"""What the 95% interval may cover of unseen telemetry without a word of caution."""
CLEAR = 2.0
"""Standard errors by which a difference between two models must differ from zero."""


def models_of(scenario: Scenario) -> tuple[str, ...]:
    """Those of `MODELS` that a scenario can have: not every simulator takes heat."""
    return MODELS if can_have_heat(variant(scenario, "heat")) else MODELS[1:]


def variant(scenario: Scenario, model: str) -> Scenario:
    """The scenario with another model of what the simulator lacks: its own blocks where it has them, or their defaults.

    Heavy tails and rounding stay with iid alone, for they go together with nothing else. Without heat, noise that is
    left out is that of scenarios without it.
    """
    if model == "heat":
        return _with_heat(scenario)
    scenario = scenario.model_copy(update={"heat": "none"})

    def noise(noise_kind: Noise) -> Noise:
        of_memory = [name for name, (key, _) in NEEDS.items() if key == "model"]
        # What is written of correlated noise says nothing of noise that is to stand alone.
        same = noise_kind.model == "iid" or model.endswith("ar1")
        written: dict[str, Any] = {"standard_deviation": noise_kind.standard_deviation} if same else {}
        if model.endswith("ar1"):
            written |= {"model": "ar1"} | {name: getattr(noise_kind, name) for name in of_memory}
        elif model == "iid":
            kept = noise_kind.model_fields_set - {"standard_deviation", "model", *of_memory}
            written |= {name: getattr(noise_kind, name) for name in kept}
        return Noise.model_construct(**written)

    observations = {
        channel: item
        if item.heater is not None
        else item.model_copy(update={"noise": noise(noise_of(scenario, channel))})
        for channel, item in scenario.observations.items()
    }
    chosen = discrepancy_of(scenario) or Discrepancy(phase=PhaseDiscrepancy())
    discrepancy = chosen if model.startswith("phase") else None
    return scenario.model_copy(
        update={"observations": observations, "noise": noise(scenario.noise), "discrepancy": discrepancy}
    )


def scored_by_all(
    predictions: Mapping[str, Mapping[str, xarray.Dataset]],
) -> dict[str, dict[str, xarray.Dataset]]:
    """Predictions of each model by window or origin, with those samples scored alone that every model scores.

    Where training ends, a model with heat scores a window from its first sample on, and others leave out some minutes.
    """
    together: dict[str, Any] = {}
    for windows in predictions.values():
        for window, dataset in windows.items():
            together[window] = dataset["scored"].values.astype(bool) & together.get(window, True)
    return {
        model: {window: dataset.assign(scored=("time", together[window])) for window, dataset in windows.items()}
        for model, windows in predictions.items()
    }


def comparison_of(
    name: str,
    metrics: Mapping[str, Sequence[Metric]],
    passed: Mapping[str, bool],
    useless: Collection[str] = (),
    backtests: Mapping[str, Mapping[str, Any]] | None = None,
    predictions: Mapping[str, Mapping[str, xarray.Dataset]] | None = None,
) -> dict[str, Any]:
    """Content of comparison.json: scores by model, and what is recommended and why.

    metrics, backtests and predictions: of samples that every model scores (`scored_by_all`). passed: whether each model
    was sampled well; useless: those whose own verdict is not to use them. Neither is recommended where there is
    another. backtests: backtest.json of each model; where they are given, they tell which model is recommended.
    predictions: of each model by unseen window; they or the backtests tell the error of a difference. Nothing is
    recommended (None) where another such model is within `CLEAR` errors of the best.
    """
    rows = []
    for model, found in metrics.items():
        values = values_of(m for m in found if m.metric in COMPARED and not is_trained(m.window))
        for window, channel in dict.fromkeys(place[1:3] for place in values if place[0] == "stochastic"):
            scores = {metric: values.get(("stochastic", window, channel, metric)) for metric in COMPARED}
            rows.append({"model": model, "window": window, "channel": channel, **scores})
    means = {
        model: _means([row for row in rows if row["model"] == model and row["channel"] == "all"]) for model in metrics
    }
    rolling = {model: backtest_summary(content) for model, content in (backtests or {}).items()}
    of_gates = {model: record["passed"] for model, record in rolling.items()} if rolling else passed
    sampled = [model for model in metrics if of_gates[model]] or list(metrics)
    eligible = [model for model in sampled if model not in useless] or sampled
    chosen, reason = recommend_by_backtest(rolling, eligible) if rolling else recommend(means, eligible)
    recommended: str | None = chosen
    differences = (
        _crps_differences(backtests, chosen) if backtests else _log_score_differences(predictions or {}, chosen)
    )
    rivals = [model for model, difference in differences.items() if model in eligible and not difference.clear]
    if rivals:
        recommended, reason = None, f"{_undecided(chosen, rivals, differences, backtest=bool(rolling))} {reason}"
    return {
        "name": name,
        "models": list(metrics),
        "recommended": recommended,
        "reason": reason,
        "differences": {model: asdict(difference) for model, difference in differences.items()},
        "passed": passed,
        "useless": sorted(useless),
        "scores": rows,
        "means": means,
        "backtest": rolling,
    }


def _with_heat(scenario: Scenario) -> Scenario:
    """The scenario with heat, and with its own noise where that can stand beside heat.

    What is written for all channels of noise without a memory says nothing of noise beside heat.
    """
    observations = {}
    for channel, item in scenario.observations.items():
        written = item.noise
        if isinstance(written, Noise) and written.not_normal:
            item = item.model_copy(
                update={"noise": Noise.model_construct(standard_deviation=written.standard_deviation)}
            )
        observations[channel] = item
    heat = scenario.heat if isinstance(scenario.heat, Heat) else Heat()
    noise = scenario.noise if scenario.noise.model == "ar1" else NOISE_BESIDE_HEAT
    return scenario.model_copy(update={"observations": observations, "noise": noise, "heat": heat, "discrepancy": None})


@dataclass(frozen=True)
class Difference:
    """By how much a model's score is worse than that of the best."""

    worse: float
    standard_error: float

    @property
    def clear(self) -> bool:
        """Whether it is more than chance may make."""
        return self.worse > CLEAR * self.standard_error


def _log_score_differences(predictions: Mapping[str, Mapping[str, xarray.Dataset]], best: str) -> dict[str, Difference]:
    """Of log scores, nats a sample: of samples of the same time, of which as many count as are effective."""
    found = {}
    for model, windows in predictions.items():
        if model == best or best not in predictions:
            continue
        means, variances = [], []
        for window, prediction in windows.items():
            worse = _log_scores(predictions[best][window]) - _log_scores(prediction)
            kept = np.isfinite(worse)
            if kept.sum() > 1:
                times = prediction["time"].values[prediction["scored"].values.astype(bool)][kept]
                means.append(worse[kept].mean())
                variances.append(worse[kept].var(ddof=1) / effective_samples(worse[kept], times))
        if means:
            found[model] = Difference(float(np.mean(means)), math.sqrt(sum(variances)) / len(means))
    return found


def _log_scores(prediction: xarray.Dataset) -> FloatArray:
    """Log score of each scored sample [T], nat, the mean over its channels; see `log_score_normal`."""
    scored = prediction.sel({"by": "stochastic"}).isel(time=prediction["scored"].values.astype(bool))
    observed, mean, deviation = (
        scored[name].transpose("time", "channel").values for name in ("observed", "mean", "standard_deviation")
    )
    scores = -0.5 * ((observed - mean) / deviation) ** 2 - np.log(deviation) - 0.5 * math.log(2.0 * math.pi)
    known = np.isfinite(scores)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.where(known, scores, 0.0).sum(axis=1) / known.sum(axis=1))


def _crps_differences(backtests: Mapping[str, Mapping[str, Any]], best: str) -> dict[str, Difference]:
    """Of the CRPS, K: of the same origins, as if these were independent."""
    by_origin = {
        model: {
            score["origin"]: score["crps"]
            for score in content["scores"]
            if score["origin"] != ALL and score["channel"] == score["band"] == ALL and score["crps"] is not None
        }
        for model, content in backtests.items()
    }
    found = {}
    for model, scores in by_origin.items():
        same = [origin for origin in scores if origin in by_origin[best]]
        if model != best and len(same) > 1:
            worse = np.array([scores[origin] - by_origin[best][origin] for origin in same])
            found[model] = Difference(float(worse.mean()), float(worse.std(ddof=1)) / math.sqrt(len(same)))
    return found


def _undecided(best: str, rivals: Sequence[str], differences: Mapping[str, Difference], *, backtest: bool) -> str:
    """Why nothing is recommended."""
    score, unit = ("CRPS", "K") if backtest else ("log score", "nat a sample")
    listed = ", ".join(
        f"'{model}' ({differences[model].worse:.2g} ± {differences[model].standard_error:.2g} {unit} worse)"
        for model in rivals
    )
    advice = "More telemetry would tell." if backtest else "--backtest compares them on more telemetry."
    return (
        f"Nothing is recommended: by {score} '{best}' cannot be told from {listed}, a difference within {CLEAR:g} "
        f"standard errors. {advice}"
    )


def backtest_summary(content: Mapping[str, Any]) -> dict[str, Any]:
    """Of a backtest.json: scores of all origins, channels and horizons, and after how many origins intervals held."""
    whole = next(score for score in content["scores"] if score["origin"] == score["channel"] == score["band"] == ALL)
    kept = {name: whole[name] for name in ("rmse", "coverage", "coverage_error", "width", "crps")}
    return kept | {"held": content["held"], "origins": len(content["origins"]), "passed": content["passed"]}


def recommend_by_backtest(rolling: Mapping[str, Mapping[str, Any]], eligible: Sequence[str]) -> tuple[str, str]:
    """The model to use, and why: of those that are eligible, the one with the lowest CRPS.

    rolling: `backtest_summary` of each model.
    """
    best = min(eligible, key=lambda model: rolling[model]["crps"])
    record = rolling[best]
    others = [model for model in rolling if model not in eligible and rolling[model]["crps"] < record["crps"]]
    among = " of those that can be used" if others else ""
    words = [
        f"After rolling origins '{best}' has the lowest CRPS{among}, {record['crps']:.3g} K. Its interval covers "
        f"{record['coverage']:.1%} and held after {record['held']} of {record['origins']} origins."
    ]
    holding = [model for model in eligible if rolling[model]["held"] > record["held"]]
    if holding:
        safe = max(holding, key=lambda model: (rolling[model]["held"], -rolling[model]["crps"]))
        words.append(
            f"Where coverage matters more than sharpness, use '{safe}': held after {rolling[safe]['held']}, CRPS "
            f"{rolling[safe]['crps']:.3g} K."
        )
    if others:
        named = [f"{name} ({rolling[name]['crps']:.3g} K, held after {rolling[name]['held']})" for name in others]
        words.append(
            f"A lower CRPS, but not converged or not to be used: {', '.join(named)}. Its own page and that of its "
            "backtest say what to mend first: it may be the better one."
        )
    return best, " ".join(words)


def _means(rows: Sequence[dict[str, Any]]) -> dict[str, float | None]:
    """Of each score over the windows."""
    means: dict[str, float | None] = {}
    for metric in COMPARED:
        values = [row[metric] for row in rows if row[metric] is not None]
        means[metric] = float(np.mean(values)) if values else None
    return means


def recommend(means: Mapping[str, Mapping[str, float | None]], eligible: Sequence[str]) -> tuple[str, str]:
    """The model to use, and why: of those that are eligible, the one with the best log score.

    The log score is proper (Gneiting & Raftery 2007): an interval too narrow costs it as much as one too wide.
    """
    scores = {model: -np.inf if of["log_score"] is None else of["log_score"] for model, of in means.items()}
    covers = [model for model, of in means.items() if of["picp"] and COVERED[0] <= of["picp"] <= COVERED[1]]
    best = max(eligible, key=scores.__getitem__)
    share = means[best]["picp"]
    covered = "" if share is None else f"; its 95% interval covers {share:.1%} of them"
    words = [
        f"On the windows that come after the training, '{best}' has the best log score, {scores[best]:.3f} nats a "
        f"sample{covered}."
    ]
    covering = [model for model in eligible if model in covers]
    if best not in covers and covering:
        safe = max(covering, key=scores.__getitem__)
        words.append(
            "That is not right for an interval of 95%: where coverage matters more than sharpness, use "
            f"'{safe}', whose interval covers {means[safe]['picp']:.1%}."
        )
    elif best not in covers:
        words.append("No model's interval covers between 90% and 99%: take none of these intervals at its word.")
    others = [model for model in means if model not in eligible and scores[model] > scores[best]]
    if others:
        words.append(f"A better log score, but not converged or not to be used: {', '.join(others)}.")
    if best != "iid" and "iid" in means:
        words += [f"Against 'iid': {_change(means, best, 'crps', 'CRPS')}, {_change(means, best, 'mpiw', 'MPIW')}."]
    return best, " ".join(words)


def _change(means: Mapping[str, Mapping[str, float | None]], model: str, metric: str, title: str) -> str:
    value, reference = means[model][metric], means["iid"][metric]
    if value is None or not reference:
        return f"{title} undefined"
    return f"{title} {value:.3g} K instead of {reference:.3g} K ({value / reference - 1:+.0%})"
