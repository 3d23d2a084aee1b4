from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from flightcal.operational import SpacecraftFile
from flightcal.scenario import schema_of
from flightcal.scenario.document import read_document

EXAMPLE = Path(__file__).parents[2] / "examples" / "leo_observer" / "spacecraft.yaml"


@pytest.fixture(scope="module")
def validator():
    Draft202012Validator.check_schema(schema_of(SpacecraftFile))
    return Draft202012Validator(schema_of(SpacecraftFile))


def test_the_example_is_valid(validator):
    assert list(validator.iter_errors(read_document(EXAMPLE).data)) == []


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("step",), 12),
        (("materials", "aluminium", "density"), "2700"),
        (("boxes", "bus", "mesh"), 4.5),
        (("boxes", "bus", "size"), ["1 m", "1 m"]),
        (("plates", "array", "colour"), "blue"),
        (("software", "period"), None),
        (("software", "heaters", "battery", "branches"), {}),
        (("thermistors", "TT_TANK", "failures"), [{"at": "5 s", "kind": "loose"}]),
    ],
)
def test_form_that_is_wrong_is_invalid(validator, path, value):
    content = read_document(EXAMPLE).data
    *above, last = path
    block = content
    for name in above:
        block = block[name]
    block[last] = value
    assert not validator.is_valid(content)
