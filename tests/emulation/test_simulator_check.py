"""What the simulator itself says of a posterior through its emulator."""

from dataclasses import replace

import numpy as np
import pytest

from flightcal.emulation.simulator_check import density_error, steps, unmatched_switches
from tests import derivative_free


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A problem with a thermostat, 30 thetas near the truth, and the runs there."""
    problem = derivative_free.problem(tmp_path_factory.mktemp("check"), heater=True)
    truth = {"link": 0.65, "panel_size": 1.1, "power": 28.0, "noise.body_temp": 0.1}
    truth |= {"initial.body": 284.0, "initial.panel": 262.0}
    theta = np.array([truth[name] for name in problem.names])
    thetas = theta * (1.0 + 1e-4 * np.random.default_rng(1).standard_normal((30, len(theta))))
    return problem, thetas, derivative_free.runs_at(problem.windows[0], thetas[:, problem.windows[0].simulated])


def test_what_is_exact_has_no_density_error(scene):
    problem, thetas, runs = scene
    assert density_error(problem, problem, thetas, (runs,)) < 1e-6
    assert np.isnan(density_error(problem, problem, thetas[:1], (runs.take(slice(0, 1)),)))


def test_the_density_error_is_that_of_the_log_likelihood(scene):
    problem, thetas, runs = scene
    off = replace(runs, temperatures=runs.temperatures + 0.02 * np.random.default_rng(2).standard_normal((30, 1, 1)))
    (window,) = problem.windows
    squares = [
        np.nansum(((window.observed - both) / window.noise(thetas[0])) ** 2, axis=(1, 2))
        for both in (runs.temperatures, off.temperatures)
    ]
    expected = np.std(0.5 * (squares[0] - squares[1]), ddof=1)
    assert density_error(problem, problem, thetas, (off,)) == pytest.approx(expected, rel=0.01)
    # A bound on how far importance weights would move a mean, and so on what the emulator's posterior is off by.
    weights = np.exp(0.5 * (squares[0] - squares[1]) * 1e-3)
    moved = weights @ thetas / weights.sum() - thetas.mean(axis=0)
    assert (np.abs(moved) / thetas.std(axis=0) < 1.05e-3 * expected).all()


def test_runs_are_the_trajectories_that_the_simulator_gave(scene):
    _, _, runs = scene
    run = runs.trajectories()[3]
    np.testing.assert_array_equal(run.temperatures, runs.temperatures[3])
    assert len(run.switches.time) == np.count_nonzero(np.diff(runs.status[3, :, 0]))


def test_heaters_are_in_step_at_the_truth_and_not_in_another_cycle(scene):
    problem, thetas, runs = scene
    (window,) = problem.windows
    (found,) = steps(window, runs)
    assert (found.heater, found.unmatched) == ("heater", 0.0)
    assert found.measured == np.count_nonzero(np.diff(window.status[:, 0]))
    # Already on at the start, where the telemetry sees it switched on: the local mode that fits all but three samples.
    other = thetas[:3].copy()
    other[:, problem.names.index("initial.body")] = 282.6
    slipped = derivative_free.runs_at(window, other[:, problem.windows[0].simulated])
    assert steps(window, slipped)[0].unmatched >= 1.0
    unmeasured = replace(window, status=np.full_like(window.status, np.nan))
    assert steps(unmeasured, runs) == ()


def at(*times, samples=40):
    """A status that switches at these samples, off at first."""
    return (np.searchsorted(times, np.arange(samples), side="right") % 2).astype(float)


@pytest.mark.parametrize(
    ("measured", "simulated", "count"),
    [
        (at(5, 9, 20, 24), at(5, 9, 20, 24), 0),
        (at(5, 9, 20, 24), at(6, 11, 18, 25), 0),
        (at(5, 9, 20, 24), at(20, 24), 2),
        (at(20, 24), at(5, 9, 20, 24), 2),
        (at(5, 9), at(), 2),
        (at(5, 9, 39), at(5, 9), 0),  # just before the window's end, where the other may be just after it
        (at(5, 9, 20, 24), at(4, 8, 12, 16, 21, 25), 2),
    ],
)
def test_switches_without_a_counterpart_are_counted(measured, simulated, count):
    assert unmatched_switches(measured, simulated) == count
    gap = measured.copy()
    gap[30:33] = np.nan
    assert unmatched_switches(gap, simulated) == count
