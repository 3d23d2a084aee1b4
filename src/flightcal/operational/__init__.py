"""The full-order operational simulator: networks from geometry, and the on-board software in the loop.

Imports: errors, scenario, simulator.
"""

from .file import Mission, load_spacecraft
from .onboard import HeaterLine, OnOff
from .schema import CommandBlock, Kelvins, SpacecraftFile
from .simulator import Spacecraft, fly

__all__ = [
    "CommandBlock",
    "HeaterLine",
    "Kelvins",
    "Mission",
    "OnOff",
    "Spacecraft",
    "SpacecraftFile",
    "fly",
    "load_spacecraft",
]
