import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from flightcal.environment import orbital_period, shadow_edges, sunlit_share
from flightcal.environment.eclipse import sunlit_fraction
from flightcal.environment.geometry import geometry_of
from flightcal.environment.orbit import EARTH_RADIUS
from flightcal.environment.sun import ASTRONOMICAL_UNIT, SUN_RADIUS
from flightcal.errors import OrbitError

from .scenes import EPOCH, beta_angle, circular, environment, raan_to_local_time, reference_data, seconds_after

SUN = np.array([[ASTRONOMICAL_UNIT, 0.0, 0.0]])


def seconds(times):
    return (times - EPOCH) / np.timedelta64(1, "s")


# --- sunlit share -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("position", "share"),
    [([7000e3, 0, 0], 1.0), ([0, 7000e3, 0], 1.0), ([-7000e3, 0, 0], 0.0), ([-7000e3, 1000e3, 0], 0.0)],
)
def test_share_is_whole_in_sunlight_and_nil_in_umbra(position, share):
    assert sunlit_fraction(np.array([position], float), SUN) == share


def test_share_is_half_where_the_sun_s_centre_stands_on_the_limb():
    # The line of sight to the Sun's centre touches the Earth: at right angles to the radius of the touching point.
    along = np.linspace(1000e3, 40000e3, 50)
    position = np.stack([-along, np.full(50, EARTH_RADIUS), np.zeros(50)], axis=1)
    sun = np.broadcast_to([ASTRONOMICAL_UNIT, EARTH_RADIUS, 0.0], position.shape)
    # Not exactly half: the limb is curved (more so, seen from afar).
    assert sunlit_fraction(position, sun) == pytest.approx(0.5, abs=0.012)


def test_share_agrees_with_counting_points_of_the_solar_disc():
    rng = np.random.default_rng(3)
    radius = SUN_RADIUS * np.sqrt(rng.random(40000))
    angle = 2 * np.pi * rng.random(40000)
    points = np.stack([np.zeros(40000), radius * np.cos(angle), radius * np.sin(angle)], axis=1) + SUN
    for across in np.linspace(EARTH_RADIUS - 60e3, EARTH_RADIUS + 40e3, 12):
        position = np.array([-9000e3, across * 0.6, across * 0.8])
        rays = points - position
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        nearest = position - np.sum(position * rays, axis=1, keepdims=True) * rays
        counted = np.mean(np.linalg.norm(nearest, axis=1) > EARTH_RADIUS)
        assert sunlit_fraction(position[None], SUN) == pytest.approx(counted, abs=0.01)


@given(st.floats(6400e3, 50000e3), st.floats(0, np.pi), st.integers(0, 2**31))
@settings(max_examples=60)
def test_share_depends_only_on_distance_and_angle(distance, angle, seed):
    turn = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    position = distance * np.array([[np.cos(angle), np.sin(angle), 0.0]])
    share = sunlit_fraction(position, SUN)
    assert 0 <= share <= 1
    assert sunlit_fraction(position @ turn.T, SUN @ turn.T) == pytest.approx(share, abs=1e-6)


def test_share_falls_steadily_through_the_penumbra():
    across = np.linspace(EARTH_RADIUS + 60e3, EARTH_RADIUS - 60e3, 400)
    position = np.stack([np.full(400, -9000e3), across, np.zeros(400)], axis=1)
    share = sunlit_fraction(position, np.broadcast_to(SUN, (400, 3)))
    assert share[0] == 1
    assert share[-1] == 0
    assert (np.diff(share) <= 0).all()
    assert ((share > 0) & (share < 1)).sum() > 100


def test_share_is_unknown_without_an_orbit():
    times = seconds_after(EPOCH, [0.0, 1.0])
    assert np.isnan(sunlit_share(environment(period="97 min"), times)).tolist() == [True, True]


# --- edges --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("raan", [0, 30, 45])
@pytest.mark.parametrize("altitude", ["408 km", "1400 km"])
def test_eclipse_lasts_as_long_as_behind_a_cylinder(raan, altitude):
    scene = environment(circular(altitude, raan=f"{raan} deg"))
    edges = shadow_edges(scene, EPOCH, EPOCH + np.timedelta64(6, "h"))
    first = np.flatnonzero(sunlit_share(scene, edges - np.timedelta64(1, "s")) == 1)[0]
    outer_in, inner_in, inner_out, outer_out = seconds(edges[first : first + 4])
    height = EARTH_RADIUS + {"408 km": 408e3, "1400 km": 1400e3}[altitude]
    beta = beta_angle(scene, edges[first : first + 1])[0]
    # Ground track in shadow: cos(half width) = sqrt(1 - (R / a)^2) / cos(beta).
    half_width = np.arccos(np.sqrt(1 - (EARTH_RADIUS / height) ** 2) / np.cos(beta))
    expected = half_width / np.pi * orbital_period(scene)
    # The solar disc's centre goes behind the limb halfway through the penumbra.
    assert (inner_out + outer_out - outer_in - inner_in) / 2 == pytest.approx(expected, abs=1.5)


