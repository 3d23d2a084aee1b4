"""Thresholds of thermostats as measured switches show them."""

import numpy as np
import pytest

from flightcal.prediction.thresholds import draw_thresholds
from flightcal.problem import build_problem
from tests import small


@pytest.mark.parametrize("error", ["bias", "time_offset"])
def test_a_threshold_is_found_where_it_is_whatever_that_of_the_draw(tmp_path, error):
    content = small.content() | {"heat": {"pattern": {"harmonics": 1}, "gains": None, "slow": None}}
    # No channel is left that shows temperatures as they are.
    unit = {"bias": "K", "time_offset": "s"}[error]
    uncertain = {"normal": {"mean": f"0 {unit}", "standard_deviation": f"1 {unit}"}}
    for channel in ("body_temp", "panel_temp"):
        content["parameters"][f"of_{channel}"] = {"sets": f"observations.{channel}.{error}", "prior": uncertain}
    written = content["simulator"]["heaters"]["heater"]["off_above"]
    prior = {"normal": {"mean": written, "standard_deviation": "1 K"}}
    content["parameters"]["off_above"] = {"sets": "heaters.heater.off_above", "prior": prior}
    problem = build_problem(*small.closed_loop(tmp_path, content))
    (window,) = problem.open_loop.windows
    medians = dict(zip(problem.names, problem.priors.median(), strict=True))
    one = problem.at(window, np.array(list((medians | small.TRUTH).values()))[None])[0]
    other = one.copy()
    other[window.names.index("off_above")] += 0.4
    thetas = np.repeat([one, other], 200, axis=0)
    shifts = np.zeros((len(thetas), len(window.switching.time)))

    found = draw_thresholds((window,), [thetas], [None], [shifts], np.random.default_rng(0))

    lower, upper = np.moveaxis(found.offsets[..., 0].reshape(2, 200, 2), 2, 0)
    error = upper.std() / np.sqrt(200)
    assert abs(upper[0].mean() - upper[1].mean() - 0.4) < 5 * np.sqrt(2.0) * error
    assert abs(lower[0].mean() - lower[1].mean()) < 5 * np.sqrt(2.0) * lower.std() / np.sqrt(200)
    assert error < 0.04
