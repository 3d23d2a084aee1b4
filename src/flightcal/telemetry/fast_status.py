"""Heaters that switch more often than their status is sampled: samples tell how long such a one is on, not when."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from .drivers import valid_samples

_LEAST = 8
"""Spells of a state, which tell how long it lasts."""
_OFTEN = 0.08
"""Share of its samples at which it changes: single samples that are wrong now and then are fewer."""
_SINGLE, _MANY_SINGLE, _CHANCE = 0.6, 0.4, 0.85
"""Share of spells that one sample alone shows, from which others are missed; and that from which they are where the
status changes from sample to sample by so much of what chance would have."""
_AROUND = (1.0, 2.0, 3.0, 2.0, 1.0)
"""Weights of a sample and its neighbours in what is smoothed."""


def is_blurred(dataset: xr.Dataset, channel: str) -> bool:
    """Whether samples of a status do not show when it switches.

    They do not where a state mostly lasts for one sample, for then it also lasts for none: of what happens between two
    samples nothing is known, whether they are the same or not.
    """
    values = dataset[channel].to_numpy()
    on = values[np.isfinite(values)] > 0.5
    edges = np.flatnonzero(np.diff(on)) + 1
    # The first and the last may be longer than what is seen of them.
    lengths, state = np.diff(edges), on[edges[:-1]]
    share = float(on.mean()) if len(on) else 0.0
    by_chance = 2.0 * share * (1.0 - share) * (len(on) - 1)
    needed = _MANY_SINGLE if len(edges) >= _CHANCE * by_chance else _SINGLE
    spells = [lengths[state], lengths[~state]]
    often = len(edges) >= _OFTEN * len(on)
    return often and any(len(spell) >= _LEAST and (spell == 1).mean() >= needed for spell in spells)


def smoothed(dataset: xr.Dataset, channel: str) -> NDArray[np.float64]:
    """[T] each valid sample of a channel as a mean of it and its neighbours, linear in between; ends go on.

    Raises TelemetryError where none is valid.
    """
    at, values, interval = valid_samples(dataset, channel)
    reach = 0.5 * len(_AROUND) * interval
    total, weights = np.zeros(len(values)), np.zeros(len(values))
    for away, weight in zip(range(-(len(_AROUND) // 2), len(_AROUND) // 2 + 1), _AROUND, strict=True):
        place = np.arange(len(values)) + away
        inside = np.clip(place, 0, len(values) - 1)
        near = weight * ((place == inside) & (np.abs(at[inside] - at) < reach))
        total += near * values[inside]
        weights += near
    seconds = dataset["time"].to_numpy().astype("datetime64[ns]").astype(np.int64) / 1e9
    return np.interp(seconds, at, total / weights)
