"""The on-board software, driven by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from flightcal.errors import FlightcalError
from flightcal.operational.onboard import (
    Branch,
    Command,
    HeaterLine,
    OnboardSoftware,
    OnOff,
    PulseWidth,
    TemperatureTransition,
    VotedSensor,
    cycle,
    started,
    vote,
)

PERIOD = 10.0
THREE = VotedSensor(("a", "b", "c"))


def software(law, **changes):
    line = HeaterLine(
        "battery",
        **{
            "branches": {"nominal": Branch({"tank": 20.0})},
            "thermostat" if isinstance(law, OnOff) else "pulse_width": law,
            **changes.pop("line", {}),
        },
    )
    return OnboardSoftware(
        **{
            "period": PERIOD,
            "sensors": {"battery": THREE},
            "heaters": {"heater": line},
            "enabled": {"nominal": ("heater",), "safe": ("heater",), "launch": ()},
            "initial_mode": "nominal",
            **changes,
        }
    )


def alike(value):
    return dict.fromkeys("abc", value)


def drive(configuration, temperatures):
    """Memories after each cycle with all thermistors alike, at the temperatures given."""
    memory, found = started(configuration), []
    for k, temperature in enumerate(temperatures):
        memory = cycle(configuration, memory, k * PERIOD, alike(temperature))
        found.append(memory)
    return found


def on(memories):
    return [memory.lines["heater"].on for memory in memories]


@pytest.mark.parametrize(
    ("readings", "expected"),
    [
        ((280.0, 281.0, 290.0), 281.0),
        ((280.0, 281.0, math.nan), 280.5),
        ((280.0, 500.0, 282.0), 281.0),
        ((280.0, 290.0, math.nan), math.nan),
        ((math.nan, 290.0, 20.0), 290.0),
        ((math.nan, math.nan, math.nan), math.nan),
    ],
)
def test_voting_takes_the_median_and_believes_what_is_left(readings, expected):
    found = vote(THREE, dict(zip("abc", readings, strict=True)))
    assert found == expected or (math.isnan(found) and math.isnan(expected))


def test_a_thermostat_switches_at_its_thresholds_only():
    found = drive(software(OnOff(280.0, 285.0)), [283.0, 279.9, 283.0, 285.0, 285.1, 283.0, 280.0, 279.0])
    assert on(found) == [False, True, True, True, False, False, False, True]


def test_minimum_times_delay_a_switch():
    configuration = software(OnOff(280.0, 285.0, minimum_on=30.0, minimum_off=40.0))
    found = drive(configuration, [279.0, 290.0, 290.0, 290.0, 270.0, 270.0, 270.0, 270.0])
    assert on(found) == [True, True, True, False, False, False, False, True]


def test_a_heater_that_the_mode_does_not_enable_stays_off_and_goes_off():
    configuration = software(OnOff(280.0, 285.0), timeline=(Command(40.0, "nominal"), Command(20.0, "launch")))
    found = drive(configuration, [270.0] * 6)
    assert on(found) == [True, True, False, False, True, True]
    assert [memory.mode for memory in found] == ["nominal"] * 2 + ["launch"] * 2 + ["nominal"] * 2


def test_safe_mode_needs_its_cycles_in_a_row_and_holds():
    transition = TemperatureTransition("safe", "battery", below=270.0, cycles=3)
    configuration = software(OnOff(280.0, 285.0), transitions=(transition,))
    found = drive(configuration, [269.0, 269.0, 271.0, 269.0, 269.0, 269.0, 290.0])
    assert [memory.mode for memory in found] == ["nominal"] * 5 + ["safe"] * 2


def test_pulse_width_is_in_proportion_and_settles_without_an_offset():
    law = PulseWidth(set_point=290.0, gain=0.2, integral_time=math.inf, period=100.0)
    assert on(drive(software(law), [287.0] * 10)) == [True] * 6 + [False] * 4
    # A first-order plant: 10 W hold it 20 K above a sink at 280 K.
    law = replace(law, integral_time=600.0)
    configuration = software(law)
    memory, temperature, history = started(configuration), 280.0, []
    for k in range(2000):
        memory = cycle(configuration, memory, k * PERIOD, alike(temperature))
        power = 10.0 if memory.lines["heater"].on else 0.0
        temperature += PERIOD / 1000.0 * (power - 0.5 * (temperature - 280.0))
        history.append((temperature, power))
    mean, power = np.mean(history[1000:], axis=0)
    # Half the ripple of the pulses; in proportion only, it would be 2.5 K.
    assert mean == pytest.approx(290.0, abs=0.3)
    assert power == pytest.approx(5.0, rel=0.02)


def test_the_integral_does_not_wind_up_while_the_heater_is_always_on():
    law = PulseWidth(set_point=290.0, gain=0.2, integral_time=600.0, period=100.0)
    configuration = software(law)
    memory, temperature, highest = started(configuration), 260.0, 0.0
    for k in range(3000):
        memory = cycle(configuration, memory, k * PERIOD, alike(temperature))
        power = 20.0 if memory.lines["heater"].on else 0.0
        temperature += PERIOD / 1000.0 * (power - 0.5 * (temperature - 260.0))
        highest = max(highest, temperature)
    assert highest < 293.0


def test_a_dead_branch_gives_way_to_the_redundant_one_and_then_the_heater_is_given_up():
    branches = dict.fromkeys(("nominal", "redundant"), Branch({"tank": 20.0}))
    configuration = software(
        OnOff(280.0, 285.0), line={"branches": branches, "failure_time": 50.0, "failure_rise": 0.5}
    )
    found = drive(configuration, [275.0] * 12)
    assert [memory.lines["heater"].branch for memory in found] == [0] * 5 + [1] * 7
    assert on(found) == [True] * 10 + [False] * 2
    warming = drive(configuration, [275.0 + 0.2 * k for k in range(12)])
    assert {memory.lines["heater"].branch for memory in warming} == {0}


@pytest.mark.parametrize(("choice", "expected"), [("off", False), ("on", True), ("hold", True)])
def test_without_a_sensor_the_line_does_what_it_was_told(choice, expected):
    configuration = software(OnOff(280.0, 285.0), line={"without_sensor": choice})
    found = drive(configuration, [270.0, math.nan])
    assert on(found) == [True, expected]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"initial_mode": "cruise"}, "initial mode: found 'cruise'"),
        ({"enabled": {"nominal": ("pump",)}}, "enable table, mode 'nominal': found 'pump'"),
        ({"timeline": (Command(5.0, "cruise"),)}, "timeline at 5.0 s: found 'cruise'"),
        ({"transitions": (TemperatureTransition("safe", "tank", below=1.0),)}, "found 'tank'"),
    ],
)
def test_a_name_that_is_not_there_is_an_error(changes, message):
    with pytest.raises(FlightcalError, match=message):
        software(OnOff(280.0, 285.0), **changes)


def test_pulses_must_fit_the_control_cycle():
    with pytest.raises(FlightcalError, match=r"expected a multiple of the control cycle of 10\.0 s"):
        software(PulseWidth(290.0, 0.1, period=25.0, integral_time=600.0))
