import csv

import numpy as np
import pytest

from flightcal.environment import face_fluxes
from flightcal.errors import ScenarioError
from flightcal.scenario import lint, load_scenario, write_template

from .example_telemetry import example_telemetry, sunlight_on_zenith_face


def test_template_lints_clean_as_it_is(tmp_path):
    scenario, telemetry = write_template(tmp_path / "new" / "folder")

    assert (scenario.name, telemetry.name) == ("scenario.yaml", "telemetry.csv")
    assert lint(scenario) == []


@pytest.mark.parametrize("name", ["scenario.yaml", "telemetry.csv"])
def test_nothing_is_overwritten(tmp_path, name):
    (tmp_path / name).write_text("mine")

    with pytest.raises(ScenarioError, match=f"{name}: found a file, expected none"):
        write_template(tmp_path)

    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(name, "mine")]


def test_folder_that_cannot_be_made_is_an_error(tmp_path):
    (tmp_path / "file").write_text("")

    with pytest.raises(ScenarioError, match="cannot be written"):
        write_template(tmp_path / "file" / "folder")


def test_example_telemetry_is_what_its_maker_gives(tmp_path):
    _, telemetry = write_template(tmp_path)
    assert telemetry.read_bytes() == example_telemetry().encode()


def test_example_telemetry_is_plausible():
    rows = list(csv.DictReader(example_telemetry().splitlines()))
    battery = np.array([float(row["TT_BAT"]) for row in rows])
    radiator = np.array([float(row["TT_RAD"]) for row in rows])
    heater = np.array([int(row["HTR_BAT"]) for row in rows])

    assert len(rows) == 8 * 60 + 1
    assert 11 < battery.min() < battery.max() < 20
    assert -30 < radiator.min() < radiator.max() < 20
    assert np.count_nonzero(np.diff(heater)) >= 6
    assert np.all(np.diff(battery)[(heater[:-1] == 1) & (heater[1:] == 1)] > -0.5)


def test_example_sunlight_agrees_with_the_environment(tmp_path):
    scenario = load_scenario(write_template(tmp_path)[0])
    elapsed = np.arange(0, 8 * 3600, 60)
    times = np.datetime64("2024-03-01T00:00:00") + elapsed.astype("timedelta64[s]")

    fluxes = face_fluxes(scenario.environment, {"zenith": (0, 0, -1)}, times)

    example = [sunlight_on_zenith_face(seconds) for seconds in elapsed.tolist()]
    np.testing.assert_allclose(example, np.asarray(fluxes.solar)[:, 0], atol=1.0)  # W/m2 of 1266
