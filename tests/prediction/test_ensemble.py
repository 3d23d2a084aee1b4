"""Propagation: what the mean, the intervals and the duty cycle of an ensemble are."""

from dataclasses import replace

import numpy as np
import pytest

from flightcal.errors import RunError
from flightcal.prediction.ensemble import propagate
from flightcal.prediction.errors import Drawn
from flightcal.prediction.metrics import crps_of_draws, probability_below
from flightcal.problem import build_window

from .. import small


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    written = small.content()
    written["windows"]["train"]["end"] = "2024-03-01T01:15:00"
    return build_window(*small.closed_loop(tmp_path_factory.mktemp("ensemble"), written), "train")


def thetas_of(problem, count, **spread):
    values = {"noise.body_temp": 0.5, "initial.body": 285.0, "initial.panel": 262.0} | small.TRUTH
    thetas = np.tile([values[name] for name in problem.names], (count, 1))
    rng = np.random.default_rng(0)
    for name, deviation in spread.items():
        thetas[:, problem.names.index(name)] += deviation * rng.standard_normal(count)
    return thetas


def test_equal_thetas_leave_the_noise_alone_in_the_interval(problem):
    ensemble = propagate(problem, thetas_of(problem, 1500), 0.9, np.random.default_rng(1))
    run = problem.simulate(thetas_of(problem, 1)[0])
    np.testing.assert_allclose(ensemble.mean, run.temperatures, atol=1e-9)
    for bound in (ensemble.model_lower, ensemble.model_upper):
        np.testing.assert_allclose(bound, run.temperatures, atol=1e-9)
    for channel, noise in enumerate((0.5, 0.1)):
        upper = (ensemble.upper - run.temperatures)[:, channel] / noise
        lower = (ensemble.lower - run.temperatures)[:, channel] / noise
        np.testing.assert_allclose([lower.mean(), upper.mean()], [-1.645, 1.645], atol=0.03)
        np.testing.assert_allclose(ensemble.standard_deviation[:, channel], noise, rtol=1e-6)


def test_draws_are_the_telemetry_whose_quantiles_the_interval_has(problem):
    ensemble = propagate(problem, thetas_of(problem, 60, link=0.02), 0.9, np.random.default_rng(1))
    assert ensemble.draws.shape == (60, *problem.observed.shape)
    np.testing.assert_allclose(np.quantile(ensemble.draws, [0.05, 0.95], axis=0), [ensemble.lower, ensemble.upper])


def test_spread_of_theta_and_noise_add_up(problem):
    thetas = thetas_of(problem, 300, link=0.02)
    ensemble = propagate(problem, thetas, 0.95, np.random.default_rng(1))
    simulated = np.stack([problem.simulate(theta).temperatures for theta in thetas])
    np.testing.assert_allclose(ensemble.mean, simulated.mean(axis=0))
    np.testing.assert_allclose(ensemble.standard_deviation**2, simulated.var(axis=0) + np.array([0.25, 0.01]))
    np.testing.assert_allclose(ensemble.model_lower, np.quantile(simulated, 0.025, axis=0))
    assert (ensemble.upper - ensemble.lower > ensemble.model_upper - ensemble.model_lower).mean() > 0.95


def test_a_new_draw_with_noise_lies_in_the_interval_as_often_as_it_says(problem):
    ensemble = propagate(problem, thetas_of(problem, 800, link=0.02), 0.8, np.random.default_rng(1))
    fresh = thetas_of(problem, 1100, link=0.02)[800:]
    rng = np.random.default_rng(2)
    inside = []
    for theta in fresh:
        new = problem.simulate(theta).temperatures
        new = new + problem.noise(theta) * rng.standard_normal(new.shape)
        inside.append((ensemble.lower <= new) & (new <= ensemble.upper))
    assert np.mean(inside) == pytest.approx(0.8, abs=0.02)


