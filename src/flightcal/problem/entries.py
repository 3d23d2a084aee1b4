"""Theta: what is uncertain in a calibration, entry by entry, and where each window's own theta comes from.

Theta is ordered: the scenario's parameters; ``telemetry.time_error`` (s); noise, discrepancy and status;
``drift.<parameter>`` and ``drift.<parameter>.<window>`` where a parameter drifts; ``initial.<node>`` (K), with several
windows to train on ``initial.<window>.<node>``.

A parameter that drifts has, in window w, the unconstrained value z + tau xi_w: z is the common one, tau
(``drift.<parameter>``) the standard deviation between windows and xi_w (``drift.<parameter>.<window>``, standard
normal) how far this window is off. That is z_w ~ N(z, tau^2), non-centred (Papaspiliopoulos et al. 2007, Statistical
Science 22, 59-73), so that a small tau makes no funnel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from ..probability import Priors, PriorTerms, signed
from ..scenario import HalfNormal, Normal, Prior, Scenario, is_difference, timed_together
from ..simulator import TIME_ERROR, FloatArray, IntArray
from .window import Window

Kind = Literal["parameter", "noise", "discrepancy", "heat", "timing", "error_rate", "time", "initial", "drift"]


@dataclass(frozen=True)
class Entry:
    """One uncertain quantity: its name, SI unit, prior, what it sets or scales, and whose it is."""

    name: str
    unit: str
    prior: Prior
    kind: Kind
    sets: tuple[str, ...] = ()
    scales: tuple[str, ...] = ()
    window: str | None = None
    """None: all windows share it."""

    @property
    def is_temperature(self) -> bool:
        """Whether it is an absolute temperature, and not a difference."""
        of_sensor = any(map(is_difference, self.sets))
        return self.unit == "K" and (self.kind == "initial" or (bool(self.sets) and not of_sensor))

    @property
    def is_of_network(self) -> bool:
        """Whether temperatures respond to heat otherwise with it: not where they begin, nor when they are read."""
        return self.kind not in ("initial", "time")

    @property
    def long_name(self) -> str:
        """What it is, in words: for plots and tables that others make."""
        first, _, rest = self.name.partition(".")
        if self.kind == "parameter":
            told = [f"{verb} {', '.join(paths)}" for verb, paths in (("sets", self.sets), ("scales", self.scales))]
            return "; ".join(words for words, paths in zip(told, (self.sets, self.scales), strict=True) if paths)
        if self.kind == "time":
            return "error of all time tags: readings are of so much later"
        if self.kind == "initial":
            return f"initial temperature of {rest}"
        if self.kind == "drift":
            between = f"deviation of {rest} between windows"
            return between if self.window is None else f"how far {rest} is off in its window, in deviations"
        if self.kind == "noise":
            channel, _, what = rest.partition(".")
            return f"noise of {channel}: {what.replace('_', ' ') or 'standard deviation'}"
        about = {"heat": "unmodelled heat", "timing": "error of timing", "error_rate": "share of wrong samples"}
        return f"{about.get(first, first)}: {rest.replace('_', ' ') if self.kind == 'discrepancy' else rest}"


def entries_of(scenario: Scenario, windows: Sequence[Window]) -> tuple[Entry, ...]:
    """Theta of a calibration on these windows."""
    shared, initial = {}, []
    for window in windows:
        for name, prior in window.reads.items():
            if name.startswith("initial."):
                own = _initial_name(name, window, len(windows))
                initial.append(Entry(own, "K", prior, "initial", window=window.name))
            elif name not in shared:
                shared[name] = _entry(scenario, name, prior)
    drifts = []
    for name in drifting_parameters(scenario):
        scale = scenario.parameters[name].drift or 1.0
        drifts.append(Entry(f"drift.{name}", "", HalfNormal(scale=scale), "drift"))
        for window in windows:
            standard = Normal(mean=0.0, standard_deviation=1.0)
            drifts.append(Entry(f"drift.{name}.{window.label}", "", standard, "drift", window=window.name))
    return (*shared.values(), *drifts, *initial)


def _entry(scenario: Scenario, name: str, prior: Prior) -> Entry:
    parameter = scenario.parameters.get(name)
    if parameter is not None:
        return Entry(name, parameter.unit, prior, "parameter", parameter.sets, parameter.scales)
    if name == TIME_ERROR:
        return Entry(name, "s", prior, "time", timed_together(scenario))
    kind, *rest = name.split(".")
    if kind == "heat":
        return Entry(name, "" if rest == ["gains"] else "W", signed(prior), "heat")
    in_seconds = kind == "timing" or rest[-1:] == ["correlation_time"]
    in_orbits = kind == "discrepancy" and rest[:2] == ["phase", "lengthscale"]
    none = kind == "error_rate" or "degrees_of_freedom" in rest or in_orbits
    return Entry(name, "s" if in_seconds else "" if none else "K", prior, kind)  # type: ignore[arg-type]


def drifting_parameters(scenario: Scenario) -> tuple[str, ...]:
    """Names of the parameters that drift from window to window."""
    return tuple(name for name, parameter in scenario.parameters.items() if parameter.drift is not None)


def _initial_name(name: str, window: Window, windows: int) -> str:
    return name if windows == 1 else f"initial.{window.label}.{name.removeprefix('initial.')}"


# --- from theta to a window's own -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Link:
    """Where the entries of a window's theta [q] come from among those [d] of a calibration."""

    columns: IntArray
    """[q] position of each; -1: none, as of the initial temperatures of a window that is not calibrated on."""
    drifting: IntArray
    """[p] positions in q of the parameters that drift,"""
    deviation: IntArray
    """[p] and in d of tau,"""
    score: IntArray
    """[p] and of xi; -1: the window has none of its own."""
    priors: Priors
    """[p] of the parameters that drift: how theirs come from unconstrained values."""
    medians: FloatArray
    """[q] of the window's own priors: for what comes from nowhere."""

    @cached_property
    def drifts(self) -> tuple[IntArray, IntArray]:
        """Positions in d of each entry's tau and xi [q]; -1: it does not drift."""
        found = np.full((2, len(self.columns)), -1)
        found[:, self.drifting] = self.deviation, self.score
        return found[0], found[1]

    def at(self, z: FloatArray, prior: PriorTerms) -> PriorTerms:
        """The window's theta [q] and its slopes by its own coordinates, at z [d] where the priors are `prior`."""
        theta, slope = prior.theta[self.columns], prior.slope[self.columns]
        if len(self.drifting):
            moved = self.priors.at(z[self.columns[self.drifting]] + prior.theta[self.deviation] * z[self.score])
            theta[self.drifting], slope[self.drifting] = moved.theta, moved.slope
        return PriorTerms(theta, slope, prior.log_density, prior.gradient)

    def coordinates(self, z: FloatArray, thetas: FloatArray) -> FloatArray:
        """The window's own coordinates [..., q] at z [..., d], which are thetas [..., d]."""
        inside = z[..., self.columns]
        inside[..., self.drifting] += thetas[..., self.deviation] * z[..., self.score]
        return inside

    def pull_back(self, z: FloatArray, prior: PriorTerms, inside_bar: FloatArray) -> FloatArray:
        """Cotangent of z [d] from that [q] of the window's own coordinates."""
        return np.asarray(inside_bar @ self.derivative(z, prior))

    def derivative(self, z: FloatArray, prior: PriorTerms) -> FloatArray:
        """Of the window's coordinates by z [d], [q, d]."""
        derivative = np.zeros((len(self.columns), len(z)))
        derivative[np.arange(len(self.columns)), self.columns] = 1.0
        derivative[self.drifting, self.score] = prior.theta[self.deviation]
        derivative[self.drifting, self.deviation] = z[self.score] * prior.slope[self.deviation]
        return derivative

    def thetas(self, thetas: FloatArray, priors: Priors, rng: np.random.Generator | None) -> FloatArray:
        """Thetas of the window [..., q] from those [..., d] of a calibration with `priors`.

        What comes from nowhere is at its median; a parameter that drifts is drawn anew around the common value where
        the window has no score (rng; None: it is the common value).
        """
        inside = np.where(self.columns < 0, self.medians, thetas[..., self.columns])
        if len(self.drifting):
            z = priors.to_z(thetas)
            own: FloatArray = z[..., self.columns[self.drifting]]
            for k, (deviation, score) in enumerate(zip(self.deviation, self.score, strict=True)):
                if score >= 0:
                    own[..., k] += thetas[..., deviation] * z[..., score]
                elif rng is not None:
                    own[..., k] += thetas[..., deviation] * rng.standard_normal(z.shape[:-1])
            inside[..., self.drifting] = self.priors.to_theta(own)
        return inside


def link(entries: Sequence[Entry], windows: Sequence[Window], window: Window) -> Link:
    """Where a window's theta comes from; it need not be one of `windows`, which are calibrated on."""
    place = {entry.name: k for k, entry in enumerate(entries)}
    among = any(own.name == window.name for own in windows)

    def column(name: str) -> int:
        if not name.startswith("initial."):
            return place.get(name, -1)
        return place.get(_initial_name(name, window, len(windows)), -1) if among else -1

    drifting = [name for name in drifting_parameters(window.scenario) if f"drift.{name}" in place]
    columns = np.array([column(name) for name in window.names], dtype=np.int64)
    positions = np.array([window.names.index(name) for name in drifting], dtype=np.int64)
    return Link(
        columns,
        positions,
        np.array([place[f"drift.{name}"] for name in drifting], dtype=np.int64),
        np.array([place.get(f"drift.{name}.{window.label}", -1) for name in drifting], dtype=np.int64),
        Priors(tuple(drifting), tuple(entries[k].prior for k in columns[positions])),
        Priors(window.names, tuple(window.reads.values())).median(),
    )
