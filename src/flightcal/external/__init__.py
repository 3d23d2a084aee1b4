"""Simulators that flightcal did not write, behind the one `Simulator` protocol."""

from .build import build_simulator
from .record import Outcome, Record
from .simulator import ExternalSimulator

__all__ = ["ExternalSimulator", "Outcome", "Record", "build_simulator"]
