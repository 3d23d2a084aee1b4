"""The noise of samples, as neighbouring ones say."""

import numpy as np
import pytest

from flightcal.telemetry import quiet_noise


def test_noise_is_told_from_what_is_slow_and_from_a_few_jumps():
    rng = np.random.default_rng(0)
    count, deviation = 20_000, 0.3
    values = 290.0 + 20.0 * np.sin(np.arange(count) / 300.0) + deviation * rng.standard_normal(count)
    values[5000:] += 40.0
    values[::50] = np.nan
    # The median of absolute deviations is known to 1.2 / sqrt(n); neighbouring second differences are correlated.
    assert quiet_noise(values) == pytest.approx(deviation, rel=4.0 * 2.0 * 1.2 / np.sqrt(count))


def test_too_few_samples_tell_of_no_noise():
    assert quiet_noise(np.array([1.0, np.nan, 5.0])) == 0.0
