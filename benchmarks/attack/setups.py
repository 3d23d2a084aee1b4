"""`python -m benchmarks.attack.setups`: wrong set-ups of random satellites, and what is named first before sampling.

Each set-up spoils the scenario or the telemetry of a satellite of `benchmarks.truth` in one way. The twenty satellites
after them are as they should be: there nothing is to be named.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.truth.flight import KINDS, Flight, fly, written_to
from benchmarks.truth.satellites import START, WINDOWS
from flightcal.check import Suspects, suspects
from flightcal.errors import FlightcalError
from flightcal.problem import build_problem
from flightcal.telemetry import read

SEED = 7
_TRIED = 60
"""Satellites among which one is looked for that a set-up fits."""


@dataclass(frozen=True)
class Case:
    """A scenario as its file has it, and its telemetry."""

    written: dict[str, Any]
    table: pd.DataFrame
    flight: Flight
    other: Flight
    """Another satellite."""

    def copy(self) -> Case:
        return replace(self, written=deepcopy(self.written), table=self.table.copy())

    @property
    def model(self) -> dict[str, Any]:
        return dict(self.written["simulator"])

    @property
    def channels(self) -> list[str]:
        """Temperatures, that which varies most first."""
        names = [name for name in self.table if name.endswith("_temp")]
        return sorted(names, key=lambda name: -float(self.training[name].std()))

    @property
    def training(self) -> pd.DataFrame:
        times = pd.to_datetime(self.table["time"])
        first, length = (orbits * self.flight.satellite.period for orbits in WINDOWS["train"])
        seconds = (times - pd.Timestamp(START)).dt.total_seconds()
        return self.table[(seconds >= first) & (seconds < first + length)]

    @property
    def heaters(self) -> list[str]:
        """Those that switch in the training."""
        return [name for name in self.model["heaters"] if 0.1 < self.training[f"{name}_status"].mean() < 0.9]

    @property
    def eclipsed(self) -> bool:
        """Whether sunlight comes and goes: else no clock can be told by it."""
        return float(self.training[self.channels[0]].std()) > 2.0


@dataclass(frozen=True)
class SetUp:
    """One way to be wrong."""

    name: str
    kinds: tuple[str, ...]
    """Of suspicions that are right."""
    spoil: Callable[[Case], str]
    """Spoils a case in place, and says what it is about ("": anything)."""
    fits: Callable[[Case], bool] = lambda case: True


@dataclass(frozen=True)
class Result:
    """What was named first."""

    setup: str
    satellite: int
    named: str
    right: bool
    seconds: float


def _late(minutes: float) -> Callable[[Case], str]:
    def spoil(case: Case) -> str:
        times = pd.to_datetime(case.table["time"]) + pd.Timedelta(minutes=minutes)
        case.table["time"] = times.dt.strftime("%Y-%m-%dT%H:%M:%S")
        for window in case.written["windows"].values():
            if minutes > 0:
                window["start"] = str(np.datetime64(window["start"]) + np.timedelta64(int(60 * minutes), "s"))
        return ""

    return spoil


def _bias(kelvin: float, place: int) -> Callable[[Case], str]:
    def spoil(case: Case) -> str:
        channel = case.channels[place % len(case.channels)]
        case.table[channel] += kelvin
        return channel

    return spoil


def _swapped(case: Case) -> str:
    a, b = case.channels[0], case.channels[-1]
    case.table[[a, b]] = case.table[[b, a]].to_numpy()
    return f"{a} {b}"


def _converted(change: Callable[[Any], Any], place: int | None) -> Callable[[Case], str]:
    def spoil(case: Case) -> str:
        chosen = case.channels if place is None else [case.channels[place % len(case.channels)]]
        for channel in chosen:
            case.table[channel] = change(case.table[channel]).round(6)
        return chosen[0] if len(chosen) == 1 else ""

    return spoil


def _inverted(case: Case) -> str:
    name = f"{case.heaters[0]}_status"
    case.table[name] = 1.0 - case.table[name]
    return name


def _heater_missing(case: Case) -> str:
    return _without_heater(case, keep_status=False)


def _heater_missing_status_there(case: Case) -> str:
    return _without_heater(case, keep_status=True)


def _without_heater(case: Case, keep_status: bool) -> str:
    name = case.heaters[0]
    node = case.written["simulator"]["heaters"].pop(name)["node"]
    del case.written["observations"][f"{name}_status"]
    if not keep_status:
        del case.written["telemetry"]["channels"][f"{name}_status"]
    return str(node)


def _busy(case: Case) -> tuple[str, float]:
    """Node and power that the busy mode adds."""
    modes = case.model["modes"]
    node = next(name for name in modes["busy"] if name not in modes["idle"])
    return node, float(str(modes["busy"][node]).split()[0])


def _mode_missing(case: Case) -> str:
    node, _ = _busy(case)
    del case.written["simulator"]["modes"]["busy"][node]
    case.written["parameters"].pop("power_busy", None)
    return "busy"


def _mode_at_the_wrong_node(case: Case) -> str:
    node, _ = _busy(case)
    modes, other = case.written["simulator"]["modes"], _idle(case)[0]
    modes["busy"][other] = modes["busy"].pop(node)
    parameter = case.written["parameters"].get("power_busy")
    if parameter:
        parameter["sets"] = [f"modes.busy.{other}"]
    return "busy"


def _idle(case: Case) -> list[str]:
    """Nodes into which the payload gives no heat."""
    return [name for name in case.model["nodes"] if name not in case.model["modes"]["busy"]]


def _timeline_moved(case: Case) -> str:
    for change in case.written["simulator"]["timeline"]:
        change["at"] = str(np.datetime64(change["at"]) + np.timedelta64(1500, "s"))
    return ""


def _stuck(first: float) -> Callable[[Case], str]:
    def spoil(case: Case) -> str:
        channel, rows = case.channels[0], case.training.index
        begin = rows[int(first * len(rows))]
        case.table.loc[begin:, channel] = case.table.loc[begin, channel]
        return channel

    return spoil


def _repeating(case: Case) -> str:
    channel, rows = case.channels[0], case.training.index
    block = case.table.loc[rows[:37], channel].to_numpy()
    case.table.loc[rows, channel] = np.resize(block, len(rows))
    return channel


def _held(case: Case) -> str:
    channel = case.channels[0]
    case.table[channel] = case.table[channel].to_numpy()[np.arange(len(case.table)) // 12 * 12]
    return channel


def _spike(case: Case) -> str:
    channel, rows = case.channels[-1], case.training.index
    case.table.loc[rows[57], channel] += 40.0
    return channel


def _another_satellite(case: Case) -> str:
    names = [name for name in case.other.telemetry if name.endswith("_temp")]
    for k, channel in enumerate(case.channels):
        case.table[channel] = np.resize(case.other.telemetry[names[k % len(names)]], len(case.table))
    return ""


def _a_channel_of_another(case: Case) -> str:
    channel = case.channels[0]
    name = next(name for name in case.other.telemetry if name.endswith("_temp"))
    case.table[channel] = np.resize(case.other.telemetry[name], len(case.table))
    return channel


def _wrong_node(case: Case) -> str:
    channel = case.channels[0]
    own = case.written["observations"][channel]["node"]
    case.written["simulator"]["nodes"][own]["initial"] = f"{case.training[channel].iloc[0]:.2f} degC"
    case.written["observations"][channel]["node"] = next(
        item["node"] for name, item in case.written["observations"].items() if item.get("node") not in (None, own)
    )
    return channel


def _number(path: Callable[[Case], tuple[dict[str, Any], str, str]], factor: float) -> Callable[[Case], str]:
    def spoil(case: Case) -> str:
        block, key, name = path(case)
        value, unit = str(block[key]).split()
        block[key] = f"{float(value) * factor} {unit}"
        return name

    return spoil


def _certain(case: Case) -> list[str]:
    """Observed nodes whose capacity is no parameter."""
    known = {path for item in case.written["parameters"].values() for path in np.atleast_1d(item["sets"])}
    return [
        name
        for name in case.model["nodes"]
        if f"nodes.{name}.capacity" not in known and f"{name}_temp" in case.channels
    ]


def _capacity(case: Case) -> tuple[dict[str, Any], str, str]:
    node = _certain(case)[0]
    return case.model["nodes"][node], "capacity", f"nodes.{node}.capacity"


def _area(case: Case) -> tuple[dict[str, Any], str, str]:
    face = max(case.model["faces"], key=lambda name: float(case.model["faces"][name]["area"].split()[0]))
    return case.model["faces"][face], "area", f"faces.{face}.area"


def _attitude(case: Case) -> str:
    case.written["environment"]["attitude"] = (
        "nadir" if case.written["environment"]["attitude"] == "sun_pointing" else "sun_pointing"
    )
    return ""


def _ltan(case: Case) -> str:
    orbit = case.written["environment"]["orbit"]
    orbit["ltan"] = f"{(int(orbit['ltan'][:2]) + 6) % 24:02d}:30"
    return ""


def _statuses_swapped(case: Case) -> str:
    a, b = (f"{name}_status" for name in case.heaters[:2])
    case.table[[a, b]] = case.table[[b, a]].to_numpy()
    return f"{a} {b}"


def _status_late(case: Case) -> str:
    for name in case.heaters:
        case.table[f"{name}_status"] = np.roll(case.table[f"{name}_status"].to_numpy(), 12)
    return ""


def _channel_late(case: Case) -> str:
    channel = case.channels[0]
    case.table[channel] = np.roll(case.table[channel].to_numpy(), 15)
    return channel


def _heater_dead(case: Case) -> str:
    name = case.heaters[0]
    case.written["simulator"]["heaters"][name]["power"] = "200 W"
    return name


def _heater_at_the_wrong_node(case: Case) -> str:
    name = case.heaters[0]
    heater = case.written["simulator"]["heaters"][name]
    heater["node"] = next(node for node in case.model["nodes"] if node != heater["node"])
    return name


def _driver(factor: float) -> Callable[[Case], str]:
    """The payload's power measured, in another unit than the scenario says."""

    def spoil(case: Case) -> str:
        node, power = _busy(case)
        simulator = case.written["simulator"]
        del simulator["modes"]["busy"][node]
        case.written["parameters"].pop("power_busy", None)
        simulator["loads"] = {"payload": {"node": node, "driver": "payload_power", "coefficient": 1}}
        case.written["telemetry"]["channels"]["payload_power"] = {
            "column": "payload_power", "unit": "W", "kind": "driver",
        }  # fmt: skip
        times = case.table["time"].to_numpy().astype("datetime64[s]")
        changes = np.array([change["at"] for change in simulator["timeline"]], "datetime64[s]")
        busy = [simulator["timeline"][k]["mode"] == "busy" for k in np.searchsorted(changes, times, side="right") - 1]
        true = case.flight.truth.get("power_busy", power)
        case.table["payload_power"] = np.where(busy, true * factor, 0.0)
        return "payload_power"

    return spoil


