"""What a model of the residuals adds to the log density's gradient."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from flightcal.calibration.find_heat import find_heat
from flightcal.calibration.heat_point import start_with_heat
from flightcal.problem.heat import at_sizes

from ..problem import TRUTH, content, make_problem
from ..report import Section, Table
from ..timing import interleaved, ratio_text, ratios

FUNCTIONS = 40
_AR1 = {"noise": {"model": "ar1", "white": {"half_normal": "0.1 K"}}}
_PHASE = {"discrepancy": {"phase": {"harmonics": FUNCTIONS // 2}}}
MODELS: dict[str, dict[str, Any]] = {
    "independent noise": {"noise": {"model": "iid"}},
    f"discrepancy in orbit phase, {FUNCTIONS // 2} harmonics": _PHASE,
    "AR(1) noise and white noise": _AR1,
    "discrepancy in orbit phase, AR(1) and white noise": _PHASE | _AR1,
}
HEAT = "unmodelled heat, AR(1) and white noise"
"""Over two orbits alone: its weights grow with the time, and to find their sizes takes minutes in twenty."""
ORBITS = (2, 20)


def measure(quick: bool) -> Section:
    """The table."""
    columns, cells, weights = [], [], 0
    names = [*MODELS, HEAT]
    for orbits in ORBITS:
        problems = {name: _problem(orbits, blocks) for name, blocks in MODELS.items()}
        if orbits == ORBITS[0]:
            problems[HEAT] = _with_heat(orbits)
            weights = len(problems[HEAT][0].heat.centre)
        calls = {name: lambda p=p, z=z: p.log_density_and_gradient(z) for name, (p, z) in problems.items()}
        timings = interleaved(calls, 5 if quick else 41, budget=15 if quick else 60)
        relative = ratios(timings, names[0])
        times, channels = problems[names[0]][0].windows[0].observed.shape
        columns += [f"T = {times:,}", "over independent noise"]
        cells += [
            [str(timings[name]) if name in timings else "" for name in names],
            [ratio_text(relative[name]) if name in timings else "" for name in names],
        ]
    flown = " and ".join(map(str, ORBITS))
    rows = [[name, *row] for name, row in zip(names, zip(*cells, strict=True), strict=True)]
    return Section(
        "Models of the residuals",
        f"The same satellite; each of its {channels} channels has T samples ({flown} orbits), and each has the model.",
        [Table(["", *columns], rows)],
        [
            f"The {FUNCTIONS} weights of each channel are integrated out in closed form; noise levels, correlation "
            "times, amplitudes and lengthscales are inferred.",
            f"Heat has {weights} weights in {ORBITS[0]} orbits. They are integrated out too, at the most probable "
            "sizes of noise and heat, as the sampler does; the heater is open there, as its status was measured.",
            "With AR(1) noise the products of the functions with one another hang on the correlation time, so they "
            "are made anew at each call.",
        ],
    )


def _problem(orbits: int, blocks: dict[str, Any]) -> tuple[Any, Any]:
    written = content() | blocks
    written["windows"] = {"train": {"start": written["windows"]["train"]["start"], "orbits": orbits}}
    for observed in written["observations"].values():
        observed.pop("noise", None)
    with tempfile.TemporaryDirectory() as folder:
        problem, theta = make_problem(written, TRUTH, Path(folder))
    z = problem.to_z(theta)
    value, gradient = problem.log_density_and_gradient(z)
    if not (np.isfinite(value) and np.isfinite(gradient).all()):
        raise AssertionError(f"{blocks}: the log density is not finite")
    return problem, z


def _with_heat(orbits: int) -> tuple[Any, Any]:
    problem, z = _problem(orbits, {"heat": {}})
    heated, z = start_with_heat(problem, find_heat(problem, problem.to_theta(z[None])[0]))
    known = at_sizes(heated, heated.to_theta(z))
    return known, np.array([z[heated.names.index(name)] for name in known.names])
