from datetime import datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from flightcal.environment import orbital_period
from flightcal.environment.orbit import (
    EARTH_MU,
    EARTH_RADIUS,
    eccentric_anomaly,
    local_time_to_raan,
    propagator,
    secular_rates,
)
from flightcal.environment.sun import sun_position
from flightcal.errors import OrbitError
from flightcal.scenario import CircularOrbit

from .scenes import EPOCH, circular, environment, raan_to_local_time, seconds_after

# Vallado et al. (2006), Revisiting Spacetrack Report #3, verification case 00005.
VANGUARD = [
    "1 00005U 58002B   00179.78495062  .00000023  00000-0  28098-4 0  4753",
    "2 00005  34.2682 348.7242 1859667 331.7664  19.3264 10.82419157413667",
]
SUCHAI = (
    [
        "1 42788U 17036Z   17294.87504270  .00002447  00000+0  11293-3 0  9997",
        "2 42788  97.4358 353.1861 0012135 183.8921 176.2222 15.21122995 18354",
    ],
    [
        "1 42788U 17036Z   17302.83466765  .00002476  00000+0  11405-3 0  9996",
        "2 42788  97.4351   1.0434 0012905 156.9044 203.2774 15.21170370 19561",
    ],
)
VANGUARD_EPOCH = np.datetime64("2000-06-27T18:50:19.733568", "ns")


def kepler(eccentricity=0.01, **changes):
    orbit = {
        "semi_major_axis": "7100 km",
        "eccentricity": eccentricity,
        "inclination": "98 deg",
        "raan": "40 deg",
        "argument_of_perigee": "70 deg",
        "mean_anomaly": "20 deg",
        "epoch": str(EPOCH),
        **changes,
    }
    return environment(orbit)


def state(scene, times, folder=None):
    return propagator(scene.orbit, *([folder] if folder else []))(times)


# --- elements -----------------------------------------------------------------------------------------------


def test_circular_orbit_keeps_altitude_and_speed():
    position, velocity = state(environment(circular()), seconds_after(EPOCH, np.arange(0, 6000, 7.0)))
    assert np.linalg.norm(position, axis=1) == pytest.approx(EARTH_RADIUS + 693e3, rel=1e-12)
    assert np.linalg.norm(velocity, axis=1) == pytest.approx(np.sqrt(EARTH_MU / 7071137.0), rel=2e-3)


def test_circular_orbit_starts_at_its_argument_of_latitude():
    orbit = circular(inclination="90 deg", raan="30 deg", argument_of_latitude="90 deg")
    position, velocity = state(environment(orbit), np.array([EPOCH]))
    assert position[0] / 7071137.0 == pytest.approx([0, 0, 1], abs=1e-12)
    assert velocity[0] / np.linalg.norm(velocity) == pytest.approx([-np.cos(np.pi / 6), -0.5, 0], abs=1e-5)


@pytest.mark.parametrize("eccentricity", [0.0, 0.05])
def test_velocity_is_the_derivative_of_the_position(eccentricity):
    scene = kepler(eccentricity)
    at = np.array([0.0, 1000.0, 4321.0])
    (ahead, _), (behind, _) = (state(scene, seconds_after(EPOCH, at + h)) for h in (0.5, -0.5))
    assert state(scene, seconds_after(EPOCH, at))[1] == pytest.approx(ahead - behind, abs=2e-3)


def test_sun_synchronous_node_follows_the_mean_sun():
    orbit = kepler(0.0, semi_major_axis=f"{EARTH_RADIUS + 693e3} m", inclination="98.18 deg").orbit
    # 360 deg a tropical year is what defines Sentinel-1's orbit. J2 squared and J4, left out, take 0.2% off.
    assert np.degrees(secular_rates(orbit)[0]) * 86400 == pytest.approx(0.9856, rel=0.003)


def test_perigee_stands_still_at_the_critical_inclination():
    orbit = kepler(0.1, inclination="63.4349488 deg", semi_major_axis="8000 km").orbit
    assert secular_rates(orbit)[1] == pytest.approx(0, abs=1e-14)


