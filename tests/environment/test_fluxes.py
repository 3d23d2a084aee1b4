import time

import numpy as np
import pytest

from flightcal.environment import face_fluxes, shadow_edges, sunlit_share
from flightcal.environment.geometry import geometry_of
from flightcal.environment.orbit import EARTH_RADIUS
from flightcal.environment.sun import ASTRONOMICAL_UNIT
from flightcal.errors import OrbitError
from flightcal.scenario import SunTracking

from .scenes import EPOCH, circular, environment, random_units, seconds_after

TIMES = seconds_after(EPOCH, np.arange(0.0, 6000.0, 60.0))
CUBE = {
    "forward": (1, 0, 0),
    "backward": (-1, 0, 0),
    "right": (0, 1, 0),
    "left": (0, -1, 0),
    "down": (0, 0, 1),
    "up": (0, 0, -1),
}
SQUARED_RATIO = (EARTH_RADIUS / (EARTH_RADIUS + 693e3)) ** 2


def solar_flux(scene, times):
    at = geometry_of(scene)(times)
    return 1361.0 * (ASTRONOMICAL_UNIT / np.linalg.norm(at.sun - at.position, axis=1)) ** 2


def test_nadir_spacecraft_sees_the_earth_below_and_not_above():
    fluxes = face_fluxes(environment(circular()), CUBE, TIMES)
    assert fluxes.names == tuple(CUBE)
    down, up = fluxes.names.index("down"), fluxes.names.index("up")
    assert fluxes.infrared[:, down] == pytest.approx(SQUARED_RATIO, rel=1e-9)
    assert (fluxes.infrared[:, up] == 0).all()
    assert (fluxes.albedo[:, up] == 0).all()
    sides = fluxes.infrared[:, [0, 1, 2, 3]]
    assert sides == pytest.approx(sides[0, 0], rel=1e-9)


def test_solar_flux_on_a_cube_has_the_sun_s_strength_in_light_and_none_in_shadow():
    scene = environment(circular(raan="30 deg"))
    fluxes = face_fluxes(scene, CUBE, TIMES)
    share = sunlit_share(scene, TIMES)
    # Three mutually perpendicular faces at most are lit; their cosines' squares add to one.
    total = np.sqrt((fluxes.solar**2).sum(axis=1))
    assert total == pytest.approx(share * solar_flux(scene, TIMES), rel=1e-9)
    assert (fluxes.solar[share == 0] == 0).all()
    assert ((fluxes.solar > 0).sum(axis=1) <= 3).all()


def test_albedo_at_the_subsolar_point_is_the_view_factor_s_share_of_the_sun():
    scene = environment(circular(raan="0 deg", argument_of_latitude="0 deg"))
    fluxes = face_fluxes(scene, {"down": (0, 0, 1)}, np.array([EPOCH]))
    # Zenith angles reach 26 deg at the horizon, and weigh little: a few percent below the view factor.
    share = fluxes.albedo[0, 0] / solar_flux(scene, np.array([EPOCH]))[0]
    assert 0.93 * SQUARED_RATIO < share < SQUARED_RATIO


def test_sun_pointing_face_receives_the_whole_solar_flux():
    scene = environment(circular(raan="90 deg", altitude="1400 km"), attitude="sun_pointing")
    fluxes = face_fluxes(scene, {"array": (0, 0, 5), "back": (0, 0, -1)}, TIMES)
    assert fluxes.solar[:, 0] == pytest.approx(solar_flux(scene, TIMES), rel=1e-12)
    assert (fluxes.solar[:, 1] == 0).all()


def tracking(axis, back=False) -> SunTracking:
    return SunTracking(tracks_sun_about=axis, back=back)


@pytest.mark.parametrize("attitude", ["nadir", {"inertial": [0.5, 0.1, -0.7, 0.5]}])
def test_face_that_tracks_the_sun_stands_as_near_to_it_as_its_axis_allows(attitude):
    scene = environment(circular(raan="50 deg"), attitude=attitude)
    axis = np.array([0.2, 1.0, -0.3])
    fluxes = face_fluxes(scene, {"front": tracking(tuple(axis)), "back": tracking(tuple(axis), back=True)}, TIMES)
    # No way across the axis is better: all of them in steps of a degree, as faces that are fixed.
    along = np.cross(axis, (1.0, 0.0, 0.0))
    along /= np.linalg.norm(along)
    across = np.cross(axis / np.linalg.norm(axis), along)
    turns = {str(k): tuple(along * np.cos(a) + across * np.sin(a)) for k, a in enumerate(np.deg2rad(np.arange(360)))}
    fixed = face_fluxes(scene, turns, TIMES)
    assert fluxes.solar[:, 0] == pytest.approx(fixed.solar.max(axis=1), rel=2e-4)
    assert (fluxes.solar[:, 1] == 0).all()
    # Both sides get of the Earth what the two sides of a fixed plate get that stands so, in the Sun or not.
    best = fixed.solar.argmax(axis=1)
    sunlit = fixed.solar.max(axis=1) > 0
    rows = np.arange(len(TIMES))[sunlit]
    for kind in ("albedo", "infrared"):
        ours, plates = getattr(fluxes, kind), getattr(fixed, kind)
        assert ours[rows, 0] == pytest.approx(plates[rows, best[rows]], abs=0.02 * plates.max())
        assert ours[rows, 1] == pytest.approx(plates[rows, (best[rows] + 180) % 360], abs=0.02 * plates.max())


