"""Several windows that share the weights of a discrepancy in phase, against dense normals of all their samples.

Also where the simulator has an error in shapes whose weights channels share, as many as windows have, or fewer.
"""

import numpy as np
import pytest
from scipy import stats
from scipy.linalg import block_diag

from flightcal.compiled import Program
from flightcal.probability.discrepancy import MaternPrior, frequencies, in_phase
from flightcal.probability.likelihood import (
    Likelihood,
    Residuals,
    information,
    likelihood_calls,
    weights_given,
    window_memory,
)
from flightcal.probability.shapes import Shapes

from .residual_cases import CORRELATED, INDEPENDENT, Case

COUNTS = (40, 55, 30)
NO_ERROR = (0, 0, 0)
ERRORS = {"no": NO_ERROR, "all": (2, 2, 2), "some": (3, 0, 1)}
"""Shapes of each window's error, by the windows that have one."""
HARMONICS = 3
KINDS = {"independent": INDEPENDENT, "correlated": CORRELATED}


class Windows:
    """Windows of two channels, of which the second has no discrepancy; numbers of `Case`."""

    def __init__(self, kind, errors=NO_ERROR):
        rng = np.random.default_rng(1)
        self.numbers = Case((kind, kind), (True, False)).numbers
        self.residuals, self.memories = [], []
        for place, count in enumerate(COUNTS):
            seconds = np.cumsum(rng.uniform(50, 300, count))
            basis = in_phase(seconds / 5400.0 + 0.3 * place, HARMONICS)
            observed, simulated = 1.3 * rng.normal(size=(count, 2)), 0.3 * rng.normal(size=(count, 2))
            observed[[0, 7, 8], 0] = np.nan
            prior = MaternPrior(frequencies(HARMONICS), 2.5)
            valid = np.isfinite(observed).T.copy()
            error = 0.3 * np.random.default_rng(place).normal(size=(count, 2, errors[place]))
            # One shape is the first channel's alone.
            error[:, 1, 1:2] = 0.0
            shapes = Shapes(np.array([True, False]), basis, prior, error)
            self.residuals.append(Residuals(seconds, valid, (kind, kind), shapes))
            variance = np.linspace(0.5, 2.0, errors[place])
            self.memories.append(window_memory(observed, simulated, self.numbers.copy(), variance))
        self.calls = likelihood_calls(self.residuals, self.memories)
        self.program = Program(self.calls.rows)

    def noise(self, k, seconds):
        deviation, white, time = self.numbers[k, :3]
        if self.residuals[0].kinds[k] == INDEPENDENT:
            return deviation**2 * np.eye(len(seconds))
        apart = np.abs(seconds[:, None] - seconds)
        return white**2 * np.eye(len(seconds)) + deviation**2 * np.exp(-apart / time)

    def of_weights(self, k):
        """The basis of the weights at all windows' valid samples, and their variances."""
        basis = np.concatenate([window.shapes.basis[window.valid[k]] for window in self.residuals])
        return basis, self.residuals[0].shapes.prior.deviations(self.numbers[k, -2:]) ** 2

    def covariance(self, k):
        """Of all windows' valid residuals."""
        total = block_diag(*(self.noise(k, window.seconds[window.valid[k]]) for window in self.residuals))
        if k == 0:
            basis, variance = self.of_weights(k)
            total += basis * variance @ basis.T
        return total

    def of_channel(self, k, arrays):
        """Arrays [T, N, ...] of the windows, at a channel's valid samples."""
        return np.concatenate([a[w.valid[k], k] for a, w in zip(arrays, self.residuals, strict=True)])

    def dense(self):
        """The log likelihood, with a covariance between windows and channels."""
        residual = [memory.observed - memory.simulated for memory in self.memories]
        both = np.concatenate([self.of_channel(k, residual) for k in range(2)])
        return stats.multivariate_normal.logpdf(both, cov=self.covariance_of_all())

    def covariance_of_all(self):
        """Of all windows' valid residuals, of the one channel and then of the other."""
        bases = [terms.shapes.errors for terms in self.residuals]
        rows = [
            block_diag(*(basis[terms.valid[k], k] for basis, terms in zip(bases, self.residuals, strict=True)))
            for k in range(2)
        ]
        errors = np.concatenate(rows)
        variance = np.concatenate([memory.variance for memory in self.memories])
        return block_diag(self.covariance(0), self.covariance(1)) + errors * variance @ errors.T

    def run(self):
        for memory in self.memories:
            memory.numbers[:] = self.numbers
        assert self.program.run() == 0
        return sum(memory.value[0] for memory in self.memories)


@pytest.fixture(params=KINDS)
def exact(request):
    return Windows(KINDS[request.param])


@pytest.fixture(params=[("independent", "no"), ("correlated", "no"), ("independent", "all"), ("correlated", "some")])
def windows(request):
    """With an error of the simulator in some windows or all, too."""
    kind, errors = request.param
    return Windows(KINDS[kind], ERRORS[errors])


