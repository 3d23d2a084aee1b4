"""Compile the kernels that most tests call, by two processes: of a network and of a reduced model, with heat.

Each of the two that run the tests would compile all of them.
"""

from pathlib import Path

from flightcal.calibration import warm
from flightcal.problem import build_problem
from flightcal.scenario import load_scenario
from flightcal.telemetry import read

EXAMPLE = Path(__file__).parents[1] / "examples" / "leo_observer"

if __name__ == "__main__":
    for path in ("scenario.yaml", "reduced/scenario.yaml"):
        scenario = load_scenario(EXAMPLE / path)
        warm(build_problem(scenario, read(scenario)))
