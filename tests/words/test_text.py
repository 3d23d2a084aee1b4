"""Numbers and units as shown."""

import math

import pytest

from flightcal.words import (
    count,
    duration,
    interval,
    labelled,
    listed,
    number,
    percent,
    signed_percent,
    unit,
    without_paths,
)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.75334, "0.7533"),
        (1234.56, "1235"),
        (-0.0211, "−0.02110"),
        (0.0, "0"),
        (1.5e-7, "1.500·10⁻⁷"),
        (-2.5e9, "−2.500·10⁹"),
        (None, "–"),
        (math.nan, "–"),
    ],
)
def test_numbers_have_four_significant_digits(value, text):
    assert number(value) == text


def test_rounding_up_to_the_next_power_of_ten_keeps_the_number_of_digits():
    assert number(9.9999) == "10.00"
    assert number(-1e-9, 2) == "−1.0·10⁻⁹"


def test_counts_are_grouped_by_three():
    assert count(31_250) == "31\u202f250"
    assert count(math.nan) == "–"


def test_shares_are_percent():
    assert percent(0.9324) == "93.2%"
    assert signed_percent(0.02) == "+2.0%"
    assert signed_percent(-0.02) == "−2.0%"
    assert percent(None) == "–"


@pytest.mark.parametrize(
    ("given", "shown"),
    [("W/m^2", "W/m²"), ("W/m^2/K^4", "W/m²/K⁴"), ("degC", "°C"), ("", ""), ("1", ""), ("A*V", "A·V")],
)
def test_units_are_set_as_in_print(given, shown):
    assert unit(given) == shown


def test_an_axis_without_a_unit_says_so():
    assert labelled("absorptivity", "") == "absorptivity, –"
    assert labelled("link", "W/K") == "link, W/K"


def test_durations_and_lists_read_as_words():
    assert [duration(s) for s in (42.5, 200, 7500)] == ["42.5 s", "3 min 20 s", "2 h 5 min"]
    assert [listed(["a", "b", "c"][:n]) for n in range(4)] == ["", "a", "a and b", "a, b and c"]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("file: [/home/ana/sat/telemetry.csv]", "file: [telemetry.csv]"),
        ("SHA-256 of /home/ana lee/sat 1/telemetry.csv", "SHA-256 of telemetry.csv"),
        (r"C:\Users\ana\telemetry.csv, twice", "telemetry.csv, twice"),
        ("~/sat/run/ is a folder", " is a folder"),
        ("W/m^2/K and 0.1/0.2/0.3, GA mean / best", "W/m^2/K and 0.1/0.2/0.3, GA mean / best"),
        ("flightcal check own.yaml --out runs/first", "flightcal check own.yaml --out runs/first"),
        ("https://example.org/a/b", "https://example.org/a/b"),
        ("/home/john/secret-sat/tm/x.csv and /home/john", "x.csv and john"),
        ("/home/johnny/tm/x.csv", "x.csv"),
    ],
)
def test_a_path_is_told_by_its_last_step(text, told):
    assert without_paths(text, ["/home/ana lee/sat 1/telemetry.csv", "telemetry.csv", "/home/john", "/"]) == told


def test_intervals_have_as_many_decimals_as_their_width_asks_for():
    assert interval(0.42013, 0.41252, 0.42761) == "0.4201 [0.4125, 0.4276]"
    assert interval(293.1234, 293.1231, 293.1239) == "293.12340 [293.12310, 293.12390]"
    assert interval(math.nan, math.nan, math.nan) == "–"
