"""The stages of the experiment on a small satellite whose telemetry its own model made."""

import dataclasses
import json
import shutil
from io import StringIO
from pathlib import Path

import arviz_stats
import numpy as np
import pandas as pd
import pytest
import xarray
from rich.console import Console
from ruamel.yaml import YAML
from typer.testing import CliRunner

from flightcal.calibration import stages
from flightcal.cli import app
from flightcal.commands.calibrate import run_experiment
from flightcal.commands.display import print_verdict
from flightcal.commands.simulate import simulate_to_csv
from flightcal.errors import FlightcalError, RunError
from flightcal.prediction import simulator_errors
from flightcal.report import write_report
from flightcal.scenario import lint, load_scenario, settable
from tests import small
from tests.told import Told

FILES = {
    "scenario.yaml", "provenance.json", "suspects.json", "telemetry_quality.json", "priors.json",
    "integration.json", "genetic.nc", "posterior.nc", "diagnostics.json", "prediction.nc", "metrics.json",
    "verdict.json", "parameters.json", "parameters.csv", "calibrated.yaml", "best_fit.yaml", "report.html",
    "log.jsonl", "digests.json",
    "run.lock",
}  # fmt: skip


BUILDING = "building the problem (the first time it compiles the simulator)"
TITLES = {
    "suspects": "looking for what may be wrong",
    "compile": "compiling (long only once)",
    "genetic": "genetic algorithm",
    "nuts": "stochastic update (NUTS)",
    "predict": "predicting and scoring",
}


def write(folder: Path, **calibration) -> Path:
    """The small scenario and its telemetry as files; the gates are as easy as a short run can pass."""
    written = small.content()
    written["calibration"]["nuts"] |= {"max_r_hat": 1.5, "min_ess": 5}
    for block, values in calibration.items():
        written["calibration"][block] |= values
    _, data = small.closed_loop(folder, written)
    table = pd.DataFrame(
        {
            "time": np.datetime_as_string(data["time"].values, unit="s"),
            "body": data["body_temp"].values - 273.15,
            "panel": data["panel_temp"].values - 273.15,
            "heater": (data["heater_status"].values > 0.5).astype(int),
            "sun": small.sunlight((data["time"].values - small.START) / np.timedelta64(1, "s")),
        }
    )
    table.to_csv(folder / "telemetry.csv", index=False)
    return folder / "scenario.yaml"


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("small")
    scenario = write(folder)
    return scenario, folder / "run", run_experiment(scenario, folder / "run")


def test_a_run_leaves_all_its_files_and_no_others(finished):
    _, run, summary = finished
    assert {file.name for file in run.iterdir()} == FILES
    assert summary.report == run / "report.html"


def test_metrics_cover_every_method_and_window(finished):
    _, run, summary = finished
    records = json.loads((run / "metrics.json").read_text())
    found = {(record["method"], record["window"]) for record in records if record["metric"] == "rmse"}
    methods = {"uncalibrated", "poorly_calibrated", "genetic", "genetic_best", "calibrated", "stochastic"}
    assert found == {(method, window) for method in methods for window in ("train", "test")}
    assert len(summary.metrics) == len(records)


def test_the_genetic_algorithms_runs_are_scored_together_and_counted(finished):
    _, run, summary = finished
    scores = {(m.method, m.window, m.channel, m.metric): m for m in summary.metrics}
    for channel in ("body_temp", "all"):
        lowest, median, highest = (
            scores["genetic_runs", "test", channel, f"rmse_{name}"].value for name in ("lowest", "median", "highest")
        )
        assert lowest < median < highest
        assert scores["genetic_best", "test", channel, "rmse"].value in (lowest, highest)  # of two runs
    converged = scores["genetic_runs", "train", "all", "converged"]
    assert converged.value == 0  # eight generations are too few
    assert converged.note.startswith("of 2 runs; over 100 generations")
    assert "0 of 2 runs converged" in (run / "report.html").read_text(encoding="utf-8")
    with xarray.open_datatree(run / "prediction.nc") as kept:
        assert not any(str(method).startswith("genetic_run") for method in kept["test"]["by"].values)


