import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flightcal.environment.eclipse import sunlit_fraction
from flightcal.environment.faces import (
    AllDirections,
    Flat,
    Spun,
    albedo_view,
    infrared_view,
    mean_view_factor,
    turn_mean_cosine,
    view_factor,
)
from flightcal.environment.orbit import EARTH_RADIUS
from flightcal.environment.sun import ASTRONOMICAL_UNIT

from .scenes import random_units, reference_data

HEIGHTS = [200e3, 408e3, 700e3, 2000e3, 36000e3]


def scene(rng, height, count, faces):
    """Positions [T, 3] m, directions of the Sun [T, 3] and normals [T, F, 3]."""
    return (
        random_units(rng, count) * (EARTH_RADIUS + height),
        random_units(rng, count),
        random_units(rng, count, faces),
    )


def ray_traced(position, sun, normals, nadir_steps=300, turns=360):
    """View factor and albedo view [F] of one position: rays over the Earth's disc, seen from the spacecraft.

    Rays in rings about the nadir, closer near the limb; nothing of `faces._disc`.
    """
    distance = np.linalg.norm(position)
    down = -position / distance
    side = np.cross(down, [0.3, -0.5, 0.81])
    side /= np.linalg.norm(side)
    front = np.cross(down, side)
    limb = np.arcsin(EARTH_RADIUS / distance)
    # Squeezed towards the limb, where the ground is seen at a glance and the solar zenith angle runs fast.
    fraction = (np.arange(nadir_steps) + 0.5) / nadir_steps
    nadir = limb * (1 - (1 - fraction) ** 2)
    solid = np.sin(nadir) * limb * 2 * (1 - fraction) / nadir_steps * 2 * np.pi / turns
    turn = 2 * np.pi * (np.arange(turns) + 0.5) / turns
    ray = (
        np.cos(nadir)[:, None, None] * down
        + np.sin(nadir)[:, None, None] * (np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * front)
    ).reshape(-1, 3)
    solid = np.repeat(solid, turns)
    towards_centre = -(ray @ position)
    reach = towards_centre - np.sqrt(towards_centre**2 - distance**2 + EARTH_RADIUS**2)
    ground = (position + reach[:, None] * ray) / EARTH_RADIUS
    incidence = np.maximum(ray @ normals.T, 0.0)
    zenith = np.maximum(ground @ sun, 0.0)
    return solid @ incidence / np.pi, (solid * zenith) @ incidence / np.pi


# --- view factor --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("height", HEIGHTS)
def test_view_factor_facing_the_earth_is_the_squared_ratio_of_radii(height):
    ratio = 1 + height / EARTH_RADIUS
    assert view_factor(np.array(1.0), ratio) == pytest.approx(ratio**-2, rel=1e-14)
    assert view_factor(np.array(-1.0), ratio) == 0


@pytest.mark.parametrize("height", HEIGHTS)
def test_view_factor_edge_on_is_that_of_half_a_sphere(height):
    ratio = 1 + height / EARTH_RADIUS
    limb = np.arcsin(1 / ratio)
    expected = (limb - np.sin(limb) * np.cos(limb)) / np.pi
    assert view_factor(np.array(0.0), ratio) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("height", HEIGHTS)
def test_view_factor_has_no_jump_where_the_horizon_begins_to_cut(height):
    ratio = 1 + height / EARTH_RADIUS
    for cosine in (1 / ratio, -1 / ratio):
        below, above = view_factor(cosine + np.array([-1e-9, 1e-9]), ratio)
        assert above == pytest.approx(below, abs=1e-8)


@given(st.floats(-1, 1), st.floats(1.01, 10))
def test_view_factor_of_both_sides_differs_by_the_net_irradiance(cosine, ratio):
    # Irradiance is a vector: opposite sides differ by its component along the normal.
    difference = view_factor(np.array(cosine), ratio) - view_factor(np.array(-cosine), ratio)
    assert difference == pytest.approx(cosine / ratio**2, abs=1e-12)


@given(st.floats(-1, 0.999), st.floats(1.01, 10))
def test_view_factor_grows_towards_the_earth_and_stays_within_bounds(cosine, ratio):
    less, more = view_factor(np.array([cosine, cosine + 0.001]), ratio)
    assert 0 <= less <= more + 1e-15 <= 1


@pytest.mark.parametrize("height", HEIGHTS)
def test_view_factor_agrees_with_rays(height):
    rng = np.random.default_rng(1)
    position, sun, normals = scene(rng, height, 1, 40)
    traced, _ = ray_traced(position[0], sun[0], normals[0])
    closed = infrared_view(Flat(normals), position)[0]
    assert np.abs(closed - traced).max() < 1e-4


