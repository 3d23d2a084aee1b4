"""Plates and boxes in a scenario, against the network that they stand for."""

import re

import pytest
from jsonschema import Draft202012Validator
from typer.testing import CliRunner

from flightcal.cli import app
from flightcal.scenario import calibrated_text, json_schema, lint, load_scenario, resolved_yaml
from flightcal.scenario.document import read_document

BASE = """\
name: meshed
telemetry:
  file: telemetry.csv
  time: {column: time}
  channels: {battery: {column: battery, unit: degC, kind: temperature}}
environment:
  orbit: {altitude: 693 km, inclination: 98.18 deg, ltan: "22:30", epoch: 2024-03-01T00:00:00}
simulator:
  nodes:
    battery: {capacity: 9000 J/K}
  conductors:
    - {between: [battery, "fin[0,0]"], conductance: 2 W/K}
parameters:
  white: {sets: "faces.fin[?,0]+.absorptivity", prior: {uniform: [0.1, 0.4]}}
  capacity: {sets: "nodes.fin[1,0].capacity", prior: {uniform: [500 J/K, 900 J/K]}}
observations:
  battery: {node: battery, noise: 0.1 K}
heat: none
windows:
  train: {start: 2024-03-01T00:00:00, orbits: 1}
"""
PLATE = """\
  initial: 8 degC
  materials: {aluminium: {conductivity: 150 W/m/K, density: 2700 kg/m^3, specific_heat: 900 J/kg/K}}
  coatings: {white: {absorptivity: 0.2, emissivity: 0.85}, black: {absorptivity: 0.9, emissivity: 0.8}}
  insulations: {blanket: {effective_emissivity: 0.02, coating: black}}
  plates:
    fin:
      corner: [0 m, 0 m, 0 m]
      size: [0.6 m, 0.2 m, 0 m]
      thickness: 5 mm
      material: aluminium
      mesh: [2, 1]
      positive: {coating: white}
      negative: {coating: black, insulation: blanket}
"""
BY_HAND = """\
    battery: {capacity: 9000 J/K, initial: 8 degC}
    "fin[0,0]": {capacity: 729 J/K, initial: 8 degC}
    "fin[1,0]": {capacity: 729 J/K, initial: 8 degC}
    "fin[0,0]-insulation": {capacity: 4.62 J/K, initial: 8 degC}
    "fin[1,0]-insulation": {capacity: 4.62 J/K, initial: 8 degC}
  faces:
    "fin[0,0]+": {node: "fin[0,0]", area: 0.06 m^2, normal: [0, 0, 1], absorptivity: 0.2, emissivity: 0.85}
    "fin[1,0]+": {node: "fin[1,0]", area: 0.06 m^2, normal: [0, 0, 1], absorptivity: 0.2, emissivity: 0.85}
    "fin[0,0]-": {node: "fin[0,0]-insulation", area: 0.06 m^2, normal: [0, 0, -1], absorptivity: 0.9, emissivity: 0.8}
    "fin[1,0]-": {node: "fin[1,0]-insulation", area: 0.06 m^2, normal: [0, 0, -1], absorptivity: 0.9, emissivity: 0.8}
  conductors:
    - {between: ["fin[0,0]", "fin[1,0]"], conductance: 0.5 W/K}
    - {between: ["fin[0,0]", "fin[0,0]-insulation"], radiative: 0.0012 m^2}
    - {between: ["fin[1,0]", "fin[1,0]-insulation"], radiative: 0.0012 m^2}
"""
BOX = """\
  boxes:
    bus:
      corner: [0 m, 0 m, 1 m]
      size: [0.4 m, 0.4 m, 0.4 m]
      thickness: 10 mm
      material: aluminium
      mesh: 2
      outside: {coating: white}
      inside: black
      joints: 6 W/m/K
"""


def edited(text, *replacements):
    for old, new in replacements:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


MESHED = edited(BASE, ("simulator:\n", "simulator:\n" + PLATE))


@pytest.fixture
def write(tmp_path):
    def written(text, name="scenario.yaml"):
        (tmp_path / "telemetry.csv").write_text("time\n")
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return written


def findings(path):
    return [str(finding).removeprefix(f"{path}:") for finding in lint(path)]


def near(block):
    """Its values, with numbers that may differ by rounding."""
    values = {key: value for key, value in block.model_dump().items() if value is not None}
    return {key: pytest.approx(value) if isinstance(value, float) else value for key, value in values.items()}


