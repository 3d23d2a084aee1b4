"""Set-ups whose telemetry was spoilt between the sensor and the file: curves, packets, merging, smoothing."""

from __future__ import annotations

import numpy as np
import pandas as pd

from .case import Case, SetUp, heated, is_busy, lit, several


def _smoothed(case: Case) -> str:
    """A centred mean over 21 min, as a ground system may take."""
    channel = case.channels[0]
    mean = case.table[channel].rolling(21, center=True, min_periods=1).mean()
    case.table[channel] = mean.round(2)
    return channel


def _curve(case: Case) -> str:
    """Another thermistor's curve: right in the middle, and off by 6 K at both ends."""
    channel = case.channels[0]
    low, high = case.training[channel].min(), case.training[channel].max()
    share = (case.table[channel] - 0.5 * (low + high)) / (0.5 * (high - low))
    case.table[channel] += (6.0 * share**2).round(2)
    return channel


def _from_25_degc(case: Case) -> str:
    """A thermistor with a larger B than its curve has: right at 25 degC alone."""
    channel = max(case.channels, key=lambda name: float(np.ptp(case.training[name])))
    case.table[channel] = (25.0 + 1.35 * (case.table[channel] - 25.0)).round(2)
    return channel


def _reference(case: Case) -> str:
    """All sensors are read beside a resistor that is off."""
    for channel in case.channels:
        case.table[channel] = (25.0 + 0.75 * (case.table[channel] - 25.0)).round(2)
    return "every temperature"


def _lines_between(case: Case) -> str:
    """An archive keeps one reading of 15, and fills in the rest."""
    places = np.arange(len(case.table))
    for channel in case.channels:
        case.table[channel] = np.interp(places, places[::15], case.table[channel].iloc[::15]).round(2)
    return case.channels[0]


def _bottom(case: Case) -> str:
    """Readings that end at the lowest number of the converter."""
    channel = case.channels[0]
    low, high = case.training[channel].min(), case.training[channel].max()
    case.table[channel] = case.table[channel].clip(lower=round(0.7 * low + 0.3 * high, 2))
    return channel


def _without_a_sign(case: Case) -> str:
    """Counts of a byte that are negative below the middle of the range are read without a sign."""
    channel = case.channels[0]
    low, high = case.training[channel].min(), case.training[channel].max()
    step = (high - low) / 60.0
    counts = ((case.table[channel] - 0.5 * (low + high)) / step).round()
    case.table[channel] = (counts.where(counts >= 0.0, counts + 256.0) * step + 0.5 * (low + high)).round(4)
    return channel


def _packets_swapped(case: Case) -> str:
    """Two packets of half an hour have each other's times."""
    rows, columns = case.training.index, case.table.columns.drop("time")
    first = rows[len(rows) // 5 :][:30]
    second = rows[3 * len(rows) // 5 :][:30]
    values = case.table[columns].copy()
    case.table.loc[first, columns] = values.loc[second].to_numpy()
    case.table.loc[second, columns] = values.loc[first].to_numpy()
    return ""


def _packets_reversed(case: Case) -> str:
    """Samples of each packet of 20 min stand in reversed order."""
    rows = np.arange(len(case.table))
    order = np.minimum(rows // 20 * 20 + 19 - rows % 20, len(rows) - 1)
    columns = case.table.columns.drop("time")
    case.table[columns] = case.table[columns].to_numpy()[order]
    return ""


def _packet_ends(case: Case) -> str:
    """A sample has the time at which its packet of 16 min ends: the first of each is kept."""
    late = pd.to_datetime(case.table["time"]) + pd.Timedelta(minutes=16)
    case.table["time"] = late.dt.strftime("%Y-%m-%dT%H:%M:%S")
    case.table.drop(index=case.table.index[case.table.index % 16 > 0], inplace=True)
    case.table.reset_index(drop=True, inplace=True)
    return ""


def _gap_closed(case: Case) -> str:
    """25 min in the middle of the training are lost, and later samples are tagged as if they followed at once."""
    rows, columns = case.training.index, case.table.columns.drop("time")
    middle = rows[len(rows) // 2]
    values = case.table[columns].to_numpy()
    case.table.loc[middle : len(case.table) - 26, columns] = values[middle + 25 :]
    return ""


def _half_of_another_date(case: Case) -> str:
    """The second half of the training is telemetry of another time, at another place of the orbit."""
    rows, columns = case.training.index, case.table.columns.drop("time")
    half = len(rows) // 2
    later = rows[half:] + round(4.3 * case.flight.satellite.period / 60.0)
    case.table.loc[rows[half:], columns] = case.table.loc[later, columns].to_numpy()
    return ""


def _multiplexed(case: Case) -> str:
    """Every seventh sample of a channel is another's."""
    a, b = case.channels[0], case.channels[-1]
    case.table.loc[::7, a] = case.table.loc[::7, b]
    return a


def _mean_of_two(case: Case) -> str:
    """A channel is the mean of two sensors, at two nodes."""
    a, b = case.channels[0], case.channels[-1]
    case.table[a] = (0.5 * (case.table[a] + case.table[b])).round(2)
    return a


def _status_of_another(case: Case) -> str:
    """One heater's status is written in two columns."""
    a, b = (f"{name}_status" for name in case.heaters[:2])
    case.table[a] = case.table[b]
    return " ".join([*case.heaters, *reversed(case.heaters)])


def _status_minutes_late(case: Case) -> str:
    for name in case.heaters:
        case.table[f"{name}_status"] = np.roll(case.table[f"{name}_status"].to_numpy(), 5)
    return ""


def _status_of_power(case: Case) -> str:
    """Status that is on whenever the payload is."""
    name = case.heaters[0]
    case.table[f"{name}_status"] = is_busy(case).astype(float)
    return name


def _two_heaters(case: Case) -> bool:
    return len(case.heaters) > 1


def _lit_and_several(case: Case) -> bool:
    return lit(case) and several(case)


SETUPS = (
    SetUp("a channel smoothed over 21 min", 60, ("slow",), _smoothed, _lit_and_several),
    SetUp("a thermistor of another curve", 61, ("curve",), _curve, _lit_and_several),
    SetUp("a thermistor right at 25 degC alone", 113, ("gain", "curve"), _from_25_degc, _lit_and_several),
    SetUp("a reference of all sensors that is off", 114, ("gain",), _reference, _lit_and_several),
    SetUp("an archive with lines between readings", 115, ("interpolated",), _lines_between, _lit_and_several),
    SetUp("a sensor at the bottom of its range", 62, ("clipped",), _bottom, lit),
    SetUp("a negative number read without a sign", 73, ("wrapped",), _without_a_sign, lit),
    SetUp("two packets with swapped times", 63, ("order",), _packets_swapped, lit),
    SetUp("packets in reversed order", 64, ("order",), _packets_reversed, lit),
    SetUp("times of the packets' ends", 65, ("clock",), _packet_ends, lit),
    SetUp("a gap closed", 66, ("order", "jump"), _gap_closed, lit),
    SetUp("half of another date", 67, ("order",), _half_of_another_date, lit),
    SetUp("every seventh sample another's", 68, ("spike", "unrelated"), _multiplexed, _lit_and_several),
    SetUp("the mean of two sensors", 69, ("between",), _mean_of_two, _lit_and_several),
    SetUp("status of another heater", 70, ("same status",), _status_of_another, _two_heaters),
    SetUp("status 5 min late", 71, ("status clock",), _status_minutes_late, heated),
    SetUp("status that is the payload's", 72, ("thermostat",), _status_of_power, heated),
)
