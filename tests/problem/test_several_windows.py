"""Several windows as one problem, against the residuals of all of them put together by hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from flightcal.calibration import calibrate_genetic, genetic_points
from flightcal.calibration.posterior import Posterior, posterior_tree
from flightcal.problem import build_problem, build_window
from flightcal.problem.coordinates import Whitening
from flightcal.problem.native import DENSITY_NOT_FINITE, REASONS
from flightcal.scenario import load_scenario
from flightcal.simulator.kernels.forward import TOO_MANY_SWITCHES
from tests import small


def written(**changes):
    content = small.content()
    content["windows"] = {
        "train": {
            "first": {"start": "2024-03-01T00:00:00", "end": "2024-03-01T01:30:00"},
            "second": {"start": "2024-03-01T02:10:00", "end": "2024-03-01T03:20:00"},
        },
        "test": [{"start": "2024-03-01T03:30:00", "end": "2024-03-01T05:00:00"}],
    }
    return content | changes


def drifting():
    content = written()
    content["parameters"]["link"]["drift"] = 0.5
    return content


def ageing(content):
    """The parameter `link` has a trend: of 0.6 of its prior's deviations from the first window to the second."""
    content["parameters"]["link"]["trend"] = 2000.0
    return content


@pytest.fixture(scope="module", params=["shared", "drifting", "both"])
def joint(request, tmp_path_factory):
    content = written() if request.param == "shared" else drifting()
    content = ageing(content) if request.param == "both" else content
    return build_problem(*small.closed_loop(tmp_path_factory.mktemp("joint"), content))


def points(joint, count=3):
    """Away from the mode, in all directions."""
    z = joint.to_z(joint.priors.median())
    return z + 0.3 * np.random.default_rng(0).standard_normal((count, len(z)))


def test_windows_share_parameters_and_noise_and_have_initial_temperatures_of_their_own(joint):
    trend = ("trend.link",) if "trend.link" in joint.names else ()
    drift = ("drift.link", "drift.link.first", "drift.link.second") if "drift.link" in joint.names else ()
    initial = [f"initial.{window}.{node}" for window in ("first", "second") for node in ("body", "panel")]
    assert joint.names == ("link", "panel_size", "power", "noise.body_temp", *trend, *drift, *initial)
    assert [window.observed.shape for window in joint.windows] == [(90, 2), (70, 2)]


def test_with_one_window_initial_temperatures_need_no_name_of_a_window(tmp_path):
    problem = build_problem(*small.load(tmp_path))
    assert [name for name in problem.names if name.startswith("initial.")] == ["initial.body", "initial.panel"]


def test_with_one_window_a_drift_is_legal_and_an_unseen_window_is_drawn_anew(tmp_path):
    content = small.content()
    content["parameters"]["link"]["drift"] = 0.5
    scenario, data = small.closed_loop(tmp_path, content)
    problem = build_problem(scenario, data)
    assert [name for name in problem.names if name.startswith("drift")] == ["drift.link", "drift.link.train"]
    theta = problem.priors.median()
    theta[problem.names.index("drift.link")], theta[problem.names.index("drift.link.train")] = 0.4, 1.0
    place = problem.names.index("link")
    assert problem.window_values(theta)["link"][0] == pytest.approx(theta[place] * 1.3**0.4)
    unseen = build_window(scenario, data, "test")
    draws = problem.at(unseen, np.tile(theta, (4000, 1)), np.random.default_rng(0))[:, place]
    assert np.log(draws).std() == pytest.approx(0.4 * np.log(1.3), rel=0.05)
    z = problem.to_z(theta)
    gradient = problem.log_density_and_gradient(z)[1]
    for k, step in enumerate(1e-5 * np.eye(len(z))):
        difference = (problem.log_density(z + step) - problem.log_density(z - step)) / 2e-5
        assert gradient[k] == pytest.approx(difference, rel=1e-3, abs=1e-3 * np.abs(gradient).max())


