"""Where a backtest stands: the origins, what is trained on before each and predicted after it."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import xarray
from numpy.typing import NDArray

from ..environment import as_datetime, orbital_period, timespan
from ..errors import RunError, TelemetryError
from ..scenario import Scenario, SimulatorModel, Window, to_si
from ..simulator import FloatArray
from ..telemetry import driver_series, end_of_telemetry, measured_inputs, usual_interval, window_bounds

AHEAD: Final = "ahead"
"""Window that begins at an origin."""

_FEWEST: Final = 0.5
"""Share of the usual number of samples that a stretch must have."""
_CANDIDATES: Final = 100
_PARTS: Final = 24
"""Of an orbit, by which a prediction is made shorter."""
_HORIZONS: Final = 4.0
"""Training lengths that are predicted by default."""
_LONGEST: Final = 1e9
"""s, of what a user may ask for: some thirty years."""

Times = NDArray[np.datetime64]


@dataclass(frozen=True)
class Origin:
    """Training from `start` to `time`, prediction from there to `end`; datetime64[ns], UTC."""

    start: np.datetime64
    time: np.datetime64
    end: np.datetime64

    @property
    def label(self) -> str:
        """For names of files and groups."""
        return "origin_" + str(self.time.astype("datetime64[s]")).replace(":", "").replace("-", "")

    def scenario(self, whole: Scenario) -> Scenario:
        """The scenario with two windows: `train`, and `AHEAD` for what follows."""
        spans = {"train": (self.start, self.time), AHEAD: (self.time, self.end)}
        windows = {name: Window(start=as_datetime(start), end=as_datetime(end)) for name, (start, end) in spans.items()}
        return whole.model_copy(update={"windows": windows})


@dataclass(frozen=True)
class Plan:
    """The origins of a backtest."""

    origins: tuple[Origin, ...]
    train: float
    """Length of the training, s."""
    horizon: float
    """The longest prediction, s."""
    period: float
    """Of the orbit, s."""
    measured: tuple[str, ...]
    """Channels that drive the simulator as they were measured after the origin too; without any it is a plan that
    drives it, as in a forecast."""
    skipped: tuple[str, ...]
    """Stretches in which no origin can stand, with the reason."""


def plan_origins(
    scenario: Scenario,
    telemetry: xarray.Dataset,
    count: int,
    *,
    train: float | None = None,
    horizon: float | None = None,
) -> Plan:
    """So many origins, spread evenly over the telemetry where there can be one.

    There, training and the orbit after it have half as many samples as such stretches have on average, or more, and all
    measured drivers can be bridged. Where samples come in passes alone, an orbit without a pass has none.
    train: length of the training, s; default: that of the scenario's training windows together. horizon: s; default:
    four times as long. A prediction ends there, at the telemetry's end, or where a driver has a gap that cannot be
    bridged. Raises RunError where no origin can stand, or fewer samples than one prediction needs.
    """
    period = orbital_period(scenario.environment, scenario.folder)
    train = _trained(scenario, period) if train is None else train
    horizon = _HORIZONS * train if horizon is None else horizon
    if horizon < period:
        raise RunError(f"--horizon: found {horizon / period:.3g} orbits, expected one or more")
    channels = [name for name, item in scenario.observations.items() if item.heater is None]
    present = np.logical_or.reduce([np.isfinite(telemetry[name].values) for name in channels])
    times = telemetry["time"].values[present]
    spacing = usual_interval(times) if len(times) > 1 else float(telemetry.attrs["sampling_interval_s"])
    drivers = measured_drivers(scenario)
    # s for each sample, gaps and times between passes included.
    usual = spacing if len(times) < 2 else float((times[-1] - times[0]) / np.timedelta64(1, "s")) / (len(times) - 1)

    def reason(at: np.datetime64) -> str:
        """Why there can be no origin; "": there can."""
        for words, begin, end in (("training before", -train, 0.0), ("orbit after", 0.0, period)):
            inside = (times >= at + timespan(begin)) & (times < at + timespan(end))
            if inside.sum() * usual < _FEWEST * (end - begin):
                return f"the {words} has less than half as many samples as usual"
            if not _bridged(scenario, telemetry, drivers, at + timespan(begin), at + timespan(end), period):
                return f"a measured driver has a gap in the {words} that cannot be bridged"
        return ""

    last = min(times[-1] + timespan(spacing), end_of_telemetry(telemetry))
    first, latest = times[0] + timespan(train - spacing), last - timespan(period)
    if latest < first:
        found = (times[-1] - times[0]) / np.timedelta64(1, "s") / period
        raise RunError(
            f"backtest: found telemetry of {found:.3g} orbits, expected {train / period:.3g} to train on and one more; "
            "a shorter --train needs less"
        )
    evenly = first + _spans(np.linspace(0.0, (latest - first) / np.timedelta64(1, "s"), _CANDIDATES))
    tried = times[np.unique(np.minimum(np.searchsorted(times, evenly), len(times) - 1))]
    reasons = [reason(at) for at in tried]
    usable = tried[[not why for why in reasons]]
    if not len(usable):
        found = "; ".join(dict.fromkeys(reasons))
        raise RunError(f"backtest: no origin can stand in this telemetry ({found}); a shorter --train needs less")
    chosen = usable[np.unique(np.linspace(0, len(usable) - 1, count).round().astype(int))]
    origins = []
    for at in chosen:
        end = min(at + timespan(horizon), last)
        # Shorter where a driver ends: the first orbit is known to be there.
        while not _bridged(scenario, telemetry, drivers, at, end, period):
            end -= timespan(period / _PARTS)
        origins.append(Origin(max(at - timespan(train), times[0]), at, end))
    return Plan(tuple(origins), train, horizon, period, drivers, _stretches(tried, reasons))


def measured_drivers(scenario: Scenario) -> tuple[str, ...]:
    """Channels that a simulation of the scenario takes as they were measured."""
    model, found = scenario.simulator, list(measured_inputs(scenario))
    if isinstance(model, SimulatorModel) and model.heater_input == "measured":
        found += [heater.measured_by for heater in model.switches.values() if heater.measured_by is not None]
    return tuple(dict.fromkeys(found))


def read_length(text: str, period: float, option: str) -> float:
    """A length of time as a user writes it, such as ``2 orbits`` or ``3 h``, in s. Raises RunError."""
    number, _, unit = text.strip().partition(" ")
    try:
        length = float(number) * period if unit.strip() in ("orbit", "orbits") else to_si(text, "s")
    except ValueError:
        length = math.nan
    if not 0 < length <= _LONGEST:
        raise RunError(f"{option}: found '{text}', expected a length of time such as '2 orbits' or '3 h'")
    return length


def _trained(scenario: Scenario, period: float) -> float:
    bounds = [window_bounds(scenario.windows[name], period) for name in scenario.train_windows]
    return float(sum((end - start) / np.timedelta64(1, "s") for start, end in bounds))


def _bridged(
    scenario: Scenario,
    telemetry: xarray.Dataset,
    drivers: tuple[str, ...],
    start: np.datetime64,
    end: np.datetime64,
    period: float,
) -> bool:
    """Whether all drivers of temperatures and loads are known from start to end."""
    spacing = 2.0 * float(telemetry.attrs["sampling_interval_s"])
    seconds = np.arange(0.0, (end - start) / np.timedelta64(1, "s"), spacing)
    times = start + _spans(seconds)
    for name in drivers:
        channel = scenario.telemetry.channels[name]
        if channel.kind == "status":
            continue  # where it is unknown thermostats act
        fill: Any = "interpolate" if channel.kind == "temperature" else channel.bridge
        try:
            driver_series(telemetry, name, times, fill=fill, period=period)
        except TelemetryError:
            return False
    return True


def _stretches(tried: Times, reasons: list[str]) -> tuple[str, ...]:
    """What was skipped, in words, one line for neighbours of the same reason."""
    lines = []
    for why, group in itertools.groupby(zip(tried, reasons, strict=True), key=lambda pair: pair[1]):
        moments = [str(at.astype("datetime64[m]")).replace("T", " ") for at, _ in group]
        if why:
            lines.append(f"{moments[0]} to {moments[-1]}: {why}")
    return tuple(lines)


def _spans(seconds: FloatArray) -> NDArray[np.timedelta64]:
    return np.round(seconds * 1e9).astype("timedelta64[ns]")
