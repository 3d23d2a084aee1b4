"""The grid and the series on it."""

import numpy as np
import pytest

from flightcal.environment import face_fluxes
from flightcal.errors import TelemetryError
from flightcal.simulator import build_network, open_loop
from flightcal.simulator.drive import build_drive, make_grid

from .. import small
from .test_network import rich

NOTHING = np.empty(0)


def seconds(count):
    return np.timedelta64(int(count), "s")


def drive_of(scenario, data, *, start=0.0, hours=1.5):
    """Network, drive and sampling on a window that begins `start` s into the telemetry."""
    times = data["time"].values
    begin = times[0] + seconds(start)
    end = begin + seconds(3600 * hours)
    samples = times[(times >= begin) & (times <= end)]
    network = build_network(scenario)
    period = small.period_of(scenario)
    return network, *build_drive(scenario, network, data, begin, end, samples, period=period)


def series(network, drive, column):
    return drive.inputs[:, network.columns.index(column)]


def test_no_step_of_the_grid_is_longer_than_asked_and_samples_and_kinks_are_on_it():
    samples, kinks = np.array([0.0, 70.0, 140.0, 205.0, 280.0]), np.array([33.3, 500.0])
    grid = make_grid(300.0, 30.0, samples, kinks, NOTHING, settle=False)
    assert (grid[0], grid[-1]) == (0.0, 300.0)
    assert np.diff(grid).min() > 0
    assert np.diff(grid).max() <= 30.0 + 1e-9
    assert set(samples) | {33.3} <= set(grid)
    assert 500.0 not in grid


def test_a_jump_stands_twice_and_is_followed_by_settling_steps():
    grid = make_grid(300.0, 30.0, NOTHING, NOTHING, np.array([0.0, 100.0, 300.0]), settle=True)
    assert (grid == 100.0).sum() == 2
    assert (np.diff(grid) == 0.0).sum() == 1
    np.testing.assert_allclose(grid[(grid > 100.0) & (grid < 101.0)] - 100.0, [1e-4, 2e-4, 3e-4], rtol=1e-6)


@pytest.fixture(scope="module")
def everything(tmp_path_factory):
    scenario, data = small.load(tmp_path_factory.mktemp("rich"), rich())
    return scenario, data, *drive_of(scenario, data)


def test_exactly_one_mode_is_active_and_it_changes_at_the_times_of_the_timeline(everything):
    _, _, network, drive, _ = everything
    busy, quiet = series(network, drive, "mode.busy"), series(network, drive, "mode.quiet")
    np.testing.assert_array_equal(busy + quiet, 1.0)
    first = np.flatnonzero(busy)[0]
    assert drive.times[first] == drive.times[first - 1] == 20.5 * 60
    assert np.trapezoid(busy, drive.times) == pytest.approx((50 - 20.5) * 60)


def test_the_mode_of_the_last_change_before_the_window_holds_at_its_start(tmp_path):
    scenario, data = small.load(tmp_path, rich())
    network, drive, _ = drive_of(scenario, data, start=1800.0)
    assert series(network, drive, "mode.busy")[0] == 1.0
    assert np.trapezoid(series(network, drive, "mode.busy"), drive.times) == pytest.approx(20 * 60)


def test_without_a_timeline_the_only_mode_holds(tmp_path):
    written = rich()
    written["simulator"].pop("timeline")
    written["simulator"]["modes"].pop("quiet")
    scenario, data = small.load(tmp_path, written)
    network, drive, _ = drive_of(scenario, data)
    np.testing.assert_array_equal(series(network, drive, "mode.busy"), 1.0)


def test_a_driver_follows_the_telemetry_between_samples(everything):
    _, data, network, drive, _ = everything
    at = (data["time"].values - data["time"].values[0]) / np.timedelta64(1, "s")
    np.testing.assert_allclose(
        series(network, drive, "driver.sun"), np.interp(drive.times, at, data["sun"].values), atol=1e-9
    )


def test_a_measured_boundary_gives_its_temperature_and_the_fourth_power_of_it(everything):
    _, _, network, drive, _ = everything
    measured = series(network, drive, "temperature.bus")
    np.testing.assert_allclose(measured, 285.15 + 0.001 * drive.times / 60.0, atol=1e-6)
    np.testing.assert_allclose(series(network, drive, "temperature4.bus"), measured**4)


def test_faces_get_the_environments_fluxes_and_eclipse_edges_are_on_the_grid(everything):
    scenario, data, network, drive, _ = everything
    times = data["time"].values[0] + np.round(drive.times * 1e9).astype("timedelta64[ns]")
    fluxes = face_fluxes(scenario.environment, {"top": scenario.simulator.faces["top"].normal}, times)
    for kind in ("solar", "albedo", "infrared"):
        np.testing.assert_allclose(series(network, drive, f"{kind}.top"), getattr(fluxes, kind)[:, 0])
    # Between the points of the grid inputs are straight lines: with eclipse edges on it, the heat is right.
    fine = data["time"].values[0] + np.arange(0, 5400 * 2 + 1) * np.timedelta64(500, "ms")
    exact = face_fluxes(scenario.environment, {"top": scenario.simulator.faces["top"].normal}, fine).solar[:, 0]
    assert (exact == 0).any()
    on_grid = np.trapezoid(series(network, drive, "solar.top"), drive.times)
    assert on_grid == pytest.approx(exact.mean() * 5400, rel=1e-3)


def test_heaters_are_driven_by_thermostats_or_by_the_measured_share_of_each_step(tmp_path):
    scenario, data = small.load(tmp_path)
    data["heater_status"].values[10:25] = 1.0
    _, drive, _ = drive_of(scenario, data)
    assert np.isnan(drive.measured).all()
    _, drive, _ = drive_of(open_loop(scenario), data)
    assert np.isfinite(drive.measured).all()
    assert drive.measured[:, 0] @ np.diff(drive.times) == pytest.approx(15 * 60.0)


def test_open_loop_needs_a_status_channel(tmp_path):
    written = small.content()
    written["simulator"]["heaters"]["heater"].pop("measured_by")
    scenario, data = small.load(tmp_path, written)
    with pytest.raises(TelemetryError, match=r"heater 'heater'.*no 'measured_by'"):
        drive_of(open_loop(scenario), data)


@pytest.mark.parametrize("measured", [0.0, 1.0])
def test_a_heater_starts_in_its_measured_state(tmp_path, measured):
    written = small.content()
    written["simulator"]["heaters"]["heater"]["initially_on"] = measured == 0.0
    scenario, data = small.load(tmp_path, written)
    data["heater_status"].values[:] = 1.0 - measured
    data["heater_status"].values[60] = measured
    assert drive_of(scenario, data, start=3600.0)[1].initially_on == [measured]


def test_a_heater_without_status_starts_as_the_scenario_says(tmp_path):
    written = small.content()
    written["simulator"]["heaters"]["heater"] |= {"initially_on": True}
    written["simulator"]["heaters"]["heater"].pop("measured_by")
    scenario, data = small.load(tmp_path, written)
    assert drive_of(scenario, data)[1].initially_on == [1.0]


def test_a_driver_that_cannot_be_bridged_is_an_error(tmp_path):
    scenario, data = small.load(tmp_path)
    data["sun"].values[20:80] = np.nan
    with pytest.raises(TelemetryError, match=r"channel 'sun'.*gap"):
        drive_of(scenario, data)
