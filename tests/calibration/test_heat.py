"""Unmodelled heat found in telemetry that was made with some, and the linear algebra around what was found."""

from dataclasses import replace

import numpy as np
import pytest
import xarray
from scipy import stats
from scipy.linalg import block_diag

from flightcal.calibration import calibrate_nuts, heat_search, with_heat
from flightcal.calibration.heat_check import check_heat
from flightcal.calibration.heat_file import heat_dataset, with_kept_heat
from flightcal.calibration.heat_point import bend, draw_sizes, follow, moved, spread_sizes, start_with_heat
from flightcal.calibration.heat_search import find_heat
from flightcal.calibration.sizes import Around
from flightcal.probability import Gains, Priors
from flightcal.problem import at_sizes, build_problem, patterns_of, responses, split, unit_heats
from flightcal.scenario import HalfNormal, HalfStudentT, NutsSettings
from flightcal.simulator import network_simulator
from tests import small

HOURS = 6
PATTERN = (0.5, 0.8, -0.6)
"""W: constant, and cosine and sine of the orbit."""
PROCESS, WHITE, TIME = 0.12, 0.05, 500.0
"""Of the body's noise: K, K and s; the panel's is 0.1 K and independent."""
NODES = ("body", "panel")
TRUE = small.TRUTH | {"initial.body": 285.0, "initial.panel": small.TRUTH["initial_panel"]}


def written(*, heaters=True, windows=1):
    content = small.content() | {"heat": {"pattern": {"harmonics": 2}}}
    content["noise"] = {
        "model": "ar1",
        "standard_deviation": {"half_normal": "1 K"},
        "white": {"half_normal": "0.5 K"},
        "correlation_time": {"lognormal": {"median": "5 min", "factor": 2}},
    }
    content["windows"] = {"train": {"start": "2024-03-01T00:00:00", "end": f"2024-03-01T{HOURS:02d}:00:00"}}
    if windows == 2:
        content["windows"] = {
            "train": {
                "first": {"start": "2024-03-01T00:00:00", "end": "2024-03-01T03:00:00"},
                "second": {"start": "2024-03-01T03:30:00", "end": "2024-03-01T06:00:00"},
            }
        }
    if not heaters:
        del content["simulator"]["heaters"], content["observations"]["heater_status"], content["parameters"]["power"]
    return content


def pattern(seconds):
    angle = 2.0 * np.pi * seconds / small.PERIOD
    return PATTERN[0] + PATTERN[1] * np.cos(angle) + PATTERN[2] * np.sin(angle)


def drift(seconds):
    return 0.8 * np.sin(2.0 * np.pi * seconds / (3.3 * small.PERIOD))


def problem_of(folder, content, seed=0, unseen=(), **heat):
    """With telemetry of the scenario's own model at `TRUE`, and heat (W, of seconds) into nodes by name.

    unseen: minutes without a status.
    """
    scenario, data = small.load(folder, content)
    times, rng = data["time"].values, np.random.default_rng(seed)
    period = small.period_of(scenario)
    simulator = network_simulator(scenario, data, times[0], times[-1], times, period=period, heated=NODES)
    ends = np.stack([simulator.drive.times[:-1], simulator.drive.times[1:]], axis=1).ravel()
    watts = np.stack([heat[name](ends) if name in heat else np.zeros(len(ends)) for name in NODES])
    run = simulator.with_heat(watts).simulate(small.theta_of(simulator, **small.TRUTH))
    apart = 60.0 * np.abs(np.subtract.outer(np.arange(len(times)), np.arange(len(times))))
    process = np.linalg.cholesky(PROCESS**2 * np.exp(-apart / TIME)) @ rng.standard_normal(len(times))
    noise = {"body_temp": process + WHITE * rng.standard_normal(len(times))}
    noise["panel_temp"] = 0.1 * rng.standard_normal(len(times))
    for k, channel in enumerate(simulator.channels):
        data[channel].values[:] = run.temperatures[:, k] + noise[channel]
    if len(simulator.heaters):
        data["heater_status"].values[:] = run.status[:, 0]
        data["heater_status"].values[list(unseen)] = np.nan
    return build_problem(scenario, data)


def sizes_of(point):
    return np.array([point.sizes[name] for name in point.around.sizes.names])


def errors(problem, point):
    """Of the parameters and initial temperatures, in their deviations, by name."""
    mean, factor = point.around.of_z(sizes_of(point))
    names = [problem.names[k] for k in point.around.moving]
    known = dict(zip(problem.names, problem.priors.median(), strict=True)) | TRUE
    true = problem.to_z(np.array([known[name] for name in problem.names]))[point.around.moving]
    return dict(zip(names, (mean - true) / np.sqrt((factor**2).sum(axis=1)), strict=True))


