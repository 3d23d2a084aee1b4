"""Intervals if the scenario's fixed numbers are off, on the small satellite."""

from types import SimpleNamespace

import numpy as np
import pytest

from flightcal.calibration.fixed_numbers import considered
from flightcal.problem import build_problem
from flightcal.scenario import LogNormal
from tests import small

WITHIN = 0.1
FIXED = ("nodes.body.capacity", "nodes.panel.capacity")
DRAWS = 4000


def written(*, free=False):
    """The small satellite, whose capacities are fixed, or parameters that are off by so much."""
    content = small.content()
    del content["simulator"]["heaters"], content["observations"]["heater_status"], content["parameters"]["power"]
    if free:
        for path, value in zip(FIXED, ("3000 J/K", "800 J/K"), strict=True):
            prior = {"lognormal": {"median": value, "factor": float(np.exp(WITHIN))}}
            content["parameters"][path.split(".")[1]] = {"sets": path, "prior": prior}
    return content


def around(problem):
    """A point, and what the posterior scatters around it, as if normal: theta [S, d]."""
    values = small.TRUTH | {"noise.body_temp": 0.1, "body": 3000.0, "panel": 800.0}
    values |= {"initial.body": 285.0, "initial.panel": small.TRUTH["initial_panel"]}
    z = problem.to_z(np.array([values[name] for name in problem.names]))
    covariance = np.linalg.inv(problem.gauss_newton_hessian(z))
    drawn = np.random.default_rng(0).multivariate_normal(z, covariance, DRAWS)
    # Their mean is the point, so that both problems are linear about the same.
    return problem.to_theta(drawn - drawn.mean(axis=0) + z), covariance


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """The problem with fixed capacities, and the one in which they are parameters."""
    folders = (tmp_path_factory.mktemp(name) for name in ("fixed", "free"))
    return [build_problem(*small.closed_loop(folder, written(free=k == 1))) for k, folder in enumerate(folders)]


def deviations(problem, thetas):
    return dict(zip(problem.names, problem.to_z(thetas).std(axis=0), strict=True))


def test_values_scatter_as_they_would_if_the_numbers_were_parameters(both):
    fixed, free = both
    thetas, _ = around(fixed)
    moved, found = considered(fixed, thetas, WITHIN, seed=1)
    assert found.within == WITHIN
    before, after = deviations(fixed, thetas), deviations(fixed, moved)
    expected = np.sqrt(np.diag(around(free)[1]))
    for name in ("link", "panel_size"):
        wanted = expected[free.names.index(name)]
        assert wanted > 1.5 * before[name]
        # Of 4,000 draws a deviation is off by 1.1%.
        assert after[name] == pytest.approx(wanted, rel=0.05), name


def test_a_value_follows_a_number_as_is_said(both):
    fixed, free = both
    _, found = considered(fixed, around(fixed)[0], WITHIN, seed=1)
    covariance, names = around(free)[1], free.names
    assert {footing.number for footing in found.footings} <= set(FIXED)
    body_footing = next(
        footing for footing in found.footings if (footing.name, footing.number) == ("link", "nodes.body.capacity")
    )
    number, value = names.index("body"), names.index("link")
    # Of a normal posterior in z, which is in deviations of the prior.
    left = np.sqrt(covariance[number, number])
    assert body_footing.off == pytest.approx(WITHIN * left, rel=0.02)
    link = next(entry for entry in free.entries if entry.name == "link")
    assert isinstance(link.prior, LogNormal)
    moved = small.TRUTH["link"] * np.expm1(np.log(link.prior.factor) * covariance[number, value] / left)
    assert body_footing.change == pytest.approx(moved, rel=0.02)


def test_a_number_that_is_well_known_widens_nothing(both):
    thetas, _ = around(both[0])
    moved, found = considered(both[0], thetas, 1e-6, seed=1)
    np.testing.assert_allclose(moved, thetas, rtol=1e-4)
    assert found.footings == ()


def test_what_parameters_set_or_scale_is_not_fixed_nor_are_thresholds(tmp_path):
    problem = build_problem(*small.closed_loop(tmp_path))
    _, found = considered(problem, around(problem)[0], WITHIN, seed=1)
    assert {footing.number for footing in found.footings} <= set(FIXED)


def test_of_a_simulator_that_is_no_thermal_network_nothing_is_known():
    priors = SimpleNamespace(to_z=np.log)
    problem = SimpleNamespace(priors=priors, to_theta=np.exp, windows=[SimpleNamespace(is_network=False)])
    assert considered(problem, np.ones((3, 2)), WITHIN, seed=1) is None


def test_nothing_is_known_where_simulations_near_the_mean_fail(both, monkeypatch):
    thetas, _ = around(both[0])
    broken = np.full((7, 7), np.nan)
    monkeypatch.setattr(type(both[0]), "gauss_newton_hessian", lambda *_: broken)
    assert considered(both[0], thetas, WITHIN, seed=1) is None
