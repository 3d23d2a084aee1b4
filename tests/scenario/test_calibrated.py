"""A scenario's text with calibrated numbers in it."""

from pathlib import Path

import numpy as np
import pytest

from flightcal.probability import Priors
from flightcal.scenario import (
    RewritingError,
    calibrated_text,
    load_scenario,
    parameter_units,
    resolved_yaml,
    settable,
    written_unit,
    written_values,
)

TELEMETRY = Path(__file__).parent / "example.csv"
PACKETS = """\
  packets:
    hk: {file: [a.csv, "b.csv"], time: {column: time}}
    power:
      file: c.csv # where it lies
      time: {column: time}
"""
TEXT = """\
# Größe: 3 µm  (not only ASCII before numbers)
name: example
telemetry:
  file: example.csv # where it lies
  time: {column: time}
  channels:
    battery_temp: {column: TT_BAT, unit: degC, kind: temperature}
environment: {orbit: {altitude: 693 km, inclination: 98.2 deg, ltan: "10:30", epoch: 2024-03-01T00:00:00}}
simulator:
  nodes:
    battery: {capacity: 9 kJ/K, initial: 12 degC} # 9000 J/K
    # the radiator
    radiator: {capacity: "4000 J/K", initial: -3 degC}
  conductors:
    - {between: [battery, radiator], conductance: 0.8 W/K}
    - between: [radiator, battery]
      name: "strap"
      conductance: 200 mW/K # a comment that stays
  faces:
    space: {node: radiator, area: 0.4 m^2, normal: [0, 0, -1], absorptivity: 0.15, emissivity: 0.8}
  heaters:
    heater: {node: battery, power: 12 W, sensor: battery, on_below: 10 degC, off_above: 13 degC}
  modes:
    nominal: {battery: 5 W}
  timeline: [{at: 2024-03-01T00:00:00, mode: nominal}]
parameters:
  link: {sets: conductors.battery-radiator.conductance, prior: {lognormal: {median: 900 mW/K, factor: 1.5}}}
  strap: {sets: conductors.strap.conductance, prior: {uniform: [0.1 W/K, 0.4 W/K]}}
  capacities: {scales: [nodes.battery.capacity, nodes.radiator.capacity], prior: {uniform: [0.5, 2]}}
  coating: {scales: faces.space.emissivity, prior: {uniform: [0.5, 1.25]}}
  on_below: {sets: heaters.heater.on_below, prior: {normal: {mean: 10 degC, standard_deviation: 0.5 K}}}
  albedo: {sets: environment.albedo, prior: {beta: {alpha: 3, beta: 7}}}
  bias: {sets: observations.battery_temp.bias, prior: {normal: {mean: 0 K, standard_deviation: 0.5 K}}}
  power: {sets: modes.nominal.battery, prior: {half_normal: 9 W}}
observations:
  battery_temp: {node: battery}
windows:
  train: {start: 2024-03-01T00:00:00, orbits: 2}
"""
MEANS = {
    "link": 0.731234567, "strap": 0.25, "capacities": 1.1, "coating": 1.1, "on_below": 283.65, "albedo": 0.31,
    "bias": -0.2, "power": 6.5, "initial.battery": 285.4, "initial.radiator": 270.0,
}  # fmt: skip


def load(folder, text):
    (folder / "example.csv").write_bytes(TELEMETRY.read_bytes())
    (folder / "scenario.yaml").write_text(text, encoding="utf-8")
    return load_scenario(folder / "scenario.yaml")


@pytest.fixture
def scenario(tmp_path):
    return load(tmp_path, TEXT)


def values(scenario):
    return {path: number.value for path, number in settable(scenario).items()}


def elsewhere(folder, text):
    """The scenario of a text in another folder."""
    (folder / "other").mkdir()
    (folder / "other" / "calibrated.yaml").write_text(text, encoding="utf-8")
    return load_scenario(folder / "other" / "calibrated.yaml")


def test_numbers_are_replaced_in_their_units_and_all_else_stays(scenario):
    lines = calibrated_text(TEXT, scenario, MEANS).splitlines()
    changed = {line.strip() for line in lines} - {line.strip() for line in TEXT.splitlines()}
    assert len(lines) == len(TEXT.splitlines())
    assert changed == {
        f'file: "{scenario.folder.absolute() / "example.csv"}" # where it lies',
        'environment: {albedo: 0.31, orbit: {altitude: 693 km, inclination: 98.2 deg, ltan: "10:30", '
        "epoch: 2024-03-01T00:00:00}}",
        "battery: {capacity: 9.9 kJ/K, initial: 12.25 degC} # 9000 J/K",
        'radiator: {capacity: "4400 J/K", initial: -3.15 degC}',
        "- {between: [battery, radiator], conductance: 0.731235 W/K}",
        "conductance: 250 mW/K # a comment that stays",
        "space: {node: radiator, area: 0.4 m^2, normal: [0, 0, -1], absorptivity: 0.15, emissivity: 0.88}",
        "heater: {node: battery, power: 12 W, sensor: battery, on_below: 10.5 degC, off_above: 13 degC}",
        "nominal: {battery: 6.5 W}",
        "capacities: {scales: [nodes.battery.capacity, nodes.radiator.capacity], "
        "prior: {uniform: [0.454546, 1.81818]}}",
        "coating: {scales: faces.space.emissivity, prior: {uniform: [0.454546, 1.13636]}}",
        "battery_temp: {bias: -0.2 K, node: battery}",
    }


