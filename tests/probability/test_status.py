"""Heater status in a problem: what is taken from the telemetry, the density's derivatives, the search for the mode."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from flightcal.calibration import climb, find_mode
from flightcal.calibration.mode import Mode
from flightcal.calibration.posterior import search_record
from flightcal.probability.kernels.switching import DutyCycles, StatusData, StatusSamples
from flightcal.probability.status import THRESHOLD_ERROR, HeaterStatus, heater_status, measured_switches
from flightcal.problem import build_problem
from flightcal.problem.coordinates import whitening
from flightcal.problem.native import DENSITY_NOT_FINITE, REASONS
from flightcal.simulator import open_loop
from flightcal.simulator.system import Switch

from .. import small

INFERRED = {"switch_times": {"error_rate": {"beta": {"alpha": 1, "beta": 99, "lower": 0.0, "upper": 0.5}}}}
TRUTH = {
    "noise.body_temp": 0.1, "initial.body": 285.0, "initial.panel": 262.0, "on_below": 283.15, "off_above": 286.15,
    "timing.heater_status": 15.0, "error_rate.heater_status": 0.01,
} | small.TRUTH  # fmt: skip


def written(likelihood, on_below="10 degC", off_above="13 degC"):
    content = small.content()
    for name, centre in (("on_below", on_below), ("off_above", off_above)):
        prior = {"normal": {"mean": centre, "standard_deviation": "1 K"}}
        content["parameters"][name] = {"sets": f"heaters.heater.{name}", "prior": prior}
    if likelihood is not None:
        content["observations"]["heater_status"]["likelihood"] = likelihood
    content["windows"]["train"]["end"] = "2024-03-01T02:00:00"
    return content


def made(folder, likelihood, **centres):
    scenario, data = small.closed_loop(folder, written(likelihood, **centres))
    data["heater_status"].values[50:60] = np.nan
    return scenario, data


@pytest.fixture(scope="module", params=[INFERRED, {"duty_cycle": {"over": "40 min"}}], ids=["switch times", "duty"])
def problem(request, tmp_path_factory):
    return build_problem(*made(tmp_path_factory.mktemp("status"), request.param))


@pytest.fixture(scope="module")
def inexact(tmp_path_factory):
    """The same of a simulator with an error of its own."""
    content = written(INFERRED)
    error = {"offset": "0.05 K", "deviation": "0.1 K", "correlation_time": "20 min"}
    content["simulator"]["errors"] = {"body_temp": error}
    return build_problem(*small.closed_loop(tmp_path_factory.mktemp("inexact"), content))


def without_status(problem):
    (window,) = problem.windows
    return replace(problem, windows=(replace(window, measured_switches=None, heater_status=None),))


def near_truth(problem, seed):
    z = problem.to_z(np.array([TRUTH[name] for name in problem.names]))
    return z + 0.03 * np.random.default_rng(seed).standard_normal(len(z))


def differences(function, z):
    return np.array([(function(z + step) - function(z - step)) / 2e-5 for step in 1e-5 * np.eye(len(z))])


def test_settings_that_are_inferred_stand_between_noise_and_initial_temperatures(tmp_path):
    problem = build_problem(*made(tmp_path, INFERRED))
    assert problem.names[5:] == (
        "noise.body_temp", "timing.heater_status", "error_rate.heater_status", "initial.body", "initial.panel",
    )  # fmt: skip
    theta = np.array([TRUTH[name] for name in problem.names])
    np.testing.assert_array_equal(problem.windows[0].status_settings(theta), [15.0, 0.01])
    fixed = build_problem(*made(tmp_path, {"switch_times": {"timing": "12 s", "error_rate": 0.002}}))
    assert "timing.heater_status" not in fixed.names
    np.testing.assert_array_equal(fixed.windows[0].status_settings(theta), [12.0, 0.002])


def test_samples_in_a_gap_or_near_the_windows_ends_are_not_used(tmp_path):
    scenario, data = made(tmp_path, {"switch_times": {"timing": "50 s"}})
    window = data.isel(time=slice(0, 121))
    samples = heater_status(scenario, window, small.START).data.samples
    minutes = np.setdiff1d(np.arange(3, 118), np.arange(50, 60))
    np.testing.assert_allclose(samples.time, 60.0 * minutes, rtol=1e-12)
    np.testing.assert_array_equal(samples.on, window["heater_status"].values[minutes])


def test_duty_cycles_are_those_of_the_stretches_without_the_gaps(tmp_path):
    scenario, data = made(tmp_path, {"duty_cycle": {"over": "40 min"}})
    duties = heater_status(scenario, data.isel(time=slice(0, 121)), small.START).data.duties
    np.testing.assert_array_equal(duties.first, [0, 1, 3, 4])
    np.testing.assert_allclose(duties.begin, [0.0, 2400.0, 3600.0, 4800.0], rtol=1e-12)
    np.testing.assert_allclose(duties.end, [2400.0, 2940.0, 4800.0, 7200.0], rtol=1e-12)
    status = data["heater_status"].values
    expected = 0.5 * (status[:-1] + status[1:])
    shares = [expected[:40].mean(), np.r_[expected[40:49], expected[60:80]].mean(), expected[80:120].mean()]
    np.testing.assert_allclose(duties.measured, shares)
    # What lies between two samples belongs to the stretch that its middle is in.
    scenario, data = made(tmp_path, {"duty_cycle": {"over": "41.4 min"}})
    known = np.delete(np.arange(42), [5, 6])
    data["heater_status"].values[[5, 6]] = np.nan
    duties = heater_status(scenario, data.isel(time=slice(0, 121)), small.START).data.duties
    assert duties.end[0] == 2460.0
    # A gap as short as this is known, and counts by its length.
    assert duties.measured[0] == pytest.approx(np.trapezoid(status[known], 60.0 * known) / 2460.0)


def test_the_density_has_what_the_status_adds(problem):
    """That of the same problem without it, and the priors of its settings aside."""
    z = near_truth(problem, 0)
    theta = problem.to_theta(z)
    run, settings = problem.windows[0].simulate(theta), problem.windows[0].status_settings(theta)
    added = problem.windows[0].heater_status.log_likelihood(run, settings)[0]
    assert problem.log_density(z) - without_status(problem).log_density(z) == pytest.approx(added, rel=1e-9)
    assert abs(added) > 1.0


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("loop", ["closed", "open"])
def test_value_and_gradient_agree_with_differences(problem, loop, seed):
    case = problem if loop == "closed" else problem.open_loop
    z = near_truth(problem, seed)
    value, gradient = case.log_density_and_gradient(z)
    assert value == pytest.approx(case.log_density(z), rel=1e-12)
    expected = differences(case.log_density, z)
    np.testing.assert_allclose(gradient, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


def test_more_uncertain_switches_than_there_is_room_for_have_no_density_and_are_named(tmp_path):
    content = small.content()
    content["simulator"]["heaters"]["heater"]["off_above"] = "10.2 degC"
    likelihood = {"switch_times": {"timing": "900 s", "error_rate": 0.01}}
    content["observations"]["heater_status"]["likelihood"] = likelihood
    problem = build_problem(*small.load(tmp_path, content))
    z = problem.to_z(problem.priors.median())
    assert problem.log_density(z) == -np.inf
    density = problem.native_density(whitening(z, np.eye(len(z))))
    assert density(np.zeros(len(z)))[0] == -np.inf
    assert density.last_failure == REASONS[DENSITY_NOT_FINITE]


@pytest.mark.parametrize("loop", ["closed", "open"])
def test_so_they_do_where_the_simulator_has_an_error_of_its_own(inexact, loop):
    case = inexact if loop == "closed" else inexact.open_loop
    assert case.windows[0].simulator.error_basis is not None
    z = near_truth(case, 0)
    value, gradient = case.log_density_and_gradient(z)
    assert value == pytest.approx(case.log_density(z), rel=1e-12)
    expected = differences(case.log_density, z)
    np.testing.assert_allclose(gradient, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())
    assert climb(case, z).log_density > value


def test_the_information_is_that_of_the_moving_switches(problem):
    """Against switches' times at theta next to it: a variance of tau^2 + 60^2 / 12 each, or that of the duty cycles."""
    z = near_truth(problem, 1)
    theta = problem.to_theta(z)
    run = problem.windows[0].simulate(theta)
    moving = differences(lambda z: problem.windows[0].simulate(problem.to_theta(z)).switches.time, z).T
    data, settings = problem.windows[0].heater_status.data, problem.windows[0].status_settings(theta)
    if len(data.duties.measured):
        deviation = []
        for step in 1e-3 * np.eye(len(moving)):
            moved = [replace(run, switches=run.switches._replace(time=run.switches.time + s)) for s in (step, -step)]
            # The derivative of the log likelihood by the measured value, of each duty cycle alone.
            values = []
            for number in range(len(data.duties.measured)):
                at = []
                for case in moved:
                    shifted = []
                    for shift in (1e-4, -1e-4):
                        measured = data.duties.measured.copy()
                        measured[number] += shift
                        other = data._replace(duties=data.duties._replace(measured=measured))
                        status = replace(problem.windows[0].heater_status, data=other)
                        shifted.append(status.log_likelihood(case, settings)[0])
                    at.append((shifted[0] - shifted[1]) / 2e-4)
                values.append((at[0] - at[1]) / 2e-3 * settings[0])
            deviation.append(values)
        rows = np.array(deviation).T
    else:
        seen = (run.switches.time > data.samples.time[0]) & (run.switches.time < data.samples.time[-1])
        gap = (run.switches.time > 2940.0) & (run.switches.time < 3600.0)
        interval = np.where(gap, 660.0, 60.0)
        rows = np.eye(len(moving))[seen] / np.sqrt(settings[0] ** 2 + interval[seen, None] ** 2 / 12.0)
    expected = (rows @ moving).T @ (rows @ moving)
    found = problem.gauss_newton_hessian(z) - without_status(problem).gauss_newton_hessian(z)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)) + 1e-12)
    kept = np.ix_(problem.simulated, problem.simulated)
    np.testing.assert_allclose((found / scale)[kept], (expected / scale)[kept], atol=1e-3)
    assert np.linalg.matrix_rank(expected, tol=1e-6 * expected.max()) > 1


