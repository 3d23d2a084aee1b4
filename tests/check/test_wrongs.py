"""Wrongs of sensors, of what lights the faces and of what is left out, named before any sampling."""

from types import SimpleNamespace

import numpy as np
import pytest

from flightcal.check import suspects, wrongs
from flightcal.check.evidence import climbed
from flightcal.check.prepared import prepared
from flightcal.check.sunlight import FINE
from flightcal.check.wrongs.channels import swaps
from flightcal.check.wrongs.clocks import channel_clocks, clocks, status_clocks
from flightcal.check.wrongs.heat import constant_heat, missing_heat, shares
from flightcal.check.wrongs.heaters import heaters
from flightcal.check.wrongs.orbit import epochs, orbits
from flightcal.check.wrongs.written import exchanged, numbers
from flightcal.problem import build_problem
from flightcal.simulator import SimulationFailure
from tests import small

from .test_suspects import named, spoilt, sunlit


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A scenario and the telemetry of its own model."""
    return small.closed_loop(tmp_path_factory.mktemp("flown"))


def followed(values, minutes):
    """What a sensor reads that follows values [T], a minute apart, with a lag."""
    read = np.array(values)
    for k in range(1, len(read)):
        read[k] = read[k - 1] + (values[k] - read[k - 1]) * (1.0 - np.exp(-1.0 / minutes))
    return read


def test_a_slow_sensor_is_named_with_its_lag(flown):
    scenario, data = flown
    slow = spoilt(data, panel_temp=followed(data["panel_temp"].values, 12.0))
    first = named(scenario, slow)[0]
    assert (first.kind, first.about) == ("slow", "panel_temp")
    assert "lag" in first.title
    assert float(first.title.split()[-2]) == pytest.approx(12.0, rel=0.3)


def test_where_a_slow_sensors_node_begins_is_not_what_its_first_sample_says(flown):
    """The sensor was 30 K warmer than its panel when the window began."""
    scenario, data = flown
    left = 30.0 * np.exp(-np.arange(data.sizes["time"]) / 12.0)
    first = named(scenario, spoilt(data, panel_temp=followed(data["panel_temp"].values, 12.0) + left))[0]
    assert (first.kind, first.about) == ("slow", "panel_temp")
    assert float(first.title.split()[-2]) == pytest.approx(12.0, rel=0.2)


def test_a_slow_sensor_that_the_scenario_knows_of_is_no_wrong(flown):
    scenario, data = flown
    slow = spoilt(data, panel_temp=followed(data["panel_temp"].values, 12.0))
    known = scenario.observations["panel_temp"].model_copy(update={"lag": 720.0})
    observations = {**scenario.observations, "panel_temp": known}
    assert named(scenario.model_copy(update={"observations": observations}), slow) == ()


def test_a_slow_sensor_of_a_thermostat_explains_that_it_is_disobeyed(flown):
    scenario, data = flown
    slow = spoilt(data, body_temp=followed(data["body_temp"].values, 20.0))
    assert "thermostat" not in {own.kind for own in named(scenario, slow)}


def test_a_smoothed_channel_is_named_with_the_time(flown):
    scenario, data = flown
    smooth = np.convolve(np.pad(data["panel_temp"].values, 20, mode="edge"), np.ones(41) / 41.0, mode="valid")
    first = named(scenario, spoilt(data, panel_temp=smooth))[0]
    assert (first.kind, first.about) == ("slow", "panel_temp")
    assert "smoothed" in first.title
    assert float(first.title.split()[-2]) == pytest.approx(41.0, rel=0.3)


def test_what_means_hold_from_beyond_the_window_is_not_known(flown):
    """The same means, of a panel that was much colder before the window and much warmer after it."""
    scenario, data = flown
    panel = data["panel_temp"].values
    around = np.concatenate([np.full(20, panel[0] - 20.0), panel, np.full(20, panel[-1] + 20.0)])
    first = named(scenario, spoilt(data, panel_temp=np.convolve(around, np.ones(41) / 41.0, mode="valid")))[0]
    assert (first.kind, first.about) == ("slow", "panel_temp")
    assert "smoothed" in first.title


def test_the_curve_of_another_sensor_is_named(tmp_path):
    scenario, data = small.closed_loop(tmp_path, sunlit())
    read = data["panel_temp"].values
    middle, half = 0.5 * (read.max() + read.min()), 0.5 * np.ptp(read)
    first = named(scenario, spoilt(data, panel_temp=read + 6.0 * ((read - middle) / half) ** 2))[0]
    assert (first.kind, first.about) == ("curve", "panel_temp")


def test_a_mean_of_two_sensors_is_between_them(flown):
    scenario, data = flown
    mean = 0.5 * (data["body_temp"].values + data["panel_temp"].values)
    first = named(scenario, spoilt(data, panel_temp=mean))[0]
    assert (first.kind, first.about) == ("between", "panel_temp")
    assert 0.4 < float(first.sentence.split("%")[0].split()[-1]) / 100.0 < 0.6


def two_faced():
    """The satellite with two faces that look along other axes."""
    written = sunlit()
    looks = {"area": "0.03 m^2", "normal": [1, 0, 0], "absorptivity": 0.5, "emissivity": 0.7}
    written["simulator"]["faces"]["ahead"] = {"node": "body", **looks}
    return written


def test_nadir_and_zenith_confused_are_the_bodys_axes(tmp_path):
    written = two_faced()
    _, data = small.closed_loop(tmp_path, written)
    for face in written["simulator"]["faces"].values():
        face["normal"] = [-axis for axis in face["normal"]]
    scenario, right = small.load(tmp_path, written)
    assert right.sizes == data.sizes
    assert named(scenario, data)[0].title == "The body's axes are others"


def boxed():
    """The satellite with a face on each side, of two nodes."""
    written = two_faced()
    looks = {"absorptivity": 0.5, "emissivity": 0.7}
    for name, node, normal in (
        ("back", "panel", [-1, 0, 0]),
        ("left", "panel", [0, 1, 0]),
        ("down", "body", [0, 0, 1]),
    ):
        written["simulator"]["faces"][name] = {"node": node, "area": "0.04 m^2", "normal": normal, **looks}
    return written


def test_a_tilted_body_is_named_with_about_its_angle(tmp_path):
    written = boxed()
    scenario, _ = small.load(tmp_path, written)
    for face in written["simulator"]["faces"].values():
        x, y, z = face["normal"]
        c, s = np.cos(np.deg2rad(35.0)), np.sin(np.deg2rad(35.0))
        face["normal"] = [x, float(c * y - s * z), float(s * y + c * z)]
    _, data = small.closed_loop(tmp_path, written)
    first = named(scenario, data)[0]
    assert (first.kind, first.about) == ("attitude", "tilt")
    assert float(first.title.split(" by ")[1].split()[0]) == pytest.approx(35.0, abs=12.0)


def test_two_faces_that_are_exchanged_are_named(tmp_path):
    written = boxed()
    scenario, _ = small.load(tmp_path, written)
    faces = written["simulator"]["faces"]
    faces["ahead"]["normal"], faces["outside"]["normal"] = faces["outside"]["normal"], faces["ahead"]["normal"]
    _, data = small.closed_loop(tmp_path, written)
    first = named(scenario, data)[0]
    assert first.title == "Faces outside and ahead are exchanged"


def test_a_panel_that_was_not_deployed_is_named_by_both_of_its_sides(tmp_path):
    written = boxed()
    faces = written["simulator"]["faces"]
    cells = {"node": "panel", "area": "0.08 m^2", "absorptivity": 0.8, "emissivity": 0.8}
    faces["cells"], faces["behind"] = cells | {"normal": [0, -1, 0]}, cells | {"normal": [0, 1, 0], "absorptivity": 0.2}
    del faces["outside"], faces["left"]
    scenario, _ = small.load(tmp_path, written)
    faces["cells"]["normal"], faces["behind"]["normal"] = [0, 0, -1], [0, 0, 1]
    _, data = small.closed_loop(tmp_path, written)
    first = named(scenario, data)[0]
    assert first.title == "Faces cells and behind look another way"


def test_coatings_that_are_exchanged_on_every_face_are_named(tmp_path):
    written = boxed()
    scenario, _ = small.load(tmp_path, written)
    for face in written["simulator"]["faces"].values():
        face["absorptivity"], face["emissivity"] = face["emissivity"], face["absorptivity"]
    _, data = small.closed_loop(tmp_path, written)
    first = named(scenario, data)[0]
    assert (first.kind, first.about) == ("number", "every coating")


def pointed(quaternion):
    """Three attitudes, one after another, that differ from this one by turns."""
    w, x, y, z = quaternion
    named = {
        "one": {"inertial": [w, x, y, z]},
        "other": {"inertial": [-x, w, -z, y]},
        "third": {"inertial": [y, z, -w, -x]},
    }
    at = ["2024-03-01T00:00:00", "2024-03-01T01:10:00", "2024-03-01T02:20:00"]
    return {"named": named, "timeline": [{"at": own, "attitude": name} for own, name in zip(at, named, strict=True)]}


@pytest.mark.parametrize("read", [lambda w, x, y, z: (w, -x, -y, -z), lambda w, x, y, z: (x, y, z, w)])
def test_quaternions_of_another_convention_are_named(tmp_path, read):
    written, true = boxed(), (0.5, 0.1, 0.7, 0.5)
    written["environment"]["attitude"] = pointed(true)
    _, data = small.closed_loop(tmp_path, written)
    for own in written["environment"]["attitude"]["named"].values():
        own["inertial"] = list(read(*own["inertial"]))
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert (first.kind, first.about) == ("attitude", "quaternions")


def test_a_timeline_of_attitudes_that_is_late_is_named_with_the_minutes(tmp_path):
    written = boxed()
    written["environment"]["attitude"] = pointed((0.5, 0.1, 0.7, 0.5))
    scenario, data = small.closed_loop(tmp_path, written)
    assert named(scenario, data) == ()
    for own, at in zip(written["environment"]["attitude"]["timeline"], ("00:17", "01:27", "02:37"), strict=True):
        own["at"] = f"2024-03-01T{at}:00"
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert (first.kind, first.about) == ("attitude", "timeline")
    assert float(first.title.split()[-3]) == pytest.approx(17.0, abs=2.0)
    assert first.title.endswith("late")


def test_attitudes_that_are_exchanged_are_named(tmp_path):
    written = boxed()
    written["environment"]["attitude"] = pointed((0.5, 0.1, 0.7, 0.5))
    _, data = small.closed_loop(tmp_path, written)
    attitudes = written["environment"]["attitude"]["named"]
    attitudes["one"], attitudes["other"] = attitudes["other"], attitudes["one"]
    scenario, _ = small.load(tmp_path, written)
    assert named(scenario, data)[0].title == "Attitudes 'one' and 'other' are exchanged"


@pytest.mark.parametrize("elements", ["of a circle", "two lines"])
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


@pytest.mark.parametrize("elements", ["of a circle", "two lines"])
def test_an_epoch_that_is_a_day_off_is_tried(tmp_path, elements):
    written = boxed()
    if elements == "two lines":
        written["environment"]["orbit"] = {"tle": list(LINES)}
    scenario, data = small.closed_loop(tmp_path, written)
    right, orbit = prepared(scenario, data), written["environment"]["orbit"]
    if elements == "two lines":
        orbit["tle"][0] = checked(LINES[0].replace("24061.", "24060."))
    else:
        orbit["epoch"] = "2024-02-29T00:00:00"
    scenario, _ = small.load(tmp_path, written)
    view = prepared(scenario, data)
    (wrong,) = [own for own in epochs(view) if "epoch 1 day later" in own.words.sentence]
    assert (wrong.kind, wrong.about) == ("orbit", "epoch")
    expected = right.simulated(right.window, right.middle)
    apart = [np.abs(view.simulated(own, right.middle) - expected).max() for own in (wrong.window, view.window)]
    assert apart[0] < 0.3 < 2.0 < apart[1]


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
    tried = " ".join(own.words.sentence for own in orbits(view) if own.about == "ltan")
    assert all(f"ltan {time}:" in tried for time in ("11:52", "11:56", "12:04", "12:08", "13:00"))


def test_sunlight_is_looked_up_where_a_shadow_begins_and_ends(tmp_path):
    view = prepared(*small.closed_loop(tmp_path, sunlit()))
    seconds = view.sunlight.times(view.window.scenario, 0.0, 10800.0)
    assert np.diff(seconds).max() == FINE
    assert 4 <= (seconds % FINE > 0.0).sum() <= 16


def test_a_heater_that_has_lost_a_string_is_named_with_the_time(tmp_path):
    scenario, data = small.closed_loop(tmp_path)
    simulator = small.simulator_of(scenario, data)
    # From 01:10 on half of its heat is lacking.
    view = prepared(scenario, data)
    on = np.repeat(view.network.drive.measured[:, 0] * (view.network.drive.times[:-1] >= 4200.0), 2)
    heat = np.zeros((len(view.network.network.heated), len(on)))
    heat[view.network.network.heated.index("body")] = -14.0 * on
    window = view.simulated_by(drive=view.network.with_heat(heat).drive)
    theta = view.problem.at(view.window, view.problem.to_theta(view.middle))[view.window.simulated]
    for name, value in small.TRUTH.items():
        place = view.network.parameters.index(name.replace("_", ".", 1) if name.startswith("initial") else name)
        theta[place] = value
    read = window.network.simulate(theta).temperatures
    noise = 0.1 * np.random.default_rng(2).standard_normal(read.shape)
    inside = np.isin(data["time"].values, view.window.times)
    weak = data.copy(deep=True)
    for k, channel in enumerate(simulator.channels):
        weak[channel].values[inside] = (read + noise)[:, k]
    (first,) = [own for own in named(scenario, weak) if own.kind == "heater"]
    assert first.about == "heater from a time on"
    assert 0.3 < float(first.title.split(" has ")[1].split()[0]) < 0.7
    hour, minute = map(int, first.title.split("T")[1].split()[0].split(":"))
    assert 60 * hour + minute == pytest.approx(70.0, abs=15.0)


def test_a_step_has_that_share_of_a_wave_that_is_in_it():
    states = np.array([0.0, 1.0, 1.0, 0.0])
    grid = np.array([0.0, 50.0, 100.0, 100.0, 400.0])
    np.testing.assert_allclose(shares(np.array([0.0, 80.0, 160.0, 200.0]), states, grid), [0.0, 0.4, 0.0, 1.0 / 3.0])


def test_heat_whose_times_a_status_tells_is_likelier_than_heat_whose_times_the_temperatures_tell(flown):
    scenario, data = flown
    heater = scenario.simulator.heaters["heater"].model_copy(update={"measured_by": None})
    simulator = scenario.simulator.model_copy(update={"heaters": {}})
    assert heater.node == "body"
    observations = {name: own for name, own in scenario.observations.items() if own.heater is None}
    update = {"simulator": simulator, "observations": observations, "parameters": {}}
    view = prepared(scenario.model_copy(update=update), data)
    odds = {bool("heater_status" in own.words(SimpleNamespace(added=[1.0])).sentence): own.odds
            for own in missing_heat(view) if own.about == "body"}  # fmt: skip
    assert odds[False] > odds[True] + 2.0


def test_all_heaters_are_tried_together(tmp_path):
    written = small.content()
    blocks = written["simulator"]["heaters"]
    blocks["second"] = blocks["heater"] | {"node": "panel", "power": "10 W"}
    del written["parameters"]["power"]
    view = prepared(*small.closed_loop(tmp_path, written))
    powers = [view.network.network.paths.index(f"heaters.{name}.power") for name in ("heater", "second")]
    together = [own for own in heaters(view) if own.about == "every heater"]
    assert [own.window.network.mapping.written[powers].tolist() for own in together] == [
        [30.0 * factor, 10.0 * factor] for factor in (0.25, 0.5, 2.0, 4.0)
    ]


def of_three():
    """The satellite with a second sensor of its panel, each of another packet than the body's."""
    written = sunlit()
    written["telemetry"]["channels"]["other_temp"] = {"column": "panel", "unit": "degC", "kind": "temperature"}
    written["observations"]["other_temp"] = {"node": "panel"}
    return written


