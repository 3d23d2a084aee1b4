"""Coordinates that bounds do not bend."""

from __future__ import annotations

import numpy as np
import pytest

from flightcal.probability import Priors, straight
from flightcal.scenario import Beta, LogNormal, Normal, TruncatedNormal, Uniform

PRIORS = Priors(
    ("link", "absorptivity", "emissivity", "bias", "share"),
    (
        LogNormal(median=1.0, factor=2.0),
        Uniform(lower=0.2, upper=0.5),
        TruncatedNormal(mean=0.8, standard_deviation=0.2, lower=0.6, upper=0.9),
        Normal(mean=0.0, standard_deviation=1.0),
        Beta(alpha=2.0, beta=3.0),
    ),
)
CENTRE = np.array([0.3, 1.2, -0.4, 0.1, 0.6])


def of(centre=CENTRE):
    rng = np.random.default_rng(0)
    root = 0.4 * rng.standard_normal((5, 5))
    found = straight(PRIORS, centre, root @ root.T + 0.1 * np.eye(5))
    assert found is not None
    return found


def by_differences(function, at, step=1e-6):
    return np.stack(
        [(function(at + step * e) - function(at - step * e)) / (2 * step) for e in np.eye(len(at))], axis=-1
    )


def test_they_are_z_at_the_centre_to_first_order():
    np.testing.assert_allclose(of().to_z(CENTRE), CENTRE, rtol=1e-14)
    np.testing.assert_allclose(by_differences(of().to_z, CENTRE), np.eye(5), atol=1e-8)


def test_they_lead_there_and_back():
    y = CENTRE + 1.5 * np.random.default_rng(1).standard_normal((3, 7, 5))
    np.testing.assert_allclose(of().to_y(of().to_z(y)), y, rtol=1e-12, atol=1e-12)


def test_volumes_stay_so_that_the_density_does():
    for y in CENTRE + 1.5 * np.random.default_rng(2).standard_normal((5, 5)):
        assert np.linalg.det(by_differences(of().to_z, y)) == pytest.approx(1.0, abs=1e-6)


def test_derivatives_are_pulled_back_by_the_jacobian():
    y = CENTRE + np.random.default_rng(3).standard_normal(5)
    z_bar = np.random.default_rng(4).standard_normal(5)
    expected = by_differences(of().to_z, y).T @ z_bar
    np.testing.assert_allclose(of().pull_back(of().to_z(y), z_bar), expected, rtol=1e-6, atol=1e-7)


def test_a_line_in_theta_and_a_logarithm_is_straight():
    """The logarithm of a link that follows an absorptivity linearly, up to the bound of the latter's prior."""
    slope = 3.0
    theta, rate = PRIORS.at(CENTRE).theta, PRIORS.at(CENTRE).slope
    covariance = np.eye(5)
    covariance[0, 1] = covariance[1, 0] = slope * rate[1]
    found = straight(PRIORS, CENTRE, covariance)
    absorptivity = np.linspace(0.25, 0.4999, 9)
    z = np.tile(CENTRE, (9, 1))
    z[:, 1] = PRIORS.to_z(np.where(np.arange(5) == 1, absorptivity[:, None], theta))[:, 1]
    z[:, 0] += slope * (absorptivity - theta[1])
    y = found.to_y(z)
    np.testing.assert_allclose(y[:, 0], CENTRE[0] + slope * rate[1] * (y[:, 1] - CENTRE[1]), rtol=1e-12)
    assert np.ptp(np.diff(z[:, 0]) / np.diff(z[:, 1])) > 0.3


def test_the_most_bent_come_first_and_straight_ones_are_left_out():
    found = straight(PRIORS, np.zeros(5), np.diag([1.0, 1.0, 1e-4, 1.0, 0.25]))
    assert list(found.bounded) == [1, 4]
    assert sorted(found.order) == list(range(5))


def test_without_bounds_there_is_nothing_to_do():
    priors = Priors(("a", "b"), (LogNormal(median=1.0, factor=2.0), Normal(mean=0.0, standard_deviation=1.0)))
    assert straight(priors, np.zeros(2), np.eye(2)) is None


def test_a_centre_on_a_bound_makes_nothing_straight():
    centre = np.where(np.arange(5) == 1, 40.0, CENTRE)
    found = straight(PRIORS, centre, np.eye(5))
    assert 1 not in found.bounded
    assert np.isfinite(found.to_z(centre + 1.0)).all()
