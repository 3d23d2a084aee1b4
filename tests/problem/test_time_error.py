"""The error that all time tags have in common, as an entry of theta."""

import numpy as np
import pytest

from flightcal.problem import build_problem
from flightcal.scenario import Normal
from flightcal.simulator import TIME_ERROR
from tests import small

MINUTE = 60.0
"""s between samples."""


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    content = small.content() | {"heat": {}, "time_error": "4 s"}
    return build_problem(*small.closed_loop(tmp_path_factory.mktemp("timed"), content))


def test_it_is_one_entry_for_all_temperatures(problem):
    (entry,) = (parameter for parameter in problem.entries if parameter.kind == "time")

    assert (entry.name, entry.unit, entry.window) == (TIME_ERROR, "s", None)
    assert entry.prior == Normal(mean=0.0, standard_deviation=4.0)
    assert entry.sets == ("observations.body_temp.time_offset", "observations.panel_temp.time_offset")
    assert problem.names.index(TIME_ERROR) == len(problem.scenario.parameters)


def test_readings_of_a_minute_later_are_the_next_ones(problem):
    theta = problem.priors.median()
    later = theta.copy()
    later[problem.names.index(TIME_ERROR)] = MINUTE
    (now,), (then,) = problem.simulate(theta), problem.simulate(later)

    np.testing.assert_allclose(then.temperatures[:-1], now.temperatures[1:], rtol=1e-9)
    assert np.ptp(now.temperatures, axis=0).min() > 1.0


def test_windows_that_are_predicted_have_it_too(problem, tmp_path):
    content = small.content() | {"heat": {}, "time_error": "4 s"}
    (unseen,) = build_problem(*small.closed_loop(tmp_path, content), "test").windows
    thetas = np.tile(problem.priors.median(), (2, 1))
    thetas[:, problem.names.index(TIME_ERROR)] = 1.5, -2.5

    assert problem.at(unseen, thetas)[:, unseen.names.index(TIME_ERROR)].tolist() == [1.5, -2.5]


def test_without_it_theta_has_no_such_entry(tmp_path):
    content = small.content() | {"heat": {}, "time_error": "none"}
    assert TIME_ERROR not in build_problem(*small.closed_loop(tmp_path, content)).names
