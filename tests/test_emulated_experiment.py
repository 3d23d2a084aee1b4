"""The experiment on a simulator without derivatives: a Python function of two unknowns that crashes in a corner."""

import json
import textwrap

import numpy as np
import pandas as pd
import pytest
import xarray

from flightcal.commands.calibrate import run_experiment
from flightcal.emulation import active
from flightcal.scenario import NutsSettings
from tests.external import scenes
from tests.told import Told
from tests.workers import close_workers

PROGRAM = """
import numpy as np

def simulate(inputs, times, start):
    if inputs["link"] > 1.5:
        raise RuntimeError("the link is too strong")
    battery = 293.15 + 2 * inputs["load"] * np.exp(-inputs["link"] * times / 900)
    return np.stack([battery, 280.0 + inputs["load"] * np.tanh(inputs["link"] * times / 900)], axis=1)
"""
TRAIN = {"start": "2024-03-01T00:00:00", "end": "2024-03-01T00:31:00"}
LATER = {"start": "2024-03-01T00:40:00", "end": "2024-03-01T01:10:00"}
TRUTH = {"link": 0.8, "load": 5.0}
EMULATOR_FILES = {
    "training_runs.nc", "emulator.json", "check_runs.nc", "emulator_check.json", "training_runs_later.nc",
    "emulator_later.json",
}  # fmt: skip

BUILDING = "building the problem (the first time it compiles the simulator)"


