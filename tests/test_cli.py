"""What a user sees: help with examples, exit codes, messages in place of tracebacks."""

import dataclasses
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from ruamel.yaml import YAML
from typer.testing import CliRunner

import flightcal
from flightcal import cli
from flightcal.calibration import methods
from flightcal.cli import GATE_FAILED, INTERRUPTED, USER_ERROR, app
from flightcal.simulator.steps import choose_grid
from tests import small
from tests.commands.test_calibrate import write

run = CliRunner().invoke


def test_help_lists_every_command():
    result = run(app, ["--help"])
    assert result.exit_code == 0
    assert all(command in result.output for command in cli.VERBS)


@pytest.mark.parametrize("command", cli.VERBS)
def test_help_of_a_command_has_an_example(command):
    result = run(app, [command, "--help"])
    assert result.exit_code == 0
    assert f"flightcal {command}" in result.output.split("Example:")[1]


def test_the_version_is_that_of_the_package():
    result = run(app, ["--version"])
    assert (result.exit_code, result.output) == (0, f"flightcal {flightcal.__version__}\n")


def test_the_package_lists_what_there_is():
    assert set(dir(flightcal)) == {*flightcal.__all__, "__version__"}
    assert all(getattr(flightcal, name) is not None for name in dir(flightcal))


def test_init_writes_a_scenario_without_findings(tmp_path):
    assert run(app, ["init", str(tmp_path / "mine")]).exit_code == 0
    result = run(app, ["lint", str(tmp_path / "mine" / "scenario.yaml")])
    assert result.exit_code == 0, result.output
    assert "no problems found" in result.output


def test_init_overwrites_nothing(tmp_path):
    (tmp_path / "scenario.yaml").write_text("mine")
    result = run(app, ["init", str(tmp_path)])
    assert result.exit_code == USER_ERROR
    assert (tmp_path / "scenario.yaml").read_text() == "mine"


def test_lint_lists_all_findings_with_their_lines(tmp_path):
    scenario = write(tmp_path)
    text = scenario.read_text()
    scenario.write_text(
        text.replace("3000 J/K", "3000").replace("600 mW/K", "0.6 W").replace("kind: status", "kind: x")
    )
    result = run(app, ["lint", str(scenario)])
    assert result.exit_code == USER_ERROR
    assert result.output.count("scenario.yaml:") == 2
    assert "2 problems found" in result.output


def test_schema_is_a_json_schema():
    result = run(app, ["schema"])
    assert json.loads(result.output)["$schema"].startswith("https://json-schema.org")


def test_simulate_writes_temperatures_beside_the_telemetry(tmp_path):
    out = tmp_path / "out.csv"
    result = run(app, ["simulate", str(write(tmp_path)), "--window", "test", "--set", "power=28", "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "body_temp simulated degC,body_temp measured degC" in out.read_text().splitlines()[0]
    assert "RMSE" in result.output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--set", "pwer=3"], "did you mean 'power'"),
        (["--set", "power=much"], "found 'much', expected a number"),
        (["--window", "tset"], "window 'tset'"),
        (["--telemetry", "nowhere.csv"], "nowhere.csv"),
    ],
)
def test_wrong_arguments_of_simulate_are_messages(tmp_path, arguments, message):
    result = run(app, ["simulate", str(write(tmp_path)), *arguments, "--out", str(tmp_path / "out.csv")])
    assert result.exit_code == USER_ERROR
    assert message in result.output
    assert not (tmp_path / "out.csv").exists()


def test_a_scenario_that_is_missing_is_a_message(tmp_path):
    for arguments in (["lint"], ["simulate"], ["calibrate", "--out", str(tmp_path / "run")]):
        result = run(app, [arguments[0], str(tmp_path / "no.yaml"), *arguments[1:]])
        assert result.exit_code == USER_ERROR
        assert "no.yaml" in result.output
        assert not (tmp_path / "run").exists()


def test_a_failed_gate_has_its_own_exit_code_and_the_report_can_be_written_again(tmp_path, monkeypatch):
    small.unsuspected(monkeypatch)
    scenario = write(tmp_path, nuts={"min_ess": 1e6, "draws": 50, "warmup": 50})
    result = run(app, ["calibrate", str(scenario), "--out", str(tmp_path / "run")])
    assert result.exit_code == GATE_FAILED, result.output
    assert "Do not use it." in result.output
    assert "Did the sampling converge? ✕ problem" in result.output
    again = run(app, ["report", str(tmp_path / "run"), "--out", str(tmp_path / "again.html")])
    assert again.exit_code == 0
    assert (tmp_path / "again.html").stat().st_size > 100_000


@pytest.mark.parametrize("beside", [(), ("scenario.yaml", "telemetry.csv")])
def test_a_report_of_something_that_is_no_run_is_a_message(tmp_path, beside):
    for name in beside:
        (tmp_path / name).touch()
    result = run(app, ["report", str(tmp_path)])
    assert result.exit_code == USER_ERROR
    assert str(tmp_path) in result.output
    assert not (tmp_path / "report.html").exists()


