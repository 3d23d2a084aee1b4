"""The report's panels. A panel is a file with `panel(run)`: its figure, its table and its words, or None."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Final

from ..block import Part, Section
from ..run_files import RunFiles

FIRST: Final = ("calibrated", "picture", "duty", "plans")
"""What stands under the verdict."""

PARTS: Final = (
    (
        "trust",
        "Why, and how far to trust it",
        "The verdict's reasons, one by one, and the tests behind them.",
        ("backtest", "reliability", "residuals", "convergence", "heat", "discrepancy", "emulator", "full_simulator",
         "parameters", "pairs", "heaters"),
    ),
    (
        "published",
        "The published experiment",
        "A genetic algorithm against the stochastic update (this calibration): the paper's table and six figures.",
        ("scores", "before", "genetic", "densities", "prediction"),
    ),
    ("record", "Record", "Telemetry's quality, versions, inputs and the scenario.", ("telemetry", "provenance")),
)  # fmt: skip
"""Folded parts: anchor, title, what is in it, and its panels."""


def first_screen(run: RunFiles) -> list[Section]:
    """The sections under the verdict, in order."""
    return _sections(run, FIRST)


def parts(run: RunFiles) -> list[Part]:
    """The folded parts, in order."""
    return [Part(anchor, title, words, _sections(run, names)) for anchor, title, words, names in PARTS]


def _sections(run: RunFiles, names: Sequence[str]) -> list[Section]:
    found: list[Section | None] = [import_module(f".{name}", __name__).panel(run) for name in names]
    return [section for section in found if section is not None]