CASES = {"open loop": written(), "without heaters": written(heaters=False)}


@pytest.fixture(scope="module", params=CASES)
def found(request, tmp_path_factory):
    """Telemetry with heat in the panel alone, and what was found in it."""
    problem = problem_of(tmp_path_factory.mktemp("heat"), CASES[request.param], panel=pattern)
    return problem, find_heat(problem, problem.priors.median())


# --- what is found ------------------------------------------------------------------------------------------------


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
    assert shares[f"heat.{node}.slow_pattern"] < 1.5, shares


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
    assert max(shares[name] for name in seen_in_part) < 0.85, shares
    phase = np.linspace(0.0, 1.0, 100, endpoint=False)
    (found,) = patterns_of(point.model, point.model.centre[None], phase)
    assert (found.std(axis=1) < 0.2 * np.hypot(*PATTERN[1:])).all()


def test_with_gaps_in_the_status_heaters_are_held_there(tmp_path):
    problem = problem_of(tmp_path, written(), unseen=range(100, 125), panel=pattern)
    point = find_heat(problem, problem.priors.median())
    (held,) = point.model.held
    assert held.window == "train"
    assert {step for step, _, _ in held.shares} >= set(range(2 * 101, 2 * 123))
    assert max(map(abs, errors(problem, point).values())) < 4.0


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


def test_what_the_telemetry_tells_nothing_of_is_left_to_the_prior(found):
    _, point = found
    for basis, group in zip(point.model.kept, point.model.groups, strict=True):
        np.testing.assert_allclose(basis.T @ basis, np.eye(basis.shape[1]), atol=1e-12)
        if group.part == "slow_pattern":
            assert basis.shape[1] < len(basis)
    assert len(point.model.centre) == sum(basis.shape[1] for basis in point.model.kept)


# --- around it ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def linear():
    """`Around` of two windows of two channels, the second's noise known; columns and residuals of each part."""
    rng = np.random.default_rng(0)
    counts, r, m = (30, 25, 20, 28), 9, 6
    columns = [rng.normal(size=(count, r)) for count in counts]
    left = [rng.normal(size=count) for count in counts]
    names = ("noise.a", "noise.a.correlation_time", "heat.x", "heat.y")
    half_normals = (HalfNormal(scale=scale) for scale in (1.0, 300.0, 0.5))
    sizes = Priors(names, (*half_normals, HalfStudentT(scale=2.0, degrees_of_freedom=3.0)))
    around = Around(
        bases=(),
        sizes=sizes,
        free=np.array([0, 2, 3]),
        noise=np.array([0, -1]),
        held=np.array([np.nan, 0.7]),
        scale=np.array([2, 2, 3, 3, 3, -1]),
        mean=rng.normal(size=r - m),
        deviation=rng.uniform(0.5, 2.0, r - m),
        moving=np.array([0, 2, 3]),
        gram=np.stack([own.T @ own for own in columns]),
        moment=np.stack([own.T @ y for own, y in zip(columns, left, strict=True)]),
        squares=np.array([y @ y for y in left]),
        samples=np.array(counts),
        determinant=rng.normal(size=4),
    )
    return around, columns, left


SIZES = np.array([0.9, 250.0, 0.4, 1.3])


def dense(linear, sizes):
    """Columns, residuals, covariance of the noise, and prior variances of the unknowns."""
    around, columns, left = linear
    deviations = [sizes[0], 0.7, sizes[0], 0.7]
    noise = block_diag(*(d**2 * np.eye(len(y)) for d, y in zip(deviations, left, strict=True)))
    roots = np.array([*sizes[[2, 2, 3, 3, 3]], 1.0, *around.deviation])
    return np.concatenate(columns), np.concatenate(left), noise, roots**2


def scores(around, sizes):
    """Normal scores [free] of those of the sizes [s] that are free."""
    return np.array([stats.norm.ppf(below(around.sizes.priors[k], sizes[k])) for k in around.free])


def below(prior, size):
    """Probability below a size."""
    if isinstance(prior, HalfStudentT):
        return 2.0 * stats.t.cdf(size / prior.scale, prior.degrees_of_freedom) - 1.0
    return stats.halfnorm.cdf(size / prior.scale)