def test_edges_are_where_light_begins_and_ends_to_a_millisecond():
    scene = environment(circular(raan="30 deg"))
    edges = shadow_edges(scene, EPOCH, EPOCH + np.timedelta64(12, "h"))
    before, after = (sunlit_share(scene, edges + np.timedelta64(sign, "ms")) for sign in (-1, 1))
    assert len(edges) == pytest.approx(4 * 12 * 3600 / orbital_period(scene), abs=4)
    outside = {0.0, 1.0}
    for one, other in zip(before, after, strict=True):
        assert (one in outside) != (other in outside)


def test_edges_agree_with_a_fine_search():
    scene = environment(circular(raan="55 deg"))
    times = seconds_after(EPOCH, np.arange(0.0, 6000.0, 0.5))
    share = sunlit_share(scene, times)
    inside = (share > 0).astype(int) + (share == 1)
    found = seconds(times[np.flatnonzero(np.diff(inside))])
    edges = seconds(shadow_edges(scene, times[0], times[-1]))
    assert edges == pytest.approx(found + 0.25, abs=0.251)


def test_dawn_dusk_orbit_has_no_edges():
    scene = environment(circular(raan="90 deg", altitude="1400 km"))
    day = shadow_edges(scene, EPOCH, EPOCH + np.timedelta64(1, "D"))
    assert day.size == 0
    assert day.dtype == np.dtype("datetime64[ns]")


def test_short_passage_through_the_penumbra_is_found():
    # Between no eclipse (beta high) and a long one lies a node for which the penumbra is only brushed.
    times = seconds_after(EPOCH, np.arange(0.0, 5900.0, 1.0))

    def brushed(raan):
        share = sunlit_share(environment(circular(raan=f"{raan} deg")), times)
        return times[share < 1]

    low, high = 60.0, 90.0
    while (count := len(brushed((low + high) / 2))) == 0 or count > 6:
        low, high = ((low + high) / 2, high) if count else (low, (low + high) / 2)
    dark = brushed((low + high) / 2)
    scene = environment(circular(raan=f"{(low + high) / 2} deg"))
    # The passage lies in the middle of a step of the search, 1/360 of the period, and is shorter.
    step = orbital_period(scene) / 360
    middle = seconds(dark[[0, -1]]).mean()
    edges = shadow_edges(scene, *seconds_after(EPOCH, middle + np.array([-50.45, 50.45]) * step))
    assert len(edges) == 2
    assert (edges[1] - edges[0]) / np.timedelta64(1, "s") < step / 2
    assert np.abs(seconds(edges) - seconds(dark[[0, -1]])).max() <= 1.0


def test_interval_that_begins_in_shadow_has_the_edges_that_lie_in_it():
    scene = environment(circular())
    whole = shadow_edges(scene, EPOCH, EPOCH + np.timedelta64(3, "h"))
    inside = shadow_edges(scene, whole[1] + np.timedelta64(60, "s"), whole[3] + np.timedelta64(60, "s"))
    assert np.abs(seconds(inside) - seconds(whole[2:4])).max() < 1e-3


def test_empty_interval_has_no_edges_and_a_reversed_one_is_an_error():
    scene = environment(circular())
    assert shadow_edges(scene, EPOCH, EPOCH).size == 0
    with pytest.raises(OrbitError, match="not before start"):
        shadow_edges(scene, EPOCH, EPOCH - np.timedelta64(1, "s"))


# --- against flight: FUNcube-1 ------------------------------------------------------------------------------

# Mean elements of AO-73 on 2016-02-04, interpolated between its public two-line elements of 2015-11-18 and
# 2016-12-18 (node, perigee, mean motion, inclination and eccentricity all run smoothly between them). Only the mean
# anomaly is fitted: to the first four edges of the telemetry.
FUNCUBE = {
    "semi_major_axis": "7002.09 km",
    "eccentricity": 0.00592,
    "inclination": "97.70 deg",
    "raan": "93.77 deg",
    "argument_of_perigee": "100.08 deg",
    "mean_anomaly": "23.13 deg",
    "epoch": "2016-02-04T00:00:00",
}


