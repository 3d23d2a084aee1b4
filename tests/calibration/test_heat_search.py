"""Unmodelled heat found in telemetry that was made with some."""

import numpy as np
import pytest

from flightcal.calibration import heat_search
from flightcal.calibration.find_heat import find_heat, with_found_states
from flightcal.probability import Evidence
from flightcal.problem import patterns_of, split
from tests.calibration.heated import CASES, NODES, PATTERN, TRUE, drift, errors, pattern, problem_of, sizes_of, written


@pytest.mark.parametrize("content", CASES.values(), ids=CASES)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("node", NODES)
def test_parameters_are_right_beside_heat_and_the_heat_is_where_it_was_put(tmp_path, content, node, seed):
    problem = problem_of(tmp_path, content, seed, **{node: pattern})
    point = find_heat(problem, problem.priors.median())
    assert max(map(abs, errors(problem, point).values())) < 4.0, errors(problem, point)
    (other,) = set(NODES) - {node}
    assert point.sizes[f"heat.{node}.pattern"] > 1.5 * point.sizes[f"heat.{other}.pattern"]


def test_the_pattern_that_is_found_is_the_one_that_was_there(found):
    _, point = found
    model = point.model
    (place,) = (k for k, group in enumerate(model.groups) if (group.part, group.node) == ("pattern", 1))
    weights = split(model, model.centre)[place]
    prior = (1.0 + (1.0 / 3.0) ** 2) ** -0.5
    # The first harmonic: the constant and the gain of the sunlight are hard to tell apart, and both from parameters.
    np.testing.assert_allclose(prior * weights[:2], PATTERN[1:], rtol=0.0, atol=0.35)


@pytest.mark.parametrize("node", NODES)
def test_a_secret_load_that_comes_and_goes_is_slow_heat(tmp_path, node):
    content = written(heaters=False)
    content["heat"]["slow"] = {"scale": 0.1}
    problem = problem_of(tmp_path, content, 1, **{node: drift})
    point = find_heat(problem, problem.priors.median())
    (other,) = set(NODES) - {node}
    assert max(map(abs, errors(problem, point).values())) < 4.0
    assert point.sizes[f"heat.{node}.slow"] > 2.0 * point.sizes[f"heat.{other}.slow"]


@pytest.mark.parametrize("node", NODES)
def test_heat_that_drifts_is_far_larger_than_expected_though_no_harmonic_drifts(tmp_path, node):
    problem = problem_of(tmp_path, written(heaters=False), 1, **{node: drift})
    point = find_heat(problem, problem.priors.median())
    shares = {name: point.sizes[name] / prior.scale for name, prior in point.model.priors.items()}
    assert shares[f"heat.{node}.slow"] > 4.0, shares
    assert shares[f"heat.{node}.pattern"] < 1.5, shares


@pytest.mark.parametrize("content", CASES.values(), ids=CASES)
@pytest.mark.parametrize("seed", range(2))
def test_without_any_heat_none_is_found(tmp_path, content, seed):
    problem = problem_of(tmp_path, content, seed)
    point = find_heat(problem, problem.priors.median())
    assert max(map(abs, errors(problem, point).values())) < 4.0
    shares = {name: point.sizes[name] / prior.scale for name, prior in point.model.priors.items()}
    # The logarithm of a size is most probable at its scale: there it is where the telemetry tells nothing.
    # It lies below where heat as large as that would be seen, and above only as noise happens to look like heat.
    assert max(shares.values()) < 1.1, shares
    assert shares["heat.panel.pattern"] < 0.25, shares
    seen_in_part = ("heat.body.constant", "heat.panel.constant", "heat.gains", "heat.panel.slow")
    assert max(shares[name] for name in seen_in_part) < 0.95, shares
    phase = np.linspace(0.0, 1.0, 100, endpoint=False)
    (found,) = patterns_of(point.model, point.model.centre[None], phase)
    assert (found.std(axis=1) < 0.2 * np.hypot(*PATTERN[1:])).all()


def test_with_gaps_in_the_status_heaters_are_held_there(tmp_path):
    problem = problem_of(tmp_path, written(), unseen=range(100, 125), panel=pattern)
    point = find_heat(problem, problem.priors.median())
    (held,) = point.model.held
    assert held.window == "train"
    ((begin, end, heater),) = held.gaps
    assert (heater, begin <= 101 * 60.0, end >= 123 * 60.0) == (0, True, True)
    assert max(map(abs, errors(problem, point).values())) < 4.0


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("node", NODES)
def test_a_heater_without_a_status_is_found_to_do_what_it_did(tmp_path, node, seed):
    content = written()
    del content["simulator"]["heaters"]["heater"]["measured_by"], content["observations"]["heater_status"]
    problem = problem_of(tmp_path, written(), seed, **{node: pattern})
    status, times = problem.windows[0].status[:, 0], problem.windows[0].network.observation.times
    point = find_heat(problem_of(tmp_path, content, seed, **{node: pattern}), problem.priors.median())
    assert max(map(abs, errors(problem, point).values())) < 4.0, errors(problem, point)
    (held,) = point.model.held
    found = np.zeros(len(times))
    for begin, end, _ in held.on:
        found[(times >= begin) & (times < end)] = 1.0
    # Each switch within two samples of the truth: 26 in 361 samples.
    assert np.count_nonzero(np.diff(found)) == np.count_nonzero(np.diff(status)) > 10
    assert np.mean(found != status) < 2.0 * np.count_nonzero(np.diff(status)) / len(status)


