"""The check on the operational simulator: theta reaches the spacecraft, and the reduced model agrees with it."""

from dataclasses import replace

import numpy as np
import pytest

from flightcal.reduction.check import compare, fly_at, spacecraft_at
from flightcal.reduction.file import load_task
from flightcal.reduction.full_order import window_simulator
from flightcal.reduction.schema import FlightWindow
from flightcal.simulator import build_network
from tests.reduction import craft


@pytest.fixture(scope="module")
def task(tmp_path_factory):
    return load_task(craft.write(tmp_path_factory.mktemp("craft")))


THETA = np.array([1.3, 0.3, 0.55, 5600.0, 18.0])


def test_theta_sets_and_scales_the_spacecrafts_numbers(task):
    changed = spacecraft_at(task.mission.spacecraft, task.scenario.parameters, THETA)
    model, written = changed.scenario.network, task.mission.spacecraft.scenario.network
    assert model.faces["window"].absorptivity == 0.3
    assert model.nodes["battery"].capacity == 5600.0
    assert changed.software.heaters["battery"].branches["nominal"].power == {"battery": 18.0}
    blankets = [
        (a.radiative, b.radiative)
        for a, b in zip(model.conductors, written.conductors, strict=True)
        if "insulation" in a.label
    ]
    assert len(blankets) == 24
    assert all(now == pytest.approx(1.3 * before) for now, before in blankets)
    # Everything else is as it was: the network built from it differs in these numbers only.
    before, after = build_network(task.mission.spacecraft.scenario), build_network(changed.scenario)
    assert np.flatnonzero(before.values != after.values).size == 24 + 3


def test_the_full_network_agrees_with_the_flight_but_for_the_control_cycle(tmp_path):
    # A noisy thermistor also switches its heater early, by twice the noise or so.
    quiet = {name: {**item, "noise": "0 K"} for name, item in craft.SPACECRAFT["thermistors"].items()}
    task = load_task(craft.write(tmp_path, spacecraft={"thermistors": quiet}))
    flight = FlightWindow.model_construct(
        start=task.mission.start.astype("datetime64[us]").item(), orbits=1.0, end=None, timeline=None
    )
    scenario = task.with_timeline(flight)
    start, end = task.bounds(flight)
    simulator, times = window_simulator(scenario, start, end, task.period)
    initial = [scenario.network.nodes[simulator.network.nodes[k]].initial for k in simulator.network.diffusive]
    run = simulator.simulate(np.concatenate([THETA, initial]))
    flown = fly_at(task.mission, task.scenario.parameters, THETA, simulator.channels, times, (start, end))
    records = {item["channel"]: item for item in compare([flown], [run], simulator.channels, ("battery duty",))}
    # A heater is switched at the next cycle, up to 10 s late: 18 W on 5600 J/K are 0.03 K by then.
    assert records["structure_1"]["worst"] < 0.02
    assert records["battery_1"]["worst"] < 0.15
    assert abs(records["battery duty"]["mean"]) < 0.01
    other = fly_at(task.mission, task.scenario.parameters, THETA * 1.05, simulator.channels, times, (start, end))
    assert compare([other], [run], simulator.channels, ())[2]["worst"] > 0.1


def test_a_window_before_the_mission_is_refused(task):
    earlier = replace(task.mission, start=task.mission.start + np.timedelta64(1, "D"))
    times = np.array([task.mission.start])
    with pytest.raises(Exception, match="before the mission's start"):
        fly_at(earlier, task.scenario.parameters, THETA, ("battery_1",), times, (times[0], times[0]))


def test_a_flight_is_looked_at_over_the_whole_window_wherever_its_samples_lie(task):
    start = task.mission.start
    span = (start, start + np.timedelta64(2, "h"))
    times = start + np.arange(0, 7200, 600) * np.timedelta64(1, "s")
    whole, late = (
        fly_at(task.mission, task.scenario.parameters, THETA, ("battery_1",), samples, span)
        for samples in (times, times[3:-3])
    )
    # The mission begins with what the spacecraft file writes.
    assert late.start["battery"] == pytest.approx(288.15)
    assert (late.start, late.on) == (whole.start, whole.on)
    np.testing.assert_array_equal(late.duty, whole.duty)
    np.testing.assert_array_equal(late.temperatures, whole.temperatures[3:-3])
