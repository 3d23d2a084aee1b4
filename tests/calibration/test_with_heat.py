"""Posteriors of a response to heat that follows the parameters."""

import json
import re

import numpy as np
import pytest
import xarray

from flightcal.calibration import calibrate_nuts, with_heat
from flightcal.calibration.heat_file import heat_dataset, with_kept_heat
from flightcal.calibration.with_heat import next_place
from flightcal.errors import RunError
from flightcal.scenario import NutsSettings
from tests.told import Told


@pytest.fixture(scope="module")
def followed(without_heaters):
    """A posterior of a response that has to be followed however little it bends, and what was told."""
    told = Told()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(with_heat, "_STRAIGHT", 1e-9)
        settings = NutsSettings(chains=2, warmup=100, draws=60, max_r_hat=1.5, min_ess=5)
        return calibrate_nuts(without_heaters, settings, seed=3, progress=told), told


@pytest.fixture(scope="module")
def followed_posterior(followed):
    return followed[0]


def test_it_is_said_how_long_it_takes_to_follow_the_response(followed):
    assert [line for line in followed[1].said if re.search(r"is followed: about \d+ (s|min) more$", line)]


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


@pytest.mark.parametrize(
    ("bound", "value", "advice"),
    [("_MOST_FOLLOWED", 0, "Train on a shorter window"), ("_PILOT_DEPTH", 1, "narrow the priors of heat")],
    ids=["too many weights", "no chain gets through"],
)
def test_a_response_that_bends_and_is_not_followed_fails_its_gate(without_heaters, monkeypatch, bound, value, advice):
    monkeypatch.setattr(with_heat, "_STRAIGHT", 1e-9)
    monkeypatch.setattr(with_heat, bound, value)
    settings = NutsSettings(chains=2, warmup=100, draws=50, max_r_hat=1.5, min_ess=5)
    posterior = calibrate_nuts(without_heaters, settings, seed=3)
    gates = {gate.name: gate for gate in posterior.diagnostics.gates}
    assert not posterior.heat.model.followed
    assert not gates["response to heat"].passed
    assert "the log density is off by" in gates["response to heat"].found
    assert advice in gates["response to heat"].advice


@pytest.mark.parametrize("other", [{"of_pattern": None}, {"held": [{"window": "train", "shares": [], "switches": []}]}])
def test_heat_of_an_earlier_flightcal_is_refused_with_what_to_do(without_heaters, followed_posterior, other):
    point = followed_posterior.heat
    kept = heat_dataset(point.model, point.names, point.theta)
    content = json.loads(str(kept["model"].item()))
    content = {name: value for name, value in (content | other).items() if value is not None}
    tree = xarray.DataTree.from_dict({"heat": xarray.Dataset({"model": ((), json.dumps(content))})})
    with pytest.raises(RunError, match=r"earlier flightcal.*calibrate again"):
        with_kept_heat(without_heaters, tree)


def test_a_middle_that_swings_and_drifts_is_found_in_a_few_places():
    """What is found depends linearly on where it is looked for: one quantity swings, one comes slowly, one stays."""
    answers = np.array([-1.0, 0.8, 0.0])
    middle, deviation = np.array([3.0, -2.0, 10.0]), np.array([0.5, 2.0, 0.1])
    place, points, steps = middle + 4.0 * deviation, [], []
    for _ in range(5):
        found = middle + answers * (place - middle)
        points, steps = [*points, place], [*steps, found - place]
        place = next_place(points, steps, deviation)
    assert (np.abs(place - middle) < 0.1 * deviation).all()