def test_what_a_heater_without_a_status_did_is_about_known_beside_thermostats_out_of_step(tmp_path):
    """What is looked at before sampling then has no jumps, as little as what is sampled."""
    content = written()
    problem = problem_of(tmp_path, content, panel=pattern)
    theta = problem.priors.median()
    assert with_found_states(problem, theta) is None, "its status is measured"
    del content["simulator"]["heaters"]["heater"]["measured_by"], content["observations"]["heater_status"]
    (window,) = with_found_states(problem_of(tmp_path, content, panel=pattern), theta).windows
    assert np.isfinite(window.network.drive.measured).all()
    true, found = problem.windows[0].status[:, 0], window.status[:, 0]
    assert np.mean(found != true) < 4.0 * np.count_nonzero(np.diff(true)) / len(true)
    assert np.mean(found != true) < 0.5 * np.mean(np.roll(true, 5) != true)


def test_several_windows_share_the_heat(tmp_path):
    problem = problem_of(tmp_path, written(heaters=False, windows=2), 2, panel=pattern)
    point = find_heat(problem, problem.priors.median())
    assert len(point.around.squares) == 4
    known = dict(zip(problem.names, point.theta, strict=True))
    for name in ("link", "panel_size"):
        k = list(point.around.moving).index(problem.names.index(name))
        mean, factor = point.around.of_z(sizes_of(point))
        true = problem.to_z(np.array([(known | TRUE)[n] for n in problem.names]))[point.around.moving[k]]
        assert abs(mean[k] - true) < 4.0 * np.linalg.norm(factor[k]), name
    assert point.sizes["heat.panel.pattern"] > 1.5 * point.sizes["heat.body.pattern"]


def test_it_makes_no_difference_how_many_groups_of_two_windows_are_looked_at_together(tmp_path, monkeypatch):
    """Switches are of one window each, and the other one has nothing of them."""
    problem = problem_of(tmp_path, written(windows=2), 2, panel=pattern)
    theta = problem.priors.median()
    whole = find_heat(problem, theta)
    assert {group.window for group in whole.model.groups} == {"", "train.first", "train.second"}
    monkeypatch.setattr(heat_search, "_AT_ONCE", 1)
    parted = find_heat(problem, theta)
    np.testing.assert_allclose(parted.theta, whole.theta, rtol=1e-6)


def test_what_the_telemetry_tells_nothing_of_is_left_to_the_prior(found):
    _, point = found
    for basis, group in zip(point.model.kept, point.model.groups, strict=True):
        np.testing.assert_allclose(basis.T @ basis, np.eye(basis.shape[1]), atol=1e-12)
        if group.part == "slow_pattern":
            assert basis.shape[1] < len(basis)
    assert len(point.model.centre) == sum(basis.shape[1] for basis in point.model.kept)


def test_directions_that_only_far_more_heat_would_show_change_nothing(tmp_path, monkeypatch):
    problem = problem_of(tmp_path, written(heaters=False), body=pattern)
    few = find_heat(problem, problem.priors.median())
    monkeypatch.setattr(heat_search, "_LARGER", 1e9)
    all_of_them = find_heat(problem, problem.priors.median())
    kept, every = (
        {group.scale: basis.shape[1] for basis, group in zip(point.model.kept, point.model.groups, strict=True)}
        for point in (few, all_of_them)
    )
    assert kept["heat.panel.pattern"] < every["heat.panel.pattern"]
    (mean, factor), (expected, of_all) = (point.around.of_z(sizes_of(point)) for point in (few, all_of_them))
    deviation = np.linalg.norm(of_all, axis=1)
    np.testing.assert_allclose(mean, expected, rtol=0.0, atol=0.02 * deviation.min())
    np.testing.assert_allclose(np.linalg.norm(factor, axis=1), deviation, rtol=0.01)


def test_no_fit_takes_a_size_further_than_matrices_have_digits_for(without_heaters, monkeypatch):
    problem, name = without_heaters, "noise.body_temp.correlation_time"
    monkeypatch.setattr(heat_search, "_FARTHEST", 0.01)
    point = find_heat(problem, problem.priors.median())
    sizes, place = point.around.sizes, point.around.sizes.names.index(name)
    score = sizes.to_z(sizes_of(point))[place] - sizes.to_z(sizes.median())[place]
    assert 0.0 < abs(score) <= 0.0301


def test_the_beginning_of_a_long_telemetry_tells_the_noise(tmp_path, monkeypatch):
    problem = problem_of(tmp_path, written(heaters=False, windows=2), panel=pattern)
    whole = find_heat(problem, problem.priors.median())
    looked = []
    monkeypatch.setattr(heat_search, "_WORK", 2e5)
    monkeypatch.setattr(
        heat_search, "Evidence", lambda *arguments: looked.append(len(arguments[1][0])) or Evidence(*arguments)
    )
    part = find_heat(problem, problem.priors.median())
    assert 0.3 < max(looked) / len(problem.windows[0].times) < 0.9
    (mean, factor), (expected, of_whole) = (point.around.of_z(sizes_of(point)) for point in (part, whole))
    deviation = np.linalg.norm(of_whole, axis=1)
    assert (abs(mean - expected) < deviation).all()
    np.testing.assert_allclose(np.linalg.norm(factor, axis=1), deviation, rtol=0.5)
