"""The decision from the first screen alone, for runs of different kinds: what is not folded has to be enough."""

import dataclasses
import html
import re

import numpy as np
import pytest
import xarray as xr

from flightcal.report import page, verdict_of
from flightcal.report.page import render

from .packed import drawn, without_scripts
from .test_verdict import fitted, sampled


@pytest.fixture(autouse=True)
def nothing_folded(monkeypatch):
    """What is folded takes most of the time, and has no part in the decision."""
    monkeypatch.setattr(page, "parts", lambda run: [])


def first_screen(run):
    """What is read without opening anything: sections by their anchor, as words; and the page."""
    text = render(run)
    shown = re.sub(r"<wbr>|<details.*?</details>", "", without_scripts(text), flags=re.S)
    sections = re.findall(r'<section id="(\w+)"[^>]*>(.*?)</section>', shown, re.S)
    words = {name: html.unescape(" ".join(re.sub(r"<[^>]+>", " ", body).split())) for name, body in sections}
    return words, text


def lines(run):
    """The three answers on the first screen: the mark's word and what is said."""
    verdict = first_screen(run)[0]["verdict"]
    return re.findall(r"(good|caution|problem|not in this run) (.*?) why", verdict)


def good(run):
    return fitted(run)


def bad_model(run):
    return sampled(run)


def not_converged(run):
    return dataclasses.replace(fitted(run), diagnostics=run.diagnostics)


def interrupted(run):
    tree = run.posterior.copy()
    tree.attrs = run.posterior.attrs | {"interrupted": "true"}
    return dataclasses.replace(fitted(run), posterior=tree)


def cut_off(run):
    """Killed before there was a posterior."""
    lacking = ("posterior.nc", "diagnostics.json", "prediction.nc", "metrics.json")
    return dataclasses.replace(run, posterior=None, diagnostics=None, windows={}, metrics=[], missing=lacking)


def one_channel_fails(run):
    return fitted(run, shifted=[1])


def all_channels_fail(run):
    return fitted(run, shifted=[0, 1, 2])


def no_heaters(run):
    right = fitted(run)
    windows = {
        name: window.drop_dims("heater").assign_coords(heater=("heater", np.array([], str)))
        for name, window in right.windows.items()
    }
    return dataclasses.replace(right, windows=windows)


def heater_is_off(run):
    right = fitted(run)
    test = right.windows["test"]
    other = xr.where(test["heater"] == "battery_heater", 0.9, test["observed_duty_cycle"])
    return dataclasses.replace(right, windows=right.windows | {"test": test.assign(observed_duty_cycle=other)})


def nothing_unseen(run):
    right = fitted(run)
    return dataclasses.replace(right, windows={"train": right.windows["train"]})


def prior_is_wrong(run):
    right = fitted(run)
    rows = [
        own | {"prior_score": 4.2 if own["name"] == "battery_link" else 0.1} for own in run.diagnostics["parameters"]
    ]
    return dataclasses.replace(right, diagnostics=right.diagnostics | {"parameters": rows})


USE, LIMITS, NOT = "Use it.", "Use it for ", "Do not use it."


@pytest.mark.parametrize(
    ("kind", "decision", "words", "then"),
    [
        (good, USE, "Intervals hold on “test”, in every channel", "flightcal backtest"),
        (bad_model, NOT, "The assumption of independent noise is contradicted", "Leave `heat` and `noise` out"),
        (not_converged, NOT, "The chains have not converged", "Raise the acceptance"),
        (interrupted, NOT, "The run was interrupted", "The same command takes up where it stopped."),
        (cut_off, NOT, "The sampling did not finish", "Run the same command again"),
        (one_channel_fails, LIMITS, "but not for temperatures of battery_temperature.", "flightcal check"),
        (all_channels_fail, NOT, "Intervals do not hold in 3 of 3 channels", "flightcal check"),
        (no_heaters, USE, "Intervals hold on “test”, in every channel", "flightcal backtest"),
        (heater_is_off, LIMITS, "but not for the duty cycle of battery_heater.", "flightcal check"),
        (nothing_unseen, LIMITS, "but not for windows that it was not trained on.", "Add a window"),
        (prior_is_wrong, LIMITS, "but not for the value of battery_link.", "flightcal check"),
    ],
)
def test_the_first_screen_tells_whether_to_use_it_why_and_what_to_do_next(run, kind, decision, words, then):
    made = kind(run)
    verdict = first_screen(made)[0]["verdict"]
    assert verdict.startswith(decision)
    assert words in verdict
    assert f"Next: {then}" in verdict
    assert [mark for mark, _ in lines(made)].count("good") == sum(a.state == "good" for a in verdict_of(made).answers)


def test_numbers_of_a_run_that_is_not_to_be_used_say_so_where_they_stand(run):
    for kind, said in ((good, False), (one_channel_fails, False), (bad_model, True), (not_converged, True)):
        assert ("Not to be used: see the verdict." in first_screen(kind(run))[0]["calibrated"]) == said


def test_a_value_in_doubt_is_marked_in_its_row(run):
    assert "battery_link in doubt" in first_screen(prior_is_wrong(run))[0]["calibrated"]
    assert "in doubt" not in first_screen(good(run))[0]["calibrated"]


def test_parameters_have_before_after_interval_unit_and_the_telemetry_s_share(run):
    table = first_screen(good(run))[0]["calibrated"]
    assert "battery_link 1.040 0.6001 0.5772 to 0.6248 W/K 100%" in table
    assert "noise." not in table
    assert "initial." not in table


def test_the_picture_is_of_the_channel_that_fails_and_of_another_in_the_unseen_window(run):
    words, text = first_screen(one_channel_fails(run))
    assert "Window “test”, which was not trained on" in words["picture"]
    assert re.search(r"\d% of battery_temperature and 9\d% of", words["picture"])
    figure = drawn(text)["figures"]["figure-1"]
    titles = [own["text"] for own in figure["layout"]["annotations"]]
    assert titles[0] == "<b>battery temperature, the worst of 3</b>"
    assert titles[1].endswith(", a typical one</b>")
    assert titles[2:] == ["<b>battery heater</b>", "<b>payload heater</b>"]


def test_without_a_prediction_it_is_said_in_the_picture_s_place(run):
    words, _ = first_screen(cut_off(run))
    assert "no prediction with an interval" in words["picture"]
    assert "no calibrated numbers: sampling did not finish" in words["calibrated"]
    assert "No duty cycle is predicted" in words["duty"]
    assert "Nothing is predicted" in words["verdict"]


def test_heaters_are_told_predicted_and_measured(run):
    assert "There are no heaters." in first_screen(no_heaters(run))[0]["duty"]
    assert re.search(
        r"payload_heater test [\d.]+% [\d.]+% [\d.]+% to [\d.]+% ✓ inside", first_screen(good(run))[0]["duty"]
    )
    assert re.search(
        r"battery_heater test 90\.0% .*? ✕ outside payload_heater", first_screen(heater_is_off(run))[0]["duty"]
    )
