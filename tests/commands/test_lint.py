"""What `flightcal lint` prints."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from flightcal.cli import app
from tests import small
from tests.check.cases import sunlit

run = CliRunner().invoke


def test_of_many_gaps_of_a_driver_the_longest_are_told_and_the_others_counted(tmp_path: Path):
    written = small.content()
    written["telemetry"]["channels"]["sun"]["fill"] = "previous_orbit"
    current = small.sunlight(60.0 * np.arange(421))
    # In the second orbit, longer and longer.
    for length, first in enumerate((95, 105, 115, 125, 135), start=4):
        current[first : first + length] = np.nan
    small.load(tmp_path, written, columns={"sun": current})
    result = run(app, ["lint", str(tmp_path / "scenario.yaml")])
    assert result.exit_code == 0, result.output
    told = [line.split(";")[0] for line in result.output.splitlines() if line.startswith("telemetry sun: bridged")]
    assert told == [f"telemetry sun: bridged, {length} samples" for length in (8, 7, 6)]
    assert "telemetry sun: 2 more gaps, shorter than these, are bridged" in result.output


@pytest.mark.parametrize(("irregular", "advised"), [(False, True), (True, False)])
def test_a_driver_that_is_sampled_and_not_sent_when_it_changes_is_not_to_be_held(
    tmp_path: Path, irregular: bool, advised: bool
):
    written = small.content()
    written["telemetry"]["channels"]["sun"]["fill"] = "hold"
    current = small.sunlight(60.0 * np.arange(421))
    if irregular:
        current[np.random.default_rng(1).random(421) < 0.5] = np.nan
        current[0] = 0.0
    small.load(tmp_path, written, columns={"sun": current})
    result = run(app, ["lint", str(tmp_path / "scenario.yaml")])
    assert result.exit_code == 0, result.output
    assert ("advice: telemetry.channels.sun: its samples come every 60 s" in result.output) is advised


def test_a_driver_that_lies_beyond_a_loads_table_is_told(tmp_path: Path):
    written = small.content()
    written["simulator"]["loads"]["sun"] = {
        "node": "panel", "driver": "sun", "coefficient": "12 W", "table": [["0 mA", 0], ["1 mA", 1]]
    }  # fmt: skip
    small.load(tmp_path, written)
    result = run(app, ["lint", str(tmp_path / "scenario.yaml")])
    assert result.exit_code == 0, result.output
    assert "of the samples of 'sun' lie beyond its table" in result.output
    written["simulator"]["loads"]["sun"]["table"][1][0] = "1 A"
    small.load(tmp_path, written)
    assert "beyond its table" not in run(app, ["lint", str(tmp_path / "scenario.yaml")]).output


def test_a_face_of_another_unit_and_an_earth_that_sends_nothing_are_told(tmp_path: Path):
    written = sunlit()
    faces = written["simulator"]["faces"]
    small.load(tmp_path, written)
    before = run(app, ["lint", str(tmp_path / "scenario.yaml")])
    assert before.exit_code == 0, before.output
    assert "check its unit" not in before.output
    assert "so the Earth" not in before.output
    name = next(iter(faces))
    faces[name]["area"] = "1200 m^2"
    written["environment"] |= {"albedo": 0, "earth_infrared": "0 W/m^2"}
    small.load(tmp_path, written)
    after = run(app, ["lint", str(tmp_path / "scenario.yaml")])
    assert after.exit_code == 0, after.output
    assert f"advice: simulator.faces.{name}: its area is 1200 m^2; check its unit" in after.output
    assert "advice: environment.albedo: it is 0, so the Earth reflects nothing" in after.output
    assert "advice: environment.earth_infrared: it is 0, so the Earth radiates nothing" in after.output


def test_a_plate_that_turns_to_the_sun_and_has_one_side_is_told(tmp_path: Path):
    written = sunlit()
    faces = written["simulator"]["faces"]
    front = next(iter(faces.values()))
    front["normal"] = {"tracks_sun_about": [0, 1, 0]}
    small.load(tmp_path, written)
    told = "panel has no face with 'back: true'"
    assert told in run(app, ["lint", str(tmp_path / "scenario.yaml")]).output
    faces["rear"] = {**front, "normal": {"tracks_sun_about": [0, 1, 0], "back": True}}
    small.load(tmp_path, written)
    assert told not in run(app, ["lint", str(tmp_path / "scenario.yaml")]).output


def test_a_number_that_its_parameters_prior_does_not_reach_is_told(tmp_path: Path):
    written = small.content()
    assert written["parameters"]["power"]["sets"] == "heaters.heater.power"
    for watts, told in (("30 W", False), ("45 W", False), ("30 kW", True)):
        written["simulator"]["heaters"]["heater"]["power"] = watts
        small.load(tmp_path, written)
        result = run(app, ["lint", str(tmp_path / "scenario.yaml")])
        assert result.exit_code == 0, result.output
        assert ("advice: parameters.power: its prior is from 15 to 45" in result.output) is told


def test_steps_that_no_number_of_them_makes_exact_are_told(tmp_path: Path):
    written = sunlit()
    del written["simulator"]["step"]
    small.load(tmp_path, written)
    assert "leave an error" not in run(app, ["lint", str(tmp_path / "scenario.yaml")]).output
    faces = written["simulator"]["faces"]
    faces[next(iter(faces))]["area"] = "4000 m^2"
    small.load(tmp_path, written)
    told = run(app, ["lint", str(tmp_path / "scenario.yaml")]).output
    assert "advice: window train: " in told
    assert "leave an error of 0." in told


CHANGES = [(hour, minute, mode) for hour in range(6) for minute, mode in (("00", "busy"), ("30", "idle"))]
"""Of modes that last half an hour."""


@pytest.mark.parametrize(("change", "rest"), [("02:00:00", "all"), ("05:40:00", "the rest"), ("06:00:00", "")])
def test_a_plan_beyond_the_last_change_of_mode_is_told(tmp_path: Path, change: str, rest: str):
    written = small.content()
    written["simulator"] |= {
        "modes": {"idle": {"body": "1 W"}, "busy": {"body": "3 W"}},
        "timeline": [
            *({"at": f"2024-03-01T0{hour}:{minute}:00", "mode": mode} for hour, minute, mode in CHANGES),
            {"at": f"2024-03-01T{change}", "mode": "busy"},
        ],
    }
    if rest == "all":
        written["simulator"]["timeline"][1:-1] = []
    written["windows"]["test"] = {
        "plan": {"start": "2024-03-01T05:30:00", "end": "2024-03-01T06:30:00", "planned": True}
    }
    small.load(tmp_path, written)
    result = run(app, ["lint", str(tmp_path / "scenario.yaml")])
    words = f"advice: windows.test.plan: simulator.timeline has no change after 2024-03-01T{change}, so {rest} of the"
    assert (f"{words} plan is in mode 'busy'" in result.output) == bool(rest), result.output
    assert ("has no change" in result.output) == bool(rest)


@pytest.mark.parametrize(("limits", "told"), [(["12 K", "26 K"], True), ([None, "90 degC"], False)])
def test_limits_outside_of_which_a_channel_always_is_are_told(tmp_path: Path, limits: list[str | None], told: bool):
    written = small.content()
    written["telemetry"]["channels"]["body_temp"]["limits"] = limits
    small.load(tmp_path, written)
    result = run(app, ["lint", str(tmp_path / "scenario.yaml")])
    words = "advice: telemetry.channels.body_temp.limits: more than half of its readings are outside; check their unit"
    assert (words in result.output) == told, result.output


def test_a_trend_beside_a_drift_wants_three_windows(tmp_path: Path):
    written = small.content()
    written["parameters"]["link"] |= {"trend": 0.5, "drift": 0.3}
    small.load(tmp_path, written)
    result = run(app, ["lint", str(tmp_path / "scenario.yaml")])
    words = "advice: parameters.link: 'trend' beside 'drift' is told by 3 windows to train on or more, and there is 1;"
    assert words in result.output


@pytest.mark.parametrize(("minute", "told"), [(30, False), (300, True)])
def test_a_driver_that_begins_with_a_plan_is_told(tmp_path: Path, minute: int, told: bool):
    """It is planned from 05:30 on, and known before up to a minute."""
    written = small.content()
    written["telemetry"]["channels"]["sun"]["fill"] = "previous_orbit"
    current = small.sunlight(60.0 * np.arange(421))
    current[330 - minute : 330] = np.nan
    written["windows"] = {
        "train": {"start": "2024-03-01T00:00:00", "end": "2024-03-01T00:30:00"},
        "test": {"start": "2024-03-01T05:30:00", "end": "2024-03-01T06:30:00", "planned": True},
    }
    small.load(tmp_path, written, columns={"sun": current})
    result = run(app, ["lint", str(tmp_path / "scenario.yaml")])
    words = (
        "advice: windows.test: 'sun' has no sample before 2024-03-01T05:30:00, so the temperatures at which the plan"
    )
    assert (words in result.output) == told, result.output


@pytest.mark.parametrize(("month", "trend", "told"), [(3, None, False), (6, None, True), (6, 0.5, False)])
def test_a_window_months_after_training_is_told_where_nothing_ages(
    tmp_path: Path, month: int, trend: float | None, told: bool
):
    written = small.content()
    written["simulator"] = {key: block for key, block in written["simulator"].items() if key != "loads"}
    written["telemetry"]["channels"].pop("sun")
    written["parameters"] = {"link": written["parameters"]["link"] | ({} if trend is None else {"trend": trend})}
    written["windows"]["test"] = {
        "plan": {"start": f"2024-{month:02d}-10T00:00:00", "end": f"2024-{month:02d}-10T02:00:00", "planned": True}
    }
    small.load(tmp_path, written)
    result = run(app, ["lint", str(tmp_path / "scenario.yaml")])
    words = "advice: windows.test.plan: it begins 101 days after what is trained on, and in no interval is how the"
    assert (words in result.output) == told, result.output


@pytest.mark.parametrize(("samples", "told"), [(1, True), (20, False)])
def test_a_heater_that_switches_more_often_than_it_is_sampled_is_told(tmp_path: Path, samples: int, told: bool):
    """Its state lasts for so many samples."""
    written = small.content()
    del written["heat"]
    small.load(tmp_path, written, columns={"heater": np.arange(421) // samples % 2})
    result = run(app, ["lint", str(tmp_path / "scenario.yaml")])
    assert result.exit_code == 0, result.output
    assert (
        "advice: simulator.heaters.heater: it switches more often than the telemetry shows" in result.output
    ) == told


@pytest.mark.parametrize("heat", ["on", "none"])
def test_a_likelihood_of_a_status_that_is_not_used_is_told(tmp_path: Path, heat: str):
    written = small.content()
    written["observations"]["heater_status"]["likelihood"] = {"switch_times": {}}
    if heat == "on":
        del written["heat"]
    small.load(tmp_path, written)
    result = run(app, ["lint", str(tmp_path / "scenario.yaml")])
    assert result.exit_code == 0, result.output
    told = "advice: observations.heater_status.likelihood: it is not used" in result.output
    assert told == (heat == "on")
