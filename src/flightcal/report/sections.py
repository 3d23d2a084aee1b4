"""The sections after the verdict, each a list of blocks: text, table, figure."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import plotly.graph_objects as go
import xarray as xr

from flightcal.scenario.schema import is_trained
from flightcal.validation import ResidualCheck, uniformity

from . import discrepancy, tables
from . import figures as draw
from .figures.style import GENETIC, PRIOR, chain_colour
from .run_files import RunFiles, draws
from .tables import Table
from .text import count, duration, listed, number
from .verdict import Checks, assumption, correlation_expected, spread

MOST_PAIRS = 8
MOST_TRACES = 6


@dataclass(frozen=True)
class Block:
    """A piece of a section; `kind` says which of the other fields it has."""

    kind: str
    """text, note (something lacks), heading, table, figure, grid (small figures), folded (a table), source (a file)"""
    text: str = ""
    table: Table | None = None
    figures: tuple[go.Figure, ...] = ()
    key: tuple[tuple[str, str, str], ...] = ()
    """Legend of a grid: name, colour, and line, dash or mark."""
    wide: bool = False
    """A figure that scrolls sideways on a narrow screen."""


@dataclass(frozen=True)
class Section:
    """A section: its anchor, title and blocks."""

    anchor: str
    title: str
    blocks: list[Block]


def sections(run: RunFiles, checks: Checks) -> list[Section]:
    """All sections of the report, in order."""
    made: list[tuple[str, str, Callable[[RunFiles], list[Block]]]] = [
        ("scores", "Scores", _scores),
        ("before", "Before calibration", _before),
        ("genetic", "Genetic algorithm", _genetic),
        ("densities", "Prior and posterior", _densities),
        ("prediction", "Prediction with interval", _prediction),
        ("parameters", "Parameters", _parameters),
        ("pairs", "Correlations", _pairs),
        ("convergence", "Convergence", _convergence),
        *([("emulator", "Emulator", _emulator)] if run.emulator is not None else []),
        *([("full-simulator", "The full simulator", _full_check)] if run.full_check is not None else []),
        *([("discrepancy", "Discrepancy", _discrepancy)] if discrepancy.parts(run.windows) else []),
        ("residuals", "Residuals", lambda run: _residuals(run, checks)),
        ("reliability", "Reliability", _reliability),
        ("heaters", "Heaters", _heaters),
        ("telemetry", "Telemetry quality", _quality),
        ("provenance", "Provenance", _provenance),
    ]
    return [Section(anchor, title, build(run)) for anchor, title, build in made]


def _text(text: str) -> Block:
    return Block("text", text)


def _note(text: str) -> Block:
    return Block("note", text)


def _table(table: Table, nothing: str = "There is nothing to list.") -> Block:
    return Block("table", table=table) if table.rows else _note(nothing)


def _figure(figure: go.Figure, caption: str, *, wide: bool = False) -> Block:
    return Block("figure", caption, figures=(figure,), wide=wide)


def _bins(run: RunFiles) -> int:
    """Stretches into which a figure divides a long series: fewer for many plots, so that the page stays small."""
    plots = sum(window.sizes["channel"] for window in run.windows.values())
    return int(np.clip(6_000 // max(plots, 1), 40, 400))


def _has(window: xr.Dataset, method: str) -> bool:
    """Whether a window's prediction has a method, with numbers in it."""
    return method in window["method"].values and bool(np.isfinite(window["mean"].sel({"method": method}).values).any())


def _scores(run: RunFiles) -> list[Block]:
    if not run.metrics:
        return [_note("There are no scores in this run (metrics.json).")]
    return [
        _text(
            "Genetic algorithm (GA, mean of its runs as published) against the stochastic update (posterior mean), "
            "over all channels. A ratio below one (↓) says that the stochastic one is better. The paper's ratios are "
            "0.1014/0.1346 = 0.753 for RMSE and 0.054/0.061 = 0.885 for MAPE; its temperatures are masked, so that "
            "only ratios compare. A mean of runs can leave the ridge of good fits, so the best run stands beside it."
        ),
        _table(tables.comparison(run.metrics), "There is no pair of methods to compare."),
        Block("heading", "By window and channel"),
        _table(tables.scores(run.metrics)),
        Block("folded", "Every score of every method", table=tables.all_scores(run.metrics)),
        _text(
            "Only samples that were not used for the initial state count. PICP: share of telemetry inside the 95% "
            "interval; MPIW: mean width of that interval; CRPS: continuous ranked probability score, for a point "
            "method its mean absolute error. MAPE in °C is undefined (–) where telemetry comes within 1 °C of 0 °C."
        ),
    ]


