"""JSON Schema of what users write, for completion and checks in editors."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from .priors import prior_schema
from .schema import Scenario

_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_PRIOR = prior_schema()


def json_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of a scenario file; descriptions are those of the data model.

    It knows the form of each block; units, references between blocks and files are for `lint`.
    """
    schema = schema_of(Scenario)
    definitions = schema["$defs"]
    del schema["properties"]["noise"]["default"]
    for key in ("heat", "time_error"):
        written = schema["properties"][key]
        written["anyOf"].remove({"type": "null"})
        del written["default"]
    for key in ("sets", "scales"):
        del definitions["Parameter"]["properties"][key]["default"]
    definitions["Parameter"]["anyOf"] = [{"required": ["sets"]}, {"required": ["scales"]}]

    window = schema["properties"]["windows"]["additionalProperties"]
    group = [{"type": "array", "items": window}, {"type": "object", "additionalProperties": window}]
    schema["properties"]["windows"]["additionalProperties"] = {"anyOf": [window, *group]}

    telemetry = definitions["TelemetryFile"]
    telemetry["anyOf"] = [{"required": ["file", "time"]}, {"required": ["packets"]}]
    for key in ("file", "packets"):
        telemetry["properties"][key].pop("default", None)

    network = definitions["SimulatorModel"]
    network["required"].remove("nodes")
    network["anyOf"] = [{"required": [key]} for key in ("nodes", "boxes", "plates", "reduced_model")]
    return schema


def schema_of(file: type[BaseModel]) -> dict[str, Any]:
    """JSON Schema (2020-12) of a file whose whole content is a model of pydantic."""
    schema = file.model_json_schema()
    for block in (schema, *schema["$defs"].values()):
        _drop_bare_defaults(block)
    named: dict[str, Any] = _name_priors(schema)
    if named != schema:
        named["$defs"]["Prior"] = _PRIOR
    return {"$schema": _DIALECT, **named}


def _drop_bare_defaults(block: dict[str, Any]) -> None:
    # pydantic gives the default of what is written with a unit, or of a prior, in SI, which an editor would offer.
    for schema in block.get("properties", {}).values():
        default = schema.get("default")
        is_prior = isinstance(default, dict) and "kind" in default
        if is_prior or (schema.get("type") == "string" and not isinstance(default, str)):
            schema.pop("default", None)


def _name_priors(schema: Any) -> Any:
    """With a reference in the place of each description of a prior."""
    if isinstance(schema, list):
        return [_name_priors(part) for part in schema]
    if not isinstance(schema, dict):
        return schema
    if schema.get("description") == _PRIOR["description"]:
        return {"$ref": "#/$defs/Prior"}
    return {key: _name_priors(part) for key, part in schema.items()}
