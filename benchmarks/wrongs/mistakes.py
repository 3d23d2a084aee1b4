"""Set-ups with an engineer's mistakes: of frames, time systems, conventions and copied numbers."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import numpy as np

from flightcal.environment import sunlit_share
from flightcal.scenario import load_scenario

from .case import Case, SetUp, amount, heated, lit, several

_EARTH = 6378.137e3


def _from_the_centre(case: Case) -> str:
    """The orbit's radius is written as its altitude."""
    orbit = case.written["environment"]["orbit"]
    orbit["altitude"] = f"{amount(orbit['altitude']) + _EARTH} m"
    for window in case.written["windows"].values():
        seconds = round(window.pop("orbits") * case.flight.satellite.period)
        window["end"] = str(np.datetime64(window["start"]) + np.timedelta64(seconds, "s"))
    return ""


def _other_beta(case: Case) -> str:
    """The Sun stands on the other side of the orbit's plane."""
    orbit = case.written["environment"]["orbit"]
    hour, minute = map(int, orbit["ltan"].split(":"))
    noon = 720 if hour < 18 and hour >= 6 else 0
    minutes = (2 * noon - 60 * hour - minute) % 1440
    orbit["ltan"] = f"{minutes // 60:02d}:{minutes % 60:02d}"
    return ""


def _other_day(case: Case) -> str:
    """The epoch is of a day later than the elements."""
    orbit = case.written["environment"]["orbit"]
    orbit["epoch"] = str(np.datetime64(orbit["epoch"]) + np.timedelta64(1, "D"))
    return ""


def _days_old(case: Case) -> str:
    """The epoch is of ten days before the elements."""
    orbit = case.written["environment"]["orbit"]
    orbit["epoch"] = str(np.datetime64(orbit["epoch"]) - np.timedelta64(10, "D"))
    return ""


