"""Reliability of predicted distributions: right ones pass at the rate that chance allows, wrong ones do not."""

import numpy as np
import pytest
import xarray as xr
from scipy.stats import binom, kstest, norm

from flightcal.validation import (
    chance_band,
    coverage_by_hour,
    coverage_by_phase,
    probability_integral_transform,
    uniformity,
)
from flightcal.validation.residuals import effective_samples
from tests.validation.test_residuals import ar1, times

HALF = 1.959964


def predicted(residuals, deviation=1.0, scored=None):
    """A prediction of standard normals [T, N] with the standard deviation `deviation`; one orbit is 90 samples."""
    size, channels = residuals.shape
    mean = np.full((1, size, channels), 280.0)
    spread = np.full_like(mean, deviation)
    by = ("by", "time", "channel")
    return xr.Dataset(
        {
            "observed": (("time", "channel"), 280.0 + residuals),
            "scored": ("time", np.ones(size, bool) if scored is None else scored),
            "mean": (by, mean),
            "standard_deviation": (by, spread),
            "lower": (by, mean - HALF * spread),
            "upper": (by, mean + HALF * spread),
            "probability_below": (("time", "channel"), norm.cdf(residuals / deviation)),
            "orbit_phase": ("time", (np.arange(size) / 90.0) % 1.0),
        },
        {"time": times(size), "channel": [f"c{k}" for k in range(channels)], "by": ["stochastic"]},
        {"interval": 0.95},
    )


def test_the_transform_is_the_predicted_probability_of_less_and_leaves_out_what_is_not_scored():
    residuals = np.array([[0.0], [HALF], [-HALF], [np.nan], [1.0]])
    found = probability_integral_transform(predicted(residuals, scored=np.array([True, True, True, True, False])))
    assert found[:3, 0] == pytest.approx([0.5, 0.975, 0.025], abs=1e-6)
    assert np.isnan(found[3:]).all()


def test_white_residuals_get_the_test_of_kolmogorov_and_smirnov():
    residuals = np.random.default_rng(2).normal(size=(400, 1))
    found = uniformity(predicted(residuals))[0]
    values = probability_integral_transform(predicted(residuals))[:, 0]
    assert found.distance == pytest.approx(kstest(values, "uniform").statistic)
    assert found.samples == 400
    assert found.effective > 250


def test_autocorrelated_residuals_of_the_right_spread_are_rarely_called_wrong():
    rng = np.random.default_rng(3)
    residuals = np.stack([ar1(0.9, 600, rng) for _ in range(200)], axis=1)
    found = uniformity(predicted(residuals))
    share = np.mean([channel.p_value < 0.05 for channel in found])
    assert share <= binom.ppf(0.999, 200, 0.05) / 200
    # As independent samples nearly all of them would be.
    values = probability_integral_transform(predicted(residuals))
    assert np.mean([kstest(column, "uniform").pvalue < 0.05 for column in values.T]) > 0.4


def test_a_prediction_half_as_wide_as_it_should_be_is_found():
    rng = np.random.default_rng(4)
    residuals = np.stack([ar1(0.5, 600, rng) for _ in range(20)], axis=1)
    assert all(channel.p_value < 1e-3 for channel in uniformity(predicted(residuals, deviation=0.5)))


def test_coverage_is_told_apart_by_place_in_the_orbit():
    size = 900
    residuals = np.random.default_rng(5).normal(size=(size, 1))
    phase = (np.arange(size) / 90.0) % 1.0
    residuals[(phase >= 0.25) & (phase < 0.5)] = 5.0
    residuals[(phase >= 0.5) & (phase < 0.75)] = -5.0
    found = coverage_by_phase(predicted(residuals, scored=np.arange(size) >= 20), parts=4)
    assert [part.samples for part in found] == [210, 220, 230, 220]
    for part in found[1:3]:
        assert part.share == 0.0 < part.lower
    assert all(part.share > 0.9 for part in (found[0], found[3]))


def test_residuals_that_follow_each_other_have_a_wider_band_of_chance():
    residuals = np.stack([ar1(0.9, 900, np.random.default_rng(6))], axis=1)
    independent = effective_samples(residuals[:, 0], times(900))
    assert independent < 200
    for part in coverage_by_phase(predicted(residuals), parts=4):
        assert (part.lower, part.upper) == pytest.approx(chance_band(0.95, independent * part.samples / 900))


def test_coverage_is_told_apart_by_hour_since_the_first_scored_sample():
    size = 240
    residuals = np.zeros((size, 1))
    residuals[130:] = 5.0
    scored = np.arange(size) >= 10
    found = coverage_by_hour(predicted(residuals, scored=scored))
    assert [(part.start, part.end) for part in found] == [(0, 1), (1, 2), (2, 3), (3, 4)]
    assert [part.samples for part in found] == [60, 60, 60, 50]
    assert [part.share for part in found] == [1.0, 1.0, 0.0, 0.0]


def test_a_long_forecast_is_told_apart_in_longer_parts():
    found = coverage_by_hour(predicted(np.zeros((30 * 60 + 1, 1))))
    assert [(part.start, part.end) for part in found] == [(2 * k, 2 * k + 2) for k in range(16)]


def test_an_unknown_phase_has_no_coverage():
    prediction = predicted(np.zeros((50, 1)))
    prediction["orbit_phase"][:] = np.nan
    assert coverage_by_phase(prediction) == []


def test_the_band_of_chance_is_that_of_counts():
    low, high = chance_band(0.95, 200)
    exact = binom.ppf([0.025, 0.975], 200, 0.95) / 200
    assert [low, high] == pytest.approx(exact, abs=0.006)
    assert chance_band(0.95, 2.0)[0] < 0.5
