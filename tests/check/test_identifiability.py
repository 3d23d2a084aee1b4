"""The information spectrum against closed forms, and combinations that no data can tell."""

import numpy as np
import pytest
from scipy.stats import halfnorm, norm

from flightcal.check.centre import find_centre
from flightcal.check.identifiability import identifiability, sparse_basis
from flightcal.problem import build_problem
from flightcal.scenario import HalfNormal, LogNormal, Normal

from .. import small
from .problems import centre_at, formula_problem, samples, several

POSITIVE = LogNormal(median=2.0, factor=1.5)


def shapes(count, seed=0):
    return np.random.default_rng(seed).standard_normal((samples(), 2, count))


def test_a_linear_gaussian_problem_gives_the_exact_spectrum_and_widths():
    matrix = 0.003 * shapes(4)
    deviations = np.array([1.0, 2.0, 0.5, 3.0])
    priors = {f"p{k}": Normal(mean=10.0, standard_deviation=s) for k, s in enumerate(deviations)}
    truth = dict.fromkeys(priors, 10.0)
    problem = formula_problem(priors, lambda theta: 290.0 + matrix @ theta, truth)
    centre = centre_at(problem, **truth)
    found = identifiability(problem, centre.z, centre.hessian)
    whitened = (matrix * deviations).reshape(-1, 4) / 0.1
    information = whitened.T @ whitened
    np.testing.assert_allclose(found.information, np.linalg.eigvalsh(information), rtol=1e-5)
    covariance = np.linalg.inv(information + np.eye(4))
    np.testing.assert_allclose(found.width, np.sqrt(np.diag(covariance)), rtol=1e-5)
    np.testing.assert_allclose(found.known_alone, 1.0 / np.sqrt(1.0 + np.diag(information)), rtol=1e-5)
    expected = covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    np.testing.assert_allclose(found.correlation, expected, atol=1e-5)


def test_the_information_of_two_windows_is_the_sum_of_theirs():
    priors = {name: Normal(mean=10.0, standard_deviation=2.0) for name in "abc"}
    truth = dict.fromkeys(priors, 10.0)

    def telling(matrix, seed):
        return formula_problem(priors, lambda theta: 290.0 + matrix @ theta, truth, seed=seed)

    one, other = telling(0.003 * shapes(3) * [1.0, 0.0, 1.0], 0), telling(0.003 * shapes(3, 1) * [0.0, 1.0, 1.0], 1)
    both = several(one=one, other=other)
    found = {}
    for name, problem in {"one": one, "other": other, "both": both}.items():
        centre = centre_at(problem, **truth)
        found[name] = (identifiability(problem, centre.z, centre.hessian), centre.hessian - np.eye(3))
    np.testing.assert_allclose(found["both"][1], found["one"][1] + found["other"][1], rtol=1e-9, atol=1e-9)
    assert found["one"][0].combinations[0].names == ("b",)
    assert found["other"][0].combinations[0].names == ("a",)
    for alone in ("one", "other"):
        assert (found["both"][0].information >= found[alone][0].information).all()
        assert (found["both"][0].width <= found[alone][0].width * (1.0 + 1e-9)).all()
    assert found["both"][0].information[0] > 10.0 * found["one"][0].information[0]


def found_in(temperatures, names, truth=2.0):
    priors = dict.fromkeys(names, POSITIVE)
    problem = formula_problem(priors, temperatures, dict.fromkeys(names, truth))
    centre = centre_at(problem, **dict.fromkeys(names, truth))
    return identifiability(problem, centre.z, centre.hessian)


def test_a_product_of_which_only_the_value_is_known_is_named():
    shape = shapes(2)
    found = found_in(
        lambda t: 290.0 + t[0] * t[1] * shape[..., 0] + t[2] * shape[..., 1], ("area", "emissivity", "link")
    )
    (combination,) = found.combinations
    assert set(combination.names) == {"area", "emissivity"}
    assert combination.kind == "product"
    assert combination.information == pytest.approx(0.0, abs=1e-4)
    assert combination.width == pytest.approx(1.0, abs=1e-4)
    before = np.prod([move.before for move in combination.moves])
    assert np.prod([move.after for move in combination.moves]) == pytest.approx(before, rel=1e-6)
    assert found.correlated[0][:2] == ("area", "emissivity")
    assert found.correlated[0][2] < -0.95


def test_combinations_that_are_equally_unknown_are_told_apart():
    shape = shapes(3)

    def temperatures(t):
        return 290.0 + t[0] * t[1] * shape[..., 0] + t[2] / t[3] * shape[..., 1] + t[5] * shape[..., 2]

    found = found_in(temperatures, ("a", "b", "c", "d", "idle", "e"))
    kinds = {frozenset(item.names): item.kind for item in found.combinations}
    assert kinds == {frozenset("ab"): "product", frozenset("cd"): "ratio", frozenset(["idle"]): "alone"}


def test_parameters_that_can_all_be_scaled_together_are_named():
    shape = shapes(2)
    found = found_in(lambda t: 290.0 + t[0] / t[1] * shape[..., 0] + t[2] / t[1] * shape[..., 1], ("a", "b", "c"))
    (combination,) = found.combinations
    assert (set(combination.names), combination.kind) == ({"a", "b", "c"}, "scale")


def test_a_sparse_basis_undoes_any_mixture():
    sparse = np.array([[1, -1, 0, 0, 0, 0], [0, 0, 1, 1, 0, 0], [0, 0, 0, 0, 1, 0]]).T / np.sqrt([2, 2, 1])
    mixture = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    found = sparse_basis(sparse @ mixture)
    overlap = np.abs(found.T @ sparse)
    np.testing.assert_allclose(np.sort(overlap, axis=1), np.tile([0.0, 0.0, 1.0], (3, 1)), atol=1e-12)
    assert sorted(overlap.argmax(axis=1)) == [0, 1, 2]


def test_widths_are_those_of_the_prior_whatever_its_scale():
    problem = formula_problem(
        {"level": HalfNormal(scale=3.0)}, lambda t: 290.0 + 0.01 * t[0] * np.ones((samples(), 2)), {"level": 2.0}
    )
    centre = centre_at(problem, level=2.0)
    found = identifiability(problem, centre.z, centre.hessian)
    # z is the logarithm; half of the distance between the normal's quantiles at 84 and 16% is its spread.
    tail = norm.sf(1.0)
    spread = 0.5 * np.log(halfnorm.ppf(1.0 - tail) / halfnorm.ppf(tail))
    information = 2 * samples() * (0.01 * 2.0 * spread / 0.1) ** 2
    np.testing.assert_allclose(found.information, [information], rtol=1e-5)


def test_a_network_whose_conductance_is_a_product_of_two_parameters_says_so(tmp_path):
    written = small.content()
    for name in ("contact_area", "contact_conductance"):
        written["parameters"][name] = {
            "scales": "conductors.body-panel.conductance",
            "prior": {"lognormal": {"median": 1, "factor": 1.5}},
        }
    del written["parameters"]["link"]
    scenario, data = small.closed_loop(tmp_path, written)
    problem = build_problem(scenario, data)
    draws = problem.priors.sample(np.random.default_rng(0), 8)
    centre = find_centre(problem, (draws, problem.simulate_many(draws)), 1, 0)
    found = identifiability(problem, centre.z, centre.hessian)
    (combination,) = found.combinations
    assert set(combination.names) == {"contact_area", "contact_conductance"}
    assert combination.kind == "product"
    assert combination.information < 1e-3