def test_columns_are_tried_as_shifted_by_one(tmp_path):
    view = prepared(*small.closed_loop(tmp_path, of_three()))
    shifted = [own.observed for own in swaps(view) if own.words.title == "Every channel is its neighbour's"]
    assert len(shifted) == 2
    for k, by in enumerate((1, -1)):
        np.testing.assert_array_equal(shifted[k], view.observed[:, [by % 3, (1 + by) % 3, (2 + by) % 3]])


def test_any_three_of_more_channels_are_tried_as_each_others_both_ways():
    truth = np.array([[1.0, 2.0, 3.0, 4.0]])
    view = SimpleNamespace(channels=("a", "b", "c", "d"), observed=truth[:, [2, 0, 1, 3]])
    turned = [own for own in swaps(view) if own.words.title.endswith("are each other's")]
    assert len({tuple(own.observed[0]) for own in turned}) == len(turned) == 8
    (right,) = [own for own in turned if (own.observed == truth).all()]
    assert right.words.sentence.startswith("With the readings of b for a, of c for b and of a for c")


def in_packets(scenario, packets):
    """The scenario with channels in packets."""
    channels = {
        name: own.model_copy(update={"packet": packets.get(name)}) for name, own in scenario.telemetry.channels.items()
    }
    return scenario.model_copy(update={"telemetry": scenario.telemetry.model_copy(update={"channels": channels})})


