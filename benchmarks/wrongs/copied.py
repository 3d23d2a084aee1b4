"""Set-ups whose scenario was copied wrongly from drawings, tests or the mission's documents."""

from __future__ import annotations

import numpy as np

from .case import Case, SetUp, amount, busy, heated, lit, strong_payload


def _sets(case: Case) -> set[str]:
    """Paths that parameters set."""
    return {path for item in case.written["parameters"].values() for path in np.atleast_1d(item.get("sets", []))}


def _upside_down(case: Case) -> str:
    """Nadir and zenith confused: both faces, all areas and coatings as they are."""
    for face in case.written["simulator"]["faces"].values():
        if face["normal"] != "all":
            x, y, z = face["normal"]
            face["normal"] = [x, -y, -z]
    return ""


def _has_z(case: Case) -> bool:
    faces = case.model["faces"].values()
    return lit(case) and case.written["environment"]["attitude"] == "nadir" and any(f["normal"][2] for f in faces)


def _no_albedo(case: Case) -> str:
    case.written["environment"]["albedo"] = 0
    return "environment.albedo"


def _no_infrared(case: Case) -> str:
    case.written["environment"]["earth_infrared"] = "0 W/m^2"
    return "environment.earth_infrared"


def _no_earth(case: Case) -> str:
    case.written["environment"] |= {"earth_infrared": "0 W/m^2", "albedo": 0}
    return "environment"


def _solar_constant(case: Case) -> str:
    case.written["environment"]["solar_constant"] = "136.1 W/m^2"
    return "environment.solar_constant"


def _milliwatts(case: Case) -> str:
    node, power = busy(case)
    case.written["simulator"]["modes"]["busy"][node] = f"{1000.0 * power} W"
    case.written["parameters"].pop("power_busy", None)
    return ""


def _half_a_day(case: Case) -> str:
    """The hour of the descending node for that of the ascending one."""
    orbit = case.written["environment"]["orbit"]
    orbit["ltan"] = f"{(int(orbit['ltan'][:2]) + 12) % 24:02d}:30"
    return ""


def _never_in_shadow(case: Case) -> str:
    """An eclipse by a flag that always says sunlight."""
    case.table["eclipse"] = 0.0
    case.written["telemetry"]["channels"]["eclipse"] = {"column": "eclipse", "kind": "status"}
    case.written["environment"]["eclipse"] = {"measured_by": "eclipse"}
    return ""


def _interchanged(case: Case) -> str:
    name = max(_coated(case), key=lambda item: amount(case.model["faces"][item]["area"]))
    face = case.written["simulator"]["faces"][name]
    face["absorptivity"], face["emissivity"] = face["emissivity"], face["absorptivity"]
    return f"faces.{name}"


def _coated(case: Case) -> list[str]:
    """Faces of fixed and unlike coatings."""
    known = _sets(case)
    return [
        name
        for name, face in case.model["faces"].items()
        if not {f"faces.{name}.emissivity", f"faces.{name}.absorptivity"} & known
        and abs(face["emissivity"] - face["absorptivity"]) > 0.2
    ]


def _in_grams(case: Case) -> str:
    """A capacity in kJ/K is written as J/K."""
    node = _fixed_nodes(case)[0]
    block = case.written["simulator"]["nodes"][node]
    block["capacity"] = f"{0.001 * amount(block['capacity'])} J/K"
    return f"nodes.{node}.capacity"


def _fixed_nodes(case: Case) -> list[str]:
    known = _sets(case)
    return [n for n in case.model["nodes"] if f"nodes.{n}.capacity" not in known and f"{n}_temp" in case.channels]


def _capacities_swapped(case: Case) -> str:
    nodes = case.written["simulator"]["nodes"]
    a, b = _unlike(case)
    nodes[a]["capacity"], nodes[b]["capacity"] = nodes[b]["capacity"], nodes[a]["capacity"]
    return f"nodes.{a}.capacity nodes.{b}.capacity"


def _unlike(case: Case) -> list[str]:
    fixed = sorted(_fixed_nodes(case), key=lambda n: amount(case.model["nodes"][n]["capacity"]))
    if len(fixed) < 2 or amount(case.model["nodes"][fixed[-1]]["capacity"]) < 2.5 * amount(
        case.model["nodes"][fixed[0]]["capacity"]
    ):
        return []
    return [fixed[0], fixed[-1]]


def _face_at_another_node(case: Case) -> str:
    faces = case.written["simulator"]["faces"]
    name = max(faces, key=lambda item: amount(faces[item]["area"]))
    faces[name]["node"] = next(node for node in case.model["nodes"] if node != faces[name]["node"])
    return name