def test_secular_rates_agree_with_sgp4():
    satellite = environment({"tle": VANGUARD})
    axis = 8618.3e3  # m, from the mean motion: SGP4's own semi-major axis
    orbit = kepler(0.1859667, semi_major_axis=f"{axis} m", inclination="34.2682 deg").orbit
    times = seconds_after(VANGUARD_EPOCH, [0.0, 5 * 86400.0])
    momentum = np.cross(*state(satellite, times))
    node = np.unwrap(np.arctan2(momentum[:, 0], -momentum[:, 1]))
    assert np.degrees(node[1] - node[0]) / 5 == pytest.approx(np.degrees(secular_rates(orbit)[0]) * 86400, rel=0.02)


@given(st.floats(-20, 20), st.floats(0, 0.97))
def test_eccentric_anomaly_solves_kepler_s_equation(mean_anomaly, eccentricity):
    anomaly = eccentric_anomaly(np.array([mean_anomaly]), eccentricity)
    left = anomaly - eccentricity * np.sin(anomaly)
    assert np.abs(np.exp(1j * left) - np.exp(1j * mean_anomaly)) < 1e-12


def test_kepler_ellipse_has_its_perigee_apogee_and_energy():
    scene = kepler(0.05, mean_anomaly="0 deg")
    position, velocity = state(scene, seconds_after(EPOCH, np.linspace(0, 6000, 601)))
    distance = np.linalg.norm(position, axis=1)
    assert distance[0] == pytest.approx(7100e3 * 0.95, rel=1e-12)
    assert distance.max() == pytest.approx(7100e3 * 1.05, rel=1e-5)
    # Vis-viva holds to the size of J2's rates: the ellipse drifts.
    speed = np.sqrt(EARTH_MU * (2 / distance - 1 / 7100e3))
    assert np.linalg.norm(velocity, axis=1) == pytest.approx(speed, rel=2e-3)


def test_period_is_the_time_between_ascending_nodes():
    scene = environment(circular(argument_of_latitude="0 deg"))
    period = orbital_period(scene)
    position, velocity = state(scene, seconds_after(EPOCH, [period, 10 * period]))
    assert position[:, 2] == pytest.approx(0, abs=0.05)
    assert (velocity[:, 2] > 0).all()
    assert period == pytest.approx(98.6 * 60, abs=15)  # Sentinel-1: 98.6 min


def test_given_period_comes_before_the_orbit_s():
    assert orbital_period(environment(circular(), period="97 min")) == 97 * 60


def test_without_an_orbit_lengths_are_told_in_days():
    assert orbital_period(environment()) == 86400.0


def test_perigee_inside_the_earth_is_an_error():
    with pytest.raises(ValidationError, match=r"found a perigee \d+ km below the Earth's surface"):
        kepler(0.2)


@pytest.mark.parametrize("both", [{"raan": "1 deg", "ltan": "18:00"}, {"raan": None, "ltan": None}])
def test_circular_orbit_needs_exactly_one_node(both):
    with pytest.raises(ValidationError, match="exactly one of 'ltan'"):
        environment(circular(**both))


# --- local time of the node ---------------------------------------------------------------------------------


def test_node_at_local_noon_has_the_mean_sun_s_right_ascension():
    # Mean longitude of the Sun at J2000.0: 280.4665 deg (Meeus 1998, eq. 25.2), less 0.0057 deg of aberration.
    noon = local_time_to_raan("12:00", np.datetime64("2000-01-01T12:00:00"))
    assert np.degrees(noon) == pytest.approx(280.461, abs=0.02)


def test_node_at_local_noon_keeps_to_the_sun_within_the_equation_of_time():
    times = seconds_after(EPOCH, np.arange(0.0, 366 * 86400.0, 7.3 * 3600))
    noon = np.array([local_time_to_raan("12:00", time) for time in times])
    sun = sun_position(times)
    ahead = np.degrees(np.angle(np.exp(1j * (noon - np.arctan2(sun[:, 1], sun[:, 0])))))
    # Extremes of the equation of time in 2024/25: -14.2 min in February, 16.4 min in November.
    assert ahead.min() == pytest.approx(-14.2 / 4, abs=0.05)
    assert ahead.max() == pytest.approx(16.4 / 4, abs=0.05)


@given(st.integers(0, 23), st.integers(0, 59), st.datetimes(datetime(1970, 1, 1), datetime(2100, 1, 1)))
@settings(max_examples=50)
def test_local_time_and_right_ascension_are_inverse(hours, minutes, epoch):
    raan = local_time_to_raan(f"{hours:02d}:{minutes:02d}", np.datetime64(epoch, "us"))
    found = raan_to_local_time(raan, np.datetime64(epoch, "us"))
    assert np.exp(1j * np.pi * found / 12) == pytest.approx(np.exp(1j * np.pi * (hours + minutes / 60) / 12))


