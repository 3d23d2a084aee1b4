"""More draws are made where only effective draws are wanting."""

from dataclasses import replace

import numpy as np
import pytest

from flightcal.calibration.diagnostics import Diagnostics, diagnose, gate
from flightcal.calibration.enough_draws import sample_enough
from flightcal.calibration.nuts import Draws
from flightcal.problem import Whitening
from flightcal.progress import SILENT
from flightcal.scenario import NutsSettings

SETTINGS = NutsSettings(chains=2, draws=1000, warmup=50, min_ess=400)
PLAIN = Whitening(np.zeros(2), np.eye(2))
MIXING = np.array([[2.0, 0.0], [1.9, 0.3]])


def draws_of(z):
    chains, count, _ = z.shape
    rng = np.random.default_rng(5)
    statistics = {
        "diverging": np.zeros((chains, count), bool),
        "depth": np.full((chains, count), 3),
        "energy": rng.standard_normal((chains, count)),
    }
    return Draws(z, statistics, 10 * count, 10, 0, 0, None, False)


def slow(kept):
    """A sampler whose draws are those of an AR(1) process of mean (10, 20), and what it is asked for."""
    asked, rng = [], np.random.default_rng(1)

    def sampler(coordinates, settings, seed):
        asked.append((coordinates, settings.draws, seed))
        w = rng.standard_normal((settings.chains, settings.draws, 2))
        for k in range(1, settings.draws):
            w[:, k] = kept * w[:, k - 1] + np.sqrt(1 - kept**2) * w[:, k]
        return draws_of(np.array([10.0, 20.0]) + w @ MIXING.T)

    return sampler, asked


def judge(draws):
    by_name = {"first": draws.z[..., 0], "second": draws.z[..., 1]}
    return draws.z, diagnose(by_name, draws.statistics, SETTINGS.model_copy(update={"max_r_hat": 1.9}))


def test_draws_that_are_enough_are_left_alone():
    sampler, asked = slow(0.0)
    draws, theta, judged = sample_enough(sampler, PLAIN, SETTINGS, 3, judge, SILENT)
    assert len(asked) == 1
    assert theta.shape == draws.z.shape == (2, 1000, 2)
    assert judged.passed


def test_too_few_effective_draws_are_made_more_in_coordinates_of_the_first_ones():
    sampler, asked = slow(0.75)
    draws, theta, judged = sample_enough(sampler, PLAIN, SETTINGS, 3, judge, SILENT)
    (_, _, first_seed), (coordinates, more, seed) = asked
    assert 0 < more <= 1000
    assert seed != first_seed
    assert theta.shape == draws.z.shape == (2, 1000 + more, 2)
    assert draws.statistics["depth"].shape == (2, 1000 + more)
    assert draws.gradients == 10 * (1000 + more)
    assert judged.passed
    white = coordinates.to_w(draws.z[:, :1000]).reshape(-1, 2)
    np.testing.assert_allclose(np.cov(white, rowvar=False), np.eye(2), atol=1e-9)
    np.testing.assert_allclose(white.mean(axis=0), 0.0, atol=1e-9)


def test_they_are_made_more_again_where_those_that_were_added_are_less_effective():
    sampler, asked = slow(0.0)

    def judged(draws):
        theta, diagnostics = judge(draws)
        count = draws.z.shape[1]
        if count > 3000:
            return theta, diagnostics
        worst = replace(diagnostics.parameters[0], ess_bulk=150.0)
        gates = (*diagnostics.gates, gate("effective draws", False, "", "", ""))
        return theta, replace(diagnostics, parameters=(worst, *diagnostics.parameters[1:]), gates=gates)

    draws, _, found = sample_enough(sampler, PLAIN, SETTINGS, 3, judged, SILENT)
    assert [count for _, count, _ in asked] == [1000, 1000, 2000], "each time at most as many again"
    assert len({seed for _, _, seed in asked}) == 3
    assert draws.z.shape == (2, 4000, 2)
    assert found.passed


