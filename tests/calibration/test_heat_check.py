"""Draws simulated exactly, with heat of their own."""

import numpy as np

from flightcal.calibration.heat_check import check_heat
from tests.calibration.heated import spread_draws


def test_simulations_with_their_heat_confirm_the_linear_response(started):
    heated, rng = started[2], np.random.default_rng(1)
    (thetas,) = spread_draws(started, 1, 60, rng)

    checked = check_heat(heated, thetas, rng)

    assert checked.draws == 60
    assert checked.difference < 0.01
    # k is a shape: of weights that hardly differ it says nothing.
    assert checked.pareto_k < 0.7 or checked.relative < 0.01
