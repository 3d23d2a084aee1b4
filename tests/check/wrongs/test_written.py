"""Numbers of the scenario, and priors."""

from types import SimpleNamespace

import numpy as np
import pytest

from flightcal.check.prepared import prepared
from flightcal.check.wrongs.written import exchanged, numbers, priors
from flightcal.scenario import LogNormal
from tests import small

from ..cases import boxed, named, sunlit, switching, two_faced


def test_a_narrow_prior_that_is_far_off_is_named(flown):
    scenario, data = flown
    prior = LogNormal(median=2.0, factor=1.05)
    link = scenario.parameters["link"].model_copy(update={"prior": prior})
    first = named(scenario.model_copy(update={"parameters": {**scenario.parameters, "link": link}}), data)[0]
    assert (first.kind, first.about) == ("prior", "link")


@pytest.mark.parametrize("times", [1.4, 1.0 / 1.4])
def test_a_number_that_is_off_by_two_fifths_is_named(tmp_path, named_of, times):
    """What it does is nearer to nothing wrong than to half or twice of it."""
    written = boxed()
    _, data = small.closed_loop(tmp_path, written)
    written["simulator"]["faces"]["outside"]["absorptivity"] *= times
    scenario, _ = small.load(tmp_path, written)
    first = named_of(scenario, data, "written")[0]
    assert (first.kind, first.about) == ("number", "faces.outside.absorptivity")


@pytest.mark.parametrize(("value", "checks"), [(0.9, ""), (1.2, "; no surface has so much: check faces.outside.area")])
def test_an_emissivity_above_one_is_an_area(tmp_path, value, checks):
    written = sunlit()
    prior = {"lognormal": {"median": 0.8, "factor": 1.02}}
    written["parameters"] = {"outside_emissivity": {"sets": "faces.outside.emissivity", "prior": prior}}
    view = prepared(*small.closed_loop(tmp_path, written))
    (wrong,) = priors(view)
    theta = view.problem.priors.median()
    theta[view.problem.names.index("outside_emissivity")] = value
    told = wrong.words(SimpleNamespace(z=view.problem.to_z(theta), added=[9.0]))
    assert told.advice == f"Check the prior of outside_emissivity, and its unit{checks}"


@pytest.mark.parametrize("times", [3.0, 1.0 / 3.0])
def test_a_narrow_prior_that_is_three_times_off_is_told_with_what_it_should_be(tmp_path, times):
    written = small.content()
    prior = {"lognormal": {"median": "800 J/K", "factor": 1.03}}
    written["parameters"]["panel_capacity"] = {"sets": "nodes.panel.capacity", "prior": prior}
    _, data = small.closed_loop(tmp_path, written)
    prior["lognormal"]["median"] = f"{800.0 * times} J/K"
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert (first.kind, first.about) == ("prior", "panel_capacity")
    found = float(first.sentence.split("median of ")[1].split()[0])
    assert found == pytest.approx(800.0, rel=0.1)


@pytest.mark.slow
def test_the_prior_of_a_capacity_in_another_unit_is_named_by_how_many_times(tmp_path):
    written = small.content()
    prior = {"lognormal": {"median": "3000 J/K", "factor": 1.15}}
    written["parameters"]["body_capacity"] = {"sets": "nodes.body.capacity", "prior": prior}
    scenario, data = small.closed_loop(tmp_path, written)
    assert named(scenario, data) == ()
    prior["lognormal"]["median"] = "3 J/K"
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert (first.kind, first.about) == ("prior", "body_capacity")
    assert first.title.endswith("is 0.0010 times what it should be")


@pytest.mark.slow
def test_coatings_that_are_exchanged_on_every_face_are_named(tmp_path):
    written = boxed()
    scenario, _ = small.load(tmp_path, written)
    for face in written["simulator"]["faces"].values():
        face["absorptivity"], face["emissivity"] = face["emissivity"], face["absorptivity"]
    _, data = small.closed_loop(tmp_path, written)
    first = named(scenario, data)[0]
    assert (first.kind, first.about) == ("number", "every coating")


@pytest.mark.parametrize(
    "left_out", [{"earth_infrared": 0}, pytest.param({"earth_infrared": 0, "albedo": 0}, marks=pytest.mark.slow)]
)
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


def test_a_number_of_the_sun_is_not_mended_by_one_that_cannot_be(tmp_path):
    view = prepared(*small.closed_loop(tmp_path, sunlit()))
    tried = {wrong.about for wrong in numbers(view)}
    assert "environment.solar_constant" not in tried
    assert "faces.outside.area" in tried


def test_of_an_area_that_is_far_too_large_insulation_is_told_too(tmp_path):
    view = prepared(*small.closed_loop(tmp_path, sunlit()))
    advice = {wrong.words.title: wrong.words.advice for wrong in numbers(view) if wrong.about == "faces.outside.area"}
    assert "whether insulation covers it" in advice["faces.outside.area is 100.0 times what it should be"]
    assert "insulation" not in advice["faces.outside.area is 2.0 times what it should be"]


@pytest.mark.parametrize("uncertain", [False, pytest.param(True, marks=pytest.mark.slow)])
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


