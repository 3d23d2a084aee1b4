import shutil
from pathlib import Path

import pytest

from flightcal.errors import ScenarioError
from flightcal.scenario import (
    Discrepancy,
    Environment,
    HalfNormal,
    Heat,
    HeatPattern,
    HeatSlow,
    LogNormal,
    PhaseDiscrepancy,
    SimulatorError,
    discrepancy_of,
    heat_of,
    load_scenario,
    noise_of,
    resolved_yaml,
)
from flightcal.scenario.heat import HeatGains

from .. import small

EXTERNAL = Path(__file__).parents[1] / "broken" / "valid_external.yaml"


def omitted():
    """A scenario whose block `heat` is left out, and that can have heat."""
    written = small.content()
    written.pop("heat", None)
    return written


def written_with(path, value):
    written = omitted()
    *parents, last = path.split(".")
    block = written
    for key in parents:
        block = block[key]
    block[last] = value
    return written


def load(folder, written):
    return small.load(folder, written)[0]


def test_a_block_has_the_defaults_of_what_it_does_not_write(tmp_path):
    heat = load(tmp_path, omitted() | {"heat": {"nodes": ["body"], "slow": {"time": "2 h"}, "gains": None}}).heat

    assert heat.slow.time == 7200.0
    assert heat == Heat(nodes=("body",), pattern=HeatPattern(), gains=None, slow=HeatSlow(time="2 h"))
    assert Heat() == Heat(
        nodes=(),
        pattern=HeatPattern(harmonics=6, scale=0.05),
        gains=HeatGains(scale=0.05),
        slow=HeatSlow(time=None, scale=0.005, of_pattern=0.1),
    )


def test_heat_stands_beside_no_discrepancy(tmp_path):
    assert heat_of(load(tmp_path, omitted() | {"discrepancy": "none"})) == Heat()


def test_what_is_written_is_the_heat(tmp_path):
    block = {"nodes": ["panel"], "pattern": {"harmonics": 3}}

    assert heat_of(load(tmp_path, omitted() | {"heat": block})) == Heat(
        nodes=("panel",), pattern=HeatPattern(harmonics=3)
    )
    assert heat_of(load(tmp_path, omitted() | {"heat": "none"})) is None


def test_a_block_that_is_left_out_is_heat_with_its_defaults(tmp_path):
    assert heat_of(load(tmp_path, omitted())) == Heat()


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("discrepancy", {"phase": {}}),
        ("noise", {"distribution": "student_t"}),
        ("observations.panel_temp.noise", {"quantisation": "0.1 K"}),
        ("simulator.errors", {"body_temp": {"offset": "0.1 K", "deviation": "0.1 K", "correlation_time": "9 min"}}),
    ],
)
def test_a_scenario_with_what_heat_cannot_stand_beside_has_none(tmp_path, path, value):
    written = written_with(path, value)

    assert heat_of(load(tmp_path, written)) is None
    with pytest.raises(ScenarioError, match="heat: found heat beside"):
        load(tmp_path, written | {"heat": {}})
    assert heat_of(load(tmp_path, written | {"heat": "none"})) is None


def test_an_external_simulator_has_no_heat():
    assert heat_of(load_scenario(EXTERNAL, telemetry=EXTERNAL.parent / "scenarios")) is None


EVERY = Discrepancy(phase=PhaseDiscrepancy())


@pytest.mark.parametrize(
    ("written", "discrepancy", "noise"),
    [
        ("", EVERY, "ar1"),
        ("heat: none", None, "iid"),
        ("discrepancy: none", None, "ar1"),
        ("noise: {standard_deviation: 0.2 K}", EVERY, "iid"),
        ("heat: none\ndiscrepancy: {phase: {}}", EVERY, "iid"),
    ],
)
def test_beside_an_external_simulator_a_discrepancy_stands_for_heat(tmp_path, written, discrepancy, noise):
    """Which says the same where it is read again with all defaults written out."""
    shutil.copytree(EXTERNAL.parent / "scenarios", tmp_path / "scenarios")
    telemetry, file = tmp_path / "scenarios", tmp_path / "scenario.yaml"
    file.write_text(f"{EXTERNAL.read_text(encoding='utf-8')}{written}\n", encoding="utf-8")
    scenario = load_scenario(file, telemetry=telemetry)
    file.write_text(resolved_yaml(scenario), encoding="utf-8")
    for version in (scenario, load_scenario(file)):
        assert discrepancy_of(version) == discrepancy
        assert noise_of(version, "battery_temp").model == noise


