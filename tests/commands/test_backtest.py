"""`flightcal backtest` on the small satellite: what it leaves, that it resumes, that it knows no temperature ahead."""

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from flightcal.calibration import LINEAR
from flightcal.cli import GATE_FAILED, MODEL_FAILED, USER_ERROR, app
from flightcal.commands.backtest import backtest_scenario
from flightcal.errors import RunError
from flightcal.report import write_backtest
from flightcal.run import read_tree
from flightcal.validation.horizon import BANDS
from tests.commands.test_calibrate import write
from tests.external import scenes
from tests.told import Told

run = CliRunner().invoke


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("backtest")
    file = write(folder, prediction={"simulations": 200})
    return file, folder / "run", backtest_scenario(file, folder / "run", 2, train="1.5 h", horizon="2 orbits")


def test_a_backtest_leaves_its_records_its_predictions_and_a_page(finished):
    _, out, found = finished
    assert {file.name for file in out.iterdir()} == {
        "scenario.yaml", "provenance.json", "log.jsonl", "origins", "backtest.json", "backtest.nc", "report.html",
        "digests.json", "run.lock",
    }  # fmt: skip
    content = json.loads((out / "backtest.json").read_text())
    assert content == found.content
    assert [origin["origin"] for origin in content["origins"]] == ["2024-03-01T01:29:00", "2024-03-01T05:31:00"]
    assert {score["band"] for score in content["scores"]} == {*BANDS, "all"}
    tree = read_tree(out / "backtest.nc")
    assert list(tree.children) == [origin["name"] for origin in content["origins"]]
    assert found.report == out / "report.html"


def test_a_right_model_holds_and_its_errors_are_its_noise(finished):
    content = finished[2].content
    assert content["holds"]
    whole = next(score for score in content["scores"] if score["origin"] == score["band"] == "all" == score["channel"])
    assert whole["rmse"] < 0.2
    assert whole["coverage"] > 0.85
    assert [duty["heater"] for duty in content["duty"]] == ["heater", "heater"]


def test_measured_drivers_are_named(finished):
    _, out, found = finished
    assert found.content["measured"] == ["sun"]
    assert "Measured drivers: these predictions are not forecasts" in (out / "report.html").read_text(encoding="utf-8")


def test_the_page_has_its_pictures(finished):
    _, out, found = finished
    page = (out / "report.html").read_text(encoding="utf-8")
    assert f"Intervals held after {found.content['held']} of 2 origins" in page
    assert len(re.findall(r'class="plot" id="(figure-\d+)"', page)) == 3
    assert "Did intervals hold tomorrow?" in page


def test_the_page_says_before_which_origins_the_response_to_heat_is_not_linear(finished, tmp_path):
    _, out, found = finished
    shutil.copytree(out, tmp_path / "run")
    gates = ("", LINEAR)
    origins = [
        origin | {"passed": True, "failed_gates": gate}
        for origin, gate in zip(found.content["origins"], gates, strict=True)
    ]
    (tmp_path / "run" / "backtest.json").write_text(json.dumps(found.content | {"origins": origins}))
    page = write_backtest(tmp_path / "run").read_text(encoding="utf-8")
    assert "The response to heat is not linear before 1 of 2 origins" in page
    assert "The sampling failed a gate" not in page


def test_report_writes_the_page_of_a_backtest_again(finished, tmp_path):
    _, out, _ = finished
    result = run(app, ["report", str(out), "--out", str(tmp_path / "page.html")])
    assert result.exit_code == 0
    assert "flightcal backtest" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_origins_that_are_done_are_not_run_again(finished, tmp_path):
    file, out, first = finished
    copy = tmp_path / "copy"
    shutil.copytree(out, copy)
    told = Told()
    again = backtest_scenario(file, copy, 2, train="1.5 h", horizon="2 orbits", progress=told)
    assert again.content == first.content
    assert told.done_before("origin 1 of 2, 2024-03-01 01:29")
    assert told.done_before("origin 2 of 2, 2024-03-01 05:31")
    assert any(line.startswith("2 origins, each a calibration on 1 orbits") for line in told.said)
    assert any(re.match(r"origin 1 took \d s; one is left, about \d s", line) for line in told.said)


def test_no_temperature_after_an_origin_but_those_of_the_first_minutes_counts(finished, tmp_path):
    file, out, _ = finished
    lines = (file.parent / "telemetry.csv").read_text().splitlines()
    heading = lines[0].split(",")
    changed = lines[:1]
    # The first origin stands at 89 min, and its first ten minutes are used.
    for minute, line in enumerate(lines[1:]):
        cells = line.split(",")
        for name in ("body", "panel"):
            cells[heading.index(name)] = str(float(cells[heading.index(name)]) + (25.0 if minute > 99 else 0.0))
        changed.append(",".join(cells))
    shutil.copy(file, tmp_path / "scenario.yaml")
    (tmp_path / "telemetry.csv").write_text("\n".join(changed) + "\n")
    backtest_scenario(tmp_path / "scenario.yaml", tmp_path / "run", 1, train="1.5 h", horizon="2 orbits")
    name = "origin_20240301T012900"
    before, after = (read_tree(folder / "backtest.nc")[name].to_dataset() for folder in (out, tmp_path / "run"))
    assert np.abs(before["observed"] - after["observed"]).max() == pytest.approx(25.0, abs=1e-3)
    for variable in ("mean", "lower", "upper"):
        np.testing.assert_allclose(before[variable], after[variable], rtol=0, atol=1e-9)


def test_a_failed_gate_and_intervals_that_do_not_hold_have_exit_codes_of_their_own(finished, monkeypatch):
    file, out, found = finished
    arguments = ["backtest", str(file), "--out", str(out), "--origins", "2", "--train", "1.5 h"]
    result = run(app, [*arguments, "--horizon", "2 orbits"])
    assert f"Intervals held after {found.content['held']} of 2 origins" in result.output
    for passed, holds, code in ((True, True, 0), (False, True, GATE_FAILED), (True, False, MODEL_FAILED)):
        content = found.content | {"passed": passed, "holds": holds}
        monkeypatch.setattr(
            "flightcal.commands.backtest.backtest_scenario",
            lambda *_, content=content, **__: replace(found, content=content),
        )
        assert run(app, [*arguments, "--horizon", "2 orbits"]).exit_code == code


@pytest.mark.parametrize("length", ["two", "1e9 h"])
def test_a_length_that_is_none_is_a_message(tmp_path, length):
    result = run(app, ["backtest", str(write(tmp_path)), "--out", str(tmp_path / "out"), "--train", length])
    assert result.exit_code == USER_ERROR
    assert f"--train: found '{length}', expected a length of time such as '2 orbits' or '3 h'" in result.output
    assert not (tmp_path / "out").exists()


def test_a_simulator_without_derivatives_is_refused_before_anything_is_made(tmp_path):
    out, told = tmp_path / "out", Told()
    with pytest.raises(RunError, match="without derivatives"):
        backtest_scenario(without_derivatives(tmp_path), out, progress=told)
    assert (told.said, [*told.stages]) == ([], ["reading telemetry"])
    assert not out.exists()


def without_derivatives(folder):
    """A scenario around a function that gives no gradient, and is not run."""
    (folder / "model.py").write_text("def simulate(inputs, times, start): ...\n", encoding="utf-8")
    return scenes.write(folder, scenes.written({"callable": {"file": "model.py"}}))
