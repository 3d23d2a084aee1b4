"""Modes from a CSV file in the place of the scenario's timeline."""

import pandas as pd
import pytest
from ruamel.yaml import YAML

from flightcal.errors import ScenarioError
from flightcal.scenario import lint, load_scenario, resolved_yaml
from tests import small

ROWS = """\
at,mode
2024-02-29T23:00:00,nominal
2024-03-01T00:30:00,imaging
2024-03-01T00:31:00,imaging
2024-03-01T00:50:00Z,nominal
"""


def written(folder, rows=ROWS, **more):
    content = small.content()
    content["simulator"]["modes"] = {"nominal": {"body": "2 W"}, "imaging": {"body": "5 W"}}
    content["simulator"].pop("timeline", None)
    content["simulator"] |= {"timeline_file": "modes.csv"} | more
    file = folder / "scenario.yaml"
    YAML(typ="safe").dump(content, file)
    (folder / "telemetry.csv").touch()
    (folder / "modes.csv").write_text(rows, encoding="utf-8")
    return file


def test_rows_are_changes_and_rows_that_repeat_a_mode_change_nothing(tmp_path):
    timeline = load_scenario(written(tmp_path)).network.timeline
    assert [(change.at.isoformat(), change.mode) for change in timeline] == [
        ("2024-02-29T23:00:00", "nominal"),
        ("2024-03-01T00:30:00", "imaging"),
        ("2024-03-01T00:50:00", "nominal"),
    ]


NAMES = ("nominal",) * 10 + ("imaging",) * 4 + ("nominal",) * 6


def sampled(modes=NAMES, minutes=None):
    minutes = range(len(modes)) if minutes is None else minutes
    times = pd.Timestamp("2024-03-01T00:00:00") + pd.to_timedelta(minutes, unit="min")
    return "at,mode\n" + "".join(f"{at.isoformat()},{mode}\n" for at, mode in zip(times, modes, strict=True))


def test_between_samples_a_mode_changes_midway(tmp_path):
    timeline = load_scenario(written(tmp_path, sampled())).network.timeline
    assert [(change.at.isoformat(), change.within, change.mode) for change in timeline] == [
        ("2024-03-01T00:00:00", None, "nominal"),
        ("2024-03-01T00:09:30", 60.0, "imaging"),
        ("2024-03-01T00:13:30", 60.0, "nominal"),
    ]


@pytest.mark.parametrize(
    ("names", "minutes", "expected"),
    [
        (NAMES, [k**2 for k in range(20)], [0, 100, 196]),
        (["nominal", "imaging", "imaging", "nominal", "imaging"], [0, 1, 2, 3, 4], [0, 1, 3, 4]),
    ],
    ids=["without a rate", "that seldom repeat"],
)
def test_such_rows_are_changes(tmp_path, names, minutes, expected):
    timeline = load_scenario(written(tmp_path, sampled(names, minutes))).network.timeline
    assert [change.at.hour * 60 + change.at.minute for change in timeline] == expected
    assert not any(change.within for change in timeline)


def test_in_a_gap_of_the_samples_a_mode_changed_anywhere(tmp_path):
    rows = sampled().splitlines()
    timeline = load_scenario(written(tmp_path, "\n".join(rows[:8] + rows[12:]) + "\n")).network.timeline
    assert [(change.at.isoformat(), change.within) for change in timeline[1:]] == [
        ("2024-03-01T00:08:30", 300.0),
        ("2024-03-01T00:13:30", 60.0),
    ]


def test_a_file_of_changes_may_say_within_how_long_each_lies(tmp_path):
    rows = "at,mode,within\n2024-03-01T00:00:00,nominal,\n2024-03-01T00:30:00,imaging,2 min\n"
    timeline = load_scenario(written(tmp_path, rows)).network.timeline
    assert [change.within for change in timeline] == [None, 120.0]
    with pytest.raises(ScenarioError, match=r"modes\.csv, line 3: within: found '2 m' .a length., expected"):
        load_scenario(written(tmp_path, rows.replace("2 min", "2 m")))


@pytest.mark.parametrize("rows", [ROWS, sampled()])
def test_what_is_resolved_reads_as_the_same(tmp_path, rows):
    scenario = load_scenario(written(tmp_path, rows))
    again = tmp_path / "resolved.yaml"
    again.write_text(resolved_yaml(scenario), encoding="utf-8")
    (tmp_path / "modes.csv").unlink()
    assert load_scenario(again).network.timeline == scenario.network.timeline


@pytest.mark.parametrize(
    ("rows", "wrong"),
    [
        (ROWS.replace("imaging\n2024-03-01T00:31", "imagin\n2024-03-01T00:31"), "line 3: found the mode 'imagin'"),
        (ROWS.replace("00:31:00", "00:20:00"), "line 4: found 2024-03-01T00:20:00, expected a time after"),
        (ROWS.replace("00:30:00", "half past"), "line 3: found '2024-03-01Thalf past', expected a UTC time"),
        ("time,mode\n", "found no row, expected the columns at and mode"),
        ("time,mode\n1,nominal\n", "found time, mode, expected the columns at and mode"),
    ],
)
def test_what_is_wrong_in_the_file_is_said_with_its_line(tmp_path, rows, wrong):
    with pytest.raises(ScenarioError, match=r"modes\.csv") as raised:
        load_scenario(written(tmp_path, rows))
    assert wrong in str(raised.value)


