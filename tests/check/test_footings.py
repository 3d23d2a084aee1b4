"""Values that are as good as a fixed number, on the small satellite."""

import numpy as np
import pytest

from flightcal.check.evidence import climbed
from flightcal.check.footings import footings
from flightcal.check.prepared import prepared
from flightcal.check.wrongs import multiplied
from tests import small


def uncertain(target, median):
    return {"sets": target, "prior": {"lognormal": {"median": median, "factor": 2.0}}}


def loose():
    """The small satellite, of which all is uncertain but the heater's power and what sunlight brings."""
    written = small.content()
    written["parameters"] = {
        "link": uncertain("conductors.body-panel.conductance", "0.6 W/K"),
        "panel": uncertain("nodes.panel.capacity", "800 J/K"),
        "body": uncertain("nodes.body.capacity", "3000 J/K"),
        "size": uncertain("conductors.panel-space.radiative", "0.05 m^2"),
    }
    return written


@pytest.fixture(scope="module")
def looked(tmp_path_factory):
    """A view, a point and the best fit of it."""
    view = prepared(*small.closed_loop(tmp_path_factory.mktemp("loose"), loose()))
    base = view.point(view.window, view.middle)
    return view, base, climbed(view, view.window, view.observed, base)


def test_a_capacity_is_as_good_as_the_power_that_heats_it(looked):
    found = {(own.parameter, own.number): own.share for own in footings(*looked)}
    assert found["body", "heaters.heater.power"] == pytest.approx(1.0, abs=0.05)
    assert ("body", "loads.sun.coefficient") not in found
    assert found["panel", "loads.sun.coefficient"] > 0.5


def test_a_value_follows_an_error_of_the_number_as_is_said_and_no_fit_shows_it(looked):
    view, base, fit = looked
    for own in footings(view, base, fit):
        window = multiplied(view, [view.network.network.paths.index(own.number)], 1.1)
        other = climbed(view, window, view.observed, base)
        k = view.problem.names.index(own.parameter)
        moved = np.log(view.problem.to_theta(other.z)[k] / view.problem.to_theta(fit.z)[k]) / np.log(1.1)
        assert own.share == pytest.approx(moved, abs=0.05)
        assert abs(other.evidence - fit.evidence) < 2.0


def test_a_number_whose_error_the_telemetry_shows_is_no_footing(tmp_path):
    written = loose()
    del written["parameters"]["body"], written["parameters"]["panel"]
    view = prepared(*small.closed_loop(tmp_path, written))
    base = view.point(view.window, view.middle)
    fit = climbed(view, view.window, view.observed, base)
    window = multiplied(view, [view.network.network.paths.index("heaters.heater.power")], 1.1)
    assert climbed(view, window, view.observed, base).evidence < fit.evidence - 2.0
    assert "heaters.heater.power" not in [own.number for own in footings(view, base, fit)]


def test_a_number_that_a_parameter_scales_is_not_fixed(tmp_path):
    written = loose()
    del written["parameters"]["body"]
    written["parameters"]["share"] = {
        "scales": "nodes.body.capacity", "prior": {"lognormal": {"median": 1, "factor": 2.0}}
    }  # fmt: skip
    view = prepared(*small.closed_loop(tmp_path, written))
    base = view.point(view.window, view.middle)
    found = footings(view, base, climbed(view, view.window, view.observed, base))
    assert [own.number for own in found if own.parameter == "share"] == ["heaters.heater.power"]
