"""What the first section says."""

import dataclasses
import json
import re

import numpy as np
import pytest

from flightcal.calibration import Calibrated, FixedNumbers
from flightcal.report.panels.duty import duties
from flightcal.report.panels.parameters import at_edge, footing
from flightcal.report.run_files import read_run
from flightcal.report.verdict import verdict_of
from flightcal.run import typed

from .cases import one_channel_fails, with_attributes
from .synthetic_run import every_finding


def converged(run):
    gates = [g | {"passed": True} for g in run.diagnostics["gates"]]
    return dataclasses.replace(run, diagnostics=run.diagnostics | {"passed": True, "gates": gates})


def findings(run):
    return {f.title: f for f in every_finding(run)}


def about(run, words):
    return next(f for title, f in findings(run).items() if words in title)


def with_metric(run, method, metric, value):
    changed = [
        dataclasses.replace(m, value=value)
        if (m.method, m.window, m.channel, m.metric) == (method, "test", "all", metric)
        else m
        for m in run.metrics
    ]
    return dataclasses.replace(run, metrics=changed)


def test_failed_gates_are_told_with_what_was_found_and_required(run):
    finding = about(run, "not converged")
    assert finding.state == "bad"
    assert finding.text == "1 of 6 gates is not passed. Not converged: do not rely on this posterior."
    advice = "Raise the acceptance (nuts: target_acceptance)."
    assert finding.details == (f"divergences: found 2 of 1000 draws, required none. {advice}",)


def test_passed_gates_are_good(run):
    finding = about(converged(run), "have converged")
    assert finding.state == "good"
    assert "All 6 gates" in finding.text


def test_every_state_is_said_in_words_and_not_by_colour_alone(run):
    for finding in every_finding(run):
        assert len(finding.mark.split(" ", 1)[1]) > 3


def test_scores_are_told_beside_the_papers_ratio(run):
    finding = about(converged(run), "On unseen telemetry")
    assert finding.state == "good"
    assert "the stochastic update is better than the genetic algorithm's mean" in finding.title
    for words in (
        "stochastic 0.275 K", "genetic algorithm 0.411 K", "0.753 in the paper", "0.885 in the paper", "PICP", "MPIW",
    ):  # fmt: skip
        assert words in finding.text


def test_the_best_genetic_run_is_told_when_it_beats_the_stochastic_update(run):
    assert "best single run of the genetic algorithm has 0.363 K, worse" in about(run, "On unseen telemetry").text
    better = about(with_metric(run, "genetic_best", "rmse", 0.1), "On unseen telemetry").text
    assert "best single run of the genetic algorithm has 0.100 K, better" in better


def test_it_is_said_that_intervals_leave_out_discrepancy(run):
    assert "not model discrepancy" in about(run, "On unseen telemetry").text
    assert "No interval in this report contains this model discrepancy" in about(run, "independent noise").text


def test_scores_of_chains_that_have_not_converged_are_no_good_news(run):
    finding = about(run, "On unseen telemetry")
    assert finding.state == "warn"
    assert finding.text.endswith("rests on chains that have not converged.")


def test_errors_that_hardly_differ_are_called_equal(run):
    genetic = next(m.value for m in run.metrics if (m.method, m.window, m.metric) == ("genetic", "test", "rmse")
                   and m.channel == "all")  # fmt: skip
    finding = about(with_metric(run, "stochastic", "rmse", 0.99 * genetic), "On unseen telemetry")
    assert "about as good as" in finding.title


def test_a_worse_stochastic_result_is_told(run):
    finding = about(with_metric(run, "stochastic", "rmse", 9.0), "On unseen telemetry")
    assert finding.state == "warn"
    assert "is worse" in finding.title


def test_the_share_inside_the_interval_of_all_channels_is_told_and_judges_nothing(run):
    finding = about(with_metric(converged(run), "stochastic", "picp", 0.6), "On unseen telemetry")
    assert finding.state == "good"
    assert "holds 60.0% of the telemetry of all channels (PICP)" in finding.text