def test_a_plate_is_the_network_that_it_stands_for(write):
    meshed = load_scenario(write(MESHED)).network
    network = ("    battery: {capacity: 9000 J/K}\n  conductors:\n", BY_HAND)
    by_hand = load_scenario(write(edited(BASE, network))).network
    assert not meshed.plates
    assert not meshed.materials
    for key in ("nodes", "faces"):
        found, expected = getattr(meshed, key), getattr(by_hand, key)
        assert {name: block.model_dump(exclude_none=True) for name, block in found.items()} == {
            name: near(block) for name, block in expected.items()
        }
    links = {block.label: block.model_dump(exclude_none=True) for block in meshed.conductors}
    assert links == {block.label: near(block) for block in by_hand.conductors}


def test_a_resolved_scenario_has_the_network_of_its_plates_and_boxes(write):
    scenario = load_scenario(write(edited(MESHED, ("  nodes:\n", BOX + "  nodes:\n"))))
    text = resolved_yaml(scenario)
    assert "boxes" not in text
    assert len(scenario.network.nodes) == 1 + 4 + 6 * 4
    assert load_scenario(write(text)) == scenario


def test_the_schema_knows_plates_and_boxes(write):
    validator = Draft202012Validator(json_schema())
    for text in (MESHED, edited(MESHED, ("  nodes:\n    battery: {capacity: 9000 J/K}\n", BOX))):
        assert list(validator.iter_errors(read_document(write(text)).data)) == []
    assert not validator.is_valid(read_document(write(edited(MESHED, ("mesh: [2, 1]", "mesh: [2, 0]")))).data)


def test_what_is_written_of_a_cell_or_its_face_replaces_what_the_mesh_says(write):
    cell = '    "fin[1,0]": {initial: 20 degC}\n  faces: {"fin[1,0]+": {absorptivity: 0.3}}\n  conductors:'
    network = load_scenario(write(edited(MESHED, ("  conductors:", cell)))).network
    assert network.nodes["fin[1,0]"].initial == 293.15
    assert network.nodes["fin[1,0]"].capacity == pytest.approx(729.0)
    assert network.faces["fin[1,0]+"].absorptivity == 0.3
    assert network.faces["fin[1,0]+"].area == pytest.approx(0.06)


def test_the_capacity_of_a_box_s_cell_may_depend_on_temperature(write):
    text = edited(
        MESHED,
        ("  nodes:\n", BOX + '  nodes:\n    "bus.x+[0,1]": {capacity_slope: 0.002 1/K, at: 0 degC}\n'),
        (
            "parameters:\n",
            'parameters:\n  slope: {sets: "nodes.bus.x+[0,1].capacity_slope", prior: {uniform: [0 1/K, 0.004 1/K]}}\n',
        ),
    )
    scenario = load_scenario(write(text))
    cell, other = (scenario.network.nodes[f"bus.x+[0,{k}]"] for k in (1, 0))
    assert (cell.capacity, cell.initial) == (other.capacity, other.initial)
    assert (cell.capacity_slope, cell.at, other.capacity_slope) == (0.002, 273.15, None)
    assert scenario.parameters["slope"].sets == ("nodes.bus.x+[0,1].capacity_slope",)
    again = load_scenario(
        write(
            calibrated_text(text, scenario, {"white": 0.3, "capacity": 650.0, "initial.battery": 290.0, "slope": 0.003})
        )
    ).network.nodes["bus.x+[0,1]"]
    assert (again.capacity_slope, again.at, again.capacity) == (0.003, 273.15, pytest.approx(cell.capacity))


def test_parameters_set_numbers_of_cells_alone_and_by_pattern(write):
    parameters = load_scenario(write(MESHED)).parameters
    assert parameters["white"].sets == ("faces.fin[0,0]+.absorptivity", "faces.fin[1,0]+.absorptivity")
    assert parameters["capacity"].unit == "J/K"
    nothing = edited(MESHED, ("fin[?,0]+", "fun*"))
    assert findings(write(nothing)) == [
        "27: parameters.white.sets: found 'faces.fun*.absorptivity', which fits no number"
    ]


