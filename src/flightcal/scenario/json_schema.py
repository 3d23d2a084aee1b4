"""JSON Schema of what users write, for completion and checks in editors."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from ._priors import prior_schema
from ._residuals import PHASE, TIME
from ._units import quantity_schema
from .residuals import NOISE
from .schema import Scenario

_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_PRIORS = ("Uniform", "Normal", "TruncatedNormal", "LogNormal", "HalfNormal", "Beta")


def json_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of a scenario file; descriptions are those of the data model.

    It knows the form of each block; units, references between blocks and files are for `lint`.
    """
    schema = schema_of(Scenario)
    definitions = schema["$defs"]
    for name in _PRIORS:
        del definitions[name]
    definitions["Prior"] = prior_schema()
    del schema["properties"]["folder"]
    prior = {"$ref": "#/$defs/Prior"}

    parameter = definitions["Parameter"]
    _replace(parameter, "prior", prior)
    paths = {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}]}
    _replace(parameter, "sets", paths)
    _replace(parameter, "scales", paths)
    del parameter["properties"]["unit"]
    parameter["required"].remove("unit")
    parameter["anyOf"] = [{"required": ["sets"]}, {"required": ["scales"]}]

    window = schema["properties"]["windows"]["additionalProperties"]
    group = [{"type": "array", "items": window}, {"type": "object", "additionalProperties": window}]
    schema["properties"]["windows"]["additionalProperties"] = {"anyOf": [window, *group]}

    network = definitions["SimulatorModel"]
    del network["properties"]["reduced_numbers"]
    del definitions["ReducedNumber"]
    network["required"].remove("nodes")
    network["anyOf"] = [{"required": ["nodes"]}, {"required": ["reduced_model"]}]

    observation = definitions["Observation"]
    noise = {"anyOf": [quantity_schema("K"), prior, {"$ref": "#/$defs/Noise"}, {"type": "null"}]}
    _replace(observation, "noise", noise)
    for block, quantities in (("Noise", NOISE), ("TimeDiscrepancy", TIME), ("PhaseDiscrepancy", PHASE)):
        for name, quantity in quantities.items():
            _replace(definitions[block], name, {"anyOf": [quantity_schema(quantity.unit), prior, {"type": "null"}]})
    del schema["properties"]["noise"]["default"]
    _replace(observation, "bias", quantity_schema("K"))
    switch_times = definitions["SwitchTimes"]
    for key, unit in (("timing", "s"), ("error_rate", "")):
        _replace(switch_times, key, {"anyOf": [quantity_schema(unit), prior]})
    return schema


def schema_of(file: type[BaseModel]) -> dict[str, Any]:
    """JSON Schema (2020-12) of a file whose whole content is a model of pydantic."""
    schema = file.model_json_schema()
    for block in (schema, *schema["$defs"].values()):
        _drop_bare_defaults(block)
    return {"$schema": _DIALECT, **schema}


def _drop_bare_defaults(block: dict[str, Any]) -> None:
    # pydantic gives the default of a written quantity as a bare SI number, which an editor would offer.
    for schema in block.get("properties", {}).values():
        if schema.get("type") == "string" and not isinstance(schema.get("default"), str):
            schema.pop("default", None)


def _replace(block: dict[str, Any], name: str, schema: dict[str, Any]) -> None:
    """Puts another schema in the place of a property's, and keeps its description."""
    described = {key: block["properties"][name][key] for key in ("description",) if key in block["properties"][name]}
    block["properties"][name] = {**schema, **described}
