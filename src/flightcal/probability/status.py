"""Heater status as data: what the telemetry of a window says of the heaters, and how probable a simulation makes it.

In closed loop the simulated switches meet the measured status (see `kernels/switching.py`). In open loop, where the
measured status drives the heaters and the mode is sought, no thermostat acts; there its sensor should be at the
threshold when the heater is seen to switch, which is what makes uncertain thresholds observable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray

from ..scenario import (
    DutyCycle,
    Prior,
    Scenario,
    SimulatorModel,
    SwitchTimes,
    status_likelihoods,
    uncertain_thermostats,
)
from ..simulator import FloatArray, IntArray, Switch, Times, Trajectory
from ..telemetry import SHORT_GAP
from .kernels.switching import DutyCycles, StatusCall, StatusData, StatusSamples, status_work, switching
from .priors import Priors

_MARGIN = 3.0
"""Samples nearer to the window's ends than so many (median) timing errors are not used: whether a heater switches just
outside of the window is not simulated, and the likelihood would jump where a switch passes an end."""
THRESHOLD_ERROR = 0.3
"""K, standard deviation of a sensor around its threshold at a measured switch: only the search in open loop uses it."""


@dataclass(frozen=True)
class HeaterStatus:
    """The heaters' status in a window, of the channels that have a likelihood."""

    data: StatusData
    settings: FloatArray
    """[P] timing errors (s), error rates and standard deviations; NaN where inferred."""
    priors: dict[str, Prior]
    """Of those that are inferred, by their name in theta, ``timing.<channel>`` or ``error_rate.<channel>``."""

    @cached_property
    def inferred(self) -> IntArray:
        """Places of the inferred settings [.], in the order of `priors`."""
        return np.flatnonzero(np.isnan(self.settings))

    def log_likelihood(self, run: Trajectory, settings: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """Log likelihood of a simulation, and its derivatives by the switches' times [E] and by the settings [P].

        (-inf, ...) where more switches are uncertain at once than `kernels.switching.BAND`.
        """
        switches = run.switches
        work = status_work(self.data, len(settings), len(switches.time))
        work.settings[:] = settings
        switches_bar, value = np.empty(len(switches.time)), np.empty(1)
        heaters, count = np.asarray(switches.heater, np.int64), np.array([len(switches.time)])
        times, ons, status = (np.ascontiguousarray(part) for part in (switches.time, switches.on, run.status))
        switching(StatusCall(self.data, work, count, times, heaters, ons, status, switches_bar, value))
        return float(value[0]), switches_bar, work.settings_bar

    def information(self, run: Trajectory, settings: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rows [r, E] of which R^T R is the information on the switches' times, and that on each setting [P].

        A switch between samples that are an interval apart is known with the variance tau^2 + interval^2 / 12; what a
        Gauss-Newton step wants is this, not the curvature, which is nothing while it stays between them.
        """
        samples, duties = self.data.samples, self.data.duties
        times, heaters = run.switches.time, run.switches.heater
        rows, precision = [np.empty((0, len(times)))], np.zeros(len(settings))
        for c, heater in enumerate(samples.heater):
            here = samples.time[samples.first[c] : samples.first[c + 1]]
            place = samples.setting[c]
            tau, error = settings[place], settings[place + 1]
            first, last = (here[0], here[-1]) if len(here) else (0.0, 0.0)
            within = np.flatnonzero((heaters == heater) & (times > first) & (times < last))
            later = np.searchsorted(here, times[within])
            variance = tau**2 + (here[later] - here[later - 1]) ** 2 / 12.0
            rows.append(np.eye(len(times))[within] / np.sqrt(variance)[:, None])
            precision[place] += (2.0 * tau**2 / variance**2).sum()
            precision[place + 1] += len(here) / (error * (1.0 - error))
        for d, heater in enumerate(duties.heater):
            spans = range(duties.first[d], duties.first[d + 1])
            deviation = settings[duties.setting[d]]
            known = sum(duties.end[s] - duties.begin[s] for s in spans)
            inside = np.any([(duties.begin[s] <= times) & (times < duties.end[s]) for s in spans], axis=0)
            sign = np.where(run.switches.on > 0.5, -1.0, 1.0)  # a later "on" shortens the time
            rows.append((inside & (heaters == heater)) * (sign / (known * deviation))[None])
        return np.concatenate(rows), precision


def heater_status(scenario: Scenario, telemetry: xarray.Dataset, start: np.datetime64) -> HeaterStatus | None:
    """What a window's telemetry says of the heaters, with times from `start`; None: no channel has a likelihood."""
    forms = {
        name: (status_likelihood.switch_times or status_likelihood.duty_cycle, scenario.observations[name].heater)
        for name, status_likelihood in status_likelihoods(scenario).items()
    }
    if not forms:
        return None
    heaters = tuple(scenario.simulator.switches)
    settings: list[float] = []
    priors: dict[str, Prior] = {}
    samples: list[tuple[int, int, FloatArray, FloatArray]] = []
    duties: list[tuple[int, int, FloatArray, FloatArray, float]] = []
    ordered = sorted(forms.items(), key=lambda item: isinstance(item[1][0], DutyCycle))
    for name, (form, heater) in ordered:
        times, on = _samples(telemetry, name, start)
        place = heaters.index(heater or "")
        if isinstance(form, SwitchTimes):
            timing = form.timing
            margin = _MARGIN * (timing if isinstance(timing, float) else Priors((name,), (timing,)).median()[0])
            end = _seconds(telemetry["time"].values[-1:], start)[0] if telemetry.sizes["time"] else 0.0
            kept = (times >= margin) & (times <= end - margin)
            samples.append((place, len(settings), times[kept], on[kept]))
            for key in ("timing", "error_rate"):
                value = getattr(form, key)
                settings.append(value if isinstance(value, float) else np.nan)
                if not isinstance(value, float):
                    priors[f"{key}.{name}"] = value
        elif isinstance(form, DutyCycle):
            duties += [(place, len(settings), *stretch) for stretch in _stretches(times, on, form.over)]
            settings.append(form.standard_deviation)
    return HeaterStatus(StatusData(_status_samples(samples), _duty_cycles(duties)), np.array(settings), priors)


def measured_switches(scenario: Scenario, telemetry: xarray.Dataset, start: np.datetime64) -> Switch | None:
    """Where the measured status that drives heaters changes between two neighbouring samples, s from `start`.

    The time is halfway between the samples, as it is for the heater. None: in closed loop, and where it would say
    nothing new: thresholds are known, and no status has a likelihood.
    """
    model = scenario.simulator
    if not isinstance(model, SimulatorModel) or model.heater_input != "measured":
        return None
    if not uncertain_thermostats(scenario) and not status_likelihoods(scenario):
        return None
    found = []
    for heater, block in enumerate(model.switches.values()):
        if block.measured_by is None:
            continue
        times, on = _samples(telemetry, block.measured_by, start)
        gaps = np.diff(times)
        changed = (np.diff(on) != 0.0) & (gaps < 1.5 * np.median(gaps)) if len(gaps) else np.empty(0, bool)
        middle = times[:-1][changed] + 0.5 * gaps[changed]
        found.append(np.stack([middle, np.full(len(middle), heater), on[1:][changed]], axis=1))
    time, heaters, went_on = np.concatenate([np.empty((0, 3)), *found]).T
    return Switch(time, heaters.astype(np.int64), went_on)


def _samples(telemetry: xarray.Dataset, channel: str, start: np.datetime64) -> tuple[FloatArray, FloatArray]:
    """Times (s from `start`) of the valid samples of a status channel, and 0 or 1 there."""
    values = telemetry[channel].values
    valid = np.isfinite(values)
    return _seconds(telemetry["time"].values[valid], start), (values[valid] > 0.5).astype(float)


def _seconds(times: Times, start: np.datetime64) -> FloatArray:
    return (times - start) / np.timedelta64(1, "ns") * 1e-9


def _stretches(times: FloatArray, on: FloatArray, over: float | None) -> list[tuple[FloatArray, FloatArray, float]]:
    """Spans (begin and end, s) of each stretch in which the status is known, and its share of time on.

    A sample holds from halfway to its neighbours, and nothing is known in a long gap.
    """
    gaps = np.diff(times)
    known = np.flatnonzero(gaps <= SHORT_GAP * np.median(gaps)) if len(gaps) else np.empty(0, int)
    number = np.zeros(len(known)) if over is None else (times[known] + 0.5 * gaps[known]) // over
    stretches = []
    for k in np.unique(number):
        here = known[number == k]
        whole = np.split(here, np.flatnonzero(np.diff(here) > 1) + 1)
        share = float(np.average(0.5 * (on[here] + on[here + 1]), weights=gaps[here]))
        begin, end = (np.array([times[part[0]] for part in whole]), np.array([times[part[-1] + 1] for part in whole]))
        stretches.append((begin, end, share))
    return stretches


def _status_samples(channels: list[tuple[int, int, FloatArray, FloatArray]]) -> StatusSamples:
    heater, setting, times, on = zip(*channels, strict=True) if channels else ((), (), (), ())
    return StatusSamples(
        np.array(heater, np.int64), np.array(setting, np.int64), _firsts(times),
        np.concatenate([np.empty(0), *times]), np.concatenate([np.empty(0), *on]),
    )  # fmt: skip


def _duty_cycles(stretches: list[tuple[int, int, FloatArray, FloatArray, float]]) -> DutyCycles:
    heater, setting, begin, end, measured = zip(*stretches, strict=True) if stretches else ((), (), (), (), ())
    return DutyCycles(
        np.array(heater, np.int64), np.array(setting, np.int64), _firsts(begin),
        np.concatenate([np.empty(0), *begin]), np.concatenate([np.empty(0), *end]), np.array(measured, float),
    )  # fmt: skip


def _firsts(parts: Sequence[FloatArray]) -> IntArray:
    return np.cumsum([0, *map(len, parts)]).astype(np.int64)
