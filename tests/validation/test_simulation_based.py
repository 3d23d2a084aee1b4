"""Ranks of a problem whose posterior is known: a normal mean with a normal prior and correlated draws."""

import numpy as np
import pytest
from scipy.stats import binom

from flightcal.validation.simulation_based import (
    Repeat,
    check_ranks,
    ecdf,
    ecdf_band,
    joint,
    p_value,
    ranks,
    stays_inside,
)
from tests.validation.test_residuals import ar1

NAMES = ("one", "two")


def repeats(count, *, width=1.0, shift=0.0, seed=0, rho=0.5):
    """Mean ~ N(0, 2^2), one sample of it with noise one: posterior N(0.8 y, 0.8); `width` and `shift` falsify it."""
    rng = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        truth = 2.0 * rng.normal(size=2)
        centre, deviation = 0.8 * (truth + rng.normal(size=2)) + shift, np.sqrt(0.8) * width
        draws = np.stack([[ar1(rho, 300, rng) for _ in NAMES] for _ in range(2)])
        draws = centre + deviation * np.moveaxis(draws, 1, 2)
        effective = 600 * (1 - rho) / (1 + rho)
        rank, used = ranks(truth, draws, effective, rng)
        made.append(Repeat(truth, rank, draws.mean(axis=(0, 1)), draws.std(axis=(0, 1)), used, (), 0, 0.0))
    return made


def judged(made):
    return check_ranks(NAMES, made, np.full(2, 2.0))


def test_right_posteriors_have_uniform_ranks_right_coverage_and_the_known_contraction():
    made = repeats(400)
    for check in judged(made):
        assert check.inside
        for probability, share in zip((0.5, 0.8, 0.95), check.coverage, strict=True):
            assert binom.ppf(1e-3, 400, probability) <= 400 * share <= binom.ppf(1 - 1e-3, 400, probability)
        assert check.contraction == pytest.approx(0.8, abs=0.02)
        # Root mean square of 400 standard normals: four standard errors.
        assert check.score == pytest.approx(1.0, abs=4 / np.sqrt(800))


@pytest.mark.parametrize("wrong", [{"width": 0.5}, {"width": 2.0}, {"shift": 1.0}, {"shift": -1.0}])
def test_posteriors_too_narrow_too_wide_or_biased_leave_the_band(wrong):
    assert not any(check.inside for check in judged(repeats(60, **wrong)))


def test_draws_that_share_a_value_count_once():
    rng = np.random.default_rng(3)
    rank = np.array(
        [
            ranks(rng.normal(size=1), np.repeat(rng.normal(size=(2, 10, 1)), 10, axis=1), 200.0, rng)[0]
            for _ in range(4000)
        ]
    )
    # If each counted, 1 in 21 would lie below all of them, and so below 1/201.
    assert binom.ppf(1e-3, 4000, 0.01) <= (rank < 0.01).sum() <= binom.ppf(1 - 1e-3, 4000, 0.01)


def test_ranks_are_among_as_many_draws_as_are_effective():
    rng = np.random.default_rng(1)
    draws = rng.normal(size=(2, 300, 3))
    assert ranks(np.zeros(3), draws, 80.0, rng)[1] == 80
    assert ranks(np.zeros(3), draws, 5000.0, rng)[1] == 200
    assert ranks(np.zeros(3), draws, 0.3, rng)[1] == 2
    rank, _ = ranks(np.array([-9.0, 0.0, 9.0]), draws, 200.0, rng)
    assert rank[0] < 1 / 201
    assert 200 / 201 < rank[2] < 1.0
    # Half of 200 draws lie below the middle: five standard errors of that.
    assert rank[1] == pytest.approx(0.5, abs=5 * np.sqrt(0.25 / 200))


def test_ranks_that_no_trial_strays_as_far_as_are_as_unlikely_as_the_trials_can_say():
    assert p_value(np.full(50, 0.01)) == 1 / 20_001


def test_correlated_chains_that_are_not_thinned_are_not_uniform():
    rng = np.random.default_rng(2)
    narrow = [ranks(rng.normal(size=1), np.stack([ar1(0.99, 300, rng)])[..., None], 1e9, rng)[0][0] for _ in range(200)]
    assert p_value(np.array(narrow)) < 1e-3


@pytest.mark.parametrize("count", [30, 200])
def test_uniform_ranks_stay_in_the_band_with_its_probability(count):
    rng = np.random.default_rng(3)
    band = ecdf_band(count, 0.95)
    sets = rng.random((2000, count))
    share = np.mean([stays_inside(values, band) for values in sets])
    assert share == pytest.approx(0.95, abs=3.5 * np.sqrt(0.95 * 0.05 / 2000))
    p_values = np.array([p_value(values) for values in sets[:500]])
    assert np.mean(p_values < 0.05) < 0.05 + 4 * np.sqrt(0.05 * 0.95 / 500)


def test_the_bands_of_several_quantities_hold_together():
    rng = np.random.default_rng(4)
    band = ecdf_band(50, joint(0.95, 10))
    together = [all(stays_inside(values, band) for values in rng.random((10, 50))) for _ in range(600)]
    assert np.mean(together) > 0.95 - 4 * np.sqrt(0.95 * 0.05 / 600)


def test_a_quantity_that_one_band_would_refuse_may_stay_in_that_of_two():
    rng = np.random.default_rng(5)
    alone, together = (ecdf_band(60, joint(0.95, count)) for count in (1, 2))
    rank = next(
        values
        for values in rng.random((2000, 60))
        if stays_inside(values, together) and not stays_inside(values, alone)
    )
    for names in (("one",), ("one", "two")):
        nothing = np.zeros(len(names))
        made = [Repeat(nothing, np.full(len(names), r), nothing + 3.0, nothing + 1.5, 100, (), 0, 0.0) for r in rank]
        for check in check_ranks(names, made, nothing + 2.0):
            assert check.inside == (len(names) == 2)
            assert check.score == pytest.approx(3.0 / 1.5)
            assert check.contraction == pytest.approx(1.0 - (1.5 / 2.0) ** 2)


def test_the_distribution_function_counts_what_is_at_a_point():
    np.testing.assert_array_equal(
        ecdf(np.array([0.5, 0.25, 1.0, 0.25]), np.array([0.2, 0.25, 0.5, 1.0])), [0, 0.5, 0.75, 1]
    )