def test_ctrl_c_outside_of_the_sampling_is_a_message(tmp_path, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("flightcal.commands.calibrate.run_experiment", interrupt)
    result = run(app, ["calibrate", str(write(tmp_path)), "--out", str(tmp_path / "run")])
    assert result.exit_code == INTERRUPTED
    assert "takes up where this one stopped" in result.output


INTERRUPTED_AT = """
import os, signal, sys, time
from flightcal import cli
from flightcal.commands import calibrate
from flightcal.errors import RunError

moment, number = sys.argv[1], getattr(signal, sys.argv[2])

def command(*_, **__):
    os.kill(os.getpid(), number)

class Freed:
    def __del__(self):
        command()

def freed(*_, **__):
    Freed()
    time.sleep(90.0)
    raise RunError("an interruption while an object is freed was dropped")

def turned(*_, **__):
    try:
        command()
    except KeyboardInterrupt:
        raise RunError("another error is made of it")

if moment == "parsing":
    cli.app.callback()(lambda: command())
else:
    calibrate.run_experiment = {"command": command, "freed": freed, "turned": turned}[moment]
sys.argv[1:] = ["calibrate", "scenario.yaml", "--out", "run"]
cli.main()
"""


@pytest.mark.parametrize("number", ["SIGINT", pytest.param("SIGTERM", marks=pytest.mark.slow)])
@pytest.mark.parametrize("moment", ["parsing", "command", "freed", "turned"])
def test_an_interruption_has_its_exit_code_whatever_becomes_of_it(tmp_path, moment, number):
    command = [sys.executable, "-c", INTERRUPTED_AT, moment, number]
    began = time.monotonic()
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.returncode == INTERRUPTED, ended.stderr
    assert time.monotonic() - began < 60.0, "it was waited until the work's end"
    assert "Traceback" not in ended.stderr
    assert "was dropped" not in ended.stderr


def test_an_interruption_before_the_first_draw_has_the_exit_code_of_one(tmp_path, monkeypatch):
    sample = methods.sample_problem

    def cut(*given, **named):
        draws = sample(*given, **named)
        return dataclasses.replace(draws, z=draws.z[:, :0], interrupted=True)

    monkeypatch.setattr(methods, "sample_problem", cut)
    small.unsuspected(monkeypatch)
    scenario = write(tmp_path, nuts={"draws": 50, "warmup": 50})
    result = run(app, ["calibrate", str(scenario), "--out", str(tmp_path / "run")])
    assert result.exit_code == INTERRUPTED, result.output
    assert "takes up where this one stopped" in result.output


def test_help_imports_no_numerical_package():
    code = (
        "import sys; from typer.testing import CliRunner; from flightcal.cli import app\n"
        "CliRunner().invoke(app, ['--help'])\n"
        "heavy = {'jax', 'numba', 'numpy', 'scipy', 'xarray', 'pandas', 'plotly'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


def test_the_bundled_scenario_lies_in_the_package():

    folder = Path(cli.__file__).parent / "demo"
    assert {"scenario.yaml", "telemetry.csv"} <= {file.name for file in folder.iterdir()}


@pytest.mark.parametrize(
    ("noise", "advised"), [({"model": "ar1"}, True), ({"model": "ar1", "white": "0.1 K"}, False), ({}, False)]
)
def test_lint_advises_against_correlated_noise_alone_on_a_quantised_channel(tmp_path, noise, advised):
    written = small.content()
    written["noise"] = noise
    small.load(tmp_path, written)
    table = pd.read_csv(tmp_path / "telemetry.csv")
    table["body"] = 0.5 * np.round((12.0 + np.sin(np.arange(len(table)) / 30.0)) / 0.5)
    table.loc[50:57, "sun"] = np.nan
    table.to_csv(tmp_path / "telemetry.csv", index=False)
    result = run(app, ["lint", str(tmp_path / "scenario.yaml")])
    assert result.exit_code == 0, result.output
    words = "advice: observations.body_temp: its samples come in steps of 0.5 K"
    assert (words in result.output) == advised
    assert "panel_temp" not in result.output.split("no problems")[0].split("advice")[-1]
    assert "'sun' drives the simulator and has no sample for 9.0 min" in result.output


@pytest.mark.parametrize("average", [None, "5 min"])
def test_lint_tells_of_a_time_to_leave_out_in_which_no_sample_is(tmp_path, average):
    written = small.content()
    spans = [("2024-03-01T01:00:30", "2024-03-01T01:01:20"), ("2025-03-01T01:00:00", "2025-03-01T01:30:00")]
    written["telemetry"]["channels"]["body_temp"]["leave_out"] = [{"start": span[0], "end": span[1]} for span in spans]
    if average is not None:
        written["telemetry"]["average"] = average
    small.load(tmp_path, written)
    result = run(app, ["lint", str(tmp_path / "scenario.yaml")])
    assert result.exit_code == 0, result.output
    assert result.output.count("advice: telemetry.channels.body_temp: no sample is from 2025-03-01T01:00:00 to") == 1
    assert result.output.count("which 'leave_out' names") == 1


def test_a_full_memory_is_a_message_with_the_size(monkeypatch, tmp_path):
    def too_much(path, **_):
        raise MemoryError("Unable to allocate 447. GiB for an array")

    monkeypatch.setattr("flightcal.scenario.lint", too_much)
    result = run(app, ["lint", str(tmp_path)])
    assert result.exit_code == USER_ERROR
    assert "error: the memory is full: Unable to allocate 447. GiB" in result.output


def test_a_plan_is_simulated_with_its_thermostats(tmp_path):
    content = small.content()
    content["telemetry"]["channels"]["sun"]["fill"] = "previous_orbit"
    content["windows"]["test"] = {"start": "2024-03-01T07:10:00", "end": "2024-03-01T08:40:00", "planned": True}
    small.load(tmp_path, content)
    out = tmp_path / "plan.csv"
    result = run(app, ["simulate", str(tmp_path / "scenario.yaml"), "--window", "test", "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "body_temp: no sample" in result.output
    assert pd.read_csv(out)["heater simulated"].isin([0, 1]).all()


def test_simulate_takes_no_trend_which_would_do_nothing_to_one_window(tmp_path):
    content = small.content()
    content["parameters"]["link"]["trend"] = 0.5
    small.load(tmp_path, content)
    result = run(app, ["simulate", str(tmp_path / "scenario.yaml"), "--set", "trend.link=0.1"])
    assert result.exit_code == USER_ERROR
    assert "--set trend.link=0.1: found unknown parameter 'trend.link'" in result.output


def test_simulate_starts_where_the_scenario_says_or_else_at_the_first_samples(tmp_path):
    def first(edit):
        path = write(tmp_path)
        path.write_text(edit(path.read_text()))
        out = tmp_path / "out.csv"
        done = run(app, ["simulate", str(path), "--out", str(out), *more])
        assert done.exit_code == 0, done.output
        row = pd.read_csv(out).iloc[0]
        return row["body_temp simulated degC"], row["body_temp measured degC"]

    more: list[str] = []
    assert first(lambda text: text.replace("12 degC", "33 degC"))[0] == pytest.approx(33.0, abs=0.01)
    simulated, measured = first(lambda text: text.replace("initial: 12 degC", ""))
    assert simulated == pytest.approx(measured, abs=0.5)
    more = ["--set", "initial.body=300"]
    assert first(lambda text: text)[0] == pytest.approx(26.85, abs=0.01)


def test_simulate_says_of_an_unseen_window_which_nodes_start_where_the_scenario_says(tmp_path):
    def said(*arguments):
        done = run(app, ["simulate", str(write(tmp_path)), *arguments, "--out", str(tmp_path / "out.csv")])
        assert done.exit_code == 0, done.output
        return "starts in every window where 'initial' says: body 12.0 degC" in done.output

    assert said("--window", "test")
    assert not said("--window", "train")


def test_lint_tells_what_is_wrong_with_each_window(tmp_path):
    path = write(tmp_path)
    written = YAML(typ="safe").load(path)
    written["windows"] |= {
        name: {"start": f"2023-0{month}-01T00:00:00", "end": f"2023-0{month}-01T03:00:00"}
        for month, name in enumerate(("january", "february"), start=1)
    }
    YAML(typ="safe").dump(written, path)
    told = run(app, ["lint", str(path)])
    assert told.exit_code == USER_ERROR
    assert [f"2023-0{month}-01" in told.output for month in (1, 2)] == [True, True]


@pytest.mark.parametrize("verb", [["lint"], ["check", "--out", "run"], ["calibrate", "--out", "run"]])
def test_priors_at_which_nothing_can_be_simulated_are_refused_with_the_largest_heat(tmp_path, monkeypatch, verb):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("flightcal.simulator.build.choose_grid", nothing_simulated)
    path = write(tmp_path)
    path.write_text(path.read_text().replace("step: 30 s", "tolerance: 5 mK"))
    done = run(app, [*verb, str(path)])
    assert done.exit_code == USER_ERROR
    said = " ".join(done.output.split())
    assert "windows.train: found no simulation that stays finite at draws of the priors" in said
    assert "the largest heat is up to" in said


def nothing_simulated(inputs, compare, tolerance):
    return choose_grid(inputs, lambda grid, halves: None, tolerance)


def test_a_reader_that_has_had_enough_is_no_error():
    with subprocess.Popen(
        [sys.executable, "-m", "flightcal.cli", "schema"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        process.stdout.close()
        assert process.wait(timeout=120) == 141
        assert process.stderr.read() == ""
