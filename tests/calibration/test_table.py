"""Quantities before and after a calibration."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from flightcal.calibration import Calibrated, Posterior, html_table
from flightcal.calibration.table import calibrated, correlation
from flightcal.problem import Entry
from flightcal.scenario import LogNormal, Normal, Uniform, written_unit


class Theta:
    """Of a problem, what the table needs."""

    def __init__(self, *entries):
        from flightcal.probability import Priors

        self.entries = entries
        self.priors = Priors(tuple(e.name for e in entries), tuple(e.prior for e in entries))


LINK = Entry("link", "W/K", Normal(mean=0.6, standard_deviation=0.2), "parameter", sets=("conductors.a-b.conductance",))
START = Entry("initial.body", "K", Normal(mean=285.0, standard_deviation=2.0), "initial")
SCALE = Entry("scale", "", Uniform(lower=0.5, upper=1.5), "parameter", scales=("nodes.body.capacity",))
BIAS = Entry("bias", "K", Normal(mean=0.0, standard_deviation=1.0), "parameter", sets=("observations.body_temp.bias",))


def draws(*columns):
    return np.stack(columns, axis=1)


@pytest.fixture
def rows():
    rng = np.random.default_rng(0)
    given = draws(
        0.65 + 0.1 * rng.standard_normal(20_000),
        284.15 + 0.1 * rng.standard_normal(20_000),
        rng.uniform(0.5, 1.5, 20_000),
        0.3 + 0.5 * rng.standard_normal(20_000),
    )
    units = {"link": written_unit("mW/K", "W/K")}
    return {row.name: row for row in calibrated(Theta(LINK, START, SCALE, BIAS), given, units)}


def test_numbers_are_in_the_units_of_the_scenario_and_temperatures_in_degrees_celsius(rows):
    link, start = rows["link"], rows["initial.body"]
    assert (link.unit, start.unit, rows["scale"].unit, rows["bias"].unit) == ("mW/K", "degC", "", "K")
    assert (link.before, link.mean, link.deviation) == pytest.approx((600.0, 650.0, 100.0), rel=0.02)
    assert (link.lower, link.upper) == pytest.approx((454.0, 846.0), rel=0.02)
    assert (link.before_lower, link.before_upper) == pytest.approx((208.0, 992.0), rel=0.01)
    assert (start.before, start.mean, start.deviation) == pytest.approx((11.85, 11.0, 0.1), abs=0.01)
    assert rows["bias"].mean == pytest.approx(0.3, abs=0.02)


def test_the_data_s_share_is_what_they_take_from_the_prior_s_variance(rows):
    assert rows["link"].from_data == pytest.approx(0.75, abs=0.01)
    assert rows["scale"].from_data == pytest.approx(0.0, abs=0.02)
    assert rows["initial.body"].from_data > 0.99


def test_a_posterior_wider_than_its_prior_has_nothing_from_the_data():
    given = draws(np.random.default_rng(1).normal(0.6, 0.4, 2000))
    assert calibrated(Theta(LINK), given)[0].from_data == 0.0


def test_a_posterior_far_out_in_a_wide_prior_has_much_from_the_data_however_wide_it_is_in_its_unit():
    capacity = Entry("capacity", "J/K", LogNormal(median=350.0, factor=1.5), "parameter", sets=("nodes.a.capacity",))
    given = draws(1840.0 * np.exp(0.15 * np.random.default_rng(1).standard_normal(4000)))
    row = calibrated(Theta(capacity), given)[0]
    assert row.deviation > (row.before_upper - row.before_lower) / 4
    assert row.from_data == pytest.approx(1.0 - (0.15 / np.log(1.5)) ** 2, abs=0.02)


def test_an_interval_if_fixed_numbers_are_off_is_in_the_same_unit_and_never_narrower():
    given = draws(284.15 + 0.1 * np.random.default_rng(3).standard_normal(4000))
    wider = 284.15 + 3.0 * (given - 284.15)
    widened, same = (
        calibrated(Theta(START), given, None, moved)[0] for moved in (wider, 284.15 + 0.5 * (given - 284.15))
    )
    assert widened.considered == pytest.approx((11.0 - 0.59, 11.0 + 0.59), abs=0.03)
    assert widened.times_as_wide == pytest.approx(3.0, rel=0.01)
    assert (same.considered, same.times_as_wide) == ((same.lower, same.upper), 1.0)
    cooler = widened.rescaled(lambda value: value - 11.0, 1.0, "K")
    assert cooler.considered == pytest.approx((-0.59, 0.59), abs=0.03)
    assert calibrated(Theta(START), given)[0].considered is None


def test_correlations_are_those_of_the_draws():
    given = np.random.default_rng(2).multivariate_normal([0, 0], [[1, -0.8], [-0.8, 1]], 20_000)
    found = correlation(np.column_stack([given, np.ones(len(given))]))
    assert found[0, 1] == pytest.approx(-0.8, abs=0.01)
    assert np.isnan(found[0, 2])


def test_a_row_is_short_and_its_html_escapes_names(rows):
    assert repr(rows["link"]).startswith("<link: 65")
    assert repr(rows["link"]).endswith("mW/K>")
    row = Calibrated("a<b", "parameter", "W", *([1.0] * 9))
    assert "<td>a&lt;b</td><td>W</td><td>1 [1, 1]</td><td>1 [1, 1]</td><td>100.0%</td>" in html_table([row])
    wider = dataclasses.replace(row, considered_lower=0.5, considered_upper=1.5)
    assert "<td>1 [1, 1]</td><td>[0.5, 1.5]</td><td>100.0%</td>" in html_table([wider, row])


def test_a_posterior_is_a_line_and_in_notebooks_a_table():
    problem = Theta(LINK)
    problem.scenario = SimpleNamespace(name="small")
    theta = np.random.default_rng(3).normal(0.65, 0.1, (2, 500, 1))
    posterior = Posterior(("link",), theta, None, (), SimpleNamespace(passed=True), problem)
    assert repr(posterior) == "<Posterior of 'small': 2 x 500 draws of 1; all gates passed>"
    assert posterior.table[0].mean == pytest.approx(theta.mean())
    assert "<td>link</td><td>W/K</td>" in posterior._repr_html_()


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        (LINK, "sets conductors.a-b.conductance"),
        (SCALE, "scales nodes.body.capacity"),
        (START, "initial temperature of body"),
        (Entry("noise.tank", "K", LINK.prior, "noise"), "noise of tank: standard deviation"),
        (Entry("noise.tank.correlation_time", "s", LINK.prior, "noise"), "noise of tank: correlation time"),
        (Entry("heat.tank.pattern", "W", LINK.prior, "heat"), "unmodelled heat: tank.pattern"),
        (Entry("drift.link", "", LINK.prior, "drift"), "deviation of link between windows"),
        (Entry("timing.tank_status", "s", LINK.prior, "timing"), "error of timing: tank_status"),
    ],
)
def test_quantities_have_long_names(entry, words):
    assert entry.long_name == words
