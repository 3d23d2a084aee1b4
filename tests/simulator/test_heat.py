"""Heat that no block describes, as simulations take it: on their drive, or each its own."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flightcal.simulator import TOO_MANY_SWITCHES, WIDTH, SimulationFailure, in_steps, integrate, network_simulator
from flightcal.simulator.calls import Calls

from .. import small

HEATED = ("body", "panel")


def simulator_of(folder, written=None, *, hours=7.0, heated=HEATED):
    scenario, data = small.load(folder, written, hours=hours)
    times = data["time"].values
    period = small.period_of(scenario)
    return network_simulator(scenario, data, times[0], times[-1], times, period=period, heated=heated)


def without_heaters():
    written = small.content()
    del written["simulator"]["heaters"], written["observations"]["heater_status"], written["parameters"]["power"]
    return written


def isolated():
    """A body that exchanges heat with nothing."""
    written = without_heaters()
    del written["parameters"]["link"]
    written["parameters"]["panel_size"]["scales"] = ["conductors.panel-space.radiative", "loads.sun.coefficient"]
    written["simulator"]["conductors"] = written["simulator"]["conductors"][1:]
    return written


def constant(simulator, **watts):
    """Heat [h, 2 K] by node."""
    heat = np.zeros((len(HEATED), 2 * len(simulator.drive.inputs)))
    for name, value in watts.items():
        heat[HEATED.index(name)] = value
    return heat


def at_ends(simulator, of_time):
    """A function of time [2 K] at the beginning and at the end of each step."""
    return of_time(np.stack([simulator.drive.times[:-1], simulator.drive.times[1:]], axis=1).ravel())


def random_heat(simulator, count, size=3.0):
    rng = np.random.default_rng(1)
    return size * rng.standard_normal((count, len(HEATED), 2 * len(simulator.drive.inputs)))


@pytest.mark.parametrize("node", HEATED)
def test_constant_heat_is_that_of_a_mode_of_its_power(tmp_path, node):
    written = without_heaters()
    plain = simulator_of(tmp_path, written)
    written["simulator"]["modes"] = {"on": {node: "5 W"}}
    with_mode = simulator_of(tmp_path, written)
    np.testing.assert_array_equal(plain.drive.times, with_mode.drive.times)
    theta = small.theta_of(plain)

    found = plain.with_heat(constant(plain, **{node: 5.0})).simulate(theta)

    expected = with_mode.simulate(theta)
    assert np.abs(expected.temperatures - plain.simulate(theta).temperatures).max() > 1.0
    np.testing.assert_allclose(found.temperatures, expected.temperatures, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(found.final, expected.final, rtol=0.0, atol=1e-9)


def test_no_heat_changes_nothing(tmp_path):
    heated, plain = simulator_of(tmp_path), simulator_of(tmp_path, heated=())
    theta = small.theta_of(plain)
    np.testing.assert_allclose(
        heated.simulate(theta).temperatures, plain.simulate(theta).temperatures, rtol=0.0, atol=1e-9
    )


@pytest.mark.parametrize("count", [1, 2, 8, 21])
def test_each_simulation_of_a_batch_has_its_own_heat(tmp_path, count):
    simulator = simulator_of(tmp_path, hours=4.0)
    rng = np.random.default_rng(0)
    theta = small.theta_of(simulator)
    thetas = theta * rng.uniform(0.95, 1.05, (count, len(theta)))
    heat = random_heat(simulator, count) + rng.uniform(-3.0, 3.0, (count, 2, 1))
    on_drive = random_heat(simulator, count + 1)[-1]

    together = simulator.with_heat(on_drive).simulate_many(thetas, heat)

    for run, parameters, of_run in zip(together, thetas, heat, strict=True):
        alone = simulator.with_heat(on_drive + of_run).simulate(parameters)
        assert len(alone.switches.time) > 4
        np.testing.assert_allclose(run.temperatures, alone.temperatures, rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(run.duty_cycle, alone.duty_cycle, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(run.final, alone.final, rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(run.switches.time, alone.switches.time, rtol=0.0, atol=1e-6)


def test_a_simulation_whose_heat_takes_a_node_below_absolute_zero_has_failed(tmp_path):
    """There the law of radiation cools without end, and its neighbours' temperatures are finite and mean nothing."""
    simulator = simulator_of(tmp_path, hours=2.0)
    thetas = np.tile(small.theta_of(simulator), (3, 1))
    heat = np.stack([constant(simulator, panel=watts) for watts in (0.0, -150.0, -2.0)])
    assert [run is None for run in simulator.simulate_many(thetas, heat)] == [False, True, False]
    with pytest.raises(SimulationFailure, match="no sensor reads"):
        simulator.with_heat(heat[1]).simulate(thetas[1])


