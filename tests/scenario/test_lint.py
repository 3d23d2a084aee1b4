from pathlib import Path

import pytest

from flightcal.errors import ScenarioError
from flightcal.scenario import lint
from flightcal.scenario.lint import Finding

from .. import small

EXAMPLE = Path(__file__).parent / "example.yaml"


@pytest.fixture
def lint_edited(tmp_path):
    """Findings in the example after (old, new) replacements, without the file's name."""

    def edited(*replacements):
        text = EXAMPLE.read_text()
        for old, new in replacements:
            assert text.count(old) == 1, old
            text = text.replace(old, new)
        path = tmp_path / "scenario.yaml"
        path.write_text(text)
        (tmp_path / "example.csv").write_text("time\n")
        return [str(finding).removeprefix(f"{path}:") for finding in lint(path)]

    return edited


def test_example_has_no_findings():
    assert lint(EXAMPLE) == []


def test_elements_of_another_year_are_a_warning(lint_edited):
    (found,) = lint_edited(("epoch: 2024-03-01", "epoch: 2023-03-01"))
    assert "environment.orbit.epoch: found elements that are 366 days from a window" in found
    assert lint_edited(("epoch: 2024-03-01", "epoch: 2024-02-20")) == []


def test_finding_reads_as_place_location_and_sentence():
    assert str(Finding("a.yaml", 14, "nodes.b", "found x, expected y")) == "a.yaml:14: nodes.b: found x, expected y"
    assert str(Finding("a.yaml", None, "", "cannot be read")) == "a.yaml: cannot be read"


def test_findings_come_by_line_and_each_once(lint_edited):
    found = lint_edited(
        ("{heater: battery_htr}", "{heater: nothing}"),
        ("capacity: 9000 J/K", "capacity: nine"),
        ("unit: mA, kind", "unit: mAmpere, kind"),
    )

    lines = [int(finding.split(":")[0]) for finding in found]
    assert lines == sorted(lines)
    assert len(found) == len(set(found)) == 3


def test_broken_block_causes_no_finding_about_references_to_it(lint_edited):
    """Conductors, heaters, modes, loads, parameters and observations refer to the battery."""
    assert lint_edited(("capacity: 9000 J/K", "capacity: 9000")) == [
        "26: nodes.battery.capacity: found 9000 without a unit, expected a heat capacity such as '9000 J/K'"
    ]


def test_broken_channel_causes_no_finding_about_its_load_and_parameter(lint_edited):
    found = lint_edited(("I_SUN, unit: mA", "I_SUN, unit: mAmpere"))

    assert len(found) == 1
    assert found[0].startswith("15: channels.photo_current.unit: found 'mAmpere'")


def test_broken_conductor_causes_no_finding_about_a_parameter_that_sets_one(lint_edited):
    found = lint_edited(("[battery, radiator], conductance: 0.8 W/K", "[battery, radiator], conductance: 0.8"))

    assert len(found) == 1
    assert found[0].startswith("32: conductors[0].conductance: found 0.8 without a unit")


def test_broken_environment_causes_no_finding_about_faces_and_windows(lint_edited):
    assert lint_edited(("altitude: 693 km", "altitude: 693")) == [
        "18: environment.orbit.altitude: found 693 without a unit, expected a length such as '693 km'"
    ]


def test_observation_with_a_wrong_noise_is_still_told_what_it_names_wrongly(lint_edited):
    found = lint_edited(("{node: radiator, bias: -0.1 K, noise: {half_normal: 0.5 K}}", "{node: radiatr, noise: 3}"))

    assert [finding.split(": ")[1] for finding in found] == [
        "observations.radiator_temp.noise",
        "observations.radiator_temp.node",
    ]


def test_default_filled_in_by_flightcal_cannot_be_written(lint_edited):
    assert lint_edited(("name: example", "folder: here")) == [
        "2: folder: unknown key 'folder', expected name, description, telemetry, environment, simulator, "
        "initial_state, parameters, observations, noise, discrepancy, heat, time_error, windows, calibration",
        "2: missing key 'name'",
    ]
    found = lint_edited(("imaging_power: {", "imaging_power: {unit: W, "))
    assert found == [
        "66: parameters.imaging_power.unit: unknown key 'unit', expected none: the unit follows from the path that the "
        "parameter sets"
    ]


