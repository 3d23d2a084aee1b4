import numpy as np
import pytest
import scipy.stats

from flightcal.probability.priors import Priors, Tilt, signed
from flightcal.scenario import Beta, HalfNormal, HalfStudentT, LogNormal, Normal, TruncatedNormal, Uniform

SIGMA = np.log(2.5)


class HalfStudent:
    """The reference for half of Student's t: SciPy has the whole one alone."""

    whole = scipy.stats.t(3.0, scale=2.0)

    def logpdf(self, theta):
        return np.log(2.0) + self.whole.logpdf(theta)

    def ppf(self, p):
        return self.whole.ppf(0.5 + 0.5 * np.asarray(p))

    def cdf(self, theta):
        return 2.0 * self.whole.cdf(theta) - 1.0

    def median(self):
        return self.ppf(0.5)

    def support(self):
        return 0.0, np.inf


CASES = {
    "absorptivity": (Uniform(lower=0.05, upper=0.45), scipy.stats.uniform(0.05, 0.4)),
    "bias": (Normal(mean=-3.0, standard_deviation=0.5), scipy.stats.norm(-3.0, 0.5)),
    "emissivity": (
        TruncatedNormal(mean=0.8, standard_deviation=0.2, lower=0.5, upper=1.0),
        scipy.stats.truncnorm(-1.5, 1.0, 0.8, 0.2),
    ),
    "in_upper_tail": (
        TruncatedNormal(mean=0.0, standard_deviation=1.0, lower=7.0, upper=12.0),
        scipy.stats.truncnorm(7.0, 12.0),
    ),
    "in_lower_tail": (
        TruncatedNormal(mean=0.0, standard_deviation=2.0, lower=-20.0, upper=-12.0),
        scipy.stats.truncnorm(-10.0, -6.0, 0.0, 2.0),
    ),
    "hardly_cut": (
        TruncatedNormal(mean=2.0, standard_deviation=0.5, lower=-30.0, upper=40.0),
        scipy.stats.truncnorm(-64.0, 76.0, 2.0, 0.5),
    ),
    "link": (LogNormal(median=0.8, factor=2.5), scipy.stats.lognorm(SIGMA, scale=0.8)),
    "second_absorptivity": (Uniform(lower=-10.0, upper=300.0), scipy.stats.uniform(-10.0, 310.0)),
    "noise": (HalfNormal(scale=2.0), scipy.stats.halfnorm(scale=2.0)),
    "drift": (HalfStudentT(scale=2.0, degrees_of_freedom=3.0), HalfStudent()),
    "share": (Beta(alpha=2.0, beta=5.0), scipy.stats.beta(2.0, 5.0)),
    "efficiency": (Beta(alpha=0.6, beta=0.9, lower=-1.0, upper=4.0), scipy.stats.beta(0.6, 0.9, -1.0, 5.0)),
}
NAMES = tuple(CASES)
PRIORS = Priors(NAMES, tuple(prior for prior, _ in CASES.values()))
REFERENCE = [reference for _, reference in CASES.values()]
D = len(NAMES)

each = pytest.mark.parametrize("j", range(D), ids=NAMES)


def single(j: int) -> Priors:
    return Priors((NAMES[j],), (PRIORS.priors[j],))


@each
def test_log_density_of_z_is_that_of_theta_plus_the_log_jacobian(j):
    prior = single(j)
    z = np.linspace(-4.0, 4.0, 33)
    theta = np.array(prior.to_theta(z[:, None]))[:, 0]
    expected = REFERENCE[j].logpdf(theta) + np.log(prior.at(z[:, None]).slope[:, 0])
    np.testing.assert_allclose(prior.at(z[:, None]).log_density, expected, rtol=1e-8, atol=1e-8)


@each
def test_density_of_z_integrates_to_one(j):
    z = np.linspace(-80.0, 40.0, 120_001)
    density = np.exp(single(j).at(z[:, None]).log_density)
    assert np.trapezoid(density, z) == pytest.approx(1.0, abs=1e-8)


@each
def test_quantiles_agree_with_scipy(j):
    p = np.array([1e-6, 0.001, 0.025, 0.5, 0.975, 0.999, 1 - 1e-6])
    np.testing.assert_allclose(single(j).quantile(p[:, None])[:, 0], REFERENCE[j].ppf(p), rtol=1e-8)


