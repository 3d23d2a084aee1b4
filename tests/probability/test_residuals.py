"""Noise and discrepancy of a problem: what of them is in theta, and that both ways to the density agree."""

import numpy as np
import pytest
from scipy import stats

from flightcal.calibration import climb, find_mode
from flightcal.calibration.start import fit_residuals
from flightcal.errors import ScenarioError
from flightcal.probability import DEVIATION
from flightcal.probability.discrepancy import in_phase
from flightcal.probability.noise import kind_of_noise
from flightcal.probability.residuals import AMPLITUDE, LENGTH
from flightcal.problem import build_problem
from flightcal.problem.coordinates import whitening
from flightcal.scenario import Noise

from .. import small
from .residual_cases import CORRELATED, CORRELATED_STUDENT, INDEPENDENT, ROUNDED, STUDENT, log_likelihood

MODELS = {
    "iid": ({}, None),
    "ar1": ({"model": "ar1"}, None),
    "ar1 and white": ({"model": "ar1", "white": {"half_normal": "0.1 K"}}, None),
    "student": ({"distribution": "student_t", "degrees_of_freedom": {"lognormal": {"median": 5, "factor": 2}}}, None),
    "correlated student": ({"model": "ar1", "distribution": "student_t"}, None),
    "quantised": ({"quantisation": "0.2 K"}, None),
    "phase": ({}, {"phase": {"shared": ["amplitude", "lengthscale"]}, "channels": ["body_temp"]}),
    "phase by channel": ({}, {"phase": {"shared": [], "smoothness": "5/2"}}),
    "phase and ar1": ({"model": "ar1", "white": "0.05 K"}, {"phase": {"harmonics": 4}}),
}


def made(folder, noise=None, discrepancy=None, **options):
    written = small.content()
    written["noise"] = noise or {}
    written["observations"]["panel_temp"].pop("noise")
    if discrepancy is not None:
        written["discrepancy"] = discrepancy
    scenario, data = small.closed_loop(folder, written, **options)
    data["body_temp"].values[40:55] = np.nan
    return scenario, data


@pytest.fixture(scope="module", params=MODELS)
def problem(request, tmp_path_factory):
    return build_problem(*made(tmp_path_factory.mktemp("residuals"), *MODELS[request.param]))


def near_truth(problem, seed=0):
    theta = problem.priors.median()
    for name, value in (small.TRUTH | {"initial.body": 285.0, "initial.panel": 262.0}).items():
        if name in problem.names:
            theta[problem.names.index(name)] = value
    return problem.to_z(theta) + 0.05 * np.random.default_rng(seed).standard_normal(len(theta))


def test_names_stand_between_parameters_and_initial_temperatures(tmp_path):
    noise, discrepancy = MODELS["ar1 and white"][0], {"phase": {}}
    problem = build_problem(*made(tmp_path, noise, discrepancy))
    channels = ("body_temp", "panel_temp")
    assert problem.names == (
        *("link", "panel_size", "power"),
        *(f"noise.{channel}{what}" for what in ("", ".white", ".correlation_time") for channel in channels),
        *(f"discrepancy.phase.amplitude.{channel}" for channel in channels),
        "discrepancy.phase.lengthscale",
        *("initial.body", "initial.panel"),
    )
    theta = problem.priors.median() * (1 + 0.001 * np.arange(len(problem.names)))
    numbers = problem.windows[0].numbers(theta)
    names = CORRELATED.names
    for name in names:
        column, key = names.index(name), "" if name == "standard_deviation" else f".{name}"
        expected = [theta[problem.names.index(f"noise.{channel}{key}")] for channel in channels]
        np.testing.assert_array_equal(numbers[:, column], expected)
    amplitudes = [theta[problem.names.index(f"discrepancy.phase.amplitude.{channel}")] for channel in channels]
    np.testing.assert_array_equal(numbers[:, AMPLITUDE], amplitudes)
    np.testing.assert_array_equal(numbers[:, LENGTH], theta[problem.names.index("discrepancy.phase.lengthscale")])
    np.testing.assert_allclose(
        problem.windows[0].noise(theta), np.hypot(numbers[:, DEVIATION], numbers[:, names.index("white")])
    )


