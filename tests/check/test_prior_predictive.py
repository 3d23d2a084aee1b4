"""Priors that reach the telemetry, and priors that do not."""

import re

import numpy as np
import pytest
from scipy.stats import norm

from flightcal.check.prior_predictive import prior_predictive
from flightcal.problem import build_problem
from flightcal.scenario import Heat, Normal
from tests import small

from .problems import centre_at, formula_problem, observing, samples, several

PRIORS = {"body": Normal(mean=0.0, standard_deviation=1.0), "panel": Normal(mean=0.0, standard_deviation=1.0)}
EXACT = {"body": 0.0, "panel": 0.0}


def levels(theta):
    return 290.0 + np.ones((samples(), 1)) * np.asarray(theta)


def found_for(problem, centre, count=2000):
    draws = problem.priors.sample(np.random.default_rng(0), count)
    return prior_predictive(problem, (draws, problem.simulate_many(draws)), centre, 0)


@pytest.fixture(scope="module")
def problem():
    return formula_problem(PRIORS, levels, EXACT)


def test_a_prior_around_the_truth_holds_the_telemetry_in_its_band_of_known_width(problem):
    found = found_for(problem, centre_at(problem, **EXACT))
    assert [channel.inside for channel in found.channels] == [1.0, 1.0]
    assert [channel.reached for channel in found.channels] == [1.0, 1.0]
    assert found.pressed == ()
    (bands,) = found.bands
    half = 0.5 * (bands.quantiles[2] - bands.quantiles[0]).mean()
    assert half == pytest.approx(1.96 * np.sqrt(1.0 + 0.1**2), rel=0.04)


def test_a_channel_that_the_prior_cannot_reach_is_named_with_side_and_distance(problem):
    observed = problem.windows[0].observed + np.array([0.0, -6.0])
    far = observing(problem, observed)
    found = found_for(far, centre_at(far, body=0.0, panel=-5.9))
    body, panel = found.channels
    assert body.reached == 1.0
    assert (panel.channel, panel.reached, panel.inside) == ("panel_temp", 0.0, 0.0)
    # The 99% band ends 2.58 below, and twice the noise of 0.1 K below that.
    assert panel.beyond == pytest.approx(observed[:, 1].min() - 290.0 + 2.58 + 0.2, abs=0.2)
    (pressed,) = found.pressed
    assert (pressed.name, pressed.theta) == ("panel", pytest.approx(-5.9))
    assert pressed.probability < 1e-6


@pytest.mark.parametrize(("heat", "pressed"), [("none", ["noise.body_temp"]), (Heat(), [])])
def test_noise_is_at_no_edge_where_it_stands_for_unmodelled_heat(tmp_path, heat, pressed):
    scenario, data = small.closed_loop(tmp_path)
    problem = build_problem(scenario.model_copy(update={"heat": heat}), data)
    medians = dict(zip(problem.names, problem.priors.median(), strict=True))
    upper = dict(zip(problem.names, problem.priors.quantile(0.999), strict=True))
    centre = centre_at(problem, **(medians | {"noise.body_temp": upper["noise.body_temp"]}))
    assert [parameter.name for parameter in found_for(problem, centre, 20).pressed] == pressed


@pytest.mark.parametrize(
    "prior", [{"half_normal": "2 K"}, {"half_student_t": {"scale": "2 K", "degrees_of_freedom": 3}}]
)
def test_noise_near_zero_is_at_no_edge_of_a_prior_whose_mode_is_there(tmp_path, prior):
    content = small.content()
    content["observations"]["body_temp"]["noise"] = prior
    problem = build_problem(*small.closed_loop(tmp_path, content))
    medians = dict(zip(problem.names, problem.priors.median(), strict=True))
    centre = centre_at(problem, **(medians | {"noise.body_temp": 1e-4}))
    assert found_for(problem, centre, 20).pressed == ()


def test_noise_alone_puts_no_telemetry_out_of_reach():
    tight = {name: Normal(mean=0.0, standard_deviation=0.02) for name in PRIORS}
    problem = formula_problem(tight, levels, EXACT)
    found = found_for(problem, centre_at(problem, **EXACT))
    # A band of 2 noise levels and 2.58 deviations of the prior.
    expected = 1.0 - 2.0 * norm.sf(2.0 + 2.58 * 0.02 / 0.1)
    for channel in found.channels:
        assert channel.reached == pytest.approx(expected, abs=4.0 * np.sqrt(0.01 / samples()))


def test_failed_simulations_are_counted_and_left_out(problem):
    draws = problem.priors.sample(np.random.default_rng(0), 40)
    runs = problem.simulate_many(draws)
    runs[::4] = [None] * 10
    found = prior_predictive(problem, (draws, runs), centre_at(problem, **EXACT), 0)
    assert (found.draws, found.failed) == (40, 10)
    assert np.isfinite(found.bands[0].quantiles).all()


def test_why_simulations_fail_is_told_with_the_heater_whose_thresholds_cross(tmp_path):
    _, data = small.closed_loop(tmp_path)
    written = small.content()
    written["parameters"]["on"] = {
        "sets": "heaters.heater.on_below",
        "prior": {"normal": {"mean": "12 degC", "standard_deviation": "1.5 K"}},
    }
    problem = build_problem(small.load(tmp_path, written)[0], data)
    found = found_for(problem, centre_at(problem, **dict(zip(problem.names, problem.priors.median(), strict=True))), 40)
    assert 0 < len(found.why) <= found.failed < 40
    for said in found.why:
        on, off = (float(part) for part in re.findall(r"([0-9.]+) degC", said.partition("heater 'heater'")[2]))
        assert on >= off == 13.0


def test_telemetry_out_of_reach_in_one_of_two_windows_is_that_windows(problem):
    far = observing(problem, problem.windows[0].observed + np.array([0.0, -6.0]))
    both = several(near=problem, far=far)
    found = found_for(both, centre_at(both, **EXACT), 400)
    reached = {(channel.window, channel.channel): channel.reached for channel in found.channels}
    assert reached == {
        ("near", "body_temp"): 1.0,
        ("near", "panel_temp"): 1.0,
        ("far", "body_temp"): 1.0,
        ("far", "panel_temp"): 0.0,
    }
    alone = found_for(problem, centre_at(problem, **EXACT), 400)
    np.testing.assert_allclose(found.bands[0].model, alone.bands[0].model)
    np.testing.assert_allclose(found.bands[1].model, alone.bands[0].model)