def _before(run: RunFiles) -> list[Block]:
    if not run.windows:
        return [_note("There is no prediction in this run (prediction.nc), so figures 1 to 4 and 6 are missing.")]
    name, window = next(iter(run.windows.items()))
    blocks = []
    for figure, method, words in (
        (1, "uncalibrated", "Uncalibrated: every parameter at its prior's median"),
        (2, "poorly_calibrated", "Poorly calibrated: best of the genetic algorithm's first generation"),
    ):
        if _has(window, method):
            caption = f"Figure {figure}. {words}, against telemetry of the window “{name}”."
            if "eclipse" in window and (window["eclipse"] < 0.5).any():
                caption += " Eclipses are shaded."
            if figure == 1 and window.sizes["time"] > 6 * _bins(run):
                caption += " Of a long series like this one, every figure shows the extremes of each stretch."
            blocks.append(_figure(draw.figure_point(window, [method], _bins(run)), caption))
        else:
            blocks.append(_note(f"Figure {figure}: the prediction has no method “{method}”."))
    methods = [m for m in ("uncalibrated", "poorly_calibrated") if _has(window, m)]
    if window.sizes.get("heater", 0) and methods:
        caption = f"Figure 3. Heater status of both against telemetry (grey area: on) in the window “{name}”."
        blocks.append(_figure(draw.figure_heater_status(window, methods, _bins(run)), caption))
    else:
        why = "neither was simulated" if window.sizes.get("heater", 0) else "the scenario has no heaters"
        blocks.append(_note(f"Figure 3: {why}."))
    return blocks


def _genetic(run: RunFiles) -> list[Block]:
    windows = run.test_windows or run.windows
    blocks = [
        _figure(
            draw.figure_point(window, [m for m in ("genetic", "genetic_best") if _has(window, m)], _bins(run)),
            f"Figure 4{_letter(i, windows)}. Genetic algorithm (solid: mean of its runs, as published; dotted: best "
            f"run) against telemetry of the window “{name}”.",
        )
        for i, (name, window) in enumerate(windows.items())
        if _has(window, "genetic") or _has(window, "genetic_best")
    ]
    return blocks or [_note("Figure 4: there is no prediction by the genetic algorithm in this run.")]


def _letter(index: int, items: dict[str, xr.Dataset]) -> str:
    return chr(ord("a") + index % 26) if len(items) > 1 else ""


def _densities(run: RunFiles) -> list[Block]:
    if run.posterior is None or "prior" not in run.posterior.children or not run.parameters:
        return [_note("Figure 5: there is no posterior with its prior in this run (posterior.nc, parameters.json).")]
    prior, posterior = (run.posterior[g].to_dataset() for g in ("prior", "posterior"))
    infos = [i for i in run.parameters if i.name in posterior and i.name in prior]
    genetic = {}
    if run.genetic is not None:
        values = run.genetic["mean_theta"].values
        genetic = {str(n): float(v) for n, v in zip(run.genetic["parameter"].values, values, strict=True)}
    shown = [
        draw.figure_density(
            info, draws(run.posterior, "prior", [info.name])[..., 0].ravel(),
            draws(run.posterior, "posterior", [info.name])[..., 0], genetic.get(info.name), large=number_ < 3,
        )
        for number_, info in enumerate(infos)
    ]  # fmt: skip
    chains = run.posterior["posterior"].to_dataset().sizes["chain"]
    caption = (
        f"Figure 5. Prior (dashed grey) and posterior of the {chains} chains (solid), each scaled to its own peak; "
        "▲ the genetic algorithm's mean. Where the prior is more than 12 times as wide as the posterior, the axis "
        "shows the posterior's surroundings only; a double click shows all of the prior."
    )
    key = (
        ("prior", PRIOR, "dash"),
        *((f"chain {k + 1}", chain_colour(k), "line") for k in range(chains)),
        *((("genetic algorithm, mean", GENETIC, "mark"),) if genetic else ()),
    )
    blocks = [Block("grid", caption, figures=tuple(shown[:3]), key=key, wide=True)]
    if shown[3:]:
        blocks.append(Block("grid", "Figure 5, the other quantities.", figures=tuple(shown[3:]), key=key))
    return blocks


