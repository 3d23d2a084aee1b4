"""Makes telemetry.csv: flight data of leo_observer, from a richer model than the one that scenario.yaml calibrates.

It has 27 nodes instead of 9, on-board software that samples its own thermistors, and the effects that README.md lists.
It uses flightcal.environment, as any model of this orbit would, and nothing of flightcal.simulator.
The seed is fixed: run it again and the file is the same, byte for byte.

    python examples/leo_observer/make_telemetry.py
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flightcal.environment import face_fluxes, orbit_phase, orbital_period, sunlit_share
from flightcal.scenario.schema import Environment

Floats = NDArray[np.float64]
Times = NDArray[np.datetime64]

FILE = Path(__file__).with_name("telemetry.csv")
SEED = 20240301
STEFAN_BOLTZMANN = 5.670374419e-8  # W m^-2 K^-4, CODATA 2018
ZERO_CELSIUS = 273.15  # K

ORBIT = {"altitude": "693 km", "inclination": "98.18 deg", "ltan": "22:30", "epoch": "2024-03-01T00:00:00"}
EPOCH = np.datetime64(ORBIT["epoch"], "ns")
"""Ascending node of orbit 1, and the first row."""
ORBITS, RUN_IN = 6, 8
"""In the file; and before it, after which nothing remembers how the twin was started."""
STEP, CONTROL_CYCLE, SAMPLING = 6, 12, 60
"""s; each divides the next."""
IMAGING = (
    ("00:40", "00:52"),
    ("02:09", "02:23"),
    ("03:52", "03:58"),
    ("04:15", "04:29"),
    ("05:41", "05:59"),
    ("07:01", "07:13"),
    ("09:02", "09:14"),
    ("09:20", "09:28"),
)
"""Passes, UTC; every orbit of the run-in has one like the first."""

# --- the satellite --------------------------------------------------------------------------------------------

PANELS = ("zenith", "nadir", "plus_x", "minus_x", "plus_y", "minus_y")
RADIATOR = ("radiator_top", "radiator_middle", "radiator_bottom")
CELLS = ("cell_1", "cell_2", "cell_3")
CAPACITIES = {  # J/K
    **{f"panel_{side}": 1000.0 for side in PANELS},
    "avionics": 2300.0,
    **dict.fromkeys(CELLS, 1050.0),
    "battery_case": 650.0,
    "tank_shell": 900.0,
    "propellant": 2700.0,
    "bench": 2300.0,
    "mirror": 1100.0,
    "baffle": 600.0,
    "detector": 280.0,
    "detector_electronics": 350.0,
    "payload_electronics": 1800.0,
    **dict.fromkeys(RADIATOR, 600.0),
    "cold_plate": 350.0,
    "cold_fin": 250.0,
    "array_front": 2900.0,
    "array_back": 1700.0,
    "yoke": 120.0,
}
NODES = tuple(CAPACITIES)
CONDUCTANCES = {  # W/K
    **{(f"panel_{a}", f"panel_{b}"): 2.5 for a in PANELS[:2] for b in PANELS[2:]},
    **{(f"panel_{a}", f"panel_{b}"): 3.0 for a in PANELS[2:4] for b in PANELS[4:]},
    ("avionics", "panel_nadir"): 6.0,
    ("avionics", "panel_minus_y"): 5.0,
    ("avionics", "panel_plus_x"): 3.0,
    ("cell_1", "cell_2"): 2.0,
    ("cell_2", "cell_3"): 2.0,
    **{(cell, "battery_case"): 6.0 for cell in CELLS},
    ("battery_case", "panel_nadir"): 1.4,
    ("battery_case", "panel_minus_x"): 0.1,
    ("tank_shell", "propellant"): 12.0,
    ("tank_shell", "panel_plus_x"): 0.35,
    ("tank_shell", "panel_zenith"): 0.2,
    ("bench", "mirror"): 8.0,
    ("bench", "baffle"): 2.5,
    ("bench", "panel_nadir"): 0.25,
    ("bench", "panel_plus_y"): 0.1,
    ("bench", "detector"): 0.05,
    ("detector", "detector_electronics"): 1.5,
    ("detector_electronics", "panel_plus_y"): 0.03,
    ("detector", "cold_plate"): 0.38,
    ("cold_plate", "cold_fin"): 1.2,
    ("cold_plate", "panel_plus_y"): 0.02,
    ("payload_electronics", "radiator_middle"): 1.7,
    ("payload_electronics", "radiator_bottom"): 2.0,
    ("radiator_top", "radiator_middle"): 2.5,
    ("radiator_middle", "radiator_bottom"): 2.5,
    **{(plate, "panel_minus_y"): 1.3 for plate in RADIATOR},
    **{(plate, "avionics"): 0.7 for plate in RADIATOR},
    ("array_front", "array_back"): 60.0,
    ("array_back", "yoke"): 0.12,
    ("yoke", "panel_plus_y"): 0.03,
    ("yoke", "avionics"): 0.05,
}
EXCHANGE = {  # m2: area x emissivities x view factor
    ("baffle", "mirror"): 0.02,
    ("radiator_top", "array_back"): 0.004,
    ("radiator_middle", "array_back"): 0.002,
}
SIDES = {
    "plus_x": (1.0, 0.0, 0.0),
    "minus_x": (-1.0, 0.0, 0.0),
    "plus_y": (0.0, 1.0, 0.0),
    "minus_y": (0.0, -1.0, 0.0),
    "nadir": (0.0, 0.0, 1.0),
    "zenith": (0.0, 0.0, -1.0),
}
"""Body frame: +x along the velocity, +z to the Earth; the Sun stands on the side of -y."""


@dataclass(frozen=True)
class Surface:
    """A bare outer surface."""

    node: str
    side: str
    area: float  # m2
    absorptivity: float
    emissivity: float
    depth: float | None = None
    """m below the solar array, where that casts its shadow."""


SURFACES = (
    Surface("radiator_top", "minus_y", 0.12, 0.29, 0.80, depth=0.2),
    Surface("radiator_middle", "minus_y", 0.12, 0.29, 0.80, depth=0.4),
    Surface("radiator_bottom", "minus_y", 0.12, 0.29, 0.80, depth=0.6),
    Surface("cold_plate", "plus_y", 0.035, 0.16, 0.86),
    Surface("cold_fin", "plus_y", 0.035, 0.16, 0.86),
    Surface("baffle", "nadir", 0.05, 0.60, 0.85),
    Surface("array_front", "zenith", 1.2, 0.70, 0.83),
    Surface("array_back", "nadir", 1.2, 0.45, 0.78),
)
BLANKETS = {"zenith": 0.36, "nadir": 0.30, "plus_x": 0.48, "minus_x": 0.48, "plus_y": 0.41, "minus_y": 0.11}  # m2
BLANKET_ABSORPTIVITY, BLANKET_EMISSIVITY = 0.45, 0.80  # of the outermost layer
BLANKET_EMITTANCE, BLANKET_LEAK = 0.016, 0.018  # through the layers; W m^-2 K^-1 through seams and spacers
DISSIPATION = {  # W: nominal, imaging
    "avionics": (30.0, 32.0),
    "payload_electronics": (9.0, 43.0),
    "detector_electronics": (0.9, 3.0),
    "detector": (0.6, 1.8),
}
WARM_UP = 60.0  # s, time constant of the dissipation after a change of mode
CELL_SLOPE, CELL_REFERENCE = 0.006, 290.0  # 1/K, K: heat capacity of the cells
DISCHARGE, CHARGE, FULL = 2.3, 1.8, 2.1  # W, heat of the battery
DEPLETION, RECHARGE = 2010.0, 2400.0  # s, from full to the usual depth of discharge, and back


@dataclass(frozen=True)
class Control:
    """A heater and the software that switches it on the median of three thermistors."""

    node: str
    power: float  # W at 28 V
    sensors: tuple[str, str, str]
    offsets: tuple[float, float, float]  # K
    on_below: float  # K
    off_above: float  # K
    shortest_on: float = 60.0  # s


CONTROLS = {
    "HTR_BAT": Control("battery_case", 24.0, CELLS, (0.15, -0.10, 0.10), 295.15, 297.15),
    "HTR_TANK": Control(
        "tank_shell", 9.0, ("tank_shell", "tank_shell", "propellant"), (0.1, -0.2, 0.0), 291.15, 294.15
    ),
    "HTR_TEL": Control("bench", 18.0, ("bench", "bench", "mirror"), (0.10, -0.15, 0.05), 290.15, 291.65),
}


@dataclass(frozen=True)
class Thermistor:
    """What the telemetry has of a temperature: delayed, shifted, noisy, in steps."""

    node: str
    lag: float  # s
    offset: float  # K
    step: float  # K
    noise: float = 0.06  # K


THERMISTORS = {
    "TT_STR": Thermistor("panel_nadir", 40.0, 0.15, 0.125),
    "TT_BAT": Thermistor("cell_2", 30.0, 0.10, 0.125),
    "TT_TANK": Thermistor("tank_shell", 30.0, 0.10, 0.125),
    "TT_TEL": Thermistor("bench", 30.0, 0.05, 0.125),
    "TT_DET": Thermistor("detector", 20.0, -0.20, 0.125),
    "TT_PEL": Thermistor("payload_electronics", 40.0, 0.20, 0.25),
    "TT_RAD": Thermistor("radiator_middle", 40.0, -0.15, 0.25),
    "TT_ARR": Thermistor("array_back", 10.0, 0.30, 0.25, noise=0.1),
}
OUTAGES = (range(341, 367), range(456, 461))
"""Rows without reception."""
FROZEN = range(185, 193)
"""Rows in which the ground system repeats the row before."""
INVALID = {"TT_PEL": (131, 132, 420), "TT_TANK": (247, 500, 501), "TT_ARR": (260,)}
MARKER = "-999.0"

# --- surroundings ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Surroundings:
    """What acts on the satellite at each step [K]."""

    times: Times
    heat: Floats
    """[K, n] W: absorbed by bare surfaces, dissipated by units and cells."""
    blankets: Floats
    """[K, panels] W/m2: what a blanket absorbs over its emissivity."""
    voltage: Floats
    """[K] V, of the bus."""


def surroundings() -> Surroundings:
    """From the run-in's start to the last row."""
    environment = Environment.model_validate({"orbit": ORBIT, "attitude": "nadir"})
    period = orbital_period(environment)
    before, after = (int(np.ceil(orbits * period / SAMPLING)) * SAMPLING for orbits in (RUN_IN, ORBITS))
    times = EPOCH + np.arange(-before, after + STEP, STEP) * np.timedelta64(1, "s")
    fluxes = face_fluxes(environment, SIDES, times)
    # White, cold poles: over the bright ice the Earth reflects more and emits less.
    polar = (np.sin(np.radians(98.18)) * np.sin(2 * np.pi * orbit_phase(environment, times))) ** 2
    visible = fluxes.solar + (0.26 + 0.10 * polar)[:, None] * fluxes.albedo
    infrared = (242.0 - 24.0 * polar)[:, None] * fluxes.infrared
    to_sun = np.stack([fluxes.solar @ np.array(normals) for normals in zip(*SIDES.values(), strict=True)], axis=1)
    side = {name: k for k, name in enumerate(fluxes.names)}

    heat = np.zeros((len(times), len(NODES)))
    for surface in SURFACES:
        light = visible[:, side[surface.side]]
        if surface.depth is not None:
            light = light - shaded_share(to_sun, surface.depth) * fluxes.solar[:, side[surface.side]]
        absorbed = surface.absorptivity * light + surface.emissivity * infrared[:, side[surface.side]]
        heat[:, NODES.index(surface.node)] += surface.area * absorbed
    for node, watts in dissipation(times, period).items():
        heat[:, NODES.index(node)] += watts
    cells, voltage = battery(sunlit_share(environment, times))
    heat[:, [NODES.index(cell) for cell in CELLS]] += cells[:, None] / len(CELLS)
    blankets = BLANKET_ABSORPTIVITY / BLANKET_EMISSIVITY * visible + infrared
    return Surroundings(times, heat, blankets[:, [side[name] for name in BLANKETS]], voltage)


