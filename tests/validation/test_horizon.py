"""Scores by horizon: which samples are in which band, what is scored, and how sure a coverage is."""

import math

import numpy as np
import pytest
import xarray as xr

from flightcal.prediction.metrics import crps_of_draws
from flightcal.validation import ALL
from flightcal.validation.horizon import BANDS, band_scores, duty_scores

PERIOD = 6000.0
ORIGIN = np.datetime64("2024-03-01T00:00:00", "ns")


def prediction(error, *, offset=0.0, minutes=700, width=4.0, duty=None, unscored=10):
    """A prediction of two channels that errs by `error` [T] (K) in the first and by `offset` in the second."""
    minute = np.arange(minutes)
    error = np.broadcast_to(error, minutes).astype(float)
    observed = np.full((minutes, 2), 290.0)
    mean = observed + np.stack([error, np.full(minutes, offset)], axis=1)
    return xr.Dataset(
        {
            "observed": (("time", "channel"), observed),
            "scored": ("time", minute >= unscored),
            "mean": (("by", "time", "channel"), mean[None]),
            "lower": (("by", "time", "channel"), mean[None] - width / 2),
            "upper": (("by", "time", "channel"), mean[None] + width / 2),
            "crps": (("time", "channel"), np.abs(mean - observed)),
            "duty_cycle": (("simulation", "heater"), np.linspace(0.2, 0.4, 101)[:, None]),
            "observed_duty_cycle": ("heater", [0.3 if duty is None else duty]),
        },
        {
            "time": ORIGIN + minute * np.timedelta64(60, "s"),
            "channel": ["body", "panel"],
            "by": ["stochastic"],
            "heater": ["heater"],
        },
        {"origin": str(ORIGIN), "interval": 0.95},
    )


def by_place(scores):
    return {(score.origin, score.channel, score.band): score for score in scores}


def test_bands_count_from_the_origin_and_only_what_is_scored():
    found = by_place(band_scores({"first": prediction(1.0, unscored=8)}, PERIOD))
    # Samples at 0, 1, 2, ... min; an orbit has 100 min, and a band ends with its last sample.
    samples = [found["first", "body", band].samples for band in BANDS]
    assert samples == [3, 90, 100, 200, 299]
    assert found["first", "body", ALL].samples == 692
    assert found["first", ALL, ALL].samples == 2 * 692


def test_an_empty_band_has_no_scores():
    empty = by_place(band_scores({"first": prediction(1.0, minutes=90)}, PERIOD))["first", "body", "later"]
    assert empty.samples == 0
    assert math.isnan(empty.rmse)
    assert math.isnan(empty.coverage)


def test_scores_are_those_of_the_band():
    error = np.where(np.arange(700) <= 100, 1.0, -3.0)
    found = by_place(band_scores({"first": prediction(error, offset=0.5)}, PERIOD))
    near, far = found["first", "body", BANDS[1]], found["first", "body", BANDS[2]]
    assert (near.rmse, near.bias, near.coverage, near.crps) == pytest.approx((1.0, 1.0, 1.0, 1.0))
    assert (far.rmse, far.bias, far.coverage, far.crps) == pytest.approx((3.0, -3.0, 0.0, 3.0))
    assert near.width == pytest.approx(4.0)
    both = found["first", ALL, BANDS[1]]
    assert both.coverage == 1.0
    assert both.bias == pytest.approx(0.75)


def test_all_origins_together_have_the_samples_of_each():
    found = by_place(band_scores({"first": prediction(1.0), "second": prediction(-3.0, minutes=300)}, PERIOD))
    pooled = found[ALL, "body", ALL]
    assert pooled.samples == 690 + 290
    assert pooled.coverage == pytest.approx(690 / 980)
    assert pooled.effective == pytest.approx(
        found["first", "body", ALL].effective + found["second", "body", ALL].effective
    )


def test_missing_telemetry_is_not_scored():
    one = prediction(1.0)
    one["observed"].values[20:, 0] = np.nan
    found = by_place(band_scores({"first": one}, PERIOD))
    assert found["first", "body", ALL].samples == 10
    assert found["first", "panel", ALL].samples == 690


def test_the_error_of_a_coverage_is_that_of_repeats():
    rng = np.random.default_rng(0)
    shares, errors = [], []
    for _ in range(60):
        noise = np.empty(1500)
        noise[0] = rng.standard_normal()
        for t in range(1, 1500):
            noise[t] = 0.9 * noise[t - 1] + np.sqrt(1 - 0.81) * rng.standard_normal()
        scores = by_place(band_scores({"first": prediction(noise, minutes=1500, width=2 * 1.96)}, PERIOD))
        shares.append(scores["first", "body", ALL].coverage)
        errors.append(scores["first", "body", ALL].coverage_error)
    # A standard deviation from 60 repeats errs by 9%; residuals depend on each other more than hits do.
    assert 0.8 * np.std(shares) < np.mean(errors) < 2.5 * np.std(shares)


def test_a_coverage_of_all_samples_has_an_error():
    found = by_place(band_scores({"first": prediction(np.random.default_rng(1).normal(0, 0.1, 700))}, PERIOD))
    score = found["first", "body", ALL]
    assert score.coverage == 1.0
    assert 0.0 < score.coverage_error < 0.05


def test_duty_is_held_to_the_interval_of_the_draws():
    inside, outside = prediction(0.0, duty=0.25), prediction(0.0, duty=0.5)
    found = duty_scores({"first": inside, "second": outside, "third": prediction(0.0, duty=np.nan)})
    assert [(score.origin, score.hit) for score in found] == [("first", True), ("second", False)]
    assert (found[0].mean, found[0].lower, found[0].upper) == pytest.approx((0.3, 0.205, 0.395))


def test_crps_is_taken_from_the_prediction():
    one = prediction(0.0)
    rng = np.random.default_rng(2)
    one["crps"].values[:] = crps_of_draws(one["observed"].values, 290 + rng.standard_normal((50, 700, 2)))
    found = by_place(band_scores({"first": one}, PERIOD))
    assert found["first", "body", ALL].crps == pytest.approx(one["crps"].values[10:, 0].mean())