def test_the_calibrated_model_predicts_unseen_telemetry_to_its_noise(finished):
    _, _, summary = finished
    rmse = {
        (metric.method, metric.channel): metric.value
        for metric in summary.metrics
        if metric.metric == "rmse" and metric.window == "test"
    }
    # The noise is 0.1 K; with 170 samples its RMSE is known to 5%, and the thresholds leave 5 standard errors.
    assert rmse["stochastic", "body_temp"] < 0.13
    assert rmse["stochastic", "panel_temp"] < 0.13
    assert rmse["uncalibrated", "panel_temp"] > 0.3


def test_a_second_call_runs_no_stage_again(finished):
    scenario, run, first = finished
    before = (run / "posterior.nc").read_bytes()
    told = Told()
    again = run_experiment(scenario, run, progress=told)
    assert told.said == []
    assert list(told.stages) == ["reading telemetry", BUILDING, *TITLES.values(), "writing the report"]
    assert all(told.done_before(title) for title in TITLES.values())
    assert not told.done_before("writing the report")
    assert again.metrics == first.metrics
    assert (run / "posterior.nc").read_bytes() == before


def test_a_changed_setting_runs_its_stage_and_those_after_it(finished, tmp_path):
    run = shutil.copytree(finished[1], tmp_path / "run")
    told = Told()
    run_experiment(write(tmp_path, prediction={"simulations": 30}), run, progress=told)
    assert [told.done_before(TITLES[name]) for name in ("genetic", "nuts", "predict")] == [True, True, False]


def test_the_parameters_are_left_as_tables_with_their_correlations(finished):
    _, run, summary = finished
    content = json.loads((run / "parameters.json").read_text())
    assert content["fixed_numbers"]["within"] == 0.1
    found = {record["name"]: record for record in content["parameters"]}
    assert found.keys() >= {"link", "panel_size", "power", "noise.body_temp", "initial.body"}
    draws = xarray.open_datatree(run / "posterior.nc")["posterior"]
    link, body = draws["link"].values, draws["initial.body"].values
    assert found["link"]["mean"] == pytest.approx(link.mean())
    assert found["link"]["lower"] == pytest.approx(np.quantile(link, 0.025))
    assert found["link"]["unit"] == "W/K"
    assert found["link"]["before"] == pytest.approx(0.6)
    assert found["link"]["from_data"] > 0.99
    assert (found["initial.body"]["unit"], found["initial.body"]["mean"]) == (
        "degC",
        pytest.approx(body.mean() - 273.15),
    )
    names = content["correlation"]["names"]
    expected = np.corrcoef(link.ravel(), body.ravel())[0, 1]
    assert content["correlation"]["matrix"][names.index("link")][names.index("initial.body")] == pytest.approx(expected)
    table = pd.read_csv(run / "parameters.csv").set_index("name")
    assert list(table.index) == names
    assert table.loc["power", "mean"] == pytest.approx(found["power"]["mean"], rel=1e-5)
    assert [parameter.name for parameter in summary.parameters] == names


def test_the_calibrated_scenario_runs_as_it_is(finished, tmp_path):
    """Its simulation fits the telemetry to the noise, which is 0.1 K; that of the scenario does not."""
    scenario, run, _ = finished
    calibrated = run / "calibrated.yaml"
    assert [finding for finding in lint(calibrated) if not finding.warning] == []
    lines = calibrated.read_text().splitlines()
    identity = json.loads((run / "provenance.json").read_text())["identity"]
    assert lines[0].startswith("# Calibrated by flightcal")
    assert identity[:12] in lines[0]
    assert lines[1].startswith("# Verdict: ")
    numbers = settable(load_scenario(calibrated))
    means = {r["name"]: r["mean"] for r in json.loads((run / "parameters.json").read_text())["parameters"]}
    assert numbers["conductors.body-panel.conductance"].value == pytest.approx(means["link"], rel=1e-5)
    assert numbers["loads.sun.coefficient"].value == pytest.approx(12.0 * means["panel_size"], rel=1e-5)
    before, after = (
        float(simulate_to_csv(file, "train", [], tmp_path / "out.csv")[1].split("RMSE ")[1].split(" K")[0])
        for file in (scenario, calibrated)
    )
    assert before > 0.3
    assert after < 0.12


