"""Unmodelled heat as a run keeps it, beside the posterior: what its weights are of, and around what they are linear."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray

from ..errors import RunError
from ..probability import Profile, Shaped, Slow
from ..problem import Followed, Gain, Group, HeatModel, Held, Problem, with_heat
from ..run import plain
from ..simulator import FloatArray

HEAT_GROUP = "heat"


def heat_dataset(model: HeatModel, names: tuple[str, ...], theta: FloatArray) -> xarray.Dataset:
    """A model and the point theta [d], of a problem without heat, around which windows were linearised."""
    functions = [len(own) for own in model.kept]
    content = plain(model) | {"functions": functions, "point": dict(zip(names, theta.tolist(), strict=True))}
    return xarray.Dataset({"model": ((), json.dumps(content))})


def with_kept_heat(problem: Problem, posterior: xarray.DataTree) -> Problem:
    """The problem that a posterior is of: where it was calibrated with unmodelled heat, with that.

    Raises RunError where an earlier flightcal made it.
    """
    if HEAT_GROUP not in posterior.children or problem.heat is not None:
        return problem
    content = json.loads(str(posterior[HEAT_GROUP]["model"].item()))
    theta = np.array([content["point"][name] for name in problem.names])
    return with_heat(problem, _model(content), theta)


def _model(content: Mapping[str, Any]) -> HeatModel:
    if "of_pattern" not in content:
        raise RunError(
            "posterior: found unmodelled heat of an earlier flightcal, in which a pattern wandered by a size of its "
            "own; calibrate again into a new folder"
        )
    slow, profile, functions = content["slow"], content["profile"], content["functions"]
    kept = [np.array(own, float).reshape(count, -1) for own, count in zip(content["kept"], functions, strict=True)]
    return HeatModel(
        nodes=tuple(content["nodes"]),
        flow=np.array(content["flow"]),
        origin=np.datetime64(content["origin"]),
        harmonics=content["harmonics"],
        over=content["over"],
        profile=None
        if profile is None
        else Profile(np.array(profile["knots"], float), profile["length"], tuple(profile["range"])),
        slow=None if slow is None else Slow(np.array(slow["knots"], float), slow["time"]),
        of_pattern=content["of_pattern"],
        gains=tuple(Gain(own["node"], tuple(own["columns"]), tuple(own["watts"])) for own in content["gains"]),
        groups=tuple(Group(**own) for own in content["groups"]),
        kept=tuple(kept),
        centre=np.array(content["centre"], float),
        shapes=tuple(Shaped(own["time"], own["white_share"]) for own in content["shapes"]),
        held=tuple(
            Held(own["window"], tuple(map(tuple, own["shares"])), tuple(map(tuple, own["switches"])))
            for own in content["held"]
        ),
        followed={
            name: Followed(own["logarithmic"], own["at"], np.array(own["slope"], float))
            for name, own in content["followed"].items()
        },
    )  # fmt: skip
