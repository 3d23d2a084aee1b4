"""Broken inputs give the message that says what to mend, and no other."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from flightcal.cli import app
from flightcal.scenario import lint

BROKEN = Path(__file__).parent / "broken"
SCENARIOS = sorted((BROKEN / "scenarios").glob("*.yaml"))


def expectations(path: Path) -> list[str]:
    """What the first lines of a broken scenario say: ``# expect: LINE: text``, or without a line."""
    lines = path.read_text().splitlines()
    return [line.removeprefix("# expect: ") for line in lines if line.startswith("# expect: ")]


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_broken_scenario_gives_its_message(path):
    found = [str(finding).removeprefix(str(path)).removeprefix(":").strip() for finding in lint(path)]
    expected = expectations(path)

    assert expected
    assert len(found) == len(expected), found
    for text in expected:
        assert any(message.startswith(text) for message in found), f"{text!r} is not among {found}"


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_calibrating_a_broken_scenario_says_the_same_and_leaves_nothing_behind(path, tmp_path):
    result = CliRunner().invoke(app, ["calibrate", str(path), "--out", str(tmp_path / "run")])
    assert isinstance(result.exception, SystemExit), result.exception
    assert result.exit_code == 1
    assert "Traceback" not in result.output
    for finding in lint(path):
        assert finding.message in result.output
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("name", ["valid.yaml", "valid_external.yaml"])
def test_scenarios_that_the_broken_ones_derive_from_are_sound(name):
    assert lint(BROKEN / name, telemetry=BROKEN / "scenarios") == []


def test_there_are_enough_broken_scenarios():
    assert len(SCENARIOS) >= 100