@pytest.mark.parametrize("text", ["noon", "24:00", "18", "18:60", "-1:00"])
def test_local_time_that_is_none_is_an_error(text):
    with pytest.raises(ValidationError, match="expected a local time HH:MM such as 18:00"):
        environment(circular(ltan=text))


# --- two-line elements --------------------------------------------------------------------------------------


def test_sgp4_reproduces_the_published_test_case():
    times = seconds_after(VANGUARD_EPOCH, [0.0, 360 * 60.0])
    position, velocity = state(environment({"tle": VANGUARD}), times)
    published = [
        [7022.46529266, -1400.08296755, 0.03995155],
        [-7154.03120202, -3783.17682504, -3536.19412294],
    ]
    speeds = [[1.893841015, 6.405893759, 4.534807250], [4.741887409, -4.151817765, -2.093935425]]
    # The epoch's Julian date, in one piece, is rounded to 1e-9 day: 0.1 ms or 1 m.
    assert position == pytest.approx(np.array(published) * 1e3, abs=1.0)
    assert velocity == pytest.approx(np.array(speeds) * 1e3, abs=1e-3)


def test_times_are_reached_from_the_nearest_elements():
    # Of SUCHAI-1 (NORAD 42788), eight days apart.
    older, newer = SUCHAI
    times = np.datetime64("2017-10-26T00:00:00") + np.timedelta64(1, "h") * np.arange(-100, 200, 7)
    both, first, second = (state(environment({"tle": lines}), times)[0] for lines in (older + newer, older, newer))
    # Midway is 2017-10-25T20:32.
    late = times > np.datetime64("2017-10-25T20:32:00")
    assert 0 < late.sum() < len(times)
    np.testing.assert_array_equal(both, np.where(late[:, None], second, first))
    np.testing.assert_array_equal(state(environment({"tle": newer + older}), times)[0], both)
    periods = [orbital_period(environment({"tle": lines})) for lines in (older, newer, older + newer)]
    assert periods[2] == pytest.approx(np.mean(periods[:2]), rel=1e-6)


def test_tle_period_is_nodal():
    scene = environment({"tle": VANGUARD})
    # 1440 min / 10.82419157 revolutions is the anomalistic period; the perigee advances 4.2 deg a day.
    anomalistic = 86400 / 10.82419157
    assert orbital_period(scene) == pytest.approx(anomalistic, rel=2e-3)
    assert orbital_period(scene) < anomalistic


@pytest.mark.parametrize(
    ("lines", "found"),
    [
        (["garbage", VANGUARD[1]], "expected 69 that begin with '1 '"),
        ([VANGUARD[0][:40], VANGUARD[1]], "found 40 characters"),
        ([VANGUARD[1], VANGUARD[0]], "expected 69 that begin with '1 '"),
        ([*VANGUARD, VANGUARD[0]], "expected the two lines of a TLE"),
        ([*VANGUARD, VANGUARD[0], VANGUARD[1][:30]], "found 30 characters"),
        ([VANGUARD[0][:-1] + "9", VANGUARD[1]], "checksum"),
        ([VANGUARD[0].replace("00005U", "00006U")[:-1] + "4", VANGUARD[1]], "numbers in lines 1 and 2 do not match"),
    ],
)
def test_broken_two_line_elements_are_an_error(lines, found):
    with pytest.raises(ValidationError, match=found):
        environment({"tle": lines})


def test_old_two_line_elements_are_an_error():
    with pytest.raises(OrbitError, match="found elements 40 days away"):
        state(environment({"tle": VANGUARD}), seconds_after(VANGUARD_EPOCH, [40 * 86400.0]))


# --- position samples ---------------------------------------------------------------------------------------


def write_samples(path, times, values, columns="time,x,y,z"):
    rows = [",".join([str(time), *(f"{x:.6f}" for x in row)]) for time, row in zip(times, values, strict=True)]
    path.write_text("\n".join([columns, *rows]) + "\n")


def sampled(tmp_path, step=60.0, duration=12000.0, **changes):
    times = seconds_after(EPOCH, np.arange(0.0, duration, step))
    position, _ = state(kepler(0.01), times)
    write_samples(tmp_path / "orbit.csv", times, position, **changes)
    return environment({"positions": "orbit.csv"}), times


