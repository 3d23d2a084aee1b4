"""View factors against tabulated values, the closure of a box, reciprocity and rays."""

import numpy as np
import pytest

from flightcal.scenario.view_factors import Rectangles, gebhart_factors, view_factors


def rectangle(axis, side, lower, upper):
    return Rectangles(axis, side, np.array([lower], float), np.array([upper], float))


def box_sides(size, mesh):
    """All inner cells of a box from the origin, one `Rectangles` a side."""
    sides = []
    for axis in range(3):
        a, b = (k for k in range(3) if k != axis)
        for place, side in ((0.0, 1), (size[axis], -1)):
            i, j = (index.ravel() for index in np.indices((mesh, mesh)))
            lower, upper = np.zeros((mesh**2, 3)), np.zeros((mesh**2, 3))
            lower[:, axis] = upper[:, axis] = place
            lower[:, a], upper[:, a] = size[a] * i / mesh, size[a] * (i + 1) / mesh
            lower[:, b], upper[:, b] = size[b] * j / mesh, size[b] * (j + 1) / mesh
            sides.append(Rectangles(axis, side, lower, upper))
    return sides


def all_factors(sides):
    return np.block([[view_factors(first, second) for second in sides] for first in sides])


def test_sides_of_a_cube_have_the_tabulated_values():
    """Howell's catalogue, C-11 and C-14: 0.19982 opposite, 0.20004 adjacent."""
    sides = box_sides((1.0, 1.0, 1.0), 1)
    assert view_factors(sides[0], sides[1])[0, 0] == pytest.approx(0.199825, abs=1e-6)
    assert view_factors(sides[0], sides[2])[0, 0] == pytest.approx(0.200044, abs=1e-6)


@pytest.mark.parametrize("size", [(1.0, 1.0, 1.0), (0.3, 1.7, 0.9)])
def test_every_cell_of_a_box_sees_all_of_its_surroundings_once(size):
    sides = box_sides(size, 4)
    factors = all_factors(sides)
    assert factors.min() >= -1e-12
    np.testing.assert_allclose(factors.sum(axis=1), 1.0, atol=1e-10)
    exchanged = np.concatenate([side.area for side in sides])[:, None] * factors
    np.testing.assert_allclose(exchanged, exchanged.T, atol=1e-12)


def test_rectangles_apart_agree_with_rays():
    """Cosine-distributed rays from the first; the tolerance is four standard errors."""
    rng = np.random.default_rng(0)
    first = rectangle(2, 1, (0.2, -0.5, 0.0), (1.1, 0.4, 0.0))
    others = {
        "perpendicular": rectangle(0, -1, (1.5, -0.1, 0.3), (1.5, 1.2, 1.4)),
        "parallel": rectangle(2, -1, (0.6, 0.3, 0.8), (1.9, 0.9, 0.8)),
    }
    count = 400_000
    start = rng.uniform(first.lower[0], first.upper[0], (count, 3))
    radius, angle = np.sqrt(rng.random(count)), rng.uniform(0.0, 2.0 * np.pi, count)
    towards = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1.0 - radius**2)], axis=1)
    for name, other in others.items():
        reach = (other.lower[0, other.axis] - start[:, other.axis]) / towards[:, other.axis]
        place = start + reach[:, None] * towards
        hit = reach > 0.0
        for k in range(3):
            if k != other.axis:
                hit &= (other.lower[0, k] < place[:, k]) & (place[:, k] < other.upper[0, k])
        expected = view_factors(first, other)[0, 0]
        assert expected > 0.01, name
        assert hit.mean() == pytest.approx(expected, abs=4.0 * np.sqrt(expected / count)), name


def test_what_lies_behind_is_not_seen():
    floor = rectangle(2, 1, (0.0, 0.0, 0.0), (1.0, 1.0, 0.0))
    below = rectangle(2, 1, (0.0, 0.0, -1.0), (1.0, 1.0, -1.0))
    turned = rectangle(0, 1, (1.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    half = rectangle(0, -1, (1.0, 0.0, -1.0), (1.0, 1.0, 1.0))
    whole = rectangle(0, -1, (1.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    assert view_factors(floor, below)[0, 0] == 0.0
    assert view_factors(floor, turned)[0, 0] == pytest.approx(0.0, abs=1e-12)
    assert view_factors(floor, half)[0, 0] == pytest.approx(view_factors(floor, whole)[0, 0])


def test_gebhart_factors_of_a_closed_box_absorb_all_and_are_reciprocal():
    sides = box_sides((1.0, 2.0, 0.5), 2)
    emissivity = np.random.default_rng(1).uniform(0.05, 0.95, 24)
    shares = gebhart_factors(all_factors(sides), emissivity)
    np.testing.assert_allclose(shares.sum(axis=1), 1.0, atol=1e-9)
    couplings = (emissivity * np.concatenate([side.area for side in sides]))[:, None] * shares
    np.testing.assert_allclose(couplings, couplings.T, atol=1e-9)


def test_black_surfaces_absorb_what_they_see():
    factors = all_factors(box_sides((1.0, 1.0, 1.0), 2))
    np.testing.assert_allclose(gebhart_factors(factors, np.ones(24)), factors, atol=1e-12)
