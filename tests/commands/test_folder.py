import shutil
from pathlib import Path

import pytest

from flightcal.commands.folder import open_for, parameter_records
from flightcal.errors import RunError
from flightcal.problem import build_problem
from flightcal.progress import Silent
from flightcal.scenario import load_scenario
from flightcal.telemetry import read
from tests import small


def taken(scenario, folder, *trained, **more):
    """Open a run's folder and leave a result in it, without which it would belong to none."""
    with open_for(scenario, folder, Silent(), *trained, **more) as run:
        run.folder.write_json("result.json", {})


def open_with(folder, **blocks):
    """Take the folder `folder`/run for the scenario without heat and noise, but for `blocks`."""
    written = small.content()
    written.pop("heat", None)
    taken(small.load(folder, written | blocks)[0], folder / "run")


def test_a_block_that_is_left_out_is_the_same_as_what_it_means(tmp_path):
    open_with(tmp_path)

    open_with(tmp_path, heat={})


def test_a_run_without_heat_is_another_than_one_with_it(tmp_path):
    open_with(tmp_path, heat="none")

    with pytest.raises(RunError, match="what differs: the scenario"):
        open_with(tmp_path, heat={})


def test_written_noise_is_another_than_that_beside_heat(tmp_path):
    open_with(tmp_path, heat={})

    with pytest.raises(RunError, match="what differs: the scenario"):
        open_with(tmp_path, heat={}, noise={})


def test_records_say_which_initial_temperatures_a_channel_sees(tmp_path):
    written = small.content()
    written["simulator"]["nodes"]["inside"] = {"capacity": "500 J/K", "initial": "5 degC"}
    written["simulator"]["conductors"].append({"between": ["inside", "body"], "conductance": "0.2 W/K"})
    records = parameter_records(build_problem(*small.load(tmp_path, written)))
    assert {record["name"]: record["observed"] for record in records if record["kind"] == "initial"} == {
        "initial.body": True,
        "initial.panel": True,
        "initial.inside": False,
    }
    assert all(record["observed"] for record in records if record["kind"] != "initial")


def test_a_folder_is_that_of_one_command(tmp_path):
    scenario = small.load(tmp_path)[0]
    taken(scenario, tmp_path / "run")
    with pytest.raises(RunError, match="what differs: the command"):
        taken(scenario, tmp_path / "run", more={"the command": "backtest"})


def test_where_the_files_of_packets_lie_is_nothing_to_a_run(tmp_path):
    written = small.content()
    telemetry = written["telemetry"]
    telemetry["packets"] = {"all": {"file": telemetry.pop("file"), "time": telemetry.pop("time")}}
    for channel in telemetry["channels"].values():
        channel["packet"] = "all"
    for name in ("here", "there"):
        (tmp_path / name).mkdir()
        taken(small.load(tmp_path / name, written)[0], tmp_path / "run")


def test_changes_of_mode_after_the_windows_to_train_on_are_nothing_to_a_run(tmp_path):
    """Nor are times of which later samples are left out; earlier changes are."""

    def opened(*timeline, leave_out=()):
        written = small.content()
        written["simulator"] |= {
            "modes": {"quiet": {"body": "1 W"}, "busy": {"body": "3 W"}},
            "timeline": [{"at": at, "mode": mode} for at, mode in timeline],
        }
        written["telemetry"]["channels"]["body_temp"]["leave_out"] = list(leave_out)
        scenario, data = small.load(tmp_path, written)
        taken(scenario, tmp_path / "run", data)

    before, later = ("2024-03-01T00:00:00", "quiet"), ("2024-03-01T05:00:00", "busy")
    opened(before)
    opened(before, later, leave_out=[{"start": "2024-03-01T06:00:00", "end": "2024-03-01T06:01:00"}])
    with pytest.raises(RunError, match=r"what differs: the scenario: simulator\.timeline\)"):
        opened(before, ("2024-03-01T01:00:00", "busy"))
    with pytest.raises(RunError, match="what differs: the telemetry of the windows to train on"):
        opened(before, leave_out=[{"start": "2024-03-01T01:00:00", "end": "2024-03-01T01:10:00"}])


def test_what_reads_later_telemetry_otherwise_is_nothing_to_a_run_and_what_else_differs_is_named(tmp_path):
    """So a sensor that dies after the windows to train on is left out without a new calibration."""

    def opened(body=(), **simulator):
        written = small.content()
        written["telemetry"]["channels"]["body_temp"] |= dict(body)
        written["simulator"] |= simulator
        scenario, data = small.load(tmp_path, written)
        taken(scenario, tmp_path / "run", data)

    opened()
    opened({"invalid": [-999.0], "valid_range": ["-80 degC", "90 degC"], "stale_after": 20, "limits": ["0 degC", None]})
    modes = {"modes": {"quiet": {"body": "1 W"}}, "timeline": [{"at": "2024-03-01T00:00:00", "mode": "quiet"}]}
    with pytest.raises(RunError, match=r"what differs: the scenario: simulator\.modes\.quiet, simulator\.timeline\)"):
        opened(**modes)


def test_a_file_of_the_simulators_that_has_changed_is_named(tmp_path):
    example = Path(__file__).parents[2] / "examples" / "executable"
    shutil.copytree(example, tmp_path / "own")
    scenario = load_scenario(tmp_path / "own" / "scenario.yaml")
    data = read(scenario)
    taken(scenario, tmp_path / "run", data)
    template = tmp_path / "own" / "input.json.jinja"
    template.write_text(template.read_text() + "\n", encoding="utf-8")
    with pytest.raises(RunError, match=rf"\(what differs: the other input files: {template.name}\)"):
        taken(scenario, tmp_path / "run", data)