@pytest.mark.parametrize(("file", "method"), [("calibrated.yaml", "calibrated"), ("best_fit.yaml", "genetic_best")])
def test_what_numbers_alone_are_worth_is_that_of_a_simulation_of_their_file_and_told(finished, tmp_path, file, method):
    _, run, summary = finished
    scores = {(m.method, m.window, m.channel): m.value for m in summary.metrics if m.metric == "rmse"}
    simulated = simulate_to_csv(run / file, "train", [], tmp_path / "out.csv")
    for channel in ("body_temp", "panel_temp"):
        (line,) = (line for line in simulated if line.startswith(f"{channel}: RMSE "))
        assert float(line.split()[2]) == pytest.approx(scores[method, "train", channel], abs=1.5e-3)
    (error,) = simulator_errors(summary.metrics)
    methods = ("uncalibrated", "calibrated", "genetic_best", "stochastic")
    found = (error.window, error.before, error.calibrated, error.best_fit, error.predicted)
    assert found == ("test", *(scores[one, "test", "all"] for one in methods))
    assert f"# {error}\n" in (run / file).read_text()
    shown = CliRunner().invoke(app, ["show", str(run)], env={"COLUMNS": "300"})
    assert str(error) in shown.output
    assert f"{run / file}: the scenario with" in " ".join(shown.output.split())


def test_draws_are_what_arviz_reads(finished):
    _, run, _ = finished
    tree = xarray.open_datatree(run / "posterior.nc")
    summary = arviz_stats.summary(tree, var_names=["link"])
    assert float(summary.loc["link", "mean"]) == pytest.approx(float(tree["posterior"]["link"].mean()), abs=0.01)


@pytest.mark.parametrize("name", ["posterior.nc", "genetic.nc", "prediction.nc"])
def test_every_array_that_is_written_says_its_unit_and_what_it_is(finished, name):
    _, run, _ = finished
    for group in xarray.open_datatree(run / name).subtree:
        dataset = group.to_dataset()
        for variable in dataset.variables:
            attributes = dataset[variable].attrs
            assert "long_name" in attributes, (group.path, variable)
            is_plain = variable in dataset.coords or dataset[variable].dtype.kind in "OSUM"
            assert is_plain or attributes["units"], (group.path, variable)


def test_what_a_run_leaves_is_shown_in_the_terminal_and_in_notebooks(finished):
    _, run, summary = finished
    shown = CliRunner().invoke(app, ["show", str(run)], env={"COLUMNS": "100"})
    assert shown.exit_code == 0, shown.output
    console = Console(file=StringIO(), width=100)
    print_verdict(summary.verdict.record, summary.run, console)
    assert console.file.getvalue() in shown.output
    assert repr(summary).startswith(f"<Summary of {run}: {summary.verdict.use} ")
    assert len(repr(summary)) < 400
    page = summary._repr_html_()
    assert f"<b>{summary.verdict.use}</b>" in page
    assert "<td>link</td><td>W/K</td><td>0.6 [0.3588, 1.003]</td>" in page
    assert "initial.body" not in page


def with_windows(scenario: Path, **windows) -> Path:
    """The scenario with other windows."""
    content = YAML(typ="safe").load(scenario)
    content["windows"] |= windows
    with scenario.open("w") as file:
        YAML(typ="safe").dump(content, file)
    return scenario


LATER = {"start": "2024-03-01T04:00:00", "end": "2024-03-01T05:00:00"}
SHORTER = {"start": "2024-03-01T00:30:00", "end": "2024-03-01T03:00:00"}


