"""A small spacecraft with a meshed, insulated box, and a reduction of it, for the tests."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

SPACECRAFT: dict[str, Any] = {
    "name": "small craft",
    "start": "2024-03-01T00:00:00",
    "duration": "30000 s",
    "step": "10 s",
    "environment": {
        "orbit": {
            "altitude": "693 km",
            "inclination": "98.18 deg",
            "ltan": "22:30",
            "epoch": "2024-03-01T00:00:00",
        },
        "attitude": "nadir",
    },
    "materials": {"aluminium": {"conductivity": "150 W/m/K", "density": "2700 kg/m^3", "specific_heat": "900 J/kg/K"}},
    "coatings": {
        "black": {"absorptivity": 0.95, "emissivity": 0.88},
        "kapton": {"absorptivity": 0.4, "emissivity": 0.75},
    },
    "insulations": {"blanket": {"effective_emissivity": 0.05, "coating": "kapton"}},
    "boxes": {
        "bus": {
            "corner": ["0 m", "0 m", "0 m"],
            "size": ["0.6 m", "0.5 m", "0.6 m"],
            "thickness": "2 mm",
            "material": "aluminium",
            "mesh": 2,
            "outside": {"coating": "black", "insulation": "blanket"},
            "inside": "black",
            "joints": "40 W/m/K",
        }
    },
    "nodes": {
        "battery": {"capacity": "5000 J/K", "initial": "15 degC"},
        "unit": {"capacity": "3000 J/K", "initial": "10 degC"},
    },
    "conductors": [
        {"between": ["battery", "bus.z-[0,1]"], "conductance": "0.7 W/K"},
        {"between": ["unit", "bus.y-[1,0]"], "conductance": "1.2 W/K"},
    ],
    "faces": {
        "window": {
            "node": "bus.y-[1,0]",
            "area": "0.05 m^2",
            "normal": [0, -1, 0],
            "absorptivity": 0.2,
            "emissivity": 0.8,
        }
    },
    "initial": "5 degC",
    "modes": {"nominal": {"unit": "12 W"}, "imaging": {"unit": "30 W"}},
    "thermistors": {
        "battery_1": {"node": "battery", "noise": "0.05 K"},
        "unit_1": {"node": "unit", "noise": "0.05 K"},
        "structure_1": {"node": "bus.z-[1,1]", "noise": "0.05 K"},
    },
    "software": {
        "period": "10 s",
        "initial_mode": "nominal",
        "sensors": {"battery": {"thermistors": ["battery_1"]}},
        "heaters": {
            "battery": {
                "sensor": "battery",
                "thermostat": {"on_below": "14 degC", "off_above": "15.5 degC"},
                "branches": {"nominal": {"power": {"battery": "20 W"}}},
            }
        },
        "enabled": {"nominal": ["battery"], "imaging": ["battery"]},
        "timeline": [{"at": "8000 s", "mode": "imaging"}, {"at": "9000 s", "mode": "nominal"}],
    },
    "downlink": {"thermistors": ["battery_1", "unit_1", "structure_1"], "period": "60 s"},
}

REDUCTION: dict[str, Any] = {
    "name": "small craft",
    "spacecraft": "spacecraft.yaml",
    "parameters": {
        "blanket": {
            "scales": "conductors.bus*insulation.radiative",
            "prior": {"lognormal": {"median": 1, "factor": 1.3}},
        },
        "window_absorptivity": {"sets": "faces.window.absorptivity", "prior": {"uniform": [0.1, 0.4]}},
        "battery_link": {
            "sets": "conductors.battery-bus.z-[0,1].conductance",
            "prior": {"lognormal": {"median": "0.7 W/K", "factor": 1.3}},
        },
        "battery_capacity": {
            "sets": "nodes.battery.capacity",
            "prior": {"lognormal": {"median": "5000 J/K", "factor": 1.2}},
        },
        "power": {"sets": "heaters.battery.power", "prior": {"uniform": ["15 W", "25 W"]}},
    },
    "training": {"seed": 1, "draws": 8, "windows": {"march": {"start": "2024-03-01T00:00:00", "orbits": 2}}},
    "held_out": {"seed": 2, "draws": 4, "windows": {"april": {"start": "2024-04-01T06:00:00", "orbits": 2}}},
}


def write(folder: Path, reduction: dict[str, Any] | None = None, spacecraft: dict[str, Any] | None = None) -> Path:
    """Write both files, the blocks given in place of what stands above; the path of the reduction."""
    yaml = YAML()
    for name, content, changes in (
        ("spacecraft.yaml", SPACECRAFT, spacecraft),
        ("reduce.yaml", REDUCTION, reduction),
    ):
        with (folder / name).open("w") as file:
            yaml.dump({**deepcopy(content), **(changes or {})}, file)
    return folder / "reduce.yaml"
