"""The peer filter is exact where the network is linear, and flightcal's simulation where nothing is random."""

import sys
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import multivariate_normal, norm

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.peers import ekf

from benchmarks import forecasts, problem

pytestmark = pytest.mark.slow
"""The filter is compiled for a quarter of a minute."""

_TIMES = np.array([0.0, 60.0, 90.0, 240.0, 300.0, 700.0, 760.0])
_TAU, _PROCESS, _NOISE = 400.0, 0.03, 0.4  # s, K/s^0.5, K
_SENSOR = np.array([0])


def _run(A, heat, process, mean, covariance, sensor, noise, observed):
    found = ekf._filter(_TIMES, A, np.zeros_like(A), heat, process, mean, covariance, sensor, noise, observed)
    return ekf.Filtered(*found)


def test_one_linear_node_is_filtered_as_an_ornstein_uhlenbeck_process():
    rng = np.random.default_rng(1)
    observed = 290.0 + rng.standard_normal((len(_TIMES), 1))
    observed[3] = np.nan
    ends = np.array([[0.5, 0.7], [0.7, 0.7], [0.7, 0.1], [0.3, 0.2], [0.2, 0.9], [0.9, 0.8]])  # K/s
    found = _run(
        np.array([[-1.0 / _TAU]]), ends[..., None], np.array([_PROCESS]), np.array([291.0]), np.array([[4.0]]),
        _SENSOR, np.array([_NOISE]), observed,
    )  # fmt: skip

    mean, variance, log_likelihood = 291.0, 4.0, 0.0
    for k, y in enumerate(observed[:, 0]):
        if k > 0:
            h = _TIMES[k] - _TIMES[k - 1]
            first, last = ends[k - 1]
            slope, decay = (last - first) / h, np.exp(-h / _TAU)
            # With linear heat the node tends to a line, which lags by tau.
            mean = decay * (mean - _TAU * (first - slope * _TAU)) + _TAU * (first + slope * (h - _TAU))
            variance = decay**2 * variance + 0.5 * _TAU * _PROCESS**2 * (1.0 - decay**2)
        assert found.mean[k, 0] == pytest.approx(mean, abs=1e-8)
        assert found.variance[k, 0] == pytest.approx(variance + _NOISE**2, abs=1e-8)
        if np.isfinite(y):
            log_likelihood += norm.logpdf(y, mean, np.sqrt(variance + _NOISE**2))
            gain = variance / (variance + _NOISE**2)
            mean, variance = mean + gain * (y - mean), (1.0 - gain) * variance
    assert found.log_likelihood == pytest.approx(log_likelihood, abs=1e-8)


def test_the_likelihood_of_two_linear_nodes_is_that_of_one_dense_gaussian():
    A = np.array([[-1.0 / 300.0, 1.0 / 400.0], [1.0 / 900.0, -1.0 / 700.0]])
    process, noise = np.array([0.02, 0.05]), np.array([0.3, 0.6])
    start, spread = np.array([290.0, 280.0]), np.array([[4.0, 1.0], [1.0, 9.0]])
    rng = np.random.default_rng(2)
    observed = 288.0 + rng.standard_normal((len(_TIMES), 2))
    observed[2, 0] = np.nan
    heat = np.zeros((len(_TIMES) - 1, 2, 2))
    found = _run(A, heat, process, start, spread, np.array([0, 1]), noise, observed)

    moved = [expm(A * t) for t in _TIMES]

    def covariance(j: int, k: int):
        """Of the states at two times: the start's, and what entered until the earlier one (Gauss-Legendre)."""
        earlier = min(_TIMES[j], _TIMES[k])
        nodes, weights = np.polynomial.legendre.leggauss(40)
        entered = [
            w * expm(A * (_TIMES[j] - s)) @ np.diag(process**2) @ expm(A * (_TIMES[k] - s)).T
            for s, w in zip(0.5 * earlier * (nodes + 1.0), 0.5 * earlier * weights, strict=True)
        ]
        return moved[j] @ spread @ moved[k].T + sum(entered)

    whole = np.block([[covariance(j, k) for k in range(len(_TIMES))] for j in range(len(_TIMES))])
    whole += np.diag(np.tile(noise**2, len(_TIMES)))
    valid = np.isfinite(observed.ravel())
    mean = np.concatenate([transition @ start for transition in moved])[valid]
    expected = multivariate_normal(mean, whole[np.ix_(valid, valid)]).logpdf(observed.ravel()[valid])
    assert found.log_likelihood == pytest.approx(expected, abs=1e-8)