def test_a_packet_of_another_time_zone_is_named(tmp_path):
    scenario, data = small.closed_loop(tmp_path, of_three())
    late = {name: np.roll(data[name].values, 60) for name in ("panel_temp", "other_temp")}
    packets = {"body_temp": "bus", "panel_temp": "outside", "other_temp": "outside"}
    first = named(in_packets(scenario, packets), spoilt(data, **late))[0]
    assert first.kind == "channel clock"
    assert first.title.startswith("packet outside is ")
    assert float(first.title.split()[3]) == pytest.approx(60.0, abs=5.0)


def test_the_packet_of_all_temperatures_is_late_beside_status_and_drivers(flown):
    scenario, data = flown
    split = in_packets(scenario, {"body_temp": "tcs", "panel_temp": "tcs", "heater_status": "eps", "sun": "eps"})
    early = {name: np.roll(data[name].values, -12) for name in ("heater_status", "sun")}
    titles = {own.about: own.title.split() for own in named(split, spoilt(data, **early))}
    title = titles["body_temp panel_temp"]
    assert title[1] == "tcs"
    assert title[5] == "late"
    assert float(title[3]) == pytest.approx(12.0, abs=2.0)


def test_a_driver_that_is_late_is_named_with_the_minutes(flown):
    scenario, data = flown
    first = named(scenario, spoilt(data, sun=np.roll(data["sun"].values, 15)))[0]
    assert (first.kind, first.about) == ("driver clock", "sun")
    assert first.title.endswith("late")
    assert float(first.title.split()[4]) == pytest.approx(15.0, abs=1.0)


