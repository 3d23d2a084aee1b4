"""The error that all time tags have in common: where there is one, and which channels have it."""

from pathlib import Path

import pytest

from flightcal.errors import ScenarioError
from flightcal.scenario import load_scenario, time_error_of, timed_together

from .. import small

EXTERNAL = Path(__file__).parents[1] / "broken" / "valid_external.yaml"
BOTH = ("observations.body_temp.time_offset", "observations.panel_temp.time_offset")


def load(folder, **blocks):
    return small.load(folder, small.content() | blocks)[0]


@pytest.mark.parametrize(
    ("blocks", "error"),
    [
        ({"heat": {}}, 3.0),
        ({"heat": "none"}, None),
        ({"heat": {}, "time_error": "none"}, None),
        ({"heat": {}, "time_error": "0.5 min"}, 30.0),
        ({"heat": "none", "time_error": "2 s"}, 2.0),
    ],
)
def test_it_stands_beside_heat_unless_something_else_is_written(tmp_path, blocks, error):
    scenario = load(tmp_path, **blocks)

    assert time_error_of(scenario) == error
    assert timed_together(scenario) == BOTH


def test_a_channel_with_a_time_offset_of_its_own_has_that_alone(tmp_path):
    written = small.content() | {"heat": {}}
    written["observations"]["body_temp"]["time_offset"] = "20 s"
    prior = {"normal": {"mean": "0 s", "standard_deviation": "9 s"}}

    assert timed_together(load(tmp_path, **written)) == BOTH[1:]
    written["parameters"]["late"] = {"sets": "observations.panel_temp.time_offset", "prior": prior}
    scenario = load(tmp_path, **written)
    assert timed_together(scenario) == ()
    assert time_error_of(scenario) is None


def test_an_external_simulator_has_none():
    assert time_error_of(load_scenario(EXTERNAL, telemetry=EXTERNAL.parent / "scenarios")) is None


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (None, "found nothing, expected none or a duration"),
        ("-5 s", "time_error"),
        ("0 s", "time_error"),
        ("two", "time_error"),
        ("5 K", "time_error"),
        ("3 h", "time_error"),
    ],
)
def test_what_is_no_duration_is_refused(tmp_path, value, message):
    with pytest.raises(ScenarioError, match=rf"scenario.yaml:\d+: time_error.*{message if value is None else ''}"):
        load(tmp_path, time_error=value)


def test_beside_an_external_simulator_it_is_refused(tmp_path):
    written = EXTERNAL.read_text(encoding="utf-8") + "\ntime_error: 5 s\n"
    (tmp_path / "scenario.yaml").write_text(written, encoding="utf-8")
    with pytest.raises(ScenarioError, match="found a time error beside an external simulator"):
        load_scenario(tmp_path / "scenario.yaml", telemetry=EXTERNAL.parent / "scenarios")
