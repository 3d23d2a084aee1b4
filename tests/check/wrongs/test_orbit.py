"""Another orbit, or another time of it."""

import numpy as np
import pytest

from flightcal.check.prepared import prepared
from flightcal.check.wrongs.orbit import epochs, misread_angles, orbits, places
from tests import small

from ..cases import boxed, named, pointed, spoilt, sunlit


def test_another_inclination_is_named(tmp_path):
    written = sunlit()
    _, data = small.closed_loop(tmp_path, written)
    written["environment"]["orbit"]["inclination"] = "20 deg"
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert first.kind == "orbit"
    assert first.title == f"The orbit has another {first.about}"


def test_altitudes_that_are_off_by_kilometres_are_tried(tmp_path):
    """In a day of orbits the period tells them."""
    written = sunlit()
    view = prepared(*small.closed_loop(tmp_path, written))
    height = float(written["environment"]["orbit"]["altitude"].split()[0])
    tried = [wrong for wrong in orbits(view) if wrong.about == "altitude"]
    shares = np.array([float(wrong.words.sentence.split(" altitude ")[1].split()[0]) for wrong in tried]) / height - 1.0
    for share in (-0.05, -0.015, 0.013, 0.03):
        assert np.abs(shares - share).min() < 0.011, shares
    nearer = [wrong.words.sentence for wrong in tried[int(np.abs(shares - 0.01).argmin())].closer()]
    assert any(f"altitude {1.013 * height:.0f} km" in sentence for sentence in nearer), nearer


@pytest.mark.parametrize("elements", ["of a circle", pytest.param("two lines", marks=pytest.mark.slow)])
def test_another_place_in_the_orbit_is_told_where_attitudes_come_at_times_of_their_own(tmp_path, elements):
    written = boxed()
    written["environment"]["attitude"] = pointed((0.5, 0.1, 0.7, 0.5))
    if elements == "two lines":
        written["environment"]["orbit"] = {"tle": list(LINES)}
    _, data = small.closed_loop(tmp_path, written)
    orbit = written["environment"]["orbit"]
    if elements == "two lines":
        orbit["tle"][1] = checked(LINES[1].replace("300.0000 14.9", " 60.0000 14.9"))
    else:
        orbit["argument_of_latitude"] = "120 deg"
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert (
        first.title == f"The orbit has another {'mean anomaly' if elements == 'two lines' else 'argument of latitude'}"
    )


@pytest.mark.parametrize(("elements", "epoch", "how"), [
    ("of a circle", "2024-02-29T00:00:00", "1 day later"), ("of a circle", "2024-02-20T00:00:00", "10 days later"),
    ("of a circle", "2023-03-02T00:00:00", "a year later"),
    ("two lines", "", "1 day later"),
])  # fmt: skip
def test_an_epoch_that_is_days_or_a_year_off_is_tried(tmp_path, elements, epoch, how):
    written = boxed()
    if elements == "two lines":
        written["environment"]["orbit"] = {"tle": list(LINES)}
    scenario, data = small.closed_loop(tmp_path, written)
    right, orbit = prepared(scenario, data), written["environment"]["orbit"]
    if elements == "two lines":
        orbit["tle"][0] = checked(LINES[0].replace("24061.", "24060."))
    else:
        orbit["epoch"] = epoch
    scenario, _ = small.load(tmp_path, written)
    view = prepared(scenario, data)
    (wrong,) = [tried for tried in epochs(view) if f"epoch {how}" in tried.words.sentence]
    assert (wrong.kind, wrong.about) == ("orbit", "epoch")
    expected = right.simulated(right.window, right.middle)
    apart = [np.abs(view.simulated(window, right.middle) - expected).max() for window in (wrong.window, view.window)]
    assert apart[0] < 0.3 < 2.0 < apart[1]


