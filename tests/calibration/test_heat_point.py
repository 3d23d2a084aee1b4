"""The problem with heat around what was found."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from flightcal.calibration.find_heat import find_heat
from flightcal.calibration.heat_point import bend, follow, moved, start_with_heat
from flightcal.probability import Gains
from flightcal.problem import at_sizes, responses, unit_heats
from flightcal.simulator import TIME_ERROR
from tests.calibration.heated import pattern, problem_of, scores, sizes_of, spread_draws, written


def test_the_problem_begins_at_what_was_found(started):
    problem, point, heated, z, _ = started
    theta = dict(zip(heated.names, heated.to_theta(z), strict=True))
    for name, value in zip(problem.names, point.theta, strict=True):
        if name in theta and name not in point.sizes:
            assert theta[name] == pytest.approx(value, rel=1e-9), name
    for name, value in point.sizes.items():
        if name in theta:
            assert theta[name] == pytest.approx(value, rel=1e-9), name


def test_what_was_found_is_next_to_the_mode_at_these_sizes(started):
    _, _, heated, z, known = started
    start = np.array([z[heated.names.index(name)] for name in known.names])
    gradient, hessian = known.log_density_and_gradient(start)[1], known.gauss_newton_hessian(start)
    # It was looked for without the tilt.
    gradient = gradient - known.heat.tilt_of(known.names).slope
    # Where no tag is off the density has a kink: between the samples of a switch the heater has half of its power.
    smooth = [k for k, name in enumerate(known.names) if name != TIME_ERROR]
    gradient, hessian = gradient[smooth], hessian[np.ix_(smooth, smooth)]
    # In its deviations: a step that the search would take next.
    step = np.linalg.solve(hessian, gradient)
    assert np.abs(step * np.sqrt(np.diag(hessian))).max() < 0.3
    assert np.sqrt(step @ hessian @ step) < 0.5


def test_what_is_linear_is_the_next_step_in_the_problem(started):
    problem, point, heated, z, known = started
    start = np.array([z[heated.names.index(name)] for name in known.names])
    mean, factor = point.around.of_z(sizes_of(point))
    order = [known.names.index(problem.names[k]) for k in point.around.moving]
    gradient, hessian = known.log_density_and_gradient(start)[1], known.gauss_newton_hessian(start)
    gradient = gradient - known.heat.tilt_of(known.names).slope
    expected = (start + np.linalg.solve(hessian, gradient))[order]
    np.testing.assert_allclose(np.linalg.solve(factor, mean - expected), 0.0, atol=0.05)
    whole = np.linalg.solve(np.linalg.cholesky(np.linalg.inv(hessian)[np.ix_(order, order)]), factor)
    np.testing.assert_allclose(whole @ whole.T, np.eye(len(order)), atol=0.05)


def test_the_cost_is_that_of_the_problem_but_for_what_is_not_linear(started):
    """The log density of z at its mode, integrated by Laplace, changes with the sizes as the cost does."""
    _, point, heated, z, _ = started
    around, sizes = point.around, sizes_of(point)
    place = max(k for k in around.free if around.sizes.names[k].endswith("pattern"))
    heated = replace(heated, heat=replace(heated.heat, tilted={}))
    found, expected = [], []
    for share in (1.0, 1.3):
        moved = sizes.copy()
        moved[place] *= share
        found.append(-around.cost(scores(around, moved), sizes)[0])
        theta = heated.to_theta(z)
        theta[heated.names.index(around.sizes.names[place])] *= share
        known = at_sizes(heated, theta)
        start = np.array([z[heated.names.index(name)] for name in known.names])
        gradient, hessian = known.log_density_and_gradient(start)[1], known.gauss_newton_hessian(start)
        at_mode = known.log_density(start) + 0.5 * gradient @ np.linalg.solve(hessian, gradient)
        prior = stats.norm.logpdf(scores(around, moved)[list(around.free).index(place)])
        expected.append(at_mode - 0.5 * np.linalg.slogdet(hessian)[1] + prior)
    assert found[1] - found[0] == pytest.approx(expected[1] - expected[0], abs=0.05)


def test_spread_draws_are_thetas_of_the_problem_with_heat(started):
    problem, point, heated, _, _ = started
    mean, factor = point.around.of_z(sizes_of(point))

    theta = spread_draws(started, 2, 100, np.random.default_rng(0))

    assert theta.shape == (2, 100, len(heated.names))
    flat = theta.reshape(200, -1)
    assert np.isfinite(heated.to_z(flat)).all()
    for name in heated.heat.names:
        drawn = np.log(flat[:, heated.names.index(name)])
        assert 0.02 < drawn.std() < 2.0, name
    names = [problem.names[k] for k in point.around.moving]
    inside = heated.to_z(flat)[:, [heated.names.index(name) for name in names]]
    # Wider than at one size, and in the same place, as far as 64 draws of the sizes tell.
    deviation = np.sqrt((factor**2).sum(axis=1))
    assert (np.abs(inside.mean(axis=0) - mean) < deviation).all()
    assert (inside.std(axis=0) > 0.7 * deviation).all()


def log_determinant(problem, point, theta, noise):
    """Of the telemetry's covariance at theta, with the heat of a problem that knows its sizes, as a dense matrix."""
    (window,) = problem.windows
    units = unit_heats(point.model, window)
    found = responses(window, problem.at(window, theta[None])[0], point.model, units)
    kept = np.concatenate([response @ basis for response, basis in zip(found, point.model.kept, strict=True)], axis=2)
    columns = np.concatenate([kept[window.valid[:, k], k] for k in range(kept.shape[1])])
    roots = window.roots(problem.at(window, theta[None])[0])
    return np.linalg.slogdet(noise + (columns * roots**2) @ columns.T)[1]


