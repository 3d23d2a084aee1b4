"""Leaving blocks out: against dense conditional normals, and against a posterior whose exact answer is known."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from flightcal.problem import build_window
from flightcal.validation.block_loo import block_log_likelihood, blocks_of, leave_blocks_out
from tests import small


def conditional(residual, covariance, block):
    """log p(block | others) of a zero-mean normal, by the formula of conditioning."""
    others = ~block
    gain = np.linalg.solve(covariance[np.ix_(others, others)], covariance[np.ix_(others, block)]).T
    mean = gain @ residual[others]
    spread = covariance[np.ix_(block, block)] - gain @ covariance[np.ix_(others, block)]
    return multivariate_normal(mean, spread).logpdf(residual[block])


@pytest.mark.parametrize("model", ["iid", "ar1"])
def test_a_block_is_predicted_from_all_other_samples(tmp_path, model):
    written = small.content()
    written["windows"]["train"]["end"] = "2024-03-01T02:00:00"
    noise = {"model": model, "standard_deviation": "0.1 K"} | ({"correlation_time": "400 s"} if model == "ar1" else {})
    del written["observations"]["panel_temp"]["noise"]
    written["noise"] = noise
    scenario, data = small.closed_loop(tmp_path, written)
    data["body_temp"][30:45] = np.nan
    problem = build_window(scenario, data, "train")
    theta = small.median(problem)
    for name, value in (small.TRUTH | {"initial.body": 285.0, "initial.panel": 262.0}).items():
        if name in problem.names:
            theta[problem.names.index(name)] = value
    blocks = blocks_of(problem.times, small.PERIOD)
    assert np.bincount(blocks).tolist() == [23, 22, 23, 22, 30]
    found = block_log_likelihood(problem, theta[None], blocks)[0]
    seconds = (problem.times - problem.times[0]) / np.timedelta64(1, "s")
    simulated = problem.simulate(theta).temperatures
    expected = np.zeros(5)
    for k in range(2):
        valid = problem.valid[:, k]
        residual = (problem.observed - simulated)[valid, k]
        gaps = np.abs(seconds[valid, None] - seconds[valid])
        covariance = 0.01 * (np.exp(-gaps / 400.0) if model == "ar1" else np.eye(len(gaps)))
        for b in range(5):
            if (blocks[valid] == b).any():
                expected[b] += conditional(residual, covariance, blocks[valid] == b)
    assert found == pytest.approx(expected, rel=1e-8)


def test_the_density_of_left_out_blocks_is_that_of_the_posterior_without_them():
    # y ~ N(mu, 1) with a flat prior of mu, in blocks of ten: y_b | y_-b is normal around the others' mean.
    rng = np.random.default_rng(1)
    values = rng.normal(size=(12, 10))
    draws = rng.normal(values.mean(), 1 / np.sqrt(values.size), 20_000)
    found = leave_blocks_out(norm.logpdf(values[None], draws[:, None, None]).sum(axis=2))
    expected = []
    for b in range(12):
        others = np.delete(values, b, axis=0)
        spread = np.eye(10) + np.ones((10, 10)) / others.size
        expected.append(multivariate_normal(np.full(10, others.mean()), spread).logpdf(values[b]))
    # Importance sampling from 20,000 draws.
    assert found.of_blocks == pytest.approx(expected, abs=0.03)
    assert found.density == pytest.approx(sum(expected), abs=0.1)
    assert found.unreliable == 0


def test_draws_that_could_not_be_simulated_are_left_out():
    values = np.random.default_rng(2).normal(size=(400, 3))
    failed = np.insert(values, 17, np.nan, axis=0)
    np.testing.assert_array_equal(leave_blocks_out(failed).of_blocks, leave_blocks_out(values).of_blocks)


def test_a_short_last_block_joins_the_one_before():
    times = np.datetime64("2024-03-01", "ns") + 60 * np.arange(0, 185) * np.timedelta64(1, "s")
    assert np.bincount(blocks_of(times, 10800.0)).tolist() == [45, 45, 45, 50]


def test_a_block_without_a_valid_sample_is_no_block(tmp_path):
    scenario, data = small.closed_loop(tmp_path)
    for name in ("body_temp", "panel_temp"):
        data[name][20:70] = np.nan
    problem = build_window(scenario, data, "train")
    thetas = small.median(problem) + 1e-3 * np.random.default_rng(1).normal(size=(40, 1))
    blocks = blocks_of(problem.times, small.PERIOD)
    without = [b for b in range(blocks.max() + 1) if not problem.valid[blocks == b].any()]
    assert without
    found = block_log_likelihood(problem, thetas, blocks)
    assert found.shape[1] == blocks.max() + 1 - len(without)
    assert np.isfinite(leave_blocks_out(found).density)
