"""Whether a run can be used, for what, and why; and with which exit code it ends."""

import dataclasses
import json
import re

import numpy as np
import pytest

from flightcal.calibration import EMULATOR_ERROR
from flightcal.errors import GATE_FAILED, MODEL_FAILED, WITH_LIMITS
from flightcal.prediction import ANY
from flightcal.prediction.holding import replicate
from flightcal.report.comparison_page import _covers
from flightcal.report.findings import in_few_words, unseen
from flightcal.report.findings.finding import value_of
from flightcal.report.panels.picture import choose, holdings
from flightcal.report.verdict import CONVERGED, HOLD, RIGHT, verdict_of

from .synthetic_run import panels


def sampled(run):
    """The same run with all gates passed."""
    gates = [gate | {"passed": True} for gate in run.diagnostics["gates"]]
    return dataclasses.replace(run, diagnostics=run.diagnostics | {"passed": True, "gates": gates})


def seconds_of(window):
    time = window["time"].values
    return (time - time[0]) / np.timedelta64(1, "s")


def fitted(run, *, shifted=(), by=5.0):
    """The same with a right model: telemetry is a draw of the prediction, and shifted in these channels after all."""
    windows = {}
    for seed, (name, window) in enumerate(run.windows.items()):
        rng = np.random.default_rng(seed)
        mean, deviation = (window[key].sel({"by": "stochastic"}).values for key in ("mean", "standard_deviation"))
        draws = mean + deviation * rng.normal(size=(300, *mean.shape))
        observed = mean + deviation * rng.normal(size=mean.shape)
        if name != "train":
            observed[:, list(shifted)] += by
        held = replicate(seconds_of(window), observed, window["scored"].values, draws, 0.95)
        windows[name] = window.assign(
            observed=(("time", "channel"), observed),
            **held.dataset().variables,
        )
    return dataclasses.replace(sampled(run), windows=windows)


def states(judged):
    return {answer.question: answer.state for answer in judged.answers}


def test_a_right_model_can_be_used(run):
    judged = verdict_of(fitted(run))
    assert states(judged) == {CONVERGED: "good", RIGHT: "good", HOLD: "good"}
    assert (judged.use, judged.exit_code) == ("Use it.", 0)
    assert judged.then == "flightcal backtest scenario.yaml --out backtest"


def test_a_stretch_in_which_something_else_was_flown_is_told_with_its_times(run):
    times = run.windows["test"]["time"].values
    stretch = (np.arange(len(times)) >= 40) & (np.arange(len(times)) < 80)
    judged = verdict_of(fitted(run, shifted=[1], by=np.where(stretch, -5.0, 0.0)[:, None]))
    since, until = (np.datetime_as_string(times[k], unit="m").replace("T", " ") for k in (40, 79))
    assert judged.then == (
        f"Find what was flown otherwise from {since} to {until} UTC, as a mode or attitude that the scenario has not "
        "there: battery_temperature is 5.0 K below the prediction."
    )


def test_what_is_off_months_after_training_may_have_aged(run):
    wrong = fitted(run, shifted=[1])
    later = wrong.windows["test"].assign_coords(time=wrong.windows["test"]["time"] + np.timedelta64(60, "D"))
    judged = verdict_of(dataclasses.replace(wrong, windows=wrong.windows | {"test": later}))
    assert judged.then.endswith("It is 61 days after training: train on both, with 'trend' at what ages.")


def test_a_good_run_through_an_emulator_is_not_sent_to_a_backtest_which_would_refuse_it(run):
    judged = verdict_of(dataclasses.replace(fitted(run), emulator={"reached": True}))
    assert judged.use == "Use it."
    assert judged.then.startswith("Predict more that it has not seen: add a window")


def test_a_failed_gate_of_the_sampling_comes_before_all_else(run):
    right = fitted(run)
    judged = verdict_of(dataclasses.replace(right, diagnostics=run.diagnostics))
    assert states(judged) == {CONVERGED: "bad", RIGHT: "good", HOLD: "good"}
    assert (judged.use, judged.exit_code) == ("Do not use it.", GATE_FAILED)
    assert judged.then == "Raise the acceptance (nuts: target_acceptance)."