@pytest.mark.parametrize("seed", range(2))
def test_the_c_function_is_what_the_parts_give_in_python(problem, seed):
    z = near_truth(problem, seed)
    prior = problem.priors.at(z)
    run, pull_back = problem.windows[0].simulator.linearise(prior.theta[problem.windows[0].simulated])
    value, temperatures_bar, numbers_bar, *_ = log_likelihood(
        problem.windows[0].residuals.terms,
        problem.windows[0].observed,
        run.temperatures,
        problem.windows[0].numbers(prior.theta),
    )
    theta_bar = np.zeros_like(z)
    theta_bar[problem.windows[0].simulated] = pull_back(temperatures_bar)
    for channel, column, position in zip(*problem.places, strict=True):
        theta_bar[position] += numbers_bar[channel, column]
    found, gradient = problem.log_density_and_gradient(z)
    assert found == pytest.approx(prior.log_density + value, rel=1e-12)
    np.testing.assert_allclose(gradient, prior.gradient + prior.slope * theta_bar, rtol=1e-8, atol=1e-8)


def test_the_gradient_is_that_of_differences(problem):
    z = near_truth(problem)
    gradient = problem.log_density_and_gradient(z)[1]
    for k, step in enumerate(1e-5 * np.eye(len(z))):
        difference = (problem.log_density(z + step) - problem.log_density(z - step)) / 2e-5
        assert gradient[k] == pytest.approx(difference, rel=1e-4, abs=1e-3), problem.names[k]


def test_the_gauss_newton_hessian_can_whiten(problem):
    hessian = problem.gauss_newton_hessian(near_truth(problem))
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-9 * np.abs(hessian).max())
    assert np.linalg.eigvalsh(hessian).min() > 0.0
    channels, _, positions = problem.places
    first, second = (positions[channels == k] for k in range(2))
    if np.intersect1d(first, second).size:
        return
    np.testing.assert_allclose(hessian[np.ix_(first, second)], 0.0, atol=1e-12 * np.abs(hessian).max())


def test_of_normal_residuals_it_has_the_parameters_information_of_the_dense_covariance(problem):
    """J^T C^-1 J, with C from the likelihood of unit residuals; where these are not normal, of their equivalents."""
    if not problem.windows[0].residuals.is_normal:
        pytest.skip("compared with normal residuals only")
    z = near_truth(problem)
    numbers = problem.windows[0].numbers(problem.to_theta(z))
    (jacobian,) = problem.jacobians(z)
    expected = np.diag(problem.priors.precision(z))
    model = problem.windows[0].residuals
    for k in range(2):
        valid = problem.windows[0].valid[:, k]
        seconds, basis = model.terms.seconds[valid], model.terms.shapes.basis[valid]
        deviation, white, time = numbers[k, :3]
        if model.terms.kinds[k] == CORRELATED:
            covariance = deviation**2 * np.exp(-np.abs(seconds[:, None] - seconds) / time)
            covariance += white**2 * np.eye(len(seconds))
        else:
            covariance = deviation**2 * np.eye(len(seconds))
        if model.terms.discrepant[k]:
            covariance += basis * model.prior_deviations(numbers[k]) ** 2 @ basis.T
        derivatives = jacobian[valid, k]
        expected += derivatives.T @ np.linalg.solve(covariance, derivatives)
    kept = np.ix_(problem.windows[0].simulated, problem.windows[0].simulated)
    found = problem.gauss_newton_hessian(z)
    np.testing.assert_allclose(found[kept], expected[kept], rtol=1e-8, atol=1e-10 * np.abs(expected).max())


KINDS = {
    "iid": INDEPENDENT,
    "ar1": CORRELATED,
    "student": STUDENT,
    "correlated student": CORRELATED_STUDENT,
    "quantised": ROUNDED,
}


@pytest.mark.parametrize("model", KINDS)
def test_the_noise_is_of_the_kind_that_the_scenario_says(model, tmp_path):
    problem = build_problem(*made(tmp_path, *MODELS[model]))
    assert problem.windows[0].residuals.terms.kinds == (KINDS[model],) * 2


def test_noise_that_no_kind_is_meant_by_is_named():
    with pytest.raises(ScenarioError, match=r"noise: found ar1 noise that is rare, expected one of iid noise, AR"):
        kind_of_noise(Noise.model_construct(model="ar1", distribution="rare", quantisation=None))


def test_the_discrepancy_is_of_the_functions_at_the_samples_phases_in_its_channels(tmp_path):
    terms = build_problem(*made(tmp_path, *MODELS["phase"])).windows[0].residuals.terms
    np.testing.assert_allclose(terms.shapes.basis, in_phase(terms.seconds / small.PERIOD, 8), atol=1e-9)
    assert terms.discrepant.tolist() == [True, False]


def information(density):
    """On the location of a density, by quadrature."""
    x = np.linspace(-60.0, 60.0, 400_001)
    p = density(x)
    return np.trapezoid(np.where(p > 1e-200, np.gradient(p, x) ** 2 / np.maximum(p, 1e-200), 0.0), x)


