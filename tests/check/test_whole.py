"""A problem as it is checked, beside a problem as it is sampled."""

import pytest

from flightcal.check.whole import as_sampled
from flightcal.problem import build_problem
from flightcal.scenario import Heat
from tests import small


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    return small.closed_loop(tmp_path_factory.mktemp("flown"))


def test_where_heat_is_learnt_heaters_are_driven_by_their_measured_status(flown):
    scenario, data = flown
    problem = build_problem(scenario.model_copy(update={"heat": Heat()}), data)
    assert as_sampled(problem).windows is problem.open_loop.windows
    assert as_sampled(problem).open_loop is None


def test_without_heat_thermostats_act(flown):
    scenario, data = flown
    problem = build_problem(scenario.model_copy(update={"heat": "none"}), data)
    assert as_sampled(problem) is problem
