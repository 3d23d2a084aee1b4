"""The benchmark "heat-1d" of UM-Bridge: an initial temperature profile from a later one, whose posterior is normal.

Alghamdi et al. (2023), CUQIpy part II, arXiv:2305.16951; https://um-bridge-benchmarks.readthedocs.io. The profile is
twenty sines with standard normal weights. What the benchmark publishes of model and exact profile is reproduced; its
two data sets are drawn anew as it drew them, with the same noise, and the posterior of each is known in closed form.
"""

import numpy as np
import pytest

from flightcal.calibration import calibrate_nuts
from flightcal.scenario import NutsSettings
from tests.workers import close_workers

from . import problems

NODES, MODES = 100, 20
SPACING = 1.0 / (NODES + 1)
GRID = np.arange(1, NODES + 1) * SPACING
EXACT = (
    (1 - np.cos(2 * np.pi * (1 - GRID))) / 30
    + np.exp(-2 * (10 * (GRID - 0.5)) ** 2) / 30
    + np.exp(-2 * (10 * (GRID - 0.8)) ** 2) / 30
)


def profiles():
    """Initial profile of each weight, [node, mode]."""
    mode = np.arange(1, MODES + 1)
    return np.sin(np.pi * np.outer(np.arange(NODES) + 0.5, mode) / NODES) * mode**-1.5 / 10


def heat(initial):
    """Temperatures at t = 0.01 [node, ...]: explicit steps, both ends at zero."""
    steps = int(0.01 / (5 / 11 * SPACING**2))
    second = np.diag(np.full(NODES, -2.0)) + np.diag(np.ones(NODES - 1), 1) + np.diag(np.ones(NODES - 1), -1)
    return np.linalg.matrix_power(np.eye(NODES) + 0.01 / steps / SPACING**2 * second, steps) @ initial


@pytest.fixture(autouse=True)
def _no_idle_workers():
    yield
    close_workers()


def test_model_and_exact_profile_are_those_of_the_benchmark():
    # The regression values of its test_output.py, at weights drawn with NumPy's seed 0.
    weights = np.random.RandomState(0).rand(MODES)
    assert np.linalg.norm(weights) == pytest.approx(2.878663657007402, rel=1e-12)
    assert np.linalg.norm(profiles() @ weights) == pytest.approx(0.44245082047274725, rel=1e-12)
    assert np.linalg.norm(EXACT) == pytest.approx(0.5128234916846627, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("level", "seen"), [(0.001, NODES), (0.05, NODES // 2)], ids=["small noise", "large noise"])
def test_the_posterior_is_the_exact_one(tmp_path, level, seen):
    matrix, measured = heat(profiles()), heat(EXACT)
    noise = level * np.linalg.norm(measured) / np.sqrt(NODES)
    observed = measured + noise * np.random.default_rng(0).standard_normal(NODES)
    observed[seen:] = np.nan
    np.save(tmp_path / "matrix.npy", matrix)
    model = f"""
    import numpy as np

    MATRIX = np.load({str(tmp_path / "matrix.npy")!r})

    def simulate(inputs, times, start):
        return (MATRIX[: len(times)] @ jnp.stack([inputs[f"w{{k}}"] for k in range({MODES})]))[:, None]
    """
    priors = {f"w{k}": {"normal": {"mean": 0.0, "standard_deviation": 1.0}} for k in range(MODES)}
    problem = problems.problem(tmp_path, model, priors, observed[:, None], f"{noise:.17g} K")

    part = matrix[:seen]
    covariance = np.linalg.inv(part.T @ part / noise**2 + np.eye(MODES))
    mean = covariance @ part.T @ observed[:seen] / noise**2
    posterior = calibrate_nuts(
        problem, NutsSettings(chains=2, draws=600, warmup=300, max_r_hat=1.02), 1, random_starts=1
    )
    assert [gate.name for gate in posterior.diagnostics.gates if not gate.passed] == []
    for k in range(MODES):
        draws = posterior.theta[..., problem.names.index(f"w{k}")]
        assert draws.mean() == pytest.approx(mean[k], abs=4.5 * problems.standard_error(draws))
        # The squares of 1,200 draws are worth 350 independent ones: 4.5 standard errors.
        assert draws.std() == pytest.approx(np.sqrt(covariance[k, k]), rel=4.5 / np.sqrt(2 * 350))