@pytest.mark.parametrize("model", ["student", "correlated student", "quantised"])
def test_normal_residuals_in_the_place_of_others_have_their_information(model, tmp_path):
    problem = build_problem(*made(tmp_path, *MODELS[model]))
    numbers, names = problem.windows[0].residuals.fixed.copy(), KINDS[model].names
    given = {"standard_deviation": 0.4, "degrees_of_freedom": 3.5, "correlation_time": 500.0, "quantisation": 0.2}
    numbers[:, : len(names)] = [given[name] for name in names]
    equivalent, equal = problem.windows[0].residuals.normal_equivalent(numbers)
    densities = {
        "quantised": lambda x: (
            (stats.norm.cdf((0.1 - np.abs(x)) / 0.4) - stats.norm.cdf((-0.1 - np.abs(x)) / 0.4)) / 0.2
        ),
    }
    expected = information(densities.get(model, lambda x: stats.t(3.5, 0.0, 0.4).pdf(x)))
    np.testing.assert_allclose(equal[:, DEVIATION] ** -2.0, expected, rtol=1e-3)
    assert equivalent.kinds == (CORRELATED if model == "correlated student" else INDEPENDENT,) * 2


def test_the_curvature_is_minus_the_second_derivative_by_the_numbers_logarithms(problem):
    z = near_truth(problem)
    theta = problem.to_theta(z)
    numbers, model = problem.windows[0].numbers(theta), problem.windows[0].residuals
    residual = np.where(
        problem.windows[0].valid, problem.windows[0].observed - problem.windows[0].simulate(theta).temperatures, 0.0
    )
    found = model.curvature(residual, numbers)
    if model.is_independent:
        np.testing.assert_array_equal(found[:, DEVIATION, DEVIATION], 2.0 * problem.windows[0].valid.sum(axis=0))
        return

    def value(*steps):
        moved = numbers.copy()
        for channel, column, size in steps:
            moved[channel, column] *= np.exp(size)
        return log_likelihood(model.terms, residual, np.zeros(residual.shape), moved)[0]

    size = 1e-3
    simple = np.array([kind == INDEPENDENT for kind in model.terms.kinds]) & ~model.terms.discrepant
    for one in model.entries:
        for other in model.entries:
            if one.channel != other.channel or simple[one.channel]:
                continue
            corners = [
                a * b * value((one.channel, one.column, a * size), (other.channel, other.column, b * size))
                for a in (1.0, -1.0)
                for b in (1.0, -1.0)
            ]
            curvature = found[one.channel]
            scale = np.sqrt(abs(curvature[one.column, one.column] * curvature[other.column, other.column])) + 1.0
            expected = -sum(corners) / (4.0 * size**2)
            assert curvature[one.column, other.column] == pytest.approx(expected, abs=1e-3 * scale), (one, other)


def test_errors_are_drawn_with_the_models_own_likelihood(tmp_path):
    """The expected log density of draws is that of the normal with their covariance, within Monte Carlo error."""
    problem = build_problem(*made(tmp_path, *MODELS["phase and ar1"]))
    theta = problem.priors.median()
    numbers, rng = problem.windows[0].numbers(theta), np.random.default_rng(0)
    none = np.zeros_like(problem.windows[0].observed)
    values = []
    for _ in range(400):
        drawn = np.where(problem.windows[0].valid, problem.windows[0].draw_errors(theta, rng), np.nan)
        values.append(log_likelihood(problem.windows[0].residuals.terms, drawn, none, numbers)[0])
    count = problem.windows[0].valid.sum()
    at_zero = log_likelihood(
        problem.windows[0].residuals.terms, np.where(problem.windows[0].valid, 0.0, np.nan), none, numbers
    )[0]
    # Twice the drop from the peak is chi-squared with as many degrees of freedom as there are samples.
    squares = 2.0 * (at_zero - np.array(values))
    assert squares.mean() == pytest.approx(count, abs=4 * np.sqrt(2 * count / 400))
    assert stats.kstest(squares, stats.chi2(count).cdf).pvalue > 1e-3


def within_a_step(x):
    """Distribution function of normal noise (0.3 K) and a step (0.8 K): an integral of the normal one."""
    up, down = ((np.asarray(x) + sign * 0.4) / 0.3 for sign in (1.0, -1.0))
    upper, lower = (z * stats.norm.cdf(z) + stats.norm.pdf(z) for z in (up, down))
    return 0.3 * (upper - lower) / 0.8


