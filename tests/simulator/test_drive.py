"""What acts on a network in a window, and what steps make of it."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import simpson

from flightcal.environment import face_fluxes
from flightcal.errors import TelemetryError
from flightcal.simulator import build_network, open_loop
from flightcal.simulator.drive import Inputs, _apart, divided, drive_on, make_grid, window_inputs

from .. import small
from .test_network import rich


def seconds(count):
    return np.timedelta64(int(count), "s")


def inputs_of(scenario, data, *, start=0.0, hours=1.5):
    """Network and what acts on it in a window that begins `start` s into the telemetry."""
    times = data["time"].values
    begin = times[0] + seconds(start)
    end = begin + seconds(3600 * hours)
    samples = times[(times >= begin) & (times <= end)]
    network = build_network(scenario)
    return network, window_inputs(scenario, network, data, begin, end, samples, period=small.period_of(scenario))


def series(network, inputs, column):
    return inputs.values[network.columns.index(column)]


def made(times, values, *, breaks=None, corners=(), settling=()):
    """Inputs of the window that `times` cover, without heaters."""
    times = np.asarray(times, float)
    breaks = times[[0, -1]] if breaks is None else np.asarray(breaks, float)
    return Inputs(
        times, np.atleast_2d(np.asarray(values, float)), np.empty((len(times) - 1, 0)), breaks,
        np.asarray(corners, float), np.asarray(settling, float), np.empty(0),
    )  # fmt: skip


def test_no_step_of_the_grid_is_longer_than_asked_and_breaks_are_on_it():
    inputs = made([0.0, 300.0], [1.0, 1.0], breaks=[0.0, 33.3, 205.0, 300.0])
    grid = make_grid(inputs, 30.0)
    assert (grid[0], grid[-1]) == (0.0, 300.0)
    assert np.diff(grid).min() > 0
    assert np.diff(grid).max() <= 30.0 + 1e-9
    assert {33.3, 205.0} <= set(grid)


def test_the_length_of_the_steps_follows_a_function_of_time():
    inputs = made([0.0, 6000.0], [1.0, 1.0], breaks=[0.0, 2000.0, 6000.0])
    grid = make_grid(inputs, lambda t: 20.0 + 0.02 * t)
    middles = 0.5 * (grid[1:] + grid[:-1])
    assert 2000.0 in grid
    np.testing.assert_allclose(np.diff(grid), 20.0 + 0.02 * middles, rtol=0.05)


def test_steps_end_at_the_inputs_corners_unless_these_are_much_closer_together():
    corners = np.arange(60.0, 600.0, 60.0)
    inputs = made([0.0, 600.0], [1.0, 1.0], corners=corners)
    for length in (7.0, 50.0, 66.0, 95.0):
        assert set(corners) <= set(make_grid(inputs, lambda t, length=length: length + 0.0 * t))
    assert len(make_grid(inputs, lambda t: 200.0 + 0.0 * t)) == 4


def test_the_start_and_a_jump_are_followed_by_settling_steps_where_nodes_are_massless():
    grid = make_grid(
        made([0.0, 100.0, 300.0], [1.0, 1.0, 1.0], breaks=[0.0, 100.0, 300.0], settling=[0.0, 100.0]), 30.0
    )
    assert (grid == 100.0).sum() == 1
    np.testing.assert_allclose(grid[(grid > 100.0) & (grid < 101.0)] - 100.0, [1e-4, 2e-4, 3e-4], rtol=1e-6)


def test_what_is_linear_stays_what_it_is_in_steps_that_jump_where_it_does():
    inputs = made([0.0, 100.0, 100.0, 300.0], [[0.0, 100.0, 500.0, 300.0]], breaks=[0.0, 100.0, 300.0])
    drive = drive_on(inputs, np.array([0.0, 30.0, 100.0, 180.0, 300.0]))
    expected = [[0.0, 30.0], [30.0, 100.0], [500.0, 420.0], [420.0, 300.0]]
    np.testing.assert_allclose(drive.inputs[:, :, 0], expected, atol=1e-9)


def test_a_step_gets_all_heat_and_its_centre_of_gravity_however_long_it_is():
    times = np.linspace(0.0, 6000.0, 601)
    values = np.stack([np.maximum(np.sin(times / 900.0), 0.0), np.random.default_rng(0).normal(size=601)])
    grid = np.array([0.0, 333.3, 1234.5, 1240.0, 4000.0, 6000.0])
    drive = drive_on(made(times, values), grid)
    fine = np.unique(np.concatenate([times, grid]))
    for k, (begin, end) in enumerate(itertools.pairwise(grid)):
        t = fine[(fine >= begin) & (fine <= end)]
        # Of products of lines, exact by Simpson's rule.
        t = np.unique(np.concatenate([t, 0.5 * (t[1:] + t[:-1])]))
        for j in range(2):
            line = np.interp(t, [begin, end], drive.inputs[k, :, j])
            for weight in (1.0, (t - begin) / (end - begin)):
                got, wanted = (simpson(f * weight, x=t) for f in (line, np.interp(t, times, values[j])))
                assert got == pytest.approx(wanted, abs=1e-9 * (end - begin))


@pytest.fixture(scope="module")
def everything(tmp_path_factory):
    scenario, data = small.load(tmp_path_factory.mktemp("rich"), rich())
    return scenario, data, *inputs_of(scenario, data)


def test_exactly_one_mode_is_active_and_it_changes_at_the_times_of_the_timeline(everything):
    _, _, network, inputs = everything
    busy, quiet = series(network, inputs, "mode.busy"), series(network, inputs, "mode.quiet")
    np.testing.assert_array_equal(busy + quiet, 1.0)
    first = np.flatnonzero(busy)[0]
    assert inputs.times[first] == inputs.times[first - 1] == 20.5 * 60
    assert np.trapezoid(busy, inputs.times) == pytest.approx((50 - 20.5) * 60)
    assert {20.5 * 60, 50 * 60} <= set(inputs.breaks)


def test_the_mode_of_the_last_change_before_the_window_holds_at_its_start(tmp_path):
    scenario, data = small.load(tmp_path, rich())
    network, inputs = inputs_of(scenario, data, start=1800.0)
    assert series(network, inputs, "mode.busy")[0] == 1.0
    assert np.trapezoid(series(network, inputs, "mode.busy"), inputs.times) == pytest.approx(20 * 60)


def test_without_a_timeline_the_only_mode_holds(tmp_path):
    written = rich()
    written["simulator"].pop("timeline")
    written["simulator"]["modes"].pop("quiet")
    scenario, data = small.load(tmp_path, written)
    network, inputs = inputs_of(scenario, data)
    np.testing.assert_array_equal(series(network, inputs, "mode.busy"), 1.0)


def test_a_driver_follows_the_telemetry_between_samples(everything):
    _, data, network, inputs = everything
    at = (data["time"].values - data["time"].values[0]) / np.timedelta64(1, "s")
    np.testing.assert_allclose(
        series(network, inputs, "driver.sun"), np.interp(inputs.times, at, data["sun"].values), atol=1e-9
    )


def test_a_measured_boundary_gives_its_temperature_and_the_fourth_power_of_it(everything):
    _, _, network, inputs = everything
    measured = series(network, inputs, "temperature.bus")
    np.testing.assert_allclose(measured, 285.15 + 0.001 * inputs.times / 60.0, atol=1e-6)
    np.testing.assert_allclose(series(network, inputs, "temperature4.bus"), measured**4)


def test_faces_get_the_environments_fluxes_and_the_edges_of_the_sunlight_are_breaks(everything):
    scenario, data, network, inputs = everything
    begin = data["time"].values[0]
    times = begin + np.round(inputs.times * 1e9).astype("timedelta64[ns]")
    fluxes = face_fluxes(scenario.environment, {"top": scenario.simulator.faces["top"].normal}, times)
    for kind in ("solar", "albedo", "infrared"):
        np.testing.assert_allclose(series(network, inputs, f"{kind}.top"), getattr(fluxes, kind)[:, 0])
    fine = np.arange(0.0, 5400.0, 0.5)
    normals = {name: face.normal for name, face in scenario.simulator.faces.items()}
    exact = face_fluxes(scenario.environment, normals, begin + np.round(fine * 1e9).astype("timedelta64[ns]")).solar
    assert (exact == 0).any()
    for lit in (exact > 0.0).T:
        for edge in fine[1:][np.diff(lit)]:
            assert np.abs(inputs.breaks - edge).min() <= 0.5
    # However long the steps, a face gets all its sunlight.
    drive = drive_on(inputs, make_grid(inputs, 600.0))
    got = drive.inputs[:, :, network.columns.index("solar.top")].mean(axis=1) @ np.diff(drive.times)
    assert got == pytest.approx(exact[:, list(normals).index("top")].mean() * 5400, rel=1e-3)


def test_heaters_are_driven_by_thermostats_or_by_their_measured_status(tmp_path):
    scenario, data = small.load(tmp_path)
    data["heater_status"].values[10:25] = 1.0
    _, inputs = inputs_of(scenario, data)
    assert np.isnan(inputs.driven).all()
    _, inputs = inputs_of(open_loop(scenario), data)
    assert {9.0 * 60, 10.0 * 60, 24.0 * 60, 25.0 * 60} <= set(inputs.breaks)
    for length in (25.0, 700.0):
        drive = drive_on(inputs, make_grid(inputs, length))
        # Between the samples that show a switch it lies anywhere.
        middle = 0.5 * (drive.times[1:] + drive.times[:-1]) / 60.0
        either = ((middle > 9.0) & (middle < 10.0)) | ((middle > 24.0) & (middle < 25.0))
        np.testing.assert_allclose(drive.measured[either], 0.5, atol=1e-9)
        np.testing.assert_allclose(drive.measured[~either, 0], (middle[~either] > 10.0) & (middle[~either] < 25.0))
        assert drive.measured[:, 0] @ np.diff(drive.times) == pytest.approx(15 * 60.0)


def test_where_the_status_is_unknown_for_long_the_thermostat_acts(tmp_path):
    scenario, data = small.load(tmp_path)
    data["heater_status"].values[30:50] = np.nan
    _, inputs = inputs_of(open_loop(scenario), data)
    drive = drive_on(inputs, make_grid(inputs, 600.0))
    assert np.diff(drive.times)[np.isnan(drive.measured[:, 0])].sum() == pytest.approx(20 * 60.0)


def test_in_open_loop_the_thermostat_of_a_heater_without_a_status_acts(tmp_path):
    scenario, data = small.load(tmp_path)
    heater = scenario.network.heaters["heater"].model_copy(update={"measured_by": None})
    model = scenario.network.model_copy(update={"heaters": {"heater": heater}})
    _, inputs = inputs_of(open_loop(scenario.model_copy(update={"simulator": model})), data)
    assert np.isnan(inputs.driven).all()


@pytest.mark.parametrize("measured", [0.0, 1.0])
def test_a_heater_starts_in_its_measured_state(tmp_path, measured):
    written = small.content()
    written["simulator"]["heaters"]["heater"]["initially_on"] = measured == 0.0
    scenario, data = small.load(tmp_path, written)
    data["heater_status"].values[:] = 1.0 - measured
    data["heater_status"].values[60] = measured
    assert inputs_of(scenario, data, start=3600.0)[1].initially_on == [measured]


def test_a_heater_without_status_starts_as_the_scenario_says(tmp_path):
    written = small.content()
    written["simulator"]["heaters"]["heater"] |= {"initially_on": True}
    del written["simulator"]["heaters"]["heater"]["measured_by"], written["observations"]["heater_status"]
    scenario, data = small.load(tmp_path, written)
    assert inputs_of(scenario, data)[1].initially_on == [1.0]


def test_a_driver_that_cannot_be_bridged_is_an_error(tmp_path):
    scenario, data = small.load(tmp_path)
    data["sun"].values[20:80] = np.nan
    with pytest.raises(TelemetryError, match=r"channel 'sun'.*gap"):
        inputs_of(scenario, data)


def test_the_heat_of_a_driver_that_is_held_is_exact_in_steps_of_any_length(tmp_path):
    written = small.content()
    written["telemetry"]["channels"]["sun"]["fill"] = "hold"
    scenario, data = small.load(tmp_path, written)
    data["sun"].values[:] = np.nan
    data["sun"].values[[0, 20, 50]] = [1.0, 0.25, 3.0]
    network, inputs = inputs_of(scenario, data)
    drive = drive_on(inputs, make_grid(inputs, lambda t: 1300.0 + 0.0 * t))
    watts = 12.0 * drive.series[network.columns.index("driver.sun")].reshape(-1, 2).mean(axis=1)
    joules = 12.0 * (1.0 * 1200 + 0.25 * 1800 + 3.0 * 2400)
    assert np.diff(drive.times) @ watts == pytest.approx(joules, rel=1e-5)


def test_the_heat_of_a_driver_that_has_a_value_in_its_gaps_is_exact(tmp_path):
    written = small.content()
    written["telemetry"]["channels"]["sun"]["fill"] = "0.5 A"
    scenario, data = small.load(tmp_path, written)
    data["sun"].values[:] = np.nan
    data["sun"].values[[20, 21, 22, 50, 51]] = [2.0, 2.0, 2.0, 3.0, 3.0]
    network, inputs = inputs_of(scenario, data)
    drive = drive_on(inputs, make_grid(inputs, lambda t: 1300.0 + 0.0 * t))
    watts = 12.0 * drive.series[network.columns.index("driver.sun")].reshape(-1, 2).mean(axis=1)
    interval = float(np.diff(data["time"].to_numpy()[:2])[0] / np.timedelta64(1, "s"))
    # Each sample stands for an interval around it.
    joules = 12.0 * (0.5 * drive.times[-1] + interval * (3 * 1.5 + 2 * 2.5))
    assert np.diff(drive.times) @ watts == pytest.approx(joules, rel=1e-5)


def test_a_face_gets_the_sunlight_of_a_slew_and_its_ends_are_breaks(tmp_path):
    written = rich()
    written["environment"]["attitude"] = {
        "timeline": [
            {"at": "2024-03-01T00:00:00", "attitude": "sun_pointing"},
            {"at": "2024-03-01T00:10:00", "attitude": {"inertial": [0.8, 0.36, 0, 0.48]}},
            {"at": "2024-03-01T00:14:00", "attitude": "nadir"},
        ],
        "slew": "100 s",
    }
    scenario, data = small.load(tmp_path, written)
    network, inputs = inputs_of(scenario, data)
    for edge in (600.0, 700.0, 840.0, 940.0):
        assert np.abs(inputs.breaks - edge).min() < 1e-6
    begin = data["time"].values[0]
    fine = np.arange(0.0, 1200.0, 0.25)
    normals = {"top": scenario.simulator.faces["top"].normal}
    exact = face_fluxes(scenario.environment, normals, begin + np.round(fine * 1e9).astype("timedelta64[ns]"))
    for kind in ("solar", "albedo", "infrared"):
        wanted = getattr(exact, kind)[:, 0]
        found = np.interp(fine, inputs.times, series(network, inputs, f"{kind}.top"))
        assert np.abs(found - wanted).max() < 0.002 * wanted.max()
        assert np.trapezoid(found, fine) == pytest.approx(np.trapezoid(wanted, fine), rel=1e-4)


def flagged(folder, *, last=5400.0):
    """With a flag that has the shadow from 210 to 390 s, known until `last` s but from minute 65 to 75."""
    written = rich()
    written["environment"]["eclipse"] = {"measured_by": "heater_status"}
    scenario, data = small.load(folder, written)
    at = (data["time"].values - data["time"].values[0]) / np.timedelta64(1, "s")
    flag = ((at > 180.0) & (at <= 360.0)).astype(float)
    flag[(at > 3840.0) & (at < 4500.0) | (at > last)] = np.nan
    data["heater_status"].values[:] = flag
    return scenario, data


def test_a_flag_that_was_flown_says_when_there_is_sunlight(tmp_path):
    scenario, data = flagged(tmp_path)
    network, inputs = inputs_of(scenario, data)
    times = data["time"].values[0] + np.round(inputs.times * 1e9).astype("timedelta64[ns]")
    face = {"top": scenario.simulator.faces["top"].normal}
    plain = face_fluxes(scenario.environment, face, times)
    bright = face_fluxes(scenario.environment, face, times, sunlit=np.ones(len(times))).solar[:, 0]
    solar = series(network, inputs, "solar.top")
    # A switch lies midway between the samples that show it.
    shadow = (inputs.times > 210.001) & (inputs.times < 389.999)
    assert (solar[shadow] == 0.0).all()
    assert (plain.solar[shadow] > 0.0).all()
    unknown = (inputs.times > 3900.001) & (inputs.times < 4499.999)
    np.testing.assert_allclose(solar[unknown], plain.solar[unknown, 0])
    edges = np.abs(np.subtract.outer(inputs.times, [210.0, 390.0, 3900.0, 4500.0])).min(axis=1) < 1e-6
    np.testing.assert_allclose(solar[~shadow & ~unknown & ~edges], bright[~shadow & ~unknown & ~edges])
    for edge, after in ((210.0, False), (390.0, True)):
        assert np.abs(inputs.breaks - edge).min() < 1e-6
        first, second = solar[np.abs(inputs.times - edge) < 1e-6]
        assert (first > 0.0, second > 0.0) == (not after, after)
    np.testing.assert_allclose(series(network, inputs, "albedo.top"), plain.albedo[:, 0])


def test_where_a_flag_has_no_samples_yet_the_shadow_is_computed(tmp_path):
    scenario, data = flagged(tmp_path, last=2000.0)
    network, inputs = inputs_of(scenario, data, start=2400.0)
    times = data["time"].values[0] + np.round((inputs.times + 2400.0) * 1e9).astype("timedelta64[ns]")
    plain = face_fluxes(scenario.environment, {"top": scenario.simulator.faces["top"].normal}, times)
    np.testing.assert_allclose(series(network, inputs, "solar.top"), plain.solar[:, 0])


def test_steps_that_are_divided_bring_the_same_and_end_where_they_shall(tmp_path):
    scenario, data = small.closed_loop(tmp_path)
    simulator = small.simulator_of(scenario, data, hours=2.0)
    drive, times = simulator.drive, np.array([-5.0, 0.0, 100.1, 100.2, 3600.0, 3600.0005, 1e6])
    found = divided(drive, times)
    assert {100.1, 100.2} <= set(found.times)
    assert len(found.times) == len(drive.times) + 2
    assert set(drive.times) <= set(found.times)
    for edge in (0, 1):
        ends = [steps.times[edge : len(steps.times) - 1 + edge] for steps in (found, drive)]
        for column, known in zip(found.inputs[:, edge].T, drive.inputs[:, edge].T, strict=True):
            here = np.isin(ends[0], ends[1])
            np.testing.assert_allclose(column[here], known[np.isin(ends[1], ends[0])], atol=1e-12)
    theta = small.theta_of(simulator, **small.TRUTH)
    runs = [replace(simulator, drive=steps).simulate(theta).temperatures for steps in (found, drive)]
    np.testing.assert_allclose(*runs, atol=1e-4)


def test_of_points_that_are_next_to_each_other_the_first_is_kept_and_of_the_end_the_end():
    """Inputs ended before their window did, where a sample lies within a microsecond of its end."""
    end = 11459.987
    found = _apart(np.array([0.0, end, 60.0, 60.0 + 1e-7, end - 1.3e-7, 30.0]))
    assert found.tolist() == [0.0, 30.0, 60.0, end]
