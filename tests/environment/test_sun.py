import erfa
import numpy as np
import pytest

from flightcal.environment._time import terrestrial_julian_dates
from flightcal.environment.sun import ASTRONOMICAL_UNIT, OBLIQUITY, solar_flux, sun_position

from .scenes import EPOCH, beta_angle, circular, environment


def angles(position):
    """Right ascension and declination in degrees."""
    x, y, z = position.T
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))


# Astronomical Almanac 2024: times and distances of perihelion and aphelion.
@pytest.mark.parametrize(("time", "distance"), [("2024-01-03T00:39", 0.983307), ("2024-07-05T05:06", 1.016725)])
def test_distance_agrees_with_the_almanac_at_perihelion_and_aphelion(time, distance):
    position = sun_position(np.array([time], "datetime64[ns]"))
    assert np.linalg.norm(position) / ASTRONOMICAL_UNIT == pytest.approx(distance, abs=2e-6)


def test_distance_is_extreme_at_the_almanac_s_perihelion():
    times = np.datetime64("2024-01-03T00:39", "ns") + np.arange(-96, 97) * np.timedelta64(1, "h")
    nearest = times[np.argmin(np.linalg.norm(sun_position(times), axis=1))]
    # The Earth's wobble about the common centre with the Moon moves the minimum: both almanac and epv00 have it.
    assert abs(nearest - np.datetime64("2024-01-03T00:39")) <= np.timedelta64(2, "h")


# Astronomical Almanac 2024: instants at which the Sun's apparent longitude is 0, 90, 180 and 270 degrees.
@pytest.mark.parametrize(
    ("time", "right_ascension", "declination"),
    [
        ("2024-03-20T03:06", 0.0, 0.0),
        ("2024-06-20T20:51", 90.0, 23.4385),
        ("2024-09-22T12:44", 180.0, 0.0),
        ("2024-12-21T09:21", -90.0, -23.4385),
    ],
)
def test_direction_is_of_date_at_equinoxes_and_solstices(time, right_ascension, declination):
    found = angles(sun_position(np.array([time], "datetime64[ns]")))
    # Aberration is left out (0.0057 deg); without precession the direction would be off by 0.3 deg.
    assert (found[0][0] - right_ascension + 180) % 360 - 180 == pytest.approx(0, abs=0.008)
    assert found[1][0] == pytest.approx(declination, abs=0.004)


def test_flux_follows_the_inverse_square_of_the_distance():
    assert solar_flux(np.array([1.0, 2.0]) * ASTRONOMICAL_UNIT, 1361.0) == pytest.approx([1361.0, 340.25])


def test_beta_is_the_declination_for_an_equatorial_orbit():
    solstice = np.array(["2024-06-20T20:51"], "datetime64[ns]")
    orbit = circular(inclination="0 deg", epoch=solstice[0])
    assert np.degrees(beta_angle(environment(orbit), solstice)) == pytest.approx(23.44, abs=0.01)


def test_beta_of_a_dawn_dusk_orbit_at_the_equinox_is_its_polar_tilt_from_ninety_degrees():
    orbit = circular(inclination="98.18 deg", raan="90 deg")
    assert np.degrees(beta_angle(environment(orbit), np.array([EPOCH]))) == pytest.approx(81.82, abs=0.02)


def test_obliquity_is_the_solstice_s_declination():
    assert np.degrees(OBLIQUITY) == pytest.approx(23.4393, abs=1e-4)


def test_between_knots_the_ephemeris_is_met_to_a_decimetre():
    seconds = np.random.default_rng(1).uniform(0.0, 40 * 86400.0, 500)
    times = np.datetime64("2024-03-01T00:00:00", "ns") + np.round(1e9 * seconds).astype("timedelta64[ns]")
    whole, days = terrestrial_julian_dates(times)
    turned = np.einsum("tij,tj->ti", erfa.pnm00b(whole, days), erfa.epv00(whole, days)[0]["p"])
    assert np.abs(sun_position(times) + ASTRONOMICAL_UNIT * turned).max() < 0.1
    assert sun_position(times[:0]).shape == (0, 3)
