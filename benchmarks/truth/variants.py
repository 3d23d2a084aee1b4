"""Which models are measured, by what their scenarios say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from flightcal.scenario import Scenario

INDEPENDENT: dict[str, Any] = {"noise": {"model": "iid", "standard_deviation": {"half_normal": "2 K"}}}
if "heat" in Scenario.model_fields:
    INDEPENDENT["heat"] = "none"


@dataclass(frozen=True)
class Variant:
    """A model of what the simulator lacks, on satellites that have unmodelled heat or not."""

    written: dict[str, Any]
    """What its scenarios say besides."""
    missing: bool
    """Whether heat is missing in its scenarios."""

    @property
    def is_known(self) -> bool:
        """Whether this flightcal can calibrate it."""
        return set(self.written) <= set(Scenario.model_fields)


VARIANTS = {
    "iid": Variant(INDEPENDENT, True),
    "heat": Variant({"heat": {}}, True),
    "iid-nothing-missing": Variant(INDEPENDENT, False),
    "heat-nothing-missing": Variant({"heat": {}}, False),
}