@pytest.mark.parametrize(("name", "value"), [("direction", [1, 0, 0]), ("period", "20 min")])
def test_a_spin_that_is_another_is_named_by_what_is_written(tmp_path, name, value):
    written = boxed()
    written["environment"]["attitude"] = {"spin_axis": [0, 0, 1], "direction": [0, 0, 1], "period": "40 min"}
    scenario, _ = small.load(tmp_path, written)
    written["environment"]["attitude"][name] = value
    _, data = small.closed_loop(tmp_path, written)
    first = named(scenario, data)[0]
    assert (first.kind, first.about) == ("attitude", name)


@pytest.mark.parametrize("left_out", [{"earth_infrared": 0}, {"earth_infrared": 0, "albedo": 0}])
def test_heat_from_the_earth_that_is_left_out_is_named(tmp_path, left_out):
    written = sunlit()
    written["simulator"]["faces"]["outside"] |= {"normal": [0, 0, 1], "area": "0.3 m^2"}
    _, data = small.closed_loop(tmp_path, written)
    units = {"earth_infrared": " W/m^2", "albedo": ""}
    written["environment"] |= {name: f"0{units[name]}" if units[name] else 0 for name in left_out}
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert first.kind == "number"
    assert "environment.earth_infrared" in first.title
    assert "zero" in first.title


