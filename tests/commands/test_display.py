"""What a user sees of a long run."""

from dataclasses import replace
from io import StringIO
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from flightcal import progress
from flightcal.calibration import Calibrated
from flightcal.commands.calibrate import Summary
from flightcal.commands.display import display, print_beside, print_check, print_limits, print_summary, unseen_in_words
from flightcal.prediction import ANY, Extreme, Metric, Unseen
from flightcal.report import Finding, Verdict
from flightcal.report.verdict import Answer
from tests.commands.kept_run import cells_of

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


def summary(folder, metrics=(), heat=None):
    good = Finding("good", "fine", "")
    verdict = Verdict((Answer("Did the sampling converge?", (good,)),), (), ())
    return Summary(folder, folder / "report.html", {"passed": True}, metrics, False, verdict, heat or {})


def printed(show, *arguments):
    written = StringIO()
    show(*arguments, Console(file=written, width=200))
    return written.getvalue().splitlines()


def checked(*findings):
    passed = not any(finding.state == "bad" for finding in findings)
    return SimpleNamespace(passed=passed, verdict="a verdict", findings=findings, page=Path("check.html"))


def test_cautions_of_a_check_are_a_line_each_beside_a_problem_and_told_in_full_without_one():
    bad, caution = Finding("bad", "a clock is late", "By 20 min."), Finding("warn", "a link [1] is loose", "It may be.")
    good = Finding("good", "the prior reaches", "All of it.")
    beside = printed(print_check, checked(bad, caution, good))
    assert "  By 20 min." in beside
    assert "  ! caution: a link [1] is loose" in beside
    assert not any("It may be." in line or "the prior reaches" in line for line in beside)
    alone = printed(print_check, checked(caution, good))
    assert "! caution: a link [1] is loose" in alone
    assert {"  It may be.", "  All of it."} <= set(alone)


def test_a_summary_names_the_three_nodes_with_most_unmodelled_heat():
    shares = {"array": 0.052, "tank": 0.03, "battery": 0.0204, "structure": 0.01}
    line = "unmodelled heat at its largest, as a share of what flows through the node: "

    assert line + "array 5.2%, tank 3.0%, battery 2.0%" in printed(print_summary, summary(Path("run"), heat=shares))
    assert not any("unmodelled heat" in line for line in printed(print_summary, summary(Path("run"))))


def test_a_summary_has_the_ratio_and_the_coverage_of_every_channel_and_how_many_runs_converged():
    errors = {"genetic": 0.4, "genetic_best": 0.25, "stochastic": 0.2}
    metrics = [
        Metric(method, window, channel, "rmse", error * (2 if channel == "tank" else 1), "K")
        for method, error in errors.items()
        for window in ("train", "test")
        for channel in ("battery", "tank", "all")
    ]
    covered = {"battery": 0.99, "tank": 0.5, "all": 0.75}
    metrics += [Metric("stochastic", "test", channel, "picp", share, "1") for channel, share in covered.items()]
    metrics += [Metric("stochastic", "test", channel, "mpiw", 0.3, "K") for channel in covered]
    metrics.append(Metric("genetic_runs", "train", "all", "converged", 7.0, "1", "of 10 runs; flat"))

    lines = printed(print_summary, summary(Path("run"), tuple(metrics)))

    cells = [cells_of(line) for line in lines]
    assert ["test", "RMSE, K", "0.4", "0.25", "0.2", "0.5", "0.8"] in cells
    assert [row for row in cells if row[0] == "test" and row[1] != "RMSE, K"] == [
        ["test", "battery", "0.25", "0.2", "0.8", "99.0%", "0.3 K"],
        ["test", "tank", "0.5", "0.4", "0.8", "50.0%", "0.3 K"],
        ["test", "all", "0.25", "0.2", "0.8", "75.0%", "0.3 K"],
    ]
    assert "genetic algorithm: 7 of 10 runs converged" in lines


def test_a_summary_ends_with_the_verdict_the_parameters_and_the_page_as_the_page_begins():
    link = Calibrated("link", "parameter", "W/K", 0.6, 0.36, 1.0, 0.65, 0.65, 0.03, 0.59, 0.71, 0.97)
    noise = replace(link, name="noise.tank", kind="noise")
    metrics = (Metric("stochastic", "test", "all", "rmse", 0.2, "K"),)
    lines = printed(print_summary, replace(summary(Path("run"), metrics), parameters=(link, noise)))

    verdict = lines.index("Use it.")
    scores = max(k for k, line in enumerate(lines) if "RMSE and interval" in line)
    row = next(k for k, line in enumerate(lines) if "link, W/K" in line)
    assert scores < verdict < row < lines.index(f"report: {Path('run/report.html')}") == len(lines) - 1
    assert cells_of(lines[row]) == ["link, W/K", "0.600", "0.650 [0.590, 0.710]", "97.0%"]
    assert not any("noise.tank" in line for line in lines)


