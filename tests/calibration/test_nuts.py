import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from arviz_stats.base import array_stats
from scipy.special import digamma, polygamma

from flightcal.calibration import nuts
from flightcal.calibration.diagnostics import least_effective
from flightcal.calibration.nuts import MAXIMUM_DEPTH, OVERDISPERSION, _Density, overdispersed_starts, sample
from flightcal.errors import FlightcalError
from flightcal.probability import Priors
from flightcal.problem.coordinates import LARGEST_DEVIATION, Whitening, whitening
from flightcal.progress import Silent
from flightcal.scenario import LogNormal, NutsSettings, Uniform
from tests.told import Told


def identity(d):
    return Whitening(np.zeros(d), np.eye(d))


def standard_normal(z):
    return -0.5 * float(z @ z), -z


def short(**changes):
    return NutsSettings(**{"chains": 2, "draws": 200, "warmup": 200, **changes})


def check_moments(z, mean, variance):
    """Means and variances of draws [chain, draw, d] within 4 Monte Carlo standard errors of the exact ones."""
    centred = (z - mean) ** 2
    ess = array_stats.ess(z, chain_axis=0, draw_axis=1, method="mean")
    ess_of_square = array_stats.ess(centred, chain_axis=0, draw_axis=1, method="mean")
    flat, flat_square = z.reshape(-1, z.shape[-1]), centred.reshape(-1, z.shape[-1])
    assert (abs(flat.mean(0) - mean) < 4 * flat.std(0) / np.sqrt(ess)).all()
    assert (abs(flat_square.mean(0) - variance) < 4 * flat_square.std(0) / np.sqrt(ess_of_square)).all()


@pytest.mark.parametrize("in_turn", [False, True])
def test_a_density_in_turn_is_evaluated_for_one_chain_at_a_time_and_draws_the_same(in_turn):
    inside, most = [], []

    def density(z):
        inside.append(z)
        time.sleep(1e-4)
        most.append(len(inside))
        inside.pop()
        return standard_normal(z)

    drawn = sample(density, identity(2), short(draws=50), 3, in_turn=in_turn)
    assert max(most) == (1 if in_turn else 2)
    np.testing.assert_array_equal(drawn.z, sample(standard_normal, identity(2), short(draws=50), 3).z)


@pytest.fixture(scope="module")
def gaussian():
    """A correlated Gaussian in 20 dimensions, standard deviations over three decades, and its draws."""
    d = 20
    rng = np.random.default_rng(1)
    mixing = rng.normal(size=(d, d)) * np.geomspace(0.03, 30.0, d)[:, None]
    covariance, mean = mixing @ mixing.T, rng.normal(size=d)
    precision = np.linalg.inv(covariance)

    def density(z):
        gradient = -precision @ (z - mean)
        return 0.5 * float((z - mean) @ gradient), gradient

    jacobian = np.linalg.inv(mixing)
    white = whitening(mean, jacobian.T @ jacobian)
    return mean, covariance, density, sample(density, white, NutsSettings(draws=1000, warmup=400), seed=4)


def test_a_correlated_gaussian_is_drawn_with_its_means_and_covariance(gaussian):
    mean, covariance, _, draws = gaussian
    check_moments(draws.z, mean, np.diag(covariance))
    # In coordinates where the covariance is the identity, each entry of its estimate has an error of about 1/sqrt(S).
    w = np.linalg.solve(np.linalg.cholesky(covariance), (draws.z.reshape(-1, 20) - mean).T)
    assert abs(w @ w.T / w.shape[1] - np.eye(20)).max() < 5 * np.sqrt(2 / w.shape[1])


def test_chains_of_a_gaussian_converge_and_mix(gaussian):
    draws = gaussian[-1]
    assert array_stats.rhat(draws.z, chain_axis=0, draw_axis=1).max() < 1.01
    assert array_stats.ess(draws.z, chain_axis=0, draw_axis=1).min() > 2000
    assert not draws.statistics["diverging"].any()
    assert draws.gradients < 20 * draws.z.shape[0] * draws.z.shape[1]