def test_the_density_is_the_windows_likelihoods_and_each_prior_once(joint):
    for z in points(joint):
        theta = joint.to_theta(z)
        expected = float(joint.priors.at(z).log_density)
        for window in joint.windows:
            inside = joint.at(window, theta[None])[0]
            run = window.simulate(inside)
            noise = window.noise(inside)
            squares = ((window.observed - run.temperatures) / noise) ** 2
            expected -= 0.5 * squares.sum() + len(run.temperatures) * np.log(noise * np.sqrt(2 * np.pi)).sum()
        assert joint.log_density_and_gradient(z)[0] == pytest.approx(expected, rel=1e-9)
        assert joint.log_density(z) == pytest.approx(expected, rel=1e-9)


@pytest.fixture(scope="module", params=["iid", "ar1"])
def phased(request, tmp_path_factory):
    """Windows that share the weights of a discrepancy in orbit phase."""
    noise = {"standard_deviation": "0.2 K"}
    if request.param == "ar1":
        noise |= {"model": "ar1", "correlation_time": "8 min", "white": "0.1 K"}
    content = written(noise=noise, discrepancy={"phase": {"amplitude": "0.8 K", "lengthscale": 0.2}})
    content["observations"]["panel_temp"].pop("noise")
    return build_problem(*small.closed_loop(tmp_path_factory.mktemp("phased"), content))


def covariance_of_all(problem, channel, kind):
    """Of the residuals of all windows together: noise by window, and one set of weights."""
    total, bases = np.zeros((160, 160)), []
    for window, start in zip(problem.windows, (0, 90), strict=False):
        model = window.residuals
        apart = np.abs(model.terms.seconds[:, None] - model.terms.seconds)
        noise = (
            0.04 * np.exp(-apart / 480.0) + 0.01 * np.eye(len(apart)) if kind == "ar1" else 0.04 * np.eye(len(apart))
        )
        total[start : start + len(apart), start : start + len(apart)] = noise
        bases.append(model.terms.shapes.basis * model.prior_deviations(model.fixed[channel]))
    basis = np.concatenate(bases)
    return total[: len(basis), : len(basis)] + basis @ basis.T


def test_windows_share_the_weights_of_a_discrepancy_in_orbit_phase(phased, request):
    kind = request.node.callspec.params["phased"]
    z = points(phased, 1)[0]
    expected = float(phased.priors.at(z).log_density)
    residual = phased.residual(phased.simulate(phased.to_theta(z)))
    for k in range(2):
        expected += stats.multivariate_normal.logpdf(residual[:, k], cov=covariance_of_all(phased, k, kind))
    assert phased.log_density(z) == pytest.approx(expected, rel=1e-9)
    value, gradient = phased.log_density_and_gradient(z)
    assert value == pytest.approx(expected, rel=1e-9)
    assert phased.independent().is_independent
    for k, name in enumerate(phased.names):
        step = 1e-5 * np.eye(len(z))[k]
        difference = (phased.log_density(z + step) - phased.log_density(z - step)) / 2e-5
        assert gradient[k] == pytest.approx(difference, rel=1e-3, abs=1e-3 * np.abs(gradient).max()), name


def test_the_hessian_has_the_covariance_of_all_windows_together(phased, request):
    kind = request.node.callspec.params["phased"]
    z = points(phased, 1)[0]
    jacobian = np.concatenate(phased.jacobians(z))
    expected = np.diag(phased.priors.precision(z))
    for k in range(2):
        expected += jacobian[:, k].T @ np.linalg.solve(covariance_of_all(phased, k, kind), jacobian[:, k])
    found = phased.gauss_newton_hessian(z)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found / scale, expected / scale, atol=1e-6)


