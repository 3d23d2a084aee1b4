"""What a user sees of a long run."""

from io import StringIO

import pytest
from rich.console import Console

from flightcal import progress
from flightcal.commands.display import display

TITLE = "stochastic update (NUTS)"
TOLD = "42/200 draws, 600 gradients"


@pytest.fixture
def clock(monkeypatch):
    """The time that a display sees, s; the test sets it."""
    now = [0.0]
    monkeypatch.setattr(progress, "monotonic", lambda: now[0])
    return now


def lines_of(clock, terminal, moments):
    written = StringIO()
    with (
        display(Console(file=written, force_terminal=terminal, width=200)) as shown,
        shown.stage(TITLE) as stage,
        stage.stage("sampling", 200) as sampling,
    ):
        for clock[0] in moments:
            sampling.at(42, TOLD)
    return written.getvalue().splitlines()


def test_a_log_has_a_line_for_a_stage_and_one_for_each_minute_of_it(clock):
    expected = [TITLE, f"  sampling: {TOLD}", f"  sampling: {TOLD}"]
    assert lines_of(clock, False, [1.0, 59.0, 61.0, 62.0, 120.0, 121.5]) == expected


def test_a_new_stage_waits_a_minute_with_its_first_note(clock):
    written = StringIO()
    with display(Console(file=written, force_terminal=False, width=200)) as shown:
        with shown.stage("genetic algorithm"):
            clock[0] = 59.0
        with shown.stage(TITLE) as stage:
            clock[0] = 70.0
            stage.at(0.0, "the start of a test")
    assert written.getvalue().splitlines() == ["genetic algorithm", TITLE]


def test_a_log_has_the_last_note_of_a_stage_once_and_what_is_said(clock):
    written = StringIO()
    with display(Console(file=written, force_terminal=False, width=200)) as shown, shown.stage(TITLE, 2) as stage:
        stage.at(1, "half")
        stage.say("round 1: [20 runs]")
        stage.at(2, "done before")
        stage.at(2, "done before")
    assert written.getvalue().splitlines() == [TITLE, "round 1: [20 runs]", "  done before"]


def test_a_terminal_has_a_bar_and_no_lines(clock):
    written = lines_of(clock, True, [61.0, 122.0])
    assert any(TITLE in line and f"sampling: {TOLD}" in line for line in written)
    assert f"  sampling: {TOLD}" not in written
