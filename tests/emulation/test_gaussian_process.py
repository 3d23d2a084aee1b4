"""Gaussian processes with a trend, against the textbook's dense formulas and finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from flightcal.emulation import gaussian_process
from flightcal.emulation.gaussian_process import fit, matern, trend
from flightcal.errors import FlightcalError


@pytest.fixture(scope="module")
def case():
    rng = np.random.default_rng(4)
    inputs = rng.standard_normal((60, 3))
    return inputs, targets_at(inputs), fit(inputs, targets_at(inputs))


def targets_at(inputs):
    return np.stack(
        [np.sin(inputs @ [0.8, -0.5, 0.3]), np.cos(1.5 * inputs[:, 0]) * inputs[:, 1] + 40.0, inputs @ [1.0, 2.0, 3.0]],
        axis=1,
    )


def textbook(processes, targets, output, x):
    """Mean and variance at x [P, d] from explicit inverses: Rasmussen and Williams (2006), eqs. 2.41 and 2.42."""
    lengthscales, nugget = processes.lengthscales[output], processes.nugget[output]
    scale = processes.scale[output]
    precision = np.linalg.inv(matern(processes.inputs, processes.inputs, lengthscales) + nugget * np.eye(len(targets)))
    terms, new_terms = trend(processes.inputs), trend(x)
    cross = matern(processes.inputs, x, lengthscales)
    of_trend = np.linalg.inv(terms.T @ precision @ terms)
    beta = of_trend @ terms.T @ precision @ targets[:, output]
    unexplained = new_terms.T - terms.T @ precision @ cross
    mean = new_terms @ beta + cross.T @ precision @ (targets[:, output] - terms @ beta)
    spread = 1.0 + nugget - np.diag(cross.T @ precision @ cross) + np.diag(unexplained.T @ of_trend @ unexplained)
    return mean, scale * spread


def test_the_prediction_is_the_textbooks(case):
    _, targets, processes = case
    x = np.random.default_rng(5).standard_normal((20, 3))
    means, variances = (np.array(part) for part in zip(*map(processes.predict, x), strict=True))
    for output in range(2):
        mean, variance = textbook(processes, targets, output, x)
        np.testing.assert_allclose(means[:, output], mean, atol=1e-5)
        np.testing.assert_allclose(variances[:, output], variance, rtol=1e-3, atol=1e-6 * processes.scale[output])


def test_an_output_that_the_trend_explains_is_predicted_exactly(case):
    _, _, processes = case
    x = np.array([0.3, -1.0, 2.0])
    assert processes.predict(x)[0][2] == pytest.approx(x @ [1.0, 2.0, 3.0], abs=1e-8)


def test_the_derivatives_agree_with_finite_differences(case):
    inputs, _, processes = case
    mean_bar, variance_bar = np.array([1.0, -2.0, 0.5]), np.array([300.0, 200.0, 1.0])

    def value(x):
        mean, variance = processes.predict(x)
        return mean @ mean_bar + variance @ variance_bar

    for x in (np.array([0.2, -0.4, 0.9]), np.array([2.5, 2.0, -3.0]), inputs[7] + 0.01):
        mean, variance, cotangent = processes.linearise(x)
        assert mean @ mean_bar + variance @ variance_bar == pytest.approx(value(x), rel=1e-12)
        steps = 1e-5 * np.eye(3)
        differences = [(value(x + step) - value(x - step)) / 2e-5 for step in steps]
        np.testing.assert_allclose(cotangent(mean_bar, variance_bar), differences, rtol=2e-4, atol=1e-4)


def test_leaving_a_run_out_is_predicting_it_from_the_others(case):
    inputs, targets, processes = case
    error, variance = processes.leave_one_out()
    for run in (0, 31):
        others = np.arange(len(inputs)) != run
        for output in range(2):
            arguments = processes.lengthscales[output], processes.nugget[output]
            terms = trend(inputs[others])
            fields = gaussian_process._condition(inputs[others], terms, targets[others, output], *arguments)
            alone = gaussian_process.GaussianProcesses(
                inputs[others],
                *(np.ascontiguousarray(np.stack([field])) for field in fields),
            )
            mean, its_variance = alone.predict(inputs[run])
            assert targets[run, output] - mean[0] == pytest.approx(error[run, output], rel=1e-3, abs=1e-7)
            # Its own estimate of the scale differs by the run that is left out.
            expected = its_variance[0] * processes.scale[output] / alone.scale[0]
            assert variance[run, output] == pytest.approx(expected, rel=1e-3)


def test_the_covariance_of_predictions_has_their_variances_on_its_diagonal(case):
    _, _, processes = case
    x = np.random.default_rng(6).standard_normal((5, 3))
    covariance = processes.covariance(x)
    for point in range(5):
        variance = covariance[:, point, point] + processes.scale * processes.nugget
        np.testing.assert_allclose(processes.predict(x[point])[1], variance, rtol=1e-6, atol=1e-9)
    assert (np.linalg.eigvalsh(covariance[0]) > -1e-8 * processes.scale[0]).all()


def test_the_likelihood_that_is_climbed_is_the_restricted_one():
    rng = np.random.default_rng(1)
    inputs, target = rng.standard_normal((25, 2)), rng.standard_normal(25)
    terms = trend(inputs)
    orthonormal = np.linalg.qr(terms)[0]
    squares = np.moveaxis((inputs[:, None] - inputs[None]) ** 2, -1, 0)

    def dense(lengthscales, nugget):
        """Minus the log density of contrasts that are free of the trend (Patterson and Thompson 1971)."""
        contrasts = np.linalg.svd(terms)[0][:, 3:]
        covariance = contrasts.T @ (matern(inputs, inputs, lengthscales) + nugget * np.eye(25)) @ contrasts
        seen = contrasts.T @ target
        return 0.5 * np.linalg.slogdet(covariance)[1] + 0.5 * 22 * np.log(seen @ np.linalg.solve(covariance, seen))

    points = [np.array([0.5, 2.0, 1e-2]), np.array([3.0, 0.7, 1e-4])]
    ours = [float(gaussian_process._minus_log_likelihood(np.log(p), squares, orthonormal, target)[0]) for p in points]
    theirs = [dense(p[:2], p[2]) for p in points]
    assert ours[1] - ours[0] == pytest.approx(theirs[1] - theirs[0], rel=1e-8)


def minus_log_likelihood_in_jax(logarithms, inputs, orthonormal, residual):
    """The same by triangular solves, for JAX to differentiate."""
    difference = (inputs[:, None] - inputs[None]) * jnp.exp(-logarithms[:-1])
    square = jnp.sum(difference**2, axis=-1)
    # A root's derivative at zero is infinite.
    distance = jnp.sqrt(5.0 * jnp.where(square > 0.0, square, 1.0)) * (square > 0.0)
    correlation = (1.0 + distance + 5.0 / 3.0 * square) * jnp.exp(-distance)
    factor = jnp.linalg.cholesky(correlation + jnp.exp(logarithms[-1]) * jnp.eye(len(inputs)))
    whitened = jax.scipy.linalg.solve_triangular(factor, orthonormal, lower=True)
    target = jax.scipy.linalg.solve_triangular(factor, residual, lower=True)
    inner = jnp.linalg.cholesky(whitened.T @ whitened)
    explained = jax.scipy.linalg.solve_triangular(inner, whitened.T @ target, lower=True)
    freedom = len(inputs) - orthonormal.shape[1]
    return (
        0.5 * freedom * jnp.log(target @ target - explained @ explained)
        + jnp.log(jnp.diagonal(factor)).sum()
        + jnp.log(jnp.diagonal(inner)).sum()
    )


@pytest.mark.parametrize(
    ("lengthscale", "nugget", "tolerance"), [(3.0, 1e-6, 1e-9), (0.7, 1e-2, 1e-12), (30.0, 1e-7, 1e-7)]
)
def test_the_gradient_that_is_climbed_by_is_that_of_jax(lengthscale, nugget, tolerance):
    rng = np.random.default_rng(3)
    inputs = rng.standard_normal((40, 4))
    orthonormal = np.linalg.qr(trend(inputs))[0]
    target = np.sin(inputs @ [0.8, -0.5, 0.3, 1.0]) + 0.01 * rng.standard_normal(40)
    residual = target - orthonormal @ (orthonormal.T @ target)
    squares = np.moveaxis((inputs[:, None] - inputs[None]) ** 2, -1, 0)
    x = np.log([lengthscale, 2.0 * lengthscale, 0.5 * lengthscale, lengthscale, nugget])
    value, gradient = gaussian_process._minus_log_likelihood(x, squares, orthonormal, residual)
    with jax.enable_x64(True):
        expected, by_jax = jax.value_and_grad(minus_log_likelihood_in_jax)(x, inputs, orthonormal, residual)
    assert value == pytest.approx(float(expected), rel=tolerance)
    np.testing.assert_allclose(gradient, by_jax, rtol=0, atol=tolerance * np.abs(by_jax).max())


def test_intervals_hold_on_a_process_of_the_kind_that_is_assumed():
    rng = np.random.default_rng(8)
    inputs = rng.standard_normal((160, 2))
    lengthscales, nugget = np.array([0.7, 2.0]), 1e-3
    factor = np.linalg.cholesky(matern(inputs, inputs, lengthscales) + nugget * np.eye(160))
    targets = factor @ rng.standard_normal((160, 6)) + 5.0 * inputs[:, :1]
    processes = fit(inputs[:80], targets[:80])
    means, variances = (np.array(part) for part in zip(*map(processes.predict, inputs[80:]), strict=True))
    ratio = (targets[80:] - means) / np.sqrt(variances)
    # 480 values, of which those of one output share their hyper-parameters.
    assert 0.90 < np.mean(np.abs(ratio) < 1.96) < 0.99
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.2)
    assert np.median(processes.lengthscales[:, 0]) == pytest.approx(0.7, rel=0.5)


def test_too_few_runs_are_refused():
    with pytest.raises(FlightcalError, match="found 5 finished runs, expected at least 8 for 3 uncertain inputs"):
        fit(np.zeros((5, 3)), np.zeros((5, 1)))
