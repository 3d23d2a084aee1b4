"""Training runs and their file."""

import numpy as np
import pytest

from flightcal.emulation.runs import failure_summary, no_runs, read_runs
from flightcal.errors import RunError
from flightcal.external.record import Record
from flightcal.run import write_netcdf

TIMES = np.datetime64("2024-03-01T00:00:00", "ns") + np.arange(4) * np.timedelta64(60, "s")
NONE = no_runs(("link", "size"), ("body",), ("heater",), TIMES)


def record(link, outcome="finished", size=1.0):
    fine = outcome == "finished"
    return Record(
        np.array([link, size]), outcome, "" if fine else "it stopped", 1, 0.1,
        np.full((4, 1), 280.0 + link if fine else np.nan), np.full((4, 1), np.nan),
    )  # fmt: skip


def test_runs_come_back_from_their_file_whole(tmp_path):
    runs = NONE.add([record(0.1), record(0.9, "crashed")], 0).add([record(0.2)], 1)
    write_netcdf(tmp_path / "runs.nc", runs.dataset())
    back = read_runs(tmp_path / "runs.nc", NONE)
    for name in ("theta", "temperatures", "status", "outcome", "message", "round", "times"):
        np.testing.assert_array_equal(getattr(back, name), getattr(runs, name))
    assert back.finished.tolist() == [True, False, True]
    assert back.take(back.finished).theta[:, 0].tolist() == [0.1, 0.2]


def test_a_file_of_other_runs_is_refused(tmp_path):
    write_netcdf(tmp_path / "runs.nc", NONE.add([record(0.1)], 0).dataset())
    with pytest.raises(RunError, match=r"runs\.nc: found parameters link, size, expected link, mass"):
        read_runs(tmp_path / "runs.nc", no_runs(("link", "mass"), ("body",), ("heater",), TIMES))
    with pytest.raises(RunError, match="sample times that are not the scenario's 3"):
        read_runs(tmp_path / "runs.nc", no_runs(("link", "size"), ("body",), ("heater",), TIMES[:3]))
    (tmp_path / "runs.nc").write_text("nonsense")
    with pytest.raises(RunError, match="no readable training runs"):
        read_runs(tmp_path / "runs.nc", NONE)


def test_failed_runs_are_counted_and_their_region_is_named():
    rng = np.random.default_rng(2)
    records = [record(link, "crashed" if link > 0.7 else "finished", rng.random()) for link in rng.random(40)]
    records.append(record(0.1, "timed out"))
    text = failure_summary(NONE.add(records, 0))
    crashed = sum(r.outcome == "crashed" for r in records)
    assert text.startswith(f"{crashed + 1} of 41 runs failed ({crashed} crashed, 1 timed out)")
    assert f"{crashed} of them, and 0 that finished, have 'link' above 0.7" in text
    assert failure_summary(NONE.add([record(0.1)], 0)) == ""