@pytest.mark.parametrize("factor", [1.0, 0.3, 4.0])
def test_the_cost_of_sizes_is_that_of_the_dense_normal_and_their_prior(linear, factor):
    around = linear[0]
    sizes = SIZES * (factor, 1.0, factor, 1.0 / factor)
    columns, left, noise, variance = dense(linear, sizes)
    expected = stats.multivariate_normal.logpdf(left, cov=noise + columns * variance @ columns.T)
    expected += 0.5 * len(left) * np.log(2.0 * np.pi) - 0.5 * around.determinant.sum()
    at = scores(around, sizes)
    value, gradient = around.cost(at, SIZES)
    held = Priors(around.sizes.names[1:2], around.sizes.priors[1:2])
    prior = stats.norm.logpdf(at).sum() + float(held.at(held.to_z(SIZES[1:2])).log_density)
    assert -value == pytest.approx(expected + prior, rel=1e-9)
    for k, step in enumerate(1e-5 * np.eye(3)):
        sides = [around.cost(at + sign * step, SIZES)[0] for sign in (1.0, -1.0)]
        assert gradient[k] == pytest.approx((sides[0] - sides[1]) / 2e-5, rel=1e-6, abs=1e-5)


def test_the_weights_covariance_and_how_many_are_told_are_those_of_the_dense_normal(linear):
    around, (columns, _, noise, variance) = linear[0], dense(linear, SIZES)
    weights = columns[:, :6]
    expected = np.linalg.inv(np.diag(1.0 / variance[:6]) + weights.T @ np.linalg.solve(noise, weights))
    covariance, told = around.known_of_weights(SIZES)
    np.testing.assert_allclose(covariance, expected, rtol=1e-9)
    assert told == pytest.approx(6.0 - np.trace(expected / variance[:6]))


def test_z_at_given_sizes_is_that_of_the_dense_conditional_normal(linear):
    around = linear[0]
    columns, left, noise, variance = dense(linear, SIZES)
    wide = columns * variance
    gain = np.linalg.solve(noise + wide @ columns.T, wide).T
    mean, factor = around.of_z(SIZES)
    np.testing.assert_allclose(mean, around.mean + (gain @ left)[6:], atol=1e-10)
    np.testing.assert_allclose(factor @ factor.T, (np.diag(variance) - gain @ wide)[6:, 6:], atol=1e-10)


def test_the_most_probable_sizes_have_the_least_cost(linear):
    around = linear[0]
    sizes = around.most_probable(SIZES)
    at = scores(around, sizes)
    value, gradient = around.cost(at, sizes)
    assert sizes[1] == pytest.approx(SIZES[1], rel=1e-12)
    assert np.abs(gradient).max() < 0.01
    for move in 0.3 * np.random.default_rng(0).standard_normal((20, 3)):
        assert around.cost(at + move, sizes)[0] > value


