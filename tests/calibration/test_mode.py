"""The search for the mode, on telemetry that the model itself made."""

from pathlib import Path

import numpy as np
import pytest

from flightcal.calibration import climb, find_mode
from flightcal.problem import build_problem
from flightcal.problem.synthetic import simulate_telemetry, with_telemetry
from flightcal.scenario import load_scenario
from flightcal.telemetry import read_telemetry
from flightcal.validation import variant
from tests.told import Told

from .. import small

VALIDATION = Path(__file__).parents[2] / "examples" / "validation" / "scenario.yaml"


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    written = small.content()
    written["windows"]["train"]["end"] = "2024-03-01T02:00:00"
    return build_problem(*small.closed_loop(tmp_path_factory.mktemp("mode"), written))


@pytest.fixture(scope="module")
def modes(problem):
    told = Told()
    found = find_mode(problem, [], rng=np.random.default_rng(2), random_starts=2, progress=told)
    return found, [note for _, note in told.notes]


def test_prior_draws_lead_to_the_truth_through_the_open_loop(problem, modes):
    mode = modes[0][0]
    assert mode.converged
    deviation = np.sqrt(np.diag(np.linalg.inv(problem.gauss_newton_hessian(mode.z))))
    values = {"noise.body_temp": 0.1, "initial.body": 285.0, "initial.panel": 262.0} | small.TRUTH
    truth = problem.to_z(np.array([values[name] for name in problem.names]))
    assert (np.abs(mode.z - truth) < 4 * deviation).all()
    assert mode.log_density >= problem.log_density(truth)


def test_the_density_is_flat_at_the_mode(problem, modes):
    mode = modes[0][0]
    value, gradient = problem.log_density_and_gradient(mode.z)
    assert value == mode.log_density
    assert gradient @ np.linalg.solve(problem.gauss_newton_hessian(mode.z), gradient) < 1e-4


def test_the_search_says_what_it_is_at(modes):
    said = modes[1]
    assert said[0] == "from 2 starts"
    assert said[-1].startswith("closed loop from ")
    assert "open loop from prior draw" in modes[0][0].origin


def test_named_starts_are_climbed_in_closed_loop_too_and_the_best_comes_first(problem, modes):
    theta = problem.to_theta(modes[0][0].z)
    far = theta.copy()
    far[problem.names.index("link")] *= 1.25
    found = find_mode(
        problem,
        [("near", theta), ("far", far)],
        rng=np.random.default_rng(0),
        random_starts=0,
    )
    assert {mode.origin for mode in found} > {"near", "far"}
    assert [mode.log_density for mode in found] == sorted((mode.log_density for mode in found), reverse=True)
    assert found[0].log_density == pytest.approx(modes[0][0].log_density, abs=1e-3)


def test_a_climb_never_goes_down(problem):
    z = problem.to_z(problem.priors.median())
    mode = climb(problem, z, "median")
    assert mode.log_density > problem.log_density(z)
    assert mode.origin == "median"


def test_a_climb_from_where_nothing_can_be_simulated_says_so(problem):
    z = np.full(len(problem.names), np.nan)
    mode = climb(problem, z)
    assert not mode.converged
    assert mode.log_density == -np.inf


def test_a_thermostat_out_of_step_after_an_outage_is_brought_back_into_it(tmp_path):
    written = small.content()
    written["windows"] = {"train": {"start": "2024-03-01T00:00:00", "end": "2024-03-01T06:30:00"}}
    scenario, data = small.load(tmp_path, written)
    truth = {"link": 0.65236, "panel_size": 1.32805, "power": 32.2731}
    data = small.telemetry_of(scenario, data, noise=0.05, seed=7, **truth)
    lost = {"time": slice(small.START + np.timedelta64(60, "m"), small.START + np.timedelta64(150, "m"))}
    for channel in ("body_temp", "panel_temp", "heater_status"):
        data[channel].loc[lost] = np.nan
    problem = build_problem(scenario, data)
    assert problem.open_loop is not None
    start = climb(problem.open_loop, problem.to_z(problem.priors.median())).z
    values = {"noise.body_temp": 0.05, "initial.body": 285.0, "initial.panel": 262.0} | truth
    at_truth = problem.log_density(problem.to_z(np.array([values[name] for name in problem.names])))
    assert climb(problem, start).log_density < at_truth - 100
    rng = np.random.default_rng(0)
    assert find_mode(problem, [], rng=rng)[0].log_density >= at_truth


REPEATS = (
    ("iid", 6),
    ("iid", 72),
    ("iid", 107),
    ("iid", 168),
    ("ar1", 90),
    ("ar1", 92),
    ("ar1", 165),
)
"""Of `examples/validation`, where to follow the whole window from the open loop's mode ends 8 to 350 nats below the
truth's mode. In those of `iid` the heater switches in a gap of its status, and the truth is 40 to 150 deviations from
the open loop's mode."""


@pytest.mark.parametrize(
    ("model", "repeat"),
    [pytest.param(*case, marks=[pytest.mark.slow] * (case == ("ar1", 90))) for case in REPEATS],
)
def test_a_thermostat_that_starts_near_its_threshold_or_drifts_out_of_step_is_followed(model, repeat):
    scenario = variant(load_scenario(VALIDATION), model)
    data = read_telemetry(scenario.telemetry, scenario.folder)
    problem = build_problem(scenario, data)
    rng = np.random.default_rng([scenario.calibration.seed, repeat])
    truth = problem.priors.sample(rng, 1)[0]
    made = with_telemetry(problem, data, simulate_telemetry(problem, truth, rng))
    assert made.open_loop is not None
    found = find_mode(made, [], rng=rng)
    assert found[0].log_density > climb(made, made.to_z(truth)).log_density - 1.0
