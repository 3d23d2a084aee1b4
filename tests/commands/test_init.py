"""`flightcal init` with telemetry files: what it writes lints clean."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from flightcal.cli import app
from flightcal.errors import USER_ERROR
from flightcal.scenario import load_scenario
from tests.telemetry import test_readings as readings
from tests.telemetry.files import frame, seconds, text
from tests.telemetry.test_packets import write_files

run = CliRunner().invoke


def lint(folder: Path) -> str:
    """What lint says of the scenario in a folder; it finds no problem."""
    result = run(app, ["lint", str(folder / "scenario.yaml")])
    assert result.exit_code == 0, result.output
    assert "no problems found" in result.output
    return result.output


def test_packets_of_several_files_are_taken_from_them(tmp_path: Path):
    write_files(tmp_path)
    names = ("thermal.csv", "power.parquet", "onboard.csv")
    result = run(app, ["init", str(tmp_path / "sat"), *(str(tmp_path / name) for name in names)])
    assert result.exit_code == 0, result.output
    assert [line for line in result.output.splitlines() if ": times in" in line] == [
        "thermal.csv: times in 'UTC' (iso8601, from 2024-03-01T00:00:00); channels: 2 temperature",
        "power.parquet: times in 't_ms' (unix-ms, from 2024-03-01T00:00:07); channels: 1 driver",
        "onboard.csv: times in 'SCLK' (clock, whose epoch is a PLACEHOLDER); channels: 1 status, 1 driver",
    ]
    # The onboard samples lie between the others, as the clock's rate is told by how long the other files run.
    assert "window train: 29 samples of 2 channels" in lint(tmp_path / "sat")
    scenario = load_scenario(tmp_path / "sat" / "scenario.yaml")
    assert list(scenario.telemetry.packets) == ["thermal", "power", "onboard"]
    assert scenario.telemetry.files == tuple(f"../{name}" for name in names)
    assert scenario.telemetry.packets["onboard"].time.rate == 16
    assert list(scenario.observations) == ["tt_bat", "tt_rad", "htr"]


def test_lint_reminds_of_guesses_until_their_comments_are_gone(tmp_path: Path):
    frame(40).to_csv(tmp_path / "data.csv", index=False)
    run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")])
    file = tmp_path / "sat" / "scenario.yaml"
    assert "says PLACEHOLDER: every number of the thermal network; write your numbers" in lint(tmp_path / "sat")
    file.write_text(file.read_text().replace("PLACEHOLDER", ""))
    assert "PLACEHOLDER" not in lint(tmp_path / "sat")


def test_samples_that_are_seconds_apart_are_averaged_and_lint_advises_it(tmp_path: Path):
    frame(900, interval=2.0).to_csv(tmp_path / "data.csv", index=False)
    run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")])
    file = tmp_path / "sat" / "scenario.yaml"
    assert "  average: 20 s  # samples are 2 s apart" in file.read_text()
    assert "average" not in lint(tmp_path / "sat")
    file.write_text("".join(line for line in file.read_text().splitlines(True) if "average:" not in line))
    assert "advice: telemetry: samples are 2 s apart (tt_bat); write 'average: 20 s'" in lint(tmp_path / "sat")


@pytest.mark.parametrize(("interval", "rows", "advised"), [(5.0, 9000, True), (10.0, 4500, False)])
def test_lint_advises_means_over_a_minute_where_a_window_has_many_samples(tmp_path, interval, rows, advised):
    frame(rows, interval=interval).to_csv(tmp_path / "data.csv", index=False)
    run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")])
    # Steps that lint would choose by many long simulations.
    file = tmp_path / "sat" / "scenario.yaml"
    file.write_text(file.read_text().replace("\nsimulator:\n", "\nsimulator:\n  step: 60 s\n"))
    assert load_scenario(file).network.step == 60.0
    told = f"advice: telemetry: samples are {interval:g} s apart (tt_bat); write 'average: 60 s'"
    assert (told in lint(tmp_path / "sat")) == advised


def test_files_of_one_parameter_each_become_channels_with_their_times_in_common(tmp_path: Path):
    """Twelve thermistors of a slow satellite and two statuses, each sampled at times of its own for four days."""
    rng, files = np.random.default_rng(5), []
    for k in range(14):
        at = np.arange(rng.uniform(0.0, 60.0), 4 * 86_400.0, 64.0)
        value = 20.0 + 8.0 * np.sin(2.0 * np.pi * at / 86_400.0 + k) + 0.05 * rng.standard_normal(len(at))
        engineering = np.where(np.sin(at / 9000.0) > 0.0, "ON", "OFF") if k > 11 else value.round(2)
        table = pd.DataFrame({"TIME": text(seconds(*at)), "RAW": (10 * value).round(), "ENG": engineering})
        table["UNIT"], table["VALIDITY"] = "-" if k > 11 else "degC", "VALID"
        files.append(tmp_path / f"{'HB' if k > 11 else 'TT'}{100 + k}.dat")
        table.to_csv(files[-1], index=False, sep=";")
    result = run(app, ["init", str(tmp_path / "sat"), *map(str, files)])
    assert result.exit_code == 0, result.output
    scenario = load_scenario(tmp_path / "sat" / "scenario.yaml")
    channels = scenario.telemetry.channels
    assert [(name, channel.kind) for name, channel in channels.items()] == [
        (file.stem.lower(), "status" if file.name.startswith("HB") else "temperature") for file in files
    ]
    assert {channel.column for channel in channels.values()} == {("ENG",)}
    assert all(packet.valid_where == {"VALIDITY": ("VALID",)} for packet in scenario.telemetry.packets.values())
    assert scenario.telemetry.average == 300.0


def test_lint_tells_of_many_rows_that_are_dropped_for_others_of_the_same_time(tmp_path: Path):
    table = pd.concat([frame(60, seed=1), frame(40, seed=2)]).sort_values("time", kind="stable")
    table.to_csv(tmp_path / "data.csv", index=False)
    assert run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")]).exit_code == 0
    assert "advice: telemetry: 40 of 100 rows are dropped, for another row has the same time" in lint(tmp_path / "sat")


def test_one_file_has_no_packets_and_odd_names_are_read_as_they_stand(tmp_path: Path):
    table = pd.DataFrame({"Date/Time: UTC": text(seconds(*(60.0 * np.arange(40))))})
    rng = np.random.default_rng(1)
    for name in ('Panel "+X" deg. C', "Panel -X deg. C", "no", "Größe [mA]"):
        table[name] = rng.normal(size=40).round(2)
    table["on"] = rng.choice(["ON", "OFF"], 40)
    (tmp_path / "my data").mkdir()
    table.to_csv(tmp_path / "my data" / "a: b.csv", index=False)
    result = run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "my data" / "a: b.csv")])
    assert result.exit_code == 0, result.output
    lint(tmp_path / "sat")
    telemetry = load_scenario(tmp_path / "sat" / "scenario.yaml").telemetry
    assert (telemetry.file, telemetry.packets) == (("../my data/a: b.csv",), {})
    assert {name: (channel.column[0], channel.kind) for name, channel in telemetry.channels.items()} == {
        "panel_x_deg_c": ('Panel "+X" deg. C', "temperature"),
        "panel_x_deg_c_2": ("Panel -X deg. C", "temperature"),
        "c_no": ("no", "driver"),
        "gro_e_ma": ("Größe [mA]", "driver"),
        "c_on": ("on", "status"),
    }


def test_labels_of_series_are_part_of_a_name_only_where_they_tell_series_apart(tmp_path: Path):
    table, rng = pd.DataFrame({"Time": text(seconds(*(60.0 * np.arange(40))))}), np.random.default_rng(3)
    for title in ('EPS.temp {sat="A"}', 'PLD.temp {unit="1"}', 'PLD.temp {unit="2"}'):
        table[title] = rng.normal(20.0, 3.0, 40).round(1)
    table.to_csv(tmp_path / "data.csv", index=False)
    assert run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")]).exit_code == 0
    channels = load_scenario(tmp_path / "sat" / "scenario.yaml").telemetry.channels
    assert list(channels) == ["eps_temp", "pld_temp_unit_1", "pld_temp_unit_2"]


def test_columns_that_are_left_out_are_told(tmp_path: Path):
    table = frame(40)
    table["LINE"] = ["HEATING", "STANDBY"] * 20
    table.to_csv(tmp_path / "data.csv", index=False)
    result = run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")])
    assert "data.csv: left out 'LINE': for another time column" in result.output


def test_modes_and_their_timeline_are_taken_from_a_column(tmp_path: Path):
    table = frame(40)
    table["OBC Mode"] = ["Safe"] * 10 + ["Sun pointing"] * 20 + ["Safe"] * 10
    table.to_csv(tmp_path / "data.csv", index=False)
    result = run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")])
    assert "modes in 'OBC Mode' (Safe, Sun pointing): 2 changes, in timeline.csv\n" in result.output
    assert "left out" not in result.output
    lint(tmp_path / "sat")
    model = load_scenario(tmp_path / "sat" / "scenario.yaml").network
    assert list(model.modes) == ["safe", "sun_pointing"]
    assert [(change.at.minute + change.at.second / 60.0, change.within, change.mode) for change in model.timeline] == [
        (0.0, None, "safe"),
        (9.5, 60.0, "sun_pointing"),
        (29.5, 60.0, "safe"),
    ]


def test_a_log_of_activities_is_a_timeline_of_modes(tmp_path: Path):
    frame(40).assign(mode=["a", "b"] * 20).to_csv(tmp_path / "data.csv", index=False)
    begun, ended = seconds(600.0, 1500.0), seconds(840.0, 1560.0)
    log = pd.DataFrame({"task": ["Radar", "Down link"], "start": text(begun), "end": text(ended)})
    log.to_csv(tmp_path / "log.csv", index=False)
    result = run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "log.csv"), str(tmp_path / "data.csv")])
    assert result.exit_code == 0, result.output
    assert "modes in 'task' (nominal, Radar, Down link): 4 changes, in timeline.csv\n" in result.output
    lint(tmp_path / "sat")
    scenario = load_scenario(tmp_path / "sat" / "scenario.yaml")
    assert scenario.telemetry.files == ("../data.csv",)
    assert list(scenario.network.modes) == ["nominal", "radar", "down_link"]
    # Nothing goes on before the first, from where telemetry begins.
    assert [(change.at.replace(tzinfo=None), change.mode) for change in scenario.network.timeline] == [
        (at.astype("datetime64[us]").item(), mode)
        for at, mode in zip(
            [seconds(0.0)[0], begun[0], ended[0], begun[1], ended[1]],
            ["nominal", "radar", "nominal", "down_link", "nominal"],
            strict=True,
        )
    ]


def test_windows_have_no_long_gap_in_any_file(tmp_path: Path):
    hours = pd.to_timedelta([0.0] * 40 + [5.0] * 60 + [9.0] * 50, unit="h")
    table = frame(150)
    table["time"] = text(seconds(*(60.0 * np.arange(150) + hours.total_seconds().to_numpy())))
    table.drop(columns="HTR").to_csv(tmp_path / "thermal.csv", index=False)
    table[["time", "HTR"]][20:80].to_csv(tmp_path / "onboard.csv", index=False)
    result = run(
        app, ["init", str(tmp_path / "sat"), *(str(tmp_path / f"{name}.csv") for name in ("thermal", "onboard"))]
    )
    assert result.exit_code == 0, result.output
    lint(tmp_path / "sat")
    scenario = load_scenario(tmp_path / "sat" / "scenario.yaml")
    assert scenario.windows["train"].start.isoformat() == "2024-03-01T05:40:00"
    end = scenario.windows["test"].end
    assert end is not None
    assert end.isoformat() == "2024-03-01T06:19:00"


def test_windows_have_enough_samples_where_these_are_far_apart(tmp_path: Path):
    table = frame(900)
    table["time"] = text(seconds(*(600.0 * np.arange(900))))
    table.to_csv(tmp_path / "data.csv", index=False)
    result = run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")])
    assert result.exit_code == 0, result.output
    windows = load_scenario(tmp_path / "sat" / "scenario.yaml").windows
    assert windows["test"].end - windows["train"].start == timedelta(seconds=600 * 600)


def test_where_samples_come_in_passes_windows_hold_many_of_them(tmp_path: Path):
    hours = np.repeat([0.0, 1.6, 11.0, 12.6, 24.0, 25.6, 35.0, 140.0], 20)
    table = frame(160)
    table["time"] = text(seconds(*(30.0 * (np.arange(160) % 20) + 3600.0 * hours)))
    table.to_csv(tmp_path / "data.csv", index=False)
    result = run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")])
    assert result.exit_code == 0, result.output
    lint(tmp_path / "sat")
    windows = load_scenario(tmp_path / "sat" / "scenario.yaml").windows
    first = windows["train"].start
    assert [(moment - first).total_seconds() / 3600.0 for moment in (windows["test"].start, windows["test"].end)] == [
        24.0,
        pytest.approx(35.0 + 19 * 30.0 / 3600.0),
    ]


def test_a_heaters_current_is_its_status_and_a_clock_of_two_parts_is_read(tmp_path: Path):
    table = frame(40).drop(columns="HTR")
    table["HTR_BAT_CUR [mA]"] = np.where(np.arange(40) // 5 % 2, 480.0, 3.0) + np.arange(40) % 3
    table["time"] = [f"{515721623 + 60 * k}:{k % 16}" for k in range(40)]
    table.to_csv(tmp_path / "data.csv", index=False)
    result = run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")])
    assert result.exit_code == 0, result.output
    lint(tmp_path / "sat")
    scenario = load_scenario(tmp_path / "sat" / "scenario.yaml")
    time = scenario.telemetry.time
    assert time is not None
    assert (time.format, time.rate, time.fine) == ("clock", 1, 100)
    assert scenario.telemetry.channels["htr_bat_cur_ma"].on_above == "242 mA"
    assert scenario.observations["htr_bat_cur_ma"].heater == "htr_bat_cur_ma"


def test_a_status_and_a_current_of_one_heater_are_one_heater(tmp_path: Path):
    on = np.arange(80) // 5 % 2
    table = frame(80).drop(columns="HTR").assign(**{"HTR_BAT_ST": on, "HTR_BAT_CUR [mA]": 480.0 * on + 3.0})
    table["HTR_BAT2_ST"] = np.arange(80) // 8 % 2
    table.to_csv(tmp_path / "data.csv", index=False)
    result = run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")])
    assert result.exit_code == 0, result.output
    lint(tmp_path / "sat")
    scenario = load_scenario(tmp_path / "sat" / "scenario.yaml")
    assert list(scenario.network.heaters) == ["htr_bat_st", "htr_bat2_st"]
    text = (tmp_path / "sat" / "scenario.yaml").read_text()
    assert "# htr_bat_cur_ma is on and off as htr_bat_st is: the same heater." in text


def test_a_flag_of_the_shadow_is_said_to_be_one(tmp_path: Path):
    table = frame(80).assign(ECL_FLAG=np.arange(80) // 20 % 2)
    table.to_csv(tmp_path / "data.csv", index=False)
    result = run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")])
    assert result.exit_code == 0, result.output
    lint(tmp_path / "sat")
    text = (tmp_path / "sat" / "scenario.yaml").read_text()
    assert "`eclipse: {measured_by: ecl_flag}` takes the shadow" in text
    assert "ecl_flag" not in load_scenario(tmp_path / "sat" / "scenario.yaml").network.heaters


def test_raw_readings_and_bits_of_a_word_are_written_as_such(tmp_path: Path):
    table = frame(40).drop(columns="HTR")
    table["ANT_TEMP_RAW"], table["HTR_WORD"] = 2100 + np.arange(40), np.where(np.arange(40) // 5 % 2, 66, 64)
    table["HTR_MASK"] = np.where(np.arange(40) // 5 % 2, "A5", "25")
    table["shutter"] = np.linspace(0.0, 1.0, 40)
    table.to_csv(tmp_path / "data.csv", index=False)
    result = run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")])
    assert "'shutter': no unit" in " ".join(result.output.split())
    lint(tmp_path / "sat")
    text = (tmp_path / "sat" / "scenario.yaml").read_text()
    assert "# PLACEHOLDER: what the raw readings of ANT_TEMP_RAW mean" in text
    scenario = load_scenario(tmp_path / "sat" / "scenario.yaml")
    assert len(scenario.telemetry.channels["ant_temp_raw"].curve) == 2
    assert scenario.telemetry.channels["htr_word_1"].bits == (1,)
    mask = scenario.telemetry.channels["htr_mask_7"]
    assert (mask.bits, mask.base) == ((7,), 16)


def test_a_status_of_which_a_bit_is_always_set_is_a_word_and_one_that_counts_states_is_none(tmp_path: Path):
    table = frame(40).drop(columns="HTR")
    table["TCS_STATUS"] = np.where(np.arange(40) // 5 % 2, 68, 64)
    table["MODE_STATE"] = 1 + np.arange(40) // 10
    table.to_csv(tmp_path / "data.csv", index=False)
    run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")])
    channels = load_scenario(tmp_path / "sat" / "scenario.yaml").telemetry.channels
    assert channels["tcs_status_2"].bits == (2,)
    assert not any(name.startswith("mode_state_") for name in channels)


def test_quaternions_and_timelines_are_told_where_they_belong_and_are_no_channels(tmp_path: Path):
    table = frame(40)
    table.to_csv(tmp_path / "data.csv", index=False)
    angle = np.arange(40) / 50.0
    parts = {"w": np.cos(angle), "x": np.sin(angle), "y": 0.0 * angle, "z": 0.0 * angle}
    pd.DataFrame({"time": table["time"], **parts}).to_csv(tmp_path / "pointing.csv", index=False)
    attitudes = pd.DataFrame({"at": table["time"][::20], "attitude": ["nadir", "sun"]})
    attitudes.to_csv(tmp_path / "attitude.csv", index=False)
    files = [str(tmp_path / name) for name in ("data.csv", "pointing.csv", "attitude.csv")]
    result = run(app, ["init", str(tmp_path / "sat"), *files])
    assert result.exit_code == 0, result.output
    said = " ".join(result.output.split())
    assert "pointing.csv: 'w', 'x', 'y', 'z' are quaternions; not written: 'environment: attitude' takes them" in said
    assert "attitude.csv: found times and no channel; not written. 'timeline_file'" in said
    lint(tmp_path / "sat")
    assert "pointing" not in (tmp_path / "sat" / "scenario.yaml").read_text()


def test_quaternions_are_not_told_as_measured_inputs_beside_those_that_are(tmp_path: Path):
    table = frame(40).assign(w=1.0, x=0.0, y=0.0, z=0.0, rate=np.linspace(0.0, 3.0, 40))
    table.to_csv(tmp_path / "data.csv", index=False)
    said = " ".join(run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")]).output.split())
    assert "'w', 'x', 'y', 'z' are quaternions" in said
    assert "'rate': no unit" in said
    assert "'z', 'rate': no unit" not in said


def test_a_heater_whose_name_says_nothing_is_of_the_sensor_that_follows_it(tmp_path: Path):
    rising = np.arange(60) // 6 % 2 == 0
    warmth = np.where(rising, 10.0 + 0.5 * (np.arange(60) % 6), 13.0 - 0.5 * (np.arange(60) % 6))
    other = 20.0 + 9.0 * np.sin(np.arange(60) / 7.0)
    times = pd.date_range("2024-03-01", periods=60, freq="min").strftime("%Y-%m-%dT%H:%M:%S")
    table = pd.DataFrame({"time": times, "line [degC]": other, "tank [degC]": warmth})
    table["HTR_7"] = np.where(rising, "ON", "OFF")
    table.to_csv(tmp_path / "data.csv", index=False)
    assert run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")]).exit_code == 0
    heater = load_scenario(tmp_path / "sat" / "scenario.yaml").network.heaters["htr_7"]
    assert heater.sensor == "tank_degc"


def test_a_heater_is_of_the_sensor_that_is_the_same_at_each_switch_and_not_of_one_in_step_with_it(tmp_path: Path):
    rising = np.arange(60) // 6 % 2 == 0
    warmth = np.where(rising, 10.0 + 0.5 * (np.arange(60) % 6), 13.0 - 0.5 * (np.arange(60) % 6))
    panel = 30.0 * (warmth - 11.5) + 8.0 * np.sin(np.arange(60.0) ** 2)
    table = pd.DataFrame({"time": text(seconds(*(60.0 * np.arange(60)))), "panel [degC]": panel})
    table["battery [degC]"], table["HTR_7"] = warmth, np.where(rising, "ON", "OFF")
    table.to_csv(tmp_path / "data.csv", index=False)
    assert run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")]).exit_code == 0
    assert load_scenario(tmp_path / "sat" / "scenario.yaml").network.heaters["htr_7"].sensor == "battery_degc"


def test_the_bits_of_a_status_word_are_heaters_only_where_a_temperature_obeys_them(tmp_path: Path):
    minutes = np.arange(240.0)
    rising = minutes // 6 % 2 == 0
    warmth = np.where(rising, 10.0 + 0.5 * (minutes % 6), 13.0 - 0.5 * (minutes % 6))
    radio, sunlit = minutes // 17 % 3 == 1, np.sin(minutes / 15.0) > 0.0
    table = pd.DataFrame({"time": text(seconds(*(60.0 * minutes))), "battery [degC]": warmth})
    for k, name in enumerate(("panel", "side", "top")):
        table[f"{name} [degC]"] = -20.0 * np.cos((minutes + k) / 15.0)
    table["STATUS"] = [f"0x{4 + a + 2 * b + 8 * c:02X}" for a, b, c in zip(rising, radio, sunlit, strict=True)]
    table.to_csv(tmp_path / "data.csv", index=False)
    assert run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")]).exit_code == 0
    lint(tmp_path / "sat")
    scenario = load_scenario(tmp_path / "sat" / "scenario.yaml")
    assert {name: heater.sensor for name, heater in scenario.network.heaters.items()} == {"status_0": "battery_degc"}
    written = (tmp_path / "sat" / "scenario.yaml").read_text()
    assert "by no temperature a heater's: status_1, status_3." in written


@pytest.mark.parametrize(("wave", "period"), [(1436.0, 1436.0), (1220.0, 1436.0), (718.0, 718.0)])
def test_the_period_is_that_after_which_temperatures_come_again(tmp_path: Path, wave, period):
    minutes = np.arange(0.0, 4 * 1436.0, 5.0)
    table = pd.DataFrame({"time": text(seconds(*(60.0 * minutes)))})
    for k, name in enumerate(("north", "south", "east")):
        noise = np.random.default_rng(k).standard_normal(len(minutes))
        table[f"{name} [degC]"] = 10.0 * np.sin(2.0 * np.pi * minutes / wave + k) + 0.01 * k * minutes + noise
    table.to_csv(tmp_path / "data.csv", index=False)
    assert run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")]).exit_code == 0
    scenario = load_scenario(tmp_path / "sat" / "scenario.yaml")
    assert scenario.environment.period == pytest.approx(period * 60.0, rel=0.01)
    train = scenario.windows["train"]
    assert (train.end - train.start).total_seconds() > 1.9 * period * 60.0


def test_counts_of_a_clock_that_would_be_a_time_in_far_future_are_counts(tmp_path: Path):
    table = frame(40)
    table[["time", "TT_BAT"]].to_csv(tmp_path / "thermal.csv", index=False)
    power = pd.DataFrame({"SCLK": 3_628_800_656 + 960 * np.arange(40), "I_SA": table["I_SA"]})
    power.to_csv(tmp_path / "power.csv", index=False)
    names = (str(tmp_path / f"{name}.csv") for name in ("thermal", "power"))
    assert run(app, ["init", str(tmp_path / "sat"), *names]).exit_code == 0
    assert load_scenario(tmp_path / "sat" / "scenario.yaml").telemetry.packets["power"].time.rate == 16


def test_a_heaters_name_without_vowels_is_its_nodes(tmp_path: Path):
    names = ["UTC", "TT_TNK [degC]", "TT_STR [degC]", "TANK_HTR", "STAR_HTR"]
    table = pd.DataFrame([[at, 20.0, 20.0 + k, "ON", "OFF"] for k, at in enumerate(text(seconds(0.0, 60.0, 120.0)))])
    table.set_axis(names, axis=1).to_csv(tmp_path / "data.csv", index=False)
    assert run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")]).exit_code == 0
    heaters = load_scenario(tmp_path / "sat" / "scenario.yaml").network.heaters
    assert (heaters["tank_htr"].sensor, heaters["star_htr"].sensor) == ("tt_tnk_degc", "tt_str_degc")


def test_thresholds_are_what_the_sensor_reads_when_its_heater_switches(tmp_path: Path):
    rising = np.arange(60) // 6 % 2 == 0
    warmth = np.where(rising, 10.0 + 0.5 * (np.arange(60) % 6), 13.0 - 0.5 * (np.arange(60) % 6))
    times = pd.date_range("2024-03-01", periods=60, freq="min").strftime("%Y-%m-%dT%H:%M:%S")
    table = pd.DataFrame({"time": times, "bat_t [degC]": warmth, "bat_htr": np.where(rising, "ON", "OFF")})
    table["load [A]"] = np.linspace(0.0, 1.0, 60)
    table.to_csv(tmp_path / "data.csv", index=False)
    assert run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")]).exit_code == 0
    text = (tmp_path / "sat" / "scenario.yaml").read_text()
    assert "on_below: 10.0 degC, off_above: 13.0 degC" in text
    assert "coefficient: 1 W/A" in text


def test_thresholds_are_found_where_status_and_sensor_come_at_times_of_their_own(tmp_path: Path):
    rising = np.arange(60) // 6 % 2 == 0
    warmth = np.where(rising, 10.0 + 0.5 * (np.arange(60) % 6), 13.0 - 0.5 * (np.arange(60) % 6))
    clock = 60.0 * np.arange(60)
    thermal = {"time": text(seconds(*clock)), "bat_t [degC]": warmth, "htr_box_t [degC]": np.cos(np.arange(60.0))}
    pd.DataFrame(thermal).to_csv(tmp_path / "thermal.csv", index=False)
    status = {"time": text(seconds(*(clock + 1.0))), "tcs_htr_battery": np.where(rising, "ON", "OFF")}
    pd.DataFrame(status).to_csv(tmp_path / "status.csv", index=False)
    names = (str(tmp_path / f"{name}.csv") for name in ("thermal", "status"))
    assert run(app, ["init", str(tmp_path / "sat"), *names]).exit_code == 0
    heater = load_scenario(tmp_path / "sat" / "scenario.yaml").network.heaters["tcs_htr_battery"]
    assert heater.sensor == "bat_t_degc"
    assert (heater.on_below - 273.15, heater.off_above - 273.15) == pytest.approx((10.0, 13.0), abs=0.06)


def test_readings_and_a_log_of_modes_go_from_init_to_lint(tmp_path: Path):
    readings.table().to_csv(tmp_path / "data.csv", index=False)
    log = pd.DataFrame({"time": text(seconds(0.0, 300.0, 700.0)), "mode": ["idle", "busy", "safe"]})
    log.to_csv(tmp_path / "log.csv", index=False)
    result = run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv"), str(tmp_path / "log.csv")])
    assert result.exit_code == 0, result.output
    assert "window train: " in lint(tmp_path / "sat")
    scenario = load_scenario(tmp_path / "sat" / "scenario.yaml")
    assert scenario.telemetry.readings is not None
    # The file of modes alone has no channel, so it is no packet.
    assert (scenario.telemetry.files, list(scenario.observations)) == (
        ("../data.csv",),
        ["tm_t_cam", "tm_t_bat", "tm_htr"],
    )
    assert [change.mode for change in scenario.network.timeline] == ["idle", "busy", "idle"]


def day_of_year(times: np.ndarray) -> list[str]:
    return pd.to_datetime(times).strftime("%Y:%j:%H:%M:%S.000").tolist()


KINDS = (
    "csv",
    "csv.gz",
    "parquet",
    "xlsx",
    "doy.csv",
    "unix-ms.csv",
    "days.xlsx",
    "pattern.csv",
    "columns.csv",
    "fill.csv",
)


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_of_every_kind_goes_from_init_to_lint(tmp_path: Path, kind: str):
    table, path = frame(40), tmp_path / f"data.{kind}"
    times = seconds(*(60.0 * np.arange(40)))
    if kind.startswith("doy"):
        table["time"] = day_of_year(times)
    elif kind.startswith("unix"):
        table["time"] = times.astype(np.int64) // 1_000_000
    elif kind.startswith("pattern"):
        table["time"] = pd.to_datetime(times).strftime("%d.%m.%Y %H:%M:%S")
    elif kind.startswith("columns"):
        date = pd.DataFrame({"YEAR": 2024, "DOY": 61, "UTC": pd.to_datetime(times).strftime("%H:%M:%S")})
        table = pd.concat([date, table.drop(columns="time")], axis=1)
    elif kind.startswith("fill"):
        table = pd.concat([table[:20], table[:3].assign(time="0x00000000"), table[20:]])
    if kind.endswith("xlsx"):
        pytest.importorskip("openpyxl", reason="needs the extra 'excel'")
        days = times.astype(np.int64) / 86400e9 + 25569
        table["time"] = days if kind.startswith("days") else times
        table.to_excel(path, index=False)
    elif kind == "parquet":
        table.to_parquet(path)
    else:
        table.to_csv(path, index=False)
    assert run(app, ["init", str(tmp_path / "sat"), str(path)]).exit_code == 0
    assert "window train: 20 samples of 1 channel" in lint(tmp_path / "sat")


@pytest.mark.parametrize(("zero", "unit"), [(0.0, "degC"), (273.15, "K")])
def test_without_a_temperature_by_name_those_by_their_values_are_taken_and_said_to_be_guesses(tmp_path, zero, unit):
    table = frame(40).drop(columns="TT_BAT")
    wave = np.sin(np.arange(40) / 5.0)
    table["TM_BODY"], table["TM_BUS_I"] = (zero + 10.0 + 20.0 * wave).round(1), (5.0 + 25.0 * wave).round(2)
    table.to_csv(tmp_path / "hk.csv", index=False)
    assert run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "hk.csv")]).exit_code == 0
    channels = load_scenario(tmp_path / "sat" / "scenario.yaml").telemetry.channels
    kinds = {channel.column[0]: (channel.kind, channel.unit) for channel in channels.values()}
    assert (kinds["TM_BODY"], kinds["TM_BUS_I"]) == (("temperature", unit), ("driver", "dimensionless"))
    assert "PLACEHOLDER: a temperature by its values, not by its name" in lint(tmp_path / "sat")


def test_files_without_a_temperature_or_a_common_time_are_told(tmp_path: Path):
    frame(9).drop(columns="TT_BAT").to_csv(tmp_path / "power.csv", index=False)
    result = run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "power.csv")])
    assert result.exit_code == USER_ERROR
    assert "power.csv: found no temperature among the columns (I_SA, HTR), expected one" in result.output
    frame(9)[["time", "TT_BAT"]].to_csv(tmp_path / "thermal.csv", index=False)
    late = frame(9).drop(columns="TT_BAT").assign(time=text(seconds(*(86400 + 60.0 * np.arange(9)))))
    late.to_csv(tmp_path / "power.csv", index=False)
    result = run(
        app, ["init", str(tmp_path / "sat"), *(str(tmp_path / f"{name}.csv") for name in ("thermal", "power"))]
    )
    assert result.exit_code == USER_ERROR
    output = " ".join(result.output.split())
    spans = "thermal: 2024-03-01T00:00 to 2024-03-01T00:08, power: 2024-03-02T00:00 to 2024-03-02T00:08"
    assert f"found files whose times do not overlap ({spans})" in output
    assert not (tmp_path / "sat").exists()


def test_a_scenario_that_is_there_is_not_overwritten(tmp_path: Path):
    frame(9).to_csv(tmp_path / "data.csv", index=False)
    (tmp_path / "scenario.yaml").write_text("mine")
    result = run(app, ["init", str(tmp_path), str(tmp_path / "data.csv")])
    assert result.exit_code == USER_ERROR
    assert (tmp_path / "scenario.yaml").read_text() == "mine"


def test_the_example_of_a_load_from_a_power_is_a_share_of_it(tmp_path: Path):
    table = frame(300).rename(columns={"I_SA": "P_BUS [mW]"})
    table.to_csv(tmp_path / "data.csv", index=False)
    assert run(app, ["init", str(tmp_path / "sat"), str(tmp_path / "data.csv")]).exit_code == 0
    file = tmp_path / "sat" / "scenario.yaml"
    written = file.read_text(encoding="utf-8")
    assert "coefficient: 0.2 mW/mW}" in written
    file.write_text(written.replace("  # loads:", "  loads:"), encoding="utf-8")
    lint(tmp_path / "sat")
