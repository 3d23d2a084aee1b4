"""SUCHAI-1: the bundled telemetry and scenario agree, and every window has the orbit of its own time."""

from pathlib import Path

import numpy as np
import pytest

from flightcal.problem import build_problem
from flightcal.scenario import lint, load_scenario
from flightcal.telemetry import read

FILE = Path(__file__).parents[2] / "examples" / "suchai1" / "scenario.yaml"


def test_the_scenario_has_no_findings():
    assert lint(FILE) == []


@pytest.mark.parametrize("window", ["train", "test.days_later", "test.months_later"])
def test_the_inside_is_warm_when_the_windows_orbit_says_so(window):
    scenario = load_scenario(FILE)
    problem = build_problem(scenario, read(scenario), window)
    (window,) = problem.windows
    simulated = problem.simulate(problem.priors.median())[0].temperatures[:, 1]
    # At the prior's median: capacities shift it by minutes. An orbit of another time leaves nothing.
    known = window.valid[:, 1]
    assert np.corrcoef(simulated[known], window.observed[known, 1])[0, 1] > 0.6