def test_where_the_length_of_an_orbit_is_not_known_no_discrepancy_comes_again_in_it():
    scenario = load_scenario(EXTERNAL, telemetry=EXTERNAL.parent / "scenarios")

    assert discrepancy_of(scenario.model_copy(update={"environment": Environment()})) is None


def test_a_reduced_order_model_has_heat_beside_its_error(tmp_path):
    scenario = load(tmp_path, omitted())
    error = SimulatorError(offset="0.1 K", deviation="0.1 K", correlation_time="9 min")
    network = scenario.network.model_copy(update={"reduced_model": "rom.nc", "errors": {"body_temp": error}})

    assert heat_of(scenario.model_copy(update={"simulator": network})) == Heat()


def test_noise_that_is_left_out_is_correlated_beside_heat_alone(tmp_path):
    without = load(tmp_path, omitted() | {"heat": "none"})
    assert noise_of(without, "body_temp") is without.noise

    scenario = load(tmp_path, omitted())
    body, panel = (noise_of(scenario, channel) for channel in ("body_temp", "panel_temp"))
    assert (body.model, body.white, body.standard_deviation) == ("ar1", HalfNormal(scale=0.5), HalfNormal(scale=1.0))
    assert body.correlation_time == LogNormal(median=300.0, factor=2.0)
    assert (panel.model, panel.white, panel.standard_deviation) == ("iid", None, 0.1)


def test_noise_that_is_written_stays_beside_heat(tmp_path):
    scenario = load(tmp_path, omitted() | {"noise": {}})

    assert heat_of(scenario) == Heat()
    assert noise_of(scenario, "body_temp") is scenario.noise


@pytest.mark.parametrize(
    ("over", "message"),
    [
        ({"over": "nowhere"}, "nowhere"),
        ({"over": "body_temp"}, "driver"),
        ({"over": "sun", "harmonics": 3}, "found 'harmonics' beside 'over', expected one of them"),
    ],
)
def test_a_pattern_over_what_is_no_driver_is_refused(tmp_path, over, message):
    with pytest.raises(ScenarioError, match=message):
        load(tmp_path, omitted() | {"heat": {"pattern": over}})


def without_an_orbit(folder, *angles, followed=(), **heat):
    written = omitted() | ({"heat": heat} if heat else {})
    del written["environment"]
    for name in angles:
        written["telemetry"]["channels"][name] = {"column": "sun", "unit": "deg", "kind": "driver"}
    for name in followed:
        heat_load = {"node": "panel", "driver": name, "table": [[0, 0], [90, 1]], "coefficient": "1 W"}
        written["simulator"]["loads"][name] = heat_load
    return heat_of(load(folder, written))


def test_without_an_orbit_heat_comes_again_at_an_angle_and_drifts_by_more(tmp_path):
    heat = without_an_orbit(tmp_path, "pitch")
    assert heat == Heat(pattern=HeatPattern(over="pitch"), slow=HeatSlow(time="1 day", scale=0.02))
    assert without_an_orbit(tmp_path, "pitch", "roll").pattern == HeatPattern(harmonics=0)
    assert without_an_orbit(tmp_path, "pitch", "roll", followed=["roll"]).pattern.over == "roll"


def test_without_an_orbit_what_is_written_of_heat_stays(tmp_path):
    heat = without_an_orbit(tmp_path, "pitch", pattern={"scale": 0.3}, slow={"time": "2 h"}, gains=None)
    assert heat == Heat(pattern=HeatPattern(over="pitch", scale=0.3), gains=None, slow=HeatSlow(time="2 h", scale=0.02))
    scales = without_an_orbit(tmp_path, "pitch", pattern=None, slow={"scale": 0.01})
    assert scales == Heat(pattern=None, slow=HeatSlow(time="1 day", scale=0.01))
