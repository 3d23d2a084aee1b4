"""The certificate of a reduced model: its error on held-out runs, its speed, and the error model that follows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from time import perf_counter
from typing import Any

import numpy as np

from ..operational import fly
from ..scenario import SimulatorError
from ..simulator import FloatArray
from .candidate import simulator_on, theta_of
from .error_model import estimate, left_out
from .file import Task
from .full_order import SAMPLING, window_simulator
from .reduce import Reduced

_TIMED_RUNS = 20


@dataclass(frozen=True)
class Speed:
    """Seconds that one simulation of a window takes, measured side by side in one run."""

    window: str
    simulated_seconds: float
    reduced: float
    full_network: float
    """The compiled full network, thermostats at their crossings."""
    operational: float
    """The operational simulator, on-board software in the loop."""
    steps: int
    """Of the reduced model."""


def measure_speed(task: Task, reduced: Reduced) -> Speed:
    """Time the reduced model, the compiled full network and the operational simulator on the first held-out window."""
    run = reduced.runs[0]
    seconds = float((run.end - run.start) / np.timedelta64(1, "s"))
    small, small_theta = simulator_on(task, reduced.model, run), theta_of(reduced.model, run, 0)
    large, _ = window_simulator(run.scenario, run.start, run.end, task.period)
    large_theta = np.concatenate([run.parameters[0], run.temperatures[0, 0, large.network.diffusive]])
    craft = task.mission.spacecraft
    fly(craft, run.start, 2.0 * craft.software.period)  # compiled, if it was not
    small.simulate(small_theta)
    large.simulate(large_theta)
    times: dict[str, list[float]] = {"small": [], "large": [], "flown": []}
    for _ in range(2):
        times["flown"].append(_seconds(lambda: fly(craft, run.start, seconds)))
        times["large"].append(_seconds(lambda: large.simulate(large_theta)))
        times["small"] += [_seconds(lambda: small.simulate(small_theta)) for _ in range(_TIMED_RUNS)]
    middle = {name: float(np.median(values)) for name, values in times.items()}
    return Speed(run.window, seconds, middle["small"], middle["large"], middle["flown"], len(small.drive.times) - 1)


def certificate(task: Task, reduced: Reduced, speed: Speed) -> dict[str, Any]:
    """The certificate as plain values for JSON: kelvin, seconds, shares."""
    channels, heaters = tuple(task.scenario.observations), tuple(task.scenario.network.switches)
    reduction = task.reduction
    absolute = np.concatenate([np.abs(item.temperatures).reshape(-1, len(channels)) for item in reduced.held_out])
    duty = np.concatenate([np.abs(item.duty) for item in reduced.held_out])
    failed = sum(item.failed for item in reduced.held_out)
    overall = _statistics(absolute, reduction.quantile)
    seconds = (reduced.runs[0].times - reduced.runs[0].times[0]) / np.timedelta64(1, "s")
    model = sensor_errors(task, reduced)
    return {
        "name": reduction.name,
        "method": reduction.method,
        "states": len(reduced.model.states),
        "massless": reduced.model.massless,
        "nodes_of_full_network": len(reduced.runs[0].nodes),
        "tolerance_K": reduction.tolerance,
        "quantile": reduction.quantile,
        "within_tolerance": bool(overall["quantile_K"] <= reduction.tolerance and failed == 0),
        "parameters": list(task.scenario.parameters),
        "tried": [
            {"states": t.states, "massless": t.massless, "training_error_K": _finite(t.error)} for t in reduced.tried
        ],
        "held_out": {
            "runs": int(sum(len(item.temperatures) for item in reduced.held_out)),
            "failed": failed,
            "all": overall,
            "windows": {
                item.window: _statistics(np.abs(item.temperatures).reshape(-1, len(channels)), reduction.quantile)
                for item in reduced.held_out
            },
            "sensors": {name: _statistics(absolute[:, k], reduction.quantile) for k, name in enumerate(channels)},
            "duty": {name: _statistics(duty[:, k], reduction.quantile, "") for k, name in enumerate(heaters)},
        },
        "error_model": {
            name: {
                "offset_K": item.offset,
                "deviation_K": item.deviation,
                "correlation_time_s": item.correlation_time,
                "variance_left_out": left_out(item, seconds),
            }
            for name, item in model.items()
        },
        "speed": {
            **asdict(speed),
            "times_faster_than_operational": speed.operational / speed.reduced,
            "times_faster_than_full_network": speed.full_network / speed.reduced,
        },
        "left_out": list(task.notes),
    }


def sensor_errors(task: Task, reduced: Reduced) -> dict[str, SimulatorError]:
    """The error model that the likelihood uses, from the held-out runs."""
    return estimate(reduced.held_out, tuple(task.scenario.observations), SAMPLING)


def certificate_lines(content: Mapping[str, Any]) -> list[str]:
    """The certificate as a table to read."""
    share = f"{content['quantile']:.0%}"
    held_out, speed = content["held_out"], content["speed"]
    lines = [
        f"{content['method']}: {content['states']} states and {content['massless']} massless ones for "
        f"{content['nodes_of_full_network']} nodes",
        f"error on {held_out['runs']} held-out runs, K ({held_out['failed']} failed)",
        f"  {'sensor':<28}{'mean':>9}{share:>9}{'worst':>9}",
    ]
    rows = {**held_out["sensors"], "all": held_out["all"]}
    lines += [
        f"  {name:<28}{row['mean_K']:>9.3f}{row['quantile_K']:>9.3f}{row['worst_K']:>9.3f}"
        for name, row in rows.items()
    ]
    lines += ["error of heaters' duty, percentage points", f"  {'heater':<28}{'mean':>9}{share:>9}{'worst':>9}"]
    lines += [
        f"  {name:<28}{100 * row['mean']:>9.2f}{100 * row['quantile']:>9.2f}{100 * row['worst']:>9.2f}"
        for name, row in held_out["duty"].items()
    ]
    lines += [
        f"one simulation of {speed['simulated_seconds']:.0f} s: {1e3 * speed['reduced']:.2f} ms; "
        f"{speed['times_faster_than_operational']:.0f} times faster than the operational simulator, "
        f"{speed['times_faster_than_full_network']:.0f} times than the compiled full network",
        *(f"left out: {note}" for note in content["left_out"]),
    ]
    verdict = "kept" if content["within_tolerance"] else "NOT kept"
    return [*lines, f"tolerance of {content['tolerance_K']:g} K for {share} of the errors: {verdict}"]


def _statistics(absolute: FloatArray, quantile: float, unit: str = "_K") -> dict[str, float]:
    names = (f"mean{unit}", f"quantile{unit}", f"worst{unit}")
    if not absolute.size:
        return dict.fromkeys(names, math.inf)
    found = (absolute.mean(), np.quantile(absolute, quantile), absolute.max())
    return dict(zip(names, map(float, found), strict=True))


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _seconds(task: Any) -> float:
    begin = perf_counter()
    task()
    return perf_counter() - begin