def _sensor_elsewhere(case: Case) -> str:
    heater = case.written["simulator"]["heaters"][case.heaters[0]]
    heater["sensor"] = next(n for n in case.model["nodes"] if n != heater["sensor"] and f"{n}_temp" in case.channels)
    return case.heaters[0]


def _link_elsewhere(case: Case) -> str:
    """A conductor begins at another node."""
    links = case.written["simulator"]["conductors"]
    link = max(links, key=lambda item: amount(item["conductance"]))
    a, b = link["between"]
    taken = {frozenset(link["between"]) for link in links}
    other = next(n for n in case.model["nodes"] if n not in (a, b) and frozenset((n, b)) not in taken)
    link["between"] = [other, b]
    for path_of in case.written["parameters"].values():
        if path_of.get("sets") == f"conductors.{a}-{b}.conductance":
            path_of["sets"] = f"conductors.{other}-{b}.conductance"
    return f"{a}-{b}"


def _can_be_elsewhere(case: Case) -> bool:
    try:
        _link_elsewhere(case.copy())
    except StopIteration:
        return False
    return lit(case)


def _face_left_out(case: Case) -> str:
    """The largest face is not in the scenario, nor what sets its numbers."""
    faces = case.written["simulator"]["faces"]
    name = max(faces, key=lambda item: amount(faces[item]["area"]))
    node = faces.pop(name)["node"]
    parameters = case.written["parameters"]
    for path in [p for p, item in parameters.items() if f"faces.{name}." in str(item.get("sets", ""))]:
        del parameters[path]
    return str(node)


def _sensor_of_no_other(case: Case) -> str:
    """The only sensor of a node is said to be of its neighbour, and the node to begin at 0 degC."""
    observations = case.written["observations"]
    channel = f"{_fixed_nodes(case)[0]}_temp"
    node = observations[channel]["node"]
    observations[channel]["node"] = next(n for n in case.model["nodes"] if n != node and f"{n}_temp" in case.channels)
    case.written["simulator"]["nodes"][node]["initial"] = "0 degC"
    return channel


def _modes_exchanged(case: Case) -> str:
    """Busy is called idle, and idle busy."""
    for change in case.written["simulator"]["timeline"]:
        change["mode"] = "idle" if change["mode"] == "busy" else "busy"
    return ""


SETUPS = (
    SetUp("nadir and zenith confused", 80, ("attitude", "face"), _upside_down, _has_z),
    SetUp("no albedo", 81, ("number",), _no_albedo, lit),
    SetUp("no infrared of the Earth", 82, ("number",), _no_infrared, lit),
    SetUp("neither of the Earth", 83, ("number",), _no_earth, lit),
    SetUp("a solar constant of a tenth", 84, ("number",), _solar_constant, lit),
    SetUp("a payload's power in mW", 85, ("number", "mode"), _milliwatts, strong_payload),
    SetUp("descending for ascending node", 86, ("orbit", "clock"), _half_a_day, lit),
    SetUp("an eclipse that never comes", 87, ("eclipse", "orbit", "everything"), _never_in_shadow, lit),
    SetUp(
        "emissivity and absorptivity changed",
        88,
        ("exchanged", "number"),
        _interchanged,
        lambda c: lit(c) and bool(_coated(c)),
    ),
    SetUp("a capacity of a thousandth", 89, ("number",), _in_grams, lambda c: lit(c) and bool(_fixed_nodes(c))),
    SetUp(
        "two capacities swapped",
        90,
        ("exchanged", "number"),
        _capacities_swapped,
        lambda c: lit(c) and bool(_unlike(c)),
    ),
    SetUp("a face at another node", 91, ("face", "number"), _face_at_another_node, lit),
    SetUp(
        "a thermostat's sensor elsewhere",
        92,
        ("thresholds", "thermostat"),
        _sensor_elsewhere,
        lambda c: heated(c) and len(c.channels) > 1,
    ),
    SetUp("a conductor elsewhere", 93, ("link", "number"), _link_elsewhere, _can_be_elsewhere),
    SetUp("a face left out", 95, ("face",), _face_left_out, lambda c: lit(c) and len(c.model["faces"]) > 2),
    SetUp(
        "a sensor at another node, its own with none",
        96,
        ("other node",),
        _sensor_of_no_other,
        lambda c: bool(_fixed_nodes(c)) and len(c.channels) > 2,
    ),
    SetUp("modes exchanged", 94, ("mode",), _modes_exchanged, strong_payload),
)
