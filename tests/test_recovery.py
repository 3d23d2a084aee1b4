"""Whether the stochastic update tells the truth about data that its own model made: ranks, and the intervals' coverage.

theta is drawn from the prior anew in each repeat, so that intervals of any probability cover it at exactly that rate.
"""

import numpy as np
import pytest

from flightcal.calibration import calibrate_nuts
from flightcal.prediction import predict, score
from flightcal.problem import build_problem
from flightcal.problem.synthetic import simulate_telemetry
from flightcal.scenario import NutsSettings
from flightcal.validation import repeats
from flightcal.validation.simulation_based import check_ranks
from tests import small

REPEATS = 40
NUTS = NutsSettings(chains=2, draws=300, warmup=200)


def ranked(folder, count):
    """Checks of the ranks by quantity."""
    scenario, data = small.closed_loop(folder)
    problem = build_problem(scenario, data)
    found = [repeats.run_repeat(problem, data, NUTS, [11, k]) for k in range(count)]
    names = (*problem.names, "log density")
    checks = check_ranks(names, found, np.full(len(names), np.nan))
    print([(check.name, check.p_value, check.coverage) for check in checks])
    return {check.name: check for check in checks}


@pytest.mark.slow
def test_ranks_of_what_made_the_telemetry_are_uniform(tmp_path):
    assert all(check.inside for check in ranked(tmp_path, REPEATS).values())


@pytest.mark.slow
def test_telemetry_with_twice_the_noise_that_the_likelihood_takes_it_for_is_found(tmp_path, monkeypatch):
    def noisier(problem, theta, rng):
        ((observed, status),) = simulate_telemetry(problem, theta, rng)
        simulated = problem.windows[0].simulate(theta).temperatures
        return [(simulated + 2.0 * (observed - simulated), status)]

    monkeypatch.setattr(repeats, "simulate_telemetry", noisier)
    checks = ranked(tmp_path, 20)
    # The panel's noise is known to the likelihood, that of the body is inferred: too large.
    assert not checks["noise.body_temp"].inside
    assert not checks["log density"].inside


def coverage(folder, seed):
    """PICP on train and test."""
    rng = np.random.default_rng(seed)
    scenario, placeholder = small.load(folder)
    priors = build_problem(scenario, placeholder).priors
    drawn = priors.sample(rng, 1)[0]
    truth = {name: drawn[priors.names.index(name)] for name in scenario.parameters}
    data = small.telemetry_of(scenario, placeholder, noise=0.1, seed=seed, **truth)
    posterior = calibrate_nuts(build_problem(scenario, data), NUTS, seed)
    predicted = {
        w: predict(build_problem(scenario, data), data, w, {}, posterior.flat, seed=seed)[0] for w in ("train", "test")
    }
    return [
        metric.value
        for window, prediction in predicted.items()
        for metric in score(prediction, window)
        if metric.metric == "picp" and metric.channel == "all" and metric.method == "stochastic"
    ]


@pytest.mark.slow
def test_predictions_cover_telemetry_at_their_nominal_rate(tmp_path):
    picp = np.array([coverage(tmp_path, seed) for seed in range(REPEATS)])
    # The draws are not telemetry's own, and 600 of them leave quantiles uncertain by about half a percent.
    monte_carlo = 3 * picp.std(axis=0, ddof=1) / np.sqrt(REPEATS) + 0.005
    assert (np.abs(picp.mean(axis=0) - 0.95) < monte_carlo).all()
