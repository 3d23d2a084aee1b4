"""The sections after the verdict, each a list of blocks: text, table, figure."""

from __future__ import annotations

from collections.abc import Callable

from .. import discrepancy
from ..block import Block, Section
from ..run_files import RunFiles
from ..verdict import Checks
from . import error, posterior, record, simulation, stand_in


def sections(run: RunFiles, checks: Checks) -> list[Section]:
    """All sections of the report, in order."""
    made: list[tuple[str, str, Callable[[RunFiles], list[Block]]]] = [
        ("scores", "Scores", simulation.scores),
        ("before", "Before calibration", simulation.before),
        ("genetic", "Genetic algorithm", simulation.genetic),
        ("densities", "Prior and posterior", posterior.densities),
        ("prediction", "Prediction with interval", simulation.prediction),
        ("parameters", "Parameters", posterior.parameters),
        ("pairs", "Correlations", posterior.pairs),
        ("convergence", "Convergence", posterior.convergence),
        *([("emulator", "Emulator", stand_in.emulator)] if run.emulator is not None else []),
        *([("full-simulator", "The full simulator", stand_in.full_simulator)] if run.full_check is not None else []),
        *([("discrepancy", "Discrepancy", error.discrepancies)] if discrepancy.parts(run.windows) else []),
        ("residuals", "Residuals", lambda run: error.residuals(run, checks)),
        ("reliability", "Reliability", error.reliability),
        ("heaters", "Heaters", record.heaters),
        ("telemetry", "Telemetry quality", record.quality),
        ("provenance", "Provenance", record.provenance),
    ]
    return [Section(anchor, title, build(run)) for anchor, title, build in made]