def test_heater_duty_switches_and_energy_are_those_of_each_simulation(problem):
    thetas = thetas_of(problem, 30, power=2.0)
    # One that is too warm for its heater to switch at all.
    thetas[3, problem.names.index("initial.body")] = 400.0
    ensemble = propagate(problem, thetas, 0.95, np.random.default_rng(1))
    runs = [problem.simulate(theta) for theta in thetas]
    power = thetas[:, problem.names.index("power")]
    # Simulations side by side and one by one differ by rounding.
    np.testing.assert_allclose(ensemble.duty_cycle[:, 0], [run.duty_cycle[0] for run in runs], rtol=1e-10)
    np.testing.assert_array_equal(ensemble.switch_count[:, 0], [len(run.switches.time) for run in runs])
    np.testing.assert_allclose(ensemble.energy[:, 0], ensemble.duty_cycle[:, 0] * power * 4500.0)
    np.testing.assert_allclose(ensemble.status, np.mean([run.status for run in runs], axis=0))
    assert ((ensemble.status > 0) & (ensemble.status < 1)).any()


def test_failed_simulations_are_left_out_and_counted(problem):
    thetas = thetas_of(problem, 10)
    thetas[[2, 7], problem.names.index("initial.body")] = np.nan
    ensemble = propagate(problem, thetas, 0.95, np.random.default_rng(1))
    assert ensemble.failed == 2
    assert ensemble.duty_cycle.shape == (8, 1)
    assert np.isfinite(ensemble.upper).all()


def test_an_ensemble_that_mostly_fails_is_an_error(problem):
    thetas = thetas_of(problem, 10)
    thetas[:6, problem.names.index("initial.body")] = np.nan
    with pytest.raises(RunError, match="window 'train': 6 of 10 simulations failed"):
        propagate(problem, thetas, 0.95, np.random.default_rng(1))


def test_half_of_the_simulations_are_enough(problem):
    thetas = thetas_of(problem, 10)
    thetas[:5, problem.names.index("initial.body")] = np.nan
    assert propagate(problem, thetas, 0.95, np.random.default_rng(1)).failed == 5


def test_noise_is_that_of_each_theta(problem):
    thetas = thetas_of(problem, 1000)
    thetas[1::2, problem.names.index("noise.body_temp")] = 0.1
    ensemble = propagate(problem, thetas, 0.9, np.random.default_rng(1))
    np.testing.assert_allclose(ensemble.standard_deviation[:, 0] ** 2, (0.5**2 + 0.1**2) / 2, rtol=1e-6)
    # 0.9 of a mixture of two normals lies within +- 0.6408 K: 0.5 (P(|z| < 1.282) + P(|z| < 6.4)).
    width = (ensemble.upper - ensemble.lower)[:, 0] / 2
    assert width.mean() == pytest.approx(0.6408, rel=0.02)


def test_what_a_surrogate_may_be_off_by_is_in_the_intervals(problem):
    """Equal thetas, one constant shape of standard deviation 0.8 K on the first channel, none on the second."""

    class Surrogate:
        error_basis = np.broadcast_to([[1.0], [0.0]], (*problem.observed.shape, 1))

        def __getattr__(self, name):
            return getattr(problem.simulator, name)

        def simulate_many(self, thetas):
            return [replace(run, error_variance=np.array([0.64])) for run in problem.simulator.simulate_many(thetas)]

    thetas = thetas_of(problem, 2000)
    ensemble = propagate(replace(problem, simulator=Surrogate()), thetas, 0.9, np.random.default_rng(1))
    # The sample standard deviation of 2000 draws is known to 1.6%; the shape's weight is the same at all times.
    np.testing.assert_allclose(ensemble.standard_deviation[:, 0], np.hypot(0.5, 0.8), rtol=0.05)
    np.testing.assert_allclose(ensemble.standard_deviation[:, 1], 0.1, rtol=1e-9)
    np.testing.assert_allclose((ensemble.model_upper - ensemble.model_lower)[:, 0], 2 * 1.645 * 0.8, rtol=0.1)


class KnownErrors:
    """In the place of `WindowErrors`: errors that are given, of the draws that are usable."""

    def __init__(self, drawn, usable, taken=None):
        self.drawn, self.given, self.taken = drawn, usable, taken

    def usable(self):
        return self.given.copy()

    def only(self, kept):
        return KnownErrors(self.drawn, self.given, kept)

    def draw(self, temperatures, rng):
        parts = (self.drawn.mean, self.drawn.discrepancy, self.drawn.noise, self.drawn.white)
        return Drawn(*(part[self.taken] for part in parts))


