"""Steps of a converter are seen where they are not small beside the noise."""

import numpy as np
import pytest

from flightcal.telemetry import quantisation_step


@pytest.mark.parametrize(("step", "noise", "seen"), [(0.5, 0.1, True), (0.125, 0.2, True), (0.01, 0.1, False)])
def test_a_step_is_seen_beside_noise_that_does_not_hide_it(step, noise, seen):
    rng = np.random.default_rng(0)
    values = 290.0 + np.sin(np.arange(500) / 20.0) + noise * rng.normal(size=500)
    values = step * np.round(values / step)
    values[::7] = np.nan
    assert quantisation_step(values) == (pytest.approx(step) if seen else None)


def test_constant_few_and_continuous_samples_have_no_step():
    assert quantisation_step(np.full(100, 290.0)) is None
    assert quantisation_step([1.0, 1.0, 2.0]) is None
    assert quantisation_step(np.random.default_rng(0).normal(size=500)) is None
