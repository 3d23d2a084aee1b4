import importlib.util
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from flightcal.calibration import calibrate_nuts
from flightcal.emulation.active import learn
from flightcal.emulation.emulated import CHECKED, check_on_the_simulator, empty_runs, run_many
from flightcal.emulation.horizon import beginning
from flightcal.emulation.simulator_check import LARGEST_DENSITY_ERROR
from flightcal.problem import build_problem
from flightcal.scenario import load_scenario
from flightcal.telemetry import read
from tests.workers import close_workers

EXAMPLES = Path(__file__).parents[2] / "examples"
NOISE = 0.1  # K
without_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")


def module(folder, name, monkeypatch):
    monkeypatch.syspath_prepend(str(folder))
    specification = importlib.util.spec_from_file_location(f"{folder.name}_{name}", folder / f"{name}.py")
    loaded = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(loaded)
    monkeypatch.delitem(sys.modules, "simulator", raising=False)
    return loaded


@pytest.mark.parametrize("name", ["executable", pytest.param("fmu", marks=without_compiler)])
def test_telemetry_is_what_the_script_makes(name, monkeypatch):
    made = module(EXAMPLES / name, "make_telemetry", monkeypatch).telemetry()
    assert made == (EXAMPLES / name / "telemetry.csv").read_text()


@pytest.fixture(params=["executable", pytest.param("fmu", marks=without_compiler)])
def example(request, tmp_path, monkeypatch):
    """A copy of the example, with its FMU built, and the true parameters in the scenario's order."""
    folder = tmp_path / request.param
    shutil.copytree(EXAMPLES / request.param, folder)
    if request.param == "fmu":
        pytest.importorskip("fmpy", reason="needs the extra 'fmu'")
        subprocess.run([sys.executable, str(folder / "build.py")], check=True)
    truth = module(folder, "make_telemetry", monkeypatch).TRUTH
    yield folder / "scenario.yaml", np.array(list(truth.values()) if isinstance(truth, dict) else truth)
    close_workers()


def test_residuals_at_the_truth_are_the_noise(example):
    path, truth = example
    scenario = load_scenario(path)
    data = read(scenario)

    for window in ("train", "test"):
        problem = build_problem(scenario, data, window)
        assert problem.windows[0].simulator.parameters == tuple(scenario.parameters)
        run = problem.windows[0].simulator.simulate(truth)
        residuals = problem.windows[0].observed - run.temperatures
        assert np.isfinite(residuals).all()
        # Standard errors of a mean and of a standard deviation of independent samples; 4.5 of them.
        samples = len(residuals)
        np.testing.assert_allclose(residuals.mean(axis=0), 0.0, atol=4.5 * NOISE / np.sqrt(samples))
        np.testing.assert_allclose(residuals.std(axis=0), NOISE, rtol=4.5 / np.sqrt(2 * samples))
        if np.isfinite(problem.windows[0].status).any():
            np.testing.assert_array_equal(problem.windows[0].status, run.status)
            assert set(np.unique(run.status)) == {0.0, 1.0}


def test_truth_is_well_inside_the_priors_and_off_their_centres(example):
    path, truth = example
    scenario = load_scenario(path)
    problem = build_problem(scenario, read(scenario))
    lower, median, upper = (problem.priors.quantile(p)[: len(truth)] for p in (0.025, 0.5, 0.975))

    assert ((truth > lower) & (truth < upper)).all()
    assert (np.abs(truth / median - 1) > 0.01).all()


def test_telemetry_tells_every_parameter_much_better_than_its_prior(example):
    path, truth = example
    scenario = load_scenario(path)
    problem = build_problem(scenario, read(scenario))
    theta = problem.priors.median()
    theta[: len(truth)] = truth
    for channel in problem.channels:
        theta[problem.names.index(f"noise.{channel}")] = NOISE
        # The example lacks nothing, and a calibration finds out.
        theta[problem.names.index(f"discrepancy.phase.amplitude.{channel}")] = 0.1 * NOISE
    z = problem.to_z(theta)

    deviations = np.sqrt(np.diag(np.linalg.inv(problem.gauss_newton_hessian(z))))

    # On the scale of z a prior has a standard deviation of about one.
    assert (deviations[: len(truth)] < 0.25).all()


