"""A simple way to be wrong, as what it would change, and the window with what acts on it otherwise."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any, Literal

import numpy as np
import xarray

from ...errors import FlightcalError
from ...problem import Window
from ...scenario import Attitude, Load, ModeChange, Scenario, load_driver
from ...simulator import FloatArray, SimulationFailure, build_network, divided, in_steps
from ...telemetry import driver_series, status_fraction
from ..compared_window import INFERRED
from ..evidence import AS_READ, Fit, Scale
from ..network_view import Memory, Moved, View
from ..sunlight import FINE, REACH

Kind = Literal[
    "clock", "status clock", "channel clock", "driver clock", "bias", "swapped", "unit", "other node", "unrelated",
    "doubled", "status inverted", "statuses swapped", "heater", "thresholds", "missing heat", "mode", "driver",
    "attitude", "orbit", "number", "link", "prior", "face", "gain", "drift", "curve", "slow", "between", "eclipse",
    "earlier mean", "thermostat", "constant heat", "exchanged",
]  # fmt: skip
_RARE: Mapping[Kind, float] = {
    "orbit": 3.0, "face": 3.0, "unit": 3.0, "channel clock": 3.0, "driver clock": 3.0, "slow": 3.0, "between": 3.0,
    "earlier mean": 3.0, "constant heat": 5.0, "exchanged": 5.0, "number": 5.0, "link": 5.0, "prior": 5.0,
    "unrelated": 10.0, "thresholds": 20.0, "thermostat": 30.0,
}  # fmt: skip
"""So many times as rare a kind is as a slip of the pen or a fault of a sensor or heater: judged, not counted.