def test_statistics_describe_each_draw(gaussian):
    _, _, density, draws = gaussian
    statistics = draws.statistics
    assert set(statistics) == {
        "diverging",
        "depth",
        "n_steps",
        "energy",
        "step_size",
        "acceptance",
        "log_density",
    }
    assert all(values.shape == (4, 1000) for values in statistics.values())
    assert statistics["log_density"][2, 17] == pytest.approx(density(draws.z[2, 17])[0])
    # A last doubling that is rejected counts as steps and not as depth.
    assert (statistics["n_steps"] < 2 ** (statistics["depth"] + 1)).all()
    assert (statistics["n_steps"] >= 2 ** statistics["depth"] - 1).all()
    assert statistics["acceptance"].mean() == pytest.approx(0.9, abs=0.05)
    assert (statistics["energy"] > -statistics["log_density"]).all()
    total = statistics["n_steps"].sum() + draws.warmup_gradients
    assert total <= draws.gradients <= total + 100
    assert not draws.interrupted
    assert draws.failures == 0


def test_a_skewed_density_is_drawn_with_its_exact_moments():
    """u = A z are logarithms of gamma variables of shape k: mean digamma(k), variance trigamma(k)."""
    shape = np.array([0.5, 1.0, 3.0, 10.0])
    A = np.array([[1.0, 0.5, 0.0, 0.2], [0.0, 2.0, 0.3, 0.0], [0.1, 0.0, 0.5, 0.0], [0.0, 0.4, 0.0, 1.0]])

    def density(z):
        u = A @ z
        return float(shape @ u - np.exp(u).sum()), A.T @ (shape - np.exp(u))

    mode = np.linalg.solve(A, np.log(shape))
    draws = sample(density, whitening(mode, A.T @ np.diag(shape) @ A), NutsSettings(draws=2000), seed=1)
    check_moments(draws.z @ A.T, digamma(shape), polygamma(1, shape))


@pytest.mark.slow
def test_a_thin_ridge_that_bends_at_a_bound_is_followed_to_its_end():
    """theta in [0, 1] given only by its prior, and a logarithm that the telemetry ties to it within a thousandth."""
    priors = Priors(("share", "link"), (Uniform(lower=0.0, upper=1.0), LogNormal(median=1.0, factor=np.e)))

    def density(z):
        prior = priors.at(z)
        left = (z[1] - 2.0 * prior.theta[0]) / 1e-3
        return float(prior.log_density) - 0.5 * left**2, prior.gradient - left * np.array(
            [-2.0 * prior.slope[0], 1.0]
        ) / 1e-3

    mode = np.array([0.0, 1.0])
    ties = np.array([-2.0 * priors.at(mode).slope[0], 1.0]) / 1e-3
    precision = np.eye(2) + np.outer(ties, ties)
    settings = NutsSettings(chains=4, warmup=300, draws=1000)
    draws = sample(density, whitening(mode, precision, priors), settings, seed=1)
    assert not draws.statistics["diverging"].any()
    share = priors.to_theta(draws.z)[..., 0]
    # What is left of the prior's uniform: the link's prior, N(2 share, 1), tilts it.
    grid = np.linspace(0.0, 1.0, 20001)
    weight = np.exp(-0.5 * (2.0 * grid) ** 2)
    mean = (grid * weight).sum() / weight.sum()
    deviation = np.sqrt(((grid - mean) ** 2 * weight).sum() / weight.sum())
    assert share.mean() == pytest.approx(mean, abs=4 * deviation / np.sqrt(least_effective(draws.z)))
    bent = sample(density, whitening(mode, precision), settings, seed=1)
    assert least_effective(draws.z) > 2 * least_effective(bent.z)


def test_a_wrong_whitening_costs_time_and_not_correctness():
    d = 10
    rotation, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(d, d)))
    variance = np.geomspace(0.1, 100.0, d)
    precision = rotation @ np.diag(1 / variance) @ rotation.T

    def density(z):
        return -0.5 * float(z @ precision @ z), -precision @ z

    draws = sample(density, identity(d), NutsSettings(), seed=1)
    check_moments(draws.z @ rotation, np.zeros(d), variance)
    # The low-rank adaptation found the directions: the diagonal one needs ten times as many.
    assert draws.statistics["n_steps"].mean() < 20


