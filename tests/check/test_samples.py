"""Samples of a channel."""

import numpy as np
import pytest
import xarray

from flightcal.check.samples import noise_left, noise_of, series_at

from .cases import spoilt


def test_nothing_is_read_between_samples_where_a_line_does_not_follow_them():
    """A panel falls into the shadow between two samples of its packet, 90 s apart."""
    seconds = np.arange(0.0, 3600.0, 90.0)
    times = np.datetime64("2024-03-01T00:00:00", "ns") + (1e9 * seconds).astype("timedelta64[ns]")
    noise = 0.05 * np.random.default_rng(1).standard_normal(len(seconds))
    falling = 310.0 - 0.1 * np.maximum(seconds - 1845.0, 0.0) + noise
    data = xarray.Dataset({"panel": ("time", falling)}, {"time": times})
    between = times[:-1] + np.timedelta64(45, "s")
    read = series_at(data, "panel", between, bent=0.25)
    (lost,) = np.flatnonzero(np.isnan(read))
    assert between[lost] == times[0] + np.timedelta64(1845, "s")
    assert np.isfinite(series_at(data, "panel", times, bent=0.25)).all()
    assert np.isfinite(series_at(data, "panel", between)).all()


def test_between_two_samples_half_of_the_noise_is_left():
    """Of 20,000 readings on the line between samples of noise alone."""
    rng = np.random.default_rng(7)
    times = np.datetime64("2024-03-01T00:00:00", "ns") + np.arange(20_001) * np.timedelta64(40, "s")
    data = xarray.Dataset({"panel": ("time", rng.standard_normal(len(times)))}, {"time": times})
    for later, left in ((0, 1.0), (10, 0.625), (20, 0.5), (40, 1.0)):
        at = times[:-1] + np.timedelta64(later, "s")
        np.testing.assert_allclose(noise_left(data, "panel", at), left)
        # The variance of so many normal numbers is known to 1%, of neighbours that share one to 2%.
        assert np.var(series_at(data, "panel", at)) == pytest.approx(left, rel=0.06)


def test_noise_is_told_from_what_is_smooth():
    smooth = 10.0 * np.sin(np.arange(400) / 40.0)
    noisy = smooth + 0.3 * np.random.default_rng(0).standard_normal(400)
    assert noise_of(noisy) == pytest.approx(0.3, rel=0.2)
    assert noise_of(smooth) < 0.05


def test_a_long_gap_is_not_bridged(flown):
    _, data = flown
    values = data["body_temp"].to_numpy().copy()
    values[10:40], values[50] = np.nan, np.nan
    read = series_at(spoilt(data, body_temp=values), "body_temp", data["time"].to_numpy())
    assert np.isnan(read[10:40]).all()
    assert read[50] == pytest.approx(0.5 * (values[49] + values[51]))
