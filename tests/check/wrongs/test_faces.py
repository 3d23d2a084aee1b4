"""Faces that look another way or are of another node."""

import numpy as np
import pytest

from tests import small

from ..cases import boxed, named, sunlit


def test_a_face_that_looks_the_other_way_is_named(tmp_path, named_of):
    written = sunlit()
    _, data = small.closed_loop(tmp_path, written)
    written["simulator"]["faces"]["outside"]["normal"] = [1, 0, 0]
    scenario, _ = small.load(tmp_path, written)
    assert named_of(scenario, data, "faces", "attitude")[0].title == "Face outside looks another way"


def test_a_body_that_tumbles_is_named(tmp_path):
    written = sunlit()
    scenario, _ = small.load(tmp_path, written)
    written["simulator"]["faces"]["outside"]["normal"] = "all"
    _, data = small.closed_loop(tmp_path, written)
    assert named(scenario, data)[0].title == "The body tumbles"


@pytest.mark.parametrize(
    "name", ["outside", pytest.param("panel", marks=pytest.mark.slow)], ids=["of its own name", "called as its node"]
)
def test_two_faces_that_are_exchanged_are_named(tmp_path, name):
    written = boxed()
    faces = written["simulator"]["faces"] = {
        name if key == "outside" else key: face for key, face in written["simulator"]["faces"].items()
    }
    scenario, _ = small.load(tmp_path, written)
    faces["ahead"]["normal"], faces[name]["normal"] = faces[name]["normal"], faces["ahead"]["normal"]
    _, data = small.closed_loop(tmp_path, written)
    first = named(scenario, data)[0]
    assert first.title == f"Faces {name} and ahead are exchanged"


DRIVEN = {"tracks_sun_about": [0, 1, 0]}, {"tracks_sun_about": [0, 1, 0], "back": True}


@pytest.mark.parametrize(
    ("written", "flown", "said"),
    [
        (([0, -1, 0], [0, 1, 0]), ([0, 0, -1], [0, 0, 1]), "With the normal [0, 0, -1] of cells"),
        pytest.param(DRIVEN, ([1, 0, 0], [-1, 0, 0]), "With the normal [1, 0, 0] of cells", marks=pytest.mark.slow),
        (([0, 0, -1], [0, 0, 1]), DRIVEN, "With the normal {tracks_sun_about: [0, 1, 0]} of cells"),
    ],
    ids=["not deployed", "a drive that stands still", "a drive that the scenario lacks"],
)
def test_a_panel_that_looks_another_way_is_named_by_both_of_its_sides(tmp_path, written, flown, said, named_of):
    model = boxed()
    faces = model["simulator"]["faces"]
    cells = {"node": "panel", "area": "0.08 m^2", "absorptivity": 0.8, "emissivity": 0.8}
    faces["cells"], faces["behind"] = (
        cells | {"normal": written[0]},
        cells | {"normal": written[1], "absorptivity": 0.2},
    )
    del faces["outside"], faces["left"]
    scenario, _ = small.load(tmp_path, model)
    faces["cells"]["normal"], faces["behind"]["normal"] = flown
    _, data = small.closed_loop(tmp_path, model)
    first = named_of(scenario, data, "faces", "attitude")[0]
    assert first.title == "Faces cells and behind look another way"
    assert said in first.sentence


def hinged(front, back):
    """The satellite with a wing that is fixed at an angle, whose two sides look these ways."""
    model = boxed()
    cells = {"node": "panel", "area": "0.08 m^2", "absorptivity": 0.8, "emissivity": 0.8}
    faces = model["simulator"]["faces"]
    faces["cells"], faces["behind"] = cells | {"normal": front}, cells | {"normal": back, "absorptivity": 0.2}
    del faces["outside"], faces["left"]
    return model


@pytest.mark.parametrize(
    "written",
    [
        ([0, 0, -1], [0, 0, 1]),
        pytest.param(DRIVEN, marks=pytest.mark.slow),
    ],
    ids=["its tilt forgotten", "said to follow the Sun"],
)
def test_a_wing_that_is_tilted_is_named_with_about_its_way(tmp_path, written, named_of):
    _, data = small.closed_loop(tmp_path, hinged([0, 0.6, -0.8], [0, -0.6, 0.8]))
    scenario, _ = small.load(tmp_path, hinged(*written))
    first = named_of(scenario, data, "faces", "attitude")[0]
    assert first.title == "Faces cells and behind look another way"
    x, y, z = map(float, first.sentence.split("normal [")[1].split("]")[0].split(","))
    # To half of the last step of 15 deg.
    assert 0.6 * y - 0.8 * z > np.cos(np.deg2rad(10.0)), (x, y, z)