def test_what_more_draws_do_not_mend_is_left_as_it_is():
    sampler, asked = slow(0.75)

    def apart(draws):
        theta, judged = judge(draws)
        return theta, replace(judged, gates=(*judged.gates, gate("E-BFMI", False, "", "", "")))

    sample_enough(sampler, PLAIN, SETTINGS, 3, apart, SILENT)
    assert len(asked) == 1
    sampler, asked = slow(0.99)
    _, _, judged = sample_enough(sampler, PLAIN, SETTINGS, 3, judge, SILENT)
    assert len(asked) == 1
    assert not judged.passed


def with_r_hat(found):
    """`judge`, where the first draws have an R-hat that fails its gate, and no others."""

    def judged(draws):
        theta, diagnostics = judge(draws)
        if draws.z.shape[1] > SETTINGS.draws:
            return theta, diagnostics
        worst = replace(diagnostics.parameters[0], r_hat=found)
        gates = (*diagnostics.gates, gate("R-hat", False, "", "", ""))
        return theta, replace(diagnostics, parameters=(worst, *diagnostics.parameters[1:]), gates=gates)

    return judged


def test_an_r_hat_just_above_its_limit_is_looked_at_with_twice_the_draws_and_no_other():
    sampler, asked = slow(0.0)
    draws, _, judged = sample_enough(sampler, PLAIN, SETTINGS, 3, with_r_hat(1.035), SILENT)
    assert draws.z.shape == (2, 2000, 2)
    assert judged.passed
    sampler, asked = slow(0.0)
    sample_enough(sampler, PLAIN, SETTINGS, 3, with_r_hat(1.05), SILENT)
    assert len(asked) == 1


def test_an_interrupted_sampling_is_not_gone_on_with():
    sampler, asked = slow(0.75)
    draws, _, _ = sample_enough(
        lambda *given: replace(sampler(*given), interrupted=True), PLAIN, SETTINGS, 3, judge, SILENT
    )
    assert draws.interrupted
    assert len(asked) == 1


def test_an_interruption_before_the_first_draw_is_one():
    def nothing(*_):
        return replace(draws_of(np.zeros((2, 0, 2))), interrupted=True)

    with pytest.raises(KeyboardInterrupt):
        sample_enough(nothing, PLAIN, SETTINGS, 3, lambda d: (d.z, Diagnostics((), (), False, "")), SILENT)


def breaking(share, once):
    """A sampler of which a share of the trajectories break off, only the first time if `once`, and what it is asked."""
    asked, rng = [], np.random.default_rng(1)

    def sampler(coordinates, settings, seed):
        asked.append((settings, seed))
        drawn = draws_of(rng.standard_normal((settings.chains, settings.draws, 2)))
        if not (once and len(asked) > 1):
            drawn.statistics["diverging"][:, : round(share * settings.draws)] = True
        return drawn

    return sampler, asked


def test_where_trajectories_break_off_all_is_drawn_once_more_with_smaller_steps():
    sampler, asked = breaking(0.05, once=True)
    draws, theta, judged = sample_enough(sampler, PLAIN, SETTINGS, 3, judge, SILENT)
    (first, first_seed), (second, seed) = asked
    assert (first.target_acceptance, second.target_acceptance) == pytest.approx((0.85, 0.95))
    assert seed != first_seed
    assert theta.shape == draws.z.shape == (2, 1000, 2)
    assert not draws.statistics["diverging"].any()
    assert draws.gradients == 2 * 10 * 1000
    assert draws.warmup_gradients == 10 * 1000 + 10
    assert judged.passed


def test_where_they_break_off_again_that_is_told():
    sampler, asked = breaking(0.05, once=False)
    draws, _, judged = sample_enough(sampler, PLAIN, SETTINGS, 3, judge, SILENT)
    assert len(asked) == 2
    assert draws.z.shape == (2, 1000, 2)
    assert [criterion.name for criterion in judged.gates if not criterion.passed] == ["divergences"]


def test_a_few_that_break_off_and_steps_that_are_small_already_are_left_alone():
    sampler, asked = breaking(0.01, once=False)
    assert sample_enough(sampler, PLAIN, SETTINGS, 3, judge, SILENT)[2].passed
    assert len(asked) == 1
    sampler, asked = breaking(0.05, once=False)
    small_steps = SETTINGS.model_copy(update={"target_acceptance": 0.98})
    assert not sample_enough(sampler, PLAIN, small_steps, 3, judge, SILENT)[2].passed
    assert len(asked) == 1
