from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from flightcal.environment.attitude import body_to_inertial
from flightcal.environment.geometry import geometry_of
from flightcal.environment.sun import OBLIQUITY
from flightcal.errors import OrbitError

from .scenes import EPOCH, circular, environment, seconds_after

TIMES = seconds_after(EPOCH, np.arange(0.0, 6000.0, 371.0))


def axes(attitude, times=TIMES, folder=None, **orbit):
    """Body axes x, y, z in the inertial frame, each [T, 3], and the geometry."""
    scene = environment(circular(**orbit), attitude=attitude)
    at = geometry_of(scene)(times)
    matrix = body_to_inertial(scene.attitude, at, *([folder] if folder else []))
    return *np.moveaxis(matrix, 2, 0), at


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def write_quaternions(path, times, rotations):
    rows = [
        ",".join([str(time), *(str(x) for x in rotation.as_quat(scalar_first=True))])
        for time, rotation in zip(times, rotations, strict=True)
    ]
    path.write_text("\n".join(["time,w,x,y,z", *rows]) + "\n")


@pytest.mark.parametrize(
    "attitude",
    [
        "nadir",
        "sun_pointing",
        {"aligned": {"axis": [1, 2, 0], "towards": "sun"}, "constrained": {"axis": [0, 1, 1], "towards": [1, 0, 2]}},
        {"inertial": [0.5, -0.5, 0.1, 2.0]},
        {"spin_axis": [1, 2, 3], "direction": [0, -1, 1], "period": "7 min"},
    ],
)
def test_body_axes_are_a_right_handed_frame(attitude):
    x, y, z, _ = axes(attitude)
    for axis in (x, y, z):
        assert np.linalg.norm(axis, axis=1) == pytest.approx(1, abs=1e-12)
    assert np.cross(x, y) == pytest.approx(z, abs=1e-12)


def test_nadir_points_z_down_x_forward_and_y_against_the_orbit_normal():
    x, y, z, at = axes("nadir")
    assert z == pytest.approx(-unit(at.position), abs=1e-12)
    assert y == pytest.approx(-unit(np.cross(at.position, at.velocity)), abs=1e-12)
    assert x == pytest.approx(unit(at.velocity), abs=2e-3)


def two(axis, towards, other, second):
    return {"aligned": {"axis": axis, "towards": towards}, "constrained": {"axis": other, "towards": second}}


@pytest.mark.parametrize(
    ("attitude", "alike"),
    [
        ("nadir", two([0, 0, 3], "nadir", [0, -1, 0], "orbit_normal")),
        ("nadir", two([0, -1, 0], "orbit_normal", [1, 0, 0], "velocity")),
        ("sun_pointing", two([0, 0, 1], "sun", [0, 1, 0], "ecliptic_north")),
        ({"inertial": [1, 0, 0, 0]}, two([0, 1, 0], [0, 2, 0], [1, 1, 0], [1, 0.5, 0])),
    ],
)
def test_attitudes_with_names_are_two_axes_that_point_somewhere(attitude, alike):
    # On a circular orbit the velocity is across the radius to the rounding of its perturbations.
    for one, other in zip(axes(attitude)[:3], axes(alike)[:3], strict=True):
        assert one == pytest.approx(other, abs=2e-3)


def test_yaw_steering_points_z_down_and_turns_about_it_to_the_sun():
    x, y, z, at = axes(two([0, 0, 1], "nadir", [1, 0, 0], "sun"))
    to_sun = unit(at.to_sun)
    assert z == pytest.approx(-unit(at.position), abs=1e-12)
    assert np.sum(y * to_sun, axis=1) == pytest.approx(0.0, abs=1e-12)
    assert (np.sum(x * to_sun, axis=1) > 0.0).all()


def test_two_axes_stay_a_frame_while_the_sun_is_overhead():
    scene = environment(circular(), attitude=two([0, 0, -1], "nadir", [1, 0, 0], "sun"))
    at = geometry_of(scene)(TIMES)
    overhead = replace(at, position=7e6 * unit(at.sun), velocity=7e3 * np.cross(unit(at.sun), [0.0, 0.0, 1.0]))
    x, y, z = np.moveaxis(body_to_inertial(scene.attitude, overhead), 2, 0)
    assert z == pytest.approx(unit(at.sun), abs=1e-12)
    assert np.linalg.norm(x, axis=1) == pytest.approx(1.0, abs=1e-12)
    assert np.cross(x, y) == pytest.approx(z, abs=1e-12)