def test_face_turned_about_an_axis_across_the_sun_gets_the_whole_solar_flux():
    # At the equinox the Sun stands in the plane of an equatorial orbit, whose normal is the drive's axis.
    scene = environment(circular(inclination="0 deg", altitude="35786 km"))
    fluxes = face_fluxes(scene, {"array": tracking((0, 1, 0))}, TIMES)
    lit = fluxes.solar[:, 0] > 0
    assert lit.sum() > 10
    assert fluxes.solar[lit, 0] == pytest.approx(solar_flux(scene, TIMES)[lit], rel=1e-4)


def test_face_whose_axis_points_to_the_sun_gets_no_sunlight_and_no_error():
    scene = environment(circular(raan="30 deg"), attitude="sun_pointing")
    fluxes = face_fluxes(scene, {"array": tracking((0, 0, 1))}, TIMES)
    assert fluxes.solar[:, 0] == pytest.approx(0.0, abs=1e-5)
    assert np.isfinite(fluxes.infrared).all()


def test_no_face_tracks_the_sun_on_a_body_that_spins_fast():
    scene = environment(circular(), attitude={"spin_axis": [0, 0, 1], "direction": [1, 0, 0]})
    with pytest.raises(OrbitError, match="a face that tracks the Sun"):
        face_fluxes(scene, {"array": tracking((0, 1, 0)), "top": (0, 0, 1)}, TIMES)


def test_length_of_the_normal_does_not_matter():
    scene = environment(circular(raan="30 deg"))
    fluxes = face_fluxes(scene, {"one": (1, 2, 2), "long": (10, 20, 20)}, TIMES)
    for values in (fluxes.solar, fluxes.albedo, fluxes.infrared):
        assert values[:, 0] == pytest.approx(values[:, 1], rel=1e-12)


def test_small_convex_body_receives_the_mean_over_all_directions():
    scene = environment(circular(raan="30 deg"), attitude={"inertial": [1, 0, 0, 0]})
    even = random_units(np.random.default_rng(1), 3000)
    even = np.concatenate([even, -even])  # opposite pairs take the noise out of the net flux
    faces = {"body": "all"} | {str(k): tuple(normal) for k, normal in enumerate(even)}
    fluxes = face_fluxes(scene, faces, TIMES[::20])
    for values in (fluxes.solar, fluxes.albedo, fluxes.infrared):
        assert values[:, 0] == pytest.approx(values[:, 1:].mean(axis=1), rel=0.02)
    lit = sunlit_share(scene, TIMES[::20])
    assert fluxes.solar[:, 0] == pytest.approx(lit * solar_flux(scene, TIMES[::20]) / 4)


def test_fast_spin_receives_the_mean_of_a_slow_spin_over_its_turns():
    faces = {"side": (1, 0.3, 0), "top": (0.2, 0, 1)}
    spin = {"spin_axis": [0, 0, 1], "direction": [0.4, 0.5, 0.2]}
    times = TIMES[::25]
    fast = face_fluxes(environment(circular(raan="30 deg"), attitude=spin), faces, times)
    # Spins of 360 s seen at 1/360 of a turn apart, with orbit and Sun standing still: only the attitude's time runs.
    slow = environment(circular(raan="30 deg"), attitude=spin | {"period": "0.36 s"})
    turns = [face_fluxes(slow, faces, times + np.timedelta64(k, "ms")) for k in range(360)]
    for name, tolerance in (("solar", 0.2), ("albedo", 0.2), ("infrared", 5e-4)):
        mean = np.mean([getattr(turn, name) for turn in turns], axis=0)
        assert getattr(fast, name) == pytest.approx(mean, abs=tolerance)


def test_repeated_and_unordered_times_give_the_same_rows():
    scene = environment(circular(raan="30 deg"))
    order = np.array([5, 3, 3, 99, 0, 5])
    whole, some = face_fluxes(scene, CUBE, TIMES), face_fluxes(scene, CUBE, TIMES[order])
    for name in ("solar", "albedo", "infrared"):
        assert (getattr(some, name) == getattr(whole, name)[order]).all()


def test_solar_flux_turns_at_the_shadow_s_edges():
    scene = environment(circular(raan="30 deg"), attitude="sun_pointing")
    edges = shadow_edges(scene, TIMES[0], TIMES[-1])
    sun = face_fluxes(scene, {"array": (0, 0, 1)}, edges).solar[:, 0]
    full = solar_flux(scene, edges)
    assert np.minimum(sun, full - sun) == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize("faces", [{}, {"body": "all"}, {"plate": (0, 0, 1)}])
def test_shapes_are_times_by_faces(faces):
    for times in (TIMES, TIMES[:0]):
        fluxes = face_fluxes(environment(circular()), faces, times)
        for values in (fluxes.solar, fluxes.albedo, fluxes.infrared):
            assert values.shape == (len(times), len(faces))


def test_faces_without_orbit_are_an_error():
    with pytest.raises(OrbitError, match="found no 'orbit'"):
        face_fluxes(environment(period="97 min"), CUBE, TIMES)


def test_five_hundred_times_ten_faces_take_well_under_a_second():
    scene = environment(circular())
    faces = CUBE | {f"more {k}": (1, k, 2) for k in range(4)}
    times = seconds_after(EPOCH, np.linspace(0, 12000, 500))
    start = time.perf_counter()
    face_fluxes(scene, faces, times)
    assert time.perf_counter() - start < 1.0
