import subprocess
import sys
from datetime import datetime
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from flightcal.errors import ScenarioError
from flightcal.scenario import (
    Beta,
    CircularOrbit,
    HalfNormal,
    LogNormal,
    Normal,
    TruncatedNormal,
    Uniform,
    json_schema,
    lint,
    load_scenario,
    noise_of,
    resolved_yaml,
)
from flightcal.scenario.document import read_document
from flightcal.scenario.reading import read_scenario

EXAMPLE = Path(__file__).parent / "example.yaml"


@pytest.fixture(scope="module")
def scenario():
    return load_scenario(EXAMPLE)


def test_quantities_are_si_and_times_are_utc(scenario):
    orbit = scenario.environment.orbit

    assert isinstance(orbit, CircularOrbit)
    assert orbit.altitude == 693e3
    assert orbit.inclination == pytest.approx(1.7135642596)
    assert orbit.ltan == "18:00"
    assert orbit.epoch == datetime(2024, 3, 1)
    assert scenario.telemetry.average == 60.0
    assert scenario.simulator.heaters["battery_htr"].off_above == 286.15
    assert scenario.simulator.nodes["structure"].boundary == "structure_temp"
    assert scenario.simulator.nodes["shade"].boundary == pytest.approx(253.15)


def test_times_with_an_offset_become_utc(tmp_path):
    text = EXAMPLE.read_text().replace("epoch: 2024-03-01T00:00:00Z", "epoch: 2024-03-01T01:30:00+01:30")
    (tmp_path / "scenario.yaml").write_text(text)

    scenario = load_scenario(tmp_path / "scenario.yaml", telemetry=EXAMPLE.parent)

    assert scenario.environment.orbit.epoch == datetime(2024, 3, 1)


def test_priors_are_in_the_si_unit_of_what_they_set(scenario):
    parameters = scenario.parameters

    assert {name: parameter.unit for name, parameter in parameters.items()} == {
        "radiator_absorptivity": "",
        "battery_link": "W/K",
        "capacities": "",
        "on_below": "K",
        "emissivity": "",
        "imaging_power": "W",
        "sun_coefficient": "W/A",
        "radiator_bias": "K",
    }
    assert parameters["radiator_absorptivity"].prior == Uniform(lower=0.05, upper=0.45)
    assert parameters["battery_link"].prior == LogNormal(median=0.8, factor=2)
    assert parameters["capacities"].prior == TruncatedNormal(mean=1, standard_deviation=0.2, lower=0.5, upper=2)
    assert parameters["capacities"].scales == ("nodes.battery.capacity", "nodes.radiator.capacity")
    assert parameters["on_below"].prior == Normal(mean=283.15, standard_deviation=0.5)
    assert parameters["emissivity"].prior == Beta(alpha=8, beta=2)
    assert parameters["sun_coefficient"].prior == Uniform(lower=5, upper=20)
    assert parameters["radiator_bias"].prior == Normal(mean=0, standard_deviation=0.5)


def test_noise_is_a_number_or_a_prior_in_kelvin(scenario):
    assert scenario.observations["battery_temp"].noise == 0.2
    assert scenario.observations["radiator_temp"].noise == HalfNormal(scale=0.5)
    assert scenario.observations["radiator_temp"].bias == -0.1


def test_noise_may_be_a_model_and_a_channel_has_its_own_or_the_scenarios(tmp_path):
    text = EXAMPLE.read_text().replace("noise: 0.2 K", "noise: {model: ar1, white: {half_normal: 0.1 K}}")
    text = text.replace(", noise: {half_normal: 0.5 K}", "")
    text += "\nnoise: {distribution: student_t, standard_deviation: 0.3 K, degrees_of_freedom: 5}\n"
    (tmp_path / "scenario.yaml").write_text(text)
    (tmp_path / "example.csv").write_text("time\n")
    scenario = load_scenario(tmp_path / "scenario.yaml")
    battery, radiator = (noise_of(scenario, channel) for channel in ("battery_temp", "radiator_temp"))
    assert (battery.model, battery.white) == ("ar1", HalfNormal(scale=0.1))
    assert battery.standard_deviation == HalfNormal(scale=2.0)
    assert (radiator.standard_deviation, radiator.degrees_of_freedom, radiator.model) == (0.3, 5.0, "iid")
    assert radiator is scenario.noise


def test_a_discrepancy_is_read_in_si(tmp_path):
    block = "{phase: {amplitude: 500 mK, lengthscale: {uniform: [0.1, 0.4]}, smoothness: 5/2, shared: []}}"
    (tmp_path / "scenario.yaml").write_text(EXAMPLE.read_text() + f"\ndiscrepancy: {block}\n")
    (tmp_path / "example.csv").write_text("time\n")
    discrepancy = load_scenario(tmp_path / "scenario.yaml").discrepancy
    assert discrepancy.phase.amplitude == 0.5
    assert discrepancy.phase.lengthscale == Uniform(lower=0.1, upper=0.4)
    assert (discrepancy.phase.smoothness, discrepancy.phase.shared) == ("5/2", ())
    assert discrepancy.channels == ()


