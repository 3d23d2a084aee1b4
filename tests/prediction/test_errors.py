"""Errors of a window given the training residuals and the window's first samples, against the dense normal."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from flightcal.prediction import predict
from flightcal.prediction.errors import FirstErrors, WhiteErrors, window_errors
from flightcal.prediction.initial import condition_initial
from flightcal.probability.noise.ar1 import TIME as MEMORY
from flightcal.probability.noise.shaped import Shaped
from flightcal.problem import build_problem, build_window

from .. import small

DRAWS, FIRST = 1500, 11
NOISE = {"model": "ar1", "standard_deviation": "0.2 K", "correlation_time": "8 min", "white": "0.1 K"}
PHASE = {"amplitude": "0.6 K", "lengthscale": 0.2, "harmonics": 6}
DISCREPANCY = {"phase": PHASE, "channels": ["panel_temp"]}
WINDOWS = {
    "after": (("00:00", "02:20"), ("02:30", "04:30")),
    "before": (("02:10", "04:30"), ("00:00", "02:00")),
}


def made(folder, order="after", discrepancy=DISCREPANCY, noise=NOISE):
    written = small.content()
    train, test = ({"start": f"2024-03-01T{start}:00", "end": f"2024-03-01T{end}:00"} for start, end in WINDOWS[order])
    written["windows"] = {"train": train, "test": test}
    written["noise"] = noise
    written["observations"]["panel_temp"].pop("noise")
    if discrepancy is not None:
        written["discrepancy"] = discrepancy
    scenario, data = small.closed_loop(folder, written)
    # An error for the discrepancy to find, in all windows.
    turns = 2 * np.pi * (data["time"].values - data["time"].values[0]) / np.timedelta64(1, "s") / small.PERIOD
    data["panel_temp"].values[:] += 0.7 * np.sin(2 * turns) + 0.5 * np.cos(turns)
    data["panel_temp"].values[[3, 20, 21, 22, 23, 152]] = np.nan
    return scenario, data


def truth(problem):
    values = {"initial.body": 285.0, "initial.panel": 262.0} | small.TRUTH
    return np.array([values[name] for name in problem.names])


class Dense:
    """Everything about one channel as one normal distribution: training residuals, first residuals, errors."""

    def __init__(self, errors, channel, *, first):
        train, window, model = errors.train, errors.window, errors.model
        times = np.concatenate([train.times, window.times])
        seconds = (times - train.times[0]) / np.timedelta64(1, "s")
        inside = np.arange(len(times)) >= len(train.times)
        apart = seconds[:, None] - seconds
        discrepancy = np.zeros_like(apart)
        if model.terms.discrepant[channel]:
            basis = np.concatenate([part.residuals.terms.shapes.basis for part in (train, window)])
            discrepancy = basis * model.prior_deviations(model.fixed[channel]) ** 2 @ basis.T
        noise = np.where(inside[:, None] == inside, 0.2**2 * np.exp(-np.abs(apart) / 480.0), 0.0)
        white = 0.1
        if not model.terms.kinds[channel].has_memory:
            noise, white = np.zeros_like(noise), 0.2
        self.white = white
        self.errors = (discrepancy + noise)[np.ix_(inside, inside)]
        seen = np.concatenate([np.isfinite(train.observed[:, channel]), np.isfinite(window.observed[:, channel])])
        seen[len(train.times) + first :] = False
        total = discrepancy + noise + white**2 * np.eye(len(times))
        self.cross, self.seen = (discrepancy + noise)[np.ix_(inside, seen)], total[np.ix_(seen, seen)]
        self.observed, self.kept = np.concatenate([train.observed, window.observed])[:, channel], seen

    def given(self, simulated):
        residual = (self.observed - simulated)[self.kept]
        gain = self.cross @ np.linalg.inv(self.seen)
        return gain @ residual, self.errors - gain @ self.cross.T


CASES = {"after": ("after", NOISE), "before": ("before", NOISE), "iid": ("after", {"standard_deviation": "0.2 K"})}


@pytest.fixture(scope="module", params=CASES)
def case(request, tmp_path_factory):
    order, noise = CASES[request.param]
    scenario, data = made(tmp_path_factory.mktemp("errors"), order, noise=noise)
    train, window = build_problem(scenario, data), build_window(scenario, data, "test")
    thetas = np.tile(truth(train), (DRAWS, 1))
    errors = window_errors(train, window, thetas, FIRST)
    temperatures = np.stack([run.temperatures for run in window.simulate_many(thetas)])
    drawn = errors.draw(temperatures, np.random.default_rng(0))
    simulated = np.concatenate([train.windows[0].simulate(thetas[0]).temperatures, temperatures[0]])
    return train, window, errors, drawn, simulated


@pytest.mark.parametrize("channel", [0, 1])
def test_errors_are_those_of_the_dense_conditional_normal(case, channel):
    _, _, errors, drawn, simulated = case
    dense = Dense(errors, channel, first=FIRST)
    mean, expected = dense.given(simulated[:, channel])
    np.testing.assert_allclose(drawn.mean[0, :, channel], mean, atol=1e-8 * np.abs(mean).max())
    sampled = (drawn.discrepancy + drawn.noise)[:, :, channel]
    deviation = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(sampled.mean(axis=0), mean, atol=5 * deviation.max() / np.sqrt(DRAWS))
    np.testing.assert_allclose(sampled.std(axis=0), deviation, rtol=0.12, atol=0.02)
    found = np.cov(sampled.T)
    np.testing.assert_allclose(found, expected, atol=6 * deviation.max() ** 2 * np.sqrt(2 / DRAWS))
    np.testing.assert_allclose(drawn.white[:, :, channel].std(), dense.white, rtol=0.02)


def test_the_law_of_the_first_samples_is_that_before_they_are_seen(case):
    _, window, errors, _, simulated = case
    law = errors.only(np.arange(DRAWS) < 2).at_first()
    for channel in range(2):
        dense = Dense(errors, channel, first=0)
        mean, expected = dense.given(simulated[:, channel])
        valid = np.isfinite(window.observed[:FIRST, channel])
        factor = law.factors[channel, 1]
        np.testing.assert_allclose(law.mean[1, :, channel], mean[:FIRST], atol=1e-8 * np.abs(mean).max())
        found = (factor @ factor.T)[np.ix_(valid, valid)]
        kept = expected[:FIRST, :FIRST][np.ix_(valid, valid)] + dense.white**2 * np.eye(valid.sum())
        np.testing.assert_allclose(found, kept, atol=1e-8 * kept.max())


def uncertain(median):
    return {"lognormal": {"median": median, "factor": 2.0}}


UNCERTAIN_NOISE = {
    key: uncertain(NOISE[key]) if key != "model" else NOISE[key]
    for key in ("model", "standard_deviation", "correlation_time", "white")
}
UNCERTAIN_PHASE = PHASE | {"amplitude": {"half_normal": "1 K"}, "lengthscale": {"uniform": [0.1, 0.3]}}


def of_pairs(folder):
    """Two thetas of which every number differs, and the two windows."""
    discrepancy = {"phase": UNCERTAIN_PHASE, "channels": ["panel_temp"]}
    scenario, data = made(folder, discrepancy=discrepancy, noise=UNCERTAIN_NOISE)
    train, window = build_problem(scenario, data), build_window(scenario, data, "test")
    pair = np.tile(train.priors.median(), (2, 1))
    for name, value in {"initial.body": 285.0, "initial.panel": 262.0, **small.TRUTH}.items():
        if name in train.names:
            pair[:, train.names.index(name)] = value
    pair[1] *= np.where([name.startswith("initial") for name in train.names], 1.001, 1.4)
    pair[1, ["amplitude" in name for name in train.names]] *= 3.0
    return train, window, pair


def test_draws_of_different_thetas_are_together_what_they_are_alone(tmp_path):
    train, window, pair = of_pairs(tmp_path)
    count = 150
    thetas = np.tile(pair, (count, 1))
    rng = np.random.default_rng(0)
    errors = window_errors(train, window, thetas, FIRST)
    temperatures = np.stack([run.temperatures for run in window.simulate_many(thetas)])
    drawn, law = errors.draw(temperatures, rng), errors.only(np.arange(2 * count) < 2).at_first()
    for s in range(2):
        alone = window_errors(train, window, thetas[s::2], FIRST)
        separate, own_law = alone.draw(temperatures[s::2], rng), alone.only(np.arange(count) < 1).at_first()
        kept = errors.only(np.arange(2 * count) % 2 == s).draw(temperatures[s::2], rng)
        for together in (drawn.mean[s], drawn.mean[2 * (count - 1) + s], kept.mean[-1]):
            np.testing.assert_allclose(together, separate.mean[0], atol=1e-9)
        np.testing.assert_allclose(law.mean[s], own_law.mean[0], atol=1e-9)
        np.testing.assert_allclose(law.factors[:, s], own_law.factors[:, 0], atol=1e-9)
        for part in ("discrepancy", "noise", "white"):
            found, expected = getattr(drawn, part)[s::2], getattr(separate, part)
            # Each of the two standard deviations is known to 1 / sqrt(2 count), and there are 121 of each.
            np.testing.assert_allclose(found.std(axis=0), expected.std(axis=0), rtol=5 / np.sqrt(count), atol=1e-9)
        # After the first samples noise is as correlated as its time says; of N samples that is known to this.
        noise = drawn.noise[s::2, 60:, 0]
        kept = np.exp(-60.0 / train.windows[0].numbers(pair[s])[0, MEMORY])
        found = (noise[:, 1:] * noise[:, :-1]).sum() / (noise[:, :-1] ** 2).sum()
        assert found == pytest.approx(kept, abs=4 * np.sqrt((1.0 - kept**2) / noise.size))


def test_a_draw_is_usable_where_its_own_simulation_of_the_training_window_is(tmp_path):
    train, window, pair = of_pairs(tmp_path)
    thetas = pair[[0, 0, 1]]
    thetas[1, train.names.index("initial.body")] = np.nan
    errors = window_errors(train, window, thetas, FIRST)
    np.testing.assert_array_equal(errors.usable(), [True, False, True])
    for s in (0, 2):
        np.testing.assert_array_equal(errors.numbers[s], train.windows[0].numbers(thetas[s]))
        np.testing.assert_allclose(
            errors.train_temperatures[s], train.windows[0].simulate(thetas[s]).temperatures, atol=1e-9
        )


def test_on_the_training_window_the_discrepancy_is_that_of_its_residuals(case):
    train = case[0]
    theta = truth(train)
    theta[-2:] = train.windows[0].observed[0]  # initial temperatures of body and panel
    thetas = np.tile(theta, (300, 1))
    errors = window_errors(train, train.windows[0], thetas, 0)
    temperatures = np.tile(train.windows[0].simulate(theta).temperatures, (300, 1, 1))
    drawn = errors.draw(temperatures, np.random.default_rng(1))
    residual = (train.windows[0].observed - temperatures[0])[:, 1]
    # What the discrepancy takes away of the residuals leaves noise, and without it more than that.
    assert np.nanstd(residual - drawn.mean[0, :, 1]) < 0.3 < 0.5 < np.nanstd(residual)
    np.testing.assert_allclose(drawn.discrepancy.mean(axis=0)[:, 1], drawn.mean[0, :, 1], atol=0.1)
    assert not drawn.mean[..., 0].any()
    memory = 0.2 if train.windows[0].residuals.terms.kinds[0].has_memory else 0.0
    assert drawn.noise.std() == pytest.approx(memory, rel=0.05)


def test_correlated_noise_of_students_t_is_noise_with_a_memory(tmp_path):
    noise = {"model": "ar1", "distribution": "student_t", "degrees_of_freedom": 3.0} | {
        key: NOISE[key] for key in ("standard_deviation", "correlation_time")
    }
    scenario, data = made(tmp_path, discrepancy=None, noise=noise)
    train, window = build_problem(scenario, data), build_window(scenario, data, "test")
    errors = window_errors(train, window, np.tile(truth(train), (200, 1)), FIRST)
    drawn = errors.draw(np.tile(window.observed, (200, 1, 1)), np.random.default_rng(0))
    assert not drawn.white.any()
    said = predict(build_problem(scenario, data), data, "train", {}, np.tile(truth(train), (3, 1)), seed=1)[0].attrs[
        "interval_contains"
    ]
    assert "correlated measurement noise" in said
    late = drawn.noise[:, 60:, 0]
    innovations = (late[:, 1:] - np.exp(-60 / 480) * late[:, :-1]) / np.sqrt(1 - np.exp(-120 / 480)) / 0.2
    assert stats.kstest(innovations.ravel(), stats.t(3.0).cdf).pvalue > 0.01
    # The first samples are what was simulated, and nothing in them is white.
    assert np.abs(drawn.noise[:, :FIRST, 0]).max() < 1e-6


def test_first_samples_are_whitened_by_the_errors_of_their_own_draw_and_channel():
    rng = np.random.default_rng(0)
    columns, noise = rng.normal(size=(2, 4, 3, 5)), rng.uniform(0.1, 0.9, (2, 3))
    factors = np.tril(rng.normal(size=(3, 2, 4, 4))) + 3.0 * np.eye(4)
    by_factor = FirstErrors(np.zeros((2, 4, 3)), factors, np.arange(4)).whiten(columns)
    by_noise = WhiteErrors(noise).whiten(columns)
    for s, k in np.ndindex(2, 3):
        np.testing.assert_allclose(factors[k, s] @ by_factor[s, :, k], columns[s, :, k], atol=1e-12)
        np.testing.assert_allclose(noise[s, k] * by_noise[s, :, k], columns[s, :, k], atol=1e-12)


def test_initial_temperatures_are_less_sure_where_the_first_samples_err_together(tmp_path):
    scenario, data = made(tmp_path)
    train, window = build_problem(scenario, data), build_window(scenario, data, "test")
    first = build_window(scenario, data, "test", span=600.0)
    thetas = np.tile(truth(train), (400, 1))
    errors = window_errors(train, window, thetas, FIRST).at_first()
    apart = FirstErrors(errors.mean, errors.factors * np.eye(FIRST), np.arange(FIRST))
    panel = first.names.index("initial.panel")
    together, alone = (
        condition_initial(first, thetas, law, np.random.default_rng(0))[:, panel].std() for law in (errors, apart)
    )
    assert together > 1.5 * alone


class Apart(Shaped):
    """Noise of a known shape of which that is not known."""

    has_known_shape = False


def test_noise_of_a_known_shape_is_told_by_the_first_samples_as_any_other(tmp_path):
    scenario, data = made(tmp_path, discrepancy=None)
    train, window = build_problem(scenario, data), build_window(scenario, data, "test")
    thetas = np.tile(truth(train), (5, 1))
    temperatures = np.stack([run.temperatures for run in window.simulate_many(thetas)])
    errors, found = window_errors(train, window, thetas, FIRST), []
    numbers = np.random.default_rng(1).uniform(0.05, 0.4, (5, 2, 1))
    for kind in (Shaped, Apart):
        kinds = (kind(480.0, 0.5), kind(0.0, 1.0))
        of_train = errors.train.with_known_shape(kinds, {})
        shaped = replace(errors, train=of_train, numbers=numbers, at_start=np.full((5, 2), 0.3))
        assert set(shaped.alike) == (set() if kind is Apart else {0, 1})
        law, drawn = shaped.at_first(), shaped.draw(temperatures, np.random.default_rng(3))
        found.append((law.factors, drawn.mean, drawn.noise, drawn.white))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-10)
    assert np.abs(found[0][1]).max() > 0.05


def test_of_dense_first_samples_an_even_part_tells(case, monkeypatch):
    _, window, errors, _, simulated = case
    few = errors.only(np.arange(DRAWS) < 2)
    whole = few.at_first()
    monkeypatch.setattr("flightcal.prediction.errors._TELLING", 4)
    fewer = few.only(np.ones(2, bool))
    law = fewer.at_first()
    assert law.telling.tolist() == [0, 3, 7, 10]
    np.testing.assert_array_equal(law.mean, whole.mean)
    for k, s in np.ndindex(2, 2):
        covariance = (whole.factors[k, s] @ whole.factors[k, s].T)[np.ix_(law.telling, law.telling)]
        np.testing.assert_allclose(law.factors[k, s] @ law.factors[k, s].T, covariance, atol=1e-12)
    # As if the others were missing.
    temperatures = np.stack([simulated[-len(window.times) :]] * 2)
    drawn = fewer.draw(temperatures, np.random.default_rng(3))
    monkeypatch.undo()
    masked = window.observed.copy()
    masked[np.setdiff1d(np.arange(FIRST), law.telling)] = np.nan
    expected = replace(few, window=replace(window, observed=masked)).draw(temperatures, np.random.default_rng(3))
    for part in ("mean", "discrepancy", "noise", "white"):
        np.testing.assert_allclose(getattr(drawn, part), getattr(expected, part), atol=1e-9)


def test_the_prediction_says_that_the_discrepancy_carries_over(tmp_path):
    scenario, data = made(tmp_path)
    draws = np.tile(truth(build_problem(scenario, data)), (30, 1))
    train, test = (
        predict(build_problem(scenario, data), data, window, {}, draws, seed=1)[0].attrs for window in ("train", "test")
    )
    assert train["interval_contains"].endswith("and model discrepancy as the residuals of this window show it")
    assert test["interval_contains"].endswith("and model discrepancy as it carries over from the training window")
    assert "correlated measurement noise" in test["interval_contains"]
    assert "model discrepancy" in test["model_interval_contains"]
    assert "noise" not in test["model_interval_contains"]


def test_the_prediction_holds_the_discrepancy_and_what_of_the_residuals_should_be_white(tmp_path):
    scenario, data = made(tmp_path)
    problem = build_problem(scenario, data)
    draws = np.tile(truth(problem), (40, 1))
    prediction, ensemble = predict(build_problem(scenario, data), data, "train", {}, draws, seed=1)
    assert prediction["discrepant"].values.tolist() == [False, True]
    assert prediction["noise"].values.tolist() == ["AR(1) noise", "AR(1) noise"]
    panel = prediction.sel(channel="panel_temp")
    of_errors = ensemble.mean[:, 1] - problem.windows[0].simulate(draws[0]).temperatures[:, 1]
    # The mean has the weights' expected value, the discrepancy is drawn: Monte Carlo error of 40 draws.
    width = (panel["discrepancy_upper"] - panel["discrepancy_lower"]).values / 4
    assert (np.abs(panel["discrepancy_mean"].values - of_errors) < 5 * width / np.sqrt(40) + 1e-6).all()
    assert (panel["discrepancy_lower"] < panel["discrepancy_upper"]).all()
    assert (prediction.sel(channel="body_temp")["discrepancy_mean"] == 0.0).all()
    missing = np.isnan(prediction["observed"])
    np.testing.assert_array_equal(np.isnan(prediction["innovation"]), missing)
    # Of what the mean leaves, not of the temperatures.
    assert np.abs(prediction["innovation"]).max() < 2.0


def test_a_prediction_with_independent_noise_says_nothing_of_innovations(tmp_path):
    scenario, data = small.closed_loop(tmp_path)
    draws = np.tile(build_problem(scenario, data).priors.median(), (10, 1))
    prediction = predict(build_problem(scenario, data), data, "train", {}, draws, seed=1)[0]
    assert not {"noise", "innovation", "discrepancy_mean"} & set(prediction.data_vars)


def test_a_predictions_draws_start_from_first_samples_that_err_as_the_residuals_do(tmp_path, monkeypatch):
    scenario, data = made(tmp_path)
    problem = build_problem(scenario, data)
    given = []

    def noted(first, thetas, errors, rng=None, heat=None):
        given.append((type(errors), rng is None))
        return condition_initial(first, thetas, errors, rng, heat)

    for module in ("predict", "initial"):
        monkeypatch.setattr(sys.modules[f"flightcal.prediction.{module}"], "condition_initial", noted)
    predict(
        build_problem(scenario, data), data, "test", {"truth": truth(problem)}, np.tile(truth(problem), (3, 1)), seed=1
    )
    assert given == [(WhiteErrors, True), (FirstErrors, False)]


def test_a_stand_in_is_asked_once_for_each_window_whose_residuals_count(tmp_path):
    written = made(tmp_path)
    draws = np.tile(truth(build_problem(*written)), (3, 1))
    asked = []

    def stand_in(window):
        asked.append(window.name)
        return window

    for window, expected in (("train", ["train"]), ("test", ["test", "train"])):
        asked.clear()
        predict(build_problem(*written), written[1], window, {}, draws, seed=1, stand_in=stand_in)
        assert asked == expected


def test_innovations_are_those_of_the_draws_median_numbers(tmp_path, monkeypatch):
    train, window, pair = of_pairs(tmp_path)
    scenario, data = window.scenario, made(tmp_path, discrepancy=None)[1]
    given = []

    def noted(model, residual, seconds, numbers, rng):
        given.append(numbers)
        return residual

    monkeypatch.setattr(sys.modules["flightcal.prediction.predict"], "innovations", noted)
    predict(build_problem(scenario, data), data, "train", {}, pair[[0, 1, 1, 1]], seed=1)
    np.testing.assert_allclose(given[0], train.windows[0].numbers(pair[1]))