def test_a_calibrated_number_of_a_cell_is_written_beside_its_plate(write):
    scenario = load_scenario(write(MESHED))
    means = {"white": 0.3, "capacity": 650.0, "initial.battery": 290.0}
    again = load_scenario(write(calibrated_text(MESHED, scenario, means)))
    assert again.network.nodes["fin[1,0]"].capacity == 650.0
    assert again.network.nodes["fin[0,0]"].capacity == pytest.approx(729.0)
    assert [face.absorptivity for face in again.network.faces.values()] == [0.3, 0.3, 0.9, 0.9]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("thickness: 5 mm", "thickness: 5", "plates.fin.thickness: found 5 without a unit"),
        ("mesh: [2, 1]", "mesh: [2, 0]", "plates.fin.mesh[1]: found 0, expected at least 1"),
        ("mesh: [2, 1]", "mesh: [2, 1000]", "plates.fin.mesh[1]: found 1000, expected at most 100"),
        ("      mesh:", "      mush:", "plates.fin.mush: unknown key 'mush'"),
        ("0.2 m, 0 m]", "0.2 m, 1 m]", "plates.fin.size: found [0.6 m, 0.2 m, 1 m], expected exactly one zero"),
        ("material: aluminium", "material: alu", "plates.fin.material: found the material 'alu', expected aluminium"),
        ("positive: {coating: white}", "positive: {coating: w}", "plates.fin.positive.coating: found the coating 'w'"),
        ("initial: 8 degC", "initial: 8", "initial: found 8 without a unit"),
    ],
)
def test_a_broken_plate_is_told_with_line_and_field_and_nothing_else_is(write, old, new, message):
    broken = edited(MESHED, (old, new))
    line = MESHED[: MESHED.index(old)].count("\n") + 1
    found = [finding for finding in findings(write(broken)) if "missing key" not in finding]
    assert len(found) == 1
    assert found[0].startswith(f"{line}: {message}")


@pytest.mark.parametrize(
    ("replacement", "message"),
    [
        (("  initial: 8 degC\n", ""), "8: simulator: missing key 'initial'"),
        (("  plates:\n    fin:", '  plates:\n    "f[n":'), "plates.f[n: found the name 'f[n'"),
        (
            ("  initial:", "  joints: [{between: [fin, f], conductance: 1 W/m/K}]\n  initial:"),
            "joints[0].between: found",
        ),
        (("  orbit: {", "  period: 90 min #{"), "plates.fin: found a face without an orbit"),
        (("simulator:", "simulator:\n  reduced_model: rom.nc"), "materials: found 'materials' beside 'reduced_model'"),
        (("mesh: [2, 1]", "mesh: [1, 1]"), "parameters.capacity.sets: unknown path 'nodes.fin[1,0].capacity'"),
        (
            ("{coating: black, insulation: blanket}", "{coating: black, enclosure: gap}"),
            "plates: found an enclosure 'gap' with up to 100% of a cell's view open to space",
        ),
    ],
)
def test_what_does_not_fit_together_is_told_once(write, replacement, message):
    found = findings(write(edited(MESHED, replacement)))
    assert len([finding for finding in found if re.search(rf"(^|\W){re.escape(message)}", finding)]) == 1, found


def test_a_new_scenario_with_a_box_is_simulated(tmp_path):
    """As a user does: init, a box in the file, lint, simulate; and as its network written out."""
    run = CliRunner().invoke
    assert run(app, ["init", str(tmp_path)]).exit_code == 0
    file = tmp_path / "scenario.yaml"
    shorter = file.read_text().replace("orbits: 2}", "orbits: 0.5}")
    text = edited(shorter, ("\nsimulator:\n", f"\nsimulator:\n{PLATE}{BOX}"))
    link = '  conductors:\n    - {between: [battery, "bus.z-[0,1]"], conductance: 0.2 W/K}\n'
    cell = '    "bus.z-[0,1]": {capacity_slope: 0.02 1/K}\n'
    constant = tmp_path / "constant.yaml"
    constant.write_text(edited(text, ("  conductors:\n", link)))
    file.write_text(edited(constant.read_text(), ("  conductors:\n", f"{cell}  conductors:\n")))
    linted = run(app, ["lint", str(file)])
    assert linted.exit_code == 0, linted.output
    written_out = tmp_path / "written_out.yaml"
    written_out.write_text(resolved_yaml(load_scenario(file)))
    for path in (file, written_out, constant):
        done = run(app, ["simulate", str(path), "--out", str(path.with_suffix(".csv"))])
        assert done.exit_code == 0, done.output
    of_file, of_network, without_slope = (
        source.with_suffix(".csv").read_text() for source in (file, written_out, constant)
    )
    assert of_file == of_network != without_slope
