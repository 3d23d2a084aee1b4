"""Wrong set-ups: each spoils the scenario or the telemetry of a satellite of `benchmarks.truth` in one way."""

from . import copied, ground, mistakes, scenario, telemetry
from .case import SEED, Case, SetUp, case_of

SETUPS = (*telemetry.SETUPS, *scenario.SETUPS, *ground.SETUPS, *copied.SETUPS, *mistakes.SETUPS)

__all__ = ["SEED", "SETUPS", "Case", "SetUp", "case_of"]