def test_residuals_that_contradict_iid_noise_are_told_by_channel_with_the_factor(run):
    finding = about(run, "The residuals are not the independent noise that was assumed, worst payload_temperature")
    assert finding.state == "bad"
    assert "battery_temperature and payload_temperature" in finding.text
    assert "too narrow by up to about a factor of 7" in finding.text
    assert any(d.startswith("panel_temperature: no contradiction") for d in finding.details)


def scored(run, **scores):
    """The same run, posteriors so many deviations from their priors' medians."""
    records = [p | {"prior_score": scores.get(p["name"], p["prior_score"])} for p in run.diagnostics["parameters"]]
    return dataclasses.replace(run, diagnostics=run.diagnostics | {"parameters": records})


def with_scores(run, **scores):
    """The same run, the posterior of battery_link elsewhere in its prior."""
    records = [p | (scores if p["name"] == "battery_link" else {}) for p in run.diagnostics["parameters"]]
    return dataclasses.replace(run, diagnostics=run.diagnostics | {"parameters": records})


def test_a_posterior_at_its_priors_edge_is_marked(run):
    assert at_edge(run) == {"payload_capacity": "upper"}


def test_priors_in_conflict_with_the_telemetry_are_told_by_name(run):
    assert about(run, "where their priors expect them").state == "good"
    finding = about(scored(run, battery_link=-4.2), "battery_link lies 4.2 deviations from where its prior expects it")
    assert finding.state == "warn"
    assert "battery_link (4.2 deviations below)" in finding.text
    assert finding.not_for == ("the value of battery_link",)
    assert about(scored(run, battery_link=6.0), "battery_link lies 6.0 deviations").state == "bad"


def test_time_tags_farther_off_than_their_prior_allows_put_all_intervals_of_parameters_in_doubt(run):
    infos = [dataclasses.replace(p, kind="time") if p.name == "battery_link" else p for p in run.parameters]
    finding = about(dataclasses.replace(scored(run, battery_link=4.2), parameters=infos), "battery_link lies 4.2")
    assert finding.not_for == ("intervals of parameters",)
    assert "write how far they may be off, such as 'time_error: 30 s'" in finding.text


def test_beside_time_tags_that_are_off_drivers_are_named_that_are_held_from_sample_to_sample(run):
    infos = [dataclasses.replace(p, kind="time") if p.name == "battery_link" else p for p in run.parameters]
    off = dataclasses.replace(scored(run, battery_link=4.2), parameters=infos)
    held = dataclasses.replace(off, scenario="telemetry: {channels: {power: {fill: hold}, sun: {column: I}}}")
    assert "'fill: hold'" not in about(off, "battery_link lies 4.2").text
    assert "'fill: hold' (power) are late by up to a sample" in about(held, "battery_link lies 4.2").text


@pytest.mark.parametrize(("seconds", "state"), [(9.0, "warn"), (11.0, "bad")])
def test_a_time_error_far_shorter_than_lies_between_samples_is_no_problem(run, seconds, state):
    infos = [dataclasses.replace(p, kind="time") if p.name == "battery_link" else p for p in run.parameters]
    rows = [
        dataclasses.replace(p, kind="time", mean=-seconds) if p.name == "battery_link" else p for p in run.calibrated
    ]
    far = dataclasses.replace(scored(run, battery_link=6.0), parameters=infos, calibrated=tuple(rows))
    finding = about(far, "battery_link lies 6.0")
    assert finding.state == state
    assert ("short beside the time between samples" in finding.text) == (state == "warn")


def test_a_posterior_that_the_telemetry_hardly_narrows_is_not_to_be_far_off(run):
    hardly = with_scores(run, prior_score=2.1, usual_score=0.5)
    finding = about(hardly, "battery_link lies 2.1 deviations from where its prior expects it, where 0.5 is usual")
    assert finding.state == "warn"
    assert "so little narrower than its prior that 0.5 is usual" in finding.text
    assert about(with_scores(run, prior_score=2.1, usual_score=0.95), "where their priors").state == "good"