def _file_in_local_time(case: Case) -> str:
    """The second half of the channels was merged from a file of Central European time."""
    chosen = case.channels[len(case.channels) // 2 :]
    times = case.table["time"].to_numpy().astype("datetime64[s]")
    case.table["local"] = np.datetime_as_string(times + np.timedelta64(1, "h"))
    telemetry = case.written["telemetry"]
    file = telemetry.pop("file")
    telemetry.pop("time")
    telemetry["packets"] = {name: {"file": file, "time": {"column": name}} for name in ("time", "local")}
    for name, channel in telemetry["channels"].items():
        channel["packet"] = "local" if name in chosen else "time"
    train = case.written["windows"]["train"]
    train["start"] = str(np.datetime64(train["start"]) + np.timedelta64(1, "h"))
    return ""


def _columns_shifted(case: Case) -> str:
    names = sorted(case.channels)
    case.table[names] = case.table[[*names[1:], names[0]]].to_numpy()
    return ""


def _milliwatts_per_kelvin(case: Case) -> str:
    link = max(case.written["simulator"]["conductors"], key=lambda item: amount(item["conductance"]))
    link["conductance"] = f"{1000.0 * amount(link['conductance']):.1f} W/K"
    a, b = link["between"]
    case.written["parameters"].pop(f"link_{a}_{b}", None)
    return f"conductors.{a}-{b}.conductance"


def _per_kilogram(case: Case) -> str:
    """The specific heat of aluminium in the place of a capacity."""
    node = _unlike_aluminium(case)[0]
    case.written["simulator"]["nodes"][node]["capacity"] = "900 J/K"
    return f"nodes.{node}.capacity"


def _unlike_aluminium(case: Case) -> list[str]:
    known = {path for item in case.written["parameters"].values() for path in np.atleast_1d(item.get("sets", []))}
    return [
        n
        for n, node in case.model["nodes"].items()
        if f"nodes.{n}.capacity" not in known
        and f"{n}_temp" in case.channels
        and abs(np.log(amount(node["capacity"]) / 900.0)) > 0.7
    ]


def _coatings_interchanged(case: Case) -> str:
    """Absorptivity and emissivity of all faces, with no parameter of either."""
    for face in case.written["simulator"]["faces"].values():
        face["absorptivity"], face["emissivity"] = face["emissivity"], face["absorptivity"]
    parameters = case.written["parameters"]
    for name in [n for n, item in parameters.items() if "faces." in str(item["sets"])]:
        del parameters[name]
    return ""


def _both_strings(case: Case) -> str:
    """Each heater's power is that of both strings, of which one is on."""
    for heater in case.written["simulator"]["heaters"].values():
        heater["power"] = f"{2.0 * amount(heater['power'])} W"
    return "every heater" if len(case.model["heaters"]) > 1 else case.heaters[0]


def _faces_exchanged(case: Case) -> str:
    faces = case.written["simulator"]["faces"]
    a, b = _two_faces(case)
    faces[a]["normal"], faces[b]["normal"] = faces[b]["normal"], faces[a]["normal"]
    return ""


def _two_faces(case: Case) -> tuple[str, str]:
    """The largest, and the largest of another node."""
    faces = case.model["faces"]
    first, *rest = sorted(faces, key=lambda name: -amount(faces[name]["area"]))
    return first, next((name for name in rest if faces[name]["node"] != faces[first]["node"]), rest[0])


def _flag_of_sunlight(case: Case) -> str:
    """A flag that says sunlight is written as one of the eclipse."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scenario.yaml"
        case.table.to_csv(file.with_name("telemetry.csv"), index=False)
        file.write_text(json.dumps(case.written), encoding="utf-8")
        environment = load_scenario(file).environment
    times = case.table["time"].to_numpy().astype("datetime64[ns]")
    case.table["eclipse"] = (sunlit_share(environment, times) > 0.5).astype(float)
    case.written["telemetry"]["channels"]["eclipse"] = {"column": "eclipse", "kind": "status"}
    case.written["environment"]["eclipse"] = {"measured_by": "eclipse"}
    return ""


def _beside_its_heater(case: Case) -> str:
    """The sensor is glued to the heater's foil: 6 K more while it is on, within two minutes."""
    heater = case.heaters[0]
    on = case.table[f"{heater}_status"].to_numpy()
    warm = np.zeros(len(on))
    for k in range(1, len(on)):
        warm[k] = warm[k - 1] + (6.0 * on[k] - warm[k - 1]) * (1.0 - np.exp(-0.5))
    channel = f"{case.model['heaters'][heater]['sensor']}_temp"
    case.table[channel] = (case.table[channel] + warm).round(2)
    return f"{channel} {heater}"


def _asymmetric(case: Case) -> bool:
    hour = int(case.written["environment"]["orbit"]["ltan"][:2])
    return lit(case) and hour % 12 != 0


def _many(case: Case) -> bool:
    return lit(case) and several(case)


SETUPS = (
    SetUp("altitude from the Earth's centre", 100, ("orbit",), _from_the_centre, lit),
    SetUp("beta angle of the other sign", 101, ("orbit", "attitude"), _other_beta, _asymmetric),
    SetUp("elements of the day before", 102, ("orbit", "clock"), _other_day, lit),
    SetUp("an epoch of ten days before", 112, ("orbit",), _days_old, lit),
    SetUp("one of two files in local time", 103, ("channel clock",), _file_in_local_time, _many),
    SetUp("columns shifted by one", 104, ("swapped", "other node", "everything"), _columns_shifted, _many),
    SetUp("a conductance in mW/K", 105, ("number",), _milliwatts_per_kelvin, lit),
    SetUp(
        "specific heat for a capacity", 106, ("number",), _per_kilogram, lambda c: lit(c) and bool(_unlike_aluminium(c))
    ),
    SetUp("all coatings interchanged", 107, ("number",), _coatings_interchanged, lit),
    SetUp("power of both heater strings", 108, ("heater", "number"), _both_strings, heated),
    SetUp(
        "two faces exchanged",
        109,
        ("face", "attitude"),
        _faces_exchanged,
        lambda c: lit(c) and len(c.model["faces"]) > 3,
    ),
    SetUp("a flag of sunlight for eclipse", 110, ("eclipse",), _flag_of_sunlight, lit),
    SetUp("a sensor beside its heater", 111, ("unrelated",), _beside_its_heater, heated),
)
