"""The report's panels. A panel is a file with `panel(run)`: its figure, its table and its words, or None."""

from __future__ import annotations

from importlib import import_module

from ..block import Section
from ..run_files import RunFiles

ORDER = (
    "scores",
    "before",
    "genetic",
    "densities",
    "prediction",
    "parameters",
    "pairs",
    "convergence",
    "emulator",
    "full_simulator",
    "heat",
    "discrepancy",
    "residuals",
    "reliability",
    "heaters",
    "telemetry",
    "provenance",
)


def panels(run: RunFiles) -> list[Section]:
    """The sections of a run's report after the verdict, in order."""
    found: list[Section | None] = [import_module(f".{name}", __name__).panel(run) for name in ORDER]
    return [section for section in found if section is not None]
