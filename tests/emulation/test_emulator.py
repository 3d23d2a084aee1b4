"""The emulator of the small satellite: held-out runs, derivatives, and what it says of heaters."""

import numpy as np
import pytest

from flightcal.emulation.design import start_design
from flightcal.emulation.emulator import EmulatedSimulator, fit_emulator, simulated_priors
from flightcal.emulation.held_out import judge, validate
from flightcal.simulator import SimulationFailure
from tests import derivative_free

TOLERANCE = np.array([0.02, 0.02])


class Case:
    """An emulator from 60 runs through the priors, and 60 others."""

    def __init__(self, folder, heater):
        (self.window,) = derivative_free.problem(folder, heater=heater).windows
        self.scale = simulated_priors(self.window)
        self.runs = derivative_free.runs_at(self.window, start_design(self.scale, 60, seed=1))
        self.unseen = derivative_free.runs_at(self.window, start_design(self.scale, 60, seed=2))
        self.emulator = fit_emulator(self.runs, self.scale, TOLERANCE)
        self.simulator = EmulatedSimulator(self.emulator)


@pytest.fixture(scope="module", params=[False, True], ids=["no heater", "heater"])
def case(request, tmp_path_factory):
    return Case(tmp_path_factory.mktemp("emulator"), request.param)


def test_it_errs_by_as_much_as_it_says_on_runs_it_has_not_seen(case):
    found = validate(case.emulator, case.unseen)
    assert not [reason for reason in found.failures if reason.startswith("all")], found.table()
    if not case.runs.heaters:
        assert found.passed, found.table()
        assert found.channels[-1].rmse < 0.06, found.table()  # of temperatures that differ by tens of kelvin


def test_left_out_runs_say_the_same(case):
    error, deviation = case.emulator.leave_one_out()
    assert judge(error, deviation, case.runs.channels).passed
    unseen = validate(case.emulator, case.unseen)
    assert np.sqrt(np.mean(error**2)) == pytest.approx(unseen.channels[-1].rmse, rel=0.8)


def test_a_run_that_it_was_fitted_to_comes_back(case):
    if case.runs.heaters:
        pytest.skip("a thermostat's jitter is not interpolated")
    run = case.simulator.simulate(case.runs.theta[3])
    np.testing.assert_allclose(run.temperatures, case.runs.temperatures[3], atol=0.05)


def test_its_derivatives_agree_with_finite_differences(case):
    rng = np.random.default_rng(3)
    temperatures_bar = rng.standard_normal(case.window.observed.shape)
    variance_bar = rng.standard_normal(case.simulator.error_basis.shape[2])
    theta = case.scale.to_theta(0.4 * np.ones(5))

    def value(theta):
        run = case.simulator.simulate(theta)
        return np.sum(run.temperatures * temperatures_bar) + run.error_variance @ variance_bar

    run, cotangent = case.simulator.linearise(theta)
    assert np.sum(run.temperatures * temperatures_bar) + run.error_variance @ variance_bar == pytest.approx(
        value(theta)
    )
    steps = np.diag(1e-5 * case.scale.at(0.4 * np.ones(5)).slope)
    differences = [(value(theta + step) - value(theta - step)) / (2 * step.sum()) for step in steps]
    np.testing.assert_allclose(cotangent(temperatures_bar, variance_bar), differences, rtol=1e-4)


def test_a_window_is_a_view_of_the_same_runs(case):
    part = case.simulator.on(slice(100, 180))
    theta = case.runs.theta[5]
    whole, seen = case.simulator.simulate(theta), part.simulate(theta)
    np.testing.assert_allclose(seen.temperatures, whole.temperatures[100:180])
    np.testing.assert_array_equal(seen.status, whole.status[100:180])
    assert part.error_basis.shape == (80, 2, case.simulator.error_basis.shape[2])
    np.testing.assert_array_equal(seen.error_variance, whole.error_variance)
    assert (seen.switches.time >= 0.0).all()


def test_far_from_the_runs_it_is_less_sure_and_farther_it_says_nothing(case):
    middle, corner = case.emulator.predict(np.array([np.zeros(5), np.full(5, 2.0)]))[1]
    assert np.sqrt(np.mean(corner**2)) > 2.0 * np.sqrt(np.mean(middle**2))
    assert all(case.emulator.covers(z) for z in case.scale.to_z(case.runs.theta))
    with pytest.raises(SimulationFailure, match="far from all runs"):
        case.simulator.simulate(case.scale.to_theta(np.full(5, 4.0)))


def test_heaters_do_what_they_did_in_the_nearest_run(case):
    theta = case.unseen.theta[0]
    emulated, real = case.simulator.simulate(theta), case.window.simulator.simulate(theta)
    assert emulated.status.shape == real.status.shape
    if case.runs.heaters:
        assert any(np.array_equal(emulated.status, status) for status in case.runs.status)
        duties = [case.simulator.simulate(theta).duty_cycle[0] for theta in case.unseen.theta]
        truth = case.unseen.status.mean(axis=(1, 2))
        assert np.mean(duties) == pytest.approx(truth.mean(), abs=0.02)
        assert np.sqrt(np.mean((duties - truth) ** 2)) < 0.6 * np.sqrt(2.0) * truth.std()
        changes = np.count_nonzero(np.diff(emulated.status[:, 0]))
        assert len(emulated.switches.time) == changes
        on = emulated.switches.on
        assert set(on) <= {0.0, 1.0}
        assert (on[1:] != on[:-1]).all()


def test_where_theta_is_no_number_the_simulation_fails(case):
    with pytest.raises(SimulationFailure):
        case.simulator.simulate(np.full(5, np.nan))
    assert case.simulator.simulate_many(np.array([np.full(5, np.nan), case.scale.median()]))[0] is None
