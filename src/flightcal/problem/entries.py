"""Theta: what is uncertain in a calibration, entry by entry, and where each window's own theta comes from.

Theta is ordered: the scenario's parameters; ``telemetry.time_error`` (s); noise, discrepancy and status;
``trend.<parameter>`` where a parameter has a trend; ``drift.<parameter>`` and ``drift.<parameter>.<window>`` where one
drifts; ``initial.<node>`` (K), with several windows to train on ``initial.<window>.<node>``.

A parameter that moves has, in window w, the unconstrained value z + r t_w / s + tau xi_w. z is the common one. r
(``trend.<parameter>``) is the change in a year, in the parameter's unit at its prior's median, where s is the slope of
the parameter by z. t_w is by how many years the middle of the window is after the mean of those of all windows to train
on. tau (``drift.<parameter>``) is the standard deviation between windows, and xi_w
(``drift.<parameter>.<window>``, standard normal) how far this window is off. That is z_w ~ N(z + r t_w / s, tau^2),
non-centred (Papaspiliopoulos et al. 2007, Statistical Science 22, 59-73), so that a small tau makes no funnel.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from ..environment import timespan
from ..probability import Priors, PriorTerms, signed
from ..scenario import HalfNormal, Normal, Prior, Scenario, is_difference, timed_together
from ..simulator import TIME_ERROR, FloatArray, IntArray
from .window import Window

Kind = Literal["parameter", "noise", "discrepancy", "heat", "timing", "error_rate", "time", "initial", "drift"]

_YEAR = 365.25 * 86400.0
"""s."""


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
        if self.kind == "drift" and first == "trend":
            return f"change of {rest} in a year"
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
                full_name = _initial_name(name, window, len(windows))
                initial.append(Entry(full_name, "K", prior, "initial", window=window.name))
            elif name not in shared:
                shared[name] = _entry(scenario, name, prior)
    moving = [entry for name in moving_parameters(scenario) for entry in _moving(scenario, name, windows)]
    return (*shared.values(), *moving, *initial)


def _moving(scenario: Scenario, name: str, windows: Sequence[Window]) -> Iterator[Entry]:
    """What moves a parameter from window to window."""
    parameter = scenario.parameters[name]
    if parameter.trend is not None:
        prior = Normal(mean=0.0, standard_deviation=parameter.trend * _slope(parameter.prior))
        yield Entry(f"trend.{name}", f"{parameter.unit or '1'}/year", prior, "drift")
    if parameter.drift is not None:
        yield Entry(f"drift.{name}", "", HalfNormal(scale=parameter.drift), "drift")
        for window in windows:
            standard = Normal(mean=0.0, standard_deviation=1.0)
            yield Entry(f"drift.{name}.{window.label}", "", standard, "drift", window=window.name)


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


def moving_parameters(scenario: Scenario) -> tuple[str, ...]:
    """Names of the parameters that are not the same in all windows."""
    return tuple(name for name, parameter in scenario.parameters.items() if parameter.moves)


def _initial_name(name: str, window: Window, windows: int) -> str:
    return name if windows == 1 else f"initial.{window.label}.{name.removeprefix('initial.')}"


# --- from theta to a window's own -----------------------------------------------------------------------------------


class Moves(NamedTuple):
    """What moves parameters in a window, term by term [t]: a number of theta times a score, or times a number."""

    parameter: IntArray
    """Which of the parameters that move."""
    factor: IntArray
    """Position in d of tau, or of the change in a year."""
    score: IntArray
    """And of xi; -1: none, as of a trend, or of a drift in a window that is not calibrated on."""
    by: FloatArray
    """Years over the parameter's slope; NaN of a drift."""

    def at(self, z: FloatArray, thetas: FloatArray) -> FloatArray:
        """How far each term moves its parameter [..., t] at z [..., d], which are thetas [..., d]; NaN: not known."""
        return np.asarray(thetas[..., self.factor] * self._times(z))

    def _times(self, z: FloatArray) -> FloatArray:
        return np.where(self.score >= 0, z[..., self.score], self.by)

    def derivative(self, z: FloatArray, prior: PriorTerms, parameters: int) -> FloatArray:
        """Of what moves each of so many parameters by z [d], [p, d]."""
        derivative, upper = np.zeros((parameters, len(z))), self.score >= 0
        np.add.at(derivative, (self.parameter, self.factor), prior.slope[self.factor] * self._times(z))
        np.add.at(derivative, (self.parameter[upper], self.score[upper]), prior.theta[self.factor[upper]])
        return derivative


