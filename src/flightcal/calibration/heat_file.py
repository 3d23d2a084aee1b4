"""Unmodelled heat as a run keeps it, beside the posterior: what its weights are of, and around what they are linear."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import xarray

from ..errors import RunError
from ..problem import HeatModel, Problem, with_heat
from ..run import plain, typed
from ..simulator import FloatArray

HEAT_GROUP = "heat"


def heat_dataset(model: HeatModel, names: tuple[str, ...], theta: FloatArray) -> xarray.Dataset:
    """A model and the point theta [d], of a problem without heat, around which windows were linearised."""
    functions = [len(directions) for directions in model.kept]
    content = plain(model) | {"functions": functions, "point": dict(zip(names, theta.tolist(), strict=True))}
    return xarray.Dataset({"model": ((), json.dumps(content))})


def heat_content(posterior: xarray.DataTree) -> dict[str, Any] | None:
    """What unmodelled heat is made of, as a posterior keeps it; None without any."""
    if HEAT_GROUP not in posterior.children:
        return None
    content: dict[str, Any] = json.loads(str(posterior[HEAT_GROUP]["model"].item()))
    return content


def with_kept_heat(problem: Problem, posterior: xarray.DataTree) -> Problem:
    """The problem that a posterior is of: where it was calibrated with unmodelled heat, with that.

    Raises RunError where an earlier flightcal made it.
    """
    content = heat_content(posterior)
    if content is None or problem.heat is not None:
        return problem
    theta = np.array([content["point"][name] for name in problem.names])
    return with_heat(problem, _model(content), theta)


def _model(content: Mapping[str, Any]) -> HeatModel:
    if "of_pattern" not in content or any("on" not in record for record in content["held"]):
        raise RunError(
            "posterior: found unmodelled heat as an earlier flightcal wrote it, expected that of this version; "
            "calibrate again into a new folder"
        )
    kept = zip(content["kept"], content["functions"], strict=True)
    # A list does not tell of how many functions nothing is kept.
    return replace(
        typed(HeatModel, content),
        kept=tuple(np.array(directions, float).reshape(count, -1) for directions, count in kept),
    )
