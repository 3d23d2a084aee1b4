"""All that a check has found, and how it is named and shown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...report import ParameterInfo
from ...words import number, unit
from ..centre import Centre
from ..heat import BesideHeat
from ..identifiability import Identifiability
from ..prior_predictive import PriorPredictive
from ..profile import Profile
from ..sensitivity import Sensitivity
from ..smoothness import Smoothness
from ..suspicion import Suspects


@dataclass(frozen=True)
class Checked:
    """All that a check has found of a problem."""

    infos: tuple[ParameterInfo, ...]
    """Of theta's entries, in its order."""
    suspects: Suspects
    centre: Centre
    identifiability: Identifiability
    heat: BesideHeat | None
    """None: the problem has no unmodelled heat."""
    predictive: PriorPredictive
    sensitivity: Sensitivity
    smoothness: Smoothness
    profiles: tuple[Profile, ...]
    starts: dict[str, np.datetime64]
    """Of each window by its label, UTC."""
    budget: str
    """What was spent, in words."""

    def info(self, name: str) -> ParameterInfo:
        """How a parameter is shown."""
        return next(info for info in self.infos if info.name == name)

    def named(self, name: str, window: str) -> str:
        """A channel or a heater in a window, which is named where there are several."""
        return name if len(self.starts) == 1 else f"{name} in '{window}'"

    def value(self, name: str, theta: float) -> str:
        """A value of a parameter with its unit, as it is shown."""
        info = self.info(name)
        return f"{number(theta + info.offset)} {unit(info.unit)}".strip()
