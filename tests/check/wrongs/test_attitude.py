"""Another attitude than the scenario writes, or another time of it."""

import re

import numpy as np
import pytest

from tests import small

from ..cases import boxed, named, pointed, two_faced


def test_nadir_and_zenith_confused_are_the_bodys_axes(tmp_path, named_of):
    written = two_faced()
    _, data = small.closed_loop(tmp_path, written)
    for face in written["simulator"]["faces"].values():
        face["normal"] = [-axis for axis in face["normal"]]
    scenario, right = small.load(tmp_path, written)
    assert right.sizes == data.sizes
    assert named_of(scenario, data, "faces", "attitude")[0].title == "The body's axes are others"


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


@pytest.mark.parametrize(
    "read", [lambda w, x, y, z: (w, -x, -y, -z), pytest.param(lambda w, x, y, z: (x, y, z, w), marks=pytest.mark.slow)]
)
def test_quaternions_of_another_convention_are_named(tmp_path, read, named_of):
    written, true = boxed(), (0.5, 0.1, 0.7, 0.5)
    written["environment"]["attitude"] = pointed(true)
    _, data = small.closed_loop(tmp_path, written)
    for attitude in written["environment"]["attitude"]["named"].values():
        attitude["inertial"] = list(read(*attitude["inertial"]))
    scenario, _ = small.load(tmp_path, written)
    first = named_of(scenario, data, "attitude", "faces")[0]
    assert (first.kind, first.about) == ("attitude", "quaternions")


@pytest.mark.slow
def test_a_timeline_of_attitudes_that_is_late_is_named_with_the_minutes(tmp_path):
    written = boxed()
    written["environment"]["attitude"] = pointed((0.5, 0.1, 0.7, 0.5))
    scenario, data = small.closed_loop(tmp_path, written)
    assert named(scenario, data) == ()
    for change, at in zip(written["environment"]["attitude"]["timeline"], ("00:17", "01:27", "02:37"), strict=True):
        change["at"] = f"2024-03-01T{at}:00"
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert (first.kind, first.about) == ("attitude", "timeline")
    assert float(first.title.split()[-3]) == pytest.approx(17.0, abs=2.0)
    assert first.title.endswith("late")


@pytest.mark.slow
def test_attitudes_that_are_exchanged_are_named(tmp_path):
    written = boxed()
    written["environment"]["attitude"] = pointed((0.5, 0.1, 0.7, 0.5))
    _, data = small.closed_loop(tmp_path, written)
    attitudes = written["environment"]["attitude"]["named"]
    attitudes["one"], attitudes["other"] = attitudes["other"], attitudes["one"]
    scenario, _ = small.load(tmp_path, written)
    assert named(scenario, data)[0].title == "Attitudes 'one' and 'other' are exchanged"


@pytest.mark.slow
def test_one_attitude_that_is_another_is_named_with_its_time(tmp_path):
    written = boxed()
    written["environment"]["attitude"] = pointed((0.5, 0.1, 0.7, 0.5))
    _, data = small.closed_loop(tmp_path, written)
    written["environment"]["attitude"]["timeline"][1]["attitude"] = "third"
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert first.title == "The attitude from 2024-03-01T01:10:00 on is 'other', not 'third'"


@pytest.mark.slow
def test_one_change_of_attitude_that_is_late_is_named_with_the_minutes(tmp_path):
    written = boxed()
    written["environment"]["attitude"] = pointed((0.5, 0.1, 0.7, 0.5))
    _, data = small.closed_loop(tmp_path, written)
    written["environment"]["attitude"]["timeline"][1]["at"] = "2024-03-01T01:27:00"
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert first.title.startswith("The change of attitude to 'other' at 2024-03-01T01:27:00 is ")
    assert float(first.title.split()[-3]) == pytest.approx(17.0, abs=2.0)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        pytest.param("direction", [1, 0, 0], marks=pytest.mark.slow),
        pytest.param("direction", [0, 0, -1], marks=pytest.mark.slow),
        pytest.param("period", "20 min", marks=pytest.mark.slow),
    ],
)
def test_a_spin_that_is_another_is_named_by_what_is_written(tmp_path, name, value):
    written = boxed()
    written["environment"]["attitude"] = {"spin_axis": [0, 0, 1], "direction": [0, 0, 1], "period": "40 min"}
    scenario, _ = small.load(tmp_path, written)
    written["environment"]["attitude"][name] = value
    _, data = small.closed_loop(tmp_path, written)
    first = named(scenario, data)[0]
    assert (first.kind, first.about) == ("attitude", name)


