"""How well a simulation explains telemetry."""

import numpy as np
import pytest

from flightcal.check.evidence import Gaussian, Scale
from flightcal.check.network_view import Point


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


def test_many_fits_are_each_what_one_is():
    rng = np.random.default_rng(5)
    rows, sizes = 30, (0.5, 1.0, 4.0)
    heat, effects = rng.standard_normal((rows, 12)), rng.standard_normal((rows, 3))
    point = Point(np.zeros(3), np.zeros((rows, 1)), np.zeros(rows), effects, heat, np.zeros((rows, 0)))
    known = rng.random(rows) < 0.8
    base = effects @ effects.T + np.diag(np.where(known, rng.uniform(0.1, 1.0, rows), 1e6))
    factors = tuple(np.linalg.cholesky(base + size**2 * heat @ heat.T) for size in sizes)
    one = Gaussian(point, sizes, known, factors)
    many = one.in_modes()
    chosen = set()
    for by in (0.3, 3.0, 30.0):
        for columns, scale in ((None, Scale()), (rng.standard_normal((rows, 2)), Scale(0.5, 10))):
            residual = by * (factors[0] @ rng.standard_normal(rows))
            here, there = one.fit(residual, columns, scale), many.fit(residual, columns, scale)
            chosen.add(here.size)
            for name, wanted in vars(here).items():
                np.testing.assert_allclose(getattr(there, name), wanted, rtol=1e-8, err_msg=name)
            assert many.evidence(residual, columns, scale) == pytest.approx(here.evidence, rel=1e-10)
    assert len(chosen) > 1
