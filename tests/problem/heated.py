"""Problems with unmodelled heat."""

from dataclasses import replace

import numpy as np

from flightcal.probability import Shaped
from flightcal.problem import build_problem, heat_model, held_by, hold, sampled_windows, unit_heats, with_heat
from tests import small

HARMONICS = 2
SHAPES = (Shaped(480.0, 0.3), Shaped(0.0, 1.0))


def written(*, heaters=True, windows=2, **more):
    """Windows to train on, of one orbit and of less; with heat."""
    content = small.content() | {"heat": {"pattern": {"harmonics": HARMONICS}}} | more
    content["noise"] = {"model": "ar1", "correlation_time": "8 min", "white": "0.05 K"}
    spans = {
        "first": {"start": "2024-03-01T00:00:00", "end": "2024-03-01T01:30:00"},
        "second": {"start": "2024-03-01T02:30:00", "end": "2024-03-01T03:40:00"},
    }
    content["windows"] = {"train": dict(list(spans.items())[:windows])}
    if not heaters:
        del content["simulator"]["heaters"], content["observations"]["heater_status"], content["parameters"]["power"]
    return content


def problem_of(folder, content=None):
    scenario, data = small.closed_loop(folder, content or written())
    # A status that is not seen all the time.
    if "heater_status" in data:
        data["heater_status"].values[60:63] = np.nan
    return build_problem(scenario, data)


def model_of(problem):
    windows = sampled_windows(problem)
    theta = problem.at(windows[0], problem.priors.median()[None])[0]
    return heat_model(problem.scenario, problem.scenario.heat, windows, theta)


def looked_at(model, windows):
    """A model of which some directions of each group are kept, and heat at the centre."""
    rng = np.random.default_rng(0)
    counts = np.max(
        [[len(group_units.node) for group_units in unit_heats(model, window)] for window in windows], axis=0
    )
    kept = []
    for count in counts:
        directions = np.linalg.qr(rng.normal(size=(count, count)))[0]
        kept.append(directions[:, : count - count // 4])
    # What errors of the simulator are is linear everywhere, so they are not at the centre.
    sizes = [0.0 if g.part == "error" else g.size for g in model.groups]
    scales = np.repeat(sizes, [basis.shape[1] for basis in kept])
    return replace(model, kept=tuple(kept), centre=0.5 * scales * rng.normal(size=len(scales)), shapes=SHAPES)


TRUE = {"noise.body_temp": 0.1} | small.TRUTH


def middle(problem):
    """theta [d] of a problem without heat."""
    known = dict(zip(problem.names, problem.priors.median(), strict=True)) | TRUE
    return np.array([known[name] for name in problem.names])


def with_some_heat(problem):
    """A problem, and the same with heat."""
    model, theta = model_of(problem), middle(problem)
    windows = sampled_windows(problem)
    found = [held_by(window, problem.at(window, theta[None])[0]) for window in windows]
    model = replace(model, held=tuple(held for held in found if held is not None))
    windows = [window if held is None else hold(window, held) for window, held in zip(windows, found, strict=True)]
    return problem, with_heat(problem, looked_at(model, windows), theta)


def in_place_of_another(problem):
    """The same problem, whose simulator stands in for another: the shapes of its error are of one channel each."""

    def erring(window):
        samples = len(window.times)
        basis, wave = np.zeros((samples, 2, 3)), np.linspace(0.0, 6.0, samples)
        basis[:, 0, 0], basis[:, 0, 1], basis[:, 1, 2] = 1.0, np.sin(wave), np.cos(wave)
        simulator = replace(window.simulator, error_basis=basis, error_variance=np.array([0.2, 0.1, 0.05]) ** 2)
        return replace(window, simulator=simulator)

    return replace(problem, windows=tuple(map(erring, problem.windows)))


def by_group(model, units, part):
    return [group_units for group, group_units in zip(model.groups, units, strict=True) if group.part == part]
