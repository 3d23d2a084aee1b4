"""The log density and its gradient as C functions, which need no Python.

In a folder of their own, so that they are compiled anew only where they or what they call has changed.
"""

from .density import DENSITY_NOT_FINITE, FOLDERS, REASONS, STOPPED, NativeDensity, native_density
from .joint import joint_density

__all__ = ["DENSITY_NOT_FINITE", "FOLDERS", "REASONS", "STOPPED", "NativeDensity", "joint_density", "native_density"]
