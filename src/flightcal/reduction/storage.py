"""A projected model in one netCDF file: arrays, and the blocks of a scenario as JSON; nothing is pickled."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray
from pydantic import TypeAdapter

from ..errors import ScenarioError
from ..run import typed, write_netcdf
from ..scenario import REDUCED_MODEL_FORMAT as FORMAT
from ..scenario import FaceNormal, ReducedNumber, Scenario, SimulatorError, SimulatorModel, settable
from ..simulator import FloatArray
from .affine import Product
from .full_heat import FullHeat
from .names import node_name
from .reduced_model import ReducedModel

_WORDS = ("states", "settled", "mixed", "free", "columns", "heaters", "shifts", "followers", "full")
_ARRAYS = {
    "mixing": ("mixed", "temperature"),
    "mixing_offset": ("mixed",),
    "values": ("free",),
    "initial": ("state",),
    "initial_covariance": ("state", "state_too"),
    "entering": ("full", "unknown"),
}
_OF_HEAT = {"flow": ("full",), "brought": ("full", "input")}
_KINDS = ("capacity", "linear", "radiative", "forcing", "heating")
_COLUMNS = {"capacity": "state", "linear": "unknown", "radiative": "radiating", "forcing": "input", "heating": "heater"}
_WAYS: TypeAdapter[dict[str, FaceNormal]] = TypeAdapter(dict[str, FaceNormal])


@dataclass(frozen=True)
class Stored:
    """What a file holds; where a scenario names it, its attribute `about` is read too (`scenario/reduced.py`)."""

    model: ReducedModel
    errors: dict[str, SimulatorError]
    """By sensor."""
    sensors: dict[str, str]
    """Sensor -> node."""
    simulator: SimulatorModel
    """Nodes, faces, heaters and modes as a scenario sees them."""
    parameters: dict[str, ReducedNumber]
    """Free numbers ``reduced.<name>``."""
    heat: FullHeat


def save(path: Path, stored: Stored) -> None:
    """Write atomically."""
    write_netcdf(path, _dataset(stored))


def load(path: Path) -> Stored:
    """What is in a file, which every window asks for: it is read again where it has changed.

    Raises ScenarioError where the file is not a reduced model of this format.
    """
    found = path.stat() if path.exists() else None
    return _load(path, *((found.st_ino, found.st_size, found.st_mtime_ns) if found else ()))


@lru_cache(maxsize=2)
def _load(path: Path, *version: int) -> Stored:
    try:
        with xarray.open_dataset(path, engine="h5netcdf") as opened:
            data = opened.load()
    except (OSError, ValueError) as error:
        raise ScenarioError(f"{path}: cannot be read as a reduced model: {error}") from None
    if data.attrs.get("flightcal_reduced_model") != FORMAT:
        found = data.attrs.get("flightcal_reduced_model", "no mark of one")
        raise ScenarioError(f"{path}: found {found}, expected a reduced model of format {FORMAT}")
    about = json.loads(data.attrs["about"])
    matrices: dict[str, dict[Product, FloatArray]] = {}
    for kind in _KINDS:
        products = [tuple(product) for product in about["products"][kind]]
        values = data[kind].to_numpy() if products else np.zeros((0, 0, 0))
        matrices[kind] = dict(zip(products, values, strict=True))
    arrays = {name: data[name].to_numpy() for name in _ARRAYS}
    checked = {"sensors": about["watched"], "ways": _WAYS.validate_python(about["ways"])}
    model = typed(ReducedModel, about | arrays | checked | {"capacity": matrices.pop("capacity"), "matrices": matrices})
    return Stored(
        model,
        {name: SimulatorError.model_validate(item) for name, item in about["errors"].items()},
        about["sensors"],
        SimulatorModel.model_validate(about["simulator"]),
        {name: ReducedNumber.model_validate(item) for name, item in about["parameters"].items()},
        FullHeat(tuple(map(node_name, model.full)), *(data[name].to_numpy() for name in _OF_HEAT)),
    )


def _dataset(stored: Stored) -> xarray.Dataset:
    model = stored.model
    matrices: dict[str, Mapping[Product, FloatArray]] = {"capacity": model.capacity}
    matrices.update({str(kind): found for kind, found in model.matrices.items()})
    variables: dict[str, Any] = {name: (dimensions, getattr(model, name)) for name, dimensions in _ARRAYS.items()}
    variables |= {name: (dimensions, getattr(stored.heat, name)) for name, dimensions in _OF_HEAT.items()}
    for kind, found in matrices.items():
        if found:
            row = "temperature" if kind == "capacity" else "unknown"
            column = "state" if kind == "capacity" else "unknown_too" if kind == "linear" else _COLUMNS[kind]
            variables[kind] = ((f"{kind}_product", row, column), np.stack(list(found.values())))
    about = {name: getattr(model, name) for name in _WORDS} | {
        "watched": model.sensors,
        "ways": _WAYS.dump_python(model.ways, mode="json"),
        "products": {kind: list(found) for kind, found in matrices.items()},
        "errors": {name: item.model_dump(mode="json") for name, item in stored.errors.items()},
        "sensors": stored.sensors,
        "simulator": stored.simulator.model_dump(mode="json", exclude_none=True),
        "parameters": {name: item.model_dump(mode="json") for name, item in stored.parameters.items()},
    }
    return xarray.Dataset(variables, attrs={"flightcal_reduced_model": FORMAT, "about": json.dumps(about)})


def stored_of(
    model: ReducedModel,
    scenario: Scenario,
    block: SimulatorModel,
    errors: dict[str, SimulatorError],
    heat: FullHeat,
) -> Stored:
    """What is stored of a model of the full network's scenario."""
    numbers = settable(scenario)
    values = dict(zip(model.free, model.values.tolist(), strict=True))
    parameters = {}
    for name, item in scenario.parameters.items():
        if f"reduced.{name}" not in values:
            continue
        # A factor is not negative; what is set keeps to the bounds of what it sets.
        lower, upper = (numbers[item.sets[0]].lower, numbers[item.sets[0]].upper) if item.sets else (0.0, math.inf)
        parameters[f"reduced.{name}"] = ReducedNumber.model_construct(
            unit=item.unit,
            value=values[f"reduced.{name}"],
            lower=lower if math.isfinite(lower) else None,
            upper=upper if math.isfinite(upper) else None,
        )
    sensors = {name: item.node or "" for name, item in scenario.observations.items()}
    return Stored(model, errors, sensors, block, parameters, heat)
