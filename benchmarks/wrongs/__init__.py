"""Wrong set-ups: each spoils the scenario or the telemetry of a satellite of `benchmarks.truth` in one way."""

from . import scenario, telemetry
from .case import SEED, Case, SetUp, case_of

SETUPS = (*telemetry.SETUPS, *scenario.SETUPS)

__all__ = ["SEED", "SETUPS", "Case", "SetUp", "case_of"]
