"""Whether the stochastic update tells the truth about data that its own model made: the intervals' coverage.

theta is drawn from the prior anew in each repeat, so that intervals of any probability cover it at exactly that rate.
"""

import numpy as np
import pytest

from flightcal.calibration import build_problem, calibrate_nuts
from flightcal.prediction import predict
from flightcal.scenario import NutsSettings
from flightcal.validation import score
from tests import small

REPEATS = 40
NUTS = NutsSettings(chains=2, draws=300, warmup=200)


def repeat(folder, seed):
    """Ranks of the true parameters among the draws [d], and PICP on train and test."""
    rng = np.random.default_rng(seed)
    scenario, placeholder = small.load(folder)
    priors = build_problem(scenario, placeholder).priors
    parameters = [name for name in priors.names if name in scenario.parameters]
    drawn = priors.sample(rng, 1)[0]
    truth = {name: drawn[priors.names.index(name)] for name in parameters}
    noise = 0.1
    data = small.telemetry_of(scenario, placeholder, noise=noise, seed=seed, **truth)
    problem = build_problem(scenario, data)
    posterior = calibrate_nuts(problem, NUTS, seed)
    ranks = [(posterior.flat[:, problem.names.index(name)] < truth[name]).mean() for name in parameters]
    ranks.append((posterior.flat[:, problem.names.index("noise.body_temp")] < noise).mean())
    picp = []
    for window in ("train", "test"):
        prediction, _ = predict(scenario, data, window, {}, posterior.flat, seed=seed)
        picp += [
            metric.value
            for metric in score(prediction, window)
            if metric.metric == "picp" and metric.channel == "all" and metric.method == "stochastic"
        ]
    return ranks, picp


def covered(ranks, probability):
    return np.abs(ranks - 0.5) < 0.5 * probability


@pytest.mark.slow
def test_intervals_cover_the_truth_at_their_nominal_rate(tmp_path):
    results = [repeat(tmp_path, seed) for seed in range(REPEATS)]
    ranks, picp = (np.array(part) for part in zip(*results, strict=True))
    print("ranks", ranks.round(3).tolist(), "picp", picp.mean(axis=0), picp.std(axis=0))
    for probability in (0.5, 0.8, 0.95):
        # As if all parameters of a repeat were covered together: the widest error that the mean can have.
        error = np.sqrt(probability * (1 - probability) / REPEATS)
        assert abs(covered(ranks, probability).mean() - probability) < 3 * error, probability
    # The draws are not telemetry's own, and 600 of them leave quantiles uncertain by about half a percent.
    monte_carlo = 3 * picp.std(axis=0, ddof=1) / np.sqrt(REPEATS) + 0.005
    assert (np.abs(picp.mean(axis=0) - 0.95) < monte_carlo).all()
