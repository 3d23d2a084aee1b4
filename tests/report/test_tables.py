"""Rows of the report's tables."""

import dataclasses
import math

import numpy as np
import pytest

from flightcal.calibration import Calibrated, PriorScore
from flightcal.report.panels import (
    calibrated,
    convergence,
    heaters,
    parameters,
    provenance,
    reliability,
    residuals,
    scores,
    telemetry,
)
from flightcal.report.style import METHODS
from flightcal.validation import Uniformity, uniformity


def column(table, title):
    return [row[list(table.header).index(title)] for row in table.rows]


def test_every_row_has_a_cell_for_every_column(run):
    made = [
        scores.comparison(run.metrics),
        scores.by_channel(run.metrics),
        scores.all_scores(run.metrics),
        parameters.summary(run),
        heaters.against_telemetry(run.windows),
        heaters.heater_scores(run.metrics),
        residuals.tests_of(run.checks),
        reliability.transforms({name: uniformity(window) for name, window in run.windows.items()}),
        convergence.gates(run.diagnostics),
        telemetry.findings(run.quality),
        provenance.origins(run.provenance, run.integration),
    ]
    for table in made:
        assert table.rows
        assert {len(row) for row in table.rows} == {len(table.header)}
        assert sum(span for _, span in table.groups) in (0, len(table.header))


def test_the_comparison_has_the_papers_ratios_and_says_why_a_score_is_undefined(run):
    table = scores.comparison(run.metrics)
    test = [row for row in table.rows if row[0] == "test"]
    assert [row[5] for row in test] == ["0.753", "0.885", "0.885", "–"]
    assert [row[4] for row in test] == ["0.668 ↓", "0.719 ↓", "–", "0.524 ↓"]
    assert test[2][1] == "MAPE, % of °C\ntelemetry comes within 1 °C of 0 °C"


def test_the_best_genetic_run_stands_beside_the_mean(run):
    table = scores.comparison(run.metrics)
    of = {(m.method, m.window, m.channel, m.metric): m.value for m in run.metrics}
    best, stochastic = (of[method, "test", "all", "rmse"] for method in ("genetic_best", "stochastic"))
    row = next(r for r in table.rows if r[:2] == ["test", "RMSE, K"])
    assert [float(v) for v in row[6:]] == pytest.approx([best, stochastic / best], rel=2e-3)


def test_scores_have_a_row_for_each_window_and_channel_with_all_channels_first(run):
    rows = scores.by_channel(run.metrics).rows
    assert [row[1] for row in rows if row[0] == "test"] == [
        "all", "panel_temperature", "battery_temperature", "payload_temperature",
    ]  # fmt: skip
    assert len(scores.all_scores(run.metrics).rows) == 2 * 4 * len(METHODS)
    assert set(column(scores.by_channel(run.metrics), "GA best")) != {"–"}


def test_parameters_are_shown_with_their_units_and_temperatures_in_celsius(run):
    table = parameters.summary(run)
    threshold = next(row for row in table.rows if row[0].startswith("battery_threshold"))
    assert threshold[0] == "battery_threshold, °C\nsets heaters.battery_heater.on_below"
    assert threshold[2].startswith("10.0")
    assert "normal(283, 1)" in threshold[1]


def test_a_long_list_of_targets_is_cut(run):
    many = dataclasses.replace(run.parameters[0], target=tuple(f"faces.f{k}.emissivity" for k in range(12)))
    table = parameters.summary(dataclasses.replace(run, parameters=[many]))
    assert table.rows[0][0].endswith("sets faces.f0.emissivity, faces.f1.emissivity and 10 more")


def test_contraction_compares_the_deviations_of_prior_and_posterior(run):
    table = parameters.summary(run)
    prior = run.posterior["prior"]["battery_link"].values.std()
    posterior = run.posterior["posterior"]["battery_link"].values.std()
    shown = next(row for row in table.rows if row[0].startswith("battery_link"))[3]
    assert float(shown.rstrip("%")) == pytest.approx(100 * (1 - posterior / prior), abs=0.051)


