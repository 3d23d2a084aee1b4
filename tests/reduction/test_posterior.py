"""The posterior through a reduced model against the one through the full network, and the command that makes both."""

from __future__ import annotations

import json
from copy import deepcopy

import numpy as np
import pandas as pd
import pytest
from ruamel.yaml import YAML
from typer.testing import CliRunner

from flightcal.calibration import calibrate_nuts
from flightcal.calibration.find_heat import find_heat
from flightcal.calibration.heat_point import start_with_heat
from flightcal.check.heat import beside_heat
from flightcal.cli import app
from flightcal.commands.calibrate import run_experiment
from flightcal.operational.file import load_spacecraft
from flightcal.operational.simulator import fly
from flightcal.problem import build_problem
from flightcal.reduction.file import load_task
from flightcal.reduction.names import node_name
from flightcal.report import read_run
from flightcal.report.panels.heat import node_heats
from flightcal.scenario import (
    NutsSettings,
    calibrated_text,
    lint,
    load_scenario,
    resolved_yaml,
    settable,
    written_values,
)
from flightcal.telemetry import read
from tests import small
from tests.reduction import craft

PARAMETERS = list(craft.REDUCTION["parameters"])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A reduction carried out, and the telemetry of the flight."""
    folder = tmp_path_factory.mktemp("craft")
    biased = deepcopy(craft.SPACECRAFT["thermistors"])
    biased["structure_1"]["bias"] = "0.5 K"
    craft.write(folder, {"projection": {"states": 10}}, {"thermistors": biased})
    return carried_out(folder)


def carried_out(folder):
    """Fly and reduce what a folder's files say."""
    invoked("fly", str(folder / "spacecraft.yaml"), "--out", str(folder / "telemetry.csv"))
    invoked("reduce", str(folder / "reduce.yaml"), "--out", str(folder / "rom"))
    return folder


def invoked(*command):
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output


def changed(folder, source, target, change):
    """A scenario with something changed."""
    yaml = YAML()
    content = yaml.load(source.read_text())
    change(content)
    with (folder / target).open("w") as file:
        yaml.dump(content, file)
    return folder / target


def test_the_command_writes_a_model_a_certificate_and_a_scenario_once(folder):
    certificate = json.loads((folder / "rom" / "certificate.json").read_text())
    assert certificate["states"] == 10
    assert certificate["within_tolerance"]
    assert lint(folder / "rom" / "scenario.yaml") == []
    assert load_scenario(folder / "rom" / "scenario.yaml").observations["structure_1"].bias == 0.0
    again = CliRunner().invoke(app, ["reduce", str(folder / "reduce.yaml"), "--out", str(folder / "rom")])
    assert again.exit_code == 1
    assert "nothing is overwritten" in again.output


def test_a_scenario_with_a_reduced_model_is_read_back_as_it_was(folder):
    scenario = load_scenario(folder / "rom" / "scenario.yaml")
    text = resolved_yaml(scenario, absolute=True)
    (folder / "again.yaml").write_text(text)
    again = load_scenario(folder / "again.yaml")
    assert again.network.nodes == scenario.network.nodes
    assert again.network.errors == scenario.network.errors
    assert again.parameters == scenario.parameters


def test_a_number_of_the_reduced_model_can_be_written_in_the_scenario(folder):
    """A calibrated scenario has no other place for it."""
    source = folder / "rom" / "scenario.yaml"
    scenario = load_scenario(source)
    means = {name: 1.07 * value for name, value in written_values(scenario).items()}
    (folder / "rom" / "calibrated.yaml").write_text(calibrated_text(source.read_text(), scenario, means))
    found = load_scenario(folder / "rom" / "calibrated.yaml")
    assert settable(found)["reduced.blanket"].value == pytest.approx(
        1.07 * written_values(scenario)["blanket"], rel=1e-5
    )
    assert load_again(folder, found) == found.network.reduced_numbers
    built = [build_problem(version, read(version), "train").windows[0].network.network for version in (scenario, found)]
    place = built[0].paths.index("reduced.blanket")
    assert built[1].values[place] == pytest.approx(1.07 * built[0].values[place], rel=1e-5)


def load_again(folder, scenario):
    """Numbers of the reduced model of a scenario that was resolved and read again."""
    (folder / "again.yaml").write_text(resolved_yaml(scenario, absolute=True))
    return load_scenario(folder / "again.yaml").network.reduced_numbers