def test_same_seed_gives_the_same_draws_on_one_core_and_on_all():
    settings = short(chains=4)
    first = sample(standard_normal, identity(5), settings, seed=3)
    again = sample(standard_normal, identity(5), settings, seed=3)
    np.testing.assert_array_equal(first.z, again.z)
    for name, values in first.statistics.items():
        np.testing.assert_array_equal(values, again.statistics[name])
    if not hasattr(os, "sched_setaffinity"):
        pytest.skip("this system cannot confine a process to one core")
    cores = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {min(cores)})
        alone = sample(standard_normal, identity(5), settings, seed=3)
    finally:
        os.sched_setaffinity(0, cores)
    np.testing.assert_array_equal(first.z, alone.z)


def test_seeds_and_chains_differ():
    first, other = (sample(standard_normal, identity(3), short(), seed=seed).z for seed in (3, 4))
    assert not np.array_equal(first, other)
    assert not np.array_equal(first[0], first[1])


def test_chains_start_where_they_are_told(monkeypatch):
    visited = {}

    def density(z):
        visited.setdefault(threading.get_ident(), z.copy())
        return standard_normal(z)

    starts = np.array([[2.0, -1.0], [0.5, 3.0], [1.0, 1.0]])
    factor = np.array([[2.0, 0.0], [1.0, 0.5]])
    monkeypatch.setattr(nuts, "overdispersed_starts", lambda *_: starts)
    sample(density, Whitening(np.array([1.0, -1.0]), factor), short(chains=3), seed=1)
    first = sorted(tuple(np.round(z, 12)) for z in visited.values())
    assert first == sorted(map(tuple, starts))


def test_starts_are_wider_than_the_posterior():
    factor = np.array([[2.0, 0.0], [1.0, 0.5]])
    white = Whitening(np.array([10.0, -10.0]), factor)
    starts = overdispersed_starts(standard_normal, white, 2000, seed=1)
    covariance = np.cov(white.to_w(starts).T)
    np.testing.assert_allclose(covariance, OVERDISPERSION**2 * np.eye(2), atol=0.25)
    np.testing.assert_allclose(starts.mean(0), white.mean, atol=0.3)


def test_starts_at_which_the_density_fails_are_redrawn():
    starts = overdispersed_starts(broken_beyond(0.0, lambda z: (np.nan, z)), identity(3), 50, seed=1)
    assert (starts[:, 0] <= 0.0).all()


def test_no_start_at_all_is_reported_with_the_reason():
    def density(z):
        raise ZeroDivisionError("capacity is zero")

    with pytest.raises(FlightcalError, match=r"no start for chain 1.*ZeroDivisionError: capacity is zero"):
        sample(density, identity(3), short(), seed=1)


def test_an_unused_parameter_is_named_before_nutpie_starts():
    with pytest.raises(FlightcalError, match="unused parameter"):
        sample(lambda z: (-0.5 * z[0] ** 2, np.array([-z[0], 0.0])), identity(2), short(), seed=1)


def broken_beyond(limit, fail):
    """A standard normal whose simulations fail where the first coordinate is above the limit."""

    def density(z):
        return fail(z) if z[0] > limit else standard_normal(z)

    return density


def raises(z):
    raise ValueError("the network is singular")


@pytest.mark.parametrize(
    ("fail", "reason"),
    [
        (raises, "ValueError: the network is singular"),
        (lambda z: (np.nan, -z), "not finite"),
        (lambda z: (-np.inf, np.zeros_like(z)), "not finite"),
        (lambda z: (np.inf, -z), "not finite"),
        (lambda z: (0.0, np.full_like(z, np.nan)), "not finite"),
        (lambda z: (0.0, np.zeros(len(z) + 1)), "ValueError"),
        (lambda z: None, "TypeError"),
    ],
    ids=["raises", "nan", "minus_inf", "plus_inf", "nan_gradient", "wrong_length", "no_value"],
)
def test_failed_simulations_are_divergences_and_counted(fail, reason):
    draws = sample(broken_beyond(1.0, fail), identity(4), short(), seed=2)
    assert draws.z.shape == (2, 200, 4)
    assert (draws.z[..., 0] <= 1.0).all()
    assert reason in draws.last_failure
    failures = draws.statistics["diverging"].sum() + draws.warmup_divergences
    first_steps = draws.z.shape[0]  # the search for a chain's first step size may fail once
    assert 0 < draws.failures <= failures + first_steps
    assert draws.statistics["diverging"].any()


