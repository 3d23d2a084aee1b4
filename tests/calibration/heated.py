"""Telemetry that was made with heat that the scenario does not describe."""

import numpy as np
from scipy import stats

from flightcal.calibration.heat_point import draw_sizes, spread_sizes
from flightcal.problem import build_problem
from flightcal.scenario import HalfStudentT
from flightcal.simulator import network_simulator
from tests import small

HOURS = 6
PATTERN = (0.5, 0.8, -0.6)
"""W: constant, and cosine and sine of the orbit."""
PROCESS, WHITE, TIME = 0.12, 0.05, 500.0
"""Of the body's noise: K, K and s; the panel's is 0.1 K and independent."""
NODES = ("body", "panel")
TRUE = small.TRUTH | {"initial.body": 285.0, "initial.panel": small.TRUTH["initial_panel"]}


def written(*, heaters=True, windows=1):
    content = small.content() | {"heat": {"pattern": {"harmonics": 2}}}
    content["noise"] = {
        "model": "ar1",
        "standard_deviation": {"half_normal": "1 K"},
        "white": {"half_normal": "0.5 K"},
        "correlation_time": {"lognormal": {"median": "5 min", "factor": 2}},
    }
    content["windows"] = {"train": {"start": "2024-03-01T00:00:00", "end": f"2024-03-01T{HOURS:02d}:00:00"}}
    if windows == 2:
        content["windows"] = {
            "train": {
                "first": {"start": "2024-03-01T00:00:00", "end": "2024-03-01T03:00:00"},
                "second": {"start": "2024-03-01T03:30:00", "end": "2024-03-01T06:00:00"},
            }
        }
    if not heaters:
        del content["simulator"]["heaters"], content["observations"]["heater_status"], content["parameters"]["power"]
    return content


def pattern(seconds):
    angle = 2.0 * np.pi * seconds / small.PERIOD
    return PATTERN[0] + PATTERN[1] * np.cos(angle) + PATTERN[2] * np.sin(angle)


def drift(seconds):
    return 0.8 * np.sin(2.0 * np.pi * seconds / (3.3 * small.PERIOD))


def problem_of(folder, content, seed=0, unseen=(), **heat):
    """With telemetry of the scenario's own model at `TRUE`, and heat (W, of seconds) into nodes by name.

    unseen: minutes without a status.
    """
    scenario, data = small.load(folder, content)
    times, rng = data["time"].values, np.random.default_rng(seed)
    period = small.period_of(scenario)
    simulator = network_simulator(scenario, data, times[0], times[-1], times, period=period, heated=NODES)
    ends = np.stack([simulator.drive.times[:-1], simulator.drive.times[1:]], axis=1).ravel()
    watts = np.stack([heat[name](ends) if name in heat else np.zeros(len(ends)) for name in NODES])
    run = simulator.with_heat(watts).simulate(small.theta_of(simulator, **small.TRUTH))
    apart = 60.0 * np.abs(np.subtract.outer(np.arange(len(times)), np.arange(len(times))))
    process = np.linalg.cholesky(PROCESS**2 * np.exp(-apart / TIME)) @ rng.standard_normal(len(times))
    noise = {"body_temp": process + WHITE * rng.standard_normal(len(times))}
    noise["panel_temp"] = 0.1 * rng.standard_normal(len(times))
    for k, channel in enumerate(simulator.channels):
        data[channel].values[:] = run.temperatures[:, k] + noise[channel]
    if len(simulator.heaters):
        data["heater_status"].values[:] = run.status[:, 0]
        data["heater_status"].values[list(unseen)] = np.nan
    return build_problem(scenario, data)


def sizes_of(point):
    return np.array([point.sizes[name] for name in point.around.sizes.names])


def spread_draws(started, chains, draws, rng):
    """theta [chains, draws, d] of the problem with heat: normal draws around what was found, at sizes of their own."""
    problem, point, heated, _, known = started
    mean, factor = point.around.of_z(sizes_of(point))
    order = [known.names.index(problem.names[k]) for k in point.around.moving]
    z = np.zeros((chains, draws, len(known.names)))
    z[..., order] = mean + rng.standard_normal((chains, draws, len(mean))) @ factor.T
    return spread_sizes(problem, heated, point, known, z, draw_sizes(point, rng), rng)


def errors(problem, point):
    """Of the parameters and initial temperatures, in their deviations, by name."""
    mean, factor = point.around.of_z(sizes_of(point))
    names = [problem.names[k] for k in point.around.moving]
    known = dict(zip(problem.names, problem.priors.median(), strict=True)) | TRUE
    true = problem.to_z(np.array([known[name] for name in problem.names]))[point.around.moving]
    return dict(zip(names, (mean - true) / np.sqrt((factor**2).sum(axis=1)), strict=True))


CASES = {"open loop": written(), "without heaters": written(heaters=False)}


def below(prior, size):
    """Probability below a size."""
    if isinstance(prior, HalfStudentT):
        return 2.0 * stats.t.cdf(size / prior.scale, prior.degrees_of_freedom) - 1.0
    return stats.halfnorm.cdf(size / prior.scale)


def scores(around, sizes):
    """Normal scores [free] of those of the sizes [s] that are free."""
    return np.array([stats.norm.ppf(below(around.sizes.priors[k], sizes[k])) for k in around.free])