def test_sun_pointing_points_z_to_the_sun_and_y_to_the_ecliptic_pole():
    _, y, z, at = axes("sun_pointing")
    assert z == pytest.approx(unit(at.sun - at.position), abs=1e-12)
    pole = [0.0, -np.sin(OBLIQUITY), np.cos(OBLIQUITY)]
    assert y @ pole == pytest.approx(1, abs=1e-7)


def test_quaternion_turns_body_vectors_into_inertial_ones():
    # A quarter turn about z takes x to y; the length of the quaternion does not matter.
    x, y, z, _ = axes({"inertial": [2.0, 0, 0, 2.0]})
    assert x[0] == pytest.approx([0, 1, 0], abs=1e-12)
    assert y[0] == pytest.approx([-1, 0, 0], abs=1e-12)
    assert len(z) == len(TIMES)


@pytest.mark.parametrize("spin_axis", [[0, 0, 1], [1, 2, -1], [0, 0, -3]])
def test_spin_axis_points_along_its_direction_and_the_body_turns_about_it(spin_axis):
    attitude = {"spin_axis": spin_axis, "direction": [0, 0, 2], "period": "400 s"}
    times = seconds_after(EPOCH, [0.0, 100.0, 400.0, 4000.0])
    x, y, z, _ = axes(attitude, times)
    matrices = np.stack([x, y, z], axis=-1)
    assert matrices @ unit(np.array(spin_axis, float)) == pytest.approx(np.tile([0, 0, 1], (4, 1)), abs=1e-12)
    quarter = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    assert matrices[1] == pytest.approx(quarter @ matrices[0], abs=1e-6)
    assert matrices[2:] == pytest.approx(np.stack([matrices[0]] * 2), abs=1e-6)


def test_a_spinning_body_has_turned_by_its_phase_at_its_epoch():
    attitude = {"spin_axis": [0, 0, 1], "direction": [0, 0, 1], "period": "400 s", "epoch": str(EPOCH)}
    times = seconds_after(EPOCH, [0.0, 100.0])
    x, *_ = axes(attitude, times)
    assert x == pytest.approx(np.array([[1, 0, 0], [0, 1, 0]]), abs=1e-9)
    x, *_ = axes(attitude | {"phase": "90 deg"}, times)
    assert x == pytest.approx(np.array([[0, 1, 0], [-1, 0, 0]]), abs=1e-9)


def test_sampled_quaternions_are_met_and_turned_between_evenly(tmp_path):
    rotations = Rotation.from_euler("zyx", [[0, 0, 0], [80, 0, 0], [80, 40, 0]], degrees=True)
    samples = seconds_after(EPOCH, [0.0, 600.0, 1200.0])
    write_quaternions(tmp_path / "attitude.csv", samples, rotations)
    times = seconds_after(EPOCH, [0.0, 300.0, 600.0, 1200.0])
    x, *_ = axes({"quaternions": "attitude.csv"}, times, tmp_path)
    assert x[[0, 2, 3]] == pytest.approx(rotations.as_matrix()[:, :, 0], abs=1e-12)
    assert x[1] == pytest.approx([np.cos(np.radians(40)), np.sin(np.radians(40)), 0], abs=1e-12)


def test_quaternions_are_read_again_when_their_file_has_changed(tmp_path):
    samples, turned = TIMES[[0, -1]], Rotation.from_rotvec(np.radians([[0, 0, 90]] * 2))
    found = []
    for rotations in (Rotation.identity(2), turned):
        write_quaternions(tmp_path / "attitude.csv", samples, rotations)
        found.append(axes({"quaternions": "attitude.csv"}, TIMES, tmp_path)[0][0])
    assert np.array(found) == pytest.approx(np.array([[1, 0, 0], [0, 1, 0]]), abs=1e-12)


def test_quaternions_of_another_order_that_turn_the_other_way_are_read_as_the_file_has_them(tmp_path):
    rotations = Rotation.from_euler("zyx", [[10, 20, 30], [80, 40, 0]], degrees=True)
    samples = seconds_after(EPOCH, [0.0, 600.0])
    q1, q2, q3, q4 = rotations.inv().as_quat().T
    pd.DataFrame({"time": samples, "q1": q1, "q2": q2, "q3": q3, "q4": q4}).to_csv(tmp_path / "q.csv", index=False)
    attitude = {"quaternions": "q.csv", "columns": ["q4", "q1", "q2", "q3"], "turns": "inertial_to_body"}
    x, *_ = axes(attitude, samples, tmp_path)
    assert x == pytest.approx(rotations.as_matrix()[:, :, 0], abs=1e-12)


