"""The steps that flightcal chooses, against steps of a second."""

from copy import deepcopy

import numpy as np
import pytest

from flightcal.scenario import step_tolerance
from flightcal.simulator.drive import Inputs
from flightcal.simulator.steps import StepErrors, _tightened

from .. import small
from .satellites import problem_of, random_satellite

TOLERANCE = 5e-3  # K


def errors(coarse, fine, draws=10):
    """[S, T, N] K, differences of the readings at draws of the prior."""
    thetas = coarse.priors.sample(np.random.default_rng(11), draws)
    runs = [problem.simulate_many(thetas) for problem in (coarse, fine)]
    pairs = [(a[0], b[0]) for a, b in zip(*runs, strict=True) if a and b]
    assert len(pairs) == draws
    return np.stack([a.temperatures - b.temperatures for a, b in pairs])


@pytest.mark.parametrize("seed", [*(pytest.param(k, marks=pytest.mark.slow) for k in (0, 1, 3)), 2, 4])
def test_random_satellites_are_right_to_the_tolerance_at_draws_of_the_prior(tmp_path, seed):
    written = random_satellite(seed)
    chosen, fine = problem_of(tmp_path, written), problem_of(tmp_path, written, step=1.0)
    off = errors(chosen, fine)
    assert np.sqrt(np.mean(off**2)) < TOLERANCE
    assert np.abs(off).max() < 6.0 * TOLERANCE
    accuracy = chosen.windows[0].network.accuracy
    # What is told is what is seen, to the draws that it was seen at.
    worst = np.sqrt(np.mean(off**2, axis=(0, 1)).max())
    assert 0.3 * worst < accuracy.error < TOLERANCE
    assert accuracy.steps == len(chosen.windows[0].network.drive.times) - 1 < 2500


def test_a_looser_tolerance_takes_fewer_steps_and_a_step_that_is_written_is_kept(tmp_path):
    written = random_satellite(1)
    steps = []
    for tolerance in ("0.5 mK", "5 mK", "50 mK"):
        changed = deepcopy(written)
        changed["simulator"]["tolerance"] = tolerance
        accuracy = problem_of(tmp_path, changed).windows[0].network.accuracy
        assert accuracy.error < 1e-3 * float(tolerance.split()[0])
        steps.append(accuracy.steps)
    assert steps[0] > 1.3 * steps[1] > 1.3**2 * steps[2]
    changed = deepcopy(written)
    changed["simulator"]["step"] = "60 s"
    network = problem_of(tmp_path, changed).windows[0].network
    assert np.diff(network.drive.times).max() <= 60.0 + 1e-9
    assert network.accuracy.error > 0.0


def test_the_noise_that_is_written_asks_for_a_tenth_of_it(tmp_path):
    written = random_satellite(1)
    tolerances = []
    for noise in (None, "0.2 K", "0.01 K"):
        changed = deepcopy(written)
        if noise is not None:
            changed["observations"]["node_0_temp"]["noise"] = noise
        tolerances.append(step_tolerance(problem_of(tmp_path, changed).scenario))
    np.testing.assert_allclose(tolerances, [5e-3, 5e-3, 1e-3])


def test_telemetry_at_1_hz_costs_no_more_steps(tmp_path):
    """Samples are no grid points."""
    counts = []
    for seconds in (60, 1):
        scenario, data = small.load(
            tmp_path, small.content() | {"simulator": small.content()["simulator"] | {"step": None}}
        )
        times = np.arange(
            data["time"].values[0], data["time"].values[0] + np.timedelta64(3, "h"), np.timedelta64(seconds, "s")
        )
        simulator = small.network_simulator(
            scenario, data, times[0], times[-1], times, period=small.period_of(scenario)
        )
        counts.append(simulator.accuracy.steps)
        run = simulator.simulate(small.theta_of(simulator, **small.TRUTH))
        assert run.temperatures.shape[0] == len(times)
    assert counts[1] < 1.1 * counts[0]


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_gradient_agrees_with_differences_across_every_kind_of_kink(tmp_path, seed):
    """Shadow, a face's gain and loss of the Sun, changes of mode, located switches: all inside of long steps."""
    problem = problem_of(tmp_path, random_satellite(seed))
    window = problem.windows[0]
    theta = problem.priors.sample(np.random.default_rng(3), 1)[0][window.simulated]
    trajectory, pull_back = window.simulator.linearise(theta)
    weights = np.random.default_rng(0).normal(size=trajectory.temperatures.shape)
    gradient = pull_back(weights)
    assert (len(trajectory.switches.time) >= 3) == (seed % 3 > 0)
    for k in range(len(theta)):
        size = 1e-6 * max(abs(theta[k]), 1.0)
        ends = [theta + sign * size * np.eye(len(theta))[k] for sign in (1.0, -1.0)]
        up, down = ((window.simulator.simulate(end).temperatures * weights).sum() for end in ends)
        assert gradient[k] == pytest.approx((up - down) / (2.0 * size), rel=2e-4, abs=2e-4 * np.abs(gradient).max())


def test_a_node_that_the_prior_lets_be_very_light_is_right_at_its_lightest(tmp_path):
    """The four lightest of 400 draws are 15 to 50 times as light as the median; 64 draws rarely have one like them."""
    written = random_satellite(1)
    name = next(name for name in written["simulator"]["nodes"] if name != "node_0")
    written["parameters"] |= {
        "mass": {"scales": ["nodes.node_0.capacity"], "prior": written["parameters"]["mass"]["prior"]},
        "light": {"sets": f"nodes.{name}.capacity", "prior": {"lognormal": {"median": "150 J/K", "factor": 3}}},
    }
    chosen, fine = problem_of(tmp_path, written), problem_of(tmp_path, written, step=1.0)
    thetas = chosen.priors.sample(np.random.default_rng(12), 400)
    thetas = thetas[np.argsort(thetas[:, chosen.priors.names.index("light")])[:4]]
    for coarse, exact in zip(*(problem.simulate_many(thetas) for problem in (chosen, fine)), strict=True):
        assert np.abs(coarse[0].temperatures - exact[0].temperatures).max() < 6.0 * TOLERANCE


@pytest.mark.parametrize(("limit", "longest"), [(170.0, 160.0), (140.0, 130.0), (50.0, None)])
def test_a_grid_that_misses_the_tolerance_by_little_is_tried_with_shorter_steps(limit, longest):
    end, nothing = 20_000.0, np.zeros(0)
    inputs = Inputs(
        np.array([0.0, end]), np.zeros((1, 2)), np.zeros((1, 0)), np.array([0.0, end]), nothing, nothing, nothing
    )

    def compare(grid, halves):
        off = np.zeros((1, len(halves), 1))
        off[0, len(halves) // 2] = 2.5 * TOLERANCE * (1.1 if np.diff(grid).max() > limit else 0.9)
        return StepErrors(off, [nothing])

    found = _tightened(inputs, compare, TOLERANCE, lambda at: np.full(at.shape, 200.0))
    if longest is None:
        assert found is None
    else:
        grid, accuracy = found
        assert np.diff(grid).max() == pytest.approx(longest, rel=0.02)
        assert accuracy.steps == len(grid) - 1
        assert accuracy.largest < 2.5 * TOLERANCE