@pytest.mark.parametrize(
    ("kind", "distribution"),
    [
        (INDEPENDENT, stats.norm(0.0, 0.3).cdf),
        (STUDENT, stats.t(2.5, 0.0, 0.3).cdf),
        (ROUNDED, within_a_step),
        (CORRELATED, stats.norm.cdf),
        (CORRELATED_STUDENT, stats.t(2.5, 0.0, 0.3).cdf),
    ],
)
def test_noise_is_drawn_from_its_distribution(kind, distribution):
    """Correlated noise by what each sample adds to those before; 1500 draws tell 0.3 K from 0.28 K."""
    rng = np.random.default_rng(0)
    seconds = np.cumsum(rng.choice([30.0, 60.0, 400.0], 1500))
    given = dict(zip(CORRELATED.names, (0.3, 0.2, 200.0), strict=True))
    given |= {"degrees_of_freedom": 2.5, "quantisation": 0.8}
    memory, white = kind.draw(np.array([given[name] for name in kind.names]), seconds, rng)
    assert memory.any() == kind.has_memory
    drawn = memory + white
    kept = np.exp(-np.diff(seconds) / 200.0)
    if kind == CORRELATED:
        covariance = 0.09 * np.exp(-np.abs(seconds[:, None] - seconds) / 200.0) + 0.04 * np.eye(1500)
        drawn = np.linalg.solve(np.linalg.cholesky(covariance), drawn)
    elif kind == CORRELATED_STUDENT:
        drawn = (drawn[1:] - kept * drawn[:-1]) / np.sqrt(1.0 - kept**2)
    assert stats.kstest(drawn, distribution).pvalue > 0.01


def test_telemetry_drawn_anew_keeps_the_discrepancy_that_the_residuals_show(tmp_path):
    """Mean and covariance of what is drawn are the dense conditional normal's, and the noise is new."""
    problem = build_problem(*made(tmp_path, {"standard_deviation": "0.2 K"}, {"phase": {"harmonics": 2}}))
    theta = problem.priors.median()
    runs, rng, count = problem.simulate(theta), np.random.default_rng(0), 1500
    (run,) = runs
    drawn = problem.replicates(np.tile(theta, (count, 1)), [runs] * count, rng)[:, :, 1]
    model, numbers = problem.windows[0].residuals, problem.windows[0].numbers(theta)
    valid, basis = problem.windows[0].valid[:, 1], model.terms.shapes.basis
    prior = basis * model.prior_deviations(numbers[1]) ** 2 @ basis.T
    gain = prior[:, valid] @ np.linalg.inv(prior[np.ix_(valid, valid)] + 0.04 * np.eye(valid.sum()))
    mean = run.temperatures[:, 1] + gain @ (problem.windows[0].observed - run.temperatures)[valid, 1]
    covariance = prior - gain @ prior[valid] + 0.04 * np.eye(len(basis))
    variance = np.diag(covariance)
    assert (np.abs(drawn.mean(axis=0) - mean) < 5 * np.sqrt(variance / count)).all()
    assert (np.abs(drawn.var(axis=0) / variance - 1.0) < 5 * np.sqrt(2 / count)).all()
    whole = (drawn - mean).mean(axis=1)
    assert whole.var() == pytest.approx(covariance.mean(), rel=5 * np.sqrt(2 / count))


def test_where_noise_and_discrepancy_start_is_a_mode_of_them(tmp_path):
    problem = build_problem(*made(tmp_path, *MODELS["phase by channel"]))
    z = near_truth(problem)
    started = fit_residuals(problem, z)
    places = np.unique(problem.places[2])
    others = np.setdiff1d(np.arange(len(z)), places)
    np.testing.assert_array_equal(started[others], z[others])
    assert np.abs(problem.log_density_and_gradient(started)[1][places]).max() < 0.05
    assert problem.log_density(started) > problem.log_density(z)


def test_the_mode_is_found_through_that_of_independent_noise(tmp_path):
    problem = build_problem(*made(tmp_path, *MODELS["phase by channel"]))
    rng = np.random.default_rng(0)
    found = find_mode(problem, [], rng=rng, random_starts=2)[0]
    assert found.converged
    assert np.abs(problem.log_density_and_gradient(found.z)[1]).max() < 0.3
    from_truth = climb(problem, fit_residuals(problem, near_truth(problem)))
    assert found.log_density == pytest.approx(from_truth.log_density, abs=0.01)
    theta = dict(zip(problem.names, problem.to_theta(found.z), strict=True))
    assert theta["link"] == pytest.approx(0.65, abs=0.02)
    coordinates = whitening(found.z, problem.gauss_newton_hessian(found.z))
    assert np.isfinite(problem.native_density(coordinates)(0.1 * np.ones(len(found.z)))[0])