def test_the_error_of_the_reduced_model_widens_the_likelihood(folder):
    scenario = load_scenario(folder / "rom" / "scenario.yaml")
    problem = build_problem(scenario, read(scenario), "train")
    assert problem.windows[0].simulator.error_basis is not None
    basis, variance = problem.windows[0].simulator.error_basis, problem.windows[0].simulator.error_variance
    for k, channel in enumerate(problem.windows[0].simulator.channels):
        error = scenario.network.errors[channel]
        mean = np.mean(np.einsum("tr,r->t", basis[:, k] ** 2, variance))
        assert mean == pytest.approx(error.offset**2 + error.deviation**2, rel=1e-6)
    z = problem.to_z(problem.priors.median())
    value, gradient = problem.log_density_and_gradient(z)
    assert value == pytest.approx(problem.log_density(z))
    for k in (0, 2, 4):
        step = np.zeros(len(z))
        step[k] = 1e-5
        difference = (problem.log_density(z + step) - problem.log_density(z - step)) / 2e-5
        assert gradient[k] == pytest.approx(difference, rel=1e-3, abs=1e-2)


def test_the_sensors_of_a_reduced_model_have_gain_bias_and_time_offset(folder):
    def errors(content):
        content["observations"]["unit_1"] |= {"gain": 1.1, "bias": "0.5 K", "time_offset": "120 s"}

    path = folder / "rom" / "scenario.yaml"
    exact, erring = (load_scenario(p) for p in (path, changed(folder / "rom", path, "errors.yaml", errors)))
    problems = [build_problem(scenario, read(scenario), "train") for scenario in (exact, erring)]
    theta, window = problems[0].priors.median(), problems[0].windows[0]
    first, second = (problem.windows[0].simulate(theta).temperatures for problem in problems)
    seconds = (window.times - window.times[0]) / np.timedelta64(1, "s")
    unit = window.simulator.channels.index("unit_1")
    later = np.interp(seconds + 120.0, seconds, first[:, unit])
    expected = 1.1 * (later - 273.15) + 273.15 + 0.5
    np.testing.assert_allclose(second[:-2, unit], expected[:-2], atol=0.01)  # the window ends after the last sample
    others = [k for k in range(first.shape[1]) if k != unit]
    # The steps are chosen by what the sensors say, so they differ.
    np.testing.assert_allclose(second[:, others], first[:, others], atol=0.02)


@pytest.mark.parametrize("heat", ["none", pytest.param("default", marks=pytest.mark.slow)])
def test_a_calibration_ends_with_draws_on_the_operational_simulator(folder, heat, monkeypatch):
    if heat == "none":
        small.unsuspected(monkeypatch)

    def quick(content):
        content |= {"heat": "none"} if heat == "none" else {}
        content["calibration"] = {
            "seed": 1,
            "genetic": {"runs": 1, "population": 8, "generations": 4},
            "nuts": {"chains": 2, "draws": 50, "warmup": 50, "max_r_hat": 1.5, "min_ess": 5},
            "prediction": {"simulations": 20},
        }

    summary = run_experiment(
        changed(folder / "rom", folder / "rom" / "scenario.yaml", "quick.yaml", quick), folder / heat
    )
    found = json.loads((summary.run / "full_simulator_check.json").read_text())
    assert (found["flights"], found["failed"]) == (9, 0)
    records = {record["channel"]: record for record in found["records"]}
    assert set(records) == {"battery_1", "unit_1", "structure_1", "battery"}
    # The posterior fits telemetry of the same operational simulator with a noise of 0.05 K. Its thermistor's noise
    # switches the heater early, so the battery may be anywhere in the thermostat's band of 1.5 K, a little exceeded.
    assert all(0.0 < records[sensor]["rms"] < 0.2 for sensor in ("unit_1", "structure_1"))
    assert 0.0 < records["battery_1"]["worst"] < 1.9
    assert records["battery"]["worst"] < 0.05
    page = summary.report.read_text()
    assert 'id="full-simulator"' in page
    assert ('id="heat"' in page) == (heat == "default")
    again = run_experiment(folder / "rom" / "quick.yaml", folder / heat)
    assert json.loads((again.run / "full_simulator_check.json").read_text()) == found


def heated(**heat):
    def change(content):
        content["heat"] = heat
        content["windows"] = {"train": {"start": "2024-03-01T01:40:00", "orbits": 1.0}}

    return change


def test_heat_goes_into_full_nodes_with_a_thermistor_or_a_heater_or_into_those_that_are_named(folder):
    path, nodes = folder / "rom" / "scenario.yaml", []
    scenario = load_scenario(path)
    for version in (scenario, load_scenario(changed(folder / "rom", path, "one.yaml", heated(nodes=["bus_z-_0_0"])))):
        nodes.append(build_problem(version, read(version), "train").windows[0].network.network.heated)
    assert set(nodes[0]) == {"battery", "unit", "bus_z-_1_1"}
    assert nodes[1] == ("bus_z-_0_0",)
    assert "bus_z-_0_0" not in scenario.network.nodes


