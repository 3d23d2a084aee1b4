import re
import zipfile
from pathlib import Path

import pytest

from flightcal.scenario import input_files, load_scenario, noise_of, resolved_yaml, write_template
from flightcal.scenario.document import parse_document
from flightcal.scenario.external import simulator_files

EXAMPLE = Path(__file__).parent / "example.yaml"
PACKETS = """\
  packets:
    thermal: {file: example.csv, time: {column: time}}
    power: {file: power.xlsx, sheet: EPS, time: {column: t, format: unix-ms}, average: 5 min}
"""
TLE = """tle:
      - "1 25544U 98067A   24061.50000000  .00016717  00000+0  30000-3 0  9995"
      - "2 25544  51.6400 208.9163 0006317  69.9862  25.2906 15.49560000000008"
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "example.csv").write_text("time\n")
    (tmp_path / "flown.csv").write_text("time,x,y,z\n")
    return tmp_path


def resolve(folder, text, name="scenario.yaml"):
    (folder / name).write_text(text)
    return load_scenario(folder / name)


@pytest.mark.parametrize(
    "edit",
    [
        ("", ""),
        ("{altitude: 693 km, inclination: 98.18 deg, ltan: 18:00, epoch: 2024-03-01T00:00:00Z}", "\n    " + TLE),
        (
            "{altitude: 693 km, inclination: 98.18 deg, ltan: 18:00, epoch: 2024-03-01T00:00:00Z}",
            "{positions: flown.csv}",
        ),
        ("attitude: nadir", "attitude: {spin_axis: [0, 0, 1], direction: [1, 0.5, 0]}"),
        ("attitude: nadir", "attitude: {inertial: [0.6, 0.8, 0, 0]}"),
        (
            "attitude: nadir",
            "attitude: {aligned: {axis: [0, 0, 1], towards: sun}, constrained: {axis: [1, 0, 0], towards: [1, 0, 2]}}",
        ),
        ("attitude: nadir", "attitude: {quaternions: flown.csv}"),
        ("{node: radiator, bias: -0.1 K,", "{node: radiator, bias: -0.1 K, gain: 0.98, lag: 20 s, time_offset: -2 s,"),
        ("description: Battery", 'description: "on: 18:00 #\\n\\n- ünï & *x"\n# Battery'),
        ("{column: time, format: iso8601}", "{column: 'on', format: unix}"),
        (
            "{column: time, format: iso8601}",
            "{column: t, format: clock, epoch: 2000-01-01T12:00:00, rate: 65536 Hz, leap_seconds: true}",
        ),
        (
            "{column: time, format: iso8601}",
            "{column: [a, b], format: clock, epoch: 1958-01-01, rate: 1 1/day, fine: 86400000, invalid: ['', 0]}",
        ),
        ("{column: time, format: iso8601}", "{column: [date, 'on'], format: '%d.%m.%Y %H:%M'}\n  header: 4"),
        ("kind: status, on: [1, ON]", "kind: status, bits: 3, base: 16"),
        ("kind: status, on: [1, ON]", "kind: status, unit: mA, on_above: 90 mA"),
        ("kind: status, on: [1, ON]", "kind: status, bits: 3"),
        ("kind: status, on: [1, ON]", "kind: status, bits: [3, 4], on: 2"),
        ("kind: status, on: [1, ON]", "kind: status, on: HEATING, off: [SAFE, 3]"),
        ("windows:", "noise: {model: ar1, white: {half_normal: 0.1 K}, correlation_time: 5 min}\nwindows:"),
        ("noise: 0.2 K", "noise: {distribution: student_t, degrees_of_freedom: {lognormal: {median: 5, factor: 2}}}"),
        ("noise: 0.2 K", "noise: {quantisation: 0.1 K}"),
        ("windows:", "discrepancy: {phase: {lengthscale: {uniform: [0.1, 0.3]}, shared: []}}\nwindows:"),
        ("normal: all", "normal: {tracks_sun_about: [0, 1, 0.5], back: true}"),
        ("heat: none", ""),
        ("heat: none", "heat: {}"),
        ("heat: none", "heat: {nodes: [battery], pattern: {harmonics: 3}, gains: null, slow: null}"),
    ],
    ids=[
        "as it is",
        "tle",
        "positions",
        "spin",
        "inertial",
        "aligned",
        "quaternions",
        "sensor",
        "odd text",
        "odd column",
        "clock",
        "days",
        "pattern",
        "base",
        "threshold",
        "bit",
        "bits",
        "words",
        "ar1",
        "student",
        "rounded",
        "discrepancy",
        "drive",
        "heat left out",
        "heat",
        "heat over a driver",
    ],
)
def test_resolved_scenario_loads_as_an_equal_one(folder, edit):
    scenario = resolve(folder, EXAMPLE.read_text().replace(*edit))

    again = resolve(folder, resolved_yaml(scenario), "resolved.yaml")

    assert again == scenario
    assert resolved_yaml(again) == resolved_yaml(scenario)


def in_packets(text):
    """The example with its telemetry in two packets, one of them a sheet."""
    text = text.replace("  file: example.csv\n  time: {column: time, format: iso8601}\n", PACKETS)
    text = text.replace("{column: I_", "{packet: power, column: I_").replace(
        "{column: [I_", "{packet: power, column: [I_"
    )
    return re.sub(r"(_temp|_htr): {column", r"\1: {packet: thermal, column", text)


def test_packets_round_trip_with_paths_of_their_own(folder):
    (folder / "power.xlsx").write_text("")
    scenario = resolve(folder, in_packets(EXAMPLE.read_text()))
    assert scenario.telemetry.files == ("example.csv", "power.xlsx")
    assert list(scenario.telemetry.channels_of("power")) == ["bus_power", "photo_current"]
    assert input_files(scenario)[:2] == [folder / "example.csv", folder / "power.xlsx"]

    assert resolve(folder, resolved_yaml(scenario), "resolved.yaml") == scenario
    (folder / "elsewhere").mkdir()
    again = resolve(folder / "elsewhere", resolved_yaml(scenario, absolute=True))
    assert again.telemetry.files == (str(folder / "example.csv"), str(folder / "power.xlsx"))


def test_template_round_trips(tmp_path):
    path, _ = write_template(tmp_path)
    scenario = load_scenario(path)

    assert resolve(tmp_path, resolved_yaml(scenario), "resolved.yaml") == scenario


def test_defaults_are_written_out_with_si_units(folder):
    data = parse_document(resolved_yaml(resolve(folder, EXAMPLE.read_text()))).data

    assert data["environment"]["solar_constant"] == "1361.0 W/m^2"
    assert data["initial_state"] == {"observed": "2.0 K", "unobserved": "5.0 K"}
    assert data["calibration"]["prediction"]["initial_span"] == "600.0 s"
    assert data["simulator"]["heaters"]["battery_htr"]["on_below"] == "283.15 K"
    assert data["parameters"]["sun_coefficient"] == {
        "sets": ["loads.sun.coefficient"],
        "prior": {"uniform": ["5.0 W/A", "20.0 W/A"]},
    }
    assert data["telemetry"]["channels"]["photo_current"]["stale_after"] is None


def test_noise_that_is_left_out_beside_heat_stays_so(folder):
    """Written noise counts, and beside heat the default is another."""
    scenario = resolve(folder, EXAMPLE.read_text().replace("heat: none", "heat: {}").replace(", noise: 0.2 K", ""))

    again = resolve(folder, resolved_yaml(scenario), "resolved.yaml")

    assert noise_of(scenario, "battery_temp").model == noise_of(again, "battery_temp").model == "ar1"


def test_absolute_paths_let_the_copy_stand_in_another_folder(folder, tmp_path_factory):
    text = EXAMPLE.read_text().replace("attitude: nadir", "attitude: {quaternions: flown.csv}")
    scenario = resolve(folder, text)

    again = resolve(tmp_path_factory.mktemp("run"), resolved_yaml(scenario, absolute=True))

    assert again.telemetry.file == (str(folder / "example.csv"),)
    assert again.environment.attitude.quaternions == str(folder / "flown.csv")
    assert again.parameters == scenario.parameters


EXTERNAL = """  {kind}
  inputs:
    link: 0.8 W/K
    scale: 1.5
    first: {{value: 12 degC, unit: degC, initial_of: battery}}
  outputs: {{battery: {{name: T, unit: degC}}, radiator: }}
  heaters: {{battery_htr: {{power: link_power}}, other: {{power: 3 W}}, third: }}
