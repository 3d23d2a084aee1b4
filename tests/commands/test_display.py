"""What a user sees of a long run."""

from io import StringIO

import pytest
from rich.console import Console

from flightcal.calibration.nuts import ChainProgress
from flightcal.commands import display as progress

CHAINS = (ChainProgress(30, 100, 50, 400, 0), ChainProgress(12, 100, 50, 200, 0))
TOLD = "42/200 draws, 600 gradients"


@pytest.fixture
def clock(monkeypatch):
    """The time that a display sees, s; the test sets it."""
    now = [0.0]
    monkeypatch.setattr(progress, "monotonic", lambda: now[0])
    return now


def lines_of(clock, terminal, moments):
    written = StringIO()
    with progress.Display(Console(file=written, force_terminal=terminal, width=200)) as display:
        display.stage("nuts", False)
        for clock[0] in moments:
            display.sampling(CHAINS)
    return written.getvalue().splitlines()


def test_a_log_has_a_line_for_a_stage_and_one_for_each_minute_of_it(clock):
    expected = ["stochastic update (NUTS)", f"  {TOLD}", f"  {TOLD}"]
    assert lines_of(clock, False, [1.0, 59.0, 61.0, 62.0, 120.0, 121.5]) == expected


def test_a_new_stage_waits_a_minute_with_its_first_note(clock):
    written = StringIO()
    with progress.Display(Console(file=written, force_terminal=False, width=200)) as display:
        display.stage("genetic", False)
        clock[0] = 59.0
        display.stage("nuts", False)
        clock[0] = 70.0
        display.search("the start of a test")
    assert written.getvalue().splitlines() == ["genetic algorithm", "stochastic update (NUTS)"]


def test_a_terminal_has_a_bar_and_no_lines(clock):
    written = lines_of(clock, True, [61.0, 122.0])
    assert any(TOLD in line for line in written)
    assert f"  {TOLD}" not in written