def test_heat_of_a_batch_is_gone_in_the_next(tmp_path):
    simulator = simulator_of(tmp_path, hours=1.0)
    thetas = np.tile(small.theta_of(simulator), (9, 1))
    before = [run.temperatures for run in simulator.simulate_many(thetas)]
    simulator.simulate_many(thetas, random_heat(simulator, 9))
    after = simulator.simulate_many(thetas)
    again = simulator.simulate_many(thetas, 0.0 * random_heat(simulator, 9))
    for old, new, third in zip(before, after, again, strict=True):
        np.testing.assert_array_equal(old, new.temperatures)
        np.testing.assert_array_equal(old, third.temperatures)


def test_scattered_thermostats_take_heat_too(tmp_path):
    written = small.content()
    written["simulator"]["heaters"]["heater"]["scatter"] = "0.2 K"
    simulator = simulator_of(tmp_path, written, hours=4.0)
    thetas, heat = np.tile(small.theta_of(simulator), (9, 1)), random_heat(simulator, 9)

    each = simulator.simulate_scattered(thetas, np.random.default_rng(3), heat)

    for k, of_run in enumerate(heat):
        on_drive = simulator.with_heat(of_run).simulate_scattered(thetas, np.random.default_rng(3))[k]
        np.testing.assert_allclose(each[k].temperatures, on_drive.temperatures, rtol=0.0, atol=1e-8)


def test_what_heat_brings_is_stored(tmp_path):
    simulator = simulator_of(tmp_path, isolated())
    theta = small.theta_of(simulator, initial_body=280.0)
    end = simulator.drive.times[-1]
    heat = constant(simulator)
    heat[HEATED.index("body")] = at_ends(simulator, lambda t: 4.0 - 9.0 * t / end)
    body = simulator.channels.index("body_temp")

    run = simulator.with_heat(heat).simulate(theta)

    seconds = simulator.observation.times
    energy = 4.0 * seconds - 4.5 * seconds**2 / end
    np.testing.assert_allclose(run.temperatures[:, body], 280.0 + energy / 3000.0, rtol=0.0, atol=1e-9)


def test_jumps_of_heat_at_the_ends_of_steps_are_exact(tmp_path):
    simulator = simulator_of(tmp_path, isolated(), hours=3.0)
    theta, heat = small.theta_of(simulator, initial_body=280.0), random_heat(simulator, 1, size=5.0)[0]
    heated = simulator.with_heat(heat)
    run = integrate(heated.network.structure, heated.system(theta), heated.drive, derivative=False)
    energy = np.cumsum(heat[0].reshape(-1, 2).mean(axis=1) * np.diff(heated.drive.times))
    found = run.states[1:, heated.network.nodes.index("body")]
    np.testing.assert_allclose(found, 280.0 + energy / 3000.0, rtol=0.0, atol=1e-9)


