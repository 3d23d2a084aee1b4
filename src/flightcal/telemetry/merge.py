"""Packets, each with stamps of its own, on one time axis."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from ._flags import SAMPLE_FLAGS, Flag, flag_attributes, meaning

_OF_ROWS = ("rows_read", "untimed", "duplicates", "conflicts", "conflict_times", "unsorted", "stale_checked")
"""Attributes that tell what was wrong with the rows of a packet."""


def merged(named: Mapping[str, xr.Dataset], channels: list[str]) -> xr.Dataset:
    """All channels, in this order, on the times of all packets.

    Each channel keeps its samples and their times. At the times of other packets it is NaN, with the flag
    `other_packet`. Attributes: counts are those of all packets together, the sampling interval is the shortest.
    `packets` (JSON) has the counts of each packet.
    """
    packets = list(named.values())
    if len(packets) == 1:
        return packets[0]
    times = np.unique(np.concatenate([packet["time"].to_numpy() for packet in packets]))
    place = {name: k for k, name in enumerate(channels)}
    averaged = any("masked" in packet for packet in packets)
    flags = np.full((len(times), len(channels)), Flag.OTHER_PACKET, dtype=np.uint8)
    rows = np.zeros(flags.shape, dtype=np.int64)
    masked = np.zeros((*flags.shape, len(SAMPLE_FLAGS)), dtype=np.uint32)
    variables: dict[str, Any] = dict.fromkeys(channels)
    for packet in packets:
        at = np.searchsorted(times, packet["time"].to_numpy())
        names = [str(name) for name in packet["channel"].to_numpy()]
        for name in names:
            values = np.full(len(times), np.nan)
            values[at] = packet[name].to_numpy()
            variables[name] = ("time", values, packet[name].attrs)
        cells = np.ix_(at, np.array([place[name] for name in names]))
        packet_flags = packet["flags"].to_numpy()
        flags[cells] = packet_flags
        if "masked" in packet:
            rows[cells], masked[cells] = packet["rows"].to_numpy(), packet["masked"].to_numpy()
        else:
            rows[cells] = 1
            masked[cells] = np.stack([packet_flags & flag != 0 for flag in SAMPLE_FLAGS], axis=-1)
    coordinates: dict[str, Any] = {"time": times, "channel": channels}
    variables["flags"] = (("time", "channel"), flags, flag_attributes())
    if averaged:
        example = next(packet for packet in packets if "masked" in packet)
        variables["rows"] = (("time", "channel"), rows, example["rows"].attrs)
        variables["masked"] = (("time", "channel", "finding"), masked, example["masked"].attrs)
        coordinates["finding"] = [meaning(flag) for flag in SAMPLE_FLAGS]
    dataset = xr.Dataset(variables, coordinates, _attributes({name: packet.attrs for name, packet in named.items()}))
    dataset["time"].encoding = dict(packets[0]["time"].encoding)
    return dataset


def _attributes(named: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    packets = list(named.values())
    found = {key: value for key, value in packets[0].items() if all(other.get(key) == value for other in packets)}
    for key in ("rows_read", "untimed", "duplicates", "conflicts", "unsorted"):
        found[key] = sum(packet[key] for packet in packets)
    found["sampling_interval_s"] = min(packet["sampling_interval_s"] for packet in packets)
    found["stale_checked"] = min(packet["stale_checked"] for packet in packets)
    found["files"] = "\n".join(dict.fromkeys(name for packet in packets for name in packet["files"].splitlines()))
    conflicts = [time for packet in packets for time in packet["conflict_times"].split()]
    found["conflict_times"] = " ".join(sorted(conflicts)[:10])
    found["packets"] = json.dumps(
        {name: {key: attributes[key] for key in _OF_ROWS} for name, attributes in named.items()}
    )
    return found
