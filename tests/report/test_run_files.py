"""Reading of a run directory."""

import pytest
import xarray as xr

from flightcal.errors import RunError
from flightcal.report.run_files import STAGES, draws, read_run


def test_the_training_window_comes_first(run):
    assert list(run.windows) == ["train", "test"]
    assert list(run.test_windows) == ["test"]
    assert run.missing == ()


def test_files_that_are_not_there_are_named(own_run):
    for name in ("genetic.nc", "posterior.nc", "metrics.json"):
        (own_run / name).unlink()
    run = read_run(own_run)
    assert set(run.missing) == {"genetic.nc", "posterior.nc", "metrics.json"}
    assert run.genetic is None
    assert run.posterior is None
    assert run.metrics == []


def test_a_directory_that_is_no_run_is_refused(tmp_path):
    with pytest.raises(RunError, match="no such directory"):
        read_run(tmp_path / "none")
    with pytest.raises(RunError, match="found no run"):
        read_run(tmp_path)


@pytest.mark.parametrize("name", [n for n in STAGES if n != "scenario.yaml"])
def test_a_damaged_file_is_named(own_run, name):
    (own_run / name).write_text("{", encoding="utf-8")
    with pytest.raises(RunError, match=name):
        read_run(own_run)


def test_a_file_that_has_changed_is_read_anew_and_what_a_reader_changes_stays_its_own(own_run):
    first = read_run(own_run)
    first.genetic["cost"] = 7.0
    assert "cost" not in read_run(own_run).genetic
    changed = xr.load_dataset(own_run / "genetic.nc", engine="h5netcdf").assign(more=1.0)
    changed.to_netcdf(own_run / "genetic.nc", engine="h5netcdf")
    assert read_run(own_run).genetic["more"] == 1.0
    assert "more" not in first.genetic


def test_a_record_without_a_field_is_named(own_run):
    (own_run / "priors.json").write_text('[{"name": "x"}]', encoding="utf-8")
    with pytest.raises(RunError, match=r"priors\.json.*target"):
        read_run(own_run)


def test_only_absolute_temperatures_are_shown_in_celsius(run):
    shown = {i.name: (i.unit, i.offset) for i in run.parameters}
    assert shown["initial.panel"] == ("degC", -273.15)
    assert shown["battery_threshold"] == ("degC", -273.15)
    assert shown["noise.panel_temperature"] == ("K", 0.0)
    assert shown["battery_link"] == ("W/K", 0.0)


def test_draws_are_chain_draw_quantity(run):
    values = draws(run.posterior, "posterior", ["battery_link", "initial.panel"])
    assert values.shape == (4, 250, 2)
    assert values[..., 1].mean() == pytest.approx(285.0, abs=0.1)
