"""What of residuals should be white, against the Cholesky factor of their dense covariance."""

from types import SimpleNamespace

import numpy as np
import pytest

from flightcal.prediction.innovations import innovations
from flightcal.probability.noise import CORRELATED, CORRELATED_STUDENT, DEVIATION, NUMBERS, ROUNDED, STEP, TIME, WHITE

TIMES = np.cumsum(np.random.default_rng(0).choice([30.0, 60.0, 400.0], 300))


def of(kind, residual, **numbers):
    columns = {"deviation": DEVIATION, "time": TIME, "white": WHITE, "step": STEP}
    own = np.zeros((1, NUMBERS))
    for name, value in numbers.items():
        own[0, columns[name]] = value
    model = SimpleNamespace(compiled=SimpleNamespace(kinds=np.array([kind])))
    return innovations(model, residual[:, None], TIMES, own, np.random.default_rng(1))[:, 0]


@pytest.mark.parametrize(("kind", "white"), [(CORRELATED, 0.0), (CORRELATED, 0.3), (CORRELATED_STUDENT, 0.0)])
def test_innovations_of_correlated_noise_are_those_of_its_dense_covariance(kind, white):
    residual = np.random.default_rng(2).normal(size=len(TIMES))
    residual[[0, 40, 41, 100]] = np.nan
    valid = np.isfinite(residual)
    apart = np.abs(TIMES[valid, None] - TIMES[valid])
    total = 0.7**2 * np.exp(-apart / 200.0) + white**2 * np.eye(valid.sum())
    expected = np.linalg.solve(np.linalg.cholesky(total), residual[valid]) * np.hypot(0.7, white)
    found = of(kind, residual, deviation=0.7, time=200.0, white=white)
    np.testing.assert_allclose(found[valid], expected, rtol=1e-9)
    assert np.isnan(found[~valid]).all()


def test_of_rounded_telemetry_the_noise_is_drawn_within_the_step():
    rng = np.random.default_rng(3)
    curve = 3.0 * np.sin(TIMES / 2000.0)
    residual = np.round(curve + rng.normal(0.0, 0.2, len(TIMES))) - curve
    found = of(ROUNDED, residual, deviation=0.2, step=1.0)
    assert (np.abs(found - residual) <= 0.5).all()
    # Rounding adds 0.29 K; without it there is the noise again. Four standard errors of a deviation.
    assert found.std() == pytest.approx(0.2, rel=4 / np.sqrt(2 * len(TIMES)))
