"""What of a window was not trained on, where it is known."""

import json
from dataclasses import replace

import numpy as np
import pytest
import xarray

from flightcal.prediction.unseen import ANY, read_unseen, unseen, unseen_attribute
from flightcal.problem import build_window
from flightcal.run import write_netcdf

from .. import small
from ..check.cases import boxed, sunlit


def written(**more):
    content = small.content()
    content["simulator"]["modes"] = {"idle": {"body": "1 W"}, "imaging": {"body": "5 W"}}
    content["simulator"]["timeline"] = [
        {"at": "2024-03-01T00:00:00", "mode": "idle"},
        {"at": "2024-03-01T04:00:00", "mode": "imaging"},
        {"at": "2024-03-01T04:45:00", "mode": "idle"},
    ]
    return content | more


def windows_of(folder, content, change=lambda data: None):
    scenario, data = small.load(folder, content)
    change(data)
    return build_window(scenario, data, "train"), build_window(scenario, data, "test")


def shares(found):
    return {condition.name: condition.share for condition in found}


def test_a_mode_that_training_lacked_has_its_share_of_the_windows_time(tmp_path):
    train, test = windows_of(tmp_path, written())
    found = shares(unseen([train], test))
    assert found == pytest.approx({ANY: 0.25, "mode imaging": 0.25}, abs=1e-12)


def test_an_attitude_that_training_lacked_is_named(tmp_path):
    content = boxed() | {"windows": small.content()["windows"]}
    roll = {
        "aligned": {"axis": [0, 0.5, 0.87], "towards": "nadir"},
        "constrained": {"axis": [1, 0, 0], "towards": "velocity"},
    }
    changes = [("2024-02-29T00:00:00", "nadir"), ("2024-03-01T04:00:00", "roll"), ("2024-03-01T04:45:00", "nadir")]
    content["environment"]["attitude"] = {
        "named": {"roll": roll},
        "timeline": [{"at": at, "attitude": attitude} for at, attitude in changes],
    }
    train, test = windows_of(tmp_path, content)
    assert shares(unseen([train], test))["attitude roll"] == pytest.approx(0.25, abs=0.01)
    assert "attitude roll" not in shares(unseen([train, test], test))


def test_nothing_is_unseen_of_a_window_that_was_trained_on_or_is_like_it(tmp_path):
    train, test = windows_of(tmp_path, small.content())
    assert unseen([train], train, train.observed) == ()
    assert unseen([train], test, test.observed) == ()
    train, test = windows_of(tmp_path, written())
    assert unseen([train, test], test) == ()


def test_values_of_the_driver_that_heat_is_over_which_training_lacked_are_unseen(tmp_path):
    content = small.content() | {"heat": {"pattern": {"over": "angle"}}}
    content["telemetry"]["channels"]["angle"] = {"column": "sun", "unit": "deg", "kind": "driver"}

    def turned(data):
        # An hour and a half of the test's three.
        data["angle"].values[300:390] += np.deg2rad(20.0)

    train, test = windows_of(tmp_path, content, turned)
    found = shares(unseen([train], test))
    assert found["angle"] == pytest.approx(0.5, abs=0.01)
    assert unseen([train], train) == ()


def test_power_beyond_the_trained_range_widened_by_a_twentieth_is_unseen(tmp_path):
    def stronger(factor):
        def change(data):
            later = data["time"].values >= np.datetime64("2024-03-01T03:30:00")
            data["sun"].values[later] *= factor

        return change

    train, test = windows_of(tmp_path, small.content(), stronger(1.04))
    assert unseen([train], test) == ()
    train, test = windows_of(tmp_path, small.content(), stronger(1.5))
    # Half a sine over half of each orbit: the window has two whole orbits.
    expected = 0.5 - np.arcsin(1.05 / 1.5) / np.pi
    found = shares(unseen([train], test))
    assert found == pytest.approx({ANY: expected, "power of sun": expected}, abs=0.01)