def aligned_to(second, axis="[1, 0, 0]"):
    """+z to nadir, and another axis."""
    return f"{{aligned: {{axis: [0, 0, 1], towards: nadir}}, constrained: {{axis: {axis}, towards: {second}}}}}"


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (("combine: mean", "combine: median"), "found 'median', expected mean, sum or product"),
        (("stale_after: null", "stale_after: 1"), "found 1, expected at least 2"),
        (("on: [1, ON]", "on: true"), "found true, expected a number or text in quotes"),
        (("invalid: [-1,", "invalid: [null,"), "found nothing, expected a number or text in quotes"),
        (("kind: status, on", "kind: status, valid_range: [0, 1], on"), "found a range, expected none for a status"),
        (
            ("column: TT_BAT, unit", "column: TT_BAT, on: [2], unit"),
            "found 'on' for a temperature, expected it for a status",
        ),
        (("column: TT_BAT, unit", "column: TT_BAT, fill: interpolate, unit"), "found 'fill' for a temperature"),
        (("column: TT_BAT, unit", "column: TT_BAT, longest_gap: 1 h, unit"), "found 'longest_gap', expected it for a"),
        (("attitude: nadir", "attitude: [1, 2]"), "found a list of 2, expected an attitude: nadir, sun_pointing"),
        (("attitude: nadir", "attitude: {quaternions: q.csv}"), "found no such file at 'q.csv'"),
        (
            ("attitude: nadir", "attitude: {aligned: {axis: [0, 0, 1], towards: nadir}}"),
            "environment.attitude: missing key 'constrained'",
        ),
        (
            ("attitude: nadir", f"attitude: {aligned_to('sum')}"),
            "constrained.towards: found 'sum', expected",
        ),
        (
            ("attitude: nadir", f"attitude: {aligned_to('nadir')}"),
            "constrained.towards: found 'nadir', expected another direction than 'aligned' has",
        ),
        (
            ("attitude: nadir", f"attitude: {aligned_to('sun', '[0, 0, -2]')}"),
            "constrained.axis: found [0, 0, -2], expected another direction than 'aligned' has",
        ),
        (("altitude: 693 km", "altitude: 1e200 km"), "found '1e200 km', expected at most 1e+09 m"),
        (("file: example.csv", f"file: {'x' * 5000}"), "found no such file at 'xxxx"),
        (("file: example.csv", "file: '.'"), "found a folder at '.', expected a telemetry file"),
        (("step: 30 s", "step: 0 s"), "found '0 s', expected at least 0.01 s"),
        (("payload: {arithmetic: true}", "payload: {}"), "found none of them, expected exactly one of 'capacity'"),
        (("payload: {arithmetic: true}", "payload:"), "found nothing, expected a mapping (key: value)"),
        (
            ("payload: {arithmetic: true}", "payload: {arithmetic: true, initial: 0 degC}"),
            "found 'initial' for an arithmetic",
        ),
        (("shade: {boundary: -20 degC}", "shade: {boundary: -20}"), "found -20 without a unit, expected a temperature"),
        (("[radiator, shade], name", "[structure, shade], name"), "found the boundary nodes 'structure' and 'shade'"),
        (("[radiator, shade], name", "radiator, name"), "found 'radiator', expected the names of two nodes"),
        (("name: gap", "name: a.gap"), "found the name 'a.gap', expected letters"),
        (("normal: all", "normal: al"), "found 'al', expected all; did you mean 'all'?"),
        (("normal: all", "normal: [1, 2]"), "found a list of 2, expected three numbers [x, y, z]"),
        (
            ("body: {node: radiator", "body: {node: shade"),
            "found the boundary node 'shade', expected a node that sunlight",
        ),
        (
            ("body: {node: radiator", "body: {node: payload"),
            "found the arithmetic node 'payload', expected one with the heat capacity of its outer layer",
        ),
        (("power: 22 W", "power: [22 W]"), "found a list of 1, expected a power such as '1 W'"),
        (
            ("imaging: {battery: 6 W, payload: 14 W}", "imaging: {battery: 6 W, payload: 14 W, shade: 1 W}"),
            "dissipation can heat",
        ),
        (
            ("scales: [nodes.battery.capacity,", "scales: [nodes.battery.capacity, nodes.battery.capacity,"),
            "twice, expected",
        ),
        (
            ("{lognormal: {median: 0.8 W/K, factor: 2}}", "{beta: {alpha: 2, beta: 2, upper: 3 W/K}}"),
            "missing key 'lower'",
        ),
        (
            ("{half_normal: 20 W}", "{half_normal: 20 K}"),
            "found '20 K' (a temperature), expected a power such as '1 W'",
        ),
        (
            ("{normal: {mean: 10 degC, standard_deviation: 0.5 degC}}", "{half_normal: 300 K}"),
            "half_normal prior of a temp",
        ),
        (
            ("{half_normal: 0.5 K}", "{normal: {mean: 1 K, standard_deviation: 1 K}}"),
            "found a normal prior with negative",
        ),
        (("radiator_temp: {node: radiator,", "radiator_temp: {node: radiater,"), "did you mean 'radiator'?"),
        (
            ("train: {start: 2024-03-01T01:00:00, orbits: 2}", "train: {start: 2024-03-01T01:00:00, orbits: 0}"),
            "more than 0",
        ),
        (("seed: 1", "seed: -1"), "found -1, expected at least 0"),
        (("chains: 4", "chians: 4"), "unknown key 'chians', expected chains, draws, warmup"),
        (("genetic: {runs: 10}", "genetic: 10"), "found 10, expected a mapping (key: value)"),
    ],
)
def test_single_mistake_gives_one_finding(lint_edited, edit, message):
    found = lint_edited(edit)

    assert len(found) == 1, found
    assert message in found[0]


