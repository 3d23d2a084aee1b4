"""Tables of the report as rows of text."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os.path import normpath

import numpy as np
import xarray as xr

from flightcal.validation import Metric, ResidualCheck, Uniformity, comparison_table
from flightcal.validation.metrics import implied_energy
from flightcal.validation.residuals import IID, SIGNIFICANCE

from .run_files import ParameterInfo, Record, RunFiles, draws
from .text import METHODS, SHORT_METHODS, count, duration, number, percent, signed_percent, unit
from .verdict import at_edge, shown

INTERVAL = "median [95%]"

MOST_TARGETS = 2
"""Places that a parameter sets or scales that the table names; the scenario on the page has them all."""


@dataclass(frozen=True)
class Table:
    """A table: a header, rows of text, and where a cell wants to be seen its state (good, warn, bad)."""

    header: tuple[str, ...]
    rows: list[list[str]]
    numbers: Sequence[int] = ()
    """Columns of numbers, which are set to the right."""
    groups: Sequence[tuple[str, int]] = ()
    """Titles over several columns: title and number of columns."""
    states: dict[tuple[int, int], str] | None = None
    """(row, column) -> state"""

    def state(self, row: int, column: int) -> str:
        """State of a cell, or nothing."""
        return (self.states or {}).get((row, column), "")


def comparison(metrics: Sequence[Metric]) -> Table:
    """Genetic against stochastic over all channels, the paper's ratios and the best genetic run beside."""
    names = {
        "rmse": "RMSE, K",
        "mape_kelvin": "MAPE, % of kelvin",
        "mape_celsius": "MAPE, % of °C",
        "crps": "CRPS, K",
    }
    best = {(m.window, m.metric): m.value for m in metrics if (m.method, m.channel) == ("genetic_best", "all")}
    rows: list[list[str]] = []
    states: dict[tuple[int, int], str] = {}
    for row in (r for r in comparison_table(metrics) if r.channel == "all"):
        if row.ratio is not None:
            states[len(rows), 4] = "good" if row.ratio < 1 else "warn"
        better = "" if row.ratio is None else " ↓" if row.ratio < 1 else " ↑"
        of_best = best.get((row.window, row.metric))
        to_best = row.stochastic / of_best if of_best and row.stochastic is not None else None
        note = f"\n{row.note.replace('degC', '°C')}" if row.note else ""
        rows.append(
            [row.window, names[row.metric] + note, number(row.genetic), number(row.stochastic),
             number(row.ratio, 3) + better, number(row.published, 3), number(of_best), number(to_best, 3)]
        )  # fmt: skip
    header = (
        "window", "score", "GA mean", "stochastic", "stoch. / GA mean", "same in the paper", "GA best",
        "stoch. / GA best",
    )  # fmt: skip
    return Table(header, rows, range(2, 8), states=states)


def scores(metrics: Sequence[Metric]) -> Table:
    """Temperature scores with a row for each window and channel, all channels first: methods beside each other."""
    found = {(m.window, m.channel, m.method, m.metric): m.value for m in metrics}
    methods = list(dict.fromkeys(m.method for m in metrics if m.metric == "rmse"))
    rows = []
    for place in _places(metrics):

        def value(method: str, metric: str, place: tuple[str, str] = place) -> float | None:
            return found.get((*place, method, metric))

        def pair(metric: str, value: Callable[[str, str], float | None] = value) -> str:
            return f"{number(value('genetic', metric), 3)} / {number(value('stochastic', metric), 3)}"

        genetic, stochastic = value("genetic", "rmse"), value("stochastic", "rmse")
        ratio = stochastic / genetic if genetic and stochastic is not None else None
        rows.append(
            [*place, *(number(value(method, "rmse"), 3) for method in methods), number(ratio, 3),
             percent(value("stochastic", "picp")), number(value("stochastic", "mpiw"), 3), pair("crps"),
             pair("mape_kelvin"), pair("mape_celsius")]
        )  # fmt: skip
    header = (
        "window", "channel", *(SHORT_METHODS.get(method, method) for method in methods), "stoch. / GA mean",
        "PICP", "MPIW, K", "CRPS, K", "MAPE, % of K", "MAPE, % of °C",
    )  # fmt: skip
    groups = (("", 2), ("RMSE, K", len(methods) + 1), ("95% interval", 2), ("GA mean / stochastic", 3))
    return Table(header, rows, range(2, len(header)), groups)