def test_an_error_of_a_surrogate_that_is_known_is_not_drawn_again(problem):
    basis, variance = np.ones((*problem.observed.shape, 1)), np.array([4.0])
    surrogate = replace(problem.simulator, error_basis=basis, error_variance=variance)
    known = np.full((50, *problem.observed.shape), 0.7)
    thetas = thetas_of(problem, 50)
    thetas[10, problem.names.index("initial.body")] = np.nan
    surrogate_window = replace(problem, simulator=surrogate)
    ensemble = propagate(surrogate_window, thetas, 0.95, np.random.default_rng(1), known=known)
    run = problem.simulate(thetas[0])
    assert ensemble.failed == 1
    for bound in (ensemble.mean, ensemble.model_lower, ensemble.model_upper):
        np.testing.assert_allclose(bound, run.temperatures + 0.7, atol=1e-9)


def test_intervals_hold_discrepancy_and_both_kinds_of_noise_of_the_usable_draws(problem):
    thetas = thetas_of(problem, 40, link=0.02)
    simulated = np.stack([problem.simulate(theta).temperatures for theta in thetas])
    rng = np.random.default_rng(3)
    drawn = Drawn(*(size * rng.standard_normal(simulated.shape) for size in (0.3, 0.7, 1.1, 1.3)))
    usable = np.arange(40) % 4 > 0
    thetas[5, problem.names.index("initial.body")] = np.nan
    terms = problem.residuals.terms
    terms = replace(terms, shapes=replace(terms.shapes, channels=np.array([True, False])))
    discrepant = replace(problem, residuals=replace(problem.residuals, terms=terms))
    ensemble = propagate(discrepant, thetas, 0.8, np.random.default_rng(1), KnownErrors(drawn, usable))
    without = propagate(problem, thetas, 0.8, np.random.default_rng(1), KnownErrors(drawn, usable))
    assert without.discrepancy is None
    assert ensemble.failed == 11
    usable[5] = False
    with_discrepancy = (simulated + drawn.discrepancy)[usable]
    noisy = with_discrepancy + drawn.noise[usable] + drawn.white[usable]
    np.testing.assert_allclose(ensemble.mean, (simulated + drawn.mean)[usable].mean(axis=0))
    np.testing.assert_allclose(ensemble.model_lower, np.quantile(with_discrepancy, 0.1, axis=0))
    np.testing.assert_allclose(ensemble.model_upper, np.quantile(with_discrepancy, 0.9, axis=0))
    np.testing.assert_allclose(ensemble.lower, np.quantile(noisy, 0.1, axis=0))
    np.testing.assert_allclose(ensemble.upper, np.quantile(noisy, 0.9, axis=0))
    np.testing.assert_allclose(ensemble.standard_deviation, noisy.std(axis=0))
    np.testing.assert_allclose(ensemble.crps, crps_of_draws(problem.observed, noisy))
    np.testing.assert_allclose(ensemble.probability_below, probability_below(problem.observed, noisy))
    assert (np.isfinite(ensemble.crps) == np.isfinite(problem.observed)).all()
    discrepancy = drawn.discrepancy[usable]
    expected = [discrepancy.mean(axis=0), *np.quantile(discrepancy, [0.1, 0.9], axis=0)]
    np.testing.assert_allclose(ensemble.discrepancy, expected)


def test_duty_is_a_share_of_the_problems_own_window(problem):
    scenario = problem.scenario
    for window in ("train", "test"):
        span = scenario.windows[window]
        other = replace(problem, name=window, start=np.datetime64(span.start))
        assert other.duration == (span.end - span.start).total_seconds()


def test_telemetry_of_the_model_itself_is_anywhere_in_the_drawn_distribution(problem):
    """Also where draws are on one side of a switch and on the other: half of them are warmer, whatever the shape."""
    thetas = thetas_of(problem, 460, link=0.02)
    rng = np.random.default_rng(5)
    told = []
    for theta in thetas[400:]:
        new = problem.simulate(theta).temperatures
        telemetry = new + problem.noise(theta) * rng.standard_normal(new.shape)
        told.append(propagate(replace(problem, observed=telemetry), thetas[:400], 0.9, rng).probability_below)
    for bound in (0.1, 0.25, 0.5, 0.75, 0.9):
        shares = (np.stack(told) < bound).mean(axis=(1, 2))  # of windows, whose samples depend on each other
        assert shares.mean() == pytest.approx(bound, abs=4 * shares.std() / np.sqrt(len(shares)))
