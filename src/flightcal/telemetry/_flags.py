"""Why a sample is not used: one bit for each reason (flag masks and meanings of the CF conventions)."""

from __future__ import annotations

from enum import IntFlag

import numpy as np
from numpy.typing import NDArray


class Flag(IntFlag):
    """Reasons for which a sample is NaN; a sample that is used has none."""

    MISSING = 1
    """The file has nothing there."""
    INVALID_MARKER = 2
    """The file has one of the channel's `invalid` markers there."""
    OUT_OF_RANGE = 4
    """Outside `valid_range`, or below absolute zero."""
    STALE = 8
    """The ground system repeated the last row."""
    FEW_SAMPLES = 16
    """Block average: fewer than half of the block's samples can be used."""
    OTHER_PACKET = 32
    """Not wrong: the time is that of another packet, and the channel's own has no row there."""
    LEFT_OUT = 64
    """The scenario leaves the time out (`leave_out`)."""


SAMPLE_FLAGS = (Flag.MISSING, Flag.INVALID_MARKER, Flag.OUT_OF_RANGE, Flag.STALE, Flag.LEFT_OUT)
"""Flags that single samples of the file carry."""

Flags = NDArray[np.uint8]


def meaning(flag: Flag) -> str:
    """The flag's name in files and tables."""
    return str(flag.name).lower()


def flag_attributes() -> dict[str, object]:
    """CF attributes of the dataset's `flags` variable."""
    return {
        "long_name": "why a sample is not used",
        "flag_masks": np.array([flag.value for flag in Flag], dtype=np.uint8),
        "flag_meanings": " ".join(meaning(flag) for flag in Flag),
    }