def _places(metrics: Sequence[Metric]) -> list[tuple[str, str]]:
    """Windows and channels with temperature scores, all channels first."""
    places = dict.fromkeys((m.window, m.channel) for m in metrics if m.metric == "rmse")
    windows = list(dict.fromkeys(window for window, _ in places))
    return sorted(places, key=lambda place: (windows.index(place[0]), place[1] != "all"))


def all_scores(metrics: Sequence[Metric]) -> Table:
    """Every temperature score: a row for each window, channel and method."""
    names = ("rmse", "mape_kelvin", "mape_celsius", "crps", "picp", "mpiw")
    found = {(m.window, m.channel, m.method, m.metric): m.value for m in metrics}
    methods = list(dict.fromkeys(m.method for m in metrics))
    rows = [
        [*place, METHODS.get(method, method), *(number(found.get((*place, method, name))) for name in names)]
        for place in _places(metrics)
        for method in methods
        if (*place, method, "rmse") in found
    ]
    header = (
        "window",
        "channel",
        "method",
        "RMSE, K",
        "MAPE, % of K",
        "MAPE, % of °C",
        "CRPS, K",
        "PICP, share",
        "MPIW, K",
    )
    return Table(header, rows, range(3, 9))


def parameters(run: RunFiles) -> Table:
    """Prior against posterior of every uncertain quantity, with its diagnostics."""
    diagnosed = {p["name"]: p for p in (run.diagnostics or {}).get("parameters", [])}
    available = run.posterior["posterior"].to_dataset().data_vars if run.posterior else {}
    edges = at_edge(run)
    rows: list[list[str]] = []
    states: dict[tuple[int, int], str] = {}
    for info in run.parameters:
        low, median, high = info.prior_quantiles
        more = f" and {len(info.target) - MOST_TARGETS} more" if len(info.target) > MOST_TARGETS else ""
        target = f"\n{info.mode} {', '.join(info.target[:MOST_TARGETS])}{more}" if info.target else ""
        symbol = f", {unit(info.unit)}" if unit(info.unit) else ""
        cells = [f"{info.name}{symbol}{target}", f"{_interval(median, low, high, info)}\n{_prior(info)}"]
        if info.name in available and run.posterior is not None:
            values = draws(run.posterior, "posterior", [info.name])
            prior = draws(run.posterior, "prior", [info.name]) if "prior" in run.posterior.children else None
            q = np.quantile(values, [0.025, 0.5, 0.975])
            contraction = 1 - float(values.std() / prior.std()) if prior is not None and prior.std() > 0 else None
            cells += [_interval(q[1], q[0], q[2], info), percent(contraction)]
        else:
            cells += ["–"] * 2
        of = diagnosed.get(info.name, {})
        r_hat = of.get("r_hat")
        cells += [
            "–" if r_hat is None else f"{r_hat:.3f}",
            f"{count(of.get('ess_bulk'))} / {count(of.get('ess_tail'))}",
        ]
        if info.name in edges:
            cells[2] += f"\n⚠ at the prior's {edges[info.name]} edge"
            states[len(rows), 2] = "warn"
        if (r_hat or 0) > 1.01:
            states[len(rows), 4] = "bad"
        rows.append(cells)
    header = (
        "quantity, unit",
        f"prior, {INTERVAL}",
        f"posterior, {INTERVAL}",
        "contraction",
        "R-hat",
        "ESS bulk / tail",
    )
    return Table(header, rows, range(1, 6), states=states)


def _prior(info: ParameterInfo) -> str:
    """The prior in words, as parameters.json has it; in kelvin where the quantity is shown in degC."""
    words = info.prior.replace("standard_deviation", "sd").replace("_", " ")
    return f"{words}, in K" if info.offset else words


def _interval(median: float, low: float, high: float, info: ParameterInfo) -> str:
    return interval(median + info.offset, low + info.offset, high + info.offset)