@pytest.mark.parametrize("height", HEIGHTS)
def test_mean_view_factor_is_the_mean_over_directions(height):
    ratio = 1 + height / EARTH_RADIUS
    cosines = -1 + (np.arange(20000) + 0.5) / 10000
    assert mean_view_factor(np.array([ratio])) == pytest.approx(view_factor(cosines, ratio).mean(), rel=1e-6)


# --- albedo -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("height", HEIGHTS)
def test_albedo_agrees_with_rays(height):
    rng = np.random.default_rng(2)
    position, sun, normals = scene(rng, height, 8, 16)
    # Faces edge-on to the Earth and in the plane of the Sun are the quadrature's worst.
    up = position / np.linalg.norm(position, axis=1, keepdims=True)
    level = sun - np.sum(sun * up, axis=1, keepdims=True) * up
    level /= np.linalg.norm(level, axis=1, keepdims=True)
    normals[:, :6] = np.stack([-up, up, level, -level, np.cross(up, level), np.cross(level, up)], axis=1)
    view = albedo_view(Flat(normals), position, sun)
    peak = (1 + height / EARTH_RADIUS) ** -2
    for k in range(len(position)):
        _, traced = ray_traced(position[k], sun[k], normals[k])
        assert np.abs(view[k] - traced).max() < 1e-3 * peak


def test_albedo_is_nil_over_the_night():
    position, sun = np.array([[-7000e3, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]])
    normals = random_units(np.random.default_rng(3), 1, 20)
    assert (albedo_view(Flat(normals), position, sun) == 0).all()


def test_albedo_low_over_the_subsolar_point_is_the_view_factor():
    position, sun = np.array([[EARTH_RADIUS + 1e3, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]])
    normals = np.array([[[-1.0, 0.0, 0.0]]])
    assert albedo_view(Flat(normals), position, sun) == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("height", HEIGHTS)
def test_albedo_of_both_sides_differs_by_a_vector_s_component(height):
    rng = np.random.default_rng(4)
    position, sun, normals = scene(rng, height, 30, 8)
    net = np.stack(
        [
            albedo_view(Flat(np.tile(axis, (30, 1, 1))), position, sun)[:, 0]
            - albedo_view(Flat(np.tile(-axis, (30, 1, 1))), position, sun)[:, 0]
            for axis in np.eye(3)
        ],
        axis=1,
    )
    difference = albedo_view(Flat(normals), position, sun) - albedo_view(Flat(-normals), position, sun)
    assert difference == pytest.approx(np.einsum("tfi,ti->tf", normals, net), abs=1e-12)


@pytest.mark.parametrize("height", HEIGHTS)
def test_mean_albedo_is_the_mean_over_directions(height):
    rng = np.random.default_rng(5)
    position, sun, _ = scene(rng, height, 10, 1)
    count = np.arange(2000) + 0.5
    polar, turn = np.arccos(1 - count / 1000), np.pi * (1 + np.sqrt(5)) * count
    even = np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1)
    mean = albedo_view(Flat(np.broadcast_to(even, (10, 2000, 3))), position, sun).mean(axis=1)
    assert albedo_view(AllDirections(), position, sun)[:, 0] == pytest.approx(mean, abs=2e-5)


def test_mean_albedo_never_exceeds_the_mean_view_factor():
    position, sun, _ = scene(np.random.default_rng(6), 500e3, 200, 1)
    ratio = np.full(200, 1 + 500e3 / EARTH_RADIUS)
    assert (albedo_view(AllDirections(), position, sun)[:, 0] <= mean_view_factor(ratio) * (1 + 1e-4)).all()


@given(st.integers(0, 2**31), st.sampled_from(HEIGHTS))
@settings(max_examples=40)
def test_turning_everything_leaves_fluxes_unchanged(seed, height):
    rng = np.random.default_rng(seed)
    position, sun, normals = scene(rng, height, 3, 4)
    turn = Rotation.random(rng=rng).as_matrix()
    turned = Flat(normals @ turn.T)
    albedo = albedo_view(Flat(normals), position, sun)
    assert albedo_view(turned, position @ turn.T, sun @ turn.T) == pytest.approx(albedo, abs=1e-9)
    infrared = infrared_view(Flat(normals), position)
    assert infrared_view(turned, position @ turn.T) == pytest.approx(infrared, abs=1e-12)


