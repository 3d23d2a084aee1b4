"""Calibrations where all time tags are off by seconds."""

import numpy as np
import pytest

from flightcal.calibration import calibrate_genetic, calibrate_nuts
from flightcal.problem import build_problem
from flightcal.scenario import NutsSettings
from flightcal.simulator import TIME_ERROR
from tests import small

LATE = 30.0  # s


def test_parameters_and_the_error_are_found_though_all_tags_are_late(tmp_path):
    late = small.content() | {"heat": {}, "time_error": "15 s"}
    for channel in ("body_temp", "panel_temp"):
        late["observations"][channel]["time_offset"] = f"-{LATE} s"
    _, data = small.closed_loop(tmp_path, late, noise=0.05)
    scenario, _ = small.load(tmp_path, small.content() | {"heat": {}, "time_error": "15 s"})

    found = calibrate_nuts(build_problem(scenario, data), NutsSettings(chains=2, warmup=200, draws=200), seed=1)

    columns = dict(zip(found.problem.names, found.flat.T, strict=True))
    truth = small.TRUTH | {TIME_ERROR: -LATE}
    off = {name: abs(columns[name].mean() - truth[name]) / columns[name].std() for name in truth if name in columns}
    # Of four quantities the worst is beyond 3.5 deviations in 0.2% of cases.
    assert len(off) == 4
    assert max(off.values()) < 3.5, off
    assert columns[TIME_ERROR].mean() < -4.0 * columns[TIME_ERROR].std()


@pytest.mark.parametrize("error", ["5 s", "none"])
def test_the_genetic_algorithm_takes_tags_as_right(tmp_path, error):
    scenario, data = small.closed_loop(tmp_path, small.content() | {"heat": {}, "time_error": error})
    problem = build_problem(scenario, data)
    runs = calibrate_genetic(problem)
    assert TIME_ERROR not in runs["parameter"].values
    assert len(runs["parameter"]) == len([k for k in problem.simulated if problem.names[k] != TIME_ERROR])
    assert np.isfinite(runs["rmse"].values).all()