def written(folder, windows, runs, predicted=40):
    """A scenario of which the telemetry was made by its own simulator from the start of each window of minutes."""
    (folder / "model.py").write_text(textwrap.dedent(PROGRAM))
    content = scenes.written(
        {"callable": {"file": "model.py"}},
        windows=windows,
        calibration={
            "seed": 2,
            "emulator": {"runs": runs, "start": runs // 4},
            "genetic": {"runs": 2, "population": 16, "generations": 8},
            "nuts": {"chains": 2, "draws": 200, "warmup": 100, "max_r_hat": 1.5, "min_ess": 5},
            "prediction": {"simulations": predicted, "initial_span": "5 min"},
        },
    )
    scenario = scenes.write(folder, content)
    names: dict[str, object] = {}
    exec(PROGRAM, names)
    table = pd.read_csv(folder / "telemetry.csv")
    rng = np.random.default_rng(4)
    for first, last in ((0, 31), (40, 71)):
        made = names["simulate"](TRUTH, 60.0 * np.arange(last - first), None) - 273.15
        made += 0.1 * rng.standard_normal(made.shape)
        table.loc[first : last - 1, ["battery", "radiator"]] = made
    table.to_csv(folder / "telemetry.csv", index=False)
    return scenario


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("emulated")
    scenario = written(folder, {"later": LATER}, 80)
    told = Told()
    with pytest.MonkeyPatch.context() as patch:
        # Fewer draws between rounds; the end is sampled as the scenario says.
        patch.setattr(active, "_NUTS", NutsSettings(chains=4, draws=150, warmup=100))
        summary = run_experiment(scenario, folder / "run", progress=told)
    yield scenario, folder / "run", summary, told
    close_workers()


def test_the_posterior_is_near_the_truth_and_the_budget_is_kept(finished):
    _, run, summary, _ = finished
    found = {record["name"]: record for record in summary.diagnostics["parameters"]}
    for name, truth in TRUTH.items():
        assert abs(found[name]["mean"] - truth) < 4.0 * found[name]["sd"]
        assert found[name]["sd"] < 0.1
    record = json.loads((run / "emulator.json").read_text())
    assert record["reached"]
    with xarray.open_dataset(run / "training_runs.nc", engine="h5netcdf") as runs:
        assert runs.sizes["run"] == record["runs"] <= 60
        failed = runs["outcome"].values != "finished"
        assert (failed == (runs["theta"].sel(parameter="link").values > 1.5)).all()
        assert failed.sum() == record["failed"] > 0
    assert "'link' above" in record["failures"]


def test_the_simulator_itself_has_the_last_word(finished):
    _, run, summary, _ = finished
    gates = {gate["name"]: gate for gate in summary.diagnostics["gates"]}
    assert gates["Emulator's error"]["passed"]
    assert gates["Emulator against simulator"]["passed"]
    assert summary.passed
    check = json.loads((run / "emulator_check.json").read_text())
    assert check["runs"] == 20
    assert check["channels"][-1]["worst"] < 0.05


def test_rounds_are_told_and_kept(finished):
    _, run, _, told = finished
    log = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    learning = [record["text"] for record in log if record["event"] == "said"]
    assert [line for line in told.said if not line.startswith("not looked for: wrong heaters")] == learning
    assert len(told.said) == len(learning) + 1
    assert learning[2].startswith("round 0: 20 runs")
    assert set(told.stages) == {
        "reading telemetry", BUILDING, "looking for what may be wrong", "learning an emulator", "genetic algorithm",
        "stochastic update (NUTS)",
        "predicting and scoring", "writing the report",
    }  # fmt: skip
    assert {file.name for file in run.iterdir()} >= EMULATOR_FILES


def test_an_unseen_window_is_predicted_with_its_own_runs(finished):
    _, run, summary, _ = finished
    picp = {
        m.window: m.value for m in summary.metrics if (m.metric, m.channel, m.method) == ("picp", "all", "stochastic")
    }
    assert picp["later"] > 0.8
    with xarray.open_datatree(run / "prediction.nc", engine="h5netcdf") as tree:
        later = tree["later"].to_dataset()
        assert "the surrogate's error" in later.attrs["interval_contains"]
        assert np.isfinite(later["mean"].sel(by="uncalibrated")).all()


def test_the_report_has_a_passage_on_the_emulator(finished):
    page = (finished[1] / "report.html").read_text(encoding="utf-8")
    assert '<section id="emulator">' in page
    assert "error no longer matters" in page
    assert "The simulator itself at the posterior" in page


def test_nothing_is_run_twice(finished):
    scenario, run, summary, _ = finished
    before = (run / "training_runs.nc").stat().st_mtime_ns
    told = Told()
    again = run_experiment(scenario, run, progress=told)
    again_made = {title for title in told.stages if not told.done_before(title)}
    assert again_made == {"reading telemetry", BUILDING, "writing the report"}
    assert (run / "training_runs.nc").stat().st_mtime_ns == before
    assert again.metrics == summary.metrics


@pytest.mark.slow
def test_several_windows_are_trained_on_together(tmp_path):
    scenario = written(tmp_path, {"train": {"a": TRAIN, "b": LATER}}, 120, predicted=20)
    run = tmp_path / "run"
    summary = run_experiment(scenario, run)
    assert summary.passed
    found = {record["name"]: record for record in summary.diagnostics["parameters"]}
    for name, truth in TRUTH.items():
        assert abs(found[name]["mean"] - truth) < 4.0 * found[name]["sd"]
    record = json.loads((run / "emulator.json").read_text())
    counts = []
    for window, fitted in zip(("train.a", "train.b"), record["fitted"], strict=True):
        with xarray.open_dataset(run / f"training_runs_{window}.nc", engine="h5netcdf") as runs:
            counts.append(runs.sizes["run"])
            assert max(fitted) < runs.sizes["run"]
        with xarray.open_dataset(run / f"check_runs_{window}.nc", engine="h5netcdf") as runs:
            assert runs.sizes["run"] == 20
    assert counts[0] == counts[1]
    assert sum(counts) == record["runs"] <= 80
    check = json.loads((run / "emulator_check.json").read_text())
    assert check["runs"] == 40
    assert [channel["channel"] for channel in check["channels"]] == [
        *(f"{label}: {channel}" for label in "ab" for channel in ("battery_temp", "radiator_temp", "all")), "all",
    ]  # fmt: skip
    assert {metric.window for metric in summary.metrics} == {"train.a", "train.b"}
    assert not list(run.glob("emulator_train*"))
    again = Told()
    run_experiment(scenario, run, progress=again)
    assert again.done_before("learning an emulator")
    assert again.done_before("predicting and scoring")
    close_workers()