def test_a_guess_at_where_an_unseen_node_starts_makes_no_model_wrong(run):
    initial = next(info for info in run.parameters if info.kind == "initial")
    off = scored(run, **{initial.name: -8.0})
    assert about(off, "where its prior expects it").state == "bad"
    infos = [dataclasses.replace(info, observed=info is not initial) for info in run.parameters]
    finding = about(dataclasses.replace(off, parameters=infos), "where its prior expects it")
    assert finding.state == "warn"
    assert finding.not_for == (f"the value of {initial.name}",)
    assert "initial_state" in finding.then
    both = dataclasses.replace(scored(off, battery_link=6.0), parameters=infos)
    assert about(both, "battery_link lies 6.0 deviations").state == "bad"


@pytest.mark.parametrize(("usual", "state"), [(0.999, "good"), (0.95, "warn")])
def test_a_guess_that_bends_nothing_is_no_caution(run, usual, state):
    """At 3.5 deviations a prior bends a value by 0.16 of its own where it is a 22nd as wide, and by 1.1 at a third."""
    initial = next(info for info in run.parameters if info.kind == "initial")
    infos = [dataclasses.replace(info, observed=info is not initial) for info in run.parameters]
    records = [
        p | ({"prior_score": -3.5, "usual_score": usual} if p["name"] == initial.name else {})
        for p in run.diagnostics["parameters"]
    ]
    off = dataclasses.replace(run, diagnostics=run.diagnostics | {"parameters": records}, parameters=infos)
    finding = about(off, "where their priors expect them" if state == "good" else "where its prior expects it")
    assert finding.state == state
    assert f"{initial.name} (3.5 deviations below)" in finding.text
    assert finding.not_for == (() if state == "good" else (f"the value of {initial.name}",))


def test_many_priors_that_are_a_little_off_are_a_conflict_together(run):
    names = [info.name for info in run.parameters if info.kind == "parameter"]
    # Each alone is at 2.4 deviations, as one of eleven may be by chance; the sum of eight squares is 46.
    assert about(scored(run, **dict.fromkeys(names[:1], 2.4)), "where their priors").state == "good"
    assert (
        about(scored(run, **dict.fromkeys(names, 2.4)), "5 values lie far from where their priors expect them").state
        == "warn"
    )


def test_sizes_of_noise_are_held_to_no_prior(run):
    assert about(scored(run, **{"noise.panel_temperature": -8.0}), "where their priors expect them").state == "good"


def test_duty_cycles_outside_the_simulations_are_told(run):
    assert about(run, "All 2 duty cycles in “test” lie within").state == "good"
    window = run.windows["test"]
    shifted = window.assign(observed_duty_cycle=window["observed_duty_cycle"] + [0.3, 0.0])
    finding = about(dataclasses.replace(run, windows=run.windows | {"test": shifted}), "battery_heater is on for 7")
    assert finding.state == "warn"
    assert [d.endswith("which leaves telemetry out.") for d in finding.details] == [True, False]


def test_a_duty_cycle_beside_its_interval_may_be_so_by_chance(run):
    window = run.windows["test"]
    lowest = window["sampled_duty_cycle"].min("simulation") - 0.9 / window.sizes["time"]
    beside = dataclasses.replace(run, windows=run.windows | {"test": window.assign(observed_duty_cycle=lowest)})
    finding = about(beside, "No duty cycle in “test” is further from what is predicted than chance allows")
    assert finding.state == "good"
    assert all("beside it, as may be by chance" in detail for detail in finding.details)
    assert [duty.where for duty in duties(beside)] == ["beside", "beside"]


def test_one_duty_cycle_is_told_by_its_heater(run):
    window = run.windows["test"].isel(heater=[0])
    one = dataclasses.replace(run, windows=run.windows | {"test": window})
    assert about(one, "The duty cycle of battery_heater in “test” lies within").state == "good"


def test_nothing_is_said_of_a_window_without_a_scored_sample(run):
    window = run.windows["test"]
    none = window.assign(coverage=window["coverage"] * np.nan, observed=window["observed"] * np.nan)
    assert about(dataclasses.replace(run, windows=run.windows | {"test": none}), "is scored").details == ()