def test_what_is_calibrated_can_be_read_anywhere_and_has_the_numbers(scenario, tmp_path):
    found = elsewhere(tmp_path, calibrated_text(TEXT, scenario, MEANS, "From a run.\n\nTwo lines."))
    expected = values(scenario) | {
        "conductors.battery-radiator.conductance": MEANS["link"], "conductors.strap.conductance": 0.25,
        "nodes.battery.capacity": 9900.0, "nodes.radiator.capacity": 4400.0, "faces.space.emissivity": 0.88,
        "heaters.heater.on_below": 283.65, "environment.albedo": 0.31, "observations.battery_temp.bias": -0.2,
        "modes.nominal.battery": 6.5,
    }  # fmt: skip
    assert values(found) == pytest.approx(expected, rel=2e-6)
    assert (tmp_path / "other" / "calibrated.yaml").read_text().startswith("# From a run.\n#\n# Two lines.\n# Gr")
    assert (found.folder / found.telemetry.file[0]).is_file()


def test_files_of_packets_are_absolute_too(tmp_path):
    text = TEXT.replace("  file: example.csv # where it lies\n  time: {column: time}\n", PACKETS)
    text = text.replace("{column: TT_BAT", "{packet: hk, column: TT_BAT")
    for name in ("a.csv", "b.csv", "c.csv"):
        (tmp_path / name).write_text("time\n")
    (tmp_path / "scenario.yaml").write_text(text)
    found = elsewhere(tmp_path, calibrated_text(text, load_scenario(tmp_path / "scenario.yaml"), MEANS))
    assert found.telemetry.files == tuple(str(tmp_path / name) for name in ("a.csv", "b.csv", "c.csv"))


def test_what_is_believed_of_every_number_is_as_before(scenario, tmp_path):
    found = elsewhere(tmp_path, calibrated_text(TEXT, scenario, MEANS))

    def believed(version, path):
        (parameter,) = (p for p in version.parameters.values() if path in (*p.sets, *p.scales))
        quantiles = Priors(("x",), (parameter.prior,)).quantile(np.array([[0.01], [0.5], [0.99]]))[:, 0]
        return quantiles * (1.0 if parameter.sets else values(version)[path])

    for path in ("conductors.strap.conductance", "nodes.battery.capacity", "faces.space.emissivity"):
        np.testing.assert_allclose(believed(found, path), believed(scenario, path), rtol=1e-5)


def test_a_factor_that_reached_the_bound_of_its_number_still_may(scenario, tmp_path):
    """0.8 times 1.25 is the highest emissivity: rounding must not pass it."""
    for k, mean in enumerate(np.linspace(0.51, 1.24, 40)):
        folder = tmp_path / str(k)
        folder.mkdir()
        elsewhere(folder, calibrated_text(TEXT, scenario, MEANS | {"coating": float(mean)}))


def test_several_numbers_that_are_not_written_are_added_to_one_block(tmp_path):
    text = TEXT.replace("sets: modes.nominal.battery", "sets: environment.earth_infrared").replace("9 W", "900 W/m^2")
    text = text.replace("environment: {orbit: ", "environment:\n  orbit: ").replace(":00}}\nsim", ":00}\nsim")
    lines = calibrated_text(text, load(tmp_path, text), MEANS | {"power": 240.0}).splitlines()
    place = lines.index("environment:")
    assert lines[place + 1 : place + 3] == ["  albedo: 0.31", "  earth_infrared: 240 W/m^2"]
    assert lines[place + 3].startswith("  orbit: {altitude: 693 km")


def test_the_resolved_text_takes_the_numbers_too(scenario, tmp_path):
    text = calibrated_text(resolved_yaml(scenario, absolute=True), scenario, MEANS)
    again = elsewhere(tmp_path, text)
    (tmp_path / "third").mkdir()
    other = elsewhere(tmp_path / "third", calibrated_text(TEXT, scenario, MEANS))
    assert values(again) == pytest.approx(values(other), rel=1e-6)


def test_numbers_that_share_a_place_are_not_rewritten(tmp_path):
    text = TEXT.replace("conductance: 0.8 W/K", "conductance: &link 0.8 W/K").replace("200 mW/K #", "*link #")
    scenario = load(tmp_path, text)
    with pytest.raises(RewritingError, match="found an alias"):
        calibrated_text(text, scenario, MEANS)


def test_units_are_those_in_which_priors_are_written(scenario):
    units = {name: unit.name for name, unit in parameter_units(TEXT, scenario).items()}
    assert units == {
        "link": "mW/K", "strap": "W/K", "capacities": "", "coating": "", "on_below": "degC", "albedo": "",
        "bias": "K", "power": "W",
    }  # fmt: skip
    assert parameter_units(TEXT, scenario)["on_below"].of(283.15) == pytest.approx(10.0)
    assert written_unit("degC", "K", difference=True).of(2.0) == pytest.approx(2.0)


def test_parameters_as_they_are_written_are_the_numbers_that_they_set(scenario):
    found = written_values(scenario)
    assert (found["link"], found["capacities"], found["albedo"]) == (0.8, 1.0, 0.3)


def test_files_and_inputs_of_an_external_simulator_are_rewritten(tmp_path):
    source = Path(__file__).parents[2] / "examples" / "executable" / "scenario.yaml"
    scenario = load_scenario(source)
    means = {name: 1.1 * value for name, value in written_values(scenario).items()}
    found = elsewhere(tmp_path, calibrated_text(source.read_text(encoding="utf-8"), scenario, means))
    assert values(found) == pytest.approx({name: 1.1 * value for name, value in values(scenario).items()})
    assert found.simulator.executable.files == (str(source.parent.absolute() / "simulator.py"),)
