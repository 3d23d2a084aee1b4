import warnings

import numpy as np
import pytest

from flightcal.calibration.genetic import CONVERGED_AFTER, has_converged, minimise
from flightcal.errors import FlightcalError
from flightcal.scenario import GeneticSettings
from tests.told import Told

LOWER, UPPER = np.array([-5.0, 0.0, 100.0]), np.array([5.0, 1.0, 300.0])
TARGET = np.array([1.5, 0.2, 250.0])
PYMOO = [
    [1.448175511385295, 0.19709683187523452, 249.69992002497912],
    [1.351451257263825, 0.19127960115540818, 249.7122995133641],
]


def bowl(individuals):
    return np.sqrt(np.mean(((individuals - TARGET) / (UPPER - LOWER)) ** 2, axis=1))


def small(**changes):
    return GeneticSettings(**{"runs": 3, "population": 24, "generations": 30, **changes})


def test_every_run_finds_the_minimum():
    result = minimise(bowl, LOWER, UPPER, small(generations=60), seed=1)
    assert (result.cost < 0.01).all()
    assert (abs(result.best_theta - TARGET) < 0.02 * (UPPER - LOWER)).all()


def test_a_valley_in_twenty_dimensions_is_descended():
    rng = np.random.default_rng(0)
    rotation, _ = np.linalg.qr(rng.normal(size=(20, 20)))
    scale = np.geomspace(1.0, 30.0, 20)

    def valley(individuals):
        return np.sqrt(np.mean(((individuals - 0.3) @ rotation * scale) ** 2, axis=1))

    settings = GeneticSettings(runs=2, population=64, generations=120)
    result = minimise(valley, np.full(20, -2.0), np.full(20, 2.0), settings, seed=2)
    assert (result.history[:, -1] < 0.2 * result.history[:, 0]).all()


def test_shapes_and_summaries_agree_with_the_runs():
    result = minimise(bowl, LOWER, UPPER, small(), seed=1)
    assert result.best.shape == (3, 3)
    assert result.history.shape == (3, 30)
    np.testing.assert_array_equal(result.cost, bowl(result.best.values))
    np.testing.assert_array_equal(result.history[:, -1], result.cost)
    assert (np.diff(result.history.values, axis=1) <= 0).all()
    np.testing.assert_allclose(result.mean_theta, result.best.mean("run"))
    np.testing.assert_array_equal(result.best_theta, result.best[result.cost.values.argmin()])


def test_a_run_ends_when_it_has_converged_and_goes_on_no_longer_for_a_higher_cap():
    calls = []

    def counted(individuals):
        calls.append(len(individuals))
        return bowl(individuals) + 0.1

    result = minimise(counted, LOWER, UPPER, small(generations=1000), seed=1)
    assert (result.converged == 1).all()
    assert result.attrs["converged_runs"] == 3
    assert len(calls) == result.generations.max()
    assert sum(calls) == 24 * result.generations.sum()
    assert (result.generations > CONVERGED_AFTER).all()
    assert (result.generations < 400).all()
    assert result.identical(minimise(counted, LOWER, UPPER, small(generations=2000), seed=1))
    assert result.sizes["generation"] == result.generations.max()
    for run, generations in enumerate(result.generations.values):
        costs = result.history.values[run]
        assert costs[generations - 1] == result.cost.values[run]
        assert np.isnan(costs[generations:]).all()
        assert costs[generations - 1] >= 0.99 * costs[generations - 1 - CONVERGED_AFTER]


def test_a_run_that_the_cap_ends_has_not_converged():
    result = minimise(bowl, LOWER, UPPER, small(), seed=1)
    assert (result.converged == 0).all()
    assert result.attrs["converged_runs"] == 0
    assert (result.generations == 30).all()


def test_a_run_has_not_converged_while_its_cost_falls_its_population_narrows_or_it_is_young():
    many = CONVERGED_AFTER + 1
    flat, wide = [1.0] * many, [0.2] * many
    assert has_converged(flat, wide)
    assert not has_converged(flat[1:], wide[1:])
    assert not has_converged([*flat[1:], 0.98], wide)
    assert has_converged([*flat[1:], 0.995], wide)
    assert not has_converged(flat, [*wide[1:], 0.17])
    assert has_converged(flat, [*wide[1:], 0.0005])
    assert not has_converged([np.inf] * many, wide)