def test_the_final_state_is_that_of_the_integration_at_the_windows_end(tmp_path):
    written = small.content()
    written["observations"]["body_temp"] |= {"lag": "100 s"}
    simulator = simulator_of(tmp_path, written, hours=2.0)
    theta = small.theta_of(simulator)
    heat = random_heat(simulator, 9)

    many = simulator.simulate_many(np.tile(theta, (9, 1)), heat)

    for of_run, of_batch in zip(heat, many, strict=True):
        heated = simulator.with_heat(of_run)
        whole = integrate(heated.network.structure, heated.system(theta), heated.drive, derivative=False)
        alone = heated.simulate(theta)
        assert alone.final.shape == (2,)
        np.testing.assert_allclose(alone.final, whole.states[-1][heated.network.diffusive], rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(of_batch.final, alone.final, rtol=0.0, atol=1e-8)
    panel = [f"initial.{HEATED[1]}" == name for name in simulator.parameters[len(simulator.names) :]].index(True)
    assert alone.final[panel] == pytest.approx(alone.temperatures[-1, simulator.channels.index("panel_temp")], abs=1e-9)


def test_derivatives_with_heat_on_the_drive_are_those_of_differences(tmp_path):
    simulator = simulator_of(tmp_path, hours=3.0)
    heat = random_heat(simulator, 1)[0] + constant(simulator, body=2.0, panel=-1.0)
    heated = simulator.with_heat(heat)
    theta = small.theta_of(simulator, power=28.0)
    run, pull_back = heated.linearise(theta)
    assert len(run.switches.time) > 2
    bar = np.random.default_rng(0).standard_normal(run.temperatures.shape)
    found = pull_back(bar)
    for k, value in enumerate(theta):
        step = 1e-6 * value
        sides = [heated.simulate(theta + sign * step * np.eye(len(theta))[k]).temperatures for sign in (1.0, -1.0)]
        expected = float((bar * (sides[0] - sides[1])).sum() / (2.0 * step))
        assert found[k] == pytest.approx(expected, rel=1e-4, abs=1e-4 * np.abs(found).max()), simulator.parameters[k]


def test_a_thermostats_duty_falls_by_the_heats_share_of_its_power(tmp_path):
    written = small.content()
    band, power, capacity, link, watts = 0.2, 30.0, 3000.0, 0.6, 5.0
    written["simulator"]["heaters"]["heater"]["off_above"] = f"{10.0 + band} degC"
    simulator = simulator_of(tmp_path, written)
    theta = small.theta_of(simulator, initial_body=273.15 + 10.0 + 0.5 * band, initial_panel=265.0)
    before = simulator.simulate(theta)
    after = simulator.with_heat(constant(simulator, body=watts)).simulate(theta)
    # What the body has more at the end, and loses more in between, is as large as the band allows.
    tolerance = (capacity * band / simulator.drive.times[-1] + link * band) / power
    assert tolerance < 0.05 * watts / power
    assert before.duty_cycle[0] - after.duty_cycle[0] == pytest.approx(watts / power, abs=tolerance)


def test_a_simulation_that_switches_too_often_for_a_lane_comes_again_with_its_heat(tmp_path):
    written = small.content()
    written["simulator"]["heaters"]["heater"]["off_above"] = "10.05 degC"
    often = simulator_of(tmp_path, written)
    thetas, heat = np.tile(small.theta_of(often), (9, 1)), random_heat(often, 9)
    in_lanes = Calls(often, rooms=9, lanes=WIDTH, acting=2)
    in_lanes.simulations[0], in_lanes.thetas[:], in_lanes.integration.acting[:] = 9, thetas, heat
    in_lanes.run_forward.run()
    assert (in_lanes.outputs.outcome == TOO_MANY_SWITCHES).all()
    for run, of_run in zip(often.simulate_many(thetas, heat), heat, strict=True):
        np.testing.assert_array_equal(run.temperatures, often.with_heat(of_run).simulate(thetas[0]).temperatures)


def test_heat_on_the_drive_adds_to_what_is_there(tmp_path):
    simulator = simulator_of(tmp_path, hours=1.0)
    first, second = random_heat(simulator, 2)
    twice, once = simulator.with_heat(first).with_heat(second), simulator.with_heat(first + second)
    np.testing.assert_allclose(twice.drive.inputs, once.drive.inputs, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(once.drive.series[-2:], first + second, rtol=0.0, atol=1e-12)
    assert simulator.network.columns[-2:] == ("heat.body", "heat.panel")
    assert not simulator.drive.inputs[:, :, -2:].any()


# --- in steps ---------------------------------------------------------------------------------------------------


@st.composite
def pieces(draw):
    """Times with jumps, values [2, M], and a grid within."""
    gaps = draw(st.lists(st.sampled_from([0.5, 1.0, 7.3, 40.0]), min_size=1, max_size=12))
    inner = np.cumsum(gaps)
    jumps = draw(st.lists(st.sampled_from(inner.tolist()), unique=True, max_size=4))
    end = inner[-1] + 1.0
    times = np.sort([0.0, *inner, *jumps, end])
    values = np.random.default_rng(draw(st.integers(0, 1000))).uniform(-5.0, 5.0, (2, len(times)))
    anywhere = [share * end for share in draw(st.lists(st.floats(0.01, 0.99), max_size=8))]
    at_times = draw(st.lists(st.sampled_from(inner.tolist()), max_size=3))
    points = np.unique([*anywhere, *at_times])
    kept = points[np.diff(points, prepend=-1.0) > 1e-3]
    return times, values, np.concatenate([[0.0], kept, [end]])


def moments(times, values, begin, end):
    """Integral [q] from begin to end, and of values times time since begin: Simpson's rule in every piece."""
    totals = np.zeros((2, len(values)))
    for k in range(len(times) - 1):
        low, high = max(times[k], begin), min(times[k + 1], end)
        if high <= low:
            continue
        at = np.array([low, 0.5 * (low + high), high])
        share = (at - times[k]) / (times[k + 1] - times[k])
        line = values[:, k, None] * (1.0 - share) + values[:, k + 1, None] * share
        weights = (high - low) / 6.0 * np.array([1.0, 4.0, 1.0])
        totals += np.stack([line @ weights, (line * (at - begin)) @ weights])
    return totals


@settings(max_examples=150)
@given(pieces())
def test_a_steps_line_keeps_the_integral_and_the_first_moment(given_pieces):
    times, values, grid = given_pieces
    lines = in_steps(times, values, grid)
    assert lines.shape == (2, 2, len(grid) - 1)
    for k, (begin, end) in enumerate(itertools.pairwise(grid)):
        expected = moments(times, values, begin, end)
        found = moments(np.array([begin, end]), lines[:, :, k], begin, end)
        length = end - begin
        np.testing.assert_allclose(found[0], expected[0], rtol=0.0, atol=1e-9 * max(length, 1.0))
        np.testing.assert_allclose(found[1], expected[1], rtol=0.0, atol=1e-9 * max(length, 1.0) ** 2)


def test_what_is_linear_in_a_step_stays_what_it_is():
    grid = np.array([0.0, 10.0, 25.0, 70.0])
    rng = np.random.default_rng(0)
    lines = rng.standard_normal((3, 2, 3))
    times, values = np.repeat(grid, 2)[1:-1], np.moveaxis(lines, 1, 2).reshape(3, -1)
    np.testing.assert_allclose(in_steps(times, values, grid), lines, rtol=0.0, atol=1e-12)
