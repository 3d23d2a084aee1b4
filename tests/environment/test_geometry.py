import numpy as np
import pytest

from flightcal.environment import orbit_phase, orbital_period, sunlit_share
from flightcal.environment.geometry import geometry_of
from flightcal.errors import OrbitError

from .scenes import EPOCH, circular, environment, seconds_after


def test_phase_counts_from_where_the_orbit_is_nearest_to_the_sun_and_wraps():
    # At the equinox that is the ascending node. The Sun moves on by a degree a day.
    scene = environment(circular(argument_of_latitude="0 deg"))
    turns = np.array([0.25, 0.5, 0.999, 1.0005, 7.75])
    phase = orbit_phase(scene, seconds_after(EPOCH, turns * orbital_period(scene)))
    assert phase == pytest.approx(turns % 1.0, abs=1e-3)


@pytest.mark.parametrize("ltan", ["22:30", "09:00"])
@pytest.mark.parametrize("days", [0, 92, 184, 276])
def test_eclipses_of_all_seasons_are_around_the_same_phase(ltan, days):
    scene = environment(circular(ltan=ltan))
    times = seconds_after(EPOCH, days * 86400.0 + np.arange(0.0, orbital_period(scene), 10.0))
    phase, dark = orbit_phase(scene, times), sunlit_share(scene, times) < 0.5
    assert dark.any()
    assert phase[dark].mean() == pytest.approx(0.5, abs=0.005)


@pytest.mark.parametrize("days", [0.0, 120.0])
def test_phase_of_an_eccentric_orbit_is_the_true_anomaly_in_all_seasons(days):
    """By Kepler's equation, which is solved here by halving; the perigee of this inclination stays where it is."""
    elements = {"semi_major_axis": "26560 km", "eccentricity": 0.7, "inclination": "63.4349 deg", "raan": "80 deg"}
    later = str(EPOCH + np.timedelta64(round(days * 86400), "s"))
    scene = environment({**elements, "argument_of_perigee": "270 deg", "mean_anomaly": "0 deg", "epoch": later})
    period = orbital_period(scene)
    for share in (0.05, 0.3, 0.5, 0.8):
        low, high = 0.0, 2.0 * np.pi
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if middle - 0.7 * np.sin(middle) < 2.0 * np.pi * share else (low, middle)
        anomaly = 2.0 * np.arctan2(np.sqrt(1.7) * np.sin(0.5 * low), np.sqrt(0.3) * np.cos(0.5 * low))
        (phase,) = orbit_phase(scene, seconds_after(np.datetime64(later), [share * period]))
        assert phase == pytest.approx(anomaly / (2.0 * np.pi) % 1.0, abs=2e-4)


def test_phase_is_never_one():
    scene = environment(circular(argument_of_latitude="0 deg"))
    noon = 0.0
    for _ in range(4):
        noon -= ((orbit_phase(scene, seconds_after(EPOCH, [noon]))[0] + 0.5) % 1.0 - 0.5) * orbital_period(scene)
    phase = orbit_phase(scene, seconds_after(EPOCH, noon + np.linspace(-1e-6, 1e-6, 2001)))
    assert 0 < (phase < 0.5).sum() < 2001
    assert (phase >= 0).all()
    assert (phase < 1).all()


def test_phase_a_rounding_error_before_the_origin_is_zero():
    scene = environment(period="1e9 s")
    assert orbit_phase(scene, np.array([EPOCH - np.timedelta64(1, "ns")]), origin=EPOCH) == 0


def test_phase_of_an_equatorial_orbit_runs_on():
    scene = environment(circular(inclination="0 deg"))
    phase = orbit_phase(scene, seconds_after(EPOCH, np.linspace(0, 5000, 200)))
    assert (np.diff(np.unwrap(2 * np.pi * phase)) > 0).all()


def test_phase_without_orbit_counts_periods_from_the_first_time_or_the_origin():
    scene = environment(period="100 s")
    times = seconds_after(EPOCH, [50.0, 75.0, 160.0])
    assert orbit_phase(scene, times) == pytest.approx([0, 0.25, 0.1])
    assert orbit_phase(scene, times, origin=EPOCH) == pytest.approx([0.5, 0.75, 0.6])
    assert orbit_phase(scene, times[:0]).shape == (0,)


def test_phase_is_unknown_without_orbit_and_period():
    assert np.isnan(orbit_phase(environment(), seconds_after(EPOCH, [0.0, 1.0]))).tolist() == [True, True]


def test_geometry_without_orbit_is_an_error():
    with pytest.raises(OrbitError, match="found no 'orbit', expected one"):
        geometry_of(environment(period="97 min"))


def test_missing_time_is_an_error():
    with pytest.raises(OrbitError, match="NaT"):
        geometry_of(environment(circular()))(np.array(["NaT"], "datetime64[ns]"))


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_times_may_come_in_any_resolution(unit):
    at = geometry_of(environment(circular()))
    times = seconds_after(EPOCH, [0.0, 3600.0])
    assert at(times.astype(f"datetime64[{unit}]")).position == pytest.approx(at(times).position)