@pytest.mark.parametrize("windows", ["several windows", "one window"])
def test_the_error_of_a_simulator_is_integrated_out_beside_shared_weights(windows, tmp_path):
    """Against dense normals of all samples, in the C function and in Python."""
    content = written(
        noise={"standard_deviation": "0.2 K"}, discrepancy={"phase": {"amplitude": "0.8 K", "lengthscale": 0.2}}
    )
    content["observations"]["panel_temp"].pop("noise")
    error = {"offset": "0.3 K", "deviation": "0.4 K", "correlation_time": "20 min"}
    content["simulator"]["errors"] = {"body_temp": error, "panel_temp": error}
    made = small.closed_loop(tmp_path, content)
    problem = build_problem(*made) if windows == "several windows" else build_problem(*made, "train.first")
    size = sum(len(window.times) for window in problem.windows)
    covariance = np.zeros((size, 2, size, 2))
    for k in range(2):
        covariance[:, k, :, k] = covariance_of_all(problem, k, "iid")
    start = 0
    for window in problem.windows:
        basis, end = window.simulator.error_basis, start + len(window.times)
        assert basis.shape[2] > 3
        covariance[start:end, :, start:end] += np.einsum(
            "tnr,r,ukr->tnuk", basis, window.simulator.error_variance, basis
        )
        start = end
    covariance = covariance.reshape(2 * size, 2 * size)
    z = points(problem, 1)[0]
    residual = problem.residual(problem.simulate(problem.to_theta(z))).ravel()
    expected = float(problem.priors.at(z).log_density) + stats.multivariate_normal.logpdf(residual, cov=covariance)
    in_c, in_python = problem.log_density_and_gradient(z), problem._in_python(z)
    assert in_c[0] == pytest.approx(expected, rel=1e-9)
    assert in_python[0] == pytest.approx(expected, rel=1e-9)
    np.testing.assert_allclose(in_python[1], in_c[1], rtol=1e-9, atol=1e-9 * np.abs(in_c[1]).max())
    for k, name in enumerate(problem.names):
        step = 1e-5 * np.eye(len(z))[k]
        difference = (problem.log_density(z + step) - problem.log_density(z - step)) / 2e-5
        assert in_c[1][k] == pytest.approx(difference, rel=1e-3, abs=1e-3 * np.abs(in_c[1]).max()), name
    jacobian = np.concatenate(problem.jacobians(z)).reshape(2 * size, -1)
    hessian = jacobian.T @ np.linalg.solve(covariance, jacobian) + np.diag(problem.priors.precision(z))
    scale = np.sqrt(np.outer(np.diag(hessian), np.diag(hessian)))
    np.testing.assert_allclose(problem.gauss_newton_hessian(z) / scale, hessian / scale, atol=1e-6)


def test_the_weights_are_what_all_windows_tell(phased, request):
    kind = request.node.callspec.params["phased"]
    theta = phased.priors.median()
    runs = phased.simulate(theta)
    thetas = [phased.at(window, theta[None])[0] for window in phased.windows]
    residual = phased.residual(runs)
    for (mean, factor), window in zip(phased.weights(runs, thetas), phased.windows, strict=True):
        model = window.residuals
        for k in range(2):
            deviation = model.prior_deviations(model.fixed[k])
            basis = np.concatenate([other.residuals.terms.shapes.basis for other in phased.windows]) * deviation
            gain = np.linalg.solve(covariance_of_all(phased, k, kind), basis).T * deviation[:, None]
            np.testing.assert_allclose(mean[k], gain @ residual[:, k], atol=1e-8)
            expected = np.diag(deviation**2) - gain @ basis * deviation
            np.testing.assert_allclose(factor[k] @ factor[k].T, expected, atol=1e-8)


def test_where_one_window_cannot_be_simulated_there_is_no_simulation(joint):
    thetas = np.tile(joint.priors.median(), (2, 1))
    thetas[0, joint.names.index("initial.second.panel")] = 1e300
    failed, runs = joint.simulate_many(thetas)
    assert failed is None
    for run, again in zip(runs, joint.simulate(thetas[1]), strict=True):
        np.testing.assert_array_equal(run.temperatures, again.temperatures)


def test_of_given_simulations_the_derivative_by_the_noise_is_that_of_all_windows(joint):
    z = points(joint, 1)[0]
    theta, k = joint.to_theta(z), joint.names.index("noise.body_temp")
    run = joint.simulate(theta)
    value, found = joint.likelihood_of_numbers(run, theta)
    assert value == pytest.approx(joint.log_density(z) - joint.priors.at(z).log_density, rel=1e-10)
    step = 1e-5 * theta[k] * np.eye(len(theta))[k]
    above, below = (joint.likelihood_of_numbers(run, theta + sign * step)[0] for sign in (1.0, -1.0))
    assert found[k] == pytest.approx((above - below) / (2.0 * step[k]), rel=1e-6)
    assert not np.delete(found, k).any()