@cache
def _without_heaters():
    """flightcal's problem of the benchmarks without its heater and in short steps, and its telemetry's truth."""
    written = problem.content()
    written["simulator"]["step"] = "5 s"
    del written["simulator"]["heaters"], written["parameters"]["heater_power"]
    del written["telemetry"]["channels"]["heater_status"], written["observations"]["heater_status"]
    truth = {name: value for name, value in problem.TRUTH.items() if name != "heater_power"}
    with tempfile.TemporaryDirectory() as folder:
        made, theta = problem.make_problem(written, truth, Path(folder))
        return made, theta, ekf.record_of(made.windows[0], telemetry=None)


def test_without_process_noise_the_mean_is_flightcals_simulation():
    made, theta, record = _without_heaters()
    window = made.windows[0]
    inside = theta[window.simulated]
    nodes = record.initial.shape[1]
    equations = record.equations(inside[: record.parameters], np.zeros(nodes))
    equations = equations._replace(mean=inside[record.parameters :], covariance=np.zeros((nodes, nodes)))
    found = record.filtered(equations, np.ones(nodes), np.full_like(record.observed, np.nan))
    np.testing.assert_allclose(found.mean[record.sampled], window.simulate(theta).temperatures, rtol=0, atol=0.003)


def test_a_forecast_knows_nothing_after_its_origin():
    _, theta, record = _without_heaters()
    nodes = record.initial.shape[1]
    values = np.concatenate([theta[: record.parameters], np.full(nodes, 1e-3), np.full(nodes, 0.1)])
    fitted = ekf.Fit((), values, ())
    before = ekf.forecast(record, fitted, 50)
    record.observed[record.sampled[51] :] += 5.0
    after = ekf.forecast(record, fitted, 50)
    record.observed[record.sampled[51] :] -= 5.0
    np.testing.assert_array_equal(before.mean, after.mean)
    assert (before.variance[record.sampled[60]] > before.variance[record.sampled[51]]).sum() >= nodes - 1


def test_scores_of_draws_tend_to_those_of_their_normal_distribution():
    rng = np.random.default_rng(3)
    mean, deviation = rng.standard_normal((5, 3)), rng.uniform(0.5, 1.5, (5, 3))
    observed = mean + 1.5 * rng.standard_normal(mean.shape)
    exact = forecasts.of_normal(observed, mean, deviation**2)
    drawn = forecasts.of_draws(observed, mean + deviation * rng.standard_normal((20000, *mean.shape)))
    # The score's Monte Carlo deviation is below that of the mean distance, 1.5 K / sqrt(20000) = 0.01 K.
    np.testing.assert_allclose(drawn.crps, exact.crps, rtol=0, atol=0.04)
    assert (drawn.covered == exact.covered).mean() > 0.9


def test_origins_have_telemetry_before_and_at_their_horizon_and_follow_the_training():
    times = np.datetime64("2024-01-01") + np.arange(0, 400) * np.timedelta64(60, "s")
    valid = np.ones(400, bool)
    valid[250:260] = False
    minutes = np.timedelta64(60, "s")
    pairs = forecasts.targets(times, valid, 30 * minutes, trained=times[150], known=10 * minutes, count=8)
    assert len(pairs) == 8
    assert (pairs[:, 1] - pairs[:, 0] == 30).all()
    assert pairs[0, 0] == 150
    assert pairs[-1, 1] == 399
    assert all(valid[i - 10 : i + 1].all() and valid[j] for i, j in pairs)
