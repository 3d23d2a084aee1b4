"""Problems with unmodelled heat, against simulations with that heat and against dense normal distributions."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.linalg import block_diag, cho_factor, cho_solve

from flightcal.probability import Gains, signed
from flightcal.problem import (
    Window,
    errors_of_weights,
    exact_heat,
    followed,
    heat_of_weights,
    hold,
    kept_responses,
    responses,
    sampled_windows,
    split,
    unit_heats,
    with_heat,
)
from tests.problem.heated import SHAPES, middle, problem_of, with_some_heat, written


def test_its_theta_has_the_scales_of_heat_beside_one_size_of_the_noise(both):
    problem, heated = both
    model = heated.heat
    assert [name for name in heated.names if name.startswith("heat.")] == list(model.names)
    assert [name for name in heated.names if name.startswith("noise.")] == ["noise.body_temp"]
    assert set(problem.names) - set(heated.names) == set()
    for entry in heated.entries:
        if entry.kind == "heat":
            assert entry.prior == signed(model.priors[entry.name])
            assert entry.unit == ("" if entry.name == "heat.gains" else "W")


def test_at_known_sizes_its_theta_is_what_simulations_depend_on(heated, known):
    assert not [name for name in known.names if name.startswith(("heat.", "noise."))]
    assert list(known.names) == [heated.names[k] for k in heated.simulated]


def parts_of(heated):
    """Windows and channels, in order."""
    return [(w, k) for w in range(len(heated.windows)) for k in range(2)]


def stacked(heated, arrays):
    return np.concatenate([arrays[w][heated.windows[w].valid[:, k], k] for w, k in parts_of(heated)])


def dense_noise(heated, deviations):
    """Of all valid samples; deviations: of each channel."""
    found = []
    for w, k in parts_of(heated):
        terms = heated.windows[w].residuals.terms
        seconds = terms.seconds[terms.valid[k]]
        shape, apart = SHAPES[k], np.abs(seconds[:, None] - seconds)
        memory = np.exp(-apart / shape.time) if shape.time else 0.0
        found.append(deviations[k] ** 2 * (memory + shape.white_share**2 * np.eye(len(seconds))))
    return block_diag(*found)


def dense_covariance(heated, theta):
    """Of all residuals, at theta [d] of a problem with heat whose sizes are inferred."""
    value = dict(zip(heated.names, theta, strict=True))
    scales = np.array([value.get(name, 1.0) for name in heated.heat.scales])
    response = stacked(heated, [w.heat.response for w in heated.windows]) * scales[heated.heat.group]
    return dense_noise(heated, [value["noise.body_temp"], 0.1]) + response @ response.T


def dense(heated, theta, simulate):
    """Log likelihood, with temperatures that `simulate` gives for each window [T, N]."""
    model = heated.heat
    left = []
    for window in heated.windows:
        left.append(window.observed - simulate(window) + window.heat.response @ model.centre)
    factor = cho_factor(dense_covariance(heated, theta), lower=True)
    left = stacked(heated, left)
    determinant = 2.0 * np.log(np.diag(factor[0])).sum()
    return -0.5 * (left @ cho_solve(factor, left) + determinant + len(left) * np.log(2.0 * np.pi))


def points(heated, at_centre, count=3):
    return at_centre + 0.2 * np.random.default_rng(5).standard_normal((count, len(at_centre)))


def test_its_windows_are_simulated_with_the_heat_at_the_centre(both):
    problem, heated = both
    model = heated.heat
    for window, bare in zip(heated.windows, sampled_windows(problem), strict=True):
        bare = next((hold(bare, held) for held in model.held if held.window == bare.name), bare)
        heat = heat_of_weights(model, unit_heats(model, bare), split(model, model.centre))
        theta = heated.at(window, heated.priors.median()[None])[0]
        expected = bare.network.with_heat(heat).simulate(theta[window.simulated])
        np.testing.assert_allclose(window.simulate(theta).temperatures, expected.temperatures, rtol=0.0, atol=1e-9)


def test_the_log_density_is_the_priors_and_the_dense_normal_of_all_windows(heated, at_centre):
    for z in points(heated, at_centre):
        theta = heated.to_theta(z)
        likelihood = dense(heated, theta, lambda w, t=theta: w.simulate(heated.at(w, t[None])[0]).temperatures)
        expected = float(heated.priors.at(z).log_density) + likelihood
        assert heated.log_density(z) == pytest.approx(expected, rel=1e-8)
        assert heated.log_density_and_gradient(z)[0] == pytest.approx(expected, rel=1e-8)


def test_at_known_sizes_the_log_density_is_the_same_but_for_the_sizes_priors(heated, at_centre, known, at_known):
    places = [heated.names.index(name) for name in known.names]
    for step in 0.1 * np.random.default_rng(0).standard_normal((3, len(places))):
        z = at_centre.copy()
        z[places] += step
        whole, some = heated.log_density(z), known.log_density(at_known + step)
        priors = float(heated.priors.at(z).log_density - known.priors.at(at_known + step).log_density)
        # Directions of which the telemetry tells next to nothing are left out.
        assert some + priors == pytest.approx(whole, abs=1e-3)
        gradient = heated.log_density_and_gradient(z)[1][places]
        found = known.log_density_and_gradient(at_known + step)[1]
        np.testing.assert_allclose(found, gradient, rtol=1e-5, atol=1e-5 * np.abs(gradient).max())


@pytest.mark.parametrize("which", ["heated", "known"])
def test_the_gradient_is_that_of_differences(request, which, heated, at_centre, known, at_known):
    chosen, start = (heated, at_centre) if which == "heated" else (known, at_known)
    for z in start + 0.1 * np.random.default_rng(1).standard_normal((2, len(start))):
        gradient = chosen.log_density_and_gradient(z)[1]
        twin = chosen._in_python(z)[1]
        np.testing.assert_allclose(twin, gradient, rtol=1e-8, atol=1e-8 * np.abs(gradient).max())
        for k, step in enumerate(1e-4 * np.eye(len(z))):
            expected = (chosen.log_density(z + step) - chosen.log_density(z - step)) / 2e-4
            assert gradient[k] == pytest.approx(expected, rel=1e-4, abs=1e-5 * np.abs(gradient).max()), chosen.names[k]


def test_the_information_is_that_of_the_dense_covariance(heated, at_centre, known, at_known):
    covariance = dense_covariance(heated, heated.to_theta(at_centre))
    for chosen, z in ((heated, at_centre), (known, at_known)):
        jacobian = stacked(chosen, chosen.jacobians(z))
        expected = jacobian.T @ np.linalg.solve(covariance, jacobian) + np.diag(chosen.priors.precision(z))
        found = chosen.gauss_newton_hessian(z)
        of_simulated = np.ix_(chosen.simulated, chosen.simulated)
        np.testing.assert_allclose(found, found.T, rtol=0.0, atol=1e-9 * np.abs(found).max())
        np.testing.assert_allclose(
            found[of_simulated], expected[of_simulated], rtol=1e-8, atol=1e-8 * np.abs(expected).max()
        )
        # Other numbers that do the same to the temperatures have the same information, but no prior.
        both = chosen.gauss_newton_hessian(z, chosen.jacobians(z))
        d, alone = len(z), found - np.diag(chosen.priors.precision(z))
        np.testing.assert_allclose(both[:d, :d], found, rtol=0.0, atol=1e-9 * np.abs(found).max())
        for block in (both[d:, :d], both[:d, d:], both[d:, d:]):
            np.testing.assert_allclose(
                block[of_simulated], alone[of_simulated], rtol=1e-8, atol=1e-8 * np.abs(expected).max()
            )


def test_the_information_on_sizes_is_the_curvature_bent_to_be_positive(heated, at_centre):
    places = np.array([k for k, entry in enumerate(heated.entries) if entry.kind in ("noise", "heat")])
    covered = heated.gauss_newton_hessian(at_centre)[np.ix_(places, places)]
    covered = covered - np.diag(heated.priors.precision(at_centre)[places])
    runs = heated.simulate(heated.to_theta(at_centre))
    step = 1e-3 * np.eye(len(at_centre))[places]

    def at(z):
        theta = heated.to_theta(z)
        return dense(heated, theta, lambda w: runs[heated.windows.index(w)].temperatures)

    middle = at(at_centre)
    second = np.zeros((len(places), len(places)))
    for i in range(len(places)):
        for j in range(i + 1):
            if i == j:
                value = (at(at_centre + step[i]) + at(at_centre - step[i]) - 2.0 * middle) / 1e-6
            else:
                sides = [at(at_centre + a * step[i] + b * step[j]) * a * b for a in (1, -1) for b in (1, -1)]
                value = sum(sides) / 4e-6
            second[i, j] = second[j, i] = -value
    eigenvalues, directions = np.linalg.eigh(second)
    expected = (directions * np.abs(eigenvalues)) @ directions.T
    np.testing.assert_allclose(covered, expected, rtol=0.0, atol=1e-3 * np.abs(expected).max())


# --- a response that follows the parameters -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def following(both, at_centre):
    """Around the same point, with a response that follows the parameters."""
    problem, heated = both
    found = followed(heated, heated.to_theta(at_centre))
    return with_heat(problem, replace(heated.heat, followed=found), middle(problem))


def test_a_response_that_follows_is_nearer_to_what_is_looked_at_anew(following, at_centre):
    model, same, with_growth = following.heat, 0.0, 0.0
    places = [k for k in following.simulated if following.entries[k].kind == "parameter"]
    for k, sign in product(places, (-1.0, 1.0)):
        z = at_centre.copy()
        z[k] += 0.5 * sign
        theta = following.to_theta(z)
        growth = following.heat_growth(theta[None])[0]
        for window, whitens in zip(following.windows, following.weighed.filters, strict=True):
            inside = following.at(window, theta[None])[0]
            anew = kept_responses(model.kept, responses(window, inside, model, unit_heats(model, window)))
            for response, grown in ((window.heat.response, False), (window.heat.response * growth, True)):
                off = whitens.whiten(np.moveaxis(response - anew, 1, 0), window.terms.valid)
                same, with_growth = same + (not grown) * (off**2).sum(), with_growth + grown * (off**2).sum()
    assert with_growth < 0.5 * same


def test_the_gradient_of_a_density_whose_response_follows_is_that_of_differences(following, at_centre):
    for z in at_centre + 0.1 * np.random.default_rng(1).standard_normal((2, len(at_centre))):
        gradient = following.log_density_and_gradient(z)[1]
        np.testing.assert_allclose(following._in_python(z)[1], gradient, rtol=1e-8, atol=1e-8 * np.abs(gradient).max())
        for k, step in enumerate(1e-4 * np.eye(len(z))):
            expected = (following.log_density(z + step) - following.log_density(z - step)) / 2e-4
            assert gradient[k] == pytest.approx(expected, rel=1e-4, abs=1e-5 * np.abs(gradient).max())


def test_where_it_was_looked_at_a_response_that_follows_is_the_same(heated, following, at_centre):
    assert following.log_density(at_centre) == pytest.approx(heated.log_density(at_centre), rel=1e-9)
    np.testing.assert_allclose(following.heat_growth(following.to_theta(at_centre)[None]), 1.0, rtol=1e-9)


# --- heat that does what the linear response says -----------------------------------------------------------------


def test_exact_heat_has_simulations_do_what_the_linear_response_says(heated, at_centre):
    rng = np.random.default_rng(2)
    z = np.tile(at_centre, (6, 1))
    moved = [k for k in heated.simulated if heated.entries[k].kind == "parameter"]
    z[:, moved] += 0.15 * rng.standard_normal((6, len(moved)))
    thetas = heated.to_theta(z)
    runs = heated.simulate_many(thetas)

    found = exact_heat(heated, runs, thetas, np.random.default_rng(0))

    gains = Gains([window.terms for window in heated.windows], heated.weighed, *heated.heat_sizes(thetas))
    weights = gains.draw(heated.heat_left(runs, thetas), np.random.default_rng(0))
    model, missed, before = heated.heat, [], []
    uncorrected = [temperatures.copy() for temperatures in found.linear]
    for place, (window, simulated, linear) in enumerate(
        zip(heated.windows, found.temperatures, found.linear, strict=True)
    ):
        units = unit_heats(model, window)
        for s, exact in enumerate(found.weights):
            base = runs[s][place].temperatures
            expected = base + window.heat.response @ (weights[s] - model.centre)
            np.testing.assert_allclose(linear[s], expected, rtol=0.0, atol=1e-9)
            functions = split(model, exact - model.centre)
            heat, error = heat_of_weights(model, units, functions), errors_of_weights(units, functions)
            run = window.network.with_heat(heat).simulate(heated.at(window, thetas[s : s + 1])[0][window.simulated])
            np.testing.assert_allclose(simulated[s], run.temperatures + error, rtol=0.0, atol=1e-8)
            missed.append(np.abs(simulated[s] - linear[s]).max())
            functions = split(model, weights[s] - model.centre)
            heat, error = heat_of_weights(model, units, functions), errors_of_weights(units, functions)
            run = window.network.with_heat(heat).simulate(heated.at(window, thetas[s : s + 1])[0][window.simulated])
            before.append(np.abs(run.temperatures + error - linear[s]).max())
            uncorrected[place][s] = run.temperatures
    # A tenth of the noise.
    assert max(missed) < 0.01
    assert max(missed) < 0.2 * max(before)
    # What is left is nearly all of a shape that no weights mend.
    steps, first = (
        gains([linear - temperatures for linear, temperatures in zip(found.linear, simulated, strict=True)])
        for simulated in (found.temperatures, uncorrected)
    )
    assert np.abs(steps).max() < 0.05 * np.abs(first).max()


def test_several_windows_in_open_loop_can_have_heat(problem):
    _, heated = with_some_heat(problem)
    assert [len(window.heat.response) for window in heated.windows] == [90, 70]


def test_a_draw_that_cannot_be_simulated_with_its_heat_does_not_make_the_search_longer(heated, at_centre, monkeypatch):
    thetas = np.tile(heated.to_theta(at_centre), (3, 1))
    runs = heated.simulate_many(thetas)
    simulate_many, calls = Window.simulate_many, []

    def failing(window, thetas, heat=None):
        calls.append(len(thetas))
        return [*simulate_many(window, thetas, heat)[:2], *[None] * (len(thetas) - 2)]

    monkeypatch.setattr(Window, "simulate_many", failing)
    exact_heat(heated, runs[:2], thetas[:2], np.random.default_rng(0))
    with np.errstate(all="raise", under="ignore"):
        found = exact_heat(heated, runs, thetas, np.random.default_rng(0))
    assert calls.count(3) <= calls.count(2)
    for temperatures in found.temperatures:
        assert np.isfinite(temperatures[:2]).all()
        assert np.isnan(temperatures[2]).all()


def test_exact_heat_is_looked_for_no_longer_than_what_is_missed_is_more_than_may_be(heated, at_centre):
    z = np.tile(at_centre, (6, 1))
    moved = [k for k in heated.simulated if heated.entries[k].kind == "parameter"]
    z[:, moved] += 0.15 * np.random.default_rng(2).standard_normal((6, len(moved)))
    thetas = heated.to_theta(z)
    runs = heated.simulate_many(thetas)

    def missed(within):
        found = exact_heat(heated, runs, thetas, np.random.default_rng(0), within=within)
        left = [
            (temperatures - linear).ravel()
            for temperatures, linear in zip(found.temperatures, found.linear, strict=True)
        ]
        return np.sqrt(np.mean(np.concatenate(left) ** 2))

    first, least = missed(np.inf), missed(0.0)
    between = np.sqrt(first * least)
    assert least < missed(between) < between < first


def test_the_information_has_what_the_heaters_status_tells_where_a_threshold_drifts(tmp_path):
    content = written(windows=1)
    content["observations"]["heater_status"]["likelihood"] = {"switch_times": {}}
    content["parameters"]["threshold"] = {
        "sets": "heaters.heater.on_below",
        "prior": {
            "normal": {"mean": content["simulator"]["heaters"]["heater"]["on_below"], "standard_deviation": "1 K"}
        },
        "drift": 0.5,
    }
    problem, told = with_some_heat(problem_of(tmp_path, content))
    silent = replace(told, windows=tuple(replace(window, heater_status=None) for window in told.windows))
    known = dict(zip(problem.names, middle(problem), strict=True))
    theta = [known.get(name, median) for name, median in zip(told.names, told.priors.median(), strict=True)]
    z = told.to_z(np.array(theta))
    found = np.diag(told.gauss_newton_hessian(z) - silent.gauss_newton_hessian(z))
    for k in (told.names.index("power"), told.names.index("timing.heater_status")):
        step = 1e-3 * np.eye(len(z))[k]
        of_status = [told.log_density(z + sign * step) - silent.log_density(z + sign * step) for sign in (-1, 0, 1)]
        second = -(of_status[0] - 2.0 * of_status[1] + of_status[2]) / 1e-6
        # Gauss-Newton leaves out how the switches bend.
        assert found[k] == pytest.approx(second, rel=0.5), told.names[k]
        assert found[k] > 0.5
