import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from flightcal.calibration import build_problem
from flightcal.experiment import read
from flightcal.external import close_workers
from flightcal.scenario import load_scenario

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
        assert problem.simulator.parameters == tuple(scenario.parameters)
        run = problem.simulator.simulate(truth)
        residuals = problem.observed - run.temperatures
        assert np.isfinite(residuals).all()
        # Standard errors of a mean and of a standard deviation of independent samples; 4.5 of them.
        samples = len(residuals)
        np.testing.assert_allclose(residuals.mean(axis=0), 0.0, atol=4.5 * NOISE / np.sqrt(samples))
        np.testing.assert_allclose(residuals.std(axis=0), NOISE, rtol=4.5 / np.sqrt(2 * samples))
        if np.isfinite(problem.status).any():
            np.testing.assert_array_equal(problem.status, run.status)
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
    z = problem.to_z(np.concatenate([truth, np.full(2, NOISE)]))

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
        return ((problem.observed - problem.simulator.simulate(scaled * start).temperatures) / NOISE).ravel()

    fit = least_squares(residuals, np.ones(len(truth)), diff_step=1e-4, xtol=1e-6)

    off = fit.x - truth / start
    # Chi-square of five degrees of freedom: above 20.5 once in a thousand.
    assert off @ (fit.jac.T @ fit.jac) @ off < 20.5
    assert 2 * fit.cost / problem.observed.size == pytest.approx(1.0, abs=4.5 * np.sqrt(2 / problem.observed.size))
