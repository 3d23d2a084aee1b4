"""How far a parameter and the discrepancy stand in for each other."""

import numpy as np
import pytest

from flightcal.calibration.confounding import confounding, discrepancy_given
from flightcal.problem import build_problem

from .. import small


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    written = small.content()
    written["noise"] = {"standard_deviation": "0.1 K"}
    written["discrepancy"] = {"phase": {"amplitude": "1 K", "lengthscale": 0.2}, "channels": ["panel_temp"]}
    problem = build_problem(*small.closed_loop(tmp_path_factory.mktemp("confounding"), written))
    values = {"initial.body": 285.0, "initial.panel": 262.0} | small.TRUTH
    thetas = np.tile([values[name] for name in problem.names], (60, 1))
    rng = np.random.default_rng(0)
    for name, spread in (("panel_size", 0.02), ("power", 0.2)):
        thetas[:, problem.names.index(name)] += spread * rng.standard_normal(60)
    return problem, thetas, problem.simulate_many(thetas)


def test_a_parameter_whose_effect_the_discrepancy_takes_back_is_told(case):
    found = confounding(*case)["correlation"]
    assert found.sel(parameter="panel_size") < -0.9
    # The heater stands in the body, whose channel has no discrepancy; it reaches the panel only weakly.
    assert abs(found.sel(parameter="power")) < abs(found.sel(parameter="panel_size"))


def test_the_discrepancy_is_that_of_the_dense_conditional_normal(case):
    problem, thetas, runs = case
    expected = discrepancy_given(problem, thetas[:1], runs[:1])[0]
    (window,) = problem.windows
    basis = window.residuals.terms.shapes.basis
    prior = window.residuals.prior_deviations(window.numbers(thetas[0])[1]) ** 2
    covariance = basis * prior @ basis.T
    residual = problem.residual(runs[0])[:, 1]
    dense = covariance @ np.linalg.solve(covariance + 0.1**2 * np.eye(len(residual)), residual)
    np.testing.assert_allclose(expected[:, 1], dense, atol=1e-8)
    assert not expected[:, 0].any()


def test_without_discrepancy_there_is_nothing_to_tell(tmp_path):
    problem = build_problem(*small.closed_loop(tmp_path))
    assert confounding(problem, problem.priors.median()[None], [None]) is None