def test_a_spin_with_another_period_is_named_with_what_to_write(tmp_path, named_of):
    written = boxed()
    written["simulator"]["nodes"]["panel"]["capacity"] = "200 J/K"
    del written["simulator"]["faces"]["back"]
    spin = {"spin_axis": [0, 0, 1], "direction": [0.3, -0.5, 0.8], "epoch": "2024-03-01T00:00:00"}
    written["environment"]["attitude"] = spin | {"period": "13 min"}
    scenario, _ = small.load(tmp_path, written)
    written["environment"]["attitude"] = spin | {"period": "12 min", "phase": "70 deg"}
    _, data = small.closed_loop(tmp_path, written)
    first = named_of(scenario, data, "attitude", "faces")[0]
    assert (first.kind, first.about) == ("attitude", "period")
    period, phase = re.findall(r"'period: ([\d.]+) s', 'phase: (\d+) deg' and 'epoch: 2024-03-01", first.advice)[0]
    assert float(period) == pytest.approx(720.0, abs=2.0)
    assert abs(int(phase) - 70) <= 10


@pytest.mark.parametrize("true", [70, pytest.param(250, marks=pytest.mark.slow)])
def test_a_spin_with_another_phase_is_named_with_the_phase_to_write(tmp_path, true, named_of):
    written = boxed()
    attitude = {"spin_axis": [0, 0, 1], "direction": [0, 0.6, 0.8], "period": "40 min", "epoch": "2024-03-01T00:00:00"}
    written["environment"]["attitude"] = attitude
    scenario, _ = small.load(tmp_path, written)
    written["environment"]["attitude"] = attitude | {"phase": f"{true} deg"}
    _, data = small.closed_loop(tmp_path, written)
    (phase,) = re.findall(r"'phase: (\d+) deg'", named_of(scenario, data, "attitude", "faces")[0].advice)
    assert abs(int(phase) - true) <= 5


@pytest.mark.slow
def test_slews_that_take_longer_than_written_are_named(tmp_path):
    written = boxed()
    written["environment"]["attitude"] = attitude = pointed((0.5, 0.1, 0.7, 0.5)) | {"slew": "15 min"}
    attitude["timeline"] = [
        {"at": f"2024-03-01T{at}:00", "attitude": name}
        for at, name in (("00:00", "one"), ("01:10", "other"), ("01:50", "third"), ("02:30", "one"), ("03:10", "other"))
    ]
    _, data = small.closed_loop(tmp_path, written)
    attitude["slew"] = "2 min"
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert (first.kind, first.about) == ("attitude", "slew")
    assert float(first.title.split()[3]) == pytest.approx(900.0, rel=0.35)


@pytest.mark.parametrize(
    ("first", "second", "said"),
    [
        (([0, 0, 1], "nadir"), ([1, 0, 0], "sun"), "with +z to the Earth and turned about it with +x to the Sun"),
        pytest.param(([1, 0, 0], "sun"), ([0, 1, 0], "ecliptic_north"), "with +x to the Sun", marks=pytest.mark.slow),
    ],
    ids=["yaw steering", "another side to the Sun"],
)
def test_a_satellite_that_turns_to_the_sun_is_named(tmp_path, first, second, said):
    written = boxed()
    # The Sun is far from the orbit's plane.
    written["environment"]["orbit"]["ltan"] = "16:00"
    scenario, _ = small.load(tmp_path, written)
    keys = ("axis", "towards")
    written["environment"]["attitude"] = {
        "aligned": dict(zip(keys, first, strict=True)),
        "constrained": dict(zip(keys, second, strict=True)),
    }
    _, data = small.closed_loop(tmp_path, written)
    found = named(scenario, data)[0]
    assert found.title == f"The satellite flew {said}"
    assert "Write 'attitude: {aligned: {axis: " in found.advice


def _aligned(first, second):
    keys = ("axis", "towards")
    return {"aligned": dict(zip(keys, first, strict=True)), "constrained": dict(zip(keys, second, strict=True))}


@pytest.mark.parametrize(
    ("flown", "written", "about"),
    [
        (([0, 0, 1], [1, 0, 0]), ([0, 0, 1], [-1, 0, 0]), "turned"),
        pytest.param(([0, 0.5, 0.87], [1, 0, 0]), ([0, -0.5, 0.87], [1, 0, 0]), "tilted", marks=pytest.mark.slow),
    ],
    ids=["yaw steering with the other side to the Sun", "a roll to the other side"],
)
def test_an_axis_with_the_wrong_sign_is_named(tmp_path, flown, written, about, named_of):
    content = boxed()
    content["environment"]["orbit"]["ltan"] = "16:00"
    content["environment"]["attitude"] = _aligned((flown[0], "nadir"), (flown[1], "sun"))
    _, data = small.closed_loop(tmp_path, content)
    content["environment"]["attitude"] = _aligned((written[0], "nadir"), (written[1], "sun"))
    scenario, _ = small.load(tmp_path, content)
    first = named_of(scenario, data, "attitude", "faces")[0]
    assert (first.kind, first.about) == ("attitude", about)
    assert "the other way" in first.title
