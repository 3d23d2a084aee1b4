"""The examples on flight telemetry: their networks say what they are meant to say."""

from pathlib import Path

import numpy as np
import pytest

from flightcal.problem import Problem, build_problem
from flightcal.scenario import lint, load_scenario
from flightcal.telemetry import read

EXAMPLES = Path(__file__).parents[2] / "examples"
FUNCUBE = EXAMPLES / "funcube1" / "scenario.yaml"
BUPT = EXAMPLES / "bupt1" / "several_windows.yaml"
DATA = Path(__file__).parents[3] / "shared" / "data"

pytestmark = pytest.mark.skipif(not DATA.exists(), reason="flight data are not here: ../shared/data")


def simulated(problem: Problem, **changes: float) -> np.ndarray:
    """Temperatures [T, channels] at the prior medians, save for the entries named."""
    theta = problem.priors.median()
    for name, value in changes.items():
        theta[problem.names.index(name)] = value
    return problem.windows[0].simulate(theta).temperatures


@pytest.mark.parametrize(
    "file", [FUNCUBE, FUNCUBE.with_name("with_discrepancy.yaml"), BUPT, EXAMPLES / "bupt1" / "scenario.yaml"]
)
def test_the_scenario_has_no_findings(file: Path):
    assert lint(file) == []


def test_of_the_panels_of_funcube_only_the_differences_drive_the_coupon():
    scenario = load_scenario(FUNCUBE)
    telemetry = read(scenario)

    def coupon(*warmer: str) -> np.ndarray:
        problem = build_problem(scenario, telemetry.assign({name: telemetry[name] + 5 for name in warmer}), "train")
        return simulated(problem, turn_x=0.1, turn_y=0.1)[:, list(scenario.observations).index("black_chassis")]

    as_measured = coupon()
    np.testing.assert_allclose(coupon("plus_x", "minus_x", "plus_y", "minus_y"), as_measured, atol=1e-6)
    assert (coupon("plus_x") - as_measured)[5:].min() > 1
    assert (coupon("minus_y") - as_measured)[5:].max() < -1


@pytest.mark.parametrize(
    ("window", "idle_power", "other"), [("train.june_21", "base_low", "base_full"), ("test", "base_full", "base_low")]
)
def test_what_the_computer_of_bupt_takes_when_idle_is_that_of_its_mode(window: str, idle_power: str, other: str):
    scenario = load_scenario(BUPT)
    problem = build_problem(scenario, read(scenario), window)
    as_written = simulated(problem)
    np.testing.assert_array_equal(simulated(problem, **{other: 1.5}), as_written)
    assert (simulated(problem, **{idle_power: 1.5}) - as_written)[-1, 0] < -5  # that heat is in the board instead
