"""Thresholds that are parameters, as measured switches show them."""

from types import SimpleNamespace

import numpy as np
import pytest

from flightcal.calibration.find_heat import find_heat
from flightcal.calibration.heat_point import start_with_heat
from flightcal.calibration.thresholds import _drawn, with_thresholds
from flightcal.problem import build_problem

from .. import small

DRAWS = 250


def told(log_likelihood, count, draws=4000):
    """What the sampler takes: parameters are their normal scores."""
    names = tuple(f"p{k}" for k in range(count))
    return SimpleNamespace(
        base=np.zeros((draws, 2, 1)),
        priors=SimpleNamespace(names=names),
        log_likelihood=lambda scores, rows: log_likelihood(scores),
        values=lambda scores: scores,
    )


def test_what_nothing_tells_of_is_as_its_prior_beside_what_is_known():
    draws, deviation = 4000, 0.05
    found = _drawn(told(lambda z: -0.5 * ((z[:, 0] - 2.0) / deviation) ** 2, 3, draws), np.random.default_rng(0))
    exact = np.array([[2.0 / (1.0 + deviation**2), 0.0, 0.0], [deviation / np.hypot(1.0, deviation), 1.0, 1.0]])
    mean, spread = found.mean(axis=0), found.std(axis=0)
    assert (np.abs(mean - exact[0]) < 4.5 * exact[1] / np.sqrt(draws)).all()
    assert (np.abs(spread / exact[1] - 1.0) < 4.5 / np.sqrt(2.0 * draws)).all()
    correlation = np.corrcoef(found.T)[np.triu_indices(3, 1)]
    assert (np.abs(correlation) < 4.5 / np.sqrt(draws)).all()


def test_a_bound_cuts_a_prior():
    draws = 4000
    (found,) = _drawn(told(lambda z: np.where(z[:, 0] < -1.0, 0.0, -1e6), 1, draws), np.random.default_rng(0)).T
    assert (found < -1.0).all()
    # Of a normal distribution cut off there: mean -1.525, deviation 0.446.
    assert found.mean() == pytest.approx(-1.525, abs=4.5 * 0.446 / np.sqrt(draws))


def content_of(*names, off=0.8):
    """Thresholds of names are parameters, whose priors are off."""
    content = small.content() | {"heat": {"pattern": {"harmonics": 1}, "slow": None}, "time_error": "none"}
    for name, written in (("on_below", 10.0), ("off_above", 13.0)):
        prior = {"normal": {"mean": f"{written - off} degC", "standard_deviation": "1 K"}}
        if name in names:
            content["parameters"][name] = {"sets": f"heaters.heater.{name}", "prior": prior}
    return content


@pytest.mark.parametrize("names", [["on_below"], ["on_below", "off_above"]])
def test_thresholds_are_found_where_heaters_switch_and_all_else_stays(tmp_path, names):
    _, data = small.closed_loop(tmp_path, small.content(), noise=0.03)
    problem = build_problem(small.load(tmp_path, content_of(*names))[0], data)
    heated, z = start_with_heat(problem, find_heat(problem, problem.priors.median()))
    thetas = np.tile(heated.to_theta(z), (DRAWS, 1))
    found = with_thresholds(heated, thetas, np.random.default_rng(0))
    columns = [heated.names.index(name) for name in names]
    others = np.setdiff1d(np.arange(len(heated.names)), columns)
    np.testing.assert_array_equal(found[:, others], thetas[:, others])
    truth = {"on_below": 283.15, "off_above": 286.15}
    for name, column in zip(names, columns, strict=True):
        draws = found[:, column]
        assert draws.std() < 0.2
        assert abs(draws.mean() - truth[name]) < 2.5 * draws.std()


def test_without_such_parameters_nothing_is_done(tmp_path):
    problem = build_problem(*small.closed_loop(tmp_path, content_of()))
    thetas = problem.priors.median()[None]
    assert with_thresholds(problem, thetas, np.random.default_rng(0)) is thetas