def test_each_heaters_switches_are_known_from_its_own_channels():
    """Two heaters, each with status samples and a duty cycle; a switch says nothing of the other heater."""
    seconds = np.arange(100.0, 901.0, 100.0)
    samples = StatusSamples(
        np.array([0, 1]), np.array([0, 2]), np.array([0, 9, 18]), np.tile(seconds, 2), np.zeros(18)
    )  # fmt: skip
    duties = DutyCycles(
        np.array([0, 1]), np.array([4, 4]), np.array([0, 1, 2]), np.zeros(2), np.full(2, 1000.0), np.zeros(2)
    )  # fmt: skip
    status = HeaterStatus(StatusData(samples, duties), np.array([10.0, 0.1, 20.0, 0.2, 0.05]), {})
    # The first comes before the samples and the last after them.
    switches = Switch(
        np.array([50.0, 150.0, 450.0, 650.0, 950.0]), np.array([0, 1, 0, 1, 0]), np.array([1, 1, 0, 0, 1])
    )
    rows, precision = status.information(SimpleNamespace(switches=switches), status.settings)
    variance = np.array([10.0, 20.0])[switches.heater] ** 2 + 100.0**2 / 12.0
    moves = np.where(switches.on > 0.5, 1.0, -1.0) / (1000.0 * 0.05)
    expected = np.diag([0.0, 1.0, 1.0, 1.0, 0.0] / variance)
    for heater in range(2):
        row = np.where(switches.heater == heater, moves, 0.0)
        expected += np.outer(row, row)
    np.testing.assert_allclose(rows.T @ rows, expected, rtol=1e-12)
    first, second = (2.0 * tau**2 / (tau**2 + 100.0**2 / 12.0) ** 2 for tau in (10.0, 20.0))
    np.testing.assert_allclose(precision, [first, 9 / 0.09, 2.0 * second, 9 / 0.16, 0.0], rtol=1e-12)


