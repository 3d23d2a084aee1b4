"""Block averages: fewer, quieter samples."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..errors import TelemetryError
from ._flags import SAMPLE_FLAGS, Flag, flag_attributes, meaning
from ._values import Values
from .clean import sampling_interval

DENSE = 5.0
"""s between samples, below which means over `ENOUGH` s tell as much of temperatures that change in minutes."""
ENOUGH = 20.0
"""s"""
_MANY_APART, _TIMES_AS_MANY = 6000, 3.0
"""Times of all packets from which means are worth what they blur, if these are so many times those of one channel."""
_LENGTHS, _SAMPLES = (60.0, 120.0, 300.0, 600.0, 1200.0, 1800.0, 3600.0), 2.0
"""s; and how many samples of the slowest channel are in one."""
MANY, LONG = 3000, 60.0
"""Samples of a channel from which means over so many seconds are worth what they blur, for time grows with them."""


def dense_channels(dataset: xr.Dataset, below: float = DENSE) -> dict[str, float]:
    """Temperature channel -> usual interval between its samples, of those in which it is less than `below` seconds."""
    found, times = {}, dataset["time"].to_numpy().astype(np.int64)
    for name in dataset["channel"].to_numpy().tolist():
        if dataset[name].attrs["kind"] == "temperature":
            interval = sampling_interval(times[np.isfinite(dataset[name].to_numpy())])
            if interval < below:
                found[name] = interval
    return found


def length_in_common(dataset: xr.Dataset, times: int) -> float | None:
    """Seconds over which means of packets, each with times of its own, have few times in common; null: not needed.

    times: in the windows to train on.
    """
    if "packets" not in dataset.attrs or times < _MANY_APART:
        return None
    stamps = dataset["time"].to_numpy().astype(np.int64)
    of_temperature = [name for name in dataset["channel"].to_numpy() if dataset[name].attrs["kind"] == "temperature"]
    valid = [stamps[np.isfinite(dataset[name].to_numpy())] for name in of_temperature]
    slowest = max(map(sampling_interval, valid), default=np.nan)
    enough = [length for length in _LENGTHS if length >= _SAMPLES * slowest]
    return enough[0] if enough and len(stamps) > _TIMES_AS_MANY * max(map(len, valid)) else None


def average(dataset: xr.Dataset, length: float, *, beside_others: bool = False) -> xr.Dataset:
    """Means over blocks of `length` seconds, each at the mean time of its rows; only blocks that hold rows.

    beside_others: packets that are averaged in the same blocks are to have their times in common. Where a block has
    rows on both sides of its middle, its means are moved there, along the line that fits the block's samples best.

    Blocks start at whole multiples of `length` since 1970; the time counts rows that hold a sample, where any does.
    Temperatures and drivers: mean of the valid samples; status: the majority, a tie is on. A block with fewer than half
    of the samples that the channel's own sampling gives is NaN and flagged `few_samples`, together with the flags of
    the samples lost; a block that is used has no flag.

    Adds `rows` [time, channel], the rows of the file in each block, and `masked` [time, channel, finding], how many of
    them each finding took away. Raises TelemetryError when `length` is shorter than the sampling interval.
    """
    interval = dataset.attrs["sampling_interval_s"]
    if length < 0.999 * interval:
        files = dataset.attrs["files"].replace("\n", ", ")
        wanted = f"expected at least its sampling interval of {interval:g} s"
        raise TelemetryError(f"{files}: found 'average: {length:g} s', {wanted}")
    times = dataset["time"].to_numpy().astype(np.int64)
    span = round(length * 1e9)
    blocks, block = np.unique(times // span, return_inverse=True)
    flags = dataset["flags"].to_numpy()
    counts = np.any([dataset[name].notnull() for name in dataset["channel"].to_numpy()], axis=0)
    centres = _mean_times(times, counts, block, blocks * span)
    middles = blocks * span + span // 2
    sides = (times <= middles[block], times >= middles[block])
    around = np.all([_hold(counts & side, block, len(blocks)) for side in sides], axis=0)
    moved = around & beside_others
    variables: dict[str, tuple] = {}
    block_flags = np.zeros((len(blocks), flags.shape[1]), dtype=np.uint8)
    masked = np.zeros((*block_flags.shape, len(SAMPLE_FLAGS)), dtype=np.uint32)
    for i, name in enumerate(dataset["channel"].to_numpy()):
        channel = dataset[name]
        mean, samples = _block_mean(channel.to_numpy(), block, len(blocks))
        sampled_every = sampling_interval(times[flags[:, i] & Flag.MISSING == 0])
        expected = length / (interval if np.isnan(sampled_every) else sampled_every)
        few = samples < 0.5 * max(expected, 1.0)
        if channel.attrs["kind"] == "status":
            mean = np.where(np.isnan(mean), np.nan, mean >= 0.5)
        elif moved.any():
            away = np.asarray((times - middles[block]) * 1e-9, float)
            mean = np.where(moved, _at_zero(away, channel.to_numpy(), block, mean), mean)
        variables[name] = ("time", np.where(few, np.nan, mean), channel.attrs | {"averaged": 1})
        for j, flag in enumerate(SAMPLE_FLAGS):
            masked[:, i, j] = np.bincount(block, weights=flags[:, i] & flag != 0, minlength=len(blocks))
            block_flags[few & (masked[:, i, j] > 0), i] |= np.uint8(flag)
        block_flags[few, i] |= np.uint8(Flag.FEW_SAMPLES)
    variables["flags"] = (("time", "channel"), block_flags, flag_attributes())
    rows = np.repeat(np.bincount(block)[:, np.newaxis], flags.shape[1], axis=1)
    variables["rows"] = (("time", "channel"), rows, {"long_name": "rows of the file in the block"})
    variables["masked"] = (
        ("time", "channel", "finding"),
        masked,
        {"long_name": "rows that the finding took away"},
    )
    coordinates = {
        "time": np.where(moved, middles, centres).astype("datetime64[ns]"),
        "channel": dataset["channel"].to_numpy(),
        "finding": [meaning(flag) for flag in SAMPLE_FLAGS],
    }
    attributes = dataset.attrs | {"average_s": float(length), "sampling_interval_s": float(length)}
    averaged = xr.Dataset(variables, coordinates, attributes)
    averaged["time"].encoding = dict(dataset["time"].encoding)
    return averaged


def _mean_times(
    times: NDArray[np.int64], counts: NDArray[np.bool_], block: NDArray[np.intp], starts: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Mean times [B] of the rows [N] that count, or of all where none does, in blocks that start at times [B]; ns."""
    some = _hold(counts, block, len(starts))
    after = np.where(counts | ~some[block], times - starts[block], np.nan)
    mean, _ = _block_mean(after, block, len(starts))
    return np.asarray(starts + mean.round().astype(np.int64))