def test_an_eclipse_that_never_comes_is_named(tmp_path):
    written = sunlit()
    written["simulator"]["faces"]["outside"]["normal"] = [1, 0, 0]
    _, data = small.closed_loop(tmp_path, written)
    written["telemetry"]["channels"]["shadow"] = {"column": "heater", "kind": "status"}
    written["environment"]["eclipse"] = {"measured_by": "shadow"}
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, spoilt(data, shadow=np.zeros(data.sizes["time"])))[0]
    assert (first.kind, first.about) == ("eclipse", "shadow")


def test_a_driver_of_another_unit_is_named_by_how_many_times(flown):
    scenario, data = flown
    first = named(scenario, spoilt(data, sun=data["sun"] / 6.0))[0]
    assert (first.kind, first.about) == ("driver", "sun")
    assert float(first.title.split(" is ")[1].split()[0]) == pytest.approx(6.0, rel=0.2)


def test_a_driver_with_several_times_the_heat_is_named_by_how_many_times(flown):
    scenario, data = flown
    first = named(scenario, spoilt(data, sun=4.0 * data["sun"]))[0]
    assert (first.kind, first.about) == ("driver", "sun")
    assert float(first.title.split(" is ")[1].split()[0]) == pytest.approx(0.25, rel=0.05)


def test_samples_that_are_lost_are_named_before_anything_else(flown):
    """Later samples are tagged as if they followed at once: both channels jump."""
    scenario, data = flown
    values = {name: data[name].values.copy() for name in ("body_temp", "panel_temp")}
    for name, own in values.items():
        own[90:-40] = data[name].values[130:]
    found = suspects(build_problem(scenario, spoilt(data, **values)), spoilt(data, **values)).found
    assert [(own.kind, own.about) for own in found] == [("order", "time")]


def test_the_height_of_an_elliptic_orbit_is_named(tmp_path):
    written = sunlit()
    orbit = {
        "semi_major_axis": "7300 km", "eccentricity": 0.01, "inclination": "97.8 deg", "raan": "340 deg",
        "argument_of_perigee": "0 deg", "mean_anomaly": "0 deg", "epoch": "2024-03-01T00:00:00",
    }  # fmt: skip
    written["environment"]["orbit"] = orbit
    _, data = small.closed_loop(tmp_path, written)
    orbit["semi_major_axis"] = "6800 km"
    scenario, _ = small.load(tmp_path, written)
    assert "orbit" in {own.kind for own in named(scenario, data)}


def test_the_place_in_an_ellipse_is_named(tmp_path):
    written = boxed()
    orbit = {
        "semi_major_axis": "8500 km", "eccentricity": 0.2, "inclination": "60 deg", "raan": "340 deg",
        "argument_of_perigee": "90 deg", "mean_anomaly": "0 deg", "epoch": "2024-03-01T00:00:00",
    }  # fmt: skip
    written["environment"]["orbit"] = orbit
    _, data = small.closed_loop(tmp_path, written)
    orbit["mean_anomaly"] = "120 deg"
    scenario, _ = small.load(tmp_path, written)
    # Without modes a late clock is as good.
    assert "The orbit has another mean anomaly" in [own.title for own in named(scenario, data)]


def test_a_number_of_the_sun_is_not_mended_by_one_that_cannot_be(tmp_path):
    view = prepared(*small.closed_loop(tmp_path, sunlit()))
    tried = {own.about for own in numbers(view)}
    assert "environment.solar_constant" not in tried
    assert "faces.outside.area" in tried


def test_heat_that_is_missing_all_the_time_is_tried_at_every_node(flown):
    view = prepared(*flown)
    found = {own.about: own for own in constant_heat(view)}
    assert set(found) == {"body", "panel"}
    t = len(view.rows.kept)
    warmer = {name: _warmer(view, own.window).reshape(-1)[: 2 * t].reshape(2, t)[:, -1] for name, own in found.items()}
    body, panel = (view.channels.index(f"{name}_temp") for name in ("body", "panel"))
    assert warmer["panel"][panel] > warmer["panel"][body] > 0.0
    assert warmer["body"][body] > warmer["body"][panel] > 0.0


