"""What `flightcal show` prints of a run, and which folders it refuses."""

import json

import pytest
from typer.testing import CliRunner

from flightcal.cli import USER_ERROR, app
from tests.commands.kept_run import cells_of, change, write_json, write_kept


def show(*arguments, columns=100):
    return CliRunner().invoke(app, ["show", *map(str, arguments)], env={"COLUMNS": str(columns)})


def test_the_verdict_the_parameters_and_the_files_are_printed(tmp_path):
    result = show(write_kept(tmp_path / "run"))
    assert result.exit_code == 0, result.output
    assert "small, run abababababab of 2024-05-02 09:30:00 UTC, flightcal 0.1.0" in result.output
    assert "Use it.\n  Did the sampling converge? ✓ good: Yes [all]\n" in result.output
    run = tmp_path / "run"
    assert f"next: flightcal backtest {run}/scenario.yaml --out {run}/backtest" in " ".join(result.output.split())
    (row,) = (line for line in result.output.splitlines() if "link" in line)
    assert cells_of(row) == ["link, W/K", "0.600", "0.650 [0.590, 0.710]", "[0.550, 0.750]", "97.0%"]
    assert "initial.body" not in result.output
    assert "1 more with --all: noise" in result.output
    assert f"{tmp_path / 'run' / 'calibrated.yaml'}: the scenario with the calibrated numbers" in result.output


def test_every_quantity_is_printed_where_it_is_asked_for(tmp_path):
    assert "initial.body, degC" in show(write_kept(tmp_path / "run"), "--all").output


def test_on_a_narrow_terminal_names_stay_whole_and_the_second_interval_is_below_the_first(tmp_path):
    name = "conductance_of_the_radiator"
    lines = show(write_kept(tmp_path / "run", **{name: 0.7}), "--all", columns=80).output.splitlines()
    (place,) = (k for k, line in enumerate(lines) if name in line)
    assert cells_of(lines[place]) == [f"{name}, W/K", "0.600", "0.700 [0.640, 0.760]", "97.0%"]
    assert cells_of(lines[place + 1]) == ["[0.600, 0.800]"]


def no_folder(run):
    return run / "nowhere"


def a_file(run):
    return run / "metrics.json"


def no_run(run):
    (run.parent / "other").mkdir()
    return run.parent / "other"


def no_verdict(run):
    (run / "verdict.json").unlink()
    return run


def begun_again(run):
    change(run / "provenance.json", stage_inputs={"predict": "x", "results": "x"})
    return run


def a_backtest(run):
    write_json(run / "backtest.json", {})
    return run


def a_check(run):
    write_json(run / "check.json", {})
    return run


def begun_beside_a_check(run):
    write_json(run / "check.json", {})
    change(run / "provenance.json", stage_inputs={"check": "x", "genetic": "x"})
    return run


def damaged(run):
    (run / "parameters.json").write_text("{")
    return run


def of_an_earlier_version(run):
    write_json(run / "parameters.json", [])
    return run


def without_a_field(run):
    content = json.loads((run / "parameters.json").read_text())
    del content["parameters"][0]["mean"]
    write_json(run / "parameters.json", content)
    return run


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (no_folder, "found nothing there, expected the folder of a run"),
        (a_file, "found a file, expected the folder of a run"),
        (no_run, "found no run, expected the folder of a run"),
        (no_verdict, "found an unfinished run (verdict.json is missing), expected a finished one; run the same"),
        (begun_again, "found an unfinished run (stage 'nuts' is missing)"),
        (a_check, "found a check, expected the folder of a run"),
        (begun_beside_a_check, "found an unfinished run (stage 'nuts' is missing)"),
        (a_backtest, "found a backtest, expected the folder of a run"),
        (damaged, "parameters.json: not JSON"),
        (of_an_earlier_version, "parameters.json: found another content"),
        (without_a_field, "parameters.json: found another content"),
    ],
)
def test_what_is_no_finished_run_is_a_message(tmp_path, spoil, message):
    result = show(spoil(write_kept(tmp_path / "run")))
    assert result.exit_code == USER_ERROR
    assert result.exception is None or isinstance(result.exception, SystemExit)
    assert message in result.output


def test_a_run_in_the_folder_of_a_check_is_shown(tmp_path):
    folder = write_kept(tmp_path / "run")
    write_json(folder / "check.json", {})
    change(
        folder / "provenance.json", stage_inputs=dict.fromkeys(("check", "genetic", "nuts", "predict", "results"), "x")
    )
    assert show(folder).exit_code == 0
