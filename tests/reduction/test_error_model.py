"""The error model: it finds what errors were made with, and its shapes are the covariance."""

import numpy as np
import pytest

from flightcal.reduction.candidate import Errors
from flightcal.reduction.error_model import covariance, estimate, left_out, shapes
from flightcal.scenario import SimulatorError


def _error(offset, deviation, correlation_time):
    return SimulatorError.model_construct(offset=offset, deviation=deviation, correlation_time=correlation_time)


def test_offset_deviation_and_correlation_time_are_found_again():
    rng = np.random.default_rng(4)
    truth = _error(0.1, 0.2, 900.0)
    seconds = 60.0 * np.arange(300.0)
    root = np.linalg.cholesky(covariance(truth, seconds) + 1e-12 * np.eye(len(seconds)))
    draws = (root @ rng.standard_normal((len(seconds), 600))).T[..., None]
    found = estimate([Errors("w", draws, np.zeros((600, 0)), 0)], ["a"], 60.0)["a"]
    # The mean over a window holds a little of what varies, so it is told apart only roughly.
    assert found.offset == pytest.approx(0.1, rel=0.2)
    assert found.deviation == pytest.approx(0.2, rel=0.1)
    assert found.correlation_time == pytest.approx(900.0, rel=0.15)


def test_shapes_and_variances_are_the_covariance_of_each_sensor():
    model = {"a": _error(0.1, 0.2, 2400.0), "c": _error(0.05, 0.0, 60.0)}
    seconds = 60.0 * np.arange(150.0)
    basis, variance = shapes(model, ["a", "b", "c"], seconds)
    found = np.einsum("tnr,r,smr->tnsm", basis, variance, basis)
    exact = covariance(model["a"], seconds)
    assert left_out(model["a"], seconds) < 0.05
    assert np.abs(found[:, 0, :, 0] - exact).max() < 0.2 * exact.max()
    assert np.trace(found[:, 0, :, 0]) == pytest.approx(np.trace(exact), rel=1e-12)
    np.testing.assert_allclose(found[:, 2, :, 2], 0.05**2, rtol=1e-9)
    assert not found[:, 1].any()
    assert not found[:, 0, :, 2].any()


def test_a_perfect_model_has_no_shapes():
    basis, variance = shapes({"a": _error(0.0, 0.0, 60.0)}, ["a"], 60.0 * np.arange(10.0))
    assert basis.shape == (10, 1, 0)
    assert variance.shape == (0,)