def test_times_outside_the_sampled_quaternions_are_an_error(tmp_path):
    write_quaternions(tmp_path / "attitude.csv", TIMES[:3], Rotation.identity(3))
    with pytest.raises(OrbitError, match=r"attitude\.quaternions: attitude\.csv: found samples from"):
        axes({"quaternions": "attitude.csv"}, TIMES, tmp_path)


@pytest.mark.parametrize(
    ("attitude", "found"),
    [
        ({"inertial": [0, 0, 0, 0]}, r"attitude\.inertial\s+found a quaternion of length 0"),
        ({"spin_axis": [0, 0, 0], "direction": [1, 0, 0], "period": "1 s"}, r"attitude\.spin_axis\s+found a vector"),
        ({"spin_axis": [1, 0, 0], "direction": [0, 0, 0], "period": "1 s"}, r"attitude\.direction\s+found a vector"),
    ],
)
def test_attitude_without_direction_is_an_error(attitude, found):
    with pytest.raises(ValidationError, match=found):
        environment(circular(), attitude=attitude)


def test_body_axes_of_a_fast_spin_are_an_error():
    with pytest.raises(OrbitError, match="no spin 'period'"):
        axes({"spin_axis": [1, 0, 0], "direction": [0, 0, 1]})


def test_sampled_quaternion_of_length_zero_is_an_error(tmp_path):
    (tmp_path / "attitude.csv").write_text(f"time,w,x,y,z\n{TIMES[0]},1,0,0,0\n{TIMES[-1]},0,0,0,0\n")
    with pytest.raises(OrbitError, match=r"attitude\.csv: found a quaternion of length zero"):
        axes({"quaternions": "attitude.csv"}, TIMES, tmp_path)


LATER = seconds_after(EPOCH, np.array([1200.0, 3000.0]))
TIMELINE = {
    "named": {"burn": {"inertial": [1, 0, 0, 0]}},
    "slew": "5 min",
    "timeline": [
        {"at": str(EPOCH), "attitude": "sun_pointing"},
        {"at": str(LATER[0]), "attitude": "nadir"},
        {"at": str(LATER[1]), "attitude": "burn"},
    ],
}


def test_each_attitude_of_a_timeline_holds_after_its_slew():
    times = seconds_after(EPOCH, np.array([-500.0, 0.0, 1199.0, 1500.0, 2999.0, 3300.0, 5000.0]))
    found = np.stack(axes(TIMELINE, times)[:3], axis=2)
    for kind, which in (("sun_pointing", [0, 1, 2]), ("nadir", [3, 4]), ({"inertial": [1, 0, 0, 0]}, [5, 6])):
        np.testing.assert_allclose(found[which], np.stack(axes(kind, times[which])[:3], axis=2), atol=1e-12)


def test_in_a_slew_the_body_turns_about_one_axis_at_a_constant_rate():
    """From where the attitude before has it, as that goes on, to where the one after has it."""
    seconds = np.array([0.0, 60.0, 150.0, 240.0, 299.999])
    times = seconds_after(LATER[0], seconds)
    found = Rotation.from_matrix(np.stack(axes(TIMELINE, times)[:3], axis=2))
    before = Rotation.from_matrix(np.stack(axes("sun_pointing", times)[:3], axis=2))
    after = Rotation.from_matrix(np.stack(axes("nadir", times)[:3], axis=2))
    whole = (before.inv() * after).as_rotvec()
    np.testing.assert_allclose((before.inv() * found).as_rotvec(), seconds[:, None] / 300.0 * whole, atol=1e-9)
    assert np.linalg.norm(whole, axis=1).min() > 0.5


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"timeline": []}, "found no change, expected at least one in 'timeline'"),
        (
            {"timeline": [{"at": str(EPOCH), "attitude": "brun"}]},
            "found 'brun', expected one of burn, nadir, sun_point",
        ),
        ({"slew": "40 min"}, "expected a time after the slew of 2400 s that begins at 2024-03-20T03:06"),
        ({"slew": "0 s"}, "found '0 s', expected at least 1 s"),
        (
            {"timeline": [{"at": str(EPOCH), "attitude": {"spin_axis": [0, 0, 1], "direction": [1, 0, 0]}}]},
            "found a spin without period",
        ),
    ],
)
def test_a_timeline_of_attitudes_that_cannot_be_flown_is_refused(changes, message):
    with pytest.raises(ValidationError, match=message):
        environment(circular(), attitude=TIMELINE | changes)
