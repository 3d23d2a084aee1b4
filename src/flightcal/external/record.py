"""What one run of an external simulator gave, whether it finished or not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

if TYPE_CHECKING:  # the worker starts in a tenth of a second without it
    from ..simulator import FloatArray


FINISHED: Final = "finished"
Outcome = Literal[
    "finished",
    "crashed",
    "timed out",
    "not finite",
    "wrong shape",
    "wrong times",
    "partial output",
    "unreachable",
]


@dataclass(frozen=True)
class Record:
    """A run. What did not finish is data too: it is kept, counted and reported."""

    theta: FloatArray
    """[d] SI."""
    outcome: Outcome
    message: str
    """Why it did not finish; empty where it did."""
    attempts: int
    seconds: float
    """Of the last attempt."""
    temperatures: FloatArray
    """[T, N] K; NaN where the run did not finish."""
    status: FloatArray
    """[T, H] 0 or 1; NaN where it is not known."""