@pytest.mark.slow
def test_an_orbits_radius_that_is_written_as_its_altitude_is_named(tmp_path):
    written = boxed()
    _, data = small.closed_loop(tmp_path, written)
    written["environment"]["orbit"]["altitude"] = "6978 km"
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert (first.kind, first.about) == ("orbit", "altitude")
    assert "600 km" in first.sentence


def test_a_node_that_is_a_degree_off_is_tried(tmp_path):
    """In an orbit over the terminator eclipses tell as little."""
    view = prepared(*small.closed_loop(tmp_path, sunlit()))
    tried = " ".join(wrong.words.sentence for wrong in orbits(view) if wrong.about == "ltan")
    assert all(f"ltan {time}:" in tried for time in ("11:52", "11:56", "12:04", "12:08", "13:00"))


@pytest.mark.slow
def test_an_eclipse_that_never_comes_is_named(tmp_path):
    written = sunlit()
    written["simulator"]["faces"]["outside"]["normal"] = [1, 0, 0]
    _, data = small.closed_loop(tmp_path, written)
    written["telemetry"]["channels"]["shadow"] = {"column": "heater", "kind": "status"}
    written["environment"]["eclipse"] = {"measured_by": "shadow"}
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, spoilt(data, shadow=np.zeros(data.sizes["time"])))[0]
    assert (first.kind, first.about) == ("eclipse", "shadow")


def flown_on_an_ellipse(folder, written, **elements):
    """Its orbit, to be changed, and the telemetry of a flight on it."""
    orbit = {
        "semi_major_axis": "7300 km", "eccentricity": 0.01, "inclination": "97.8 deg", "raan": "340 deg",
        "argument_of_perigee": "0 deg", "mean_anomaly": "0 deg", "epoch": "2024-03-01T00:00:00",
    } | elements  # fmt: skip
    written["environment"]["orbit"] = orbit
    return orbit, small.closed_loop(folder, written)[1]


@pytest.mark.slow
def test_the_height_of_an_elliptic_orbit_is_named(tmp_path):
    written = sunlit()
    orbit, data = flown_on_an_ellipse(tmp_path, written)
    orbit["semi_major_axis"] = "6800 km"
    scenario, _ = small.load(tmp_path, written)
    assert "orbit" in {suspicion.kind for suspicion in named(scenario, data)}


@pytest.mark.slow
def test_the_place_in_an_ellipse_is_named(tmp_path):
    written = boxed()
    elements = {"semi_major_axis": "8500 km", "eccentricity": 0.2, "inclination": "60 deg"}
    orbit, data = flown_on_an_ellipse(tmp_path, written, **elements, argument_of_perigee="90 deg")
    orbit["mean_anomaly"] = "120 deg"
    scenario, _ = small.load(tmp_path, written)
    # Without modes a late clock is as good.
    assert "The orbit has another mean anomaly" in [suspicion.title for suspicion in named(scenario, data)]


@pytest.mark.slow
def test_an_eccentricity_with_a_slip_of_the_point_is_named(tmp_path):
    written = boxed()
    elements = {"semi_major_axis": "13000 km", "eccentricity": 0.45, "inclination": "60 deg"}
    orbit, data = flown_on_an_ellipse(tmp_path, written, **elements, argument_of_perigee="90 deg")
    orbit["eccentricity"] = 0.045
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert first.title == "The orbit has another eccentricity"
    assert float(first.sentence.split("eccentricity ")[1].split(":")[0]) == pytest.approx(0.45, abs=0.02)


LINES = (
    "1 58001U 24010A   24061.00000000  .00000000  00000-0  00000-0 0    07",
    "2 58001  97.8000 340.0000 0010000  60.0000 300.0000 14.90000000    01",
)