def test_an_emulator_that_failed_comes_before_the_chains(run):
    gates = [
        {"name": "R-hat", "passed": False, "found": "1.134", "required": "below 1.01", "advice": "Warm up longer."},
        {"name": EMULATOR_ERROR, "passed": False, "found": "the budget of runs is spent",
         "required": "no longer matters", "advice": "Allow more runs (calibration.emulator.runs)."},
    ]  # fmt: skip
    judged = verdict_of(dataclasses.replace(fitted(run), diagnostics=run.diagnostics | {"gates": gates}))
    assert judged.answers[0].worst.title == "The emulator does not follow the simulator: the budget of runs is spent"
    assert judged.then == "Allow more runs (calibration.emulator.runs)."
    assert [text.split(":")[0] for text in judged.answers[0].worst.details] == [EMULATOR_ERROR, "R-hat"]


def test_a_model_whose_residuals_are_not_its_noise_cannot_be_used(run):
    judged = verdict_of(sampled(run))
    assert states(judged)[RIGHT] == "bad"
    assert (judged.use, judged.exit_code) == ("Do not use it.", MODEL_FAILED)


def test_five_kelvin_in_the_test_window_alone_are_a_failure(run):
    judged = verdict_of(fitted(run, shifted=[0, 1, 2]))
    assert states(judged) == {CONVERGED: "good", RIGHT: "good", HOLD: "bad"}
    assert judged.exit_code == MODEL_FAILED
    assert "3 of 3 channels" in judged.answers[2].worst.title


def test_intervals_that_hold_are_told_with_the_least_that_they_cover_and_what_training_had_not(run):
    right = fitted(run)
    window = right.windows["test"]
    share = holdings(right)["test"].coverage.min()
    assert verdict_of(right).answers[2].worst.title == (
        f"Intervals hold on “test”, in every channel: {100 * share:.1f}% inside or more"
    )
    elsewhere = window.assign_attrs(unseen=json.dumps([{"name": ANY, "share": 0.38}]))
    told = verdict_of(dataclasses.replace(right, windows={**right.windows, "test": elsewhere})).answers[2]
    assert told.worst.title.endswith("inside or more; 38% of “test” is outside of what training contained")
    assert told.state == "good"


@pytest.mark.parametrize(
    ("least", "chance"),
    [(0.55, "where chance may leave 55.0%"), (0.0, "which so short a window may leave by chance")],
)
def test_a_share_far_below_the_intervals_is_told_with_what_chance_may_leave(run, monkeypatch, least, chance):
    few = {
        name: dataclasses.replace(holding, coverage=np.full(3, 0.7), lower=np.full(3, least))
        for name, holding in holdings(fitted(run)).items()
    }
    monkeypatch.setattr(unseen, "holdings", lambda _: few)
    told = unseen.holding(run)
    assert (told.state, told.title) == (
        "good",
        f"Intervals hold on “test”, in every channel: 70.0% inside or more, {chance}",
    )


def test_a_channel_that_does_not_hold_is_left_out_of_the_use(run):
    judged = verdict_of(fitted(run, shifted=[1]))
    assert judged.exit_code == WITH_LIMITS
    assert judged.use == (
        "Use it for temperatures of panel_temperature and payload_temperature, but not for temperatures of "
        "battery_temperature."
    )


def test_a_channel_that_may_not_hold_is_told_beside_one_that_does_not(run):
    """In another window: one more to test on makes nothing look better."""
    from .cases import errors_as_long_as_the_window  # which takes `fitted` from here

    doubtful, wrong = errors_as_long_as_the_window(run), fitted(run, shifted=[0])
    windows = {**doubtful.windows, "later": wrong.windows["test"]}
    answer = verdict_of(dataclasses.replace(doubtful, windows=windows)).answers[2]
    assert answer.worst.title.startswith("Intervals do not hold in 1 of 3 channels, worst panel_temperature in “later”")
    assert "; battery_temperature may not either (only 5" in answer.worst.title
    assert answer.state == "bad"
    assert len(answer.worst.not_for) == 2


def test_what_was_suspected_before_the_sampling_is_the_reason(run):
    clock = {"title": "the clock is 240 s late", "sentence": "Telemetry fits better so.", "advice": "Shift it"}
    judged = verdict_of(dataclasses.replace(fitted(run), suspects=[clock]))
    assert judged.exit_code == MODEL_FAILED
    assert judged.answers[1].worst.title == "Likely wrong: the clock is 240 s late"
    assert judged.then == "Shift it."