@dataclass(frozen=True)
class Link:
    """Where the entries of a window's theta [q] come from among those [d] of a calibration."""

    columns: IntArray
    """[q] position of each; -1: none, as of the initial temperatures of a window that is not calibrated on."""
    moving: IntArray
    """[p] positions in q of the parameters that move,"""
    moves: Moves
    """and what moves them."""
    priors: Priors
    """[p] of the parameters that move: how theirs come from unconstrained values."""
    medians: FloatArray
    """[q] of the window's own priors: for what comes from nowhere."""

    def _moved(self, z: FloatArray, moves: FloatArray) -> FloatArray:
        """[..., p] z of the parameters that move, from that of all windows and what moves them [..., t]."""
        moved = np.array(z[..., self.columns[self.moving]])
        for k, parameter in enumerate(self.moves.parameter):
            moved[..., parameter] += moves[..., k]
        return moved

    def at(self, z: FloatArray, prior: PriorTerms) -> PriorTerms:
        """The window's theta [q] and its slopes by its own coordinates, at z [d] where the priors are `prior`."""
        theta, slope = prior.theta[self.columns], prior.slope[self.columns]
        if len(self.moving):
            moved = self.priors.at(self._moved(z, self.moves.at(z, prior.theta)))
            theta[self.moving], slope[self.moving] = moved.theta, moved.slope
        return PriorTerms(theta, slope, prior.log_density, prior.gradient)

    def coordinates(self, z: FloatArray, thetas: FloatArray) -> FloatArray:
        """The window's own coordinates [..., q] at z [..., d], which are thetas [..., d]."""
        inside = z[..., self.columns]
        inside[..., self.moving] = self._moved(z, self.moves.at(z, thetas))
        return inside

    def pull_back(self, z: FloatArray, prior: PriorTerms, inside_bar: FloatArray) -> FloatArray:
        """Cotangent of z [d] from that [q] of the window's own coordinates."""
        return np.asarray(inside_bar @ self.derivative(z, prior))

    def derivative(self, z: FloatArray, prior: PriorTerms) -> FloatArray:
        """Of the window's coordinates by z [d], [q, d]."""
        derivative = np.zeros((len(self.columns), len(z)))
        derivative[np.arange(len(self.columns)), self.columns] = 1.0
        derivative[self.moving] += self.moves.derivative(z, prior, len(self.moving))
        return derivative

    def thetas(self, thetas: FloatArray, priors: Priors, rng: np.random.Generator | None) -> FloatArray:
        """Thetas of the window [..., q] from those [..., d] of a calibration with `priors`.

        What comes from nowhere is at its median; a parameter that drifts is drawn anew around the common value where
        the window has no score (rng; None: it is the common value). A trend goes on.
        """
        inside = np.where(self.columns < 0, self.medians, thetas[..., self.columns])
        if len(self.moving):
            z = priors.to_z(thetas)
            moves = self.moves.at(z, thetas)
            for k in np.flatnonzero((self.moves.score < 0) & np.isnan(self.moves.by)):
                score = 0.0 if rng is None else rng.standard_normal(z.shape[:-1])
                moves[..., k] = thetas[..., self.moves.factor[k]] * score
            inside[..., self.moving] = self.priors.to_theta(self._moved(z, moves))
        return inside


def link(entries: Sequence[Entry], windows: Sequence[Window], window: Window) -> Link:
    """Where a window's theta comes from; it need not be one of `windows`, which are calibrated on."""
    place = {entry.name: k for k, entry in enumerate(entries)}
    among = any(each_window.name == window.name for each_window in windows)

    def column(name: str) -> int:
        if not name.startswith("initial."):
            return place.get(name, -1)
        return place.get(_initial_name(name, window, len(windows)), -1) if among else -1

    columns = np.array([column(name) for name in window.names], dtype=np.int64)
    moving = [name for name in moving_parameters(window.scenario) if not place.keys().isdisjoint(_factors(name))]
    positions = np.array([window.names.index(name) for name in moving], dtype=np.int64)
    years, terms = _years_after(windows, window), []
    for k, name in enumerate(moving):
        trend, drift = _factors(name)
        if trend in place:
            terms.append((k, place[trend], -1, years / _slope(entries[place[name]].prior)))
        if drift in place:
            terms.append((k, place[drift], place.get(f"{drift}.{window.label}", -1), np.nan))
    parameter, factor, score = np.array([term[:3] for term in terms], np.int64).reshape(-1, 3).T.copy()
    return Link(
        columns,
        positions,
        Moves(parameter, factor, score, np.array([term[3] for term in terms], float)),
        Priors(tuple(moving), tuple(entries[k].prior for k in columns[positions])),
        Priors(window.names, tuple(window.reads.values())).median(),
    )


def _slope(prior: Prior) -> float:
    """Of a parameter by its unconstrained value, at the prior's median."""
    priors = Priors(("",), (prior,))
    return float(priors.at(priors.to_z(priors.median())).slope[0])


def _factors(parameter: str) -> tuple[str, str]:
    """Names of the entries that say how fast and how far a parameter moves."""
    return f"trend.{parameter}", f"drift.{parameter}"


def _years_after(windows: Sequence[Window], window: Window) -> float:
    """Years from the mean of the middles of windows to the middle of another."""
    after = (middle_of([window]) - middle_of(windows)) / np.timedelta64(1, "ns") * 1e-9
    return float(after) / _YEAR


def middle_of(windows: Sequence[Window]) -> np.datetime64:
    """The mean of the middles of windows, UTC."""
    middles = [window.start + timespan(0.5 * window.duration) for window in windows]
    return np.datetime64(middles[0] + np.mean([middle - middles[0] for middle in middles]))
