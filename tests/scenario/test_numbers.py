import math
from pathlib import Path

import numpy as np
import pytest

from flightcal.scenario import Channel, load_scenario, numbers_of, settable
from flightcal.scenario.network import Load
from flightcal.scenario.numbers import Settable, load_coefficient

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

    assert numbers["nodes.radiator.capacity"] == Settable("J/K", 4000.0, 0, math.inf, 1e9)
    assert numbers["nodes.shade.boundary"] == Settable("K", pytest.approx(253.15), 0, math.inf, 2000.0)
    assert numbers["conductors.gap.radiative"] == Settable("m^2", 0.02, 0, math.inf, 1e6)
    assert numbers["faces.body.area"] == Settable("m^2", pytest.approx(0.02), 0, math.inf, 1e6)
    assert numbers["faces.body.absorptivity"] == Settable("", 0.3, 0, 1)
    assert numbers["heaters.battery_htr.on_below"] == Settable("K", 283.15, 0, math.inf, 2000.0)
    assert numbers["modes.imaging.payload"] == Settable("W", 14.0, -math.inf, math.inf, 1e6)
    assert numbers["environment.earth_infrared"] == Settable("W/m^2", 237.0, 0, math.inf, 1e4)
    assert numbers["observations.radiator_temp.bias"] == Settable("K", -0.1, -math.inf, math.inf, 2000.0)


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


NUMBERS = numbers_of(
    {"a": 2.0, "b": 3.0, "c": 5.0, "d": 7.0},
    [(("a", "elsewhere"), ()), ((), ("b", "c")), ((), ("c", "a")), (("d",), ())],
)
"""a is set by the first entry and scaled by the third, b scaled by the second, c by both, d set by the fourth."""
THETA = np.array([1.5, 0.5, 4.0, -1.0])


def test_numbers_are_set_and_scaled_by_the_entries_of_theta():
    np.testing.assert_array_equal(NUMBERS.at(THETA), [1.5 * 4.0, 3.0 * 0.5, 5.0 * 0.5 * 4.0, -1.0])


def test_numbers_of_many_thetas_are_those_of_each():
    thetas = np.random.default_rng(1).normal(size=(2, 3, 4))
    found = NUMBERS.at(thetas)
    assert found.shape == (2, 3, 4)
    np.testing.assert_array_equal(found[1, 2], NUMBERS.at(thetas[1, 2]))
    bars = NUMBERS.pull_back(thetas, np.ones((2, 3, 4)))
    np.testing.assert_array_equal(bars[0, 1], NUMBERS.pull_back(thetas[0, 1], np.ones(4)))


def test_pull_back_is_the_transposed_derivative_of_the_numbers():
    bar = np.array([0.3, -2.0, 1.1, 0.7])
    step = 1e-6 * np.eye(4)
    jacobian = (NUMBERS.at(THETA + step) - NUMBERS.at(THETA - step)) / 2e-6
    np.testing.assert_allclose(NUMBERS.pull_back(THETA, bar), jacobian @ bar, rtol=1e-8)


def test_numbers_that_theta_does_not_touch_stay_what_they_are():
    numbers = numbers_of({"a": 2.0, "b": 3.0}, [(("b",), ())])
    np.testing.assert_array_equal(numbers.moved(), [False, True])
    np.testing.assert_array_equal(numbers.at(np.array([4.0])), [2.0, 4.0])
    np.testing.assert_array_equal(numbers_of({"a": 2.0}, []).at(np.zeros(0)), [2.0])