def interval(middle: float, low: float, high: float) -> str:
    """``0.4213 [0.4131, 0.4298]``, all with the decimals that the width asks for."""
    width = high - low
    if not np.isfinite(width):
        return "–"
    largest = max(abs(low), abs(high), 1e-300)
    digits = 4 if width <= 0 else int(np.clip(np.ceil(np.log10(largest / width)) + 2, 3, 8))
    return f"{number(middle, digits)} [{number(low, digits)}, {number(high, digits)}]"


def heaters(windows: dict[str, xr.Dataset]) -> Table:
    """Duty cycle, switch count and energy of each heater: telemetry, every point method, posterior's mean and 95%."""
    rows: list[list[str]] = []
    states: dict[tuple[int, int], str] = {}
    of_windows = dict.fromkeys(str(m) for w in windows.values() for m in w["method"].values)
    methods = [m for m in of_windows if m != "stochastic"]
    for name, window in windows.items():
        for heater in window.coords.get("heater", ()):
            part = window.sel(heater=heater)
            points = {
                v: [part[v].sel({"method": m}).item() if m in part["method"].values else np.nan for m in methods]
                for v in ("point_duty_cycle", "point_switch_count", "point_energy")
            }
            duty, energy, counts = (_simulated(part, v) for v in ("duty_cycle", "energy", "switch_count"))
            observed_duty = float(part["observed_duty_cycle"])
            mean_duty, mean_energy = _average(duty), _average(energy)
            if not np.isfinite(mean_duty) and "genetic" in methods:
                genetic = methods.index("genetic")
                mean_duty, mean_energy = points["point_duty_cycle"][genetic], points["point_energy"][genetic]
            implied = implied_energy(observed_duty, mean_duty, mean_energy)
            observed_count = float(part["observed_switch_count"])
            for label, observed, point, simulated, scale in (
                ("duty cycle, %", observed_duty, points["point_duty_cycle"], duty, 100),
                ("switch count, –", observed_count, points["point_switch_count"], counts, 1),
                ("energy, kJ", implied, points["point_energy"], energy, 1e-3),
            ):
                inside, cell = _against(observed, simulated)
                if inside is not None:
                    states[len(rows), 5 + len(methods)] = "good" if inside else "warn"
                average = _average(simulated)
                low, high = _bounds(simulated)
                if label.startswith("switch"):
                    mean = f"{average:.2f} [{count(low)}, {count(high)}]" if np.isfinite(average) else "–"
                    values = [count(v) for v in (observed, *point)]
                else:
                    mean = interval(scale * average, scale * low, scale * high)
                    values = [number(scale * v, 3) for v in (observed, *point)]
                rows.append([name, str(heater.values), label, *values, mean, cell])
    header = (
        "window", "heater", "quantity", "telemetry", *(SHORT_METHODS.get(m, m) for m in methods),
        "stochastic, mean [95%]", "telemetry within 95%?",
    )  # fmt: skip
    return Table(header, rows, range(3, 5 + len(methods)), states=states)


def _simulated(part: xr.Dataset, variable: str) -> np.ndarray:
    """Values of the posterior's simulations, [simulation]; NaN where the run has none."""
    return np.asarray(part[variable].values, float) if variable in part else np.array([np.nan])


def _average(values: np.ndarray) -> float:
    return float(np.nanmean(values)) if np.isfinite(values).any() else np.nan


def _bounds(values: np.ndarray) -> tuple[float, float]:
    """2.5th and 97.5th percentile; NaN where there are no simulations."""
    if not np.isfinite(values).any():
        return np.nan, np.nan
    low, high = np.nanquantile(values, [0.025, 0.975])
    return float(low), float(high)


def _against(observed: float, simulated: np.ndarray) -> tuple[bool | None, str]:
    low, high = _bounds(simulated)
    if not np.isfinite([observed, low]).all():
        return None, "–"
    # A duty cycle of samples may differ from the bound in the last bit.
    inside = bool(low - 1e-9 * abs(low) <= observed <= high + 1e-9 * abs(high))
    return inside, "✓ yes" if inside else "✕ no"


