"""What a check says in words, of problems whose faults are known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from flightcal.check import check
from flightcal.check.evaluate import THOROUGH
from flightcal.check.findings import findings_of, verdict_of
from flightcal.check.findings.told import _moved
from flightcal.check.identifiability import Combination, Move
from flightcal.check.page import _prior
from flightcal.report.verdict import Finding
from flightcal.scenario import Normal
from flightcal.simulator.system import Switch

from .problems import formula_problem, infos, observing, samples, several

PRIORS = {"level": Normal(mean=1.0, standard_deviation=1.0), "idle": Normal(mean=0.0, standard_deviation=1.0)}
TRUTH = {"level": 1.0, "idle": 0.0}


def findings_for(problem):
    return findings_of(check(problem, THOROUGH, infos(problem)))


def found_in(findings, words):
    return next(finding for finding in findings if words in finding.title)


def grazing():
    """Above a level that lies half a standard deviation off the mode, the heater switches twice more."""

    def high(theta):
        return theta[0] > 1.003

    def temperatures(theta):
        return 290.0 + np.ones((samples(), 2)) * (theta[0] + 0.01 * high(theta))

    def switches(theta):
        times = [600.0, 900.0, 4000.0, 4300.0] if high(theta) else [600.0, 900.0]
        return Switch(np.array(times), np.zeros(len(times), np.int64), np.tile([1.0, 0.0], len(times) // 2))

    return formula_problem(PRIORS, temperatures, TRUTH, switches=switches, heaters=("heater",))


@pytest.fixture(scope="module")
def grazed():
    return findings_for(grazing())


def test_a_jump_near_the_mode_matters_and_is_explained(grazed):
    finding = found_in(grazed, "The log density jumps by")
    assert finding.state == "bad"
    assert "grazes a threshold of heater" in finding.text
    (words,) = [detail for detail in finding.details if detail.startswith("level at 1.003 K")]
    assert "heater switches 2 times below and 4 above: the runs part at 2024-03-01 01:06:40 UTC" in words


def test_a_parameter_of_which_the_telemetry_says_nothing_is_a_caution_with_advice(grazed):
    finding = found_in(grazed, "The telemetry says next to nothing of idle")
    assert finding.state == "warn"
    assert "100% as wide as the prior" in finding.text
    assert "Fix it" in finding.text


def test_the_verdict_counts_what_matters_and_what_is_a_caution(grazed):
    passed, words = verdict_of(grazed)
    assert not passed
    assert "1 finding matters" in words
    good, warn = Finding("good", "a", "b"), Finding("warn", "a", "b")
    assert verdict_of([good, good]) == (True, "Ready to sample: nothing stands against it.")
    assert verdict_of([good, warn]) == (True, "Ready to sample, with 1 caution.")


def test_a_check_is_a_function_of_its_seed():
    problem = formula_problem(PRIORS, lambda t: 290.0 + t[0] * np.ones((samples(), 2)), TRUTH)
    assert findings_for(problem) == findings_for(problem)


def test_a_check_finds_the_same_with_two_windows_in_either_order():
    """The first window grazes a threshold, the second alone tells of `idle` and its panel is out of reach."""

    def telling(theta):
        return 290.0 + np.ones((samples(), 1)) * np.array([theta[0] + theta[1], theta[0] - theta[1]])

    other = formula_problem(PRIORS, telling, TRUTH, heaters=("heater",))
    far = observing(other, other.windows[0].observed - np.array([0.0, 9.0]))
    found = [
        findings_for(several(**windows)) for windows in ({"one": grazing(), "two": far}, {"two": far, "one": grazing()})
    ]
    states = [{finding.title: finding.state for finding in findings} for findings in found]
    assert states[0] == states[1]
    assert states[0]["The prior cannot reach the telemetry of panel_temp in 'two'"] == "bad"
    assert "The telemetry tells every parameter, and every combination of them" in states[0]
    details = [found_in(findings, "The prior cannot reach").details for findings in found]
    assert details[0] == details[1]


def test_a_jump_is_told_with_the_time_of_its_own_window():
    smooth = formula_problem(PRIORS, lambda t: 290.0 + t[0] * np.ones((samples(), 2)), TRUTH, heaters=("heater",))
    finding = found_in(findings_for(several(first=smooth, second=grazing())), "The log density jumps by")
    (words,) = [detail for detail in finding.details if detail.startswith("level at 1.003 K")]
    assert "heater switches 2 times below and 4 above: the runs part at 2024-03-02 01:06:40 UTC" in words


def test_what_is_not_told_of_the_noise_of_several_channels_is_one_caution():
    problem = formula_problem(PRIORS, lambda t: 290.0 + t[0] * np.ones((samples(), 2)), TRUTH)
    checked = check(problem, THOROUGH, infos(problem))
    noises = ["noise.tank.correlation_time", "noise.battery"]

    def cautions(names):
        combinations = tuple(Combination((Move(name, 0.1, 0.2, 1.0),), 0.01, "alone") for name in names)
        of_noise = [replace(checked.infos[0], name=name) for name in noises]
        changed = replace(
            checked,
            infos=(*checked.infos, *of_noise),
            identifiability=replace(checked.identifiability, combinations=combinations),
        )
        return [finding for finding in findings_of(changed) if finding.title.startswith("The telemetry says")]

    (alone, idle) = cautions([noises[0], "idle"])
    assert noises[0] in alone.title
    (idle, together) = cautions([*noises, "idle"])
    assert "idle" in idle.title
    assert together.title == "The telemetry says little of the noise of battery and tank"
    assert len(together.details) == 2


def test_of_two_combinations_of_the_same_parameters_the_one_that_is_told_least_is_said():
    problem = formula_problem(PRIORS, lambda t: 290.0 + t[0] * np.ones((samples(), 2)), TRUTH)
    checked = check(problem, THOROUGH, infos(problem))
    moves = (Move("level", 1.0, 1.2, 1.0), Move("idle", 0.1, 0.3, 3.0))
    combinations = (Combination(moves, 0.01, "mixed"), Combination(moves[::-1], 0.2, "mixed"))
    changed = replace(checked, identifiability=replace(checked.identifiability, combinations=combinations))
    (said,) = [finding for finding in findings_of(changed) if "make up for one another" in finding.title]
    assert said.title.startswith("level and idle")


def test_a_channel_without_samples_is_not_the_one_with_the_least_inside():
    problem = formula_problem(PRIORS, lambda t: 290.0 + t[0] * np.ones((samples(), 2)), TRUTH)
    checked = check(problem, THOROUGH, infos(problem))
    empty, seen = checked.predictive.channels
    empty = replace(empty, inside=np.nan, reached=np.nan, beyond=0.0)
    channels = (empty, replace(seen, inside=0.9))
    checked = replace(checked, predictive=replace(checked.predictive, channels=channels, pressed=()))
    text = found_in(findings_of(checked), "The prior reaches the telemetry").text
    assert text.startswith(f"At least 90.0% ({seen.channel})")
    table = next(block.table for block in _prior(checked, problem) if block.table)
    assert [table.state(row, 2) for row in range(2)] == ["", "good"]


@pytest.fixture(scope="module")
def level():
    """A problem of one level that both channels read, as it is checked."""
    problem = formula_problem(PRIORS, lambda t: 290.0 + t[0] * np.ones((samples(), 2)), TRUTH)
    return check(problem, THOROUGH, infos(problem))


def test_no_caution_stands_above_a_problem(level):
    unsure = replace(level.centre, is_mode=False)
    missed = [replace(channel, reached=0.1, beyond=9.0) for channel in level.predictive.channels]
    checked = replace(level, centre=unsure, predictive=replace(level.predictive, channels=tuple(missed)))
    states = [finding.state for finding in findings_of(checked)]
    assert {"bad", "warn", "good"} <= set(states)
    assert states == sorted(states, key=("bad", "warn", "none", "good").index)


@pytest.mark.parametrize("shares", [(0.4, 0.1), (0.9, 0.6)])
def test_of_channels_that_the_prior_does_not_reach_the_worst_is_first(level, shares):
    channels = [replace(c, reached=r, beyond=2.0) for c, r in zip(level.predictive.channels, shares, strict=True)]
    checked = replace(level, predictive=replace(level.predictive, channels=tuple(channels)))
    finding = found_in(findings_of(checked), "reach")
    better, worse = (c.channel for c in channels)
    assert finding.title.endswith(f"telemetry of {worse} and {better}")
    assert finding.details[0].startswith(worse)


def test_telemetry_that_leaves_the_prior_by_tenths_of_a_kelvin_is_no_caution(level):
    channels = tuple(replace(c, reached=0.93, beyond=0.2) for c in level.predictive.channels)
    checked = replace(level, predictive=replace(level.predictive, channels=channels))
    assert found_in(findings_of(checked), "reach").state == "good"


def test_sensitivities_that_need_more_runs_say_how_many(level):
    few = replace(level.sensitivity, runs=10, failed=0)
    text = found_in(findings_of(replace(level, sensitivity=few)), "Sensitivities are not known").text
    # 4 (2 + 2) draws of the prior, which are a third of the runs.
    assert text == "They need 16 simulations over the prior, and there are 10: check again with `--runs 48`."


def test_sensitivities_of_runs_that_failed_say_so(level):
    failed = replace(level.sensitivity, runs=20, failed=10)
    text = found_in(findings_of(replace(level, sensitivity=failed)), "Sensitivities are not known").text
    assert text == "Too few simulations finished."


@pytest.mark.parametrize(("offset", "words"), [(0.0, "level +1.0%"), (-273.15, "level from 6.85 degC to 9.65 degC")])
def test_a_move_of_a_temperature_is_told_in_degrees_and_not_in_percent_of_kelvins(offset, words):
    info = replace(infos(grazing())[0], offset=offset)
    checked = SimpleNamespace(info=lambda _: info, value=lambda _, si: f"{si + offset:.2f} degC")
    assert _moved(checked, Move("level", 280.0, 282.8, 1.0)) == words
