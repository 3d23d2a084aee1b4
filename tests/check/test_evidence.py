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


def test_what_is_lacking_is_told_beside_a_right_model_with_usual_heat():
    rows = 40
    nothing = np.zeros((rows, 1))
    point = Point(np.zeros(1), np.zeros((rows, 1)), np.zeros(rows), nothing, nothing, nothing)
    small, large = np.eye(rows), 3.0 * np.eye(rows)
    gaussian = Gaussian(point, (1.0, 4.0), np.ones(rows, bool), (small, large))
    right, wrong = gaussian.fit(np.full(rows, 0.5)), gaussian.fit(np.full(rows, 3.0))
    assert (right.size, right.lacking) == (1.0, 0.0)
    # With four times the heat its deviations are usual, but so much heat is not.
    assert (wrong.size, wrong.misfit) == (4.0, pytest.approx(1.0))
    assert wrong.lacking == pytest.approx(rows * np.log(3.0) + 0.25 * rows + 0.5 * (2.0 / 0.7) ** 2, rel=0.01)
