"""Draws simulated exactly, with heat of their own."""

import numpy as np

from flightcal.calibration.heat_check import check_heat
from flightcal.calibration.heat_point import draw_sizes, spread_sizes
from tests.calibration.heated import sizes_of


def test_simulations_with_their_heat_confirm_the_linear_response(started):
    problem, point, heated, _, known = started
    rng = np.random.default_rng(1)
    mean, factor = point.around.of_z(sizes_of(point))
    order = [known.names.index(problem.names[k]) for k in point.around.moving]
    z = np.zeros((1, 60, len(known.names)))
    z[..., order] = mean + rng.standard_normal((1, 60, len(mean))) @ factor.T
    thetas = spread_sizes(problem, heated, point, known, z, draw_sizes(point, rng), rng)[0]

    checked = check_heat(heated, thetas, rng)

    assert checked.draws == 60
    assert checked.difference < 0.01
    # k is a shape: of weights that hardly differ it says nothing.
    assert checked.pareto_k < 0.7 or checked.relative < 0.01
