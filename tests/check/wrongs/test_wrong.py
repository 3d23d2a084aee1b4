"""What wrongs of all kinds have in common."""

import numpy as np

from flightcal.check import wrongs
from flightcal.check.prepared import prepared
from flightcal.check.wrongs.channels import swaps
from flightcal.simulator import SimulationFailure


def test_the_effect_of_heat_is_in_proportion_to_it(flown):
    view = prepared(*flown)
    steps = np.ones((1, 2 * (len(view.network.drive.times) - 1)))
    little = view.response(view.window, view.middle, "panel", steps)
    much = view.response(view.window, view.middle, "panel", 1e5 * steps)
    np.testing.assert_allclose(much, 1e5 * little, rtol=1e-6)


def test_a_simulation_that_fails_ends_a_family_of_wrongs_and_no_look(flown, monkeypatch):
    def failing(view):
        raise SimulationFailure("no steps are short enough")
        yield

    monkeypatch.setattr(wrongs, "_WRONGS", (failing, swaps))
    assert [wrong.kind for wrong in wrongs.all_wrongs(prepared(*flown))] == ["swapped"]
