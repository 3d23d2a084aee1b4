"""Makes telemetry.csv: the model in thermal.c at known parameters, with noise. Deterministic; needs a C compiler.

The truth is what a calibration should find; scenario.yaml does not know it. Two stretches of three orbits, each of
which begins as the model does: at a sunrise, with a payload that has been off for long.
"""

import ctypes
import os
import random
import subprocess
import tempfile
from datetime import datetime, timedelta
from pathlib import Path

HERE = Path(__file__).parent
EPOCH = datetime(2024, 3, 1)
PERIOD = 5400  # s
TRUTH = [0.62, 0.38, 0.74, 6900.0, 0.55]  # link W/K, absorptivity, emissivity, capacity J/K, share of payload power
NOISE = 0.1  # K, standard deviation
SAMPLING = 60  # s
STRETCHES = (0, 20 * PERIOD)  # s from the epoch
LASTING = 3 * PERIOD
PASSES = ((900, 1500), (6600, 7500), (11400, 12000))  # s from a stretch's start: the payload is on
PAYLOAD = 45.0  # W


def payload(seconds):
    return PAYLOAD if any(first <= seconds < last for first, last in PASSES) else 0.0


def stretch(library):
    """Time, panel and box temperature (K) and payload power (W) of one stretch."""
    values = (ctypes.c_double * 32)(*TRUTH)
    library.model_start(values)
    for seconds in range(0, LASTING + 1, SAMPLING):
        values[5] = payload(seconds)
        yield seconds, values[6], values[7], values[5]
        library.model_step(values, ctypes.c_double(seconds), ctypes.c_double(SAMPLING))


def telemetry():
    with tempfile.TemporaryDirectory() as folder:
        compiled = Path(folder) / "thermal.so"
        options = ["-std=gnu11", "-O2", "-shared", "-fPIC", "-o", str(compiled), str(HERE / "thermal.c"), "-lm"]
        subprocess.run([os.environ.get("CC", "cc"), *options], check=True)
        rows = list(stretch(ctypes.CDLL(str(compiled))))
    noise = random.Random(6)
    lines = ["time,TT_PANEL,TT_BOX,P_PAYLOAD"]
    for start in STRETCHES:
        for seconds, panel, box, power in rows:
            stamp = (EPOCH + timedelta(seconds=start + seconds)).isoformat()
            measured = (f"{kelvin - 273.15 + noise.gauss(0.0, NOISE):.3f}" for kelvin in (panel, box))
            lines.append(",".join([stamp, *measured, f"{power:g}"]))
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    (HERE / "telemetry.csv").write_text(telemetry())