def residual_tests(checks: dict[str, list[ResidualCheck]]) -> Table:
    """Tests of the residuals by window and channel."""
    rows: list[list[str]] = []
    states: dict[tuple[int, int], str] = {}
    for window, of_window in checks.items():
        for c in of_window:
            states[len(rows), 2] = {"contradicted": "bad", "unknown": "", "expected": ""}.get(c.verdict, "good")
            p = _chance(c.p_value)
            white = "iid" if c.noise == IID and not c.discrepancy else "white"
            verdict = {
                "white": f"✓ {white}", "slight": f"✓ nearly {white}", "contradicted": f"✕ not {white}",
                "expected": "– not white,\nas expected", "unknown": "– unknown",
            }[c.verdict]  # fmt: skip
            assumed = f"{c.noise},\ndiscrepancy in {c.discrepancy}" if c.discrepancy else c.noise
            innovations = c.tested == "innovations"
            ar1 = "" if innovations else f"\nif AR(1): {number(c.factor_ar1, 3)}"
            of_residuals = f"\nof residuals {number(c.residual_lag1, 3)}" if innovations else ""
            rows.append(
                [window, f"{c.channel}\n{assumed}", verdict, f"{number(c.factor, 3)}{ar1}",
                 f"{count(c.effective)}\nof {count(c.samples)}", f"{number(c.lag1, 3)}{of_residuals}",
                 f"{p}\nQ = {number(c.ljung_box, 4)}, {c.lags} lags",
                 f"{number(c.mean, 2)}\nsd {number(c.standard_deviation, 3)}"]
            )  # fmt: skip
    header = (
        "window", "channel, and what is assumed", "verdict", "too narrow by", "effective number",
        "lag-1 auto\u00adcorrelation", "Ljung-Box", "mean, K",
    )  # fmt: skip
    return Table(header, rows, range(3, 8), states=states)


def uniformity(found: dict[str, list[Uniformity]]) -> Table:
    """Whether the probability integral transform is uniform, by window and channel."""
    rows: list[list[str]] = []
    states: dict[tuple[int, int], str] = {}
    for window, of_window in found.items():
        for u in of_window:
            against = u.p_value < SIGNIFICANCE
            states[len(rows), 2] = "bad" if against else "good"
            verdict = "– unknown" if math.isnan(u.p_value) else "✕ not uniform" if against else "✓ uniform"
            rows.append(
                [window, u.channel, verdict, _chance(u.p_value), number(u.distance, 2),
                 f"{count(u.effective)}\nof {count(u.samples)}"]
            )  # fmt: skip
    header = ("window", "channel", "transform", "Kolmogorov-Smirnov", "distance", "effective number")
    return Table(header, rows, range(3, 6), states=states)


def _chance(p_value: float) -> str:
    return "p < 0.0001" if p_value < 1e-4 else f"p = {number(p_value, 2)}"


def gates(diagnostics: Record) -> Table:
    """Gates of convergence, each with what was found and what is required."""
    rows = [
        ["✓ passed" if g["passed"] else "✕ failed", g["name"], shown(g["found"]), shown(g["required"]),
         g.get("advice") or ""]
        for g in diagnostics["gates"]
    ]  # fmt: skip
    states = {(i, 0): "good" if g["passed"] else "bad" for i, g in enumerate(diagnostics["gates"])}
    return Table(("", "gate", "found", "required", "advice"), rows, (), states=states)


def emulator_rounds(record: Record) -> Table:
    """What each round of the active learning found."""
    rows = []
    for r in record["rounds"]:
        covered = r["validation"]["channels"][-1]["coverage"][-1] if r["validation"] else None
        rows.append(
            [count(r["number"]), count(r["runs"]), count(r["failed"]), count(r["fitted"]), count(r["samples"]),
             count(r["shapes"]), number(r["error_share"], 2), number(r["expected_shift"], 2),
             number(r["mean_shift"], 2), percent(covered, 0), r["verdict"]]
        )  # fmt: skip
    header = (
        "round", "runs", "failed", "fitted", "samples", "shapes", "error / noise", "expected shift, sd",
        "mean moved, sd", "new runs covered", "what goes on",
    )  # fmt: skip
    return Table(header, rows, range(10))