def _warmer(view, window):
    """[R] K."""
    return view.temperatures(window, view.middle) - view.modelled


def test_heat_that_is_missing_all_the_time_is_more_usual_heat_too(flown):
    """With more heat a node's links and its unmodelled heat do more; a bias, that has neither, is no better."""
    view = prepared(*flown)
    always = next(own for own in constant_heat(view) if own.about == "panel")
    k = view.heat.nodes.index("panel")
    assert view.heat_of(always.window).flow[k] > 1.1 * view.heat.flow[k]


def test_the_effect_of_heat_is_in_proportion_to_it(flown):
    view = prepared(*flown)
    steps = np.ones((1, 2 * (len(view.network.drive.times) - 1)))
    little = view.response(view.window, view.middle, "panel", steps)
    much = view.response(view.window, view.middle, "panel", 1e5 * steps)
    np.testing.assert_allclose(much, 1e5 * little, rtol=1e-6)


def test_a_simulation_that_fails_ends_a_family_of_wrongs_and_no_look(flown, monkeypatch):
    def failing(view):
        raise SimulationFailure("no steps are short enough")
        yield

    monkeypatch.setattr(wrongs, "_WRONGS", (failing, swaps))
    assert [own.kind for own in wrongs.all_wrongs(prepared(*flown))] == ["swapped"]


def test_no_clock_is_off_by_less_than_lies_between_two_samples_of_what_heats(flown):
    scenario, data = flown
    seldom = np.where(np.arange(data.sizes["time"]) % 15 == 0, data["sun"].to_numpy(), np.nan)
    view = prepared(scenario, spoilt(data, sun=seldom))
    assert view.apart(["sun"]) == 900.0
    assert {own.words.title for own in clocks(view, [600.0, 1200.0])} == {"The telemetry's clock is 20.0 min late"}


def test_no_status_is_late_by_less_than_lies_between_two_of_its_samples(flown):
    scenario, data = flown
    seldom = np.where(np.arange(data.sizes["time"]) % 10 == 0, data["heater_status"].to_numpy(), np.nan)
    view = prepared(scenario, spoilt(data, heater_status=seldom))
    assert len(list(status_clocks(view, [300.0, 900.0]))) == 1


def test_what_all_modes_take_does_not_hide_what_one_of_them_takes(tmp_path):
    """The panel takes 14 W always, and 6 W more in a mode, which the scenario does not say."""
    written = small.content()
    at = [f"2024-03-01T0{hour}:{minute}:00" for hour in range(3) for minute in ("05", "35")]
    written["simulator"]["modes"] = {"idle": {"panel": "14 W"}, "busy": {"panel": "20 W"}}
    written["simulator"]["timeline"] = [
        {"at": "2024-02-29T00:00:00", "mode": "idle"},
        *({"at": time, "mode": ("busy", "idle")[k % 2]} for k, time in enumerate(at)),
    ]
    _, data = small.closed_loop(tmp_path, written)
    written["simulator"]["modes"]["busy"] = written["simulator"]["modes"]["idle"]
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert first.kind == "mode"
    assert "in panel" in first.title


def test_a_timeline_of_another_time_zone_is_named_with_the_hours(tmp_path):
    written = small.content()
    minutes, mode = np.array([0, 37, 52, 121, 139, 200, 226, 310, 330, 371, 402]), ("idle", "busy")
    at = np.datetime64("2024-03-01T00:03") + minutes.astype("timedelta64[m]")
    written["simulator"]["modes"] = {"idle": {"panel": "1 W"}, "busy": {"panel": "9 W"}}
    timeline = [{"at": "2024-02-28T00:00:00", "mode": "idle"}]
    written["simulator"]["timeline"] = timeline + [{"at": f"{t}:00", "mode": mode[k % 2]} for k, t in enumerate(at)]
    _, data = small.closed_loop(tmp_path, written)
    late = at + np.timedelta64(5, "h")
    written["simulator"]["timeline"] = timeline + [{"at": f"{t}:00", "mode": mode[k % 2]} for k, t in enumerate(late)]
    scenario, _ = small.load(tmp_path, written)
    # No face is lit here: the telemetry's clock could be off as well.
    assert "The timeline of modes is 5 h late" in [own.title for own in named(scenario, data)]


def test_modes_that_are_exchanged_are_named(tmp_path):
    written = small.content()
    at = [f"2024-03-01T0{hour}:{minute}:00" for hour in range(3) for minute in ("05", "35")]
    written["simulator"]["modes"] = {"idle": {"panel": "1 W"}, "busy": {"panel": "9 W", "body": "3 W"}}
    written["simulator"]["timeline"] = [
        {"at": "2024-02-29T00:00:00", "mode": "idle"},
        *({"at": time, "mode": ("busy", "idle")[k % 2]} for k, time in enumerate(at)),
    ]
    _, data = small.closed_loop(tmp_path, written)
    modes = written["simulator"]["modes"]
    modes["idle"], modes["busy"] = modes["busy"], modes["idle"]
    scenario, _ = small.load(tmp_path, written)
    assert named(scenario, data)[0].title == "Modes 'idle' and 'busy' are exchanged"