def test_a_window_to_predict_can_be_added_to_a_finished_run(finished, tmp_path):
    scenario, run, first = finished
    shutil.copytree(run, tmp_path / "run")
    for file in ("scenario.yaml", "telemetry.csv"):
        shutil.copy(scenario.parent / file, tmp_path)
    told = Told()
    second = run_experiment(with_windows(tmp_path / "scenario.yaml", later=LATER), tmp_path / "run", progress=told)
    found = {name: told.done_before(title) for name, title in TITLES.items()}
    assert found == {"suspects": True, "compile": True, "genetic": True, "nuts": True, "predict": False}
    assert {metric.window for metric in second.metrics} == {"train", "test", "later"}
    assert {metric for metric in second.metrics if metric.window != "later"} == set(first.metrics)
    assert "later" in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")


def test_a_window_without_telemetry_leaves_a_finished_run_as_it_was(finished, tmp_path):
    scenario, run, _ = finished
    shutil.copytree(run, tmp_path / "run")
    for file in ("scenario.yaml", "telemetry.csv"):
        shutil.copy(scenario.parent / file, tmp_path)
    before = {file: file.stat().st_mtime_ns for file in (tmp_path / "run").rglob("*")}
    beyond = {"start": "2024-04-01T00:30:00", "end": "2024-04-01T03:00:00"}
    with pytest.raises(FlightcalError, match=r"planned.*found no telemetry"):
        run_experiment(with_windows(tmp_path / "scenario.yaml", planned=beyond), tmp_path / "run")
    assert {file: file.stat().st_mtime_ns for file in (tmp_path / "run").rglob("*")} == before


def test_telemetry_that_has_grown_is_predicted_by_a_finished_run(finished, tmp_path):
    """Two hours more; then a sample that was trained on is another."""
    scenario, run, first = finished
    shutil.copytree(run, tmp_path / "run")
    shutil.copy(scenario, tmp_path)
    table = pd.read_csv(scenario.parent / "telemetry.csv")
    more = table.iloc[:120].copy()
    step = pd.Timestamp(table["time"][1]) - pd.Timestamp(table["time"][0])
    last = pd.Timestamp(table["time"].iloc[-1])
    more["time"] = [str(np.datetime64(last + (k + 1) * step, "s")) for k in range(len(more))]
    grown = pd.concat([table, more], ignore_index=True)
    grown.to_csv(tmp_path / "telemetry.csv", index=False)
    later = {"start": str(more["time"].iloc[5]), "end": str(more["time"].iloc[-1])}
    told = Told()
    second = run_experiment(with_windows(tmp_path / "scenario.yaml", later=later), tmp_path / "run", progress=told)
    found = {name: told.done_before(title) for name, title in TITLES.items()}
    assert found == {"suspects": False, "compile": True, "genetic": True, "nuts": True, "predict": False}
    assert {metric.window for metric in second.metrics} == {"train", "test", "later"}
    assert second.parameters == first.parameters

    grown.loc[10, "body"] += 1.0
    grown.to_csv(tmp_path / "telemetry.csv", index=False)
    with pytest.raises(RunError, match=r"what differs: the telemetry of the windows to train on\)"):
        run_experiment(tmp_path / "scenario.yaml", tmp_path / "run")


def test_another_window_to_train_on_is_refused_with_its_reason(finished, tmp_path):
    scenario, run, _ = finished
    for file in ("scenario.yaml", "telemetry.csv"):
        shutil.copy(scenario.parent / file, tmp_path)
    with pytest.raises(RunError, match="what differs: the windows to train on, "):
        run_experiment(with_windows(tmp_path / "scenario.yaml", train=SHORTER), run)


