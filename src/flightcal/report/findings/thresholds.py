"""Do heaters switch at the temperatures that the scenario says?"""

from __future__ import annotations

import numpy as np

from ...words import number
from ..run_files import RunFiles
from .finding import CHECK, Finding

_BESIDE_THRESHOLDS = 1.0
"""K, by which a heater switches beside its thresholds, on and off alike, from which it is worth a word."""
_SURELY = 0.3
"""K, by which it does at least, on and off."""


def thresholds(run: RunFiles) -> list[Finding]:
    """Heaters that switch at other temperatures than the scenario says, by what their sensors' channels read."""
    known = next((dataset for dataset in run.windows.values() if "least_threshold_offset" in dataset), None)
    if known is None:
        return []
    beside = {
        str(name): float(off.mean())
        for name, off, least in zip(
            known["heater"].values,
            known["threshold_offset"].values.T,
            known["least_threshold_offset"].values.T,
            strict=True,
        )
        if abs(off.mean()) > _BESIDE_THRESHOLDS and off[0] * off[1] > 0.0 and np.abs(least).min() > _SURELY
    }
    if not beside:
        return []

    def said(name: str) -> str:
        off = beside[name]
        return f"{name} switches {number(abs(off), 2)} K {'above' if off > 0.0 else 'below'} its thresholds, or more"

    worst = max(beside, key=lambda name: abs(beside[name]))
    title = said(worst) + (f"; {len(beside) - 1} more are beside theirs" if len(beside) > 1 else "")
    text = (
        "So its measured switches show, beside what its sensor's channel reads. Its thresholds are others than the "
        "scenario says, or that channel reads beside its node's temperature by so much; predictions follow the "
        "channel."
    )
    details = tuple(f"{said(name)}." for name in beside)
    return [Finding("warn", title, text, details, tuple(f"the thresholds of {name}" for name in beside), CHECK)]
