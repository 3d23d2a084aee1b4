"""Meshes against what they must conserve."""

import numpy as np
import pytest

from flightcal.errors import FlightcalError
from flightcal.scenario.body import Body, Box, Coating, Insulation, Joint, Material, Plate, Side
from flightcal.scenario.geometry import SPACE, mesh_plates


def meshed(plates=None, joints=(), boxes=None):
    """The mesh of plates and boxes by name."""
    materials = {"aluminium": Material(conductivity=150.0, density=2700.0, specific_heat=900.0)}
    coatings = {"white": Coating(0.2, 0.85), "black": Coating(0.9, 0.9)}
    insulations = {"blanket": Insulation(0.02, "white")}
    return mesh_plates(
        Body(
            materials=materials,
            coatings=coatings,
            insulations=insulations,
            boxes=boxes or {},
            plates=plates or {},
            joints=tuple(joints),
        )
    )


def strip(mesh, **sides):
    return Plate((0.0, 0.0, 0.0), (2.0, 0.5, 0.0), 0.01, "aluminium", mesh, **sides)


def conductance_matrix(mesh):
    names = list(mesh.nodes)
    matrix = np.zeros((len(names), len(names)))
    for conductor in mesh.conductors:
        if conductor.conductance is not None:
            i, j = (names.index(name) for name in conductor.between)
            matrix[[i, j], [i, j]] += conductor.conductance
            matrix[i, j] -= conductor.conductance
            matrix[j, i] -= conductor.conductance
    return names, matrix


def between(mesh, first, second):
    """W/K from one node to another, all others floating."""
    names, matrix = conductance_matrix(mesh)
    power = np.zeros(len(names))
    power[names.index(first)], power[names.index(second)] = 1.0, -1.0
    temperature = np.linalg.lstsq(matrix, power, rcond=None)[0]
    return 1.0 / (temperature[names.index(first)] - temperature[names.index(second)])


@pytest.mark.parametrize("mesh", [(1, 1), (8, 3)])
def test_capacity_is_that_of_the_material(mesh):
    found = sum(node.capacity for node in meshed({"strip": strip(mesh)}).nodes.values())
    assert found == pytest.approx(2700.0 * 900.0 * 2.0 * 0.5 * 0.01)


def test_a_strip_conducts_as_a_bar():
    found = between(meshed({"strip": strip((10, 1))}), "strip[0,0]", "strip[9,0]")
    assert found == pytest.approx(150.0 * 0.5 * 0.01 / (0.9 * 2.0))
    across = between(meshed({"strip": strip((1, 10))}), "strip[0,0]", "strip[0,9]")
    assert across == pytest.approx(150.0 * 2.0 * 0.01 / (0.9 * 0.5))


def test_a_joint_is_two_half_cells_and_the_contact_in_series():
    wall = Plate((2.0, 0.0, 0.0), (0.0, 0.5, 1.0), 0.01, "aluminium", (5, 4))
    mesh = meshed({"strip": strip((4, 5)), "wall": wall}, [Joint(("strip", "wall"), 30.0)])
    joints = [c for c in mesh.conductors if {n.split("[")[0] for n in c.between} == {"strip", "wall"}]
    assert len(joints) == 5
    sheet = 150.0 * 0.01 * 0.1
    expected = 1.0 / (0.25 / sheet + 0.125 / sheet + 1.0 / (30.0 * 0.1))
    assert [joint.conductance for joint in joints] == pytest.approx([expected] * 5)


def test_a_joint_of_other_meshes_keeps_the_length_of_the_edge():
    wall = Plate((2.0, 0.1, 0.0), (0.0, 0.4, 1.0), 0.01, "aluminium", (3, 2))
    mesh = meshed({"strip": strip((4, 5)), "wall": wall}, [Joint(("strip", "wall"), 1e-6)])
    joints = [c for c in mesh.conductors if {n.split("[")[0] for n in c.between} == {"strip", "wall"}]
    assert sum(joint.conductance for joint in joints) == pytest.approx(1e-6 * 0.4, rel=1e-4)