def test_what_the_interval_of_a_duty_cycle_contains_is_told(run):
    assert (
        "95% of what is predicted, which contains parameters, initial temperatures."
        in about(run, "All 2 duty cycles").text
    )
    said = run.windows["test"].copy()
    del said.attrs["duty_cycle_contains"]  # of an older flightcal
    told = about(dataclasses.replace(run, windows=run.windows | {"test": said}), "All 2 duty cycles")
    assert "95% of what is predicted. All" in told.text


def test_small_noise_is_not_taken_for_an_edge(run):
    low_noise = [
        dataclasses.replace(i, prior_quantiles=(0.9, 1.0, 2.0)) if i.kind == "noise" else i for i in run.parameters
    ]
    assert set(at_edge(dataclasses.replace(run, parameters=low_noise))) == {"payload_capacity"}


def test_an_interrupted_run_comes_first(run):
    tree = run.posterior.copy()
    tree.attrs = run.posterior.attrs | {"interrupted": "true"}
    first = every_finding(dataclasses.replace(run, posterior=tree))[0]
    assert first.title == "The run was interrupted"
    assert "250 draws of each of 4 chains" in first.text


def test_another_explanation_is_told_with_its_entries_and_units(run):
    differs = [["battery_capacity", 3500.0, 4100.0], ["initial.battery", 283.15, 290.15], ["a", 1.0, 2.0], ["b", 1, 2]]
    other = json.dumps([{"below": 1.44, "differs": differs}])
    finding = about(with_attributes(run, other_explanations=other), "explanation")
    assert finding.state == "warn"
    assert finding.details == (
        "battery_capacity 4100 instead of 3500 J/K, initial.battery 17 instead of 10 °C, a 2 instead of 1, and 1 "
        "more: 1.4 nats below the best.",
    )
    assert not any("explanation" in title for title in findings(run))


def test_a_scenario_without_a_test_window_is_told(run):
    metrics = [m for m in run.metrics if m.window == "train"]
    bare = dataclasses.replace(run, windows={"train": run.windows["train"]}, metrics=metrics)
    assert about(bare, "No unseen telemetry").not_for == ("windows that it was not trained on",)


def test_what_is_not_there_is_told_instead_of_judged(own_run):
    for name in ("posterior.nc", "diagnostics.json", "metrics.json", "prediction.nc"):
        (own_run / name).unlink()
    run = read_run(own_run)
    states = {f.title: f.state for f in every_finding(run)}
    assert states["The sampling did not finish"] == "bad"
    assert states["No scores"] == "none"
    assert states["The noise is not judged"] == "none"
    assert states["The run is not complete"] == "warn"


def test_scores_without_predictions_are_still_told(own_run):
    (own_run / "prediction.nc").unlink()
    assert "RMSE over all channels" in about(read_run(own_run), "On unseen telemetry").text


def test_one_method_alone_is_not_compared(own_run):
    metrics = json.loads((own_run / "metrics.json").read_text(encoding="utf-8"))
    kept = [m for m in metrics if m["method"] != "stochastic"]
    (own_run / "metrics.json").write_text(json.dumps(kept), encoding="utf-8")
    assert "no other method" in about(read_run(own_run), "On unseen telemetry").text


def test_coverage_over_all_channels_does_not_stand_alone(run):
    of = {m.channel: m.value for m in run.metrics if (m.method, m.window, m.metric) == ("stochastic", "test", "picp")}
    del of["all"]
    low, high = min(of, key=of.__getitem__), max(of, key=of.__getitem__)
    text = about(run, "On unseen telemetry").text
    assert f"By channel it holds from {100 * of[low]:.1f}% ({low}) to {100 * of[high]:.1f}% ({high})." in text


def test_what_rests_on_a_fixed_number_is_told_and_decides_nothing(run):
    fixed_numbers = FixedNumbers(0.1, ())
    emissivity = next(row for row in run.calibrated if row.name == "panel_emissivity")
    width = emissivity.upper - emissivity.lower
    ends = {"considered_lower": emissivity.lower - width, "considered_upper": emissivity.upper + width}
    resting = dataclasses.replace(
        run, calibrated=(dataclasses.replace(emissivity, **ends),), fixed_numbers=fixed_numbers
    )
    finding = about(resting, "rests on fixed numbers")
    assert finding.title == "What is known of panel_emissivity rests on fixed numbers"
    assert finding.details == ("panel_emissivity: 3.0 times as wide.",)
    assert verdict_of(resting).state == verdict_of(run).state
    assert not [title for title in findings(run) if "fixed numbers" in title]


