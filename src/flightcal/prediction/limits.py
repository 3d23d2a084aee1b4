"""How low and how high temperatures go in a planned window, and the chance that they pass what operations allow."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..run import read_tree
from ..scenario import ICE_POINT, Scenario
from ..simulator import FloatArray
from .metrics import STOCHASTIC, Metric

Limits = Mapping[str, tuple[float | None, float | None]]
"""Lowest and highest temperature that operations allow, K, by channel."""

MAY_BE, _LIKELY = 0.01, 0.5
"""Chances that a limit is passed, from which it may be and from which that is expected."""
_LOWER, _UPPER = "lower_limit", "upper_limit"


@dataclass(frozen=True)
class Extreme:
    """The lowest or the highest temperature of a channel in a window, K, without measurement noise."""

    window: str
    channel: str
    end: Literal["lowest", "highest"]
    median: float
    lower: float
    """Ends of its interval."""
    upper: float
    time: np.datetime64
    """UTC, when the predicted mean has it."""
    limit: float
    """NaN: there is none."""
    chance: float
    """Probability that the limit is passed; NaN without one."""
    draws: int
    """Simulations that tell the chance."""

    @property
    def beyond(self) -> str:
        """What passing the limit is."""
        return "below" if self.end == "lowest" else "above"

    @property
    def state(self) -> Literal["good", "warn", "bad"]:
        """Whether the limit is hardly passed, may be, or is expected to be."""
        return "bad" if self.chance > _LIKELY else "warn" if self.chance > MAY_BE else "good"

    @property
    def chance_in_words(self) -> str:
        """The chance in words, as finely as the simulations tell it."""
        least = 1.0 / self.draws
        if self.chance < least:
            return f"below {least:.1%}"
        return f"above {1.0 - least:.1%}" if self.chance > 1.0 - least else f"{self.chance:.1%}"

    def __str__(self) -> str:
        goes = f"{self.median - ICE_POINT:.1f} ({self.lower - ICE_POINT:.1f} to {self.upper - ICE_POINT:.1f})"
        return (
            f"{self.window}: {self.channel} {self.beyond} its limit of {self.limit - ICE_POINT:g} degC: chance "
            f"{self.chance_in_words}; {self.end} {goes} degC"
        )


def limits_of(scenario: Scenario) -> Limits:
    """The limits of a scenario's observed channels that have any."""
    channels = {name: scenario.telemetry.channels[name] for name in scenario.observations}
    return {name: channel.limits for name, channel in channels.items() if channel.limits is not None}


def with_limits(prediction: xr.Dataset, limits: Limits) -> xr.Dataset:
    """A window's prediction with the limits of its channels beside it, K; NaN where there is none."""
    bounds = [limits.get(str(name), (None, None)) for name in prediction["channel"].values]
    ends = np.array([[np.nan if value is None else value for value in pair] for pair in bounds]).reshape(-1, 2)
    return prediction.assign({_LOWER: ("channel", ends[:, 0]), _UPPER: ("channel", ends[:, 1])})


def to_come(times: NDArray[np.datetime64], observed: FloatArray) -> NDArray[np.bool_]:
    """[T] times of a plan of which there is no temperature yet. observed: [T, N] K."""
    known = times[np.isfinite(observed).any(axis=1)]
    return np.asarray(times > known[-1] if len(known) else np.ones(len(times), bool))


def is_plan(window: xr.Dataset) -> bool:
    """Whether nothing is measured in a window of prediction.nc, by which its prediction could be scored."""
    return not np.isfinite(window["observed"].values[window["scored"].values.astype(bool)]).any()


def extremes(window: xr.Dataset, name: str) -> Iterator[Extreme]:
    """The lowest and the highest temperature of each channel in what of a plan is still to come, with chances.

    window: a group of prediction.nc; of one that is no plan, or that has been flown, there are none.
    """
    if "planned" not in window.attrs or "lowest" not in window:
        return
    coming = to_come(window["time"].values, window["observed"].values)
    scored = window.isel(time=coming).sel({"by": STOCHASTIC})
    tails = [0.5 * (1.0 - window.attrs["interval"]), 0.5, 0.5 * (1.0 + window.attrs["interval"])]
    for channel in window["channel"].values:
        mean = scored["mean"].sel(channel=channel).values
        if not np.isfinite(mean).any():
            continue
        ends: tuple[tuple[Literal["lowest", "highest"], str, int], ...] = (
            ("lowest", _LOWER, int(np.nanargmin(mean))),
            ("highest", _UPPER, int(np.nanargmax(mean))),
        )
        for end, of_limit, at in ends:
            draws = window[end].sel(channel=channel).values
            limit = float(window[of_limit].sel(channel=channel)) if of_limit in window else np.nan
            passed = draws < limit if end == "lowest" else draws > limit
            lower, median, upper = np.quantile(draws, tails).tolist()
            chance = np.nan if np.isnan(limit) else float(passed.mean())
            time = scored["time"].values[at]
            yield Extreme(name, str(channel), end, median, lower, upper, time, limit, chance, len(draws))


def limit_scores(window: xr.Dataset, name: str) -> list[Metric]:
    """Chances that limits are passed in a plan; of any other window none."""
    told = [extreme for extreme in extremes(window, name) if not np.isnan(extreme.limit)]
    return [
        Metric(
            STOCHASTIC,
            name,
            extreme.channel,
            f"{extreme.beyond}_limit",
            extreme.chance,
            "1",
            f"limit {extreme.limit:g} K",
        )
        for extreme in told
    ]


def limits_told(windows: Mapping[str, xr.Dataset]) -> list[Extreme]:
    """Of groups of prediction.nc: extremes of plans whose channels have a limit there, the likeliest to pass first."""
    found = [extreme for name, window in windows.items() for extreme in extremes(window, name)]
    return sorted((extreme for extreme in found if not np.isnan(extreme.limit)), key=lambda extreme: -extreme.chance)


def read_limits_told(file: Path) -> list[Extreme]:
    """The same of the file; none where it is not there."""
    tree = read_tree(file).children if file.is_file() else {}
    return limits_told({str(name): group.to_dataset() for name, group in tree.items()})