def test_in_open_loop_the_sensor_is_at_its_threshold_when_the_heater_is_seen_to_switch(problem):
    """The density falls by the squared distance; its curvature by the thresholds is one row for each switch."""
    opened = problem.open_loop
    switches = opened.windows[0].measured_switches
    status = problem.windows[0].status[:, 0]
    assert len(switches.time) == np.sum(np.abs(np.diff(status)) == 1.0) >= 6
    theta = np.array([TRUTH[name] for name in problem.names])
    excess, pull_back = opened.windows[0].simulator.threshold_excess(theta[opened.simulated], switches)
    # The heater switches halfway between samples, up to half a minute off; it moves by less than 0.02 K/s.
    assert (np.abs(excess) < 0.6).all()
    assert np.abs(excess).max() > 0.01
    z = problem.to_z(theta)
    without = without_status(opened)
    added = opened.log_density(z) - without.log_density(z)
    assert added == pytest.approx(-0.5 * (excess**2).sum() / THRESHOLD_ERROR**2, rel=1e-6)
    rows = np.array([pull_back(row) for row in np.eye(len(excess))])
    upper = opened.windows[0].simulator.parameters.index("off_above")
    np.testing.assert_allclose(rows[:, upper], np.where(switches.on > 0.5, 0.0, -1.0), atol=1e-12)