def test_a_closed_box_exchanges_within_itself_and_faces_outwards():
    bus = Box((0.0, 0.0, 0.0), (1.0, 0.8, 0.6), 0.002, "aluminium", 3, Side("white"), "black", joints=20.0)
    mesh = meshed(boxes={"bus": bus})
    assert len(mesh.nodes) == 54
    assert SPACE not in mesh.nodes
    assert mesh.openness["bus"] < 1e-9
    assert sum(face.area for face in mesh.faces.values()) == pytest.approx(2 * (0.8 + 0.6 + 0.48))
    outward = np.zeros(3)
    for face in mesh.faces.values():
        outward += face.area * np.array(face.normal)
    np.testing.assert_allclose(outward, 0.0, atol=1e-12)
    _, matrix = conductance_matrix(mesh)
    assert np.linalg.matrix_rank(matrix, tol=1e-9) == 53, "the twelve joints hold the box together"
    # A black box in a black box would give each cell its area; here nearly that (emissivity 0.9).
    exchanged = sum(c.radiative for c in mesh.conductors if c.radiative is not None and "bus.x-[0,0]" in c.between)
    area = 0.8 * 0.6 / 9
    assert 0.8 * 0.9 * area < exchanged < area


def test_insulation_is_a_thin_layer_with_its_own_coating():
    side = Side("black", insulation="blanket")
    mesh = meshed({"strip": strip((2, 2), positive=side)})
    layers = {name: node.capacity for name, node in mesh.nodes.items() if name.endswith("insulation")}
    assert layers == pytest.approx(dict.fromkeys(layers, 77.0 * 0.25))
    assert len(layers) == 4
    assert {face.node for face in mesh.faces.values()} == set(layers)
    assert {face.emissivity for face in mesh.faces.values()} == {0.85}
    assert [c.radiative for c in mesh.conductors if c.radiative is not None] == pytest.approx([0.02 * 0.25] * 4)


def test_what_an_open_enclosure_loses_goes_to_space():
    below = strip((1, 1), positive=Side("black", enclosure="gap"))
    above = Plate((0.0, 0.0, 0.3), (2.0, 0.5, 0.0), 0.01, "aluminium", (1, 1), negative=Side("black", "gap"))
    mesh = meshed({"strip": below, "lid": above})
    assert 0.1 < mesh.openness["gap"] < 0.9
    out = [c.radiative for c in mesh.conductors if SPACE in c.between]
    across = [c.radiative for c in mesh.conductors if c.radiative is not None and SPACE not in c.between]
    assert len(out) == 2
    assert len(across) == 1
    assert out[0] + across[0] < 0.9 * 1.0


@pytest.mark.parametrize(
    ("plates", "joints", "message"),
    [
        ({"p": Plate((0, 0, 0), (1.0, 1.0, 1.0), 0.01, "aluminium", (1, 1))}, [], "exactly one zero"),
        ({"strip": strip((1, 1))}, [Joint(("strip", "wall"), 1.0)], "found no plate 'wall'"),
        (
            {"strip": strip((1, 1)), "far": Plate((5.0, 0.0, 0.0), (0.0, 1.0, 1.0), 0.01, "aluminium", (1, 1))},
            [Joint(("strip", "far"), 1.0)],
            "found strip and far without a common edge",
        ),
    ],
)
def test_what_is_no_plate_or_joint_is_an_error(plates, joints, message):
    with pytest.raises(FlightcalError, match=message):
        meshed(plates, joints)


def test_sides_one_behind_the_other_are_an_error():
    side = {"negative": Side("black", enclosure="gap")}
    lids = {
        f"lid{k}": Plate((0.0, 0.0, z), (2.0, 0.5, 0.0), 0.01, "aluminium", (1, 1), **side)
        for k, z in enumerate((0.02, 0.03))
    }
    floor = strip((1, 1), positive=Side("black", enclosure="gap"))
    with pytest.raises(FlightcalError, match="sides overlap, or stand behind one another"):
        meshed({"floor": floor, **lids})