def test_parameter_may_both_set_and_scale_plain_numbers_only(lint_edited):
    plain = (
        "emissivity: {sets: faces.deep_space.emissivity,",
        "emissivity: {sets: faces.deep_space.emissivity, scales: faces.body.emissivity,",
    )
    in_watt = (
        "imaging_power: {sets: modes.imaging.payload,",
        "imaging_power: {sets: modes.imaging.payload, scales: faces.body.area,",
    )

    assert lint_edited(plain) == []
    assert "found 'scales' beside 'sets' in W" in lint_edited(in_watt)[0]


def test_bias_and_temperature_are_not_set_by_one_parameter(lint_edited):
    found = lint_edited(
        ("sets: observations.radiator_temp.bias", "sets: [observations.radiator_temp.bias, nodes.shade.boundary]")
    )

    assert len(found) == 1
    assert "bias (temperature difference) and nodes.shade.boundary (K), expected paths of one unit" in found[0]


def test_normal_prior_of_a_temperature_is_accepted_though_it_has_no_end(lint_edited):
    prior = "{normal: {mean: 0 degC, standard_deviation: 5 K}}"

    assert (
        lint_edited(("{half_normal: 20 W}", prior), ("sets: modes.imaging.payload", "sets: nodes.shade.boundary")) == []
    )


@pytest.mark.parametrize(("deviation", "accepted"), [("3.9 W", True), ("4.1 W", False)])
def test_a_prior_may_have_no_end_where_it_never_comes_near_what_cannot_be(lint_edited, deviation, accepted):
    prior = f"{{normal: {{mean: 20 W, standard_deviation: {deviation}}}}}"

    power = ("sets: modes.imaging.payload", "sets: heaters.battery_htr.power")
    found = lint_edited(("{half_normal: 20 W}", prior), power)

    assert (found == []) == accepted
    assert accepted or "which goes below 0 within 5 deviations, expected at least 0 W" in found[0]


TLE = """orbit:
    tle:
      - 1 25544U 98067A   24061.50000000  .00016717  00000+0  30000-3 0  9995
      - 2 25544  51.6400 208.9163 0006317  69.9862  25.2906 15.49560000000008
"""
KEPLERIAN = (
    "orbit: {semi_major_axis: 7071 km, eccentricity: 0.001, inclination: 98 deg, raan: 0 deg, "
    "argument_of_perigee: 0 deg, mean_anomaly: 0 deg, epoch: 2024-03-01T00:00:00}\n"
)


@pytest.mark.parametrize(
    ("orbit", "overlapping", "free", "long"),
    [
        (TLE, "04:03", "04:06", "92 min"),
        (KEPLERIAN, "04:15", "04:18", "98 min"),
        (KEPLERIAN + "  period: 90 min\n", "03:57", "04:00", "90 min"),
    ],
    ids=["tle", "keplerian", "period"],
)
def test_window_that_starts_within_two_orbits_of_the_training_window_overlaps_it(
    lint_edited, orbit, overlapping, free, long
):
    circular = "orbit: {altitude: 693 km, inclination: 98.18 deg, ltan: 18:00, epoch: 2024-03-01T00:00:00Z}\n"

    def findings(start):
        return lint_edited((circular, orbit), ("test: {start: 2024-03-01T05:00", f"test: {{start: 2024-03-01T{start}"))

    assert findings(free) == []
    assert len(findings(overlapping)) == 1
    assert "windows.test: found an overlap with 'train'" in findings(overlapping)[0]
    assert findings(overlapping)[0].endswith(f"; an orbit takes {long}")


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ("gain: 0", "gain: found 0, expected more than 0"),
        ("lag: 0 s", "lag: found '0 s', expected more than 0 s"),
        ("lag: 20", "lag: found 20 without a unit, expected a time such as '60 s'"),
        ("time_offset: 2 K", "time_offset: found '2 K' (a temperature), expected a time such as '60 s'"),
    ],
)
def test_errors_of_a_sensor_have_units_and_bounds(lint_edited, written, message):
    found = lint_edited(("{node: radiator, bias: -0.1 K,", f"{{node: radiator, {written},"))
    assert [finding.split(": ", 1)[1] for finding in found] == [f"observations.radiator_temp.{message}"]