@pytest.mark.parametrize("passed", [False, True])
def test_an_edge_is_marked_and_a_high_r_hat_where_its_gate_fails(run, passed):
    diagnostics = run.diagnostics | {
        "parameters": [p | {"r_hat": 1.2} if p["name"] == "battery_link" else p for p in run.diagnostics["parameters"]],
        "gates": [{"name": "R-hat", "passed": passed, "found": "", "required": "", "advice": ""}],
    }
    table = parameters.summary(dataclasses.replace(run, diagnostics=diagnostics))
    names = [row[0].split(",")[0].split("\n")[0] for row in table.rows]
    places = [(row, column) for row in range(len(table.rows)) for column in range(len(table.header))]
    states = {place: table.state(*place) for place in places if table.state(*place)}
    disagrees = {} if passed else {(names.index("battery_link"), 4): "bad"}
    assert states == disagrees | {(names.index("payload_capacity"), 2): "warn"}


def test_a_run_without_chains_lists_its_priors(run):
    table = parameters.summary(dataclasses.replace(run, posterior=None, diagnostics=None))
    assert {row[2] for row in table.rows} == {"–"}


def test_heaters_compare_the_posterior_with_telemetry(run):
    table = heaters.against_telemetry({"test": run.windows["test"]})
    window = run.windows["test"]
    duty = 100 * float(window["duty_cycle"].sel(heater="battery_heater").mean())
    assert float(table.rows[0][9].split(" ")[0]) == pytest.approx(duty, rel=1e-3)
    assert column(table, "telemetry within 95%?").count("✓ yes") == 6
    shifted = window.assign(observed_switch_count=window["observed_switch_count"] + 9)
    assert heaters.against_telemetry({"test": shifted}).rows[2][10] == "✕ no"


def test_a_duty_cycle_is_held_to_telemetry_on_the_same_samples_and_the_whole_stands_beside(run):
    window = run.windows["test"]
    gaps = window.assign(
        sampled_duty_cycle=window["sampled_duty_cycle"] + 0.1,
        observed_duty_cycle=window["observed_duty_cycle"] + 0.1,
        unknown_status=window["unknown_status"] + 0.06,
    )
    known, whole = heaters.against_telemetry({"test": gaps}).rows[:2]
    plain = heaters.against_telemetry({"test": window}).rows
    assert (known[2], whole[2]) == ("duty cycle where the status is known, %", "duty cycle of the whole window, %")
    assert (known[10], whole[10]) == ("✓ yes", "–")
    assert whole[3] == "unknown for 6.0%"
    assert whole[9] == plain[1][9] == plain[0][9] != known[9]
    unlike = window.assign(observed_duty_cycle=window["observed_duty_cycle"] + 0.1)
    assert heaters.against_telemetry({"test": unlike}).rows[0][10] == "✕ no"


def test_heaters_compare_every_method_with_telemetry(run):
    table = heaters.against_telemetry({"test": run.windows["test"]})
    assert table.header[3:9] == ("telemetry", "uncal.", "poorly cal.", "GA mean", "GA best", "numbers alone")
    duty = run.windows["test"]["point_duty_cycle"].sel({"by": "genetic_best", "heater": "payload_heater"})
    assert float(table.rows[4][7]) == pytest.approx(100 * float(duty), rel=6e-3)


def test_energy_of_telemetry_is_its_duty_cycle_at_the_simulated_power(run):
    window = run.windows["test"]
    row = heaters.against_telemetry({"test": window}).rows[3]
    expected = float(window["observed_duty_cycle"][0]) * 14.0 * 2 * 5800.0 / 1000
    assert float(row[3]) == pytest.approx(expected, rel=6e-3)


def test_heaters_without_simulations_still_have_telemetry_and_the_genetic_algorithm(run):
    bare = run.windows["test"].drop_dims("simulation")
    rows = heaters.against_telemetry({"test": bare}).rows
    assert {row[9] for row in rows} == {"–"}
    assert np.isfinite([float(row[6]) for row in rows]).all()


def test_a_transform_that_is_not_known_is_not_called_good():
    known = Uniformity("tank", 9, 9.0, 0.1, 0.5)
    table = reliability.transforms({"test": [known, dataclasses.replace(known, p_value=math.nan)]})
    assert [table.state(row, 2) for row in range(2)] == ["good", ""]


@pytest.mark.parametrize(("score", "words"), [(0.26, "mostly the prior"), (2.05, "moved, as wide")])
def test_a_value_that_moved_is_not_mostly_the_prior_however_little_surer_it_became(score, words):
    row = Calibrated("g_bus_bat", "parameter", "W/K", 0.4, 0.207, 0.773, 0.79, 0.79, 0.22, 0.39, 1.19, 0.077)
    moved = calibrated.moved_far([row], {row.name: PriorScore(score)})
    assert str(calibrated.table([row], moved=moved).rows[0][-1]) == f"8%\n{words}"
