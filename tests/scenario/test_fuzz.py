"""Whatever a scenario file says, lint answers with findings in plain words and raises nothing."""

import copy
import io
import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from flightcal.scenario import resolved_yaml, settable
from flightcal.scenario.document import read_document, walk
from flightcal.scenario.lint import examine

EXAMPLE = Path(__file__).parent / "example.yaml"
EXTERNAL = Path(__file__).parents[2] / "examples" / "executable"
DATA = read_document(EXAMPLE).data
EXTERNAL_DATA = read_document(EXTERNAL / "scenario.yaml").data
JARGON = re.compile(r"Input should|Value error|[Pp]ydantic|validat|something else|Traceback|NoneType|<\w+>")

fuzz = settings(
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
words = st.sampled_from(
    [
        *("executable", "callable", "fmu", "umbridge", "inputs", "outputs", "inputs.link", "instrument", "initial_of"),
        *("", "on", "18:00", "battery", "radiator", "shade", "payload", "battery_temp", "bus_power", "battery_htr"),
        *(
            "nodes.battery.capacity",
            "observations.battery_temp.bias",
            "uniform",
            "5 W/K",
            "-3 degC",
            "1e400 W",
            "5 deg",
        ),
        *(
            "nan",
            "inf K",
            "2024-03-01T00:00:00",
            "9999-12-31T23:59:59-23:00",
            "degC",
            "mA",
            "m^9^9^9",
            "1e5",
            "%",
            "all",
        ),
    ]
)
scalars = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), words, st.text(st.characters(exclude_categories=["C"]))
)
values = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(words, inner, max_size=3), max_leaves=5
)


def holds(data, key):
    return (isinstance(data, dict) and key in data) or (isinstance(data, list) and key in range(len(data)))


def parent_of(data, location):
    """The mapping or list around `location`, or None where a former mutation has removed it."""
    for key in location[:-1]:
        data = data[key] if holds(data, key) else None
    return data if holds(data, location[-1]) else None


@st.composite
def mutated(draw, original):
    """An example with a few of its entries deleted, replaced, renamed or swapped with others."""
    data = copy.deepcopy(original)
    locations = [location for location, _ in walk(original) if location]
    for _ in range(draw(st.integers(1, 4))):
        location = draw(st.sampled_from(locations))
        parent = parent_of(data, location)
        if parent is None:
            continue
        action = draw(st.sampled_from(["delete", "replace", "replace", "rename", "swap"]))
        if action == "replace":
            parent[location[-1]] = draw(values)
        elif action == "swap":
            other = draw(st.sampled_from(locations))
            source = parent_of(data, other)
            if source is not None:
                parent[location[-1]] = copy.deepcopy(source[other[-1]])
        else:
            value = parent.pop(location[-1])
            if action == "rename" and isinstance(parent, dict):
                parent[draw(words)] = value
    return data


def assert_answer(path):
    scenario, findings = examine(path)

    assert (scenario is None) == any(not finding.warning for finding in findings)
    for finding in findings:
        assert not JARGON.search(finding.message), finding
        assert finding.message
    if scenario is not None:
        settable(scenario)
        path.write_text(resolved_yaml(scenario))
        again, found = examine(path)
        assert again == scenario
        assert all(finding.warning for finding in found)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "example.csv").write_text(EXAMPLE.with_suffix(".csv").read_text())
    return tmp_path


def assert_answer_to(folder, data):
    path = folder / "scenario.yaml"
    text = io.StringIO()
    YAML(typ="safe", pure=True).dump(data, text)
    path.write_text(text.getvalue())
    assert_answer(path)


@fuzz
@given(data=mutated(DATA))
def test_mutated_scenario_gives_findings_or_a_scenario(folder, data):
    assert_answer_to(folder, data)


@fuzz
@given(data=mutated(EXTERNAL_DATA))
def test_mutated_scenario_of_an_external_simulator_gives_findings_or_a_scenario(folder, data):
    for name in ("telemetry.csv", "simulator.py", "input.json.jinja"):
        (folder / name).write_text((EXTERNAL / name).read_text())

    assert_answer_to(folder, data)


@fuzz
@given(data=st.data())
def test_mutated_text_gives_findings_or_a_scenario(folder, data):
    path = folder / "scenario.yaml"
    text = EXAMPLE.read_text()
    for _ in range(data.draw(st.integers(1, 5))):
        start = data.draw(st.integers(0, len(text)))
        end = start + data.draw(st.integers(0, 5))
        inserted = data.draw(st.text(st.sampled_from(":-{}[]#&*!|>'\"%@`, \n\t.a0é\x00"), max_size=3))
        text = text[:start] + inserted + text[end:]
    path.write_text(text)

    assert_answer(path)
