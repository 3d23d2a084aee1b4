"""Ornstein-Uhlenbeck processes at times that need not be even."""

import numpy as np
import pytest

from flightcal.probability.noise.process import correlate


def step_by_step(innovations, seconds, time):
    values = [innovations[0]]
    for new, apart in zip(innovations[1:], np.diff(seconds), strict=True):
        kept = np.exp(-apart / time)
        values.append(kept * values[-1] + np.sqrt(1.0 - kept**2) * new)
    return np.array(values)


@pytest.mark.parametrize("time", [1.0, 30.0, 600.0, 1e6])
@pytest.mark.parametrize("count", [1, 2, 4000])
def test_a_process_is_that_of_its_recursion(time, count):
    rng = np.random.default_rng(0)
    # Dense for a while, and with a gap that is hundreds of correlation times long.
    seconds = np.cumsum(np.where(np.arange(count) == 1500, 2e5, rng.uniform(0.1, 90.0, count)))
    innovations = rng.standard_normal(count)
    found, expected = correlate(innovations, seconds, time), step_by_step(innovations, seconds, time)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9)
