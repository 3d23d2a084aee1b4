"""What heater status in the likelihood is worth, and whether the intervals with it still tell the truth.

Temperatures come every five minutes with 0.3 K of noise, the heater's status every minute; its switches are off the
simulated times by errors of timing. All of theta is drawn from the prior anew in each repeat.
"""

from dataclasses import replace

import numpy as np
import pytest

from flightcal.calibration import calibrate_nuts
from flightcal.problem import build_problem
from flightcal.scenario import NutsSettings
from tests import small

REPEATS = 24
NUTS = NutsSettings(chains=2, draws=250, warmup=200)
OF_THE_HEATER = ("power", "on_below", "off_above")
NOISE = 0.3  # K
EVERY = 5  # minutes


def written():
    content = small.content()
    for name, centre in (("on_below", "10 degC"), ("off_above", "13 degC")):
        prior = {"normal": {"mean": centre, "standard_deviation": "0.5 K"}}
        content["parameters"][name] = {"sets": f"heaters.heater.{name}", "prior": prior}
    for channel in ("body_temp", "panel_temp"):
        content["observations"][channel]["noise"] = f"{NOISE} K"
    content["observations"]["heater_status"]["likelihood"] = {"switch_times": {}}
    return content


def telemetry(scenario, placeholder, truth, rng):
    """Telemetry at `truth`, with errors of timing in the status, and few temperatures."""
    values = {name: truth[name] for name in scenario.parameters}
    data = small.telemetry_of(scenario, placeholder, noise=NOISE, seed=int(rng.integers(2**31)), **values)
    simulator = small.simulator_of(scenario, data)
    switches = simulator.simulate(small.theta_of(simulator, **small.TRUTH | values)).switches
    errors = truth["timing.heater_status"] * rng.standard_normal(len(switches.time))
    happened = np.maximum.accumulate(switches.time + errors)
    seconds = (data["time"].values - data["time"].values[0]) / np.timedelta64(1, "s")
    count = np.searchsorted(happened, seconds, side="right")
    data["heater_status"].values[:] = (count + 1 - switches.on[0]) % 2
    for channel in ("body_temp", "panel_temp"):
        data[channel].values[np.arange(len(seconds)) % EVERY > 0] = np.nan
    return data


def deaf(problem):
    """The problem without what its heaters' status says."""
    return replace(problem, windows=tuple(replace(window, heater_status=None) for window in problem.windows))


def repeat(folder, seed):
    """Ranks of the truth among the draws and standard deviations of these, of each parameter, with and without."""
    rng = np.random.default_rng(seed)
    scenario, placeholder = small.load(folder, written())
    priors = build_problem(scenario, placeholder).priors
    truth = dict(zip(priors.names, priors.sample(rng, 1)[0], strict=True))
    problem = build_problem(scenario, telemetry(scenario, placeholder, truth, rng))
    without = replace(deaf(problem), open_loop=deaf(problem.open_loop))
    names = [*scenario.parameters, "timing.heater_status"]
    found = []
    for case in (problem, without):
        posterior = calibrate_nuts(case, NUTS, seed, random_starts=3)
        draws = posterior.flat[:, [problem.names.index(name) for name in names]]
        ranks = (draws < [truth[name] for name in names]).mean(axis=0)
        found.append((ranks, draws.std(axis=0)))
    return names, found


@pytest.mark.slow
def test_status_narrows_what_is_known_of_the_heater_and_its_intervals_cover(tmp_path):
    results = [repeat(tmp_path, seed) for seed in range(REPEATS)]
    names = results[0][0]
    ranks = np.array([found[0][0] for _, found in results])
    ratios = np.array([found[0][1] / found[1][1] for _, found in results])
    factors = dict(zip(names, np.exp(np.log(ratios).mean(axis=0)).round(3), strict=True))
    covered = {p: (np.abs(ranks - 0.5) < 0.5 * p).mean(axis=0) for p in (0.5, 0.8, 0.95)}
    said = f"standard deviations with status / without: {factors}; covered: {covered}; ranks {ranks.round(2).tolist()}"
    print(said)
    for name in OF_THE_HEATER:
        assert factors[name] < {"power": 0.75}.get(name, 0.95), said
    for probability, share in covered.items():
        # As if all parameters of a repeat were covered together: the widest error that the mean can have.
        error = np.sqrt(probability * (1 - probability) / REPEATS)
        assert abs(share.mean() - probability) < 3 * error, said
