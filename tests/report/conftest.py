"""A synthetic run, written once; tests that change it take a copy."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import xarray as xr

from flightcal.report.run_files import RunFiles, read_run

from .synthetic_run import write_synthetic_run


@pytest.fixture(scope="session")
def run_directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_synthetic_run(tmp_path_factory.mktemp("report") / "run")


@pytest.fixture(scope="session")
def run(run_directory: Path) -> RunFiles:
    return read_run(run_directory)


@pytest.fixture(scope="session")
def slim_directory(run_directory: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run with one channel, one heater and three parameters: its page is made in a third of the time."""
    folder = Path(shutil.copytree(run_directory, tmp_path_factory.mktemp("slim") / "run"))
    run = read_run(folder)
    assert run.posterior is not None
    windows = {name: window.isel(channel=[1], heater=[0]) for name, window in run.windows.items()}
    kept = [info.name for info in run.parameters[:3]]
    groups = {name: group.to_dataset() for name, group in run.posterior.children.items()}
    groups |= {name: groups[name][kept] for name in ("posterior", "prior")}
    posterior = xr.DataTree.from_dict(groups)
    posterior.attrs = run.posterior.attrs
    xr.DataTree.from_dict(windows).to_netcdf(folder / "prediction.nc", engine="h5netcdf")
    posterior.to_netcdf(folder / "posterior.nc", engine="h5netcdf")
    return folder


@pytest.fixture
def slim_run(slim_directory: Path, tmp_path: Path) -> Path:
    """A copy of the slim run that the test may change."""
    return Path(shutil.copytree(slim_directory, tmp_path / "slim"))


@pytest.fixture
def own_run(run_directory: Path, tmp_path: Path) -> Path:
    """A copy that the test may change."""
    return Path(shutil.copytree(run_directory, tmp_path / "run"))
