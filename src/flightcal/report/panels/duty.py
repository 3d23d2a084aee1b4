"""How long heaters were on in unseen telemetry, and how long the prediction has them on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from ...prediction import is_plan
from ...words import percent
from .. import block
from ..block import Block, section
from ..run_files import RunFiles
from ..tables import Cell, Table

_ELSEWHERE: Final = 0.02
"""Share of the time, by which a heater is otherwise on in the whole window than in the samples of known status."""
CLOSED: Final = 0.99
"""Probability with which all duty cycles of a right model lie inside."""

Where = Literal["inside", "beside", "outside"]
_CELLS: Final = {
    "inside": Cell("✓ inside", "good"), "beside": Cell("✓ by chance", "good"), "outside": Cell("✕ outside", "warn"),
}  # fmt: skip


@dataclass(frozen=True)
class Duty:
    """Share of the time that a heater is on in a window that was not trained on."""

    window: str
    heater: str
    measured: float
    """NaN where its status is not known."""
    mean: float
    lower: float
    upper: float
    """Ends of the central 95% of what is predicted."""
    whole: tuple[float, float, float]
    """Mean and ends of what is predicted of the whole window; the others are of the samples whose status is known."""
    where: Where
    """Of the interval; beside it, as a right model may have one of many, or where it would have none."""


@section("duty", "Heaters")
def panel(run: RunFiles) -> list[Block]:
    """Duty cycles predicted and measured."""
    found = duties(run)
    if not found:
        none = run.windows and not any(window.sizes.get("heater", 0) for window in run.windows.values())
        return [block.note("There are no heaters." if none else "No duty cycle is predicted on unseen telemetry.")]
    words = (
        "Duty cycle: the share of the time that a heater is on. By chance: beside its interval, as one in twenty of a "
        "right model is. Outside: too far off for a right model, all heaters together."
    )
    if any(map(_is_sampled, found)):
        words += (
            " Measured and predicted: of the samples whose status is known, as of passes. Whole window: of all of its "
            "time, as an energy budget needs it; it is predicted alone."
        )
    return [block.table(table(found)), block.text(words)]


def table(found: list[Duty]) -> Table:
    """A row for each heater and window."""
    rows = []
    for duty in found:
        verdict: str = "not measured"
        if np.isfinite(duty.measured):
            verdict = _CELLS[duty.where]
        interval = f"{percent(duty.lower)} to {percent(duty.upper)}"
        if _is_sampled(duty):
            mean, lower, upper = map(percent, duty.whole)
            interval += f"\nwhole window {mean} ({lower} to {upper})"
        rows.append([duty.heater, duty.window, percent(duty.measured), percent(duty.mean), interval, verdict])
    return Table(("heater", "window", "measured", "predicted", "95% interval", "in words"), rows, (2, 3, 4))


def _is_sampled(duty: Duty) -> bool:
    """Whether the samples of known status are not as the whole window."""
    return abs(duty.whole[0] - duty.mean) > _ELSEWHERE


def duties(run: RunFiles) -> list[Duty]:
    """Of each heater and window that was not trained on, those that are outside first."""
    windows = {name: window for name, window in run.test_windows.items() if "duty_cycle" in window}
    # What is known of a plan is how it begins.
    observed = {
        name: window["observed_duty_cycle"] * (np.nan if is_plan(window) else 1.0) for name, window in windows.items()
    }
    count = sum(int(np.isfinite(series.values).sum()) for series in observed.values())
    # All duty cycles together leave their bands by chance once in a hundred times.
    tail = 0.5 * (1.0 - CLOSED ** (1.0 / max(count, 1)))
    found = []
    for name, window in windows.items():
        resolution = 1.0 / max(window.sizes["time"], 1)
        for heater in window["heater"].values:
            measured = float(observed[name].sel(heater=heater))
            # Without a status it is that of the whole window, and of the samples of known status with one.
            name_of = "sampled_duty_cycle" if np.isfinite(measured) else "duty_cycle"
            values = window[name_of].sel(heater=heater).values
            if not np.isfinite(values).any():
                continue
            of_window = window["duty_cycle"].sel(heater=heater).values
            of_window = of_window if np.isfinite(of_window).any() else values
            whole = float(np.nanmean(of_window)), *np.nanquantile(of_window, [0.025, 0.975]).tolist()
            low, lower, upper, high = np.nanquantile(values, [tail, 0.025, 0.975, 1.0 - tail]).tolist()
            where: Where = "inside"
            if measured < low - resolution or measured > high + resolution:
                where = "outside"
            elif measured < lower - resolution or measured > upper + resolution:
                where = "beside"
            found.append(Duty(name, str(heater), measured, float(np.nanmean(values)), lower, upper, whole, where))
    return sorted(found, key=lambda duty: ("outside", "beside", "inside").index(duty.where))
