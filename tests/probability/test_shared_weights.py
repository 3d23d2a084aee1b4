"""Several windows that share the weights of a discrepancy in phase, against dense normals of all their samples."""

import numpy as np
import pytest
from scipy import stats

from flightcal.compiled import Program
from flightcal.probability.discrepancy import MaternPrior, PhaseBasis, TimeBasis
from flightcal.probability.likelihood import Likelihood, Residuals, likelihood_calls, window_memory
from flightcal.probability.shapes import Shapes, products_at

from .residual_cases import CORRELATED, INDEPENDENT, Case

COUNTS = (40, 55, 30)
PARTS = {"phase": (0, 3), "time and phase": (8, 3)}
KINDS = {"independent": INDEPENDENT, "correlated": CORRELATED}


class Windows:
    """Windows of two channels, of which the second has no discrepancy; numbers of `Case`."""

    def __init__(self, kind, in_time, harmonics):
        rng = np.random.default_rng(1)
        self.numbers = Case((kind, kind), (True, False)).numbers
        self.in_time, self.residuals, self.memories = in_time, [], []
        for place, count in enumerate(COUNTS):
            seconds = np.cumsum(rng.uniform(50, 300, count))
            time, phase = TimeBasis(seconds.mean(), seconds[-1], in_time), PhaseBasis(harmonics)
            basis = np.concatenate([time.at(seconds), phase.at(seconds / 5400.0 + 0.3 * place)], axis=1)
            observed, simulated = 1.3 * rng.normal(size=(count, 2)), 0.3 * rng.normal(size=(count, 2))
            observed[[0, 7, 8], 0] = np.nan
            frequency = np.concatenate([time.frequencies, phase.frequencies])
            prior = MaternPrior(in_time, frequency, np.array([1.5, 2.5]))
            valid = np.isfinite(observed).T.copy()
            shapes = Shapes(np.array([True, False]), basis, products_at(basis, valid), in_time, prior)
            self.residuals.append(Residuals(seconds, valid, (kind, kind), shapes))
            self.memories.append(window_memory(observed, simulated, self.numbers.copy()))
        self.calls = likelihood_calls(self.residuals, self.memories)
        self.program = Program(self.calls.rows)

    def noise(self, k, seconds):
        deviation, white, time = self.numbers[k, :3]
        if self.residuals[0].kinds[k] == INDEPENDENT:
            return deviation**2 * np.eye(len(seconds))
        apart = np.abs(seconds[:, None] - seconds)
        return white**2 * np.eye(len(seconds)) + deviation**2 * np.exp(-apart / time)

    def dense(self):
        """The log likelihood, with a covariance between windows."""
        value = 0.0
        for k in range(2):
            valid = [window.valid[k] for window in self.residuals]
            residual = np.concatenate(
                [(m.observed - m.simulated)[own, k] for m, own in zip(self.memories, valid, strict=True)]
            )
            covariance, first = np.zeros((len(residual),) * 2), 0
            bases = [window.shapes.basis[own] for window, own in zip(self.residuals, valid, strict=True)]
            for window, own, basis in zip(self.residuals, valid, bases, strict=True):
                here = slice(first, first + len(basis))
                covariance[here, here] = self.noise(k, window.seconds[own])
                if k == 0:
                    variance = window.shapes.prior.deviations(self.numbers[0, -4:]) ** 2
                    covariance[here, here] += (
                        basis[:, : self.in_time] * variance[: self.in_time] @ basis[:, : self.in_time].T
                    )
                first = here.stop
            if k == 0:
                shared = np.concatenate(bases)[:, self.in_time :]
                covariance += shared * variance[self.in_time :] @ shared.T
            value += stats.multivariate_normal.logpdf(residual, cov=covariance)
        return value

    def run(self):
        for memory in self.memories:
            memory.numbers[:] = self.numbers
        assert self.program.run() == 0
        return sum(memory.value[0] for memory in self.memories)


@pytest.fixture(params=PARTS)
def parts(request):
    return PARTS[request.param]


@pytest.fixture(params=KINDS)
def windows(request, parts):
    return Windows(KINDS[request.param], *parts)


def test_the_log_likelihood_is_that_of_all_samples_together(windows):
    assert windows.run() == pytest.approx(windows.dense(), rel=1e-10)


def test_derivatives_by_the_simulated_are_those_of_differences(windows):
    windows.run()
    for memory, own in zip(windows.memories, windows.residuals, strict=True):
        derivative = memory.simulated_bar.copy()
        assert (derivative[~own.valid.T] == 0.0).all()
        for index in list(np.ndindex(derivative.shape))[::5]:
            sides = []
            for sign in (1.0, -1.0):
                memory.simulated[index] += sign * 1e-5
                sides.append(windows.run())
                memory.simulated[index] -= sign * 1e-5
            assert derivative[index] == pytest.approx((sides[0] - sides[1]) / 2e-5, rel=1e-6, abs=1e-6), index


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


def test_what_windows_share_is_closed_between_their_phases(windows):
    forward, close, backward = windows.calls
    assert close
    assert [len(rows) for rows in backward] == [2, 2, 2]  # the channel's, and what ends a window
    before = windows.run()
    for rows in (*forward, close, *backward):
        Program(rows).run()
    assert sum(memory.value[0] for memory in windows.memories) == before


@pytest.mark.parametrize("kind", KINDS.values())
def test_windows_that_share_no_weights_are_each_on_their_own(kind):
    cases = [Case((kind, kind), (True, True), parts=("time",)) for _ in range(2)]
    memories = [
        window_memory(case.observed, case.simulated * scale, case.numbers)
        for scale, case in zip((1, 2), cases, strict=True)
    ]
    calls = likelihood_calls([case.residuals for case in cases], memories)
    assert not calls.close
    Program(calls.rows).run()
    for case, memory in zip(cases, memories, strict=True):
        alone = Likelihood(case.residuals, case.numbers.shape[1])(memory.observed, memory.simulated, memory.numbers)
        assert memory.value[0] == alone[0]
        np.testing.assert_array_equal(memory.simulated_bar, alone[1])
        np.testing.assert_array_equal(memory.numbers_bar, alone[2])
