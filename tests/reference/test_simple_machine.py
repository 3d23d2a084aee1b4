"""The simple machine of Brynjarsdóttir & O'Hagan (2014), Inverse Problems 30, 114007: physical parameters need delta.

Work out of a machine for effort x in: truly 0.65 x / (1 + x / 20), for friction; the model has theta x. Efforts from
0.2 to 4 and noise of 0.01, as theirs; a sample a minute stands for each effort, and orbits are so long that a
discrepancy in their phase does not come back.
"""

import numpy as np
import pytest

from flightcal.calibration import calibrate_nuts
from flightcal.scenario import NutsSettings
from tests.workers import close_workers

from . import problems

EFFORT = np.linspace(0.2, 4.0, 61)
MODEL = """
def simulate(inputs, times, start):
    return (inputs["theta"] * (0.2 + times / 60.0 * 3.8 / 60.0))[:, None]
"""
PRIOR = {"theta": {"uniform": [0.1, 1.5]}}
HOURS = 12
"""Of an orbit."""


@pytest.fixture(autouse=True)
def _no_idle_workers():
    yield
    close_workers()


def interval(folder, **blocks):
    """95% interval of theta."""
    work = 0.65 * EFFORT / (1 + EFFORT / 20) + 0.01 * np.random.default_rng(1).standard_normal(EFFORT.size)
    problem = problems.problem(
        folder, MODEL, PRIOR, work[:, None], "0.01 K", environment={"period": f"{HOURS} h"}, **blocks
    )
    posterior = calibrate_nuts(problem, NutsSettings(chains=2, draws=500, warmup=300), 1, random_starts=2)
    low, high = np.quantile(posterior.flat[:, problem.names.index("theta")], [0.025, 0.975])
    print(folder.name, problem.names, low, high, posterior.diagnostics.verdict)
    return low, high


@pytest.mark.slow
def test_the_truth_is_covered_only_by_what_is_known_of_the_discrepancy(tmp_path):
    def discrepancy(amplitude, shortest, longest):
        """Lengthscales in hours."""
        return {
            "phase": {
                "amplitude": {"half_normal": amplitude},
                "lengthscale": {"uniform": [shortest / HOURS, longest / HOURS]},
                "smoothness": "5/2",
                "harmonics": 40,
            }
        }

    low, high = interval(tmp_path / "without")
    assert high < 0.6
    # A discrepancy of which little is known widens the interval much, and not enough: their main point.
    vague = interval(tmp_path / "vague", discrepancy=discrepancy("0.5 K", 0.5, 1.0))
    assert vague[1] - vague[0] > 10 * (high - low)
    assert vague[1] < 0.65
    # They also know its value and slope at no effort. Here: friction grows smoothly over all efforts, up to the work.
    known = interval(tmp_path / "known", discrepancy=discrepancy("1 K", 1.0, 3.0))
    assert known[0] < 0.65 < known[1]
