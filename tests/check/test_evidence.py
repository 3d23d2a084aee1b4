"""How well a simulation explains telemetry."""

import numpy as np
import pytest

from flightcal.check.evidence import Gaussian
from flightcal.check.view import Point


@pytest.mark.parametrize("diverged", [1e200, np.inf, np.nan])
def test_a_simulation_that_diverged_explains_least_and_warns_of_nothing(diverged, recwarn):
    rows = 3
    nothing = np.zeros((rows, 1))
    point = Point(np.zeros(1), np.zeros((rows, 1)), np.zeros(rows), nothing, nothing, nothing)
    gaussian = Gaussian(point, (1.0,), np.ones(rows, bool), (np.eye(rows),))
    far = gaussian.fit(np.array([0.0, diverged, 0.0]), nothing + 1.0)
    assert far.evidence < gaussian.fit(np.array([0.0, 100.0, 0.0]), nothing + 1.0).evidence
    assert np.isfinite(far.evidence)
    assert not recwarn.list