def _prediction(run: RunFiles) -> list[Block]:
    order = run.test_windows | {n: w for n, w in run.windows.items() if is_trained(n)}
    blocks = []
    for i, (name, window) in enumerate(order.items()):
        if not _has(window, "stochastic"):
            continue
        attributes = [
            f"{words}: {window.attrs[key]}."
            for key, words in (("interval_contains", "The interval contains"), ("initial_state", "Initial state"))
            if window.attrs.get(key)
        ]
        beneath = "; beneath, the probability that each heater is on" if window.sizes.get("heater", 0) else ""
        caption = (
            f"Figure 6{_letter(i, order)}. Mean and interval of the posterior's prediction against telemetry of the "
            f"window “{name}”{beneath}. {' '.join(attributes)}"
        )
        blocks.append(_figure(draw.figure_stochastic(window, _bins(run)), caption))
    return blocks or [_note("Figure 6: there is no stochastic prediction in this run.")]


def _parameters(run: RunFiles) -> list[Block]:
    if not run.parameters:
        return [_note("There is no list of parameters in this run (parameters.json).")]
    blocks = [_table(tables.parameters(run))]
    if run.posterior is None:
        blocks.insert(0, _note("There is no posterior in this run (posterior.nc): priors only."))
    blocks.append(
        _text(
            "Contraction is 1 − sd of the posterior / sd of the prior: 0% says that the telemetry taught nothing "
            "about the quantity. ESS: effective sample size. Absolute temperatures are in °C, all else in SI units."
        )
    )
    of_windows = discrepancy.window_values(run)
    if of_windows.rows:
        words = (
            "These parameters may differ between the training windows. “Common” is the centre around which they do; "
            "on a window that was not trained on, a value is drawn anew around it with the deviation drift.<parameter>."
        )
        blocks += [Block("heading", "Values by window"), _text(words), _table(of_windows)]
    return blocks


def _pairs(run: RunFiles) -> list[Block]:
    if run.posterior is None or not run.parameters:
        return [_note("There is no posterior in this run (posterior.nc).")]
    dataset = run.posterior["posterior"].to_dataset()
    infos = [i for i in run.parameters if i.name in dataset]
    values = draws(run.posterior, "posterior", [i.name for i in infos]).reshape(-1, len(infos))
    vary = np.ptp(values, axis=0) > 0
    infos, values = [i for i, v in zip(infos, vary, strict=True) if v], values[:, vary]
    if len(infos) < 2:
        return [_note("There are fewer than two quantities, so none to compare.")]
    correlation = np.corrcoef(values.T)
    chosen = draw.most_correlated(correlation, MOST_PAIRS)
    diverging = np.zeros(len(values), bool)
    if "sample_stats" in run.posterior.children and "diverging" in run.posterior["sample_stats"]:
        diverging = run.posterior["sample_stats"]["diverging"].transpose("chain", "draw").values.astype(bool).ravel()
    others = [i.name for k, i in enumerate(infos) if k not in chosen]
    rest = f" Not shown: {listed(others)}; the heat map above has them all." if others else ""
    return [
        _figure(
            draw.figure_correlation([i.name for i in infos], correlation),
            "Correlation of the posterior's quantities.", wide=True,
        ),
        _figure(
            draw.figure_pairs([infos[k] for k in chosen], values[:, chosen], diverging),
            f"Posterior draws of the {len(chosen)} quantities that correlate most (300 draws; red crosses: divergent "
            f"draws, {int(diverging.sum())} in all).{rest}",
            wide=True,
        ),
    ]  # fmt: skip


def _convergence(run: RunFiles) -> list[Block]:
    blocks = []
    if run.diagnostics is not None:
        blocks += [_table(tables.gates(run.diagnostics), "There are no gates in diagnostics.json.")]
        work = run.diagnostics.get("gradient_evaluations")
        if work is not None:
            seconds = ((run.provenance or {}).get("stages") or {}).get("nuts")
            effective = [p["ess_bulk"] for p in run.diagnostics.get("parameters", []) if p.get("ess_bulk")]
            blocks.append(
                _text(
                    f"{count(float(work))} gradients of the log density were computed, warm-up included"
                    + (
                        f", {float(work) / min(effective):.1f} for each effective draw of the worst"
                        if effective
                        else ""
                    )
                    + (f"; search of the mode and sampling took {duration(float(seconds))}." if seconds else ".")
                )
            )
    blocks += _genetic_convergence(run)
    if run.posterior is None:
        return [*blocks, _note("There are no chains in this run (posterior.nc).")]
    blocks += _mode_search(run.posterior.attrs)
    dataset = run.posterior["posterior"].to_dataset()
    infos = [i for i in run.parameters if i.name in dataset]
    if infos:
        of = {p["name"]: p for p in (run.diagnostics or {}).get("parameters", [])}
        worst = sorted(infos, key=lambda i: -(of.get(i.name, {}).get("r_hat") or 0.0))[:MOST_TRACES]
        caption = (
            f"Traces and ranks of the {len(worst)} quantities with the highest R-hat. Chains that agree have rank "
            "histograms that stay near the dotted line."
        )
        figure = draw.figure_traces(worst, draws(run.posterior, "posterior", [i.name for i in worst]))
        blocks.append(_figure(figure, caption, wide=True))
    return blocks


