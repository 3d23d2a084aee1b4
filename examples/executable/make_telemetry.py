"""Makes telemetry.csv: the simulator at known parameters, with noise. Deterministic; needs only the standard library.

The truth is what a calibration should find; scenario.yaml does not know it.
"""

import random
from datetime import timedelta
from pathlib import Path

from simulator import EPOCH, simulate

TRUTH = {
    "link": 0.55,  # W/K
    "absorptivity": 0.27,
    "emissivity": 0.60,
    "battery_capacity": 2700.0,  # J/K
    "heater_power": 16.0,  # W
}
NOISE = 0.1  # K, standard deviation
SAMPLING, DURATION = 60, 12 * 3600  # s


def telemetry():
    noise = random.Random(0)
    lines = ["time,TT_INS,TT_BAT,HTR_INS"]
    for time, instrument, battery, on in simulate(TRUTH, 0.0, range(0, DURATION + 1, SAMPLING)):
        stamp = (EPOCH + timedelta(seconds=time)).isoformat()
        measured = (f"{value + noise.gauss(0.0, NOISE):.3f}" for value in (instrument, battery))
        lines.append(",".join([stamp, *measured, str(on)]))
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    Path(__file__).with_name("telemetry.csv").write_text(telemetry())
