"""What of residuals should be white, against the Cholesky factor of their dense covariance."""

from types import SimpleNamespace

import numpy as np
import pytest

from flightcal.prediction.innovations import innovations, noise_in_words

from ..probability.residual_cases import CORRELATED, CORRELATED_STUDENT, INDEPENDENT, ROUNDED, STUDENT

TIMES = np.cumsum(np.random.default_rng(0).choice([30.0, 60.0, 400.0], 300))


def of(kind, residual, **numbers):
    named = {"standard_deviation": "deviation", "correlation_time": "time", "quantisation": "step"}
    values = np.array([[numbers.get(named.get(name, name), 0.0) for name in kind.names]])
    model = SimpleNamespace(terms=SimpleNamespace(kinds=(kind,)))
    return innovations(model, residual[:, None], TIMES, values, np.random.default_rng(1))[:, 0]


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
    residual[[5, 80]] = np.nan
    given = residual.copy()
    found = of(ROUNDED, residual, deviation=0.2, step=1.0)
    np.testing.assert_array_equal(residual, given, err_msg="the residuals are the caller's")
    np.testing.assert_array_equal(of(ROUNDED, residual, deviation=0.2, step=1.0), found)
    valid = np.isfinite(residual)
    np.testing.assert_array_equal(np.isfinite(found), valid)
    assert (np.abs(found - residual)[valid] <= 0.5).all()
    # Rounding adds 0.29 K; without it there is the noise again. Four standard errors of a deviation.
    assert found[valid].std() == pytest.approx(0.2, rel=4 / np.sqrt(2 * len(TIMES)))


def test_innovations_of_independent_noise_are_the_residuals():
    residual = np.random.default_rng(2).normal(size=len(TIMES))
    for kind in (INDEPENDENT, STUDENT):
        np.testing.assert_array_equal(of(kind, residual, deviation=0.7, step=1.0), residual)


def test_the_words_name_each_kind_of_noise():
    kinds = [INDEPENDENT, CORRELATED, CORRELATED_STUDENT, STUDENT, ROUNDED]
    model = SimpleNamespace(terms=SimpleNamespace(kinds=kinds))
    assert noise_in_words(model) == [
        "iid noise",
        "AR(1) noise",
        "AR(1) noise with Student-t innovations",
        "independent Student-t noise",
        "rounded iid noise",
    ]