def shaded_share(to_sun: Floats, depth: float) -> Floats:
    """Share [K] of a strip of the -y side, 0.6 m x 0.2 m, in the shadow of the solar array.

    The array lies in the plane of the zenith side, is 0.6 m wide and begins 0.25 m outside the -y side.
    to_sun: [K, 3], body frame, any length, zero in eclipse. depth: m, of the strip's middle below the array.
    """
    x, down = np.meshgrid(np.linspace(-0.3, 0.3, 13), depth + np.linspace(-0.1, 0.1, 9))
    up = -to_sun[:, 2, None, None]
    reach = down / np.maximum(up, 1e-6)
    across, outward = x + reach * to_sun[:, 0, None, None], -reach * to_sun[:, 1, None, None]
    share: Floats = ((up > 0) & (np.abs(across) < 0.3) & (outward > 0.25)).mean(axis=(1, 2))
    return share


def dissipation(times: Times, period: float) -> dict[str, Floats]:
    """Heat of the units [K] W, which follows the mode with a delay."""
    passes = [[np.datetime64(f"2024-03-01T{clock}", "ns") for clock in minutes] for minutes in IMAGING]
    earlier = [np.timedelta64(round(orbit * period), "s") for orbit in range(1, RUN_IN + 1)]
    passes += [[edge - shift for edge in passes[0]] for shift in earlier]
    imaging = sum((times >= start) & (times < end) for start, end in passes)
    level = np.zeros(len(times))
    for k in range(1, len(times)):
        level[k] = imaging[k] + (level[k - 1] - imaging[k]) * np.exp(-STEP / WARM_UP)
    return {unit: nominal + (busy - nominal) * level for unit, (nominal, busy) in DISSIPATION.items()}