def test_drawn_sizes_are_distributed_as_their_cost_says(linear):
    around, count = linear[0], 800
    sizes = around.most_probable(SIZES)
    drawn = around.draw_sizes(sizes, count, np.random.default_rng(1))
    assert (np.abs(drawn[:, 1] / sizes[1] - 1.0) < 1e-9).all()
    at = scores(around, sizes)
    axes = [middle + np.linspace(-span, span, 16) for middle, span in zip(at, (0.7, 3.0, 3.0), strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    density = np.exp(around.cost(at, sizes)[0] - [around.cost(point, sizes)[0] for point in grid])
    density /= density.sum()
    of_grid = np.stack(
        [around.sizes.priors[k].scale * stats.halfnorm.ppf(stats.norm.cdf(grid[:, i])) for i, k in enumerate((0, 2))]
        + [2.0 * stats.t.ppf(0.5 + 0.5 * stats.norm.cdf(grid[:, 2]), 3.0)],
        axis=1,
    )
    # Standard errors are 3%. The normal distribution of the scores alone has means that are a quarter off.
    np.testing.assert_allclose(drawn[:, around.free].mean(axis=0), density @ of_grid, rtol=0.12)


def test_sizes_of_which_the_telemetry_tells_nothing_are_drawn_from_their_prior(linear):
    around, count = linear[0], 1000
    gram, moment = around.gram.copy(), around.moment.copy()
    gram[:, :5], gram[:, :, :5], moment[:, :5] = 0.0, 0.0, 0.0
    blind = replace(around, gram=gram, moment=moment)
    drawn = blind.draw_sizes(blind.most_probable(SIZES), count, np.random.default_rng(0))
    for k in (2, 3):
        prior = blind.sizes.priors[k]
        assert stats.kstest(drawn[:, k], lambda sizes, prior=prior: below(prior, sizes)).pvalue > 1e-4


def draws_at(around, sizes, count=40):
    """z [S, d] of which those that are simulated are drawn at sizes."""
    rng = np.random.default_rng(3)
    z = rng.normal(size=(count, 5))
    mean, factor = around.of_z(sizes)
    z[:, around.moving] = mean + rng.standard_normal((count, len(mean))) @ factor.T
    return z


def test_draws_at_the_same_sizes_stay_where_they_are(linear):
    around = linear[0]
    z = draws_at(around, SIZES)
    spread, sizes = around.spread(z, SIZES, SIZES[None], np.random.default_rng(0))
    np.testing.assert_allclose(spread, z, rtol=0.0, atol=1e-9)
    np.testing.assert_array_equal(sizes, np.tile(SIZES, (len(z), 1)))


def test_draws_at_other_sizes_have_the_mean_and_covariance_of_these(linear):
    around, other = linear[0], SIZES * (0.5, 1.0, 2.0, 0.7)
    z = draws_at(around, SIZES)
    spread, sizes = around.spread(z, SIZES, other[None], np.random.default_rng(0))
    (mean, factor), (new_mean, new_factor) = around.of_z(SIZES), around.of_z(other)
    standard = np.linalg.solve(factor, (z[:, around.moving] - mean).T)
    np.testing.assert_allclose(
        np.linalg.solve(new_factor, (spread[:, around.moving] - new_mean).T), standard, rtol=0.0, atol=1e-9
    )
    still = np.setdiff1d(np.arange(5), around.moving)
    np.testing.assert_array_equal(spread[:, still], z[:, still])
    assert (sizes == other).all()


def test_all_drawn_sizes_have_as_many_draws(linear):
    around = linear[0]
    drawn = SIZES * np.random.default_rng(1).uniform(0.5, 2.0, (64, len(SIZES)))
    sizes = around.spread(draws_at(around, SIZES, 400), SIZES, drawn, np.random.default_rng(0))[1]
    _, counts = np.unique(sizes, axis=0, return_counts=True)
    assert len(counts) == 64
    assert counts.max() - counts.min() <= 1


# --- the problem around it ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def started(found):
    """Problems without heat, with it, and at known sizes, with what was found and where to begin."""
    problem, point = found
    heated, z = start_with_heat(problem, point)
    return problem, point, heated, z, at_sizes(heated, heated.to_theta(z))


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
        own = stats.norm.logpdf(scores(around, moved)[list(around.free).index(place)])
        expected.append(at_mode - 0.5 * np.linalg.slogdet(hessian)[1] + own)
    assert found[1] - found[0] == pytest.approx(expected[1] - expected[0], abs=0.05)


def test_spread_draws_are_thetas_of_the_problem_with_heat(started):
    problem, point, heated, _, known = started
    rng = np.random.default_rng(0)
    mean, factor = point.around.of_z(sizes_of(point))
    order = [known.names.index(problem.names[k]) for k in point.around.moving]
    z = np.zeros((2, 100, len(known.names)))
    z[..., order] = mean + rng.standard_normal((2, 100, len(mean))) @ factor.T

    theta = spread_sizes(problem, heated, point, known, z, draw_sizes(point, rng), rng)

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


def test_simulations_with_their_heat_confirm_the_linear_response(started):
    problem, point, heated, _, known = started
    rng = np.random.default_rng(1)
    mean, factor = point.around.of_z(sizes_of(point))
    order = [known.names.index(problem.names[k]) for k in point.around.moving]
    z = np.zeros((1, 60, len(known.names)))
    z[..., order] = mean + rng.standard_normal((1, 60, len(mean))) @ factor.T
    thetas = spread_sizes(problem, heated, point, known, z, draw_sizes(point, rng), rng)[0]

    checked = check_heat(heated, thetas, rng)

    assert checked.draws == 60
    assert checked.difference < 0.01
    # k is a shape: of weights that hardly differ it says nothing.
    assert checked.pareto_k < 0.7 or checked.relative < 0.01


def log_determinant(problem, point, theta, noise):
    """Of the telemetry's covariance at theta, with the heat of a problem that knows its sizes, as a dense matrix."""
    (window,) = problem.windows
    units = unit_heats(point.model, window)
    found = responses(window, problem.at(window, theta[None])[0], point.model, units)
    kept = np.concatenate([own @ basis for own, basis in zip(found, point.model.kept, strict=True)], axis=2)
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
    assert set(point.model.tilted) == {name for name in known.names if not name.startswith("initial.")}
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
        own - window.heat.response @ there.model.centre
        for own, window in zip(heated.heat_left([runs], theta[None]), heated.windows, strict=True)
    ]
    roots = heated.heat_sizes(theta[None])[1][0]
    ((_, factor),) = gains.factors
    # Gradient of squares and prior at the weights: covariance times it is zero.
    np.testing.assert_allclose(gains(left)[0], factor @ factor.T @ (there.model.centre / roots**2), atol=1e-8)


# --- a response that follows the parameters -----------------------------------------------------------------------


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


@pytest.fixture(scope="module")
def without_heaters(tmp_path_factory):
    return problem_of(tmp_path_factory.mktemp("heat"), CASES["without heaters"], panel=pattern)


@pytest.fixture(scope="module")
def followed_posterior(without_heaters):
    """A posterior of a response that has to be followed however little it bends."""
    problem = without_heaters
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(with_heat, "_STRAIGHT", 1e-9)
        return calibrate_nuts(problem, NutsSettings(chains=2, warmup=150, draws=100), seed=3)


def test_where_the_response_bends_much_the_draws_are_of_one_that_follows(followed_posterior):
    model = followed_posterior.heat.model
    assert set(model.followed) >= {"panel_capacity"} & set(followed_posterior.names)
    assert model.followed
    assert not model.tilted
    assert followed_posterior.problem.windows[0].heat.follows is not None
    gates = {gate.name: gate for gate in followed_posterior.diagnostics.gates}
    assert "off by" not in gates["response to heat"].found


def test_the_middle_of_the_posterior_is_where_the_response_was_looked_at(followed_posterior):
    problem, point = followed_posterior.problem, followed_posterior.heat
    z = problem.to_z(followed_posterior.flat)
    places = [k for k in problem.simulated if problem.names[k] in point.names]
    at = problem.to_z(followed_posterior.flat.mean(axis=0))
    known = dict(zip(point.names, point.theta, strict=True))
    for k in places:
        theta = followed_posterior.flat.mean(axis=0).copy()
        theta[k] = known[problem.names[k]]
        assert abs(problem.to_z(theta)[k] - at[k]) < z[:, k].std(), problem.names[k]


def test_a_problem_whose_response_follows_is_read_back_from_its_file(without_heaters, followed_posterior):
    point = followed_posterior.heat
    tree = xarray.DataTree.from_dict({"heat": heat_dataset(point.model, point.names, point.theta)})
    again = with_kept_heat(without_heaters, tree)
    z = followed_posterior.problem.to_z(followed_posterior.flat[7])
    assert again.log_density(z) == pytest.approx(followed_posterior.problem.log_density(z), rel=1e-9)


def test_a_response_that_bends_and_is_not_followed_fails_its_gate(without_heaters, monkeypatch):
    monkeypatch.setattr(with_heat, "_STRAIGHT", 1e-9)
    monkeypatch.setattr(with_heat, "_MOST_FOLLOWED", 0)
    posterior = calibrate_nuts(without_heaters, NutsSettings(chains=2, warmup=100, draws=50), seed=3)
    gates = {gate.name: gate for gate in posterior.diagnostics.gates}
    assert not posterior.heat.model.followed
    assert not gates["response to heat"].passed
    assert "the log density is off by" in gates["response to heat"].found


def test_a_density_that_no_chain_gets_through_is_not_followed_and_fails_its_gate(without_heaters, monkeypatch):
    monkeypatch.setattr(with_heat, "_STRAIGHT", 1e-9)
    monkeypatch.setattr(with_heat, "_PILOT_DEPTH", 1)
    posterior = calibrate_nuts(without_heaters, NutsSettings(chains=2, warmup=100, draws=50), seed=3)
    gates = {gate.name: gate for gate in posterior.diagnostics.gates}
    assert not posterior.heat.model.followed
    assert "the log density is off by" in gates["response to heat"].found


def test_no_fit_takes_a_size_further_than_matrices_have_digits_for(without_heaters, monkeypatch):
    problem, name = without_heaters, "noise.body_temp.correlation_time"
    monkeypatch.setattr(heat_search, "_FARTHEST", 0.01)
    point = find_heat(problem, problem.priors.median())
    sizes, place = point.around.sizes, point.around.sizes.names.index(name)
    score = sizes.to_z(sizes_of(point))[place] - sizes.to_z(sizes.median())[place]
    assert 0.0 < abs(score) <= 0.0301
