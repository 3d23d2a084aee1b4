"""Faces and conductors that the scenario leaves out, and conductors that end at another node."""

import pytest

from tests import small

from ..cases import TRAY, boxed, in_three, named


def test_a_conductor_that_is_missing_is_named(tmp_path):
    written = small.content()
    _, data = small.closed_loop(tmp_path)
    del written["parameters"]["link"], written["simulator"]["conductors"][0]
    scenario, _ = small.load(tmp_path, written)
    assert named(scenario, data)[0].title == "A conductor body-panel is missing in the scenario"


@pytest.mark.parametrize(
    "set_by", [None, pytest.param("tray_link", marks=pytest.mark.slow)], ids=["as it is written", "set by a parameter"]
)
def test_a_conductor_at_another_node_is_named(tmp_path, set_by, named_of):
    written = in_three()
    if set_by:
        prior = {"lognormal": {"median": "0.4 W/K", "factor": 1.3}}
        written["parameters"][set_by] = {"sets": "conductors.outer.conductance", "prior": prior}
    written["simulator"]["conductors"][-1]["name"] = "outer"
    _, data = small.closed_loop(tmp_path, written, columns=TRAY)
    written["simulator"]["conductors"][-1]["between"] = ["panel", "tray"]
    scenario, _ = small.load(tmp_path, written, columns=TRAY)
    assert named_of(scenario, data, "lacking", "written")[0].title == "Conductor outer is of body, not of panel"


@pytest.mark.slow
def test_a_face_of_an_unusual_coating_is_named_with_about_what_it_absorbs(tmp_path):
    written = in_three()
    faces = written["simulator"]["faces"]
    faces["gold"] = {"node": "tray", "area": "0.1 m^2", "normal": [0, 0, -1], "absorptivity": 0.3, "emissivity": 0.1}
    _, data = small.closed_loop(tmp_path, written, columns=TRAY)
    del faces["gold"]
    scenario, _ = small.load(tmp_path, written, columns=TRAY)
    first = named(scenario, data)[0]
    assert first.title == "A face of tray is missing in the scenario"
    area, absorptivity = (float(first.sentence.split(word)[1].split()[0]) for word in ("With ", "absorptivity of "))
    # What is looked at is 1.3 times apart, or less.
    assert area * absorptivity == pytest.approx(0.03, rel=0.35)


CELLS = {"area": "0.06 m^2", "absorptivity": 0.8, "emissivity": 0.8}


def test_a_side_of_a_panel_that_is_left_out_is_named(tmp_path):
    written = boxed()
    faces = written["simulator"]["faces"]
    # More than half of what the panel loses.
    faces["rear"] = CELLS | {"node": "panel", "normal": [0, 0, 1], "absorptivity": 0.3, "area": "0.1 m^2"}
    _, data = small.closed_loop(tmp_path, written)
    del faces["rear"]
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert first.title == "A face of panel is missing in the scenario"
    assert first.advice.startswith("Add the other side of outside to 'simulator: faces'")


@pytest.mark.slow
def test_other_sides_of_two_wings_that_are_left_out_are_named_together(tmp_path):
    written = boxed()
    faces = written["simulator"]["faces"]
    del faces["outside"], faces["down"], faces["left"]
    driven = {"tracks_sun_about": [0, 1, 0]}
    for name, node in (("left", "panel"), ("right", "body")):
        faces[f"{name}_cells"] = CELLS | {"node": node, "normal": driven}
        faces[f"{name}_back"] = CELLS | {"node": node, "normal": driven | {"back": True}, "absorptivity": 0.3}
    _, data = small.closed_loop(tmp_path, written)
    del faces["left_back"], faces["right_back"]
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert first.title == "Faces of panel and body are missing in the scenario"
    assert "the other sides of left_cells and right_cells" in first.sentence


def test_a_face_of_a_node_that_has_none_is_named(tmp_path, named_of):
    written = in_three()
    faces = written["simulator"]["faces"]
    faces["radiator"] = CELLS | {"node": "tray", "normal": [0, 1, 0], "absorptivity": 0.2}
    _, data = small.closed_loop(tmp_path, written, columns=TRAY)
    del faces["radiator"]
    scenario, _ = small.load(tmp_path, written, columns=TRAY)
    assert named_of(scenario, data, "lacking", "faces")[0].title == "A face of tray is missing in the scenario"