def test_temperatures_two_kelvin_beyond_the_trained_telemetry_are_unseen(tmp_path):
    train, test = windows_of(tmp_path, small.content())
    mean = np.tile(np.nanmax(train.observed, axis=0) + 1.9, (len(test.times), 1))
    assert unseen([train], test, mean) == ()
    mean[:45, 1] += 0.2
    found = shares(unseen([train], test, mean))
    assert found == pytest.approx({ANY: 0.25, "temperature of panel_temp": 0.25}, abs=0.01)


def test_what_shares_time_is_counted_once_in_all(tmp_path):
    train, test = windows_of(tmp_path, written())
    found = unseen([train], test, np.full(test.observed.shape, 400.0))
    assert [condition.name for condition in found] == [
        ANY,
        "temperature of body_temp",
        "temperature of panel_temp",
        "mode imaging",
    ]
    assert found[0].share == pytest.approx(1.0)


LEO = {
    "epoch": "2024-03-01T00:00:00",
    "semi_major_axis": "6900 km",
    "eccentricity": 0.0,
    "inclination": "50 deg",
    "raan": "0 deg",
    "argument_of_perigee": "0 deg",
    "mean_anomaly": "0 deg",
}


@pytest.mark.parametrize(("day", "expected"), [("2024-03-01", False), ("2024-03-19", True)])
def test_another_beta_angle_shows_in_sunlight_and_in_where_the_eclipse_is(tmp_path, day, expected):
    content = small.content()
    content["environment"] = {"orbit": LEO, "attitude": "nadir"}
    del content["simulator"]["loads"]
    content["parameters"]["panel_size"]["scales"] = ["conductors.panel-space.radiative"]
    content["simulator"]["faces"] = {
        "side": {"node": "panel", "area": "0.1 m^2", "absorptivity": 0.5, "emissivity": 0.5, "normal": [0, 1, 0]}
    }
    content["windows"]["test"] = {"start": f"{day}T03:20:00", "end": f"{day}T06:20:00"}
    scenario, data = small.load(tmp_path, content)
    later = data.assign_coords(time=data["time"] + (np.datetime64(day) - np.datetime64("2024-03-01")))
    found = shares(unseen([build_window(scenario, data, "train")], build_window(scenario, later, "test")))
    assert ("sunlight on side" in found) == expected
    assert any("eclipse" in name for name in found) == expected


def test_a_prediction_has_it_as_an_attribute_that_is_read_again(tmp_path):
    train, test = windows_of(tmp_path, written())
    trained = {"train": train}
    assert unseen_attribute(trained, train, train.observed) == {}
    attribute = unseen_attribute(trained, test, test.observed)
    assert json.loads(attribute["unseen"])[0] == {"name": ANY, "share": pytest.approx(0.25)}
    tree = xarray.DataTree.from_dict(
        {"train": xarray.Dataset({"a": 1.0}), "test": xarray.Dataset({"a": 1.0}, attrs=attribute)}
    )
    write_netcdf(tmp_path / "prediction.nc", tree)
    assert read_unseen(tmp_path / "prediction.nc") == {"test": unseen([train], test, test.observed)}


@pytest.mark.parametrize(("more", "told"), [(20.0, False), (60.0, True)])
def test_a_face_that_the_sun_grazes_is_new_where_it_has_much_more_sunlight(tmp_path, more, told):
    scenario, data = small.load(tmp_path, sunlit())
    train = build_window(scenario, data, "train")
    drive, columns = train.network.drive, train.network.network.columns
    dark, grazed = drive.inputs.copy(), drive.inputs.copy()
    dark[:, :, columns.index("solar.outside")] = 0.0
    grazed[:, :, columns.index("solar.outside")] = more
    drives = [replace(drive, inputs=inputs) for inputs in (dark, grazed)]
    windows = [replace(train, simulator=replace(train.network, drive=altered)) for altered in drives]
    found = shares(unseen(windows[:1], windows[1]))
    assert ("sunlight on outside" in found) == told