def _genetic_convergence(run: RunFiles) -> list[Block]:
    if run.genetic is None:
        return [_note("There is no genetic algorithm in this run (genetic.nc).")]
    evaluations = run.genetic.attrs.get("evaluations")
    work = f" {count(float(evaluations))} simulations in all." if evaluations is not None else ""
    runs = run.genetic.sizes["run"]
    blocks = [
        _figure(
            draw.figure_genetic_history(run.genetic),
            f"The {runs} runs of the genetic algorithm on the window “train”.{work}",
        )
    ]
    known = {i.name: i for i in run.parameters}
    names = [str(n) for n in run.genetic["parameter"].values if str(n) in known]
    if names:
        part = run.genetic.sel(parameter=names)
        available = run.posterior["posterior"].to_dataset() if run.posterior is not None else {}
        median = None
        if run.posterior is not None and all(n in available for n in names):
            median = np.median(draws(run.posterior, "posterior", names), axis=(0, 1))
        figure = draw.figure_genetic_spread(
            [known[n] for n in names], part["best"].transpose("run", "parameter").values, part["best_theta"].values,
            part["mean_theta"].values, median,
        )  # fmt: skip
        caption = (
            "Where the runs of the genetic algorithm ended, between the prior's 2.5th (0) and 97.5th percentile (1). "
            "A mean that lies off the ridge of good fits (◆) can be worse than the best run (★)."
        )
        blocks.append(_figure(figure, caption))
    return blocks


def _emulator(run: RunFiles) -> list[Block]:
    record = run.emulator or {}
    reached = record["reached"]
    blocks = [
        _text(
            "The simulator has no derivatives, so an emulator stands in for it: principal shapes of its trajectories, "
            f"with Gaussian processes for their coefficients, learnt from {count(record['runs'])} runs. Its error is "
            f"in the likelihood and in the intervals. {record['failures'] or 'No run failed'}."
        ),
        _text(
            "Each round adds runs where the emulator's error matters most to the posterior. It ends when that error is "
            "expected to shift the posterior by less than the scenario allows, the posterior no longer moves, and runs "
            "not yet seen are covered. "
            + ("It did." if reached else "It did not: the budget of runs was spent before, and intervals are wider.")
        ),
        _table(tables.emulator_rounds(record)),
    ]
    if any(window.sizes.get("heater", 0) for window in run.windows.values()):
        blocks.append(
            _note(
                "There are thermostats. In closed loop the likelihood has several modes, and what stands in for a "
                "simulator without derivatives has no open loop in which to seek the best of them. So the first rounds "
                "take only the beginning of the window, in which heaters have switched a few times, and the later ones "
                "as much more as the emulator follows. Whether the heaters keep step with the telemetry at the end is "
                "one of the posterior's gates; where no status is measured, nothing tells."
            )
        )
    if run.emulator_check is not None:
        check = run.emulator_check
        blocks += [
            Block("heading", "The simulator itself at the posterior's mean and at draws"),
            _text(
                f"{check['runs']} runs that the emulator has not seen; {check['failed']} more failed. Over the draws "
                f"the simulator's log density and the emulator's differ by {number(check['density_error'], 2)} "
                "(standard deviation): to first order no mean is off by more than so many of its standard deviations."
            ),
            _table(tables.emulator_check(check)),
        ]
    return blocks


