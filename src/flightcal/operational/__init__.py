"""The full-order operational simulator: networks from geometry, and the on-board software in the loop.

Imports: errors, scenario, simulator.
"""

from .file import Mission, SpacecraftFile, load_spacecraft
from .onboard import Command, HeaterLine, OnOff
from .simulator import Spacecraft, Thermistor, fly