@pytest.fixture(scope="module")
def funcube_edges():
    """Minutes before which and after which sunlight came or went, for edges outside repeated rows."""
    table = pd.read_csv(reference_data("funcube1", "funcube1_2016-02-04_first.csv"))
    minutes = (pd.to_datetime(table.iloc[:, 0]) - pd.Timestamp("2016-02-04")).dt.total_seconds().to_numpy() / 60
    values = table.iloc[:, 1:].to_numpy()
    repeated = np.concatenate([[False], (values[1:] == values[:-1]).all(axis=1)])
    repeated[:-1] |= repeated[1:]
    lit = table["Tot. Photo Curr. mA"].to_numpy() > 140
    change = np.flatnonzero((lit[1:] != lit[:-1]) & ~repeated[1:] & ~repeated[:-1])
    return (minutes[change] + minutes[change + 1]) / 2, lit[change + 1]


@pytest.fixture(scope="module")
def funcube_prediction():
    scene = environment(FUNCUBE)
    start = np.datetime64("2016-02-04T00:00:00", "ns")
    edges = shadow_edges(scene, start, start + np.timedelta64(700, "m"))
    middles = edges[0::2] + (edges[1::2] - edges[0::2]) // 2
    lit = sunlit_share(scene, middles + np.timedelta64(30, "s")) == 1
    return (middles - start) / np.timedelta64(1, "m"), lit


def test_funcube_s_later_eclipses_are_where_the_first_ones_put_them(funcube_edges, funcube_prediction):
    (observed, observed_lit), (predicted, predicted_lit) = funcube_edges, funcube_prediction
    assert len(observed) == 12
    nearest = np.argmin(np.abs(predicted[:, None] - observed), axis=0)
    assert (predicted_lit[nearest] == observed_lit).all()
    error = predicted[nearest] - observed
    assert np.abs(error[:4]).max() < 0.5  # fitted
    assert np.abs(error[4:]).max() < 1.0  # not fitted; samples are a minute apart


def test_funcube_s_eclipse_is_as_long_as_in_telemetry(funcube_edges, funcube_prediction):
    (observed, observed_lit), (predicted, predicted_lit) = funcube_edges, funcube_prediction
    whole = np.flatnonzero(~observed_lit[:-1] & observed_lit[1:])
    durations = observed[whole + 1] - observed[whole]
    durations = durations[durations < 60]
    first = int(np.argmin(predicted_lit))
    expected = predicted[first + 1] - predicted[first]
    assert len(durations) == 5
    assert durations == pytest.approx(expected, abs=1.5)
    assert durations.mean() == pytest.approx(expected, abs=0.5)


def test_funcube_s_node_has_drifted_from_its_launch_s_local_time():
    # Launched into a descending node at about 10:30; by 2018 it had drifted to a dawn-dusk orbit without eclipses.
    raan = environment(FUNCUBE).orbit.raan
    descending = raan_to_local_time(raan, np.datetime64("2016-02-04")) - 12
    assert 8.0 < descending < 10.5


def behind_an_ellipsoid(position, sun, radius, flattening):
    """Whether the line from a place to the Sun's centre meets the Earth, by its quadratic equation."""
    inverse = np.array([1.0, 1.0, 1.0 / (1.0 - flattening)]) / radius
    start, way = position * inverse, (sun - position) * inverse
    a, b, c = (way**2).sum(-1), (start * way).sum(-1), (start**2).sum(-1) - 1.0
    return (b**2 > a * c) & (b < 0.0)


def test_the_shadow_is_that_of_the_earth_that_is_written():
    flattened = environment(circular(raan="65 deg"), earth={"radius": "6400 km", "flattening": 0.03})
    times = seconds_after(EPOCH, np.arange(0.0, 6000.0, 1.0))
    at = geometry_of(flattened)(times)
    behind = behind_an_ellipsoid(at.position, at.sun, 6400e3, 0.03)
    found = sunlit_share(flattened, times) < 0.5
    assert behind.any()
    assert np.flatnonzero(found != behind).size <= 2 * (np.diff(behind.astype(int)) != 0).sum()
    whole = behind_an_ellipsoid(at.position, at.sun, 6378.137e3, 0.0)
    assert np.flatnonzero(whole != behind).size > 10
    edges = shadow_edges(flattened, times[0], times[-1])
    # The Sun's centre sets between the contacts with penumbra and umbra.
    for edge, (first, last) in zip(times[1:][np.diff(behind)], edges.reshape(2, 2), strict=True):
        assert first < edge < last + np.timedelta64(1, "s")