def test_the_log_likelihood_is_that_of_all_samples_together(windows):
    assert windows.run() == pytest.approx(windows.dense(), rel=1e-10)


def slope(windows, numbers, place):
    """By differences: of the log likelihood by one of the numbers that it reads."""
    sides = []
    for sign in (1.0, -1.0):
        numbers[place] += sign * 1e-5
        sides.append(windows.run())
        numbers[place] -= sign * 1e-5
    return (sides[0] - sides[1]) / 2e-5


def test_derivatives_by_the_errors_variances_are_those_of_differences(windows):
    windows.run()
    for memory in windows.memories:
        derivative = memory.variance_bar.copy()
        for j in range(len(derivative)):
            assert derivative[j] == pytest.approx(slope(windows, memory.variance, j), rel=1e-6, abs=1e-6), j


def test_derivatives_by_the_simulated_are_those_of_differences(windows):
    windows.run()
    for memory, terms in zip(windows.memories, windows.residuals, strict=True):
        derivative = memory.simulated_bar.copy()
        assert (derivative[~terms.valid.T] == 0.0).all()
        for index in list(np.ndindex(derivative.shape))[::5]:
            expected = slope(windows, memory.simulated, index)
            assert derivative[index] == pytest.approx(expected, rel=1e-6, abs=1e-6), index


def test_derivatives_by_the_numbers_are_those_of_differences(windows):
    windows.run()
    derivative = sum(memory.numbers_bar for memory in windows.memories)
    given = windows.numbers.copy()
    for index in np.ndindex(given.shape):
        if given[index] == 0.0:
            continue
        sides = []
        for sign in (1.0, -1.0):
            windows.numbers = given.copy()
            windows.numbers[index] *= 1.0 + sign * 1e-5
            sides.append(windows.run())
        expected = (sides[0] - sides[1]) / (2e-5 * given[index])
        assert derivative[index] == pytest.approx(expected, rel=1e-6, abs=1e-6), index


def test_what_windows_share_is_closed_between_their_phases(exact):
    forward, close, backward = exact.calls
    assert close
    assert [len(rows) for rows in backward] == [2, 2, 2]  # the channel's, and what ends a window
    before = exact.run()
    for rows in (*forward, close, *backward):
        Program(rows).run()
    assert sum(memory.value[0] for memory in exact.memories) == before


def test_weights_are_those_of_the_dense_conditional_normal(exact):
    arrays = ([getattr(m, name) for m in exact.memories] for name in ("observed", "simulated", "numbers"))
    found = weights_given(exact.residuals, *arrays)
    basis, variance = exact.of_weights(0)
    gain = variance[:, None] * basis.T @ np.linalg.inv(exact.covariance(0))
    mean = gain @ exact.of_channel(0, [memory.observed - memory.simulated for memory in exact.memories])
    covariance = np.diag(variance) - gain @ basis * variance
    for expected, factor in found:
        np.testing.assert_allclose(expected[0], mean, atol=1e-9 * np.abs(mean).max())
        np.testing.assert_allclose(factor[0] @ factor[0].T, covariance, atol=1e-9 * variance.max())
        assert not expected[1].any()


def test_the_information_is_that_of_the_dense_covariance(windows):
    rng = np.random.default_rng(5)
    jacobians = [rng.normal(size=(*w.valid.T.shape, 4)) for w in windows.residuals]
    derivatives = [rng.normal(size=(4, 6)) for _ in windows.residuals]
    by_all = [jacobian @ derivative for jacobian, derivative in zip(jacobians, derivatives, strict=True)]
    columns = np.concatenate([windows.of_channel(k, by_all) for k in range(2)])
    expected = columns.T @ np.linalg.solve(windows.covariance_of_all(), columns)
    given = ([getattr(memory, name) for memory in windows.memories] for name in ("numbers", "variance"))
    found = information(windows.residuals, jacobians, derivatives, *given)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("kind", KINDS.values())
def test_windows_that_share_no_weights_are_each_on_their_own(kind):
    """Each has the error of its simulator."""
    cases = [Case((kind, kind), (False, False)) for _ in range(2)]
    for case in cases:
        case.residuals = case.residuals.with_errors(np.random.default_rng(2).normal(size=(*case.observed.shape, 3)))
    memories = [
        window_memory(case.observed, case.simulated * scale, case.numbers, np.array([0.3, 1.1, 0.2]))
        for scale, case in zip((1, 2), cases, strict=True)
    ]
    calls = likelihood_calls([case.residuals for case in cases], memories)
    assert not calls.close
    Program(calls.rows).run()
    for case, memory in zip(cases, memories, strict=True):
        alone = Likelihood([case.residuals], case.numbers.shape[1])
        value, (bars,) = alone((memory.observed, memory.simulated, memory.numbers, memory.variance))
        assert memory.value[0] == value
        np.testing.assert_array_equal(memory.simulated_bar, bars.simulated)
        np.testing.assert_array_equal(memory.numbers_bar, bars.numbers)
