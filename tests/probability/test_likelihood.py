from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from flightcal.probability.likelihood import Residuals
from flightcal.probability.shapes import no_shapes

from . import residual_cases

SAMPLES, CHANNELS, SHAPES = 12, 3, 4


@pytest.fixture
def case():
    rng = np.random.default_rng(4)
    observed = rng.normal(290.0, 2.0, (SAMPLES, CHANNELS))
    observed[[1, 5, 6], [0, 2, 1]] = np.nan
    return {
        "observed": observed,
        "simulated": rng.normal(290.0, 2.0, (SAMPLES, CHANNELS)),
        "noise": np.array([0.5, 1.0, 1.7]),
        "basis": rng.normal(size=(SAMPLES, CHANNELS, SHAPES)),
        "variance": np.array([0.3, 2.0, 0.0, 1.1]),
    }


def log_likelihood(case):
    """Independent noise and the error of a simulator: value, and derivatives by simulated, noise and variance."""
    shapes = replace(no_shapes(SAMPLES, CHANNELS), errors=case["basis"])
    valid = np.isfinite(case["observed"]).T.copy()
    residuals = Residuals(np.arange(SAMPLES, dtype=float), valid, (residual_cases.INDEPENDENT,) * CHANNELS, shapes)
    numbers = np.concatenate([case["noise"][:, None], np.zeros((CHANNELS, 2))], axis=1)
    value, simulated_bar, numbers_bar, variance_bar, _ = residual_cases.log_likelihood(
        residuals, case["observed"], case["simulated"], numbers, case["variance"]
    )
    return value, simulated_bar, numbers_bar[:, 0], variance_bar


def test_it_is_the_density_of_the_dense_normal_distribution(case):
    valid = np.isfinite(case["observed"])
    shapes = case["basis"][valid]
    covariance = np.diag(np.broadcast_to(case["noise"] ** 2, valid.shape)[valid])
    covariance += shapes @ np.diag(case["variance"]) @ shapes.T
    dense = multivariate_normal.logpdf(case["observed"][valid], case["simulated"][valid], covariance)
    assert log_likelihood(case)[0] == pytest.approx(dense, rel=1e-12)


@pytest.mark.parametrize(("name", "place"), [("simulated", 1), ("noise", 2), ("variance", 3)])
def test_derivatives_are_those_of_differences(case, name, place):
    derivative = log_likelihood(case)[place]
    if name == "variance":
        case["variance"] += 0.5
        derivative = log_likelihood(case)[place]
    step = 1e-6
    for index in np.ndindex(case[name].shape):
        sides = []
        for sign in (1.0, -1.0):
            moved = case[name].copy()
            moved[index] += sign * step
            sides.append(log_likelihood({**case, name: moved})[0])
        assert derivative[index] == pytest.approx((sides[0] - sides[1]) / (2 * step), rel=1e-5, abs=1e-7)


def test_without_variance_it_is_the_iid_likelihood(case):
    case["variance"][:] = 0.0
    found = log_likelihood(case)
    expected = residual_cases.iid_log_likelihood(case["observed"], case["simulated"], case["noise"])
    for one, other in zip(found[:3], expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-13)