def test_the_gradient_agrees_with_differences(joint):
    z = points(joint, 1)[0]
    gradient = joint.log_density_and_gradient(z)[1]
    for k, name in enumerate(joint.names):
        step = 1e-5 * np.eye(len(z))[k]
        difference = (joint.log_density(z + step) - joint.log_density(z - step)) / 2e-5
        assert gradient[k] == pytest.approx(difference, rel=1e-3, abs=1e-3 * np.abs(gradient).max()), name


def test_the_c_function_is_the_density_in_other_coordinates(joint):
    z = points(joint)
    factor = np.random.default_rng(1).normal(size=(z.shape[1],) * 2) / 5.0
    density = joint.native_density(Whitening(z[0], factor))
    for w in 0.3 * np.random.default_rng(2).standard_normal((3, z.shape[1])):
        expected, gradient = joint.log_density_and_gradient(z[0] + factor @ w)
        value, found = density(w)
        assert value == pytest.approx(expected, rel=1e-12)
        np.testing.assert_allclose(found, factor.T @ gradient, rtol=1e-8, atol=1e-9 * np.abs(gradient).max())
    assert density(np.full(len(factor), 1e200))[0] == -np.inf
    assert (density.gradients, density.failures) == (4, 1)
    assert density.last_failure == REASONS[DENSITY_NOT_FINITE]
    steep = joint.native_density(Whitening(z[0], 1e307 * np.eye(len(factor))))
    assert steep(np.zeros(len(factor)))[0] == -np.inf
    assert steep.last_failure == REASONS[DENSITY_NOT_FINITE]


def test_what_a_window_fails_by_is_what_all_fail_by(tmp_path):
    joint = build_problem(*small.load(tmp_path, small.chattering() | {"windows": written()["windows"]}))
    density = joint.native_density(Whitening(np.zeros(len(joint.names)), np.eye(len(joint.names))))
    z = joint.to_z(joint.priors.median())
    assert density(z)[0] == joint.log_density(z) == -np.inf
    value, gradient = joint.log_density_and_gradient(z)
    assert value == -np.inf
    assert not gradient.any()
    assert density.last_failure == REASONS[TOO_MANY_SWITCHES]


def test_the_gauss_newton_hessian_is_that_of_all_windows_residuals(joint):
    z = points(joint, 1)[0]
    noise = joint.windows[0].noise(joint.at(joint.windows[0], joint.to_theta(z)[None])[0])
    weighted = []
    for k in range(len(z)):
        step = 1e-4 * np.eye(len(z))[k]
        above, below = joint.simulate_many(joint.to_theta(np.stack([z + step, z - step])))
        weighted.append(((joint.residual(below) - joint.residual(above)) / 2e-4 / noise).ravel())
    expected = np.array(weighted) @ np.array(weighted).T + np.diag(joint.priors.precision(z))
    k = joint.names.index("noise.body_temp")
    found = joint.gauss_newton_hessian(z)
    expected[k, k] = found[k, k]
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found / scale, expected / scale, atol=1e-5)


def test_a_drifting_parameter_is_the_common_one_moved_on_its_normal_scale(tmp_path):
    joint = build_problem(*small.closed_loop(tmp_path, drifting()))
    theta = joint.priors.median()
    place = {name: k for k, name in enumerate(joint.names)}
    theta[[place["link"], place["drift.link"], place["drift.link.first"], place["drift.link.second"]]] = 0.7, 0.4, 1, -2
    values = joint.window_values(theta)["link"]
    # Of a lognormal prior with a factor of 1.3.
    np.testing.assert_allclose(values, 0.7 * 1.3 ** (0.4 * np.array([1.0, -2.0])), rtol=1e-9)
    unseen = build_window(joint.scenario, joint_data(joint, tmp_path), "test.1")
    draws = joint.at(unseen, np.tile(theta, (4000, 1)), np.random.default_rng(0))[:, 0]
    assert np.log(draws).mean() == pytest.approx(np.log(0.7), abs=4 * 0.4 * np.log(1.3) / np.sqrt(4000))
    assert np.log(draws).std() == pytest.approx(0.4 * np.log(1.3), rel=0.05)
    assert joint.at(unseen, theta[None])[0, 0] == pytest.approx(0.7)
    initial = [unseen.names.index(name) for name in ("initial.body", "initial.panel")]
    theta[place["initial.second.panel"]] += 1.0
    medians = [unseen.reads[name].mean for name in ("initial.body", "initial.panel")]
    np.testing.assert_array_equal(joint.at(unseen, theta[None])[0, initial], medians)


