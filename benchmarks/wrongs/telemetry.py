"""Set-ups whose telemetry is not what the scenario says: clocks, channels, units, status."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from .case import Case, SetUp, apart, busy, heated, is_busy, lit, several, strong_payload

_CLOCK = ("clock",)


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


def _driver(factor: float) -> Callable[[Case], str]:
    """The payload's power measured, in another unit than the scenario says."""

    def spoil(case: Case) -> str:
        node, power = busy(case)
        simulator = case.written["simulator"]
        del simulator["modes"]["busy"][node]
        case.written["parameters"].pop("power_busy", None)
        simulator["loads"] = {"payload": {"node": node, "driver": "payload_power", "coefficient": 1}}
        case.written["telemetry"]["channels"]["payload_power"] = {
            "column": "payload_power", "unit": "W", "kind": "driver",
        }  # fmt: skip
        true = case.flight.truth.get("power_busy", power)
        case.table["payload_power"] = np.where(is_busy(case), true * factor, 0.0)
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


def _late_and_biased(case: Case) -> str:
    _late(30.0)(case)
    _bias(10.0, 0)(case)
    return ""


def _half_repeated(case: Case) -> str:
    """The second half of the training is the first one again, in all columns but the time."""
    rows = case.training.index
    half, columns = len(rows) // 2, case.table.columns.drop("time")
    case.table.loc[rows[half : 2 * half], columns] = case.table.loc[rows[:half], columns].to_numpy()
    return ""


def _slow(case: Case) -> str:
    """A sensor that follows its node with a lag of 15 minutes."""
    channel = case.channels[0]
    values = case.table[channel].to_numpy()
    follows = np.empty(len(values))
    follows[0] = values[0]
    for k in range(1, len(values)):
        follows[k] = follows[k - 1] + (values[k] - follows[k - 1]) / 15.0
    case.table[channel] = follows.round(2)
    return channel


def _fahrenheit(x: Any) -> Any:
    return 1.8 * x + 32.0


def _kelvin(x: Any) -> Any:
    return x + 273.15


SETUPS = (
    SetUp("clock 20 min late", 0, _CLOCK, _late(20.0), lit),
    SetUp("clock 1 h late", 1, _CLOCK, _late(60.0), lit),
    SetUp("clock 10 min early", 2, _CLOCK, _late(-10.0), lit),
    SetUp("bias of +8 K", 3, ("bias",), _bias(8.0, 0), several),
    SetUp("bias of -12 K", 4, ("bias",), _bias(-12.0, 1), several),
    SetUp("two channels swapped", 5, ("swapped",), _swapped, apart),
    SetUp("degF in one channel", 6, ("unit",), _converted(_fahrenheit, 0)),
    SetUp("degF in all channels", 7, ("unit",), _converted(_fahrenheit, None)),
    SetUp("kelvin in one channel", 8, ("unit",), _converted(_kelvin, 0)),
    SetUp("status inverted", 9, ("status inverted",), _inverted, heated),
    SetUp("sensor stuck half way", 13, ("stuck",), _stuck(0.5), lit),
    SetUp("sensor stuck throughout", 14, ("stuck",), _stuck(0.0), lit),
    SetUp("sensor repeating", 15, ("repeating",), _repeating, lit),
    SetUp("a spike", 16, ("spike",), _spike),
    SetUp("another satellite", 17, ("unrelated", "everything"), _another_satellite, several),
    SetUp("a channel of another satellite", 18, ("unrelated",), _a_channel_of_another, several),
    SetUp("sign of a channel", 20, ("unit",), _converted(lambda x: -x, 0), lit),
    SetUp("driver in mW", 21, ("driver",), _driver(1000.0), strong_payload),
    SetUp("current for power, at 28 V", 73, ("driver",), _driver(1.0 / 28.0), strong_payload),
    SetUp("sign of a driver", 22, ("driver",), _driver(-1.0), strong_payload),
    SetUp("status of two heaters swapped", 29, ("statuses swapped",), _statuses_swapped, lambda c: len(c.heaters) > 1),
    SetUp("status 12 min late", 30, ("status clock",), _status_late, heated),
    SetUp("one channel 15 min late", 31, ("channel clock",), _channel_late, lambda c: lit(c) and several(c)),
    SetUp("clock 5.5 h late", 34, _CLOCK, _late(330.0), lit),
    SetUp("clock 4% fast", 35, _CLOCK, _fast(0.04), lit),
    SetUp("-60 degC where nothing was read", 36, ("filled",), _filled, lit),
    SetUp("a sensor at the end of its range", 37, ("clipped",), _clipped, lit),
    SetUp("a channel that drifts", 38, ("drift",), _drifting, several),
    SetUp("a gain of 1.5", 39, ("gain",), _converted(lambda x: 1.5 * x, 0), lit),
    SetUp("status always off", 43, ("thermostat", "missing heat"), _status_off, heated),
    SetUp("a sample held for 12", 52, ("held", "repeating", "stuck"), _held, lit),
    SetUp("30 min late, and a bias", 53, ("clock", "bias"), _late_and_biased, lambda c: lit(c) and several(c)),
    SetUp("half of all telemetry repeated", 54, ("repeating",), _half_repeated, lit),
    SetUp("a slow sensor", 55, ("slow",), _slow, lambda c: lit(c) and several(c)),
)
