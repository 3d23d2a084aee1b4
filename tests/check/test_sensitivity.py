"""Sobol indices against functions whose indices are known, through the code that problems go through."""

import numpy as np
import pytest
from scipy.special import ndtri

from flightcal.check.evaluate import THOROUGH, Effort
from flightcal.check.sensitivity import given_data, sensitivity, sobol
from flightcal.scenario import Normal

from .problems import centre_at, formula_problem, samples

A, B = 7.0, 0.1


def ishigami(share):
    x = np.pi * (2.0 * share - 1.0)
    return (np.sin(x[:, 0]) + A * np.sin(x[:, 1]) ** 2 + B * x[:, 2] ** 4 * np.sin(x[:, 0]))[:, None]


def ishigami_indices():
    """Ishigami and Homma (1990): variance shares in closed form."""
    first = 0.5 * (1.0 + B * np.pi**4 / 5.0) ** 2
    second, both = A**2 / 8.0, B**2 * np.pi**8 * 8.0 / 225.0
    total = first + second + both
    return np.array([first, second, 0.0]) / total, np.array([first + both, second, both]) / total


def test_ishigami_has_its_known_indices():
    first, total = ishigami_indices()
    found, outputs = sobol(ishigami, 3, 2048, seed=1)
    assert len(outputs) == 2048 * 5
    np.testing.assert_allclose(found.first[0], first, atol=0.03)
    np.testing.assert_allclose(found.total[0], total, atol=0.03)
    assert (found.total_error < 0.1).all()


def test_first_order_indices_of_given_data_are_those_of_ishigami():
    share = np.random.default_rng(0).random((4000, 3))
    found = given_data(share, ishigami(share), seed=1)
    np.testing.assert_allclose(found.first[0], ishigami_indices()[0], atol=0.04)
    assert np.isnan(found.total).all()


def test_errors_of_given_data_are_as_large_as_the_indices_scatter():
    samples = [np.random.default_rng(seed).random((800, 3)) for seed in range(40)]
    found = [given_data(share, ishigami(share), seed=1) for share in samples]
    scatter = 1.96 * np.std([indices.first[0, :2] for indices in found], axis=0)
    np.testing.assert_allclose(np.mean([indices.first_error[0, :2] for indices in found], axis=0), scatter, rtol=0.25)


def test_failed_evaluations_leave_their_blocks_out_and_constants_have_no_indices():
    def outputs_of(share):
        linear = share @ np.array([3.0, 1.0, 0.0])
        linear[::97] = np.nan
        return np.column_stack([linear, np.ones(len(share))])

    found, outputs = sobol(outputs_of, 3, 1024, seed=0)
    assert np.isnan(outputs).any()
    np.testing.assert_allclose(found.total[0], [0.9, 0.1, 0.0], atol=0.05)
    assert not found.total[1].any()


WEIGHTS = np.array([2.0, 1.0, 0.0])


def additive():
    """Body and panel: constant shifts by sums of parameters; the RMS change from the mean is |sum|."""

    def temperatures(theta):
        return 290.0 + np.ones((samples(), 1)) * np.array([WEIGHTS @ theta, theta[1]])

    priors = {name: Normal(mean=0.0, standard_deviation=1.0) for name in ("strong", "weak", "idle")}
    return formula_problem(priors, temperatures, dict.fromkeys(priors, 0.0))


def indices_on_a_grid():
    """First-order and total indices of |2 x + y| by quadrature."""
    normal = ndtri((np.arange(600) + 0.5) / 600)
    change = np.abs(WEIGHTS[0] * normal[:, None] + WEIGHTS[1] * normal)
    means = change.mean(axis=1), change.mean(axis=0)
    first = np.array([np.var(mean) for mean in means]) / np.var(change)
    return first, 1.0 - first[::-1]


@pytest.mark.parametrize("effort", [THOROUGH, Effort(1500, 0, 5, 1)])
def test_a_problem_gives_the_indices_of_its_channels_and_of_its_likelihood(effort):
    problem = additive()
    centre = centre_at(problem, strong=0.0, weak=0.0, idle=0.0)
    draws = problem.priors.sample(np.random.default_rng(0), effort.draws)
    found = sensitivity(problem, centre.z, effort, 0, (draws, problem.simulate_many(draws)))
    assert found.outputs == ("body_temp", "panel_temp", "log likelihood")
    # |x| of a standard normal: sqrt(1 - 2 / pi) is its deviation.
    assert found.deviation[1] == pytest.approx(np.sqrt(1.0 - 2.0 / np.pi), rel=0.05)
    np.testing.assert_allclose(found.strongest[1], [0.0, 1.0, 0.0], atol=0.08)
    first, total = indices_on_a_grid()
    np.testing.assert_allclose(found.strongest[0, :2], total if effort.base else first, atol=0.1)
    assert abs(found.strongest[:, 2]).max() < 0.05
    assert found.failed == 0