@pytest.mark.parametrize(
    ("place", "text", "title"),
    [
        pytest.param(slice(17, 25), " 40.0000", "The orbit has another raan", marks=pytest.mark.slow),
        pytest.param(slice(8, 16), " 51.6000", "The orbit has another inclination", marks=pytest.mark.slow),
        pytest.param(slice(52, 63), "14.20000000", "The orbit has another mean motion", marks=pytest.mark.slow),
    ],
)
def test_two_line_elements_of_another_orbit_are_named_by_what_differs(tmp_path, place, text, title):
    written = boxed()
    written["environment"]["orbit"] = {"tle": list(LINES)}
    _, data = small.closed_loop(tmp_path, written)
    written["environment"]["orbit"]["tle"][1] = checked(LINES[1][: place.start] + text + LINES[1][place.stop :])
    scenario, _ = small.load(tmp_path, written)
    assert title in [suspicion.title for suspicion in named(scenario, data)]


def checked(line):
    """A line of two-line elements with the checksum that it should have."""
    return line[:68] + str(
        sum(int(character) if character.isdigit() else character == "-" for character in line[:68]) % 10
    )


def test_angles_of_an_orbit_that_are_exchanged_or_of_another_kind_are_tried(tmp_path):
    written = boxed()
    elements = {"semi_major_axis": "13000 km", "eccentricity": 0.4, "inclination": "60 deg"}
    _, data = flown_on_an_ellipse(tmp_path, written, **elements, argument_of_perigee="200 deg", mean_anomaly="20 deg")
    view = prepared(small.load(tmp_path, written)[0], data)
    tried = {wrong.words.title: wrong.words.sentence for wrong in misread_angles(view)}
    assert (
        "With raan: 200 deg and argument_of_perigee: 340 deg"
        in tried["raan and argument_of_perigee of the orbit are exchanged"]
    )
    # No inclination is beyond 180 deg.
    assert "inclination and raan of the orbit are exchanged" not in tried
    # By Kepler's equation, in numbers: tan(E / 2) = sqrt(0.6 / 1.4) tan(10 deg), M = E - 0.4 sin E.
    assert "mean_anomaly: 7.948 deg," in tried["The mean_anomaly of the orbit is its true anomaly"]


@pytest.mark.slow
def test_angles_of_an_orbit_that_are_exchanged_are_named(tmp_path):
    written = boxed()
    elements = {"semi_major_axis": "13000 km", "eccentricity": 0.4, "inclination": "60 deg"}
    orbit, data = flown_on_an_ellipse(
        tmp_path, written, **elements, argument_of_perigee="200 deg", mean_anomaly="20 deg"
    )
    orbit["raan"], orbit["argument_of_perigee"] = orbit["argument_of_perigee"], orbit["raan"]
    scenario, _ = small.load(tmp_path, written)
    assert named(scenario, data)[0].title == "raan and argument_of_perigee of the orbit are exchanged"


@pytest.mark.parametrize(("late", "zone"), [(10_790.0, "; about 3 h may also be a time zone"), (9_000.0, "")])
def test_another_place_names_the_keys_of_its_orbit_and_a_time_zone(tmp_path, late, zone):
    written = boxed()
    written["simulator"]["modes"] = {"idle": {"body": "1 W"}}
    written["simulator"]["timeline"] = [{"at": "2024-02-29T12:00:00", "mode": "idle"}]
    _, data = flown_on_an_ellipse(tmp_path, written)
    (wrong,) = places(prepared(small.load(tmp_path, written)[0], data), [late])
    expected = f"Check 'epoch' and 'mean_anomaly' in 'environment: orbit'{zone}"
    assert wrong.words.advice.removesuffix(" of the telemetry and the timeline") == expected


@pytest.mark.parametrize(("inclination", "told"), [("0.05 deg", True), ("30 deg", False)])
def test_near_the_equator_a_node_is_told_with_the_angles_in_the_plane(tmp_path, inclination, told):
    written = boxed()
    written["environment"]["orbit"] = {
        "altitude": "600 km", "inclination": inclination, "raan": "10 deg", "epoch": "2024-03-01T00:00:00"
    }  # fmt: skip
    view = prepared(*small.closed_loop(tmp_path, written))
    node = next(wrong for wrong in orbits(view) if wrong.about == "raan")
    assert ("and the other angles in its plane" in node.words.advice) == told