def test_a_region_of_failures_cuts_the_density_and_does_not_distort_the_rest():
    draws = sample(broken_beyond(1.0, raises), identity(3), NutsSettings(), seed=2)
    # A normal cut above 1: mean -phi(1) / Phi(1), variance 1 - phi(1) / Phi(1) - mean^2.
    mean = -0.2875999
    check_moments(draws.z[..., :1], np.array([mean]), np.array([1 + mean - mean**2]))


def test_a_gradient_of_any_float_kind_and_layout_is_taken():
    def density(z):
        return np.float32(-0.5 * z @ z), np.stack([-z, z], axis=1).astype(np.float32)[:, 0]

    draws = sample(density, identity(3), short(), seed=1)
    assert draws.failures == 0


def test_trajectories_end_at_the_maximum_depth(monkeypatch):
    """A thin ring has no scale that a step size could follow."""

    def ring(z):
        radius = np.sqrt(z @ z)
        distance = (radius - 1000.0) / 0.01
        return -0.5 * distance**2, -distance / 0.01 * z / radius

    starts = np.array([[1000.0, 1.0], [1.0, 1000.0]])
    monkeypatch.setattr(nuts, "overdispersed_starts", lambda *_: starts)
    draws = sample(ring, identity(2), short(warmup=50, draws=50), seed=1)
    assert draws.statistics["depth"].max() == MAXIMUM_DEPTH
    assert draws.statistics["n_steps"].max() == 2**MAXIMUM_DEPTH - 1


def slow(z):
    time.sleep(0.001)
    return standard_normal(z)


