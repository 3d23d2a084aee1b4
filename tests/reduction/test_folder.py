"""The scenario of a reduction, for one command: reduced once, and again where what it follows from has changed."""

import json
import shutil
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest

from flightcal.commands.demo import DEMO
from flightcal.errors import FlightcalError, RunError
from flightcal.reduction import folder as module
from flightcal.reduction.folder import CERTIFICATE, MODEL_FILE, reduce_to_folder, scenario_of
from flightcal.reduction.storage import load
from flightcal.scenario import load_scenario
from flightcal.simulator import NetworkSimulator, SimulationFailure
from tests.reduction import craft

SMALL = {"projection": {"states": 10, "settled": 0}}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The small craft, reduced in a run's folder."""
    place = tmp_path_factory.mktemp("craft")
    scenario = scenario_of(craft.write(place, SMALL), place / "run")
    return place, scenario


@pytest.fixture
def copied(made, tmp_path):
    return Path(shutil.copytree(made[0], tmp_path / "copy"))


@pytest.fixture
def no_reduction(monkeypatch):
    def fail(*_, **__):
        raise AssertionError("reduced again")

    monkeypatch.setattr(module, "reduce_to_folder", fail)


def test_the_reduced_model_stands_in_the_runs_folder(made):
    place, scenario = made
    assert scenario == place / "run" / "reduced" / "scenario.yaml"
    found = load_scenario(scenario, telemetry=Path(__file__))
    assert (scenario.parent / found.network.reduced_model).samefile(place / "run" / "reduced" / MODEL_FILE)
    assert (scenario.parent / found.network.checked_on).samefile(place / "reduce.yaml")
    assert all(item.bias == 0.0 for item in found.observations.values())


def test_simulations_of_the_full_network_that_fail_are_a_message(tmp_path, monkeypatch):
    file = craft.write(tmp_path, SMALL)
    monkeypatch.setattr(NetworkSimulator, "simulate_many", lambda self, thetas: [None] * len(thetas))
    with pytest.raises(FlightcalError, match="window 'march': every simulation of the full network fails"):
        reduce_to_folder(file, tmp_path / "out")

    def fail(*_):
        raise SimulationFailure("not finite after 60 s")

    monkeypatch.setattr(module, "reduce", fail)
    with pytest.raises(FlightcalError, match="reduction: not finite after 60 s: check the spacecraft"):
        reduce_to_folder(file, tmp_path / "out")


@pytest.mark.usefixtures("no_reduction")
def test_nothing_is_reduced_again_for_other_windows_or_settings(copied):
    windows = {"train": {"start": "2024-03-01T02:00:00", "orbits": 1}}
    changed = {**SMALL, "windows": windows, "calibration": {"nuts": {"draws": 123}}}
    scenario = load_scenario(scenario_of(craft.write(copied, changed), copied / "run"), telemetry=Path(__file__))
    assert list(scenario.windows) == ["train"]
    assert scenario.calibration.nuts.draws == 123


@pytest.mark.usefixtures("no_reduction")
def test_a_model_beside_the_file_is_taken(copied):
    shutil.move(copied / "run" / "reduced", copied / "reduced")
    scenario = scenario_of(craft.write(copied, SMALL), copied / "other")
    found = load_scenario(scenario, telemetry=Path(__file__))
    assert scenario.parent == copied / "other" / "reduced"
    assert (scenario.parent / found.network.reduced_model).samefile(copied / "reduced" / MODEL_FILE)


@pytest.mark.parametrize("left", [[], ["certificate.txt", "scenario.yaml"]])
def test_a_reduction_that_was_interrupted_is_made_again(made, copied, monkeypatch, left):
    folder, found = copied / "run" / "reduced", []
    for file in folder.iterdir():
        if file.name not in left:
            file.unlink()

    def made_again(path, out, *_):
        found.extend(out.iterdir())
        shutil.copytree(made[1].parent, out, dirs_exist_ok=True)
        return []

    monkeypatch.setattr(module, "reduce_to_folder", made_again)
    assert scenario_of(craft.write(copied, SMALL), copied / "run").is_file()
    assert (folder / MODEL_FILE).is_file()
    assert found == []


def test_a_run_of_another_satellite_is_not_touched(copied):
    (copied / "run" / "provenance.json").write_text("{}")
    other = deepcopy(craft.SPACECRAFT)
    other["nodes"]["unit"]["capacity"] = "2000 J/K"
    path = craft.write(copied, SMALL, other)
    before = (copied / "run" / "reduced" / CERTIFICATE).read_bytes()
    with pytest.raises(RunError, match="expected a new or empty folder"):
        scenario_of(path, copied / "run")
    assert (copied / "run" / "reduced" / CERTIFICATE).read_bytes() == before


@pytest.mark.usefixtures("no_reduction")
def test_the_bundled_satellite_has_the_model_of_its_files(tmp_path):
    assert scenario_of(DEMO / "reduce.yaml", tmp_path / "run").is_file()


@pytest.mark.slow
def test_the_bundled_satellites_model_is_what_reduce_makes(tmp_path):
    reduce_to_folder(DEMO / "reduce.yaml", tmp_path / "reduced")
    bundled, again = (load(place / MODEL_FILE) for place in (DEMO / "reduced", tmp_path / "reduced"))
    assert again.model.states == bundled.model.states
    assert again.model.settled == bundled.model.settled
    for name in ("values", "initial", "initial_covariance"):
        np.testing.assert_allclose(getattr(again.model, name), getattr(bundled.model, name), rtol=1e-4)
    np.testing.assert_allclose(again.model.shifts, bundled.model.shifts, atol=1e-4)
    first, second = (
        json.loads((place / CERTIFICATE).read_text()) for place in (DEMO / "reduced", tmp_path / "reduced")
    )
    assert second["made_from"] == first["made_from"]
    for sensor, row in first["held_out"]["sensors"].items():
        assert second["held_out"]["sensors"][sensor] == pytest.approx(row, rel=0.02)
