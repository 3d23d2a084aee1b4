"""The bundled twin: its telemetry is what its script makes, and its scenario is what the issue of a demo needs."""

import subprocess
import sys
from pathlib import Path

import numpy as np

from flightcal.calibration import build_problem
from flightcal.experiment import read
from flightcal.scenario import lint, load_scenario

FOLDER = Path(__file__).parents[2] / "examples" / "leo_observer"


def test_the_script_makes_the_bundled_telemetry_byte_for_byte(tmp_path):
    made = tmp_path / "telemetry.csv"
    subprocess.run([sys.executable, FOLDER / "make_telemetry.py", made], check=True)
    assert made.read_bytes() == (FOLDER / "telemetry.csv").read_bytes()


def test_the_scenario_has_no_findings():
    assert lint(FOLDER / "scenario.yaml") == []


def test_every_heater_cycles_in_train_and_test():
    scenario = load_scenario(FOLDER / "scenario.yaml")
    telemetry = read(scenario)
    for window in ("train", "test"):
        problem = build_problem(scenario, telemetry, window)
        switches = np.nansum(np.abs(np.diff(problem.status, axis=0)) > 0.5, axis=0)
        assert (switches >= 3).all(), (window, switches)


def test_the_uncalibrated_model_is_off_by_kelvins():
    scenario = load_scenario(FOLDER / "scenario.yaml")
    problem = build_problem(scenario, read(scenario))
    assert problem.rmse(problem.priors.median()[None])[0] > 1.5