def test_in_open_loop_too_a_failed_simulation_has_no_density(problem):
    value, gradient = problem.open_loop.log_density_and_gradient(np.full(len(problem.names), 1e200))
    assert problem.open_loop.windows[0].measured_switches is not None
    assert value == -np.inf
    assert not gradient.any()


def test_open_loop_looks_at_thresholds_only_where_they_are_uncertain_or_status_counts(tmp_path):
    scenario, data = small.load(tmp_path)
    assert measured_switches(open_loop(scenario), data, small.START) is None
    scenario, data = small.load(tmp_path, written(None))
    assert measured_switches(scenario, data, small.START) is None
    assert measured_switches(open_loop(scenario), data, small.START) is not None


@pytest.mark.parametrize("likelihood", [None, INFERRED], ids=["temperatures alone", "status too"])
def test_the_mode_is_found_with_thresholds_two_kelvin_off_the_middle_of_their_priors(tmp_path, likelihood):
    problem = build_problem(*made(tmp_path, likelihood, on_below="8 degC", off_above="15 degC"))
    mode = find_mode(problem, [], rng=np.random.default_rng(0), random_starts=3)[0]
    truth = problem.to_z(np.array([TRUTH[name] for name in problem.names]))
    deviation = np.sqrt(np.diag(np.linalg.inv(problem.gauss_newton_hessian(mode.z))))
    assert mode.converged
    assert (np.abs(mode.z - truth) < 4 * deviation).all()


def test_the_open_loop_brings_thresholds_near_the_truth(tmp_path):
    content = written(None, on_below="8 degC", off_above="15 degC")
    problem = build_problem(*small.closed_loop(tmp_path, content)).open_loop
    mode = climb(problem, problem.to_z(problem.priors.median()))
    theta = problem.to_theta(mode.z)
    for name in ("on_below", "off_above"):
        assert theta[problem.names.index(name)] == pytest.approx(TRUTH[name], abs=0.5)


def test_a_scenario_that_gives_status_no_likelihood_has_none(tmp_path):
    problem = build_problem(*small.closed_loop(tmp_path))
    assert problem.windows[0].heater_status is None
    assert problem.open_loop.windows[0].measured_switches is None
    assert problem.windows[0].status_settings(np.zeros(len(problem.names))).size == 0


@pytest.mark.parametrize("likelihood", [None, INFERRED], ids=["temperatures alone", "status too"])
def test_the_search_is_put_on_record(tmp_path, likelihood):
    written_without = small.content() if likelihood is None else written(likelihood)
    problem = build_problem(*small.closed_loop(tmp_path, written_without))
    record = search_record(problem, [Mode(np.zeros(1), -np.inf, False, "prior draw 1")])
    assert record["sought"].startswith("in open loop")
    assert ("thresholds" in record["sought"]) == (likelihood is not None)
    assert record["modes"] == [{"origin": "prior draw 1", "log_density": None, "converged": False}]
    assert search_record(problem.open_loop, [])["sought"].startswith("in open loop alone")
    assert search_record(replace(problem, open_loop=None), [])["sought"] == "in closed loop"