A column, a status or a clock is got wrong by one slip, and sensors and heaters fail. A number is copied from a drawing
or a test, and is seldom off by any factor. Other kinds explain much and say little: a channel of no place at all,
thresholds that are not kept, a status that is of no use. What says what happened goes before them.
"""
SHIFT = 240.0
"""s, between the shifts of a clock that are tried first."""
SHIFTS = tuple(shift for k in range(1, round(REACH / SHIFT)) for shift in (-k * SHIFT, k * SHIFT))
NARROWER = 0.25
"""How much nearer to the best shift so far the next ones are looked for."""
FACTORS = (0.001, 0.01, 0.1, 10.0, 100.0, 1000.0)
"""By which a number is off that has the wrong unit or one digit too many."""
FEW_TIMES = (0.25, 0.5, 2.0, 4.0)
"""The same of a number that is of another thing, or of one of two."""
AROUND = tuple(float(2.0**more) for more in np.linspace(-0.4, 0.4, 7))
"""Times a number that is nearly right, those that are looked at more closely."""

LACKED = 0.2
"""Of what flows through a node, the least heat that it lacks which is worth a word."""
PIECES = 48
"""Of a window, each with heat of its own."""
POWER = 0.25
"""Share by which a power is off, from which it is worth a word."""
_STEPS, _SHORTEST, _LONGEST = 190, 30.0, 120.0
"""Of an orbit, and s that they last, of a simulation where shadows or modes begin at other times: the view's steps are
short where its own do, and a small node that meets the Sun in a long one is thrown far off."""
_NEARER = 0.7
"""Share of its misfit that a channel has left, as it was read, which another unit is worth a word of."""
_FIRST_STEPS = (2.0, 6.0, 14.0)
"""s, when the first ones end: where it is in the shadow then, a small node is far from what it starts at."""
_OF_SENSORS = 600.0
"""s, by which one sensor is behind the others: what is read in one row is seldom apart by more."""
_MANY_MINUTES = 9000.0
"""s, from which hours say it better."""


@dataclass(frozen=True)
class Words:
    """A wrong in words."""

    title: str
    sentence: str
    advice: str


@dataclass(frozen=True)
class Wrong:
    """One way to be wrong, and what telemetry, simulation or both would be without it."""

    kind: Kind
    about: str
    """What it is about: a channel, a heater, a node."""
    words: Words | Callable[[Fit], Words]
    observed: FloatArray | None = None
    """[t, N] K as the telemetry should be; None: as it is."""
    window: Window | None = None
    """As it should be simulated; None: as it is."""
    memory: Memory | None = None
    """With which a channel should be simulated; None: with none."""
    columns: FloatArray | None = None
    """[R, k] K, effects of unknown size that a simulation lacks."""
    widened: int | None = None
    """The entry whose prior is wider than written; the weight is then how far it is off, in deviations as written."""
    moved: Moved = ()
    """Entries whose priors should be for so many times the values that are written."""
    least: float = 0.0
    """Of the first column's weight: below, it is no wrong worth a word."""
    most: float = np.inf
    """Beyond, it is another wrong."""
    also: tuple[float, ...] = ()
    """The least of the weights of the columns after the first."""
    lacked: bool = False
    """Whether the first weight is of something that is not written: there is no less of it."""
    scale: Scale = AS_READ
    """What the telemetry was scaled by."""
    tries: float = 1.0
    """So many alternatives there are of the kind."""
    smoothed: float = 0.0
    """Nats that it gains by reading telemetry between its samples."""
    closer: Callable[[], Iterator[Wrong]] | None = None
    """The same with numbers near by."""

    def read(self, as_it_is: FloatArray) -> FloatArray:
        """Telemetry [t, N] without the wrong; where there was something and nothing is left, what is next to it."""
        if self.observed is None:
            return as_it_is
        found = self.observed.copy()
        for k in range(found.shape[1]):
            valid = np.isfinite(found[:, k])
            if valid.any() and not valid.all():
                found[:, k] = np.interp(np.arange(len(valid)), np.flatnonzero(valid), found[valid, k])
        return np.where(np.isfinite(as_it_is), found, np.nan)

    @property
    def is_smaller(self) -> bool:
        """Whether channels are read in a smaller unit."""
        return self.observed is not None and self.scale.factor < 1.0

    def leaves_less(self, left: FloatArray, before: FloatArray, observed: FloatArray) -> bool:
        """Whether channels in a smaller unit leave less of what they read: else they are only smaller.

        left, before: [t, N] K that a simulation leaves of telemetry without the wrong, and as it is, `observed`.
        """
        changed = np.any(np.abs(self.read(observed) - observed) > 0.0, axis=0)
        squares = np.nanmean(left[:, changed] ** 2) / self.scale.factor**2
        return bool(squares < _NEARER**2 * np.nanmean(before[:, changed] ** 2))

    def matters(self, fit: Fit) -> bool:
        """Whether its number is worth a word."""
        first = float(fit.added[0]) if self.least else 0.0
        others = all(abs(float(fit.added[1 + k])) >= least for k, least in enumerate(self.also))
        return others and self.least <= (first if self.lacked else abs(first)) <= self.most

    @property
    def odds(self) -> float:
        """Nats by which it is less likely than one thing alone, before the telemetry says anything; and `smoothed`."""
        return float(np.log(self.tries * _RARE.get(self.kind, 1.0))) + self.smoothed