def test_sampled_positions_are_interpolated_between_samples(tmp_path):
    scene, _ = sampled(tmp_path)
    between = seconds_after(EPOCH, np.arange(330.0, 11000.0, 60.0))
    position, velocity = state(scene, between, tmp_path)
    exact_position, exact_velocity = state(kepler(0.01), between)
    assert position == pytest.approx(exact_position, abs=2.0)
    assert velocity == pytest.approx(exact_velocity, abs=0.1)


@pytest.mark.parametrize(("duration", "tolerance"), [(12000.0, 1e-4), (3000.0, 5e-3)])
def test_sampled_period_is_the_orbit_s(tmp_path, duration, tolerance):
    scene, _ = sampled(tmp_path, duration=duration)
    assert orbital_period(scene, tmp_path) == pytest.approx(orbital_period(kepler(0.01)), rel=tolerance)


def test_times_outside_the_samples_are_an_error(tmp_path):
    scene, _ = sampled(tmp_path)
    with pytest.raises(OrbitError, match=r"orbit\.csv: found samples from 2024-03-20T03:06:00"):
        state(scene, seconds_after(EPOCH, [-1.0, 5.0]), tmp_path)


@pytest.mark.parametrize("step", [700.0, 1800.0])
def test_coarse_samples_are_an_error(tmp_path, step):
    scene, _ = sampled(tmp_path, step=step)
    with pytest.raises(OrbitError, match=rf"found {step:.0f} s without a sample .* a tenth of the period"):
        state(scene, np.array([EPOCH]), tmp_path)


@pytest.mark.parametrize(
    ("lines", "found"),
    [
        ("time,x,y\n2024-01-01T00:00:00,1,2\n", r"found columns .* expected also \['z'\]"),
        ("time,x,y,z\n2024-01-01T00:00:00,7e6,0,0\n", "found 1 samples, expected at least 4"),
        ("time,x,y,z\nnever,7e6,0,0\n", "never"),
        ("time,x,y,z\n" + "2024-01-01T00:00:00,7e6,0,0\n" * 4, "line 3: expected finite numbers and a time after"),
        ("time,x,y,z\n" + "".join(f"2024-01-01T00:0{k}:00,7000,0,0\n" for k in range(4)), "in metres"),
    ],
)
def test_unusable_sample_file_is_an_error(tmp_path, lines, found):
    (tmp_path / "orbit.csv").write_text(lines)
    with pytest.raises(OrbitError, match=found):
        propagator(environment({"positions": "orbit.csv"}).orbit, tmp_path)


def test_missing_sample_file_is_an_error(tmp_path):
    with pytest.raises(OrbitError, match=r"environment\.orbit\.positions: orbit\.csv: .*No such file"):
        propagator(environment({"positions": "orbit.csv"}).orbit, tmp_path)


def with_beta(inclination, beta_angle):
    node = {"beta_angle": f"{beta_angle} deg", "epoch": str(EPOCH)[:19]}
    return CircularOrbit(altitude="500 km", inclination=f"{inclination} deg", **node)


@pytest.mark.parametrize("inclination", [40.0, 98.2])
@pytest.mark.parametrize("beta_angle", [-20.0, 0.0, 25.0])
def test_an_orbit_has_the_beta_angle_that_is_given(inclination, beta_angle):
    times = seconds_after(EPOCH, np.array([0.0]))
    position, velocity = propagator(with_beta(inclination, beta_angle))(times)
    sun, momentum = sun_position(times)[0], np.cross(position, velocity)[0]
    sine = sun @ momentum / np.linalg.norm(sun) / np.linalg.norm(momentum)
    # The node moves while the spacecraft does, by a degree a day: the momentum leans by 1e-5.
    assert np.degrees(np.arcsin(sine)) == pytest.approx(beta_angle, abs=0.1)
    # The node is on the day side.
    assert position[0] @ sun > 0


def test_a_beta_angle_that_no_node_has_is_an_error():
    # At the equinox the Sun is in the equator, from which the plane leans by its inclination.
    with pytest.raises(OrbitError, match=r"beta_angle: found 25 deg, expected -10\.0 to 10\.0 deg"):
        propagator(with_beta(10.0, 25.0))
