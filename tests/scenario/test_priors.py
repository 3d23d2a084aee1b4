import math

import pytest
from pydantic import ValidationError

from flightcal.scenario import Beta, HalfNormal, HalfStudentT, LogNormal, Normal, TruncatedNormal, Uniform
from flightcal.scenario.priors import read_prior, support, written_prior
from flightcal.scenario.wording import problems_of

PRIORS = [
    Uniform(lower=-1.5, upper=0.1),
    Normal(mean=285.15, standard_deviation=1 / 3),
    TruncatedNormal(mean=1.0, standard_deviation=0.2, lower=0.5, upper=2.0),
    LogNormal(median=0.8, factor=2.0),
    HalfNormal(scale=2.0),
    HalfStudentT(scale=2.0, degrees_of_freedom=3.0),
    Beta(alpha=2.0, beta=5.0, lower=0.1, upper=0.9),
]


@pytest.mark.parametrize(
    ("written", "unit", "prior"),
    [
        ({"uniform": [0.05, 0.45]}, "", Uniform(lower=0.05, upper=0.45)),
        ({"uniform": ["500 mW/K", "2 W/K"]}, "W/K", Uniform(lower=0.5, upper=2.0)),
        ({"lognormal": {"median": "0.8 W/K", "factor": 2}}, "W/K", LogNormal(median=0.8, factor=2.0)),
        ({"half_normal": "2 W"}, "W", HalfNormal(scale=2.0)),
        (
            {"half_student_t": {"scale": "2 W", "degrees_of_freedom": 3}},
            "W",
            HalfStudentT(scale=2.0, degrees_of_freedom=3.0),
        ),
        ({"beta": {"alpha": 2, "beta": 5}}, "", Beta(alpha=2.0, beta=5.0, lower=0.0, upper=1.0)),
        (
            {"beta": {"alpha": 2, "beta": 5, "lower": "0 W", "upper": "4 W"}},
            "W",
            Beta(alpha=2.0, beta=5.0, lower=0.0, upper=4.0),
        ),
        (
            {
                "truncated_normal": {
                    "mean": "10 degC",
                    "standard_deviation": "2 degC",
                    "lower": "0 degC",
                    "upper": "300 K",
                }
            },
            "K",
            TruncatedNormal(mean=283.15, standard_deviation=2.0, lower=273.15, upper=300.0),
        ),
    ],
)
def test_written_prior_is_read_in_si(written, unit, prior):
    assert read_prior(written, unit) == prior


def test_mean_temperature_has_an_offset_and_its_standard_deviation_none():
    for deviation in ("2 K", "2 degC", "2 delta_degC"):
        prior = read_prior({"normal": {"mean": "12 degC", "standard_deviation": deviation}}, "K")
        assert prior == Normal(mean=285.15, standard_deviation=2.0)


def test_mean_of_a_temperature_difference_has_no_offset():
    prior = read_prior({"normal": {"mean": "1 degC", "standard_deviation": "2 K"}}, "K", difference=True)

    assert prior == Normal(mean=1.0, standard_deviation=2.0)


@pytest.mark.parametrize("prior", PRIORS, ids=lambda prior: prior.kind)
@pytest.mark.parametrize("unit", ["", "K", "W/K"])
def test_prior_reads_back_as_it_is_written(prior, unit):
    assert read_prior(written_prior(prior, unit), unit) == prior


@pytest.mark.parametrize(
    ("written", "unit", "location", "message"),
    [
        (5, "", (), "found 5, expected one distribution"),
        ({}, "", (), "found none, expected one distribution"),
        ({"uniform": [0, 1], "beta": {}}, "", (), "found 'uniform' and 'beta', expected one distribution"),
        ({"gaussian": 1}, "", ("gaussian",), "unknown distribution 'gaussian', expected one of uniform, normal"),
        ({"uniform": [0, 1, 2]}, "", ("uniform",), "found a list of 3, expected two bounds [lower, upper]"),
        ({"uniform": {"lower": 0}}, "", ("uniform",), "found a mapping, expected two bounds [lower, upper]"),
        ({"uniform": ["2 W", "1 W"]}, "W", ("uniform", 1), "expected a lower bound below the upper one"),
        ({"uniform": [1, 2]}, "W", ("uniform", 0), "found 1 without a unit, expected a power such as '1 W'"),
        ({"uniform": ["1 W", 2]}, "", ("uniform", 0), "found '1 W' (a power), expected a plain number"),
        ({"normal": 3}, "", ("normal",), "found 3, expected a mapping with mean, standard_deviation"),
        ({"normal": {"mean": 1}}, "", ("normal",), "missing key 'standard_deviation'"),
        (
            {"normal": {"mean": 1, "standard_deviation": 0}},
            "",
            ("normal", "standard_deviation"),
            "expected more than 0",
        ),
        ({"normal": {"mean": 1, "sd": 1, "standard_deviation": 1}}, "", ("normal", "sd"), "unknown key 'sd'"),
        ({"lognormal": {"median": 1, "factor": "2 W"}}, "", ("lognormal", "factor"), "expected a plain number"),
        ({"lognormal": {"median": -1, "factor": 2}}, "", ("lognormal", "median"), "found -1, expected more than 0"),
        ({"half_normal": [1]}, "", ("half_normal",), "found a list of 1, expected a plain number"),
        ({"beta": {"alpha": 1, "beta": 1}}, "W", ("beta",), "missing key 'lower'"),
    ],
)
def test_what_is_no_prior_is_refused_in_its_place(written, unit, location, message):
    with pytest.raises(ValidationError) as refused:
        read_prior(written, unit)

    problems = problems_of(refused.value, location=("prior",))
    assert problems[0].location == ("prior", *location)
    assert message in problems[0].message


def test_support_is_where_the_prior_has_probability():
    assert [support(prior) for prior in PRIORS] == [
        (-1.5, 0.1),
        (-math.inf, math.inf),
        (0.5, 2.0),
        *3 * [(0.0, math.inf)],
        (0.1, 0.9),
    ]
