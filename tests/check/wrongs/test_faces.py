"""Faces that look another way or are of another node."""

from tests import small

from ..cases import boxed, named, sunlit


def test_a_face_that_looks_the_other_way_is_named(tmp_path):
    written = sunlit()
    _, data = small.closed_loop(tmp_path, written)
    written["simulator"]["faces"]["outside"]["normal"] = [1, 0, 0]
    scenario, _ = small.load(tmp_path, written)
    assert named(scenario, data)[0].title == "Face outside looks another way"


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


def test_a_face_at_another_node_is_named(tmp_path):
    written = boxed()
    scenario, _ = small.load(tmp_path, written)
    written["simulator"]["faces"]["ahead"]["node"] = "panel"
    _, data = small.closed_loop(tmp_path, written)
    assert named(scenario, data)[0].title == "Face ahead is of panel, not of body"
