"""Optima that the chains have not been near are told; those among the draws, and poor ones, are not."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flightcal.calibration import calibrate_nuts
from flightcal.calibration.explanations import other_explanations
from flightcal.calibration.mode import Mode
from flightcal.calibration.posterior import posterior_tree
from flightcal.problem import build_problem
from flightcal.problem.synthetic import simulate_telemetry, with_telemetry
from flightcal.scenario import NutsSettings, load_scenario
from flightcal.telemetry import read
from flightcal.validation import variant

VALIDATION = Path(__file__).parents[2] / "examples" / "validation" / "scenario.yaml"
Z = np.random.default_rng(1).normal([0.0, 1.0], [1.0, 0.1], (400, 2))
BEST = Mode(np.array([0.0, 1.0]), 10.0, True, "a start")


def told(*modes):
    """Of a theta that is the exponential of z."""
    modes = (BEST, *modes)
    return other_explanations(SimpleNamespace(names=["a", "b"], to_theta=np.exp), modes, Z)


def test_an_optimum_away_from_all_draws_is_told_by_the_entries_that_are_away():
    found = told(replace(BEST, z=np.array([1.0, 2.0]), log_density=8.5))
    assert [other.below for other in found] == [1.5]
    ((name, here, there),) = found[0].differs
    assert (name, here, there) == ("b", pytest.approx(np.exp(np.median(Z[:, 1]))), np.exp(2.0))


def test_the_entry_that_is_farthest_in_standard_deviations_comes_first():
    found = told(replace(BEST, z=np.array([7.0, 3.0])))
    assert [name for name, *_ in found[0].differs] == ["b", "a"]


@pytest.mark.parametrize(
    "changed",
    [
        {"z": np.array([0.5, 1.05])},
        {"z": np.array([0.0, Z[:, 1].max() + 0.9 * Z[:, 1].std()])},
        {"z": np.array([0.0, Z[:, 1].min() - 0.9 * Z[:, 1].std()])},
        {"log_density": 4.9},
        {"log_density": -np.inf},
        {"log_density": np.nan},
        {"converged": False},
    ],
)
def test_an_optimum_among_the_draws_or_far_below_or_not_converged_is_not_told(changed):
    assert told(replace(BEST, **({"z": np.array([0.0, 5.0]), "log_density": 9.0} | changed))) == ()


def test_two_climbs_to_one_optimum_are_one_explanation():
    other = replace(BEST, z=np.array([0.0, 2.0]), log_density=9.0)
    beyond = replace(BEST, z=np.array([0.0, -2.0]), log_density=8.0)
    elsewhere = replace(BEST, z=np.array([9.0, 1.0]), log_density=9.0)
    assert len(told(other, replace(other, log_density=8.99), beyond, elsewhere)) == 3


def test_a_sensor_that_starts_on_the_other_side_of_a_threshold_is_another_explanation():
    """Repeat 23 of the validation: of two optima of an equal density, one is 11 deviations from the truth."""
    written = load_scenario(VALIDATION)
    steps_of_then = written.network.model_copy(update={"step": 30.0})
    scenario = variant(written.model_copy(update={"simulator": steps_of_then}), "iid")
    data = read(scenario)
    problem = build_problem(scenario, data)
    rng = np.random.default_rng([scenario.calibration.seed, 23])
    truth = problem.priors.sample(rng, 1)[0]
    made = with_telemetry(problem, data, simulate_telemetry(problem, truth, rng))
    posterior = calibrate_nuts(made, NutsSettings(chains=2, draws=100, warmup=200), int(rng.integers(2**32)))
    attributes = posterior_tree(made, posterior, seed=1).attrs
    assert '"initial.body", 283.2' in attributes["other_explanations"]
    found = other_explanations(made, posterior.modes, posterior.draws.z.reshape(-1, len(truth)))
    place = made.names.index("initial.body")
    there = {name: value for name, _, value in found[0].differs}["initial.body"]
    near, far = sorted(abs(start - truth[place]) for start in (there, posterior.flat[:, place].mean()))
    assert near < 0.05 < 0.1 < far