"""
KINDS = {
    "callable": "callable: {file: model.py, gradient: jax}",
    "executable": """executable:
    command: [./run.sh, in.txt]
    templates: {in.txt: in.jinja}
    files: [data.txt]
    keep_failed: failed
    interpolate: true""",
    "fmu": "fmu: {file: model.fmu, step: 10 s, drivers: {sun: photo_current}}",
    "umbridge": "umbridge: {url: 'http://localhost:4242', config: {order: 2, names: [a, b]}}",
}


@pytest.fixture
def external(folder):
    """Text of a scenario around each kind of external simulator, whose files are there."""
    (folder / "model.py").write_text("def simulate(inputs, times, start): ...")
    (folder / "run.sh").write_text("exit 1")
    (folder / "run.sh").chmod(0o755)
    (folder / "in.jinja").write_text("{{ inputs.link }}")
    (folder / "data.txt").write_text("1")
    variables = "".join(
        f'<Float64 name="{name}" valueReference="{k}" causality="{kind}"/>'
        for k, (name, kind) in enumerate(
            {
                **dict.fromkeys(("link", "scale", "first", "link_power"), "parameter"),
                **dict.fromkeys(("T", "radiator", "battery_htr", "other", "third"), "output"),
                "sun": "input",
            }.items()
        )
    )
    with zipfile.ZipFile(folder / "model.fmu", "w") as archive:
        description = f"<ModelVariables>{variables}</ModelVariables><CoSimulation/>"
        root = f'<fmiModelDescription fmiVersion="3.0">{description}</fmiModelDescription>'
        archive.writestr("modelDescription.xml", root)

    def text(kind):
        simulator = EXTERNAL.format(kind=KINDS[kind]).replace("scale: 1.5", "scale: 1.5\n    link_power: 2 W")
        head, tail = EXAMPLE.read_text().split("simulator:\n")
        tail = tail[tail.index("parameters:") :]
        observations = """observations:
  battery_temp: {output: battery}
  radiator_temp: {output: radiator}
windows:"""
        parameters = """parameters:
  link: {sets: inputs.link, prior: {lognormal: {median: 0.8 W/K, factor: 2}}}
"""
        windows = tail[tail.index("windows:") + len("windows:") :]
        return f"{head}simulator:\n{simulator}{parameters}{observations}{windows}"

    return text


@pytest.mark.parametrize("kind", KINDS)
def test_external_simulator_loads_as_an_equal_one(folder, external, kind):
    scenario = resolve(folder, external(kind))

    assert resolve(folder, resolved_yaml(scenario), "resolved.yaml") == scenario


@pytest.mark.parametrize("kind", KINDS)
def test_absolute_paths_of_an_external_simulator_hold_in_another_folder(folder, external, kind, tmp_path_factory):
    scenario = resolve(folder, external(kind))

    again = resolve(tmp_path_factory.mktemp("run"), resolved_yaml(scenario, absolute=True))

    files = [path.relative_to(folder) for path in simulator_files(scenario.simulator, scenario.folder)]
    assert simulator_files(again.simulator, again.folder) == [folder / path for path in files]
    assert len(files) == {"callable": 1, "executable": 3, "fmu": 1, "umbridge": 0}[kind]
    assert again.parameters == scenario.parameters
