"""Set-ups whose scenario is not of the satellite: heaters, modes, numbers, orbit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .case import Case, SetUp, amount, apart, busy, heated, lit, strong_payload


def _heater_missing(case: Case) -> str:
    return _without_heater(case, keep_status=False)


def _heater_missing_status_there(case: Case) -> str:
    return _without_heater(case, keep_status=True)


def _without_heater(case: Case, keep_status: bool) -> str:
    name = case.heaters[0]
    node = case.written["simulator"]["heaters"].pop(name)["node"]
    del case.written["observations"][f"{name}_status"]
    if not keep_status:
        del case.written["telemetry"]["channels"][f"{name}_status"]
    return str(node)


def _mode_missing(case: Case) -> str:
    node, _ = busy(case)
    del case.written["simulator"]["modes"]["busy"][node]
    case.written["parameters"].pop("power_busy", None)
    return "busy"


def _mode_at_the_wrong_node(case: Case) -> str:
    node, _ = busy(case)
    modes, other = case.written["simulator"]["modes"], _idle(case)[0]
    modes["busy"][other] = modes["busy"].pop(node)
    parameter = case.written["parameters"].get("power_busy")
    if parameter:
        parameter["sets"] = [f"modes.busy.{other}"]
    return "busy"


def _idle(case: Case) -> list[str]:
    """Nodes into which the payload gives no heat."""
    return [name for name in case.model["nodes"] if name not in case.model["modes"]["busy"]]


def _timeline_moved(case: Case) -> str:
    for change in case.written["simulator"]["timeline"]:
        change["at"] = str(np.datetime64(change["at"]) + np.timedelta64(1500, "s"))
    return ""


def _wrong_node(case: Case) -> str:
    channel = case.channels[0]
    node = case.written["observations"][channel]["node"]
    case.written["simulator"]["nodes"][node]["initial"] = f"{case.training[channel].iloc[0]:.2f} degC"
    case.written["observations"][channel]["node"] = next(
        item["node"] for name, item in case.written["observations"].items() if item.get("node") not in (None, node)
    )
    return channel


def _number(path: Callable[[Case], tuple[dict[str, Any], str, str]], factor: float) -> Callable[[Case], str]:
    def spoil(case: Case) -> str:
        block, key, name = path(case)
        value, unit = str(block[key]).split()
        block[key] = f"{float(value) * factor} {unit}"
        return name

    return spoil


def _certain(case: Case) -> list[str]:
    """Observed nodes whose capacity is no parameter."""
    known = {path for item in case.written["parameters"].values() for path in np.atleast_1d(item["sets"])}
    return [
        name
        for name in case.model["nodes"]
        if f"nodes.{name}.capacity" not in known and f"{name}_temp" in case.channels
    ]


def _capacity(case: Case) -> tuple[dict[str, Any], str, str]:
    node = _certain(case)[0]
    return case.model["nodes"][node], "capacity", f"nodes.{node}.capacity"


def _every_capacity(case: Case) -> str:
    """Of the structure without what is built in."""
    for node in case.model["nodes"].values():
        if "capacity" in node:
            node["capacity"] = f"{0.6 * amount(node['capacity']):.1f} J/K"
    for name, parameter in case.written["parameters"].items():
        if name.startswith("capacity_"):
            lognormal = parameter["prior"]["lognormal"]
            lognormal["median"] = f"{0.6 * amount(lognormal['median']):.1f} J/K"
    return "every capacity"


def _area(case: Case) -> tuple[dict[str, Any], str, str]:
    face = max(case.model["faces"], key=lambda name: float(case.model["faces"][name]["area"].split()[0]))
    return case.model["faces"][face], "area", f"faces.{face}.area"


def _attitude(case: Case) -> str:
    case.written["environment"]["attitude"] = (
        "nadir" if case.written["environment"]["attitude"] == "sun_pointing" else "sun_pointing"
    )
    return ""


def _ltan(case: Case) -> str:
    orbit = case.written["environment"]["orbit"]
    orbit["ltan"] = f"{(int(orbit['ltan'][:2]) + 6) % 24:02d}:30"
    return ""


def _heater_dead(case: Case) -> str:
    name = case.heaters[0]
    case.written["simulator"]["heaters"][name]["power"] = "200 W"
    return name


def _heater_at_the_wrong_node(case: Case) -> str:
    name = case.heaters[0]
    heater = case.written["simulator"]["heaters"][name]
    heater["node"] = next(node for node in case.model["nodes"] if node != heater["node"])
    return name


def _thresholds(case: Case) -> str:
    heater = case.written["simulator"]["heaters"][case.heaters[0]]
    for key in ("on_below", "off_above"):
        heater[key] = f"{float(heater[key].split()[0]) + 7.0:.1f} K"
    return case.heaters[0]


def _power(case: Case) -> tuple[dict[str, Any], str, str]:
    return case.model["heaters"][case.heaters[0]], "power", case.heaters[0]


def _orbit(change: Callable[[dict[str, Any]], dict[str, str]]) -> Callable[[Case], str]:
    def spoil(case: Case) -> str:
        orbit = case.written["environment"]["orbit"]
        orbit |= change(orbit)
        return ""

    return spoil


def _outside(case: Case) -> str:
    """The face that matters most."""
    return max(case.model["faces"], key=lambda name: amount(case.model["faces"][name]["area"]))


def _face_turned(case: Case) -> str:
    face = case.written["simulator"]["faces"][_outside(case)]
    face["normal"] = [-x for x in face["normal"]]
    return _outside(case)


def _link(case: Case) -> dict[str, Any]:
    """The conductor that matters most."""
    return max(case.written["simulator"]["conductors"], key=lambda item: amount(item["conductance"]))


def _link_missing(case: Case) -> str:
    link = _link(case)
    case.written["simulator"]["conductors"].remove(link)
    between = "-".join(link["between"])
    case.written["parameters"].pop(f"link_{link['between'][0]}_{link['between'][1]}", None)
    return between


def _link_tenfold(case: Case) -> str:
    link = _link(case)
    link["conductance"] = f"{10.0 * amount(link['conductance']):.3f} W/K"
    case.written["parameters"].pop(f"link_{link['between'][0]}_{link['between'][1]}", None)
    return f"conductors.{'-'.join(link['between'])}.conductance"


def _uncertain_capacity(case: Case) -> list[str]:
    """Parameters that are capacities of observed nodes."""
    return [
        name
        for name in case.written["parameters"]
        if name.startswith("capacity_") and f"{name.removeprefix('capacity_')}_temp" in case.channels
    ]


def _prior_far_off(case: Case) -> str:
    name = _uncertain_capacity(case)[0]
    median = f"{2.5 * case.flight.truth[name]:.1f} J/K"
    case.written["parameters"][name]["prior"] = {"lognormal": {"median": median, "factor": 1.05}}
    return name


def _certain_emissivities(case: Case) -> list[str]:
    """Faces of observed nodes whose emissivity is no parameter."""
    known = {path for item in case.written["parameters"].values() for path in np.atleast_1d(item["sets"])}
    faces = case.model["faces"]
    return [
        name
        for name, face in faces.items()
        if f"faces.{name}.emissivity" not in known and f"{face['node']}_temp" in case.channels
    ]


def _emissivity(case: Case) -> str:
    faces = case.written["simulator"]["faces"]
    name = max(_certain_emissivities(case), key=lambda item: amount(faces[item]["area"]))
    faces[name]["emissivity"] = round(faces[name]["emissivity"] / 3.0, 3)
    return f"faces.{name}.emissivity"


def _timeline_of_another(case: Case) -> str:
    case.written["simulator"]["timeline"] = case.other.satellite.written["simulator"]["timeline"]
    return ""


SETUPS = (
    SetUp("heater missing", 10, ("missing heat",), _heater_missing, heated),
    SetUp("heater missing, its status there", 11, ("missing heat",), _heater_missing_status_there, heated),
    SetUp("mode without its power", 12, ("mode",), _mode_missing, strong_payload),
    SetUp("a channel at the wrong node", 19, ("other node",), _wrong_node, apart),
    SetUp("capacity ten times", 23, ("number",), _number(_capacity, 10.0), lambda c: lit(c) and bool(_certain(c))),
    SetUp("area in the wrong unit", 24, ("number",), _number(_area, 0.1), lit),
    SetUp("another attitude", 25, ("attitude",), _attitude, lit),
    SetUp("another plane of the orbit", 26, ("orbit",), _ltan, lit),
    SetUp("a heater of ten times the power", 27, ("heater", "number"), _heater_dead, heated),
    SetUp("a heater at the wrong node", 28, ("heater",), _heater_at_the_wrong_node, heated),
    SetUp(
        "a payload at the wrong node",
        32,
        ("mode",),
        _mode_at_the_wrong_node,
        lambda c: strong_payload(c) and bool(_idle(c)),
    ),
    SetUp("timeline 25 min late", 33, ("mode",), _timeline_moved, strong_payload),
    SetUp("a heater of half the power", 40, ("heater", "number"), _number(_power, 0.5), heated),
    SetUp("a heater of twice the power", 41, ("heater", "number"), _number(_power, 2.0), heated),
    SetUp("thresholds 7 K higher", 42, ("thresholds",), _thresholds, heated),
    SetUp("capacity half", 44, ("number",), _number(_capacity, 0.5), lambda c: lit(c) and bool(_certain(c))),
    SetUp("every capacity six tenths", 116, ("number",), _every_capacity, lambda c: lit(c) and bool(_certain(c))),
    SetUp("area twice", 45, ("number",), _number(_area, 2.0), lit),
    SetUp("a face turned over", 46, ("face",), _face_turned, lit),
    SetUp("a conductor missing", 47, ("link",), _link_missing, lambda c: len(c.model["nodes"]) > 2),
    SetUp("a conductor of ten times", 48, ("number",), _link_tenfold, lit),
    SetUp("a prior that is far off", 49, ("prior",), _prior_far_off, lambda c: bool(_uncertain_capacity(c))),
    SetUp(
        "altitude half as much again",
        50,
        ("orbit",),
        _orbit(lambda o: {"altitude": f"{1.5 * amount(o['altitude'])} m"}),
        lit,
    ),
    SetUp(
        "inclination 40 deg off",
        51,
        ("orbit",),
        _orbit(lambda o: {"inclination": f"{amount(o['inclination']) - 40.0} deg"}),
        lit,
    ),
    SetUp("emissivity a third", 56, ("number",), _emissivity, lambda c: lit(c) and bool(_certain_emissivities(c))),
    SetUp("timeline of another satellite", 57, ("mode",), _timeline_of_another, strong_payload),
)
