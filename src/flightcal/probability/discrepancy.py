"""What the simulator lacks, as a Gaussian process in orbit phase with its weights integrated out.

Harmonics of the orbit [T, m] have weights with a diagonal prior, so a likelihood costs a pass over them and m^3. The
weights' variances are the spectral density of a Matern process at the whole frequencies; by Poisson's summation that is
the Matern process wrapped around the orbit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..compiled import Row
from ..simulator import FloatArray
from .kernels.matern import MaternCall, pull_back_spectrum, spectrum


def frequencies(harmonics: int) -> FloatArray:
    """[m] rad per orbit, of the functions that `in_phase` gives."""
    order = np.arange(1, harmonics + 1)
    return 2.0 * np.pi * np.concatenate([[0], order, order])


def in_phase(phase: FloatArray, harmonics: int) -> FloatArray:
    """A constant, and cosine and sine of each harmonic, [T, m], at phases [T] in orbits."""
    angle = 2.0 * np.pi * np.outer(phase, np.arange(1, harmonics + 1))
    return np.concatenate([np.ones((len(phase), 1)), np.cos(angle), np.sin(angle)], axis=1)


@dataclass(frozen=True)
class MaternPrior:
    """The prior of the weights: independent normal ones, by the process's spectral density."""

    frequency: FloatArray
    """[m] rad per orbit."""
    smoothness: float

    def deviations(self, numbers: FloatArray) -> FloatArray:
        """Standard deviations [m] of the weights; numbers: [2] amplitude and lengthscale, see `kernels.matern`."""
        root, *others = np.zeros((4, len(self.frequency)))
        fills, _ = self.rows(numbers, np.empty(2), root, *others, counted=0)
        fills()
        return root

    def rows(
        self,
        numbers: FloatArray,
        numbers_bar: FloatArray,
        root: FloatArray,
        slope: FloatArray,
        weights: FloatArray,
        shrunk: FloatArray,
        *,
        counted: int,
    ) -> tuple[Row, Row]:
        """What fills the weights' prior, and what takes their posterior to the derivatives; see `MaternCall`."""
        call = MaternCall(counted, self.frequency, self.smoothness, numbers, root, slope, weights, shrunk, numbers_bar)
        return spectrum.row(call), pull_back_spectrum.row(call)
