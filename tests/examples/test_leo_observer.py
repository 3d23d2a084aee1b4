"""The bundled twin: its telemetry is what its script makes, and its scenario is what the issue of a demo needs."""

import importlib
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from flightcal.problem import build_problem
from flightcal.scenario import Heat, heat_of, lint, load_scenario
from flightcal.telemetry import read, window_bounds

FOLDER = Path(__file__).parents[2] / "examples" / "leo_observer"


@pytest.mark.slow
def test_the_script_makes_the_bundled_telemetry_byte_for_byte(tmp_path):
    made = tmp_path / "telemetry.csv"
    subprocess.run([sys.executable, FOLDER / "make_telemetry.py", made], check=True)
    assert made.read_bytes() == (FOLDER / "telemetry.csv").read_bytes()


def imaging(telemetry, scenario):
    """Whether the satellite images at each row of its telemetry: as it says itself, and by the scenario's timeline."""
    changes = scenario.network.timeline
    times = telemetry["time"].to_numpy("datetime64[s]")
    last = np.searchsorted(np.array([np.datetime64(change.at, "s") for change in changes]), times, side="right") - 1
    return (telemetry["mode"] == "imaging").to_numpy(), np.array([changes[k].mode == "imaging" for k in last])


@pytest.mark.parametrize("name", ["scenario.yaml", "published.yaml", "with_discrepancy.yaml"])
def test_the_scenario_knows_when_the_satellite_images(name):
    telemetry = pd.read_csv(FOLDER / "telemetry.csv", parse_dates=["time"])
    flown, known = imaging(telemetry, load_scenario(FOLDER / name))
    assert flown.any()
    assert (flown == known).all()


@pytest.mark.slow
def test_another_flight_differs_in_imaging_after_the_training(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(FOLDER)
    monkeypatch.setattr(importlib.import_module("make_telemetry"), "FOLDER", FOLDER)
    more_flights = importlib.import_module("more_flights")
    scenario = more_flights.another_flight(load_scenario(FOLDER / "with_discrepancy.yaml"), tmp_path, 1)
    first, other = (pd.read_csv(folder / "telemetry.csv", parse_dates=["time"]) for folder in (FOLDER, tmp_path))
    flown, known = imaging(other, scenario)
    assert (flown == known).all()
    early = (first["time"] < more_flights.SINCE).to_numpy()
    assert first[early].equals(other[early])  # what the posterior has learnt from
    assert not first["mode"][~early].equals(other["mode"][~early])
    assert not first["TT_STR"][~early].equals(other["TT_STR"][~early])
    assert len(first) == len(other)
    assert (first["mode"] == "contact").equals(other["mode"] == "contact")


@pytest.mark.parametrize("name", ["scenario.yaml", "published.yaml", "with_discrepancy.yaml"])
def test_the_scenario_has_no_findings(name):
    assert lint(FOLDER / name) == []


def test_the_scenario_with_a_discrepancy_is_of_the_same_satellite():
    plain, discrepant = (load_scenario(FOLDER / name) for name in ("scenario.yaml", "with_discrepancy.yaml"))
    assert (discrepant.telemetry, discrepant.environment) == (plain.telemetry, plain.environment)
    exact = {name: heater.model_copy(update={"scatter": 0.0}) for name, heater in discrepant.network.heaters.items()}
    assert exact == plain.network.heaters
    assert (discrepant.network.modes, discrepant.network.timeline) == (plain.network.modes, plain.network.timeline)
    capacities, areas = (
        [
            sum(getattr(item, size) for item in getattr(model, kind).values())
            for model in (discrepant.network, plain.network)
        ]
        for kind, size in (("nodes", "capacity"), ("faces", "area"))
    )
    assert capacities[0] == pytest.approx(capacities[1])
    assert areas[0] == pytest.approx(areas[1])
    assert {name: discrepant.parameters[name].prior for name in plain.parameters} == {
        name: parameter.prior for name, parameter in plain.parameters.items()
    }


def test_the_published_scenario_is_the_same_without_heat():
    default, published = (load_scenario(FOLDER / name) for name in ("scenario.yaml", "published.yaml"))
    assert (heat_of(default), heat_of(published)) == (Heat(), None)
    same = {"name": default.name, "heat": default.heat}
    assert published.model_copy(update=same) == default


def test_no_test_window_overlaps_another():
    windows = load_scenario(FOLDER / "with_discrepancy.yaml").windows
    bounds = [window_bounds(window, 98.7 * 60) for window in windows.values()]
    assert all(end <= start for (_, end), (start, _) in pairwise(bounds))


def test_every_heater_cycles_in_train_and_test():
    scenario = load_scenario(FOLDER / "scenario.yaml")
    telemetry = read(scenario)
    for window in ("train", "test"):
        problem = build_problem(scenario, telemetry, window)
        switches = np.nansum(np.abs(np.diff(problem.windows[0].status, axis=0)) > 0.5, axis=0)
        assert (switches >= 3).all(), (window, switches)


def test_the_uncalibrated_model_is_off_by_kelvins():
    scenario = load_scenario(FOLDER / "scenario.yaml")
    problem = build_problem(scenario, read(scenario))
    assert problem.rmse(problem.priors.median()[None])[0] > 1.5