def test_a_trend_goes_on_from_the_middle_of_all_windows_to_one_that_is_not_trained_on(tmp_path):
    joint = build_problem(*small.closed_loop(tmp_path, ageing(written())))
    theta = joint.priors.median()
    rate = 300.0  # W/K in a year
    place = {name: k for k, name in enumerate(joint.names)}
    theta[[place["link"], place["trend.link"]]] = 0.7, rate
    unseen = build_window(joint.scenario, joint_data(joint, tmp_path), "test.1")
    middles = [window.start + np.timedelta64(round(500 * window.duration), "ms") for window in (*joint.windows, unseen)]
    hours = (np.array(middles) - middles[0]) / np.timedelta64(1, "h")
    # Of a lognormal prior around 0.6 W/K.
    expected = 0.7 * np.exp(rate / 0.6 * (hours - hours[:2].mean()) / (365.25 * 24.0))
    np.testing.assert_allclose(joint.window_values(theta)["link"], expected[:2], rtol=1e-9)
    assert joint.at(unseen, theta[None])[0, 0] == pytest.approx(expected[2], rel=1e-9)
    assert abs(expected[2] / expected[1] - 1.0) > 0.01


def test_the_posterior_tree_holds_the_values_of_drifting_parameters_by_window(joint):
    z = points(joint, 6).reshape(2, 3, -1)
    theta = joint.to_theta(z)
    sampled = SimpleNamespace(z=z, statistics={}, interrupted=False)
    tree = posterior_tree(joint, Posterior(joint.names, theta, sampled, (), None, joint), seed=1)
    if {"drift.link", "trend.link"}.isdisjoint(joint.names):
        assert "windows" not in tree.children
        return
    found = tree["windows"].to_dataset()
    assert found["link"].dims == ("chain", "draw", "window")
    assert found["window"].values.tolist() == ["first", "second"]
    np.testing.assert_allclose(found["link"], joint.window_values(theta)["link"])


def joint_data(joint, folder):
    return small.load(folder, drifting())[1]


def test_the_error_is_pooled_over_the_samples_of_all_windows_and_the_search_finds_one(joint):
    theta = joint.priors.median()
    expected = np.sqrt(np.mean(joint.residual(joint.simulate(theta)) ** 2))
    assert joint.rmse(theta[None])[0] == pytest.approx(expected)
    runs = calibrate_genetic(joint)
    assert (runs["history"][:, -1] < runs["history"][:, 0]).all()
    point = genetic_points(joint, runs)["genetic_best"]
    assert joint.rmse(point[None])[0] == pytest.approx(float(runs["rmse"].min()))


def test_windows_in_groups_are_read_back_as_they_were(tmp_path):
    from flightcal.scenario import resolved_yaml

    scenario, _ = small.load(tmp_path, drifting())
    assert scenario.train_windows == ("train.first", "train.second")
    assert list(scenario.windows) == ["train.first", "train.second", "test.1"]
    (tmp_path / "again.yaml").write_text(resolved_yaml(scenario))
    assert load_scenario(tmp_path / "again.yaml") == scenario


@pytest.mark.parametrize(
    ("start", "expected"),
    [("03:00", "long"), ("04:40", "short"), ("05:45", "short"), ("01:30", "long"), ("09:00", "short")],
)
def test_the_nearest_window_is_the_one_whose_edge_is_nearest(tmp_path, start, expected):
    content = written()
    content["windows"] = {
        "train": {
            "long": {"start": "2024-03-01T00:00:00", "end": "2024-03-01T03:00:00"},
            "short": {"start": "2024-03-01T05:30:00", "end": "2024-03-01T06:30:00"},
        }
    }
    problem = build_problem(*small.closed_loop(tmp_path, content))
    assert problem.nearest(np.datetime64(f"2024-03-01T{start}", "ns")).label == expected