@pytest.fixture(scope="module")
def without_heat(folder):
    """A calibration problem of the reduced model, whose heat has not been looked at."""
    parts = {"pattern": {"harmonics": 1}, "slow": {"time": "3 h"}}
    path = changed(folder / "rom", folder / "rom" / "scenario.yaml", "heated.yaml", heated(nodes=["unit"], **parts))
    scenario = load_scenario(path)
    return build_problem(scenario, read(scenario), "train")


@pytest.fixture(scope="module")
def heated_problem(without_heat):
    """The same around heat that was found, and z [d]."""
    return start_with_heat(without_heat, find_heat(without_heat, without_heat.priors.median()))


def test_the_error_of_the_reduced_model_stands_beside_heat_in_the_likelihood(heated_problem):
    problem, _ = heated_problem
    (window,), model = problem.windows, problem.heat
    (place,) = [k for k, group in enumerate(model.groups) if group.part == "error"]
    first = sum(kept.shape[1] for kept in model.kept[:place])
    basis = model.kept[place]
    of_errors = window.heat.response[..., first : first + basis.shape[1]]
    simulator = window.simulator
    expected = simulator.error_basis * np.sqrt(simulator.error_variance) @ basis
    np.testing.assert_allclose(of_errors, expected, rtol=1e-9, atol=1e-12)
    # It is no scale of theta: its size is what the reduction measured.
    assert (np.array(model.scales)[model.group[first : first + basis.shape[1]]] == "").all()


def test_a_check_says_what_heat_at_full_nodes_takes_from_the_parameters(without_heat):
    found = beside_heat(without_heat, without_heat.to_z(without_heat.priors.median()))
    assert {parameter.node for parameter in found.parameters} == {"unit"}
    assert all(parameter.growth >= 1.0 for parameter in found.parameters)


def test_the_gradient_beside_heat_is_that_of_differences(heated_problem):
    problem, z = heated_problem
    value, gradient = problem.log_density_and_gradient(z)
    assert value == pytest.approx(problem.log_density(z), rel=1e-9)
    for k, step in enumerate(1e-4 * np.eye(len(z))):
        difference = (problem.log_density(z + step) - problem.log_density(z - step)) / 2e-4
        assert gradient[k] == pytest.approx(difference, rel=1e-3, abs=1e-4 * np.abs(gradient).max()), problem.names[k]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: s.update(heat={"nodes": ["unyt"]}), "unknown node of the full network 'unyt'"),
        (lambda s: s.update(heat={}, discrepancy={"phase": {}}), "found heat beside 'discrepancy'"),
        (lambda s: s["simulator"].update(reduced_model="none.nc"), "which is not there"),
        (lambda s: s["simulator"].update(reduced_model="certificate.json"), "cannot be read as a reduced model"),
        (lambda s: s["simulator"].update(checked_on="none.yaml"), "'none.yaml', which is not there"),
        (lambda s: s["simulator"]["heaters"].update(other={"power": "3 W"}), "which the reduced model does not have"),
        (
            lambda s: s["simulator"].update(reduced={"blankets": 1}),
            "'blankets', which the reduced model does not have; did you mean 'blanket'?",
        ),
        (lambda s: s["simulator"].update(reduced={"blanket": "3 W"}), "simulator.reduced.blanket: found '3 W'"),
        (lambda s: s["parameters"]["blanket"].update(sets="reduced.blankets"), "unknown path 'reduced.blankets'"),
        (lambda s: s["observations"].update(unit_1={"node": "nowhere"}), "unknown node 'nowhere'"),
        (
            lambda s: s["observations"]["unit_1"].update(lag="9 s"),
            "found a lag, expected none: the simulator is a reduced",
        ),
    ],
)
def test_what_is_wrong_in_a_reduced_scenario_is_said(folder, change, message):
    path = changed(folder / "rom", folder / "rom" / "scenario.yaml", "broken.yaml", change)
    assert any(message in str(finding) for finding in lint(path)), [str(finding) for finding in lint(path)]


def known_start(content, initial):
    """Initial temperatures that are known to half a kelvin, heaters as measured, noise as it is: one posterior each."""
    content["simulator"]["heater_input"] = "measured"
    content["simulator"].pop("errors", None)
    content["initial_state"] = {"observed": "0.3 K", "unobserved": "0.3 K"}
    for name, node in content["simulator"]["nodes"].items():
        if node is not None and "initial" in node:
            node["initial"] = f"{initial[name]!r} K"
    for item in content["observations"].values():
        if "node" in item:
            item["noise"] = "0.3 K"
    content["windows"] = {"train": {"start": "2024-03-01T01:40:00", "orbits": 1.0}}


