import math
from pathlib import Path

import pytest

from flightcal.scenario import Channel, Load, Settable, load_scenario, settable
from flightcal.scenario.numbers import load_coefficient

EXAMPLE = Path(__file__).parent / "example.yaml"
BROKEN = Path(__file__).parents[1] / "broken"


def test_paths_come_in_the_documented_order():
    assert list(settable(load_scenario(EXAMPLE))) == [
        "nodes.battery.capacity",
        "nodes.radiator.capacity",
        "nodes.shade.boundary",
        "conductors.battery-radiator.conductance",
        "conductors.battery-structure.conductance",
        "conductors.payload-battery.conductance",
        "conductors.gap.radiative",
        "faces.deep_space.area",
        "faces.deep_space.absorptivity",
        "faces.deep_space.emissivity",
        "faces.body.area",
        "faces.body.absorptivity",
        "faces.body.emissivity",
        "heaters.battery_htr.power",
        "heaters.battery_htr.on_below",
        "heaters.battery_htr.off_above",
        "modes.nominal.battery",
        "modes.imaging.battery",
        "modes.imaging.payload",
        "loads.bus.coefficient",
        "loads.sun.coefficient",
        "environment.albedo",
        "environment.earth_infrared",
        "environment.solar_constant",
        "observations.battery_temp.bias",
        "observations.battery_temp.gain",
        "observations.battery_temp.time_offset",
        "observations.radiator_temp.bias",
        "observations.radiator_temp.gain",
        "observations.radiator_temp.time_offset",
    ]


def test_numbers_are_in_si_with_their_physical_bounds():
    numbers = settable(load_scenario(EXAMPLE))

    assert numbers["nodes.radiator.capacity"] == Settable("J/K", 4000.0, 0, math.inf)
    assert numbers["nodes.shade.boundary"] == Settable("K", pytest.approx(253.15), 0, math.inf)
    assert numbers["conductors.gap.radiative"] == Settable("m^2", 0.02, 0, math.inf)
    assert numbers["faces.body.area"] == Settable("m^2", pytest.approx(0.02), 0, math.inf)
    assert numbers["faces.body.absorptivity"] == Settable("", 0.3, 0, 1)
    assert numbers["heaters.battery_htr.on_below"] == Settable("K", 283.15, 0, math.inf)
    assert numbers["modes.imaging.payload"] == Settable("W", 14.0, -math.inf, math.inf)
    assert numbers["environment.earth_infrared"] == Settable("W/m^2", 237.0, 0, math.inf)
    assert numbers["observations.radiator_temp.bias"] == Settable("K", -0.1, -math.inf, math.inf)


@pytest.mark.parametrize(
    ("driver_unit", "coefficient", "unit", "value"),
    [
        ("mA", "12 W/A", "W/A", 12.0),
        ("mA", "0.012 W/mA", "W/A", 12.0),
        ("A", "12 V", "W/A", 12.0),
        ("mA * mV", 0.1, "", 0.1),
        ("mW", "50 %", "", 0.5),
        ("dimensionless", 3, "W", 3.0),
        ("dimensionless", "3 kW", "W", 3000.0),
        ("W/m^2", "200 cm^2", "m^2", 0.02),
        ("degC", "2 W/K", "W/K", 2.0),
        ("m/s", "2 N", "N", 2.0),
    ],
)
def test_coefficient_is_in_watt_per_si_unit_of_the_driver(driver_unit, coefficient, unit, value):
    load = Load(node="n", driver="d", coefficient=coefficient)
    driver = Channel(column="d", kind="driver", unit=driver_unit)

    assert load_coefficient(load, driver) == (unit, pytest.approx(value))


def test_plain_coefficient_is_refused_for_a_driver_that_is_no_power():
    load = Load(node="n", driver="d", coefficient=12)
    driver = Channel(column="d", kind="driver", unit="mA")

    with pytest.raises(ValueError, match="found 12 without a unit, expected heat per unit of the driver: '12 W/A'"):
        load_coefficient(load, driver)


def test_inputs_of_an_external_simulator_and_biases_are_settable():
    scenario = load_scenario(BROKEN / "valid_external.yaml", telemetry=BROKEN / "scenarios")

    found = settable(scenario)

    assert {path: (number.unit, number.value) for path, number in found.items()} == {
        "inputs.link": ("W/K", 0.8),
        "inputs.heating": ("W", 22.0),
        "observations.battery_temp.bias": ("K", 0.0),
        "observations.radiator_temp.bias": ("K", 0.0),
    }
    assert scenario.parameters["link"].unit == "W/K"
