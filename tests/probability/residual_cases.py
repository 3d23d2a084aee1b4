"""Residual models for the tests, and what they say by dense matrices and by scipy's distributions."""

import numpy as np
from scipy import stats

from flightcal.probability import discrepancy
from flightcal.probability.likelihood import Likelihood, Residuals
from flightcal.probability.noise.ar1 import Correlated
from flightcal.probability.noise.iid import Independent
from flightcal.probability.noise.rounded import Rounded
from flightcal.probability.noise.student import CorrelatedStudent, Student
from flightcal.probability.shapes import Shapes

SAMPLES = 70
NOISE = {
    "standard_deviation": (0.5, 0.7),
    "white": (0.2, 0.3),
    "correlation_time": (700.0, 300.0),
    "degrees_of_freedom": (5.0, 3.0),
    "quantisation": (0.5, 0.3),
}
"""Of each channel."""
DISCREPANCY = np.array([[1.1, 0.2], [0.6, 0.3]])
"""Amplitude and lengthscale."""
HARMONICS = 3
INDEPENDENT, CORRELATED, STUDENT, CORRELATED_STUDENT, ROUNDED = (
    Independent(), Correlated(), Student(), CorrelatedStudent(), Rounded()
)  # fmt: skip


def log_likelihood(residuals, observed, simulated, numbers, variance=()):
    """Of one window: the log likelihood, and its derivatives by simulated, numbers and variances."""
    value, (bars,) = Likelihood([residuals], numbers.shape[1])((observed, simulated, numbers, variance))
    return value, *bars


def iid_log_likelihood(observed, simulated, noise):
    """Independent normal noise, as published, with one standard deviation per channel [N], K.

    Returns the log likelihood and its derivatives by `simulated` [T, N] and by `noise` [N].
    """
    valid = np.isfinite(observed)
    scaled = np.where(valid, observed - simulated, 0.0) / noise
    squares, samples = np.einsum("tn,tn->n", scaled, scaled), valid.sum(axis=0)
    value = -0.5 * squares - samples * (np.log(noise) + 0.5 * np.log(2.0 * np.pi))
    return float(value.sum()), scaled / noise, (squares - samples) / noise


class Case:
    """Two channels with gaps, at uneven times."""

    def __init__(self, kinds, discrepant, smoothness=2.5):
        rng = np.random.default_rng(0)
        self.seconds = np.cumsum(rng.uniform(20, 200, SAMPLES))
        self.observed = 1.3 * rng.normal(size=(SAMPLES, 2))
        self.observed[[0, 5, 6, 7, 30], 0] = np.nan
        self.observed[[59, 12], 1] = np.nan
        self.simulated = 0.3 * rng.normal(size=(SAMPLES, 2))
        noise = np.zeros((2, 3))
        for k, kind in enumerate(kinds):
            noise[k, : len(kind.names)] = [NOISE[name][k] for name in kind.names]
        self.numbers = np.concatenate([noise, DISCREPANCY], axis=1)
        self.smoothness = smoothness
        self.basis = discrepancy.in_phase(self.seconds / 5400.0, HARMONICS)
        valid = np.isfinite(self.observed).T.copy()
        prior = discrepancy.MaternPrior(discrepancy.frequencies(HARMONICS), smoothness)
        shapes = Shapes(np.array(discrepant), self.basis, prior)
        self.residuals = Residuals(self.seconds, valid, tuple(kinds), shapes)

    def valid(self, channel):
        return np.isfinite(self.observed[:, channel])

    def residual(self, channel):
        return (self.observed - self.simulated)[self.valid(channel), channel]

    def prior_variances(self, channel):
        """Of the weights [m]: Matern spectral densities by the book (Rasmussen & Williams 2006, eq. 4.15)."""
        size, length = self.numbers[channel, -2:]
        w, nu = discrepancy.frequencies(HARMONICS), self.smoothness
        density = (2 * nu / length**2 + w**2) ** (-nu - 0.5)
        both_signs = np.where(w == 0, 1, 2) * density
        return size**2 * both_signs / both_signs[: 1 + HARMONICS].sum()

    def noise_covariance(self, channel, seconds):
        deviation, white, time = self.numbers[channel, :3]
        if self.residuals.kinds[channel] == INDEPENDENT:
            return deviation**2 * np.eye(len(seconds))
        apart = np.abs(seconds[:, None] - seconds)
        return white**2 * np.eye(len(seconds)) + deviation**2 * np.exp(-apart / time)

    def covariance(self, channel):
        valid = self.valid(channel)
        total = self.noise_covariance(channel, self.seconds[valid])
        if self.residuals.discrepant[channel]:
            basis = self.basis[valid]
            total = total + basis * self.prior_variances(channel) @ basis.T
        return total

    def dense(self):
        """The log likelihood of both channels."""
        return sum(self._dense(channel) for channel in range(2))

    def _dense(self, channel):
        kind, residual = self.residuals.kinds[channel], self.residual(channel)
        named = dict(zip(kind.names, self.numbers[channel], strict=False))
        deviation, time, degrees, step = (
            named.get(name) for name in ("standard_deviation", "correlation_time", "degrees_of_freedom", "quantisation")
        )
        if kind in (INDEPENDENT, CORRELATED):
            return stats.multivariate_normal.logpdf(residual, np.zeros(len(residual)), self.covariance(channel))
        if kind == STUDENT:
            return stats.t(degrees, 0, deviation).logpdf(residual).sum()
        if kind == CORRELATED_STUDENT:
            decay = np.exp(-np.diff(self.seconds[self.valid(channel)]) / time)
            decay = np.concatenate([[0.0], decay])
            innovations = residual - decay * np.concatenate([[0.0], residual[:-1]])
            return stats.t(degrees, 0, deviation * np.sqrt(1 - decay**2)).logpdf(innovations).sum()
        assert kind == ROUNDED
        above = stats.norm.logsf((np.abs(residual) - step / 2) / deviation)
        beyond = stats.norm.logsf((np.abs(residual) + step / 2) / deviation)
        return (above + np.log1p(-np.exp(beyond - above)) - np.log(step)).sum()