def test_no_channel_is_late_by_less_than_lies_between_two_of_its_samples(flown):
    scenario, data = flown
    seldom = np.where(np.arange(data.sizes["time"]) % 10 == 0, data["panel_temp"].to_numpy(), np.nan)
    view = prepared(scenario, spoilt(data, panel_temp=seldom))
    assert {(own.about, own.words.title) for own in channel_clocks(view, [300.0], "body_temp")}
    assert not list(channel_clocks(view, [300.0], "panel_temp"))


def test_a_face_at_another_node_is_named(tmp_path):
    written = boxed()
    scenario, _ = small.load(tmp_path, written)
    written["simulator"]["faces"]["ahead"]["node"] = "panel"
    _, data = small.closed_loop(tmp_path, written)
    assert named(scenario, data)[0].title == "Face ahead is of panel, not of body"


def switching(**modes):
    """The satellite with two modes that take turns."""
    written = small.content()
    at = [f"2024-03-01T0{hour}:{minute}:00" for hour in range(3) for minute in ("05", "35")]
    written["simulator"]["modes"] = modes
    written["simulator"]["timeline"] = [
        {"at": "2024-02-29T00:00:00", "mode": "idle"},
        *({"at": time, "mode": ("busy", "idle")[k % 2]} for k, time in enumerate(at)),
    ]
    return written


def test_a_modes_heat_in_another_node_is_named_with_both(tmp_path):
    _, data = small.closed_loop(tmp_path, switching(idle={"panel": "3 W"}, busy={"panel": "15 W"}))
    scenario, _ = small.load(tmp_path, switching(idle={"panel": "3 W"}, busy={"panel": "3 W", "body": "12 W"}))
    assert named(scenario, data)[0].title == "Mode 'busy' heats panel, not body"


@pytest.mark.parametrize("uncertain", [False, True])
def test_two_capacities_that_are_exchanged_are_named(tmp_path, uncertain):
    written = small.content()
    if uncertain:
        prior = {"lognormal": {"median": "3000 J/K", "factor": 1.2}}
        written["parameters"]["capacity"] = {"sets": "nodes.body.capacity", "prior": prior}
    _, data = small.closed_loop(tmp_path, written)
    nodes = written["simulator"]["nodes"]
    nodes["body"]["capacity"], nodes["panel"]["capacity"] = nodes["panel"]["capacity"], nodes["body"]["capacity"]
    if uncertain:
        written["parameters"]["capacity"]["prior"]["lognormal"]["median"] = "800 J/K"
    scenario, _ = small.load(tmp_path, written)
    assert named(scenario, data)[0].title == "nodes.panel and nodes.body have each other's capacity"


def test_faces_of_one_parameter_are_exchanged_with_others_once(tmp_path):
    written = boxed()
    faces = written["simulator"]["faces"]
    faces["outside"] |= {"absorptivity": 0.2, "emissivity": 0.7}
    both = [f"faces.{name}.absorptivity" for name in ("ahead", "back")]
    around = {"mean": 0.5, "standard_deviation": 0.06, "lower": 0.02, "upper": 0.98}
    written["parameters"]["painted"] = {"sets": both, "prior": {"truncated_normal": around}}
    view = prepared(*small.closed_loop(tmp_path, written))
    tried = [own for own in exchanged(view) if "outside" in own.about and own.about.count("absorptivity") == 2]
    entry = view.problem.names.index("painted")
    moved = [own for own in tried if dict(own.moved).get(entry)]
    assert len(moved) == 1
    # Of each kind few are looked at closely; these take no place of priors that are far off.
    assert {own.kind for own in exchanged(view)} == {"exchanged"}
    assert dict(moved[0].moved)[entry] == pytest.approx(0.4, rel=0.05)


def test_a_number_of_the_sun_that_cannot_be_is_named(tmp_path):
    written = boxed()
    _, data = small.closed_loop(tmp_path, written)
    written["environment"]["solar_constant"] = "800 W/m^2"
    scenario, _ = small.load(tmp_path, written)
    assert named(scenario, data)[0].about == "environment.solar_constant"


LINES = (
    "1 58001U 24010A   24061.00000000  .00000000  00000-0  00000-0 0    07",
    "2 58001  97.8000 340.0000 0010000  60.0000 300.0000 14.90000000    01",
)