def test_a_suspicion_that_others_are_as_good_as_is_told_as_one_of_several(run):
    words = {"sentence": "Telemetry fits better so.", "advice": "Shift it"}
    found = [words | {"title": "the clock is late", "nats": 40.0}, words | {"title": "a bias", "nats": 30.0}]
    worst = verdict_of(dataclasses.replace(fitted(run), suspects=found)).answers[1].worst
    assert worst.title == "Likely wrong, one of 2: the clock is late"
    assert worst.details == ("Or: a bias.",)


def test_without_an_unseen_window_nothing_is_said_of_other_orbits(run):
    right = fitted(run)
    judged = verdict_of(dataclasses.replace(right, windows={"train": right.windows["train"]}))
    assert states(judged)[HOLD] == "none"
    assert judged.exit_code == WITH_LIMITS
    assert (
        judged.use == "Use it for the windows that it was trained on, but not for windows that it was not trained on."
    )


def test_many_values_that_are_in_doubt_are_said_in_few_words():
    names = [value_of(f"link_{k}") for k in range(8)]
    assert in_few_words(["intervals of parameters", *names[:2], names[0]]) == (
        "intervals of parameters and the values of link_0 and link_1"
    )
    assert in_few_words(names) == "the values of link_0, link_1, link_2, link_3, link_4 and 3 more"
    known = [f"link_{k}" for k in range(8)]
    assert in_few_words(names, known) == "the values of its parameters"
    assert in_few_words(names[:7], known).endswith("and 2 more")


@pytest.mark.parametrize("shifted", [[], [0], [0, 1, 2]])
def test_the_record_says_the_same_as_the_verdict(run, shifted):
    judged = verdict_of(fitted(run, shifted=shifted))
    record = judged.record
    assert (record["use"], record["exit_code"], record["next"]) == (judged.use, judged.exit_code, judged.then)
    assert [answer["state"] for answer in record["answers"]] == [answer.state for answer in judged.answers]


def test_the_noise_of_every_window_that_was_trained_on_is_judged(run):
    right = fitted(run)
    windows = {"train.a": right.windows["train"], "train.b": run.windows["train"], "test": right.windows["test"]}
    answer = verdict_of(dataclasses.replace(right, windows=windows)).answers[1]
    assert answer.state == "bad"
    assert answer.worst.text.startswith("In “train.b” the residuals of")
    assert choose(dataclasses.replace(right, windows=windows)).worst == "payload_temperature"


def test_an_interval_of_another_probability_is_called_so(run):
    windows = {name: window.assign_attrs(interval=0.8) for name, window in fitted(run).windows.items()}
    narrower = dataclasses.replace(fitted(run), windows=windows)
    assert "inside the 80% interval" in verdict_of(narrower).answers[2].worst.text
    words = " ".join(block.text for section in panels(narrower) for block in section.blocks)
    for said in ("predicted mean and 80% interval", "share of telemetry inside the 80% interval; MPIW"):
        assert said in words


@pytest.mark.parametrize(("nominal", "share", "right"), [(0.95, 0.91, True), (0.8, 0.7, True), (0.8, 0.98, False)])
def test_a_comparison_s_coverage_is_held_to_its_interval(nominal, share, right):
    assert _covers(share, nominal) == right


def test_where_a_window_is_short_for_its_errors_it_is_said_what_would_be_told(run):
    right = fitted(run)
    assert "as long as the window" not in unseen.holding(right).text
    found = unseen.holding(errors_of_the_whole_window(right))
    assert found.state == "good"
    assert " In 3 of 3 cases errors may last as long as the window" in found.text
    assert re.search(r"more than \d\.\d deviations on average or \d\.\d for five minutes or more is told", found.text)


def errors_of_the_whole_window(run):
    """A right model, each channel of which is off by as much throughout a window."""
    test, rng = run.windows["test"], np.random.default_rng(4)
    mean, deviation = (test[key].sel({"by": "stochastic"}).values for key in ("mean", "standard_deviation"))
    draws = mean + deviation * (3.0 * rng.normal(size=(300, 1, 3)) + rng.normal(size=(300, *mean.shape)))
    held = replicate(seconds_of(test), test["observed"].values, test["scored"].values, draws, 0.95)
    return dataclasses.replace(run, windows=run.windows | {"test": test.assign(**held.dataset().variables)})