def emulator_check(check: Record) -> Table:
    """How held-out runs were predicted, by channel."""
    rows = [
        [c["channel"], number(c["rmse"], 2), number(c["worst"], 2), number(c["deviation"], 2),
         number(c["standardised"], 2), *(percent(share, 0) for share in c["coverage"])]
        for c in check["channels"]
    ]  # fmt: skip
    header = ("channel", "RMSE, K", "worst, K", "predicted sd, K", "error / sd", "in 50%", "in 80%", "in 95%")
    return Table(header, rows, range(1, 8))


def full_check(check: Record) -> Table:
    """How far the reduced model is off the operational simulator at posterior draws: sensors, then heaters' duty."""
    rows = []
    for r in check["records"]:
        factor, unit = (1.0, "K") if r["unit"] == "K" else (100.0, "percentage points of duty")
        rows.append(
            [r["channel"], unit, *(number(factor * r[key], 2) for key in ("mean", "rms", "quantile_95", "worst"))]
        )
    return Table(("", "in", "mean", "RMS", "95% of its size", "worst"), rows, range(2, 6))


def switch_sequences(sequences: list[Record]) -> Table:
    """In how many ways the heaters switch among the posterior's draws."""
    rows = [[s["window"], count(s["sequences"]), percent(s["share_of_most_common"], 0)] for s in sequences]
    return Table(("window", "different switch sequences", "share of the most common"), rows, (1, 2))


def quality(records: list[Record]) -> Table:
    """Findings about the telemetry."""
    rows = [
        [r["channel"] or "(rows of the file)", str(r["finding"]).replace("_", " "), count(r["samples"]),
         percent(r["share"], 2), _moment(r.get("first")), _moment(r.get("last")), str(r.get("detail") or "")]
        for r in records
    ]  # fmt: skip
    header = ("channel", "finding", "samples", "share", "first, UTC", "last, UTC", "detail")
    return Table(header, rows, (2, 3))


def _moment(text: object) -> str:
    return str(text).replace("T", " ")[:19] if text else "–"


def provenance(record: Record) -> Table:
    """Versions, inputs, seed, wall times, machine."""
    packages = [f"{n} {v}" for n, v in (record.get("packages") or {}).items() if n != "flightcal"]
    stages = record.get("stages") or {}
    rows = [
        ["created, UTC", _moment(record.get("created"))],
        ["flightcal", str(record.get("flightcal", "–"))],
        ["Python", str(record.get("python", "–"))],
        ["packages", ", ".join(packages) or "–"],
        ["seed", str(record.get("seed", "–"))],
        *([f"wall time, {name}", duration(float(s))] for name, s in stages.items()),
        *([["wall time, all", duration(sum(float(s) for s in stages.values()))]] if stages else []),
        ["machine", ", ".join(f"{k}: {v}" for k, v in (record.get("machine") or {}).items()) or "–"],
        *([f"SHA-256 of {normpath(name)}", digest] for name, digest in (record.get("inputs") or {}).items()),
    ]
    return Table(("", ""), rows)


def heater_scores(metrics: Sequence[Metric]) -> Table:
    """Errors and agreement of each heater by method."""
    names = ("duty_cycle_error", "status_agreement", "switch_count_error")
    found = {(m.window, m.channel, m.method, m.metric): m.value for m in metrics if m.metric in names}
    windows = list(dict.fromkeys(window for window, *_ in found))
    rows = []
    for window, heater, method in sorted(
        dict.fromkeys(key[:3] for key in found), key=lambda key: (windows.index(key[0]), key[1])
    ):
        duty, agreement, count = (found.get((window, heater, method, n)) for n in names)
        rows.append(
            [window, heater, METHODS.get(method, method), signed_percent(duty), percent(agreement),
             number(count, 3) if count is None or count <= 0 else f"+{number(count, 3)}"]
        )  # fmt: skip
    header = ("window", "heater", "method", "duty cycle error, points", "status agreement", "switch count error, –")
    return Table(header, rows, range(3, 6))