def driven(
    view: View,
    scenario: Scenario | None = None,
    telemetry: xarray.Dataset | None = None,
    *,
    sunlight: float = 0.0,
    modes: float = 0.0,
    gaining: float = 0.0,
    timeline: Sequence[ModeChange] = (),
) -> Window:
    """The view's window with what acts on it by another scenario's faces, or another telemetry's status.

    sunlight, modes: s by which these come later in the telemetry's time; gaining: s of both in each s of the window;
    timeline: of modes, in the place of the scenario's. Raises TelemetryError.
    """
    drive, columns = view.network.drive, view.network.network.columns
    if scenario is not None or sunlight or modes or gaining or timeline:
        step = float(np.clip(view.window.period / _STEPS, _SHORTEST, _LONGEST))
        drive = divided(drive, np.append(_FIRST_STEPS, np.arange(step, drive.times[-1], step)))
    inputs, measured = drive.inputs.copy(), drive.measured
    if scenario is not None:
        shine(view, scenario, inputs, drive.times)
    elif sunlight or gaining:
        fine, lit = view.sunlight.before(sunlight)
        put(inputs, columns, fine * (1.0 + gaining) + sunlight, lit, drive.times)
    if modes or gaining or timeline:
        fine = np.arange(-FINE, drive.times[-1] + 2.0 * FINE, FINE)
        put(inputs, columns, fine, _modes(view, (fine - modes) / (1.0 + gaining), timeline), drive.times)
    if telemetry is not None:
        edges, measured = view.utc(drive.times), measured.copy()
        for k, heater in enumerate(view.window.scenario.network.switches.values()):
            if heater.measured_by:
                measured[:, k] = status_fraction(telemetry, heater.measured_by, edges)
    return view.simulated_by(drive=replace(drive, inputs=inputs, measured=measured))


def shine(view: View, scenario: Scenario, inputs: FloatArray, grid: FloatArray) -> None:
    """Put what shines on a scenario's faces into the inputs [K, 2, q] of a grid's steps. Raises OrbitError."""
    fine = np.union1d(view.sunlight.times(scenario, 0.0, grid[-1]), grid)
    put(inputs, view.network.network.columns, fine, view.sunlight.on_faces(scenario, fine), grid)


def brought(view: View, inputs: FloatArray) -> FloatArray:
    """[h, 2 K] W that inputs [K, 2, q] of steps bring to heated nodes, by what is known at the prior's median."""
    network = view.network.network
    series = dict(zip(network.columns, inputs.reshape(-1, inputs.shape[2]).T, strict=True))
    heat = np.zeros((len(network.heated), 2 * len(inputs)))
    for gain in view.heat.gains:
        heat[network.heated.index(view.heat.nodes[gain.node])] += gain.flow(series)
    return heat


def driven_otherwise(
    kind: Kind,
    about: str,
    words: Words,
    view: View,
    *,
    tries: float,
    closer: Callable[[], Iterator[Wrong]] | None = None,
    **how: Any,
) -> Iterator[Wrong]:
    """The wrong of what acts on the window; nothing where there is no such window. how: see `driven`."""
    try:
        window = driven(view, **how)
    except (FlightcalError, SimulationFailure, ValueError):
        return
    yield Wrong(kind, about, words, window=window, tries=tries, closer=closer)


def attitude_of(view: View) -> Attitude | None:
    """The scenario's attitude; None: no sunlight on faces depends on it."""
    scenario = view.window.scenario
    return scenario.environment.attitude if scenario.environment.orbit and scenario.network.faces else None


def elsewhere(view: View, **changes: Any) -> Scenario:
    """The scenario of a view with another orbit or attitude."""
    scenario = view.window.scenario
    return scenario.model_copy(update={"environment": scenario.environment.model_copy(update=changes)})


def at_node(view: View, kind: Literal["faces", "heaters", "loads"], name: str, node: str) -> Window:
    """The view's window with a block of its network in another node; what acts on it stays."""
    scenario = view.window.scenario
    blocks = getattr(scenario.network, kind)
    moved = {**blocks, name: blocks[name].model_copy(update={"node": node})}
    changed = scenario.model_copy(update={"simulator": scenario.network.model_copy(update={kind: moved})})
    network = build_network(changed, view.network.network.heated)
    return replace(view.simulated_by(network=network), scenario=changed)


def as_long(seconds: float) -> float:
    """Times that one sensor is so much later than others more seldom than a little, as if by a Cauchy distribution."""
    return 1.0 + (seconds / _OF_SENSORS) ** 2


