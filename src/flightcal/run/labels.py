"""Units and long names of arrays, as attributes: what other tools write at the axes of a plot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import xarray

_COORDINATES: Final = {
    "time": "time, UTC",
    "channel": "temperature channel",
    "heater": "heater",
    "by": "method that the prediction is by",
    "parameter": "uncertain quantity",
    "chain": "chain of the sampler",
    "draw": "draw of a chain",
    "run": "run",
    "node": "node",
    "place": "place of the pattern, as a share of the orbit or of the driver's range",
    "window": "window to train on",
}
"""Coordinate -> what it is."""


def labelled(data: xarray.Dataset, words: Mapping[str, tuple[str, str]]) -> xarray.Dataset:
    """The dataset with `units` ("1": a plain number; none of text) and `long_name` at variables and coordinates.

    words: variable -> unit and long name; those that the dataset does not have are left out.
    """
    data = data.copy()
    for name, (unit, long_name) in words.items():
        if name in data:
            labels = {"long_name": long_name} | ({} if data[name].dtype.kind in "OSUM" else {"units": unit or "1"})
            data[name].attrs |= labels
    for name, long_name in _COORDINATES.items():
        if name in data.coords:
            data[name].attrs.setdefault("long_name", long_name)
    return data