def test_a_lag_is_set_only_where_it_is_written(lint_edited):
    edit = ("sets: observations.radiator_temp.bias, prior: {normal: {mean: 0 K, standard_deviation: 0.5 K}}",)
    found = lint_edited((*edit, "sets: observations.radiator_temp.lag, prior: {uniform: [1 s, 60 s]}"))
    assert len(found) == 1
    assert "expected a number that stands in the scenario: write 'lag' in observations.radiator_temp first" in found[0]


def test_a_sensor_does_not_lag_behind_a_massless_node(lint_edited):
    found = lint_edited(("{node: radiator, bias", "{node: payload, lag: 9 s, bias"))
    assert any("found a lag behind the massless node 'payload', expected a node with a capacity" in f for f in found)


def test_a_heaters_status_has_no_sensor(lint_edited):
    found = lint_edited(("{heater: battery_htr}", "{heater: battery_htr, gain: 1.1, lag: 3 s}"))
    assert [finding.split(": ", 1)[1] for finding in found] == [
        f"observations.battery_htr.{key}: found {key!r} for a heater's status, expected none" for key in ("gain", "lag")
    ]


def test_a_face_tracks_the_sun_about_an_axis_unless_the_body_spins_fast(lint_edited):
    def found(normal, attitude="nadir"):
        return lint_edited(("normal: all", f"normal: {normal}"), ("attitude: nadir", f"attitude: {attitude}"))

    spin = "{spin_axis: [0, 0, 1], direction: [1, 0.5, 0]%s}"
    tracking = "{tracks_sun_about: [0, 1, 0]}"
    assert found(tracking) == found(tracking, spin % ", period: 7 min") == []
    (refused,) = found(tracking, spin % "")
    assert "faces.body.normal: found a face that tracks the Sun, expected none: the body spins" in refused
    (axis,) = found("{tracks_sun_about: [0, 0, 0]}")
    assert "normal.tracks_sun_about: found" in axis
    missing, unknown = found("{track_sun: [0, 1, 0]}")
    assert "missing key 'tracks_sun_about'" in missing
    assert "did you mean 'tracks_sun_about'?" in unknown


def test_a_capacity_may_depend_on_temperature(lint_edited):
    battery = "battery: {capacity: 9000 J/K, initial: 12 degC}"

    def found(more, rest="capacity: 9000 J/K"):
        return lint_edited((battery, f"battery: {{{rest}, initial: 12 degC, {more}}}"))

    assert found("capacity_slope: 0.002 1/K, at: 0 degC") == []
    assert "found 'at' without 'capacity_slope', expected both or none" in found("at: 0 degC")[0]
    assert "found 'capacity_slope' without 'capacity'" in found("capacity_slope: 0.002 1/K", "arithmetic: true")[0]
    assert "found 0.002 without a unit" in found("capacity_slope: 0.002")[0]
    (warning,) = found("capacity_slope: 0.01 1/K")
    assert "warning: nodes.battery.capacity_slope: found a slope with which the capacity is below zero" in warning


def test_a_capacitys_slope_is_set_only_where_it_is_written(lint_edited):
    (message,) = lint_edited(("scales: [nodes.battery.capacity,", "scales: [nodes.battery.capacity_slope,"))
    assert "write 'capacity_slope' in nodes.battery first" in message


def test_a_network_in_which_nothing_holds_heat_is_refused(tmp_path):
    written = small.content()
    for node in ("body", "panel"):
        written["simulator"]["nodes"][node] = {"arithmetic": True}
    with pytest.raises(ScenarioError, match="nodes: found no node with a capacity"):
        small.load(tmp_path, written)


def test_a_conductor_that_is_called_the_other_way_round_is_told_how_it_is_called(lint_edited):
    found = lint_edited(
        ("sets: conductors.battery-radiator.conductance", "sets: conductors.radiator-battery.conductance")
    )
    assert any(
        "found 'conductors.radiator-battery.conductance', expected 'conductors.battery-radiator.conductance'" in text
        for text in found
    )