def test_the_folder_of_an_earlier_flightcal_is_refused_with_what_to_do_and_can_still_be_reported(finished, tmp_path):
    scenario, run, _ = finished
    shutil.copytree(run, tmp_path / "run")
    file = tmp_path / "run" / "provenance.json"
    provenance = json.loads(file.read_text())
    del provenance["parts"]
    file.write_text(json.dumps(provenance))
    (tmp_path / "run" / "digests.json").unlink()
    with pytest.raises(RunError, match="an earlier flightcal, which cannot be taken up; choose another --out"):
        run_experiment(scenario, tmp_path / "run")
    assert write_report(tmp_path / "run").stat().st_size > 100_000


def test_another_scenario_is_refused_and_nothing_changes(finished, tmp_path):
    _, run, _ = finished
    scenario = write(tmp_path)
    content = YAML(typ="safe").load(scenario)
    content["simulator"]["nodes"]["body"]["capacity"] = "3100 J/K"
    with scenario.open("w") as file:
        YAML(typ="safe").dump(content, file)
    before = {file.name: file.read_bytes() for file in run.iterdir()}
    with pytest.raises(RunError, match="another scenario"):
        run_experiment(scenario, run)
    assert {file.name: file.read_bytes() for file in run.iterdir()} == before


def test_a_moved_scenario_with_another_comment_is_the_same_run_and_its_calibrated_text_is_made_anew(finished, tmp_path):
    scenario, run, _ = finished
    shutil.copytree(run, tmp_path / "run")
    shutil.copy(scenario.parent / "telemetry.csv", tmp_path)
    (tmp_path / "scenario.yaml").write_text("# A comment that stays.\n" + scenario.read_text())
    told = Told()
    run_experiment(tmp_path / "scenario.yaml", tmp_path / "run", progress=told)
    assert all(told.done_before(TITLES[name]) for name in ("nuts", "predict"))
    text = (tmp_path / "run" / "calibrated.yaml").read_text()
    assert "# A comment that stays.\n" in text
    assert str(tmp_path / "telemetry.csv") in text


def test_a_failed_gate_fails_the_summary_and_saves_everything(tmp_path, monkeypatch):
    small.unsuspected(monkeypatch)
    summary = run_experiment(write(tmp_path, nuts={"min_ess": 1e6}), tmp_path / "run")
    assert not summary.passed
    assert "effective draws" in summary.diagnostics["verdict"]
    assert {file.name for file in summary.run.iterdir()} == FILES


def test_interrupted_sampling_is_saved_reported_and_taken_up_again(tmp_path, monkeypatch):
    scenario, run = write(tmp_path), tmp_path / "run"
    small.unsuspected(monkeypatch)
    whole = stages.calibrate_nuts

    def cut_short(*arguments, **options):
        posterior = whole(*arguments, **options)
        draws = posterior.draws
        cut = dataclasses.replace(
            draws,
            z=draws.z[:, :40],
            statistics={name: values[:, :40] for name, values in draws.statistics.items()},
            interrupted=True,
        )
        return dataclasses.replace(posterior, theta=posterior.theta[:, :40], draws=cut)

    monkeypatch.setattr(stages, "calibrate_nuts", cut_short)
    summary = run_experiment(scenario, run)
    assert summary.interrupted
    assert not summary.passed
    assert {file.name for file in run.iterdir()} == FILES
    monkeypatch.undo()
    told = Told()
    summary = run_experiment(scenario, run, progress=told)
    assert told.done_before(TITLES["genetic"])
    assert not told.done_before(TITLES["nuts"])
    assert not told.done_before(TITLES["predict"])
    assert not summary.interrupted


def test_a_genetic_algorithm_that_is_taken_over_is_that_which_would_be_run(finished, tmp_path, monkeypatch):
    small.unsuspected(monkeypatch)
    scenario, run, _ = finished
    content = YAML(typ="safe").load(scenario)
    other = scenario.with_name("other.yaml")
    with other.open("w") as file:
        YAML(typ="safe").dump(content | {"noise": {"model": "ar1"}}, file)

    run_experiment(other, tmp_path / "run")

    taken, computed = (
        xarray.load_dataset(folder / "genetic.nc", engine="h5netcdf") for folder in (run, tmp_path / "run")
    )
    xarray.testing.assert_identical(taken, computed)