def test_a_file_that_is_not_there_and_a_timeline_beside_it_are_errors(tmp_path):
    file = written(tmp_path, timeline=[{"at": "2024-03-01T00:00:00", "mode": "nominal"}])
    with pytest.raises(ScenarioError, match="found 'timeline' too"):
        load_scenario(file)
    file = written(tmp_path)
    (tmp_path / "modes.csv").unlink()
    with pytest.raises(ScenarioError, match="not there"):
        load_scenario(file)


ATTITUDES = """\
at,attitude
2024-02-29T23:00:00,charge
2024-03-01T00:30:00,nadir
2024-03-01T00:31:00,nadir
2024-03-01T00:50:00Z,charge
"""


def with_attitudes(folder, rows=ATTITUDES, **more):
    content = small.content()
    orbit = {"altitude": "500 km", "inclination": "97 deg", "ltan": "12:00", "epoch": "2024-03-01T00:00:00"}
    attitude = {"named": {"charge": "sun_pointing"}, "timeline_file": "attitudes.csv", "slew": "3 min"} | more
    content["environment"] = {"orbit": orbit, "attitude": attitude}
    file = folder / "scenario.yaml"
    YAML(typ="safe").dump(content, file)
    (folder / "telemetry.csv").touch()
    (folder / "attitudes.csv").write_text(rows, encoding="utf-8")
    return file


def test_attitudes_come_from_a_file_and_what_is_resolved_reads_as_the_same(tmp_path):
    scenario = load_scenario(with_attitudes(tmp_path))
    attitude = scenario.environment.attitude
    assert [change.attitude for change in attitude.timeline] == ["charge", "nadir", "charge"]
    assert attitude.attitudes == ("sun_pointing", "nadir", "sun_pointing")
    again = tmp_path / "resolved.yaml"
    again.write_text(resolved_yaml(scenario), encoding="utf-8")
    (tmp_path / "attitudes.csv").unlink()
    assert load_scenario(again).environment.attitude.timeline == attitude.timeline


def test_attitudes_that_stand_in_the_scenario_read_as_the_same_when_resolved(tmp_path):
    changes = [{"at": "2024-03-01T00:00:00", "attitude": "nadir"}, {"at": "2024-03-01T01:00:00", "attitude": "charge"}]
    file = with_attitudes(tmp_path, timeline=changes)
    content = YAML(typ="safe").load(file)
    del content["environment"]["attitude"]["timeline_file"]
    YAML(typ="safe").dump(content, file)
    scenario = load_scenario(file)
    again = tmp_path / "resolved.yaml"
    again.write_text(resolved_yaml(scenario), encoding="utf-8")
    assert load_scenario(again).environment.attitude == scenario.environment.attitude


@pytest.mark.parametrize(
    ("rows", "wrong"),
    [
        ("at,mode\n2024-03-01,charge\n", "attitudes.csv: found at, mode, expected the columns at and attitude"),
        (
            "at,attitude\n2024-03-01,chrge\n",
            "line 2: found the attitude 'chrge', expected one of charge, nadir, sun_pointing; did you mean 'charge'?",
        ),
        ("at,attitude\n2024-03-01,charge\n2024-03-01T00:01:00,nadir\n", "after the slew of 180 s that begins at 2024"),
    ],
)
def test_a_file_of_attitudes_that_is_wrong_is_named_with_its_line(tmp_path, rows, wrong):
    with pytest.raises(ScenarioError, match=wrong.replace("?", "[?]")):
        load_scenario(with_attitudes(tmp_path, rows))


def test_a_quaternion_in_a_timeline_must_have_length_one(tmp_path):
    with pytest.raises(ScenarioError, match=r"attitude.named.burn.inertial: found a quaternion of length 2"):
        load_scenario(with_attitudes(tmp_path, named={"charge": "nadir", "burn": {"inertial": [2, 0, 0, 0]}}))


def test_a_measured_eclipse_names_a_status_channel(tmp_path):
    file = with_attitudes(tmp_path)
    content = YAML(typ="safe").load(file)
    content["environment"]["eclipse"] = {"measured_by": "sun"}
    YAML(typ="safe").dump(content, file)
    with pytest.raises(ScenarioError, match=r"eclipse.measured_by: found 'sun', a driver channel, expected a status"):
        load_scenario(file)


def test_a_line_is_that_of_the_file_and_nothing_else_is_said_of_it(tmp_path):
    rows = ROWS.replace("\n", "\n\n", 1).replace("imaging", "imagin", 1)
    findings = lint(written(tmp_path, rows))
    line = next(k for k, row in enumerate(rows.splitlines(), start=1) if "imagin" in row and "imaging" not in row)
    assert [f"line {line}: found the mode 'imagin'" in finding.message for finding in findings] == [True]