@each
def test_samples_follow_the_prior(j):
    draws = PRIORS.sample(np.random.default_rng(7), 4000)[:, j]
    assert scipy.stats.kstest(draws, REFERENCE[j].cdf).pvalue > 1e-3


@each
def test_z_of_theta_inverts_theta_of_z(j):
    z = np.linspace(-5.0, 5.0, 41)[:, None]
    prior = single(j)
    np.testing.assert_allclose(prior.to_z(prior.to_theta(z)), z, rtol=1e-7, atol=1e-7)


@each
def test_theta_far_out_stays_within_the_bounds_with_finite_derivatives(j):
    prior = single(j)
    low, high = REFERENCE[j].support()
    for z in (-np.inf, -300.0, -40.0, -9.0, 9.0, 40.0, 300.0, np.inf):
        assert low <= prior.to_theta(np.array([z]))[0] <= high
        if np.isfinite(z):
            slope = prior.at(np.array([z])).slope[0]
            assert np.isfinite(slope)
            assert slope >= 0.0
            assert prior.at(np.array([z])).log_density < -0.5
            assert np.isfinite(prior.at(np.array([z])).gradient).all()


def test_rounding_takes_no_uniform_prior_past_its_bound():
    lower, upper = -0.62, -0.09
    assert lower + (upper - lower) > upper
    assert Priors(("x",), (Uniform(lower=lower, upper=upper),)).to_theta(np.array([40.0])) == [upper]


def test_the_density_of_a_share_falls_off_with_its_exponents_however_far_out():
    shares = Priors(("a", "b"), (Beta(alpha=2.0, beta=5.0), Beta(alpha=0.6, beta=0.9)))
    constant = scipy.special.betaln([2.0, 0.6], [5.0, 0.9]).sum()
    assert shares.at(np.full(2, 1000.0)).log_density == pytest.approx(-5900.0 - constant, rel=1e-12)
    assert shares.at(np.full(2, -1000.0)).log_density == pytest.approx(-2600.0 - constant, rel=1e-12)


@each
def test_z_of_a_bound_is_finite_where_there_are_two(j):
    bounds = np.array(REFERENCE[j].support())
    if np.isfinite(bounds).all():
        z = np.array(single(j).to_z(bounds[:, None]))[:, 0]
        assert np.isfinite(z).all()
        assert z[0] < -5.0
        assert z[1] > 5.0
        furthest = 37.0 if isinstance(PRIORS.priors[j], Beta) else 8.3
        assert np.abs(z).max() < furthest, "of a probability of 2^-53"


@each
def test_slope_and_gradient_agree_with_finite_differences(j):
    prior, step = single(j), 1e-5
    z = np.linspace(-3.0, 3.0, 25)[:, None]
    difference = (prior.to_theta(z + step) - prior.to_theta(z - step)) / (2 * step)
    np.testing.assert_allclose(prior.at(z).slope, difference, rtol=1e-6)
    difference = (prior.at(z + step).log_density - prior.at(z - step).log_density) / (2 * step)
    np.testing.assert_allclose(prior.at(z).gradient[:, 0], difference, rtol=1e-6, atol=1e-8)


def test_slope_of_a_symmetric_truncated_normal_is_right_at_its_median():
    prior = Priors(("x",), (TruncatedNormal(mean=1.0, standard_deviation=2.0, lower=-1.0, upper=3.0),))
    slope = prior.at(np.zeros(1)).slope[0]
    mass = scipy.stats.norm.cdf(1.0) - scipy.stats.norm.cdf(-1.0)
    assert slope == pytest.approx(2.0 * mass)


def test_precision_is_minus_the_derivative_of_the_gradient():
    z, step = np.random.default_rng(0).normal(size=(50, D)), 1e-5
    difference = (PRIORS.at(z - step).gradient - PRIORS.at(z + step).gradient) / (2 * step)
    np.testing.assert_allclose(PRIORS.precision(z), difference, rtol=1e-6, atol=1e-8)
    assert (np.array(PRIORS.precision(np.random.default_rng(1).normal(0, 5, (100, D)))) >= 0).all()


def test_parameters_keep_their_order_over_any_leading_axes():
    z = np.random.default_rng(0).normal(size=(3, 4, D))
    theta = PRIORS.to_theta(z)
    assert theta.shape == (3, 4, D)
    for j in range(D):
        np.testing.assert_allclose(theta[..., j], single(j).to_theta(z[..., j : j + 1])[..., 0], rtol=1e-12)
    total = sum(single(j).at(z[..., j : j + 1]).log_density for j in range(D))
    np.testing.assert_allclose(PRIORS.at(z).log_density, total, rtol=1e-12)