def test_folder_is_that_of_the_file(scenario):
    assert scenario.folder == EXAMPLE.parent


def test_error_lists_every_finding_with_its_line(tmp_path):
    path = tmp_path / "scenario.yaml"
    text = (
        EXAMPLE.read_text()
        .replace("capacity: 9000 J/K", "capacity: 9000")
        .replace("{node: radiator, bias", "{nod: radiator, bias")
    )
    path.write_text(text)

    with pytest.raises(ScenarioError) as error:
        load_scenario(path, telemetry=EXAMPLE.parent)

    lines = str(error.value).splitlines()
    assert (
        lines[0]
        == f"{path}:26: nodes.battery.capacity: found 9000 without a unit, expected a heat capacity such as '9000 J/K'"
    )
    assert lines[1].startswith(f"{path}:72: observations.radiator_temp")
    assert "did you mean 'node'?" in lines[1] or "did you mean 'node'?" in lines[2]


def test_missing_file_is_said_without_a_line(tmp_path):
    with pytest.raises(ScenarioError, match=r"none\.yaml: cannot be read: No such file or directory"):
        load_scenario(tmp_path / "none.yaml")


def test_telemetry_can_be_read_from_another_folder(tmp_path):
    (tmp_path / "example.csv").write_text("time\n")

    scenario = load_scenario(EXAMPLE, telemetry=tmp_path)

    assert scenario.telemetry.file == (str(tmp_path / "example.csv"),)
    assert scenario.folder == EXAMPLE.parent


def test_telemetry_can_be_read_from_another_file(tmp_path):
    (tmp_path / "later.csv").write_text("time\n")

    assert load_scenario(EXAMPLE, telemetry=tmp_path / "later.csv").telemetry.file == (str(tmp_path / "later.csv"),)


def test_packets_are_looked_for_in_another_folder_each_by_its_name(tmp_path):
    one_file = "  file: example.csv\n  time: {column: time, format: iso8601}\n"
    packets = "".join(f"    {name}: {{file: {name}.csv, time: {{'column': time}}}}\n" for name in "ab")
    text = EXAMPLE.read_text().replace(one_file, f"  packets:\n{packets}")
    (tmp_path / "scenario.yaml").write_text(text.replace("{column: ", "{packet: b, column: "))
    (tmp_path / "later").mkdir()
    for name in ("a.csv", "b.csv"):
        (tmp_path / "later" / name).write_text("time\n")

    scenario = load_scenario(tmp_path / "scenario.yaml", telemetry=tmp_path / "later")

    assert scenario.telemetry.files == (str(tmp_path / "later" / "a.csv"), str(tmp_path / "later" / "b.csv"))


def test_other_telemetry_that_does_not_exist_is_a_finding(tmp_path):
    with pytest.raises(ScenarioError, match=r"telemetry\.file: found no such file"):
        load_scenario(EXAMPLE, telemetry=tmp_path / "none.csv")


def test_importing_the_scenario_loads_no_slow_package():
    slow = ["jax", "numba", "pandas", "pint", "numpy", "xarray", "ruamel.yaml", "sgp4"]
    code = f"import sys, flightcal.scenario; print([name for name in {slow} if name in sys.modules])"

    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "[]"


@pytest.mark.parametrize("empty", ["{}", ""])
def test_scenario_without_parameters_is_sound(tmp_path, empty):
    text = EXAMPLE.read_text()
    start, end = text.index("parameters:\n"), text.index("observations:\n")
    path = tmp_path / "scenario.yaml"
    path.write_text(f"{text[:start]}parameters: {empty}\n{text[end:]}")

    assert lint(path, telemetry=EXAMPLE.parent) == []
    scenario = load_scenario(path, telemetry=EXAMPLE.parent)
    assert scenario.parameters == {}
    path.write_text(resolved_yaml(scenario, absolute=True))
    assert load_scenario(path).parameters == {}
    assert Draft202012Validator(json_schema()).is_valid(read_document(path).data)


def test_scenario_is_made_of_the_blocks_that_the_checks_see():
    reading = read_scenario(EXAMPLE)
    scenario, blocks = reading.scenario, reading.blocks

    assert scenario.environment is blocks.environment
    for section in ("nodes", "faces", "heaters", "modes", "loads"):
        for name, block in getattr(scenario.simulator, section).items():
            assert block is getattr(blocks, section)[name]
    for section in ("parameters", "observations", "windows"):
        assert all(block is getattr(blocks, section)[name] for name, block in getattr(scenario, section).items())