def _fast(share: float) -> Callable[[Case], str]:
    """A clock that goes too fast from the first sample on."""

    def spoil(case: Case) -> str:
        times = pd.to_datetime(case.table["time"])
        late = pd.to_timedelta(((times - times.iloc[0]).dt.total_seconds() * share).round(), unit="s")
        case.table["time"] = (times + late).dt.strftime("%Y-%m-%dT%H:%M:%S")
        return ""

    return spoil


def _filled(case: Case) -> str:
    channel, rows = case.channels[0], case.training.index
    case.table.loc[np.random.default_rng(0).choice(rows, len(rows) // 20, replace=False), channel] = -60.0
    return channel


def _clipped(case: Case) -> str:
    channel = case.channels[0]
    low, high = case.training[channel].min(), case.training[channel].max()
    case.table[channel] = case.table[channel].clip(upper=round(0.6 * high + 0.4 * low, 2))
    return channel


def _drifting(case: Case) -> str:
    channel, rows = case.channels[0], case.training.index
    case.table[channel] += (8.0 * np.clip((case.table.index - rows[0]) / len(rows), 0.0, None)).round(2)
    return channel


def _status_off(case: Case) -> str:
    heater = case.heaters[0]
    case.table[f"{heater}_status"] = 0.0
    return heater


def _thresholds(case: Case) -> str:
    heater = case.written["simulator"]["heaters"][case.heaters[0]]
    for key in ("on_below", "off_above"):
        heater[key] = f"{float(heater[key].split()[0]) + 7.0:.1f} K"
    return case.heaters[0]


def _power(case: Case) -> tuple[dict[str, Any], str, str]:
    return case.model["heaters"][case.heaters[0]], "power", case.heaters[0]


def _orbit(change: Callable[[dict[str, Any]], dict[str, str]]) -> Callable[[Case], str]:
    def spoil(case: Case) -> str:
        orbit = case.written["environment"]["orbit"]
        orbit |= change(orbit)
        return ""

    return spoil


def _first(text: str) -> float:
    return float(text.split()[0])


def _outside(case: Case) -> str:
    """The face that matters most."""
    return max(case.model["faces"], key=lambda name: _first(case.model["faces"][name]["area"]))


def _face_turned(case: Case) -> str:
    face = case.written["simulator"]["faces"][_outside(case)]
    face["normal"] = [-x for x in face["normal"]]
    return _outside(case)


def _link(case: Case) -> dict[str, Any]:
    """The conductor that matters most."""
    return max(case.written["simulator"]["conductors"], key=lambda own: _first(own["conductance"]))


def _link_missing(case: Case) -> str:
    link = _link(case)
    case.written["simulator"]["conductors"].remove(link)
    between = "-".join(link["between"])
    case.written["parameters"].pop(f"link_{link['between'][0]}_{link['between'][1]}", None)
    return between


def _link_tenfold(case: Case) -> str:
    link = _link(case)
    link["conductance"] = f"{10.0 * _first(link['conductance']):.3f} W/K"
    case.written["parameters"].pop(f"link_{link['between'][0]}_{link['between'][1]}", None)
    return f"conductors.{'-'.join(link['between'])}.conductance"


def _uncertain_capacity(case: Case) -> list[str]:
    """Parameters that are capacities of observed nodes."""
    return [
        name
        for name in case.written["parameters"]
        if name.startswith("capacity_") and f"{name.removeprefix('capacity_')}_temp" in case.channels
    ]


def _prior_far_off(case: Case) -> str:
    name = _uncertain_capacity(case)[0]
    median = f"{2.5 * case.flight.truth[name]:.1f} J/K"
    case.written["parameters"][name]["prior"] = {"lognormal": {"median": median, "factor": 1.05}}
    return name


def _several(case: Case) -> bool:
    return len(case.channels) > 2


def _apart(case: Case) -> bool:
    means = [float(case.training[channel].mean()) for channel in case.channels]
    return len(case.channels) > 1 and abs(means[0] - means[-1]) > 3.0


def _strong_payload(case: Case) -> bool:
    node, power = _busy(case)
    return power > 0.25 * case.flight.flow[node] and f"{node}_temp" in case.channels


def _payload_elsewhere(case: Case) -> bool:
    return bool(_idle(case)) and _strong_payload(case)


_FAHRENHEIT: Callable[[Any], Any] = lambda x: 1.8 * x + 32.0  # noqa: E731
_KELVIN: Callable[[Any], Any] = lambda x: x + 273.15  # noqa: E731
_HEATED: Callable[[Case], bool] = lambda case: bool(case.heaters)  # noqa: E731
_LIT: Callable[[Case], bool] = lambda case: case.eclipsed  # noqa: E731
_CLOCK = ("clock",)

SETUPS = (
    SetUp("clock 20 min late", _CLOCK, _late(20.0), _LIT),
    SetUp("clock 1 h late", _CLOCK, _late(60.0), _LIT),
    SetUp("clock 10 min early", _CLOCK, _late(-10.0), _LIT),
    SetUp("bias of +8 K", ("bias",), _bias(8.0, 0), _several),
    SetUp("bias of -12 K", ("bias",), _bias(-12.0, 1), _several),
    SetUp("two channels swapped", ("swapped",), _swapped, _apart),
    SetUp("degF in one channel", ("unit",), _converted(_FAHRENHEIT, 0)),
    SetUp("degF in all channels", ("unit",), _converted(_FAHRENHEIT, None)),
    SetUp("kelvin in one channel", ("unit",), _converted(_KELVIN, 0)),
    SetUp("status inverted", ("status inverted",), _inverted, _HEATED),
    SetUp("heater missing", ("missing heat",), _heater_missing, _HEATED),
    SetUp("heater missing, its status there", ("missing heat",), _heater_missing_status_there, _HEATED),
    SetUp("mode without its power", ("mode",), _mode_missing, _strong_payload),
    SetUp("sensor stuck half way", ("stuck",), _stuck(0.5), _LIT),
    SetUp("sensor stuck throughout", ("stuck",), _stuck(0.0), _LIT),
    SetUp("sensor repeating", ("repeating",), _repeating, _LIT),
    SetUp("a spike", ("spike",), _spike),
    SetUp("another satellite", ("unrelated", "everything"), _another_satellite, _several),
    # Ten more of the same kind.
    SetUp("a channel of another satellite", ("unrelated",), _a_channel_of_another, _several),
    SetUp("a channel at the wrong node", ("other node",), _wrong_node, _apart),
    SetUp("sign of a channel", ("unit",), _converted(lambda x: -x, 0), _LIT),
    SetUp("driver in mW", ("driver",), _driver(1000.0), _strong_payload),
    SetUp("sign of a driver", ("driver",), _driver(-1.0), _strong_payload),
    SetUp("capacity ten times", ("number",), _number(_capacity, 10.0), lambda c: c.eclipsed and bool(_certain(c))),
    SetUp("area in the wrong unit", ("number",), _number(_area, 0.1), _LIT),
    SetUp("another attitude", ("attitude",), _attitude, _LIT),
    SetUp("another plane of the orbit", ("orbit",), _ltan, _LIT),
    SetUp("a heater of ten times the power", ("heater", "number"), _heater_dead, _HEATED),
    SetUp("a heater at the wrong node", ("heater",), _heater_at_the_wrong_node, _HEATED),
    SetUp("status of two heaters swapped", ("statuses swapped",), _statuses_swapped, lambda c: len(c.heaters) > 1),
    SetUp("status 12 min late", ("status clock",), _status_late, _HEATED),
    SetUp("one channel 15 min late", ("channel clock",), _channel_late, lambda c: c.eclipsed and _several(c)),
    SetUp(
        "a payload at the wrong node",
        ("mode",),
        _mode_at_the_wrong_node,
        lambda c: _strong_payload(c) and bool(_idle(c)),
    ),
    SetUp("timeline 25 min late", ("mode",), _timeline_moved, _strong_payload),
    # And some that others may make.
    SetUp("clock 5.5 h late", _CLOCK, _late(330.0), _LIT),
    SetUp("clock 4% fast", _CLOCK, _fast(0.04), _LIT),
    SetUp("-60 degC where nothing was read", ("filled",), _filled, _LIT),
    SetUp("a sensor at the end of its range", ("clipped",), _clipped, _LIT),
    SetUp("a channel that drifts", ("drift",), _drifting, _several),
    SetUp("a gain of 1.5", ("gain",), _converted(lambda x: 1.5 * x, 0), _LIT),
    SetUp("a heater of half the power", ("heater", "number"), _number(_power, 0.5), _HEATED),
    SetUp("a heater of twice the power", ("heater", "number"), _number(_power, 2.0), _HEATED),
    SetUp("thresholds 7 K higher", ("thresholds",), _thresholds, _HEATED),
    SetUp("status always off", ("thermostat", "missing heat"), _status_off, _HEATED),
    SetUp("capacity half", ("number",), _number(_capacity, 0.5), lambda c: c.eclipsed and bool(_certain(c))),
    SetUp("area twice", ("number",), _number(_area, 2.0), _LIT),
    SetUp("a face turned over", ("face",), _face_turned, _LIT),
    SetUp("a conductor missing", ("link",), _link_missing, lambda c: len(c.model["nodes"]) > 2),
    SetUp("a conductor of ten times", ("number",), _link_tenfold, _LIT),
    SetUp("a prior that is far off", ("prior",), _prior_far_off, lambda c: bool(_uncertain_capacity(c))),
    SetUp(
        "altitude half as much again",
        ("orbit",),
        _orbit(lambda o: {"altitude": f"{1.5 * _first(o['altitude'])} m"}),
        _LIT,
    ),
    SetUp(
        "inclination 40 deg off",
        ("orbit",),
        _orbit(lambda o: {"inclination": f"{_first(o['inclination']) - 40.0} deg"}),
        _LIT,
    ),
    SetUp("a sample held for 12", ("held", "repeating", "stuck"), _held, _LIT),
)


@cache
def flown(seed: int, number: int) -> Flight:
    """Satellite `number`, with heat that its scenario lacks in three of four."""
    with tempfile.TemporaryDirectory() as folder:
        return fly(seed, number, KINDS[number % len(KINDS)], Path(folder))


def case_of(seed: int, number: int) -> Case:
    """Satellite `number`, and the next one."""
    flight = flown(seed, number)
    return Case(dict(flight.satellite.written), flight.telemetry, flight, flown(seed, number + 1))


def looked_at(case: Case) -> Suspects:
    """What is suspected of a case, from its files. Raises FlightcalError."""
    with tempfile.TemporaryDirectory() as folder:
        case.table.to_csv(Path(folder) / "telemetry.csv", index=False)
        scenario = written_to(Path(folder), case.written)
        data = read(scenario)
        return suspects(build_problem(scenario, data), data)


def result(setup: SetUp | None, number: int, case: Case) -> Result:
    """What is named of a case with a set-up, or with none."""
    spoiled, about = case.copy(), ""
    if setup is not None:
        about = setup.spoil(spoiled)
    begin = time.perf_counter()
    try:
        found = looked_at(spoiled).found
        named, kind, whom = (found[0].title, found[0].kind, found[0].about) if found else ("nothing", "", "")
    except FlightcalError as error:
        named, kind, whom = f"error: {error}"[:100], "", ""
    right = not kind if setup is None else kind in setup.kinds and (not about or whom in about or about in whom)
    return Result(setup.name if setup else "correct", number, named, right, time.perf_counter() - begin)


def main() -> int:
    """Exit code 1 where fewer than 80% are named, or a correct satellite is suspected more than once in twenty."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.attack.setups", description=__doc__)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--correct", type=int, default=20, help="correct satellites")
    parser.add_argument("--only", nargs="*", default=[], help="set-ups whose name has one of these words")
    given = parser.parse_args()
    chosen = [own for own in SETUPS if not given.only or any(word in own.name for word in given.only)]
    results = []
    for place, setup in enumerate(chosen):
        for number in range(place, place + _TRIED):
            case = case_of(given.seed, number)
            if setup.fits(case):
                results.append(result(setup, number, case))
                _say(results[-1])
                break
    correct = [result(None, number, case_of(given.seed, 500 + number)) for number in range(given.correct)]
    for own in correct:
        _say(own)
    share = sum(own.right for own in results) / max(len(results), 1)
    cried = sum(not own.right for own in correct)
    print(f"named first: {share:.0%} of {len(results)}; suspected though correct: {cried} of {len(correct)}")
    return int(share < 0.8 or 20 * cried > len(correct))


def _say(own: Result) -> None:
    mark = "right" if own.right else "WRONG"
    print(f"{own.setup:34} {own.satellite:4d}  {mark:5}  {own.seconds:5.1f} s  {own.named}", flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