def _hold(rows: NDArray[np.bool_], block: NDArray[np.intp], blocks: int) -> NDArray[np.bool_]:
    """Which blocks [B] hold some of the rows [N]."""
    return np.bincount(block[rows], minlength=blocks) > 0


def _at_zero(x: Values, values: Values, block: NDArray[np.intp], mean: Values) -> Values:
    """The value at zero [B] of the line through the valid samples [N] of each block; its mean where it has one time."""
    x = np.asarray(np.where(np.isnan(values), np.nan, x))
    centre, _ = _block_mean(x, block, len(mean))
    spread, _ = _block_mean((x - centre[block]) ** 2, block, len(mean))
    together, _ = _block_mean((x - centre[block]) * (values - mean[block]), block, len(mean))
    return mean - centre * np.divide(together, spread, out=np.zeros(len(mean)), where=spread > 0)


def _block_mean(values: Values, block: NDArray[np.intp], blocks: int) -> tuple[Values, NDArray[np.int64]]:
    """Mean [B] of the valid samples and their number [B]."""
    valid = ~np.isnan(values)
    samples = np.bincount(block[valid], minlength=blocks)
    total = np.bincount(block[valid], weights=values[valid], minlength=blocks)
    return np.divide(total, samples, out=np.full(blocks, np.nan), where=samples > 0), samples