def closer(shift: float, apart: float) -> FloatArray:
    """s, around a shift that is about right."""
    return shift + np.linspace(-1.0, 1.0, 13) * apart


def flow_through(view: View, node: str) -> float:
    """W through a node; 0: it holds no heat."""
    return float(view.heat.flow[view.heat.nodes.index(node)]) if node in view.heat.nodes else 0.0


def load_series(
    view: View,
    load: Load,
    channel: str,
    seconds: FloatArray,
    of: Callable[[FloatArray], FloatArray] = np.asarray,
) -> FloatArray:
    """[M] what a load makes of a driver's channel at seconds [M] of its time; outside of its samples it stays.

    of: what the driver is in the place of what it reads, SI. Raises TelemetryError.
    """
    written = view.window.scenario.telemetry.channels[channel]
    return load_driver(load, written)(of(driver_values(view, channel, seconds)))


def driver_values(view: View, channel: str, seconds: FloatArray) -> FloatArray:
    """[M] SI of a driver's channel at seconds [M]; outside of its samples it stays. Raises TelemetryError."""
    fill = view.window.scenario.telemetry.channels[channel].bridge
    times = view.telemetry["time"].to_numpy()[np.isfinite(view.telemetry[channel].to_numpy())]
    at = np.clip(view.utc(seconds), times[0], times[-1])
    return driver_series(view.telemetry, channel, at, fill=fill, period=view.window.period)


def put(
    inputs: FloatArray, columns: Sequence[str], seconds: FloatArray, series: Mapping[str, FloatArray], grid: FloatArray
) -> None:
    """Put series [M] at seconds [M] into the inputs [K, 2, q] of a grid's steps, in place."""
    known = [column for column in series if column in columns]
    if known:
        inside = (seconds >= grid[0]) & (seconds <= grid[-1])
        edges = np.union1d(seconds[inside], grid[[0, -1]])
        values = np.stack([np.interp(edges, seconds, series[column]) for column in known])
        inputs[:, :, [columns.index(column) for column in known]] = in_steps(edges, values, grid).transpose(2, 1, 0)


def _modes(view: View, seconds: FloatArray, timeline: Sequence[ModeChange]) -> dict[str, FloatArray]:
    """1 while in the mode, [M] by column; timeline: in the place of the scenario's."""
    model = view.window.scenario.network
    timeline = timeline or model.timeline
    if not timeline:
        return {}
    changes = np.array([change.at for change in timeline], "datetime64[ns]")
    active = [timeline[max(k - 1, 0)].mode for k in np.searchsorted(changes, view.utc(seconds), side="right")]
    return {f"mode.{mode}": np.array([float(mode == flag) for flag in active]) for mode in model.modes}


def status_channels(view: View) -> dict[str, str]:
    """Heater -> channel of its status, of those that drive the simulation."""
    heaters = view.window.scenario.network.switches
    known = {name: heater.measured_by or "" for name, heater in heaters.items()}
    measured = {name: c for name, c in known.items() if c and not c.startswith(INFERRED)}
    return {name: c for name, c in measured.items() if np.isfinite(view.telemetry[c].to_numpy()).any()}


def span_of(view: View) -> tuple[datetime, datetime]:
    """When the view's window begins and ends, UTC."""
    begin, end = (time.astype("datetime64[us]").item() for time in view.utc(view.network.drive.times[[0, -1]]))
    return begin, end


def minutes(seconds: float) -> str:
    """In minutes where that is enough; many half hours as hours."""
    if abs(seconds) >= _MANY_MINUTES and abs(seconds) % 1800.0 == 0.0:
        return f"{abs(seconds) / 3600.0:g} h"
    return f"{abs(seconds) / 60.0:.1f} min" if abs(seconds) >= 90.0 else f"{abs(seconds):.0f} s"


def off(late: float) -> str:
    """Late or early by how much (s), in words."""
    return f"{minutes(late)} {'late' if late > 0 else 'early'}"