def test_the_published_method_stands_beside_the_default():
    def scores(rmse, picp):
        return (
            Metric("genetic", "test", "all", "rmse", 0.4, "K"),
            Metric("stochastic", "test", "battery", "rmse", 9.0, "K"),
            Metric("stochastic", "test", "all", "rmse", rmse, "K"),
            Metric("stochastic", "test", "all", "picp", picp, "1"),
            Metric("stochastic", "test", "battery", "picp", picp - 0.1, "1"),
            Metric("stochastic", "test", "tank", "picp", picp + 0.1, "1"),
        )

    default, published = summary(Path("run"), scores(0.2, 0.95)), summary(Path("run/published"), scores(0.3, 0.5))
    reduced = replace(
        summary(Path("run/reduced"), scores(0.1, 0.9)),
        checked={
            "flights": 9,
            "records": [
                {"channel": "TT_BAT", "unit": "K", "quantile_95": 0.234, "worst": 1.0},
                {"channel": "TT_ARR", "unit": "K", "quantile_95": 0.123, "worst": 0.5},
                {"channel": "battery", "unit": "1", "quantile_95": 0.004, "worst": 0.006},
            ],
        },
    )
    lines = printed(print_beside, default, {"published": published, "reduced": reduced})

    cells = [cells_of(line) for line in lines]
    assert ["test", "rmse", "0.4 K", "0.3 K", "0.2 K", "0.1 K"] in cells
    assert ["test", "picp", "-", "50.0%", "95.0%", "90.0%"] in cells
    worst = "published 40.0% battery, flightcal 85.0% battery, reduced 80.0% battery"
    assert f"test, channel that is covered least: {worst}" in lines
    assert f"published: {published.verdict.use} Its report: {Path('run/published/report.html')}" in lines
    assert lines[-1] == (
        "full simulator, 9 flights at the posterior's mean and draws: in 95% the reduced model is off by 0.12 K "
        "(TT_ARR) to 0.23 K (TT_BAT), and by at most 0.6 percentage points of duty. A heater out of step shifts its "
        "sensor by up to its band."
    )


def test_what_a_window_has_that_was_not_trained_on_is_said_where_it_is_more_than_a_twentieth_of_it():
    assert unseen_in_words(()) == ""
    assert unseen_in_words((Unseen(ANY, 0.04), Unseen("mode imaging", 0.04))) == ""
    found = (Unseen(ANY, 0.31), Unseen("sunlight on array", 0.3), Unseen("mode imaging", 0.06))
    assert unseen_in_words(found) == (
        "31% of its time is outside of what was trained on: sunlight on array (30%), mode imaging (6%)"
    )
    many = (Unseen(ANY, 0.5), *(Unseen(f"mode {k}", 0.1) for k in range(6)))
    assert unseen_in_words(many).endswith("mode 3 (10%) and 2 more")


def test_names_that_look_like_markup_are_shown_as_they_are(clock):
    folder = Path("q[/b]")
    assert f"report: {folder / 'report.html'}" in printed(print_summary, summary(folder))
    assert any(
        f"Its report: {folder}" in line
        for line in printed(print_beside, summary(folder), {"published": summary(folder)})
    )
    written = StringIO()
    with display(Console(file=written, force_terminal=True, width=200)) as shown, shown.stage("a[/b]") as stage:
        stage.at(1.0, "half[/b]")
    assert "a[/b]" in written.getvalue()
    assert "half[/b]" in written.getvalue()


def test_of_many_limits_the_likeliest_to_be_passed_are_told_and_the_others_counted():
    now = np.datetime64("2031-05-28T06:00")
    chances = [*np.linspace(0.95, 0.05, 14), 0.005, 0.0]
    told = [
        Extreme("test.plan", f"t{k}", "lowest", 280.0, 279.0, 281.0, now, 280.0, chance, 1000)
        for k, chance in enumerate(chances)
    ]
    lines = printed(print_limits, told)
    assert lines[0] == "test.plan: t0 below its limit of 6.85 degC: chance 95.0%; lowest 6.9 (5.9 to 7.9) degC"
    assert lines[12:] == [
        "and 2 more, with a chance of 11.9% or less: see the page",
        "limits that plans pass with a chance of 1% or less: 2 of 16",
    ]
    assert printed(print_limits, []) == []