def test_everything_is_double_precision():
    assert PRIORS.to_theta(np.zeros(D)).dtype == np.float64
    assert PRIORS.at(np.zeros(D)).log_density.dtype == np.float64


def test_medians_and_bounds_are_quantiles():
    np.testing.assert_allclose(PRIORS.median(), [r.median() for r in REFERENCE], rtol=1e-10)
    lower, upper = PRIORS.bounds()
    np.testing.assert_allclose(lower, [r.ppf(0.001) for r in REFERENCE], rtol=1e-8)
    np.testing.assert_allclose(upper, [r.ppf(0.999) for r in REFERENCE], rtol=1e-8)
    lower, upper = PRIORS.bounds(1.0)
    assert np.isfinite(lower).all()
    assert np.isfinite(upper).all()


def test_same_generator_state_gives_the_same_sample():
    first, second = (PRIORS.sample(np.random.default_rng(3), 5) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_a_tilt_is_a_slope_that_bends():
    slope, centre = (2.0, -1.0), (0.3, 0.0)
    plain = Priors(("a", "b"), (Normal(mean=1.0, standard_deviation=2.0), LogNormal(median=3.0, factor=2.0)))
    tilted = Priors(plain.names, plain.priors, Tilt(slope, centre, 1.5))
    z = np.random.default_rng(0).normal(size=(20, 2))
    added = tilted.at(z).log_density - plain.at(z).log_density
    np.testing.assert_allclose(added, 1.5 * np.tanh((z - centre) @ slope / 1.5), atol=1e-12)
    sides = [(tilted.at(z + 1e-6 * step).log_density - tilted.at(z - 1e-6 * step).log_density) for step in np.eye(2)]
    np.testing.assert_allclose(tilted.at(z).gradient, np.stack(sides, axis=1) / 2e-6, atol=1e-6)
    assert np.array_equal(tilted.to_theta(z), plain.to_theta(z))


@pytest.mark.parametrize("name", ["noise", "drift"])
def test_a_size_with_a_sign_has_its_prior_shared_by_both_signs(name):
    prior, reference = CASES[name]
    priors = Priors(("size",), (signed(prior),))
    z = np.linspace(-12.0, 12.0, 4801)[:, None]
    at = priors.at(z)
    assert np.trapezoid(np.exp(at.log_density), z[:, 0]) == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(at.theta, at.theta[::-1], rtol=1e-11, atol=1e-14)
    expected = reference.logpdf(at.theta[:, 0]) + np.log(0.5 * np.abs(at.slope[:, 0]))
    np.testing.assert_allclose(at.log_density, expected, rtol=1e-8, atol=1e-8)
    step = 1e-6
    assert priors.at(np.array([0.0])).gradient == pytest.approx(0.0)
    above, below = priors.at(z + step), priors.at(z - step)
    by_differences = (above.log_density - below.log_density) / (2 * step)
    np.testing.assert_allclose(at.gradient[:, 0], by_differences, rtol=1e-6, atol=1e-7)
    away = z[:, 0] != 0.0
    np.testing.assert_allclose(at.slope[away], ((above.theta - below.theta) / (2 * step))[away], rtol=1e-6)
    bent = (above.gradient - below.gradient) / (2 * step)
    np.testing.assert_allclose(priors.precision(z), -bent, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", ["noise", "drift"])
def test_a_size_with_a_sign_is_found_and_drawn_above_zero(name):
    prior, reference = CASES[name]
    priors = Priors(("size",), (signed(prior),))
    theta = np.array([[0.0], [1e-3], [1.0], [20.0]])
    np.testing.assert_allclose(priors.to_theta(priors.to_z(theta)), theta, rtol=1e-12)
    np.testing.assert_allclose(priors.quantile(np.array([[0.1], [0.9]]))[:, 0], reference.ppf([0.1, 0.9]), rtol=1e-8)
    both = Priors(("size", "bias"), (signed(prior), CASES["bias"][0]))
    np.testing.assert_array_equal(both.unsigned(np.array([[-1.0, -2.0], [1.0, 2.0]])), [[1.0, -2.0], [1.0, 2.0]])


def test_what_is_no_size_keeps_its_prior():
    assert signed(CASES["link"][0]) == CASES["link"][0]