@pytest.mark.parametrize(
    ("place", "text", "title"),
    [
        (slice(17, 25), " 40.0000", "The orbit has another raan"),
        (slice(8, 16), " 51.6000", "The orbit has another inclination"),
        (slice(52, 63), "14.20000000", "The orbit has another mean motion"),
    ],
)
def test_two_line_elements_of_another_orbit_are_named_by_what_differs(tmp_path, place, text, title):
    written = boxed()
    written["environment"]["orbit"] = {"tle": list(LINES)}
    _, data = small.closed_loop(tmp_path, written)
    written["environment"]["orbit"]["tle"][1] = checked(LINES[1][: place.start] + text + LINES[1][place.stop :])
    scenario, _ = small.load(tmp_path, written)
    assert title in [own.title for own in named(scenario, data)]


def checked(line):
    """A line of two-line elements with the checksum that it should have."""
    return line[:68] + str(sum(int(own) if own.isdigit() else own == "-" for own in line[:68]) % 10)


def test_a_number_that_parts_have_in_common_is_wrong_on_all_of_them(tmp_path):
    """The emissivity of a coating on two faces of two nodes, written as a third of what it is."""
    written = sunlit()
    looks = {"area": "0.3 m^2", "absorptivity": 0.6, "emissivity": 0.81}
    written["simulator"]["faces"] = {
        "outside": {"node": "panel", "normal": [0, 0, -1], **looks},
        "below": {"node": "body", "normal": [0, 0, 1], **looks},
    }
    _, data = small.closed_loop(tmp_path, written)
    for face in written["simulator"]["faces"].values():
        face["emissivity"] = 0.27
    scenario, _ = small.load(tmp_path, written)
    found = {own.about: own.nats for own in named(scenario, data)}
    assert max(found, key=found.get) == "faces.outside.emissivity and faces.below.emissivity"


def test_a_value_beyond_the_bounds_of_its_prior_is_named_with_what_it_is(tmp_path):
    _, data = small.closed_loop(tmp_path)
    written = small.content()
    written["parameters"]["link"]["prior"] = {"uniform": ["1.6 W/K", "1.8 W/K"]}
    narrow, _ = small.load(tmp_path, written)
    first = named(narrow, data)[0]
    assert (first.kind, first.about) == ("prior", "link")
    value = float(first.sentence.partition("link = ")[2].split()[0])
    assert value == pytest.approx(small.TRUTH["link"], rel=0.1)


def test_a_heater_that_is_missing_may_be_much_stronger_than_what_flows_through_its_node(tmp_path):
    """What leaves a body of 20 degC through a link of 0.1 W/K says little of its heater."""
    written = small.content()
    del written["parameters"]["link"], written["parameters"]["power"]
    written["simulator"]["conductors"][0]["conductance"] = "0.1 W/K"
    written["simulator"]["heaters"]["heater"]["power"] = "60 W"
    scenario, data = small.closed_loop(tmp_path, written)
    simulator = scenario.simulator.model_copy(update={"heaters": {}})
    observations = {name: own for name, own in scenario.observations.items() if own.heater is None}
    first = named(scenario.model_copy(update={"simulator": simulator, "observations": observations}), data)[0]
    assert (first.kind, first.about) == ("missing heat", "body")
    assert 30.0 < float(first.sentence.split()[1]) < 90.0


def without_its_heater(scenario):
    """The scenario with neither its heater nor the status of that, and with no parameters."""
    channels = {name: own for name, own in scenario.telemetry.channels.items() if own.kind != "status"}
    observations = {name: own for name, own in scenario.observations.items() if own.heater is None}
    update = {
        "simulator": scenario.simulator.model_copy(update={"heaters": {}}),
        "telemetry": scenario.telemetry.model_copy(update={"channels": channels}),
        "observations": observations,
        "parameters": {},
    }
    return scenario.model_copy(update=update)


@pytest.mark.parametrize("apart", [1, 3, 4, 5])
def test_a_heater_that_is_missing_is_named_however_seldom_its_node_is_read(flown, apart):
    scenario, data = flown
    first = named(without_its_heater(scenario), data.isel(time=slice(None, None, apart)))[0]
    assert (first.kind, first.about) == ("missing heat", "body")


def test_times_of_a_missing_heater_are_known_to_about_the_time_between_two_readings(flown):
    scenario, data = flown
    view = prepared(without_its_heater(scenario), data.isel(time=slice(None, None, 3)))
    base = view.point(view.window, view.middle)
    own = next(wrong for wrong in missing_heat(view) if wrong.about == "body")
    exact, shifted = (
        climbed(view, view.window, view.observed, base, columns) for columns in (own.columns[:, :1], own.columns)
    )
    assert shifted.evidence > exact.evidence + 10.0


def test_no_part_holds_far_more_heat_than_all_others(flown):
    """Such a capacity would explain every channel that hardly changes."""
    scenario, data = flown
    titles = [own.words.title for own in numbers(prepared(scenario, data)) if ".capacity" in own.about]
    assert "nodes.panel.capacity is 0.1000 times what it should be" in titles
    assert "nodes.body.capacity is 1000 times what it should be" in titles
    assert not any("body.capacity is 0.001" in title or "panel.capacity is 0.01" in title for title in titles)
