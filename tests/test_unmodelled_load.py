"""A load of 1 W that the simulator knows nothing of: what it does to parameters, and which residual models bear it.

It comes and goes on the panel within some hours. Heaters are driven by their measured status: in closed loop such a
load also shifts the times at which the thermostat switches, and no noise describes that.
"""

import numpy as np
import pytest

from flightcal.calibration import calibrate_nuts
from flightcal.problem import build_problem
from flightcal.scenario import NutsSettings
from tests import small

REPEATS = 10
NUTS = NutsSettings(chains=2, draws=200, warmup=200)
HOURS = 6
RESIDUALS = {
    "iid": {},
    "ar1": {
        "noise": {
            "model": "ar1",
            "white": {"half_normal": "0.3 K"},
            "correlation_time": {"lognormal": {"median": "60 min", "factor": 2}},
        }
    },
}


def written(**more):
    content = small.content() | more
    content["windows"] = {"train": {"start": "2024-03-01T00:00:00", "end": f"2024-03-01T{HOURS:02d}:00:00"}}
    # Its values are not the column's: `telemetry` writes them.
    content["telemetry"]["channels"]["unmodelled"] = {"column": "sun", "unit": "A", "kind": "driver"}
    content["observations"]["panel_temp"].pop("noise")
    content["simulator"]["heater_input"] = "measured"
    return content


def telemetry(folder, rng, truth):
    """Telemetry of a satellite with the load, thermostats acting."""
    made = written()
    made["simulator"]["heater_input"] = "simulated"
    made["simulator"]["loads"]["unmodelled"] = {"node": "panel", "driver": "unmodelled", "coefficient": "1 W/A"}
    scenario, data = small.load(folder, made)
    hours = (data["time"].values - data["time"].values[0]) / np.timedelta64(1, "h")
    period, phase = rng.uniform(0.5 * HOURS, HOURS), rng.uniform(0.0, 2.0 * np.pi)
    data["unmodelled"].values[:] = np.sin(2.0 * np.pi * hours / period + phase)
    return small.telemetry_of(scenario, data, seed=int(rng.integers(2**31)), **truth)


def repeat(folder, seed):
    """Of each residual model and parameter, [2, 3]: errors in standard deviations, and whether the truth is inside."""
    rng = np.random.default_rng(seed)
    scenario, placeholder = small.load(folder, written())
    priors = build_problem(scenario, placeholder).priors
    drawn = dict(zip(priors.names, priors.sample(rng, 1)[0], strict=True))
    truth = {name: drawn[name] for name in scenario.parameters}
    data = telemetry(folder, rng, truth)
    errors, inside = [], []
    for more in RESIDUALS.values():
        problem = build_problem(small.load(folder, written(**more))[0], data)
        draws = calibrate_nuts(problem, NUTS, seed, random_starts=3).flat
        draws = draws[:, [problem.names.index(name) for name in truth]]
        lower, upper = np.quantile(draws, [0.025, 0.975], axis=0)
        true = np.array(list(truth.values()))
        errors.append((draws.mean(axis=0) - true) / draws.std(axis=0))
        inside.append((lower <= true) & (true <= upper))
    return np.array(errors), np.array(inside)


@pytest.mark.slow
def test_correlated_noise_keeps_the_truth_inside_where_independent_noise_loses_it(tmp_path):
    found = [repeat(tmp_path, seed) for seed in range(REPEATS)]
    errors, inside = (np.array(part) for part in zip(*found, strict=True))
    shares = dict(zip(RESIDUALS, inside.mean(axis=(0, 2)).round(3).tolist(), strict=True))
    typical = dict(zip(RESIDUALS, np.sqrt((errors**2).mean(axis=(0, 2))).round(2).tolist(), strict=True))
    # As if the parameters of a repeat were inside together: the widest error that a share can have.
    tolerance = np.sqrt(0.9 * 0.1 / REPEATS)
    said = f"share inside 95%: {shares}, tolerance {tolerance:.3f}; errors in standard deviations: {typical}"
    print(said)
    assert shares["ar1"] >= 0.9, said
    assert shares["iid"] < 0.9 - 4.0 * tolerance, said