@pytest.fixture(scope="module")
def fine_folder(tmp_path_factory):
    """A reduction whose error is small beside the telemetry's noise, for then alone the two posteriors are the same."""
    folder = tmp_path_factory.mktemp("fine")
    noisy = {name: {**item, "noise": "0.3 K"} for name, item in craft.SPACECRAFT["thermistors"].items()}
    changes = {
        "projection": {"states": 26, "most_states": 26, "follow_within": "20 s"},
        "step": "30 s",
        "training": {**craft.REDUCTION["training"], "draws": 16},
    }
    craft.write(folder, changes, {"thermistors": noisy})
    return carried_out(folder)


@pytest.mark.slow
def test_the_posterior_through_the_reduced_model_is_that_through_the_full_network(fine_folder):
    """Means within 0.2 posterior standard deviations; Monte Carlo error is about 0.05 of them."""
    folder = fine_folder
    task = load_task(folder / "reduce.yaml")
    mission = load_spacecraft(folder / "spacecraft.yaml")
    flight = fly(mission.spacecraft, mission.start, 6100.0, seed=mission.seed)
    at_start = flight.temperatures[600]
    initial = dict(zip(flight.nodes, at_start.tolist(), strict=True))
    by_plain_name = {node_name(name): value for name, value in initial.items()}

    full = task.scenario
    written = folder / "rom" / "scenario.yaml"
    reduced = load_scenario(changed(folder / "rom", written, "known.yaml", lambda s: known_start(s, by_plain_name)))
    reduced = reduced.model_copy(update={"heat": "none"})
    model = full.network.model_copy(
        update={
            "heaters": {
                name: heater.model_copy(update={"measured_by": f"{name}_status"})
                for name, heater in full.network.heaters.items()
            },
            "timeline": reduced.network.timeline,
            "heater_input": "measured",
            "step": 30.0,
            "nodes": {
                name: node.model_copy(update={"initial": initial[name]}) if node.capacity is not None else node
                for name, node in full.network.nodes.items()
            },
        }
    )
    full = reduced.model_copy(
        update={
            "simulator": model,
            "parameters": full.parameters,
            "observations": {
                name: item.model_copy(update={"node": full.observations[name].node}) if item.node else item
                for name, item in reduced.observations.items()
            },
        }
    )
    telemetry = read(reduced)
    settings = NutsSettings(chains=2, draws=600, warmup=300)
    means, deviations = [], []
    for scenario in (full, reduced):
        problem = build_problem(scenario, telemetry, "train")
        assert (problem.windows[0].simulator.error_basis is None) == (scenario is full)
        draws = calibrate_nuts(problem, settings, seed=5).theta.reshape(-1, len(problem.names))
        columns = [problem.names.index(name) for name in PARAMETERS]
        means.append(draws[:, columns].mean(axis=0))
        deviations.append(draws[:, columns].std(axis=0))
    distance = np.abs(means[1] - means[0]) / deviations[0]
    print(pd.DataFrame({"full": means[0], "reduced": means[1], "sd": deviations[0], "distance": distance}, PARAMETERS))
    assert (distance < 0.2).all()
    # The reduced model's error makes the posterior wider, never much narrower.
    assert (deviations[1] > 0.85 * deviations[0]).all()


SECRET = 2.5
"""W, which the unit dissipates besides what the reduction knows of."""


@pytest.fixture(scope="module")
def folder_of_secret(tmp_path_factory):
    """A reduction, and the flight of a craft whose unit dissipates more."""
    folder = tmp_path_factory.mktemp("secret")
    modes = {name: {"unit": f"{watts + SECRET} W"} for name, watts in (("nominal", 12.0), ("imaging", 30.0))}
    craft.write(folder, {"projection": {"states": 10}}, {"modes": modes})
    invoked("fly", str(folder / "spacecraft.yaml"), "--out", str(folder / "telemetry.csv"))
    craft.write(folder, {"projection": {"states": 10}})
    invoked("reduce", str(folder / "reduce.yaml"), "--out", str(folder / "rom"))
    return folder


@pytest.mark.slow
def test_heat_that_a_reduced_model_lacks_is_found_where_it_is_and_goes_on_into_an_unseen_window(folder_of_secret):
    def short(content):
        content["simulator"].pop("checked_on")
        content["calibration"] = {
            "seed": 1,
            "genetic": {"runs": 1, "population": 16, "generations": 10},
            "nuts": {"chains": 2, "draws": 200, "warmup": 200},
            "prediction": {"simulations": 100},
        }

    folder = folder_of_secret
    run_experiment(changed(folder / "rom", folder / "rom" / "scenario.yaml", "short.yaml", short), folder / "run")
    run = read_run(folder / "run")
    for node_heat in node_heats(run):
        low, high = (bound.mean() for bound in node_heat.band)
        true = SECRET if node_heat.node == "unit" else 0.0
        assert low < true < high
        assert high - low < 2.5
    (test,) = run.test_windows.values()
    assert (test["coverage"].values > 0.9).all()
    assert "the surrogate's error, unmodelled heat" in test.attrs["interval_contains"]