def _full_check(run: RunFiles) -> list[Block]:
    check = run.full_check or {}
    return [
        _text(
            "The calibration went through a reduced model. Here it is beside the operational simulator that it stands "
            f"for, on-board software in the loop, on the training window: {count(check['flights'])} flights, at the "
            f"posterior's mean and at draws from it ({count(check['failed'])} could not be compared). The difference "
            "is reduced minus operational; it includes what the software does that a thermostat does not, and the "
            "flight's own initial temperatures. A sensor whose heater cycles out of step differs by up to its band."
        ),
        _table(tables.full_check(check)),
    ]


def _discrepancy(run: RunFiles) -> list[Block]:
    windows = {name: window for name, window in run.windows.items() if "discrepancy_mean" in window}
    part = discrepancy.parts(windows)
    blocks = [
        _text(
            "What the simulator lacks is calibrated with the parameters, as a Gaussian process for each channel. "
            f"{discrepancy.carries_over(part)} It is added to the simulation in the mean and in the intervals."
        ),
        _table(discrepancy.numbers(run), "Amplitudes and lengthscales are all fixed by the scenario."),
    ]
    if part == "phase":
        name, window = next(iter(windows.items()))
        caption = (
            f"Discrepancy over the orbit, from its start as the window “{name}” counts it: mean and interval of the "
            "posterior. Dots: telemetry minus the simulation alone, which is what the discrepancy has to explain."
        )
        blocks.append(_figure(draw.figure_discrepancy_in_phase(window), caption))
    else:
        blocks += [
            _figure(
                draw.figure_discrepancy_in_time(window, _bins(run)),
                f"Discrepancy in the window “{name}”: mean and interval of the posterior. Dots: telemetry minus the "
                "simulation alone, which is what the discrepancy has to explain.",
            )
            for name, window in windows.items()
        ]
    blocks += [
        _text(
            "The interval is that of the discrepancy alone. Each draw's discrepancy makes up for its own simulation, "
            "so their sum, the prediction, is known better than either."
        ),
        _table(discrepancy.sizes(windows)),
        Block("heading", "How far it can stand in for a parameter"),
    ]
    if run.posterior is None or "discrepancy" not in run.posterior.children:
        why = "It was not determined: there are several training windows, or no posterior (posterior.nc)."
        return [*blocks, _note(why)]
    return [
        *blocks,
        _text(
            "Correlation over the posterior's draws of a parameter with how much of the discrepancy lies in the "
            "direction in which that parameter moves the temperatures. Near −1 what the one gives, the other takes: "
            "the parameter's value then rests on the prior of the discrepancy. Near 0 the telemetry tells the two "
            "apart, or, where the contraction is small, nothing about the parameter at all."
        ),
        _table(discrepancy.confounded(run)),
    ]


def _residuals(run: RunFiles, checks: Checks) -> list[Block]:
    if not checks:
        return [_note("There is no stochastic prediction in this run, so no residuals.")]
    blocks = [
        *(_text(words) for words in map(_contradiction, checks, checks.values()) if words),
        _table(tables.residual_tests(checks)),
        _text(
            "Residual: telemetry minus the posterior's mean, which includes the expected discrepancy where there is "
            "one. Tested are the residuals, of AR(1) noise its innovations (the part of each residual that those "
            "before it do not tell), of rounded telemetry the noise drawn within the step; the numbers are of that. "
            "“Too narrow by” is √(number / effective number): by about this factor intervals of parameters are too "
            "narrow where the likelihood takes for white what is not. "
            "The posterior rests on what was trained on; other windows show whether the model's error persists."
        ),
    ]
    for name in checks:
        window = run.windows[name]
        blocks.append(Block("heading", f"Window “{name}”"))
        blocks.append(_figure(draw.figure_residuals(window, _bins(run)), f"Residuals in time, window “{name}”."))
        blocks.append(
            _figure(
                draw.figure_residual_distribution(window),
                f"Distribution and autocorrelation, window “{name}”.",
                wide=True,
            )
        )
    return blocks


def _reliability(run: RunFiles) -> list[Block]:
    windows = {name: window for name, window in run.windows.items() if _has(window, "stochastic")}
    if not windows:
        return [_note("There is no stochastic prediction in this run, so nothing whose reliability could be seen.")]
    blocks = [
        _table(tables.uniformity({name: uniformity(window) for name, window in windows.items()})),
        _text(
            "The transform of a sample is the probability that the prediction gave to a lower temperature, of a "
            "normal distribution: predictions that are right make it uniform, ones that are too narrow pile it up at 0 "
            "and 1, ones that are too wide in the middle, biased ones at one end. The test is that of Kolmogorov and "
            "Smirnov for as many independent samples as these are worth; bands of chance use the same number. An "
            "average coverage may be right while parts of the orbit or of the forecast are not covered."
        ),
    ]
    for name, window in windows.items():
        caption = (
            f"Reliability in the window “{name}”: probability integral transform, and share of telemetry inside the "
            "interval by place in the orbit and by hour of the forecast. Grey: what 95% of the values would be by "
            "chance where the interval is right; dotted: the interval's probability."
        )
        blocks.append(_figure(draw.figure_reliability(window), caption, wide=True))
    return blocks