def test_the_numbers_that_values_rest_on_are_told(run):
    record = {"name": "panel_emissivity", "number": "faces.outside.area", "off": 0.06, "change": -0.031}
    resting = dataclasses.replace(run, fixed_numbers=typed(FixedNumbers, {"within": 0.1, "footings": [record]}))
    assert footing(resting).rows == [["panel_emissivity", "faces.outside.area", "6.0%", "−0.031"]]


def test_a_value_that_is_little_wider_if_fixed_numbers_are_off_is_not_told(run):
    rows = (dataclasses.replace(row, considered_lower=row.lower, considered_upper=row.upper) for row in run.calibrated)
    same = dataclasses.replace(run, calibrated=tuple(rows), fixed_numbers=FixedNumbers(0.1, ()))
    assert not [title for title in findings(same) if "fixed numbers" in title]


def test_noise_that_lasts_for_longer_than_its_prior_says_is_a_caution_where_there_is_no_heat(run):
    name = "noise.panel_temperature.correlation_time"
    row = Calibrated(name, "noise", "s", 600.0, 150.0, 2400.0, 22_600.0, 22_600.0, 2000.0, 19_000.0, 26_000.0, 0.4)

    def correlated(score):
        rows = [*run.diagnostics["parameters"], {"name": name, "prior_score": score, "usual_score": 0.76}]
        diagnostics = run.diagnostics | {"parameters": rows}
        return dataclasses.replace(run, calibrated=(*run.calibrated, row), diagnostics=diagnostics)

    found = about(correlated(5.1), "What is left over of panel_temperature lasts for 6 h 16 min")
    assert (found.state, found.not_for) == ("warn", ("intervals of parameters",))
    assert "its prior has 10 min." in found.text
    for right in (1.0, -5.1):
        assert not [title for title in findings(correlated(right)) if "lasts for" in title]


def test_a_heater_that_switches_beside_its_thresholds_is_told_by_how_much(run):
    """As where the channel of its sensor reads 2 K too high: temperatures are predicted as that reads."""

    def switching(on, off, known_to=0.2):
        offsets = np.zeros((2, run.windows["test"].sizes["heater"]))
        offsets[:, list(run.windows["test"]["heater"].values).index("battery_heater")] = on, off
        least = np.sign(offsets) * np.maximum(np.abs(offsets) - known_to, 0.0)
        of = ("direction", "heater")
        windows = {
            name: window.assign(threshold_offset=(of, offsets), least_threshold_offset=(of, least))
            for name, window in run.windows.items()
        }
        return dataclasses.replace(run, windows=windows)

    found = about(switching(1.1, 1.4), "battery_heater switches 1.2 K above its thresholds, or more")
    assert (found.state, found.not_for) == ("warn", ("the thresholds of battery_heater",))
    assert about(switching(-1.4, -1.1), "battery_heater switches 1.2 K below its thresholds, or more")
    # One that has a wider band is beside neither.
    for right in ((0.4, 0.3), (-1.4, 1.2)):
        assert not [title for title in findings(switching(*right)) if "its thresholds" in title]
    # A sensor that changes by kelvins between samples does not tell.
    assert not [title for title in findings(switching(1.0, 1.1, known_to=1.2)) if "its thresholds" in title]


def test_a_channel_that_does_not_hold_is_told_with_its_mean_error(run):
    finding = about(one_channel_fails(run), "Intervals do not hold in 1 of 3 channels, worst battery_temperature")
    (words,) = re.findall(
        r"battery_temperature .*?does not hold: .*?; on average ([^,;.]+\.?\d*) K", finding.details[0]
    )
    assert float(words) == pytest.approx(5.0, abs=0.5)
    assert "above the prediction" in finding.details[0]
