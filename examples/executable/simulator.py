"""A thermal simulator that knows nothing of flightcal: python3 simulator.py INPUT.json OUTPUT.csv

An instrument that the Sun shines on and a battery behind it, in a circular orbit. A survival heater holds the
instrument in eclipse: on below 10 degC, off above 16 degC. INPUT.json has the numbers that are not known well, the
start (UTC) and the times (s from it) to report. The simulation begins eight orbits earlier, so that nothing of its
first temperatures is left. Needs only the standard library.
"""

import csv
import json
import math
import sys
from datetime import datetime

EPOCH = datetime(2024, 3, 1)
PERIOD = 5700.0  # s
ECLIPSE = 0.36  # share of the orbit, at its end
SOLAR_CONSTANT = 1361.0  # W/m2
STEFAN_BOLTZMANN = 5.670374419e-8  # W m-2 K-4
AREA = 0.12  # m2
INSTRUMENT_CAPACITY = 2400.0  # J/K
BATTERY_DISSIPATION = 4.0  # W
ON_BELOW, OFF_ABOVE = 283.15, 289.15  # K
STEP = 60.0  # s
SPIN_UP = 8 * PERIOD


def sunlight(seconds):
    """Sunlight on the instrument, W/m2: it looks away from the Earth, and turns with the orbit."""
    phase = (seconds / PERIOD) % 1.0
    lit = 1.0 - ECLIPSE
    return SOLAR_CONSTANT * math.sin(math.pi * phase / lit) if phase < lit else 0.0


def rates(seconds, instrument, battery, heating, p):
    absorbed = AREA * p["absorptivity"] * sunlight(seconds)
    emitted = AREA * p["emissivity"] * STEFAN_BOLTZMANN * instrument**4
    conducted = p["link"] * (battery - instrument)
    return (
        (absorbed - emitted + conducted + heating) / INSTRUMENT_CAPACITY,
        (BATTERY_DISSIPATION - conducted) / p["battery_capacity"],
    )


def advance(seconds, state, step, heating, p):
    """One step of Heun's method."""
    first = rates(seconds, *state, heating, p)
    ahead = [x + step * r for x, r in zip(state, first, strict=True)]
    second = rates(seconds + step, *ahead, heating, p)
    return [x + 0.5 * step * (r + s) for x, r, s in zip(state, first, second, strict=True)]


def simulate(p, start, times):
    """Rows of time, instrument, battery (degC) and heater status; times in s from the start."""
    now, state, on = start - SPIN_UP, [288.15, 293.15], False
    rows = []
    for time in times:
        while now < start + time - 1e-9:
            step = min(STEP, start + time - now)
            ahead = advance(now, state, step, p["heater_power"] * on, p)
            threshold = OFF_ABOVE if on else ON_BELOW
            if (ahead[0] >= threshold) if on else (ahead[0] <= threshold):
                # The thermostat acts inside the step: go as far as the threshold, then switch.
                step *= (threshold - state[0]) / (ahead[0] - state[0])
                ahead = advance(now, state, step, p["heater_power"] * on, p)
                on = not on
            now, state = now + step, ahead
        rows.append([time, state[0] - 273.15, state[1] - 273.15, int(on)])
    return rows


def main():
    with open(sys.argv[1]) as file:
        given = json.load(file)
    start = (datetime.fromisoformat(given["start"]) - EPOCH).total_seconds()
    rows = simulate(given["parameters"], start, given["times"])
    with open(sys.argv[2], "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time", "T_INSTRUMENT", "T_BATTERY", "HEATER"])
        writer.writerows([f"{time:.6f}", f"{a:.9f}", f"{b:.9f}", on] for time, a, b, on in rows)


if __name__ == "__main__":
    main()
