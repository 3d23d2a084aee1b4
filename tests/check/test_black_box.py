"""Simple wrongs beside a simulator that is run and not looked into: the small satellite, by its runs alone."""

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from flightcal.check import PriorRuns, suspects
from flightcal.check.black_box import _by_chance, ensemble_of
from flightcal.check.findings import suspected
from flightcal.check.wrongs import clocks_as_read
from flightcal.check.wrongs.clocks import channel_clocks
from flightcal.problem import build_problem
from flightcal.scenario import Uniform, load_scenario
from flightcal.telemetry import read
from tests import derivative_free

from .cases import spoilt

EXAMPLE = Path(__file__).parents[2] / "examples" / "executable" / "scenario.yaml"


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A closed loop that nobody looks into, and telemetry of the first window."""
    return derivative_free.scene(tmp_path_factory.mktemp("scene"), heater=True)


@pytest.fixture
def run_only(monkeypatch):
    """No simulator is looked into."""
    monkeypatch.setattr(sys.modules["flightcal.check.suspects"], "prepared", lambda *_: None)


def named(scenario, data, prior_runs=None, draws=100):
    problem = build_problem(scenario, data)
    found = suspects(problem, data, prior_runs or PriorRuns(problem, draws))
    print([(suspicion.title, suspicion.nats) for suspicion in found.found], found.why_not)
    return found


def ensemble_at(problem, data, prior_runs=None):
    runs = prior_runs or PriorRuns(problem)
    return ensemble_of(problem, data, runs.thetas, runs.runs)


def moved(data, samples):
    """Observations whose tags are so many samples late, of a minute each."""
    late = {name: data[name].shift(time=samples) for name in ("body_temp", "panel_temp", "heater_status")}
    return spoilt(data, **late)


def test_beside_a_right_simulator_nothing_is_named_and_it_is_said_what_nobody_looked_for(scene, run_only):
    found = named(*scene)
    assert found.looked
    assert found.found == ()
    (line,) = found.lines
    assert line.startswith("not looked for: wrong heaters, modes, drivers")
    good, caution = sorted(suspected(found), key=lambda finding: finding.state)
    assert (good.state, caution.state) == ("good", "warn")
    assert "heaters" not in good.text


@pytest.mark.parametrize(
    ("kind", "about", "wrong"),
    [
        ("bias", "body_temp", lambda data: spoilt(data, body_temp=data["body_temp"] + 9.0)),
        ("swapped", "body_temp", lambda data: spoilt(data, body_temp=data["panel_temp"], panel_temp=data["body_temp"])),
        ("unit", "panel_temp", lambda data: spoilt(data, panel_temp=data["panel_temp"] + 273.15)),
        ("status inverted", "heater_status", lambda data: spoilt(data, heater_status=1.0 - data["heater_status"])),
    ],
)
def test_a_wrong_of_the_telemetry_is_named_first(scene, run_only, kind, about, wrong):
    scenario, data = scene
    first = named(scenario, wrong(data)).found[0]
    assert (first.kind, first.about) == (kind, about)


def test_a_heater_that_never_switches_in_the_simulator_is_named(scene, run_only):
    scenario, data = scene
    heater = scenario.network.heaters["heater"]
    lower = heater.model_copy(update={"on_below": heater.on_below - 90.0, "off_above": heater.off_above - 90.0})
    model = scenario.network.model_copy(update={"heaters": {"heater": lower}})
    first = named(scenario.model_copy(update={"simulator": model}), data).found[0]
    assert (first.kind, first.title) == ("heater", "heater is never on in the simulator")


DRAWS = 50
"""Runs of a program, each of which takes a fifth of a second."""


@pytest.fixture(scope="module")
def program():
    """A program, telemetry that it has made with other numbers, and runs at draws of the prior."""
    scenario = load_scenario(EXAMPLE)
    data = read(scenario)
    return scenario, data, PriorRuns(build_problem(scenario, data), DRAWS)


def test_a_clock_is_named_beside_a_program(program):
    scenario, data, prior_runs = program
    assert named(scenario, data, prior_runs).found == ()
    late = {name: data[name].shift(time=8) for name in ("instrument_temperature", "battery_temperature")}
    first = named(scenario, spoilt(data, **late), draws=DRAWS).found[0]
    assert (first.kind, first.about) == ("clock", "time")
    assert float(first.title.split(" is ")[1].split(" min late")[0]) == pytest.approx(8.0, abs=1.0)


def test_a_time_offset_is_advised_only_where_one_can_be_written(program, scene):
    for (scenario, data, prior_runs), advised in ((program, False), ((*scene, None), True)):
        ensemble = ensemble_at(build_problem(scenario, data), data, prior_runs)
        advice = [wrong.words.advice for wrong in channel_clocks(ensemble)]
        assert advice
        assert all(("time_offset" in text) == advised for text in advice)


def test_what_a_clock_gains_by_chance_where_a_thermostat_is_out_of_step_is_no_clock(scene, run_only):
    scenario, data = scene
    ensemble = ensemble_at(build_problem(scenario, data), data)
    assert _by_chance(ensemble, next(clocks_as_read(ensemble))) > 20.0
    assert named(scenario, moved(data, 9)).found == ()


def test_a_prior_that_is_of_another_value_is_named(tmp_path, run_only):
    scenario, data = derivative_free.scene(tmp_path, heater=False)
    parameters = dict(scenario.parameters)
    prior = Uniform(lower=0.40, upper=0.45)
    parameters["panel_size"] = parameters["panel_size"].model_copy(update={"prior": prior})
    first = named(scenario.model_copy(update={"parameters": parameters}), data).found[0]
    assert (first.kind, first.about) == ("prior", "panel_size")
    assert "above the middle of its prior" in first.sentence


def test_a_simulator_whose_output_is_in_kelvin_is_named(scene, run_only):
    problem, data = build_problem(*scene), scene[1]
    more = np.array([0.0, 273.15])
    by_runs = [
        tuple(replace(window_run, temperatures=window_run.temperatures + more) for window_run in run)
        for run in PriorRuns(problem).runs
    ]
    first = suspects(problem, data, SimpleNamespace(thetas=PriorRuns(problem).thetas, runs=by_runs)).found[0]
    assert (first.kind, first.about) == ("unit", "panel_temp")
    assert first.title == "The simulator's panel_temp is in kelvin, and is read as degC"


def test_it_is_said_where_too_few_simulations_finish(scene, run_only):
    problem, data = build_problem(*scene), scene[1]
    failed = SimpleNamespace(thetas=PriorRuns(problem).thetas, runs=[None] * 100)
    found = suspects(problem, data, failed)
    assert not found.looked
    assert found.why_not == "too few simulations at draws of the prior finish"


def test_a_kelvin_more_at_the_beginning_is_a_kelvin_in_the_first_sample(scene):
    scenario, data = scene
    ensemble = ensemble_at(build_problem(scenario, data), data)
    samples = len(ensemble.rows.kept)
    for channel in range(len(ensemble.channels)):
        assert ensemble.begun_of(channel)[channel * samples] == pytest.approx(1.0, abs=0.1)