@pytest.mark.slow
def test_least_squares_from_the_prior_medians_finds_the_truth(example):
    """Without flightcal's own inference: what the telemetry says is the truth, within its uncertainty."""
    path, truth = example
    scenario = load_scenario(path)
    problem = build_problem(scenario, read(scenario))
    start = problem.priors.median()[: len(truth)]

    def residuals(scaled):
        return (
            (problem.windows[0].observed - problem.windows[0].simulator.simulate(scaled * start).temperatures) / NOISE
        ).ravel()

    fit = least_squares(residuals, np.ones(len(truth)), diff_step=1e-4, xtol=1e-6)

    off = fit.x - truth / start
    # Chi-square of five degrees of freedom: above 20.5 once in a thousand.
    assert off @ (fit.jac.T @ fit.jac) @ off < 20.5
    assert 2 * fit.cost / problem.windows[0].observed.size == pytest.approx(
        1.0, abs=4.5 * np.sqrt(2 / problem.windows[0].observed.size)
    )


def exact_moments(problem, z):
    """Means, standard deviations and effective draws of the simulator's own posterior, by importance sampling.

    z: [S, d] draws, around which a wider Student's t of seven degrees of freedom proposes.
    """
    rng, count, d, nu = np.random.default_rng(0), 300, z.shape[1], 7
    centre, factor = z.mean(axis=0), np.linalg.cholesky(np.cov(z.T))
    steps = rng.standard_normal((count, d)) / np.sqrt(rng.chisquare(nu, (count, 1)) / nu)
    proposed = centre + steps @ factor.T
    log_proposal = -0.5 * (nu + d) * np.log1p((steps**2).sum(axis=1) / nu)
    log_weights = np.array([problem.log_density(point) for point in proposed]) - log_proposal
    weights = np.exp(log_weights - log_weights.max())
    weights /= weights.sum()
    theta = problem.to_theta(proposed)
    mean = weights @ theta
    return mean, np.sqrt(weights @ (theta - mean) ** 2), 1.0 / np.sum(weights**2)


@pytest.mark.slow
def test_calibration_through_an_emulator_covers_the_truth_and_is_the_simulators_own(example):
    """With nothing lacking, for the simulator's own posterior is then known from some hundred runs."""
    path, truth = example
    path.write_text(f"{path.read_text()}\nheat: none\n")
    scenario = load_scenario(path)
    data = read(scenario)
    problem = build_problem(scenario, data)
    settings, seed = scenario.calibration.emulator, scenario.calibration.seed
    nothing = tuple(empty_runs(window) for window in problem.windows)

    learnt = learn(problem, run_many, nothing, settings, seed, beginning=partial(beginning, data))
    posterior = calibrate_nuts(learnt.problem, starts=[("active learning", learnt.theta)], random_starts=0)
    check, (runs,) = check_on_the_simulator(problem, learnt.problem, posterior.flat, seed)

    assert learnt.reached
    assert posterior.diagnostics.passed
    assert len(learnt.runs[0]) + len(runs) <= 300
    assert len(runs) == CHECKED
    assert check.validation.passed
    assert check.density_error < LARGEST_DENSITY_ERROR
    assert all(item.unmatched == 0.0 for item in check.steps)
    low, high = np.quantile(posterior.flat[:, : len(truth)], (0.025, 0.975), axis=0)
    assert ((low <= truth) & (truth <= high)).all()
    mean, deviation, effective = exact_moments(problem, problem.to_z(posterior.flat))
    assert effective > 150
    # Importance sampling's own error is 3 / sqrt(150) = 0.25 standard deviations.
    np.testing.assert_array_less(np.abs(posterior.flat.mean(axis=0) - mean) / deviation, 0.35)
    np.testing.assert_allclose(posterior.flat.std(axis=0) / deviation, 1.0, atol=0.3)