@pytest.mark.slow
def test_a_side_that_looks_as_the_other_one_is_named(tmp_path):
    _, data = small.closed_loop(tmp_path, hinged([0, 0.6, -0.8], [0, -0.6, 0.8]))
    scenario, _ = small.load(tmp_path, hinged([0, 0.6, -0.8], [0, 0.6, -0.8]))
    first = named(scenario, data)[0]
    assert first.title == "Face behind looks another way"
    assert "With the normal [0, -0.6, 0.8] of behind" in first.sentence


@pytest.mark.parametrize("period", [None, "20 min"])
def test_plates_of_a_body_that_spins_are_looked_at(tmp_path, period, named_of):
    model = boxed()
    spin = {"spin_axis": [0, 0, 1], "direction": [1, 0, 1]}
    model["environment"]["attitude"] = spin if period is None else spin | {"period": period, "epoch": "2024-03-01"}
    faces = model["simulator"]["faces"]
    cells = {"node": "panel", "area": "0.08 m^2", "absorptivity": 0.8, "emissivity": 0.8}
    faces["top"], faces["below"] = cells | {"normal": [0, 0, 1]}, cells | {"normal": [0, 0, -1], "absorptivity": 0.2}
    scenario, _ = small.load(tmp_path, model)
    faces["top"]["normal"], faces["below"]["normal"] = faces["below"]["normal"], faces["top"]["normal"]
    _, data = small.closed_loop(tmp_path, model)
    first = named_of(scenario, data, "faces", "written")[0]
    assert first.title in (
        "Faces top and below are exchanged",
        "faces.top and faces.below have each other's absorptivity and emissivity",
    )


@pytest.mark.slow
def test_axes_of_the_other_hand_are_named(tmp_path):
    written = boxed()
    faces = written["simulator"]["faces"]
    for name, sign, absorptivity in (("front_cells", 1, 0.8), ("back_cells", -1, 0.3)):
        looks = {"normal": [sign, 0, 0], "absorptivity": absorptivity, "emissivity": 0.8}
        faces[name] = {"node": "body", "area": "0.05 m^2", **looks}
    _, data = small.closed_loop(tmp_path, written)
    for face in faces.values():
        x, y, z = face["normal"]
        face["normal"] = [-x, y, z]
    scenario, _ = small.load(tmp_path, written)
    # The Sun is in the orbit's plane, so half a turn about z looks the same.
    (found,) = [suspicion for suspicion in named(scenario, data) if suspicion.about == "hand"]
    assert found.title == "The body's axes are of the other hand"
    assert "turned to -x, +y, +z" in found.sentence


def winged():
    """The satellite with two wings of two sides, one at each of its nodes."""
    model = boxed()
    faces = model["simulator"]["faces"]
    cells = {"area": "0.06 m^2", "absorptivity": 0.8, "emissivity": 0.8}
    for name, node in (("left", "panel"), ("right", "body")):
        faces[f"{name}_cells"] = cells | {"node": node, "normal": [0, 0, -1]}
        faces[f"{name}_back"] = cells | {"node": node, "normal": [0, 0, 1], "absorptivity": 0.2}
    del faces["outside"], faces["down"], faces["left"]
    return model, faces


@pytest.mark.slow
def test_two_wings_whose_sides_are_exchanged_are_named_together(tmp_path):
    model, faces = winged()
    scenario, _ = small.load(tmp_path, model)
    for name in ("left", "right"):
        front, back = faces[f"{name}_cells"], faces[f"{name}_back"]
        front["normal"], back["normal"] = back["normal"], front["normal"]
    _, data = small.closed_loop(tmp_path, model)
    # With so few other faces all may as well be turned.
    titles = {suspicion.title for suspicion in named(scenario, data)}
    assert titles == {
        "The body's axes are others",
        "The body's axes are of the other hand",
        "Faces left_cells and left_back, right_cells and right_back are exchanged",
    }


@pytest.mark.slow
def test_two_wings_that_a_drive_turns_are_named_together(tmp_path):
    model, faces = winged()
    scenario, _ = small.load(tmp_path, model)
    for name in ("left", "right"):
        faces[f"{name}_cells"]["normal"], faces[f"{name}_back"]["normal"] = DRIVEN
    _, data = small.closed_loop(tmp_path, model)
    first = named(scenario, data)[0]
    assert first.title == "Faces left_cells, left_back, right_cells and right_back look another way"
    assert "With the normal {tracks_sun_about: [0, 1, 0]} of left_cells and right_cells" in first.sentence


@pytest.mark.slow
def test_a_face_at_another_node_is_named(tmp_path):
    written = boxed()
    scenario, _ = small.load(tmp_path, written)
    written["simulator"]["faces"]["ahead"]["node"] = "panel"
    _, data = small.closed_loop(tmp_path, written)
    assert named(scenario, data)[0].title == "Face ahead is of panel, not of body"