def test_the_two_numbers_of_a_coating_are_exchanged_where_a_body_has_many_faces(tmp_path):
    written = boxed()
    faces = written["simulator"]["faces"]
    faces["outside"] |= {"absorptivity": 0.2, "emissivity": 0.7}
    for k in range(12):
        faces[f"drum_{k}"] = {
            **faces["outside"],
            "normal": [float(np.cos(k)), float(np.sin(k)), 0.0],
            "absorptivity": 0.3 + 0.01 * k,
        }
    view = prepared(*small.closed_loop(tmp_path, written))
    assert view is not None
    tried = [wrong.about for wrong in exchanged(view)]
    assert "faces.outside.absorptivity faces.outside.emissivity" in tried
    assert "faces.drum_0.absorptivity faces.drum_1.absorptivity" not in tried


def test_faces_of_one_parameter_are_exchanged_with_others_once(tmp_path):
    written = boxed()
    faces = written["simulator"]["faces"]
    faces["outside"] |= {"absorptivity": 0.2, "emissivity": 0.7}
    both = [f"faces.{name}.absorptivity" for name in ("ahead", "back")]
    around = {"mean": 0.5, "standard_deviation": 0.06, "lower": 0.02, "upper": 0.98}
    written["parameters"]["painted"] = {"sets": both, "prior": {"truncated_normal": around}}
    view = prepared(*small.closed_loop(tmp_path, written))
    tried = [wrong for wrong in exchanged(view) if "outside" in wrong.about and wrong.about.count("absorptivity") == 2]
    entry = view.problem.names.index("painted")
    moved = [wrong for wrong in tried if dict(wrong.moved).get(entry)]
    assert len(moved) == 1
    # Of each kind few are looked at closely; these take no place of priors that are far off.
    assert {wrong.kind for wrong in exchanged(view)} == {"exchanged"}
    assert dict(moved[0].moved)[entry] == pytest.approx(0.4, rel=0.05)


@pytest.mark.slow
def test_a_number_of_the_sun_that_cannot_be_is_named(tmp_path):
    written = boxed()
    _, data = small.closed_loop(tmp_path, written)
    written["environment"]["solar_constant"] = "800 W/m^2"
    scenario, _ = small.load(tmp_path, written)
    assert named(scenario, data)[0].about == "environment.solar_constant"


@pytest.mark.slow
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
    found = {suspicion.about: suspicion.nats for suspicion in named(scenario, data)}
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


def test_no_part_holds_far_more_heat_than_all_others(flown):
    """Such a capacity would explain every channel that hardly changes."""
    scenario, data = flown
    titles = [wrong.words.title for wrong in numbers(prepared(scenario, data)) if ".capacity" in wrong.about]
    assert "nodes.panel.capacity is 0.1000 times what it should be" in titles
    assert "nodes.body.capacity is 1000 times what it should be" in titles
    assert not any("body.capacity is 0.001" in title or "panel.capacity is 0.01" in title for title in titles)


def test_a_face_whose_absorptivity_and_emissivity_are_exchanged_is_named(tmp_path):
    written = two_faced()
    name, face = next(iter(written["simulator"]["faces"].items()))
    face["absorptivity"], face["emissivity"] = 0.2, 0.8
    _, data = small.closed_loop(tmp_path, written)
    face["absorptivity"], face["emissivity"] = 0.8, 0.2
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert first.title == f"Absorptivity and emissivity of faces.{name} are exchanged"


def test_values_are_told_with_their_units(flown):
    view = prepared(*flown)
    sentences = {wrong.words.title: wrong.words.sentence for wrong in numbers(view)}
    told = sentences["nodes.panel.capacity is 0.1000 times what it should be"]
    assert told == "The telemetry agrees with 8000 J/K, not 800.0 J/K."


def test_an_area_in_square_centimetres_is_named_as_such(tmp_path):
    """Heat of hundreds of kilowatts explains it nearly as well."""
    written = boxed()
    _, data = small.closed_loop(tmp_path, written)
    written["simulator"]["faces"]["back"]["area"] = "400 m^2"
    scenario, _ = small.load(tmp_path, written)
    assert named(scenario, data)[0].title.startswith("faces.back.area is 10000 times")


@pytest.mark.parametrize(("flown", "written"), [("4 K", "4 degC"), ("20 degC", "20 K")])
def test_a_node_that_is_held_in_another_unit_is_named_with_the_right_one(tmp_path, flown, written):
    content = small.content()
    content["simulator"]["nodes"]["space"]["boundary"] = flown
    _, data = small.closed_loop(tmp_path, content)
    content["simulator"]["nodes"]["space"]["boundary"] = written
    scenario, _ = small.load(tmp_path, content)
    first = named(scenario, data)[0]
    assert (first.kind, first.about) == ("number", "nodes.space.boundary")
    value, unit = flown.split()
    assert f"{float(value):.3g}"[0] in first.advice
    assert f" {unit}' in 'nodes.space.boundary'" in first.advice


@pytest.mark.parametrize("uncertain", [False, True])
def test_what_all_modes_bring_to_a_node_is_wrong_by_one_factor(tmp_path, named_of, uncertain):
    """As that of one of two equal boxes is."""
    _, data = small.closed_loop(tmp_path, switching(idle={"panel": "12 W"}, busy={"panel": "24 W"}))
    written = switching(idle={"panel": "6 W"}, busy={"panel": "12 W"})
    if uncertain:
        prior = {"normal": {"mean": "12 W", "standard_deviation": "0.6 W"}}
        written["parameters"]["busy"] = {"sets": "modes.busy.panel", "prior": prior}
    scenario, _ = small.load(tmp_path, written)
    first = named_of(scenario, data, "written", "heat")[0]
    assert first.about == "the power of every mode in panel"
    assert float(first.title.partition(" is ")[2].split()[0]) == pytest.approx(0.5, rel=0.15)
