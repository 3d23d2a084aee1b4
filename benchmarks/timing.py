"""Interleaved timing: the machine is noisy, so what is compared takes turns, A B C A B C ..."""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter, process_time
from typing import Any

import numpy as np

_SHORTEST = 5e-3  # s, of one measurement; faster functions are called several times in it


@dataclass(frozen=True)
class Timing:
    """Seconds of one call."""

    samples: tuple[float, ...]

    @property
    def median(self) -> float:
        """Median over the rounds."""
        return float(np.median(self.samples))

    @property
    def quartiles(self) -> tuple[float, float]:
        """The middle half of the rounds lies between."""
        low, high = np.quantile(self.samples, [0.25, 0.75])
        return float(low), float(high)

    def __str__(self) -> str:
        low, high = self.quartiles
        return f"{duration(self.median)} ({duration(low)} .. {duration(high)})"


def interleaved(functions: Mapping[str, Callable[[], Any]], rounds: int, *, budget: float = 60.0) -> dict[str, Timing]:
    """Time each function `rounds` times in turn; each has been called once before, so nothing is compiled in it.

    budget: s; after it no new round begins (three there are at least).
    """
    counts = {}
    for name, function in functions.items():
        function()
        begin = perf_counter()
        function()
        counts[name] = max(1, round(_SHORTEST / max(perf_counter() - begin, 1e-7)))
    samples: dict[str, list[float]] = {name: [] for name in functions}
    started = perf_counter()
    gc.collect()
    gc.disable()
    try:
        for finished in range(rounds):
            if finished >= 3 and perf_counter() - started > budget:
                break
            for name, function in functions.items():
                begin = perf_counter()
                for _ in range(counts[name]):
                    function()
                samples[name].append((perf_counter() - begin) / counts[name])
    finally:
        gc.enable()
    return {name: Timing(tuple(values)) for name, values in samples.items()}


def ratios(timings: Mapping[str, Timing], reference: str) -> dict[str, Timing]:
    """Each one's time over the reference's, round by round: what slows a whole round cancels."""
    base = np.array(timings[reference].samples)
    return {name: Timing(tuple(np.array(timing.samples) / base)) for name, timing in timings.items()}


def ratio_text(ratio: Timing) -> str:
    """Median and quartiles of a ratio."""
    low, high = ratio.quartiles
    return f"{ratio.median:.3g} ({low:.3g} .. {high:.3g})"


def duration(seconds: float) -> str:
    """Seconds in the unit that reads best."""
    for scale, unit in ((1.0, "s"), (1e3, "ms"), (1e6, "us")):
        if seconds * scale >= 1.0 or unit == "us":
            return f"{seconds * scale:.3g} {unit}"
    raise AssertionError


def exponent(sizes: Any, times: Any) -> float:
    """Slope of log time over log size by least squares."""
    return float(np.polyfit(np.log(np.asarray(sizes, float)), np.log(np.asarray(times, float)), 1)[0])


def larger_half(values: Any) -> Any:
    """The larger half of ascending sizes, or their times: at least three; what is constant hardly counts there."""
    return values[min(len(values) // 2, max(len(values) - 3, 0)) :]


def busy(function: Callable[[], Any]) -> tuple[Any, float, float]:
    """Result, wall time and processor time (s) of one call."""
    wall, processor = perf_counter(), process_time()
    result = function()
    return result, perf_counter() - wall, process_time() - processor