def interrupted_sample(after, settings):
    timer = threading.Timer(after, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    try:
        return sample(slow, identity(3), settings, seed=1)
    finally:
        timer.join()


def test_ctrl_c_returns_the_draws_so_far():
    handler = signal.getsignal(signal.SIGINT)
    start = time.perf_counter()
    draws = interrupted_sample(2.0, NutsSettings(chains=3, warmup=50, draws=100_000))
    assert time.perf_counter() - start < 6.0
    assert draws.interrupted
    assert draws.z.shape[0] == 3
    assert 20 < draws.z.shape[1] < 2000
    assert all(values.shape == draws.z.shape[:2] for values in draws.statistics.values())
    np.testing.assert_allclose(draws.statistics["log_density"], -0.5 * (draws.z**2).sum(-1), rtol=1e-10)
    # The draw that the interruption cut short is not among them.
    assert not draws.statistics["diverging"].any()
    assert signal.getsignal(signal.SIGINT) is handler


def test_interrupted_draws_are_the_first_of_the_uninterrupted():
    settings = NutsSettings(chains=2, warmup=50, draws=100_000)
    draws = interrupted_sample(1.5, settings)
    whole = sample(standard_normal, identity(3), settings.model_copy(update={"draws": 1000}), seed=1)
    n = min(draws.z.shape[1], 1000)
    assert n > 10
    np.testing.assert_array_equal(draws.z[:, :n], whole.z[:, :n])


def test_ctrl_c_during_warm_up_returns_no_draws():
    draws = interrupted_sample(0.5, NutsSettings(chains=2, warmup=100_000, draws=100))
    assert draws.interrupted
    assert draws.z.shape == (2, 0, 3)
    assert draws.gradients > 0


def test_ctrl_c_does_not_wait_for_a_long_trajectory():
    def stiff(z):
        time.sleep(0.02)
        return -0.5e-10 * float(z @ z), -1e-10 * z

    timer = threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    start = time.perf_counter()
    draws = sample(stiff, identity(3), short(), seed=1)
    assert time.perf_counter() - start < 4.0
    assert draws.interrupted


def test_progress_reaches_the_end_and_counts_all_chains():
    told = Told()
    settings = short(chains=3)
    draws = sample(slow, identity(2), settings.model_copy(update={"draws": 50}), seed=1, progress=told)
    reports = told.stages["sampling"]
    assert len(reports) > 2
    assert (np.diff([done for done, _ in reports]) >= 0).all()
    assert reports[-1] == (750, f"750/750 draws, {draws.gradients} gradients")


def test_an_exception_in_the_callers_progress_stops_the_chains_and_is_passed_on():
    class Gone(Silent):
        def at(self, done, note=""):
            raise RuntimeError("the terminal is gone")

    assert_all_chains_end(short(draws=5_000), RuntimeError, "terminal", progress=Gone())


def test_a_panic_of_one_chain_stops_the_others_and_is_passed_on(monkeypatch):
    """nutpie panics on an exception; ours are caught before, so one is planted past the catching."""
    call, planted = _Density.__call__, []

    def panic(density, w):
        # In one chain only, well after its start (which is tried beforehand with a density of its own).
        if density.gradients > 200 and planted in ([], [density]):
            planted[:] = [density]
            raise ValueError("planted")
        return call(density, w)

    monkeypatch.setattr(_Density, "__call__", panic)
    assert_all_chains_end(short(draws=5_000), BaseException, "planted")


def assert_all_chains_end(settings, error, text, **arguments):
    calls = 0

    def counted(z):
        nonlocal calls
        calls += 1
        return slow(z)

    with pytest.raises(error, match=text):
        sample(counted, identity(3), settings, seed=1, **arguments)
    after = calls
    time.sleep(0.2)
    assert calls == after > 0


def test_works_outside_of_the_main_thread():
    found = []
    thread = threading.Thread(target=lambda: found.append(sample(standard_normal, identity(2), short(), seed=1)))
    thread.start()
    thread.join()
    np.testing.assert_array_equal(found[0].z, sample(standard_normal, identity(2), short(), seed=1).z)


def test_no_warning_reaches_the_user_and_nothing_is_printed(tmp_path):
    code = (
        "import sys, numpy as np\n"
        "from flightcal.calibration.nuts import sample\n"
        "from flightcal.problem.coordinates import Whitening\n"
        "from flightcal.scenario import NutsSettings\n"
        "assert 'nutpie' not in sys.modules\n"
        "sample(lambda z: (-0.5 * float(z @ z), -z), Whitening(np.zeros(2), np.eye(2)),\n"
        "       NutsSettings(draws=50, warmup=50), 1)\n"
    )
    # An empty cache makes the old arviz announce its successor, which it does once a day.
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    run = subprocess.run([sys.executable, "-W", "error", "-c", code], env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert run.stdout == run.stderr == ""


def test_whitening_inverts_the_precision():
    rng = np.random.default_rng(0)
    jacobian = rng.normal(size=(50, 6)) * np.geomspace(1, 1e4, 6)
    white = whitening(np.ones(6), np.eye(6) + jacobian.T @ jacobian)
    expected = np.linalg.inv(np.eye(6) + jacobian.T @ jacobian)
    np.testing.assert_allclose(white.factor @ white.factor.T, expected, rtol=1e-6)
    z = rng.normal(size=(3, 4, 6))
    np.testing.assert_allclose(white.to_z(white.to_w(z)), z, rtol=1e-9)


@pytest.mark.parametrize("unheld", [0.0, -1e-3, 1e-30])
def test_a_direction_that_nothing_holds_gets_the_largest_deviation(unheld):
    rotation, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    precision = rotation @ np.diag([1e8, 1.0, unheld]) @ rotation.T
    white = whitening(np.zeros(3), precision)
    deviations = np.sqrt(np.diag(rotation.T @ white.factor @ white.factor.T @ rotation))
    np.testing.assert_allclose(deviations, [1e-4, 1.0, LARGEST_DEVIATION], rtol=1e-5)


def test_a_precision_that_is_not_finite_is_refused():
    with pytest.raises(FlightcalError, match="2 values that are not finite"):
        whitening(np.zeros(2), np.array([[1.0, np.nan], [np.nan, 1.0]]))