def test_the_density_has_the_slope_of_what_the_response_to_heat_changes_by(tmp_path):
    content = written(heaters=False)
    content["noise"] = {"standard_deviation": "0.1 K"}
    problem = problem_of(tmp_path, content, panel=pattern)
    point = find_heat(problem, problem.priors.median())
    heated, z = start_with_heat(problem, point)
    known = at_sizes(heated, heated.to_theta(z))
    (window,) = known.windows
    start = np.array([z[heated.names.index(name)] for name in known.names])
    deviations = window.numbers(known.at(window, known.to_theta(start)[None])[0])[:, 0]
    noise = np.diag(np.repeat(deviations**2, window.valid.sum(axis=0)))
    tilt = known.priors.tilt
    assert set(point.model.tilted) == {*known.scenario.parameters}
    for k, name in enumerate(known.names):
        if name in point.model.tilted:
            sides = []
            for sign in (1.0, -1.0):
                moved = start.copy()
                moved[k] += sign * 0.02
                sides.append(-0.5 * log_determinant(known, point, known.to_theta(moved), noise))
            assert tilt.slope[k] == pytest.approx((sides[0] - sides[1]) / 0.04, rel=0.1, abs=0.02), name
    assert max(map(abs, tilt.slope)) > 1.0


def test_a_point_that_moves_takes_the_weights_along_that_are_expected_there(started):
    _, point, heated, z, _ = started
    theta = heated.to_theta(z)
    theta[0] *= 1.05
    there = moved(point, heated, theta)
    assert there.theta[point.names.index(heated.names[0])] == pytest.approx(theta[0])
    # Weights that are expected leave the least residual: none of its directions is left.
    gains = Gains([window.terms for window in heated.windows], heated.weighed, *heated.heat_sizes(theta[None]))
    runs = heated.simulate(theta)
    left = [
        residual - window.heat.response @ there.model.centre
        for residual, window in zip(heated.heat_left([runs], theta[None]), heated.windows, strict=True)
    ]
    roots = heated.heat_sizes(theta[None])[1][0]
    ((_, factor),) = gains.factors
    # Gradient of squares and prior at the weights: covariance times it is zero.
    np.testing.assert_allclose(gains(left)[0], factor @ factor.T @ (there.model.centre / roots**2), atol=1e-8)


@pytest.fixture(scope="module")
def following(started):
    """What was found, and the problem there, with a response that follows the parameters."""
    problem, point, heated, z, _ = started
    there = follow(problem, point, heated, heated.to_theta(z))
    return there, *start_with_heat(problem, there)


def without(point):
    """The same with one response for all parameters."""
    return replace(point, model=replace(point.model, followed={}))


def test_how_far_a_response_bends_is_the_variance_of_its_growth_where_much_is_told(started, following):
    point, heated, z = following
    places = [k for k in heated.simulated if heated.entries[k].kind == "parameter"]
    near = np.tile(z, (200, 1))
    near[:, places] += np.random.default_rng(0).standard_normal((200, len(places)))
    few, many = (bend(point, heated, heated.to_theta(z + share * (near - z))) for share in (0.1, 0.2))
    assert 0.0 < few < many
    assert many / few == pytest.approx(4.0, rel=0.2)
    assert bend(without(point), start_with_heat(started[0], without(point))[0], heated.to_theta(near)) == 0.0
