"""Duty cycles, switches and energy of the heaters."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
import xarray as xr

from ...prediction import Metric, implied_energy, values_of
from ...words import count, interval, listed, number, percent, signed_percent
from .. import block
from ..block import Block, section
from ..run_files import Record, RunFiles
from ..style import method
from ..tables import Cell, Table


@section("heaters", "Heaters in full")
def panel(run: RunFiles) -> list[Block]:
    """Duty cycles, switches and energy."""
    with_heaters = {n: w for n, w in run.windows.items() if w.sizes.get("heater", 0)}
    if not with_heaters:
        return [block.note("There is no heater in this run's prediction.")]
    blocks = [
        block.table(against_telemetry(with_heaters)),
        block.text(
            "Telemetry has the status of a heater, not its power: its energy is its duty cycle at the power of the "
            "posterior's mean, and as simulated where its status is unknown. Its duty cycle is that of the samples "
            "whose status is known, and simulations are held to it on the same samples; the duty cycle of the whole "
            "window stands below. Its switches are those between known samples; simulations run through gaps."
        ),
    ]
    if run.metrics:
        blocks.append(block.folded("Errors and agreement of every method", heater_scores(run.metrics)))
    attributes = {} if run.posterior is None else run.posterior.attrs
    counted = json.loads(attributes.get("status_likelihood", "{}"))
    if counted:
        forms = listed([f"{form} of {channel}" for channel, form in counted.items()])
        blocks.append(block.text(f"In the likelihood besides the temperatures: {forms}."))
    sequences = json.loads(attributes.get("switch_sequences", "[]"))
    if sequences:
        several = any(s["sequences"] > 1 for s in sequences)
        words = (
            "Draws of the posterior differ in the order in which the heaters switch; where they do, the likelihood "
            "has jumps."
            if several
            else "All draws of the posterior switch the heaters in the same order."
        )
        blocks += [block.text(words), block.table(switch_sequences(sequences))]
    return blocks


def against_telemetry(windows: dict[str, xr.Dataset]) -> Table:
    """Duty cycle, switch count and energy of each heater: telemetry, every point method, posterior's mean and 95%."""
    rows = []
    of_windows = dict.fromkeys(str(m) for w in windows.values() for m in w["by"].values)
    methods = [m for m in of_windows if m != "stochastic"]
    for name, window in windows.items():
        for heater in window.coords.get("heater", ()):
            part = window.sel(heater=heater)
            points = {
                v: [part[v].sel({"by": m}).item() if m in part["by"].values else np.nan for m in methods]
                for v in ("point_duty_cycle", "point_sampled_duty_cycle", "point_switch_count", "point_energy")
            }
            sampled, duty, energy, counts = (
                _simulated(part, v) for v in ("sampled_duty_cycle", "duty_cycle", "energy", "switch_count")
            )
            observed_duty = float(part["observed_duty_cycle"])
            mean_duty, mean_energy, on_samples = duty[0], energy[0], sampled[0]
            if not np.isfinite(mean_duty) and "genetic" in methods:
                genetic = methods.index("genetic")
                mean_duty, mean_energy = points["point_duty_cycle"][genetic], points["point_energy"][genetic]
                on_samples = points["point_sampled_duty_cycle"][genetic]
            implied = implied_energy(observed_duty + mean_duty - on_samples, mean_duty, mean_energy)
            observed_count = float(part["observed_switch_count"])
            known = points["point_sampled_duty_cycle"]
            for label, observed, point, (mean, low, high), scale in (
                ("duty cycle where the status is known, %", observed_duty, known, sampled, 100),
                ("duty cycle of the whole window, %", np.nan, points["point_duty_cycle"], duty, 100),
                ("switch count, –", observed_count, points["point_switch_count"], counts, 1),
                ("energy, kJ", implied, points["point_energy"], energy, 1e-3),
            ):
                if label.startswith("switch"):
                    predicted = f"{mean:.2f} [{count(low)}, {count(high)}]" if np.isfinite(mean) else "–"
                    values = [count(v) for v in (observed, *point)]
                else:
                    predicted = interval(scale * mean, scale * low, scale * high)
                    values = [number(scale * v, 3) for v in (observed, *point)]
                if label.endswith("whole window, %"):
                    values[0] = f"unknown for {percent(float(part['unknown_status']))}"
                verdict: str = "–"
                if np.isfinite([observed, low]).all():
                    # A duty cycle of samples may differ from the bound in the last bit.
                    inside = low - 1e-9 * abs(low) <= observed <= high + 1e-9 * abs(high)
                    verdict = Cell("✓ yes", "good") if inside else Cell("✕ no", "warn")
                rows.append([name, str(heater.values), label, *values, predicted, verdict])
    header = (
        "window", "heater", "quantity", "telemetry", *(method(m).short for m in methods),
        "stochastic, mean [95%]", "telemetry within 95%?",
    )  # fmt: skip
    return Table(header, rows, range(3, 5 + len(methods)))


def _simulated(part: xr.Dataset, variable: str) -> tuple[float, float, float]:
    """Mean, 2.5th and 97.5th percentile of the posterior's simulations; NaN where the run has none."""
    values = np.asarray(part[variable].values, float) if variable in part else np.array([np.nan])
    if not np.isfinite(values).any():
        return np.nan, np.nan, np.nan
    low, high = np.nanquantile(values, [0.025, 0.975])
    return float(np.nanmean(values)), float(low), float(high)


def heater_scores(metrics: Sequence[Metric]) -> Table:
    """Errors and agreement of each heater by method."""
    names = ("duty_cycle_error", "status_agreement", "status_unknown", "switch_count_error")
    found = values_of(m for m in metrics if m.metric in names)
    windows = list(dict.fromkeys(window for _, window, *_ in found))
    rows = []
    for place in sorted(dict.fromkeys(key[:3] for key in found), key=lambda key: (windows.index(key[1]), key[2])):
        duty, agreement, unknown, switches = (found.get((*place, name)) for name in names)
        more = "+" if switches is not None and switches > 0 else ""
        name, window, heater = place
        rows.append([window, heater, method(name).title, signed_percent(duty), percent(agreement), percent(unknown),
                     f"{more}{number(switches, 3)}"])  # fmt: skip
    header = (
        "window", "heater", "method", "duty cycle error, points", "status agreement", "status unknown",
        "switch count error, –",
    )  # fmt: skip
    return Table(header, rows, range(3, 7))


def switch_sequences(sequences: list[Record]) -> Table:
    """In how many ways the heaters switch among the posterior's draws."""
    rows = [[s["window"], count(s["sequences"]), percent(s["share_of_most_common"], 0)] for s in sequences]
    return Table(("window", "different switch sequences", "share of the most common"), rows, (1, 2))