def battery(sunlit: Floats) -> tuple[Floats, Floats]:
    """Heat of the cells [K] W and bus voltage [K] V: discharged in eclipse, then charged until full."""
    charge = np.ones(len(sunlit))
    for k in range(1, len(sunlit)):
        charge[k] = charge[k - 1] + STEP * (sunlit[k] / RECHARGE - (1 - sunlit[k]) / DEPLETION)
        charge[k] = min(max(charge[k], 0.0), 1.0)
    filling = 1 / (1 + np.exp(-(charge - 0.93) / 0.02))
    heat = sunlit * (CHARGE + (FULL - CHARGE) * filling) + (1 - sunlit) * DISCHARGE
    return heat, 26.8 + 1.0 * charge + sunlit * (1.0 - 0.2 * charge)


# --- simulation -----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Flight:
    """What happened; [K] at the steps."""

    temperatures: Floats
    """[K, n] K."""
    heaters: NDArray[np.bool_]
    """[K, H]."""


def exchange_matrix(links: dict[tuple[str, str], float]) -> Floats:
    """[n, n]: what flows into each node, per potential (temperature, or sigma T^4) of each node."""
    matrix = np.zeros((len(NODES), len(NODES)))
    for (first, second), value in links.items():
        a, b = NODES.index(first), NODES.index(second)
        matrix[[a, b], [a, b]] -= value
        matrix[[a, b], [b, a]] += value
    return matrix


