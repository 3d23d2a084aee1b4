"""What `flightcal diff` says of two runs."""

import math
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from flightcal.calibration import Calibrated
from flightcal.cli import USER_ERROR, app
from flightcal.commands.diff import _named, changed_files, differences, in_deviations, in_unit_of
from tests import small
from tests.commands.kept_run import cells_of, change, write_kept


def diff(*arguments):
    return CliRunner().invoke(app, ["diff", *map(str, arguments)], env={"COLUMNS": "100"})


def rows_of(output, name):
    return [cells_of(line) for line in output.splitlines() if name in line]


def quantity(mean, deviation, unit="W/K"):
    ends = (mean - 1.96 * deviation, mean + 1.96 * deviation)
    return Calibrated("x", "parameter", unit, mean, mean, mean, mean, mean, deviation, *ends, 0.5)


def test_a_run_and_itself_are_the_same(tmp_path):
    run = write_kept(tmp_path / "run")
    result = diff(run, run)
    assert result.exit_code == 0, result.output
    assert "Scenarios: the same" in result.output
    assert "Did the sampling converge? both ✓ good: Yes [all]" in result.output
    assert rows_of(result.output, "link") == [["link, W/K", "0.650 [0.590, 0.710]", "0.650 [0.590, 0.710]", "+0.0"]]


def test_what_differs_is_told(tmp_path):
    other = small.content()
    other["simulator"]["nodes"]["body"]["capacity"] = "3100 J/K"
    other["heat"] = None
    one, two = write_kept(tmp_path / "one"), write_kept(tmp_path / "two", scenario=other, link=0.8, extra=0.1)
    change(two / "verdict.json", use="Do not use it.", answers=[{
        "question": "Did the sampling converge?", "state": "bad", "answer": "No", "findings": []
    }])  # fmt: skip
    change(two / "provenance.json", inputs={"telemetry.csv": "2"})
    output = diff(one, two).output
    assert "Do not use it." in output
    assert "Did the sampling converge?\n      A ✓ good: Yes [all]\n      B ✕ problem: No\n" in output
    assert "Scenarios: 3 differences" in output
    assert "  simulator.nodes.body.capacity: 3000 J/K -> 3100 J/K\n" in output
    assert "  heat: none -> default\n" in output
    assert "  content of telemetry.csv\n" in output
    assert rows_of(output, "link")[0][-1] == "+3.5"  # 0.15 over 0.03 and the root of two
    assert rows_of(output, "extra") == [["extra, W/K", "-", "0.100 [0.0400, 0.160]", "-"]]
    assert ["test", "rmse", "K", "0.65", "0.8"] in rows_of(output, "rmse")


def test_links_have_their_names_and_windows_of_other_times_come_first(tmp_path):
    other = small.content()
    other["simulator"]["nodes"]["body"]["initial"] = "14 degC"
    other["simulator"]["conductors"][1]["radiative"] = "0.055 m^2"
    other["windows"]["test"]["end"] = "2024-03-01T07:00:00"
    output = diff(write_kept(tmp_path / "one"), write_kept(tmp_path / "two", scenario=other)).output
    lines = [line.split(":")[0].strip() for line in output.splitlines() if " -> " in line]
    assert lines == ["windows.test.end", "simulator.conductors.panel-space.radiative", "simulator.nodes.body.initial"]
    assert "Scores of test are of different times in A and B." in output
    assert "different times" not in diff(tmp_path / "one", tmp_path / "one").output


def test_two_links_of_the_same_nodes_are_both_compared():
    found = _named([{"between": ["a", "b"], "x": 1}, {"between": ["a", "b"], "x": 2}, {"name": "c", "between": []}])
    assert list(found) == ["a-b", "a-b 2", "c"]


def test_factors_are_compared_as_factors_of_the_same_numbers(tmp_path):
    """The second run began with calibrated numbers: its factor of 1 is the first run's of 1.1."""
    other = small.content()
    other["simulator"]["conductors"][1]["radiative"] = "0.055 m^2"
    one = write_kept(tmp_path / "one", panel_size=1.1)
    two = write_kept(tmp_path / "two", scenario=other, panel_size=1.0)
    (row,) = rows_of(diff(one, two).output, "panel_size")
    assert row[1:] == ["1.10 [1.04, 1.16]", "1.10 [1.03, 1.17]", "+0.0"]


def test_runs_that_share_nothing_are_refused(tmp_path):
    other = small.content()
    other["observations"] = {"panel_3": {"node": "panel"}}
    result = diff(write_kept(tmp_path / "one"), write_kept(tmp_path / "two", scenario=other))
    assert result.exit_code == USER_ERROR
    assert "found no channel in common (" in result.output
    assert "expected two runs of one satellite" in result.output


def test_a_folder_that_is_no_run_is_a_message(tmp_path):
    result = diff(write_kept(tmp_path / "run"), tmp_path)
    assert result.exit_code == USER_ERROR
    assert "found no run" in result.output


def test_a_difference_is_counted_in_deviations_of_both():
    assert in_deviations(quantity(1.0, 0.3), quantity(2.0, 0.4)) == pytest.approx(2.0)
    assert math.isnan(in_deviations(quantity(1.0, 0.0), quantity(2.0, 0.0)))


def test_a_long_tail_away_from_the_other_hides_no_difference():
    one, two = quantity(2000.0, 350.0), replace(quantity(50000.0, 55000.0), median=35000.0, lower=12000.0, upper=2e5)
    assert in_deviations(one, two) == pytest.approx(33000.0 / math.hypot(23000.0 / 1.96, 350.0), rel=1e-9)
    assert in_deviations(two, one) == -in_deviations(one, two)


def test_units_of_two_scenarios_are_made_one():
    found = in_unit_of(quantity(0.6, 0.1), quantity(650.0, 20.0, "mW/K"))
    assert (found.unit, found.mean, found.deviation) == ("W/K", pytest.approx(0.65), pytest.approx(0.02))
    warm = in_unit_of(quantity(10.0, 1.0, "degC"), quantity(284.15, 1.0, "K"))
    assert (warm.mean, warm.deviation) == (pytest.approx(11.0), pytest.approx(1.0))


def test_differences_are_found_where_they_are():
    one = {"a": {"b": [1, 2], "c": [1]}, "d": 1}
    two = {"a": {"b": [1, 3], "c": [1, 2]}, "e": 1}
    assert list(differences(one, two)) == [
        ("a.b[1]", 2, 3), ("a.c", [1], [1, 2]), ("d", 1, None), ("e", None, 1)
    ]  # fmt: skip


def test_a_file_that_was_only_moved_is_no_difference_and_one_that_is_not_in_both_is():
    one = {"a/telemetry.csv": "1", "a/orbit.tle": "2", "a/modes.csv": "3"}
    two = {"b/telemetry.csv": "1", "b/orbit.tle": "4"}
    assert changed_files(one, two) == ["modes.csv", "orbit.tle"]
    assert changed_files(one, {f"moved/{name}": digest for name, digest in one.items()}) == []
