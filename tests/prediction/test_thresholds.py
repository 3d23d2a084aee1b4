"""Thresholds of thermostats as measured switches show them."""

import numpy as np
import pytest

from flightcal.prediction.thresholds import draw_thresholds
from flightcal.problem import build_problem

from .. import small

DRAWS = 200


def content_of(error, off_above=13.0):
    """No channel is left that shows temperatures as they are."""
    content = small.content() | {"heat": {"pattern": {"harmonics": 1}, "gains": None, "slow": None}}
    unit = {"bias": "K", "time_offset": "s"}[error]
    uncertain = {"normal": {"mean": f"0 {unit}", "standard_deviation": f"1 {unit}"}}
    for channel in ("body_temp", "panel_temp"):
        content["parameters"][f"of_{channel}"] = {"sets": f"observations.{channel}.{error}", "prior": uncertain}
    content["simulator"]["heaters"]["heater"]["off_above"] = f"{off_above} degC"
    return content


def drawn(folder, content, data, **changed):
    """Thresholds of a scenario with telemetry of its own; changed: parameters."""
    problem = build_problem(small.load(folder, content)[0], data)
    (window,) = problem.open_loop.windows
    known = dict(zip(problem.names, problem.priors.median(), strict=True)) | small.TRUTH | changed
    thetas = np.tile(problem.at(window, np.array(list(known.values()))[None]), (DRAWS, 1))
    shifts = np.zeros((DRAWS, len(window.switching.time)))
    return draw_thresholds((window,), [thetas], [None], [shifts], np.random.default_rng(0))


@pytest.mark.parametrize("error", ["bias", "time_offset"])
def test_a_threshold_is_found_where_it_is_whatever_the_scenario_writes(tmp_path, error):
    _, data = small.closed_loop(tmp_path, content_of(error))
    one, other = (drawn(tmp_path, content_of(error, off), data).offsets[..., 0].T for off in (13.0, 13.4))
    error = one[1].std() / np.sqrt(DRAWS)
    assert abs(one[1].mean() - other[1].mean() - 0.4) < 5 * np.sqrt(2.0) * error
    assert abs(one[0].mean() - other[0].mean()) < 5 * np.sqrt(2.0) * one[0].std() / np.sqrt(DRAWS)
    assert error < 0.04


@pytest.mark.parametrize("changed", [2.0, 5.0])
def test_a_threshold_that_was_changed_on_board_by_kelvins_is_found(tmp_path, changed):
    _, data = small.closed_loop(tmp_path, content_of("bias"))
    as_flown, as_written = (drawn(tmp_path, content_of("bias", off), data) for off in (13.0, 13.0 + changed))
    spread = np.hypot(as_flown.offsets[:, 1].std(), as_written.offsets[:, 1].std()) / np.sqrt(DRAWS)
    found = as_written.offsets[:, 1].mean() - as_flown.offsets[:, 1].mean()
    # The prior, by which so much is unlikely, draws it a little.
    assert abs(found + changed) < 5 * spread + 0.05
    mean, least = as_written.told
    assert abs(mean[1, 0]) > abs(least[1, 0]) > abs(changed) - 0.5
    assert abs(mean[0, 0]) < 0.3


def test_of_a_threshold_that_is_a_parameter_only_scatter_is_found(tmp_path):
    content = content_of("bias")
    prior = {"normal": {"mean": "13 degC", "standard_deviation": "1 K"}}
    content["parameters"]["off_above"] = {"sets": "heaters.heater.off_above", "prior": prior}
    _, data = small.closed_loop(tmp_path, content)
    right, wrong = (drawn(tmp_path, content, data, off_above=286.15 + off) for off in (0.0, 1.2))
    assert right.offsets[:, 0].std() > 0.0
    for found in (right, wrong):
        assert not found.offsets[:, 1].any()
    assert np.median(wrong.scatter[:, 1]) > 1.5 * np.median(right.scatter[:, 1])
