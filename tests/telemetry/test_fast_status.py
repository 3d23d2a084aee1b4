"""A status whose samples do not show each switch, and what is smoothed."""

import numpy as np
import pytest
import xarray as xr

from flightcal.telemetry import is_blurred, smoothed


def sampled(values, interval=60.0):
    times = np.datetime64("2024-03-01T00:00:00", "ns") + (interval * 1e9 * np.arange(len(values))).astype("m8[ns]")
    return xr.Dataset({"x": ("time", np.asarray(values, float))}, {"time": times})


def cycling(on, off, interval=60.0, count=400):
    """Samples of a status that is on and off for so many s in turn."""
    return sampled(((np.arange(count) * interval) % (on + off) < on).astype(float), interval)


@pytest.mark.parametrize(("on", "off"), [(20.0, 60.0), (160.0 / 5.0, 246.0 / 5.0), (40.0, 500.0), (61.0, 67.0)])
def test_a_heater_that_is_on_or_off_for_about_a_sample_is_blurred(on, off):
    assert is_blurred(cycling(on, off), "x")


@pytest.mark.parametrize(("on", "off"), [(190.0, 250.0), (130.0, 1900.0), (1900.0, 130.0), (130.0, 130.0)])
def test_a_heater_whose_spells_are_all_seen_is_not(on, off):
    assert not is_blurred(cycling(on, off), "x")


@pytest.mark.parametrize("values", [[], [1.0], [0.0] * 50, [0.0, 1.0] * 3, [np.nan] * 20])
def test_what_hardly_switches_is_not(values):
    assert not is_blurred(sampled(values), "x")


def test_a_status_that_is_wrong_now_and_then_is_not():
    status = cycling(1900.0, 1900.0)
    status["x"][np.random.default_rng(0).choice(400, 12, replace=False)] = 0.0
    assert not is_blurred(status, "x")


def test_a_line_is_smoothed_to_itself_and_gaps_are_bridged():
    values = np.arange(30.0)
    values[11:14] = np.nan
    found = smoothed(sampled(values), "x")
    np.testing.assert_allclose(found[2:-2], np.arange(30.0)[2:-2], atol=0.7)
    np.testing.assert_allclose(found[4:8], np.arange(4.0, 8.0))
    assert np.isfinite(found).all()


def test_noise_is_smoothed_as_its_weights_say():
    noise = np.random.default_rng(0).standard_normal(20_000)
    found = smoothed(sampled(noise), "x")
    # The sum of the squares of 1, 2, 3, 2, 1 over 9; its deviation over so many samples is about 1%.
    assert found.std() == pytest.approx(np.sqrt(19.0) / 9.0, rel=0.04)
