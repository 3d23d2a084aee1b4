import math

import pytest

from flightcal.scenario.units import Quantity, is_temperature, kind_of, registry, si_unit, to_si, written


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [
        ("0.8 W/K", "W/K", 0.8),
        ("4 kJ/K", "J/K", 4000.0),
        ("200 cm^2", "m^2", 0.02),
        ("0.5 W/degC", "W/K", 0.5),
        ("12 degC", "K", 285.15),
        ("53.6 degF", "K", 285.15),
        ("12degC", "K", 285.15),
        ("-1e-1 W", "W", -0.1),
        ("180 deg", "rad", math.pi),
        ("1.5 hour", "s", 5400.0),
        ("250 mA*mV", "W", 250e-6),
        ("5 %", "", 0.05),
        (0.3, "", 0.3),
    ],
)
def test_written_quantity_becomes_si(text, unit, expected):
    assert to_si(text, unit) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("value", "unit", "message"),
    [
        (9000, "J/K", "found 9000 without a unit, expected a heat capacity such as '9000 J/K'"),
        ("98", "rad", "found '98' without a unit, expected an angle such as '98.2 deg'"),
        ("9000 J", "J/K", "found '9000 J' (an energy), expected a heat capacity such as '1 J/K'"),
        ("3 C", "K", "found '3 C' (an electric charge), expected a temperature such as '20 degC'"),
        (
            "2 delta_degC",
            "K",
            "found '2 delta_degC' (a temperature difference), expected a temperature such as '20 degC'",
        ),
        ("5 deg", "", "found '5 deg' (an angle), expected a plain number"),
        ("1 W/deg", "W", "expected a power such as '1 W'"),
        ("1 W", "W/rad", "found '1 W' (a power), expected a quantity in W/rad"),
        ("10 %", "rad", "found '10 %' (a plain number), expected an angle such as '98.2 deg'"),
        (
            "2 degc",
            "K",
            "found '2 degc', expected a temperature such as '20 degC': unknown unit 'degc'; did you mean 'degC'?",
        ),
        ("1e999 W", "W", "found '1e999 W', expected a finite number"),
        (10**400, "", "expected a finite number"),
        (math.nan, "", "found nan, expected a finite number"),
        (True, "", "found true, expected a plain number"),
        (None, "W", "found nothing, expected a power such as '1 W'"),
        (["1 W"], "W", "found a list of 1, expected a power such as '1 W'"),
    ],
)
def test_what_is_no_such_quantity_is_refused_in_plain_words(value, unit, message):
    with pytest.raises(ValueError, match="found") as error:
        to_si(value, unit)

    assert message in str(error.value)


def test_difference_of_temperatures_has_no_offset():
    assert to_si("2 degC", "K", difference=True) == 2.0
    assert to_si("3.6 degF", "K", difference=True) == pytest.approx(2.0)
    assert to_si("2 delta_degC", "K", difference=True) == 2.0


@pytest.mark.parametrize("text", ["9**9**9**9", "m^9^9^9", "W * 10000", "(m)^(9^9)", "__import__('os')", "W; W"])
def test_unit_that_is_arithmetic_is_not_evaluated(text):
    with pytest.raises(ValueError, match="unknown unit"):
        to_si(f"1 {text}", "W")


@pytest.mark.parametrize(
    ("unit", "si"),
    [
        ("mA", "A"),
        ("mA * mV", "W"),
        ("mV", "V"),
        ("degC", "K"),
        ("deg", "rad"),
        ("percent", ""),
        ("dimensionless", ""),
        ("1", ""),
        ("mW/cm^2", "W/m^2"),
        ("minute", "s"),
    ],
)
def test_driver_unit_has_a_coherent_si_unit(unit, si):
    assert si_unit(unit) == si
    one = registry().Quantity(1.0, unit).to_base_units().magnitude
    assert to_si(f"1 {unit}", si) == pytest.approx(one)


def test_si_unit_of_anything_reads_back_as_itself():
    unit = si_unit("V^2/m")

    assert si_unit(unit) == unit
    assert to_si("3 V^2/m", unit) == pytest.approx(3.0)


def test_only_units_of_absolute_temperature_are_temperatures():
    assert [is_temperature(unit) for unit in ("K", "degC", "degF", "mK")] == [True] * 4
    assert [is_temperature(unit) for unit in ("delta_degC", "C", "deg", "W", "")] == [False] * 5


def test_kind_of_a_unit_is_said_in_words():
    assert [kind_of(unit) for unit in ("deg", "mA", "W/m^2/K", "kg")] == [
        "an angle",
        "an electric current",
        "a quantity in kg / K / s ** 3",
        "a mass",
    ]


@pytest.mark.parametrize("number", [0.1, 253.14999999999998, 1 / 3, 1e-300, -7.0])
@pytest.mark.parametrize("unit", ["K", "W/m^2", "rad", ""])
def test_written_number_reads_back_as_the_same_float(number, unit):
    assert to_si(written(number, unit), unit) == number


def test_quantity_keeps_its_bounds():
    area = Quantity("m^2", above=0)
    share = Quantity("", at_least=0, at_most=1)

    assert (area.lower, area.upper, share.lower, share.upper) == (0, math.inf, 0, 1)
    with pytest.raises(ValueError, match=r"found '0 m\^2', expected more than 0 m\^2"):
        area.read("0 m^2")
    with pytest.raises(ValueError, match=r"found -0\.1, expected at least 0"):
        share.read(-0.1)
    with pytest.raises(ValueError, match=r"found 1\.1, expected at most 1"):
        share.read(1.1)