def test_cost_is_called_once_a_generation_with_the_populations_of_all_runs():
    calls, told = [], Told()

    def counted(individuals):
        calls.append(individuals.shape)
        return bowl(individuals)

    result = minimise(counted, LOWER, UPPER, small(), seed=1, progress=told)
    assert calls == [(3 * 24, 3)] * 30
    assert result.evaluations == 90 * 24
    assert told.stages["search"] == [
        (k + 1, f"generation {k + 1}, {3 if k == 29 else 0} of 3 runs have ended, cost {best:.4g}")
        for k, best in enumerate(result.history.values.min(axis=0))
    ]


def test_a_run_is_the_same_whatever_runs_go_on_beside_it():
    alone = minimise(bowl, LOWER, UPPER, small(runs=1, generations=1000), seed=3)
    beside = minimise(bowl, LOWER, UPPER, small(runs=3, generations=1000), seed=3)
    assert len(set(beside.generations.values)) > 1
    length = int(alone.generations[0])
    assert np.array_equal(beside.history[0, :length], alone.history[0])
    assert np.array_equal(beside.best[0], alone.best[0])


def test_initial_population_is_a_latin_hypercube_of_the_box():
    populations = []

    def kept(individuals):
        populations.append(individuals)
        return bowl(individuals)

    minimise(kept, LOWER, UPPER, small(runs=1, generations=1), seed=1)
    cells = np.floor((populations[0] - LOWER) / (UPPER - LOWER) * 24).astype(int)
    for column in cells.T:
        assert sorted(column) == list(range(24))


def test_individuals_stay_in_the_box():
    def corner(individuals):
        assert (individuals >= LOWER).all()
        assert (individuals <= UPPER).all()
        return -individuals.sum(axis=1)

    minimise(corner, LOWER, UPPER, small(), seed=1)


def test_same_seed_gives_the_same_result_whatever_numpys_global_state():
    np.random.seed(1)
    first = minimise(bowl, LOWER, UPPER, small(), seed=5)
    np.random.seed(2)
    before = np.random.get_state()[1].copy()
    second = minimise(bowl, LOWER, UPPER, small(), seed=5)
    assert first.identical(second)
    np.testing.assert_array_equal(np.random.get_state()[1], before)


def test_runs_and_seeds_differ():
    first = minimise(bowl, LOWER, UPPER, small(), seed=5)
    other = minimise(bowl, LOWER, UPPER, small(), seed=6)
    assert len(np.unique(first.history[:, 0])) == 3
    assert not np.array_equal(first.best, other.best)


def test_failed_simulations_lose_and_are_counted():
    failures = 0

    def half_broken(individuals):
        nonlocal failures
        costs = bowl(individuals)
        broken = individuals[:, 0] > 1.0
        failures += broken.sum()
        costs[broken] = np.resize([np.nan, np.inf, -np.inf], broken.sum())
        return costs

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = minimise(half_broken, LOWER, UPPER, small(generations=60), seed=1)
    assert result.failures == failures > 0
    assert (result.best[:, 0] <= 1.0).all()
    np.testing.assert_allclose(result.best_theta[0], 1.0, atol=0.2)


def test_a_run_that_starts_with_failures_alone_recovers():
    calls = 0

    def late(individuals):
        nonlocal calls
        calls += 1
        return np.full(len(individuals), np.nan) if calls <= 2 else bowl(individuals)

    result = minimise(late, LOWER, UPPER, small(runs=1), seed=1)
    assert np.isinf(result.history[0, :2]).all()
    assert np.isfinite(result.cost).all()


def test_no_success_at_all_is_reported_with_the_number_of_simulations():
    with pytest.raises(FlightcalError, match="no finite cost in 480 simulations"):
        minimise(lambda x: np.full(len(x), np.nan), LOWER, UPPER, small(runs=2, generations=10), seed=1)


def test_of_a_single_run_the_mean_is_the_best():
    result = minimise(bowl, LOWER, UPPER, small(runs=1), seed=1)
    np.testing.assert_array_equal(result.mean_theta, result.best_theta)


def test_a_run_is_that_of_pymoo():
    """pymoo 0.6.2: GA with LHS, SBX(prob=0.9, eta=15) and PM(eta=20), seeded alike; ties and failures among it."""

    def steps(individuals):
        costs = np.round(bowl(individuals), 2)
        costs[individuals[:, 1] > 0.9] = np.nan
        return costs

    result = minimise(steps, LOWER, UPPER, small(runs=2, population=15, generations=25), seed=9)
    np.testing.assert_allclose(result.best, PYMOO, rtol=1e-12)