def fly(around: Surroundings) -> Flight:
    """Runge-Kutta of order 4 in steps of STEP, heaters constant within each control cycle."""
    conduction, exchange = exchange_matrix(CONDUCTANCES), STEFAN_BOLTZMANN * exchange_matrix(EXCHANGE)
    emission = np.zeros(len(NODES))
    for surface in SURFACES:
        emission[NODES.index(surface.node)] += STEFAN_BOLTZMANN * surface.emissivity * surface.area
    exchange -= np.diag(emission)
    panels = np.array([NODES.index(f"panel_{name}") for name in BLANKETS])
    areas = np.array(list(BLANKETS.values()))
    cells = np.array([NODES.index(cell) for cell in CELLS])
    capacities = np.array(list(CAPACITIES.values()))
    heated = [NODES.index(control.node) for control in CONTROLS.values()]
    powers = np.array([control.power for control in CONTROLS.values()])

    def rate(x: Floats, heat: Floats, blankets: Floats) -> Floats:
        fourth = x**4
        flow = heat + conduction @ x + exchange @ fourth
        inside4 = fourth[panels]
        outside4 = blankets / STEFAN_BOLTZMANN + BLANKET_EMITTANCE * inside4
        through = BLANKET_EMITTANCE * STEFAN_BOLTZMANN * (inside4 - outside4)
        flow[panels] -= areas * (through + BLANKET_LEAK * (x[panels] - outside4**0.25))
        change = flow / capacities
        change[cells] /= 1 + CELL_SLOPE * (x[cells] - CELL_REFERENCE)
        return change

    steps = len(around.times)
    temperatures = np.full((steps, len(NODES)), 288.0)
    heaters = np.zeros((steps, len(CONTROLS)), dtype=bool)
    since = np.full(len(CONTROLS), np.inf)
    for k in range(steps - 1):
        x = temperatures[k]
        if k % (CONTROL_CYCLE // STEP) == 0:
            heaters[k] = [
                decide(c, x, on, s) for c, on, s in zip(CONTROLS.values(), heaters[k - 1], since, strict=True)
            ]
        else:
            heaters[k] = heaters[k - 1]
        since = np.where(heaters[k] == heaters[k - 1], since + STEP, STEP)
        power = np.zeros(len(NODES))
        power[heated] = heaters[k] * powers * (around.voltage[k] / 28.0) ** 2
        first, last = (around.heat[k] + power, around.blankets[k]), (around.heat[k + 1] + power, around.blankets[k + 1])
        middle = (first[0] + last[0]) / 2, (first[1] + last[1]) / 2
        k1 = rate(x, *first)
        k2 = rate(x + STEP / 2 * k1, *middle)
        k3 = rate(x + STEP / 2 * k2, *middle)
        k4 = rate(x + STEP * k3, *last)
        temperatures[k + 1] = x + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    heaters[-1] = heaters[-2]
    return Flight(temperatures, heaters)


def decide(control: Control, x: Floats, on: bool, since: float) -> bool:
    """New state of a heater, `since` s after it was last switched."""
    readings = [x[NODES.index(node)] + shift for node, shift in zip(control.sensors, control.offsets, strict=True)]
    median = sorted(readings)[1]
    if on:
        return median < control.off_above or since < control.shortest_on
    return median <= control.on_below


# --- telemetry ------------------------------------------------------------------------------------------------


def rows_of(times: Times) -> slice:
    """The steps at which a row is written."""
    return slice(int(np.searchsorted(times, EPOCH)), None, SAMPLING // STEP)


def read_out(thermistor: Thermistor, temperature: Floats, rows: slice, rng: np.random.Generator) -> Floats:
    """What a thermistor says of its node's temperature [K] K in each row, degC."""
    felt, memory = temperature.copy(), np.exp(-STEP / thermistor.lag)
    for k in range(1, len(felt)):
        felt[k] += (felt[k - 1] - felt[k]) * memory
    sampled = felt[rows] - ZERO_CELSIUS + thermistor.offset
    noisy = sampled + thermistor.noise * rng.standard_normal(len(sampled))
    return np.round(noisy / thermistor.step) * thermistor.step


def table(around: Surroundings, flight: Flight) -> list[str]:
    """Lines of the file, with everything that goes wrong on the way to it."""
    rng = np.random.default_rng(SEED)
    rows = rows_of(around.times)
    columns = {}
    for name, thermistor in THERMISTORS.items():
        read = read_out(thermistor, flight.temperatures[:, NODES.index(thermistor.node)], rows, rng)
        columns[name] = [f"{value:g}" for value in read]
    for name, row_numbers in INVALID.items():
        for row in row_numbers:
            columns[name][row] = MARKER
    for name, on in zip(CONTROLS, flight.heaters[rows].T, strict=True):
        columns[name] = ["ON" if state else "OFF" for state in on]
    cells = list(zip(*columns.values(), strict=True))
    for row in FROZEN:
        cells[row] = cells[row - 1]
    stamps = np.datetime_as_string(around.times[rows], unit="s")
    lost = {row for outage in OUTAGES for row in outage}
    kept = [k for k in range(len(stamps)) if k not in lost]
    return [",".join(("time", *columns)), *(",".join((f"{stamps[k]}Z", *cells[k])) for k in kept)]


def main(file: Path = FILE) -> None:
    """Simulate and write the file."""
    around = surroundings()
    lines = table(around, fly(around))
    file.write_text("\n".join(lines) + "\n", encoding="ascii", newline="\n")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
