import copy
import re
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from flightcal.scenario import json_schema, load_scenario, resolved_yaml, write_template
from flightcal.scenario.document import parse_document, read_document

EXAMPLE = Path(__file__).parent / "example.yaml"
BROKEN = Path(__file__).parents[1] / "broken"
EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def validator():
    return Draft202012Validator(json_schema())


def test_schema_is_a_valid_one():
    Draft202012Validator.check_schema(json_schema())


def test_scenarios_that_lint_accepts_are_valid(validator, tmp_path):
    template = write_template(tmp_path)[0]

    for path in (EXAMPLE, template, *(EXAMPLES / name / "scenario.yaml" for name in ("executable", "fmu"))):
        assert list(validator.iter_errors(read_document(path).data)) == []
        if path.parent.name != "fmu":  # which is not built
            assert list(validator.iter_errors(parse_document(resolved_yaml(load_scenario(path))).data)) == []


@pytest.mark.parametrize(
    "name",
    [
        *(
            "unknown_key",
            "missing_section",
            "missing_key",
            "text_for_a_number",
            "number_for_text",
            "list_for_a_mapping",
        ),
        *("wrong_choice", "fractional_count", "count_too_small", "word_for_a_flag", "capacity_without_unit"),
        *("absorptivity_above_one", "orbit_not_a_mapping", "attitude_unknown", "parameter_without_path"),
        *("packets_as_a_list", "packet_without_time", "status_bit_negative"),
        *("prior_unknown_distribution", "prior_argument_missing"),
        *("external_kind_misspelt", "external_of_two_kinds", "external_output_in_watt", "executable_command_as_text"),
    ],
)
def test_form_that_is_wrong_is_invalid(validator, name):
    assert not validator.is_valid(read_document(BROKEN / "scenarios" / f"{name}.yaml").data)


_TIMES = {"lognormal": {"median": "9 min", "factor": 2}}


@pytest.mark.parametrize(
    ("block", "valid"),
    [
        ({"noise": {"model": "ar1", "white": "0.1 K", "correlation_time": _TIMES}}, True),
        ({"noise": {"model": "ar2"}}, False),
        ({"discrepancy": {"phase": {"lengthscale": {"uniform": [0.1, 0.3]}, "harmonics": 6}}}, True),
        ({"discrepancy": {"channels": ["battery_temp"]}}, False),
        ({"discrepancy": {"phase": {"smoothness": "7/2"}}}, False),
        ({"discrepancy": {"phase": {"lengthscale": "1 K"}}}, False),
        (
            {"heat": {"pattern": {"harmonics": 3}, "slow": {"time": "2 h"}, "gains": None}},
            True,
        ),
        ({"heat": "none"}, True),
        ({"heat": "off"}, False),
        ({"heat": None}, False),
        ({"heat": {"slow": {"time": 7200}}}, False),
    ],
)
def test_noise_discrepancy_and_heat_have_their_forms(validator, block, valid):
    assert validator.is_valid(read_document(EXAMPLE).data | block) == valid


@pytest.mark.parametrize(
    ("prior", "valid"),
    [
        ({"uniform": [0.1, 0.2]}, True),
        ({"uniform": ["1 W", "2 W"]}, True),
        ({"uniform": [0.1]}, False),
        ({"normal": {"mean": "12 degC", "standard_deviation": "2 K"}}, True),
        ({"normal": {"mean": "12 degC", "sd": "2 K"}}, False),
        ({"truncated_normal": {"mean": 1, "standard_deviation": 1, "lower": 0, "upper": 2}}, True),
        ({"lognormal": {"median": "0.8 W/K", "factor": 2}}, True),
        ({"lognormal": {"median": "0.8 W/K", "factor": "2 W"}}, False),
        ({"half_normal": "2 K"}, True),
        ({"half_normal": "two"}, False),
        ({"beta": {"alpha": 2, "beta": 5}}, True),
        ({"beta": {"alpha": 2}}, False),
        ({"uniform": [0, 1], "half_normal": 1}, False),
        ({"kind": "uniform", "lower": 0, "upper": 1}, False),
    ],
)
def test_prior_is_described_as_users_write_it(validator, prior, valid):
    data = copy.deepcopy(read_document(EXAMPLE).data)
    data["parameters"]["emissivity"]["prior"] = prior

    assert validator.is_valid(data) is valid


def test_what_flightcal_fills_in_is_not_offered(validator):
    schema = json_schema()

    assert "folder" not in schema["properties"]
    assert "unit" not in schema["$defs"]["Parameter"]["properties"]


def test_blocks_and_fields_are_described_by_the_docstrings():
    definitions = json_schema()["$defs"]

    assert definitions["Face"]["description"].startswith("A flat outer face of a node")
    assert definitions["Heater"]["properties"]["measured_by"]["description"].startswith("Status channel")


def test_defaults_are_valid_themselves():
    schema = json_schema()

    for block in [schema, *schema["$defs"].values()]:
        for name, field in block.get("properties", {}).items():
            if field.get("default") is not None:
                validator = Draft202012Validator({**field, "$defs": schema["$defs"]})
                assert validator.is_valid(field["default"]), name


def test_formats_name_every_key_of_a_scenario():
    def keys(schema):
        for part in schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list) else ():
            yield from keys(part)
        if isinstance(schema, dict):
            yield from schema.get("properties", ())

    text = (Path(__file__).parents[2] / "docs" / "formats.md").read_text(encoding="utf-8")
    assert [key for key in sorted(set(keys(json_schema()))) if not re.search(rf"\b{key}\b", text)] == []