@given(st.integers(0, 2**31))
@settings(max_examples=40)
def test_reflection_in_the_plane_of_earth_and_sun_leaves_albedo_unchanged(seed):
    rng = np.random.default_rng(seed)
    position, sun, normals = scene(rng, 600e3, 2, 4)
    across = np.cross(position, sun)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    reflected = normals - 2 * np.einsum("tfi,ti->tf", normals, across)[..., None] * across[:, None]
    albedo = albedo_view(Flat(normals), position, sun)
    assert albedo_view(Flat(reflected), position, sun) == pytest.approx(albedo, abs=1e-9)


def test_sun_overhead_gives_finite_albedo():
    position = np.array([[0.0, 0.0, 7000e3], [7000e3, 0.0, 0.0]])
    normals = np.tile([[0.0, 0.6, -0.8], [-0.8, 0.6, 0.0]], (2, 1, 1))
    view = albedo_view(Flat(normals), position, position)
    assert np.isfinite(view).all()
    assert view[0, 0] == pytest.approx(view[1, 1], rel=2e-3)


# --- fast spin ----------------------------------------------------------------------------------------------


@given(st.floats(0, np.pi), st.floats(0, np.pi))
def test_mean_cosine_over_a_turn_agrees_with_sampling(face, light):
    turn = 2 * np.pi * (np.arange(4000) + 0.5) / 4000
    cosine = np.cos(face) * np.cos(light) + np.sin(face) * np.sin(light) * np.cos(turn)
    found = turn_mean_cosine(np.cos(face), np.cos(light))
    assert found == pytest.approx(np.maximum(cosine, 0).mean(), abs=1e-6)


def test_spun_faces_receive_the_mean_over_a_turn():
    rng = np.random.default_rng(7)
    position, sun, _ = scene(rng, 500e3, 20, 1)
    axis = random_units(rng)
    normals = random_units(rng, 3)
    turns = Rotation.from_rotvec(2 * np.pi * np.arange(360)[:, None] / 360 * axis).as_matrix()
    flat = Flat(np.broadcast_to(np.einsum("kij,fj->kfi", turns, normals).reshape(-1, 3), (20, 1080, 3)))
    spun = Spun(axis, normals @ axis)
    albedo = albedo_view(flat, position, sun).reshape(20, 360, 3).mean(axis=1)
    infrared = infrared_view(flat, position).reshape(20, 360, 3).mean(axis=1)
    assert albedo_view(spun, position, sun) == pytest.approx(albedo, abs=5e-5)
    assert infrared_view(spun, position) == pytest.approx(infrared, abs=5e-6)


# --- against ESATAN-TMS -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def esatan():
    """Time, albedo, planet and solar flux (W/m2) from ESATAN, and the same orbit's positions, normals and Sun."""
    columns = np.loadtxt(reference_data("esatan", "Beta45_Z_408km.csv"), delimiter=",", skiprows=6)
    turn = 2 * np.pi * columns[:, 0] / columns[-1, 0]
    zero = np.zeros_like(turn)
    position = (6371e3 + 408e3) * np.stack([np.cos(turn), np.sin(turn), zero], axis=1)
    velocity = np.stack([-np.sin(turn), np.cos(turn), zero], axis=1)
    sun = np.broadcast_to([np.sqrt(0.5), 0.0, np.sqrt(0.5)], position.shape)
    return columns[:, [1, 3, 5]], position, velocity, sun


def test_albedo_agrees_with_esatan(esatan):
    columns, position, velocity, sun = esatan
    reference = columns[:, 0]
    found = 435.8 * albedo_view(Flat(velocity[:, None]), position, sun, 6371e3)[:, 0]
    assert np.abs(found - reference).max() < 0.005 * reference.max()


def test_planet_flux_agrees_with_esatan(esatan):
    columns, position, velocity, _ = esatan
    found = 239.0 * infrared_view(Flat(velocity[:, None]), position, 6371e3)[:, 0]
    assert found == pytest.approx(columns[:, 1], rel=0.002)


def test_direct_solar_flux_and_eclipse_agree_with_esatan(esatan):
    columns, position, velocity, sun = esatan
    reference = columns[:, 2]
    share = sunlit_fraction(position, 0.983 * ASTRONOMICAL_UNIT * sun, 6371e3)
    found = 1413.6 * share * Flat(velocity[:, None]).cosine(sun[:, None])[:, 0, 0]
    edge = np.flatnonzero(np.diff((reference > 0).astype(int)))
    near = np.unique(np.concatenate([edge, edge + 1]))
    away = np.setdiff1d(np.arange(len(reference)), near)
    assert np.abs(found - reference)[away].max() < 0.001 * reference.max()
    assert (found[away] > 1).sum() > 12