def _contradiction(window: str, of_window: Sequence[ResidualCheck]) -> str:
    """In words, how many channels of a window contradict what is assumed; nothing where none can be judged."""
    judged = [c for c in of_window if c.verdict != "unknown"]
    against = [c for c in judged if c.verdict == "contradicted"]
    expected = [c for c in judged if c.verdict == "expected"]
    if not judged:
        return ""
    words = f"Window “{window}”: "
    if against:
        tested = listed(list(dict.fromkeys(c.tested for c in against)))
        alike = min(c.lag1 for c in against) > 0
        dependent = (
            f"each of their {tested} resembles the one before" if alike else f"their {tested} are not independent"
        )
        words += (
            f"{len(against)} of {len(judged)} channels contradict the {assumption(against)} that the likelihood "
            f"assumes: {dependent} (lag-1 autocorrelation {spread([c.lag1 for c in against])}; 0 for what is assumed)."
        )
    else:
        words += f"no channel contradicts {assumption(judged)}."
    if expected:
        tested = listed(list(dict.fromkeys(c.tested for c in expected)))
        words += (
            f" The {tested} of {listed([c.channel for c in expected])} "
            "are correlated, as a discrepancy in time makes them where nothing tells it; the interval contains it."
        )
    return f"{words} {correlation_expected(judged)}".strip()


def _mode_search(attributes: Mapping[Any, Any]) -> list[Block]:
    """How the mode was sought, and where the chains start."""
    search = json.loads(attributes.get("mode_search", "{}"))
    if not search.get("modes"):
        return []
    best = search["modes"][0]
    words = f"The mode was sought {search['sought']}. The chains start around the best of {len(search['modes'])} found"
    return [_text(f"{words} ({best['origin']})" + ("." if best["converged"] else "; the search did not converge."))]


def _heaters(run: RunFiles) -> list[Block]:
    with_heaters = {n: w for n, w in run.windows.items() if w.sizes.get("heater", 0)}
    if not with_heaters:
        return [_note("There is no heater in this run's prediction.")]
    blocks = [
        _table(tables.heaters(with_heaters)),
        _text(
            "Telemetry has the status of a heater, not its power: its energy is its duty cycle at the power of the "
            "posterior's mean. Its duty cycle is that of its valid samples and its switches are those between them; "
            "simulations run through gaps."
        ),
    ]
    if run.metrics:
        blocks.append(Block("folded", "Errors and agreement of every method", table=tables.heater_scores(run.metrics)))
    attributes = {} if run.posterior is None else run.posterior.attrs
    counted = json.loads(attributes.get("status_likelihood", "{}"))
    if counted:
        forms = listed([f"{form} of {channel}" for channel, form in counted.items()])
        blocks.append(_text(f"In the likelihood besides the temperatures: {forms}."))
    sequences = json.loads(attributes.get("switch_sequences", "[]"))
    if sequences:
        several = any(s["sequences"] > 1 for s in sequences)
        words = (
            "Draws of the posterior differ in the order in which the heaters switch; where they do, the likelihood "
            "has jumps."
            if several
            else "All draws of the posterior switch the heaters in the same order."
        )
        blocks += [_text(words), _table(tables.switch_sequences(sequences))]
    return blocks


def _quality(run: RunFiles) -> list[Block]:
    if run.quality is None:
        return [_note("There is no record of the telemetry's quality in this run (telemetry_quality.json).")]
    return [_table(tables.quality(run.quality), "No findings: every sample of every channel was usable.")]


def _provenance(run: RunFiles) -> list[Block]:
    blocks = [
        _table(tables.provenance(run.provenance))
        if run.provenance is not None
        else _note("There is no provenance in this run (provenance.json).")
    ]
    if run.scenario is None:
        return [*blocks, _note("There is no scenario in this run (scenario.yaml).")]
    return [*blocks, Block("source", run.scenario)]
