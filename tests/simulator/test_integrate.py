"""The compiled integration and its adjoint against the JAX oracle and against finite differences."""

import contextlib
import sys
import threading
import time

import numpy as np
import pytest

from flightcal.simulator import SimulationFailure, cores, in_parallel, integrate
from flightcal.simulator.system import Drive, System

from .. import oracle
from ..oracle import QUICKLY_COMPILED, jax
from .systems import derivatives_along, from_dense, random_system

CASES = {
    "two thermostats and a massless node": {},
    "three thermostats on ten nodes": {"nodes": 10, "heaters": 3, "massless": 2},
    "one heater measured, two simulated": {"heaters": 3, "measured_heaters": 1, "seed": 3},
    "no heater": {"heaters": 0},
    "a larger tree": {"nodes": 14, "heaters": 2, "massless": 3},
    "conductances with a slope": {"slope": 4e-3},
    "conductances with a slope, one heater measured": {"slope": 3e-3, "heaters": 3, "measured_heaters": 1, "seed": 3},
}


# JAX compiles for several seconds, so half of them are slow tests.
SLOW = (
    "two thermostats and a massless node",
    "conductances with a slope, one heater measured",
    "three thermostats on ten nodes",
    "a larger tree",
)


@pytest.mark.parametrize(
    "options", [pytest.param(CASES[name], id=name, marks=[pytest.mark.slow] * (name in SLOW)) for name in CASES]
)
def test_states_and_gradient_equal_the_oracles(options):
    structure, system, drive = random_system(**{"seed": 1, **options})
    run = integrate(structure, system, drive)
    if options.get("heaters", 2) > options.get("measured_heaters", 0):
        assert len(run.switches.time) >= 4, "the case must switch to test anything"
    cotangent = np.random.default_rng(0).normal(size=run.states.shape)

    def objective(system):
        states, status = oracle.integrate(structure, system, drive, max_segments=6)
        return (states * cotangent).sum(), (states, status)

    value_and_gradient = jax.jit(jax.value_and_grad(objective, has_aux=True), compiler_options=QUICKLY_COMPILED)
    (_, (states, status)), expected = value_and_gradient(system)
    np.testing.assert_allclose(run.states, states, atol=1e-9)
    np.testing.assert_array_equal(run.status, status)

    gradient = run.pull_back(cotangent)
    for name, got, wanted in zip(System._fields, gradient, expected, strict=True):
        if np.size(wanted):
            scale = np.abs(wanted).max() or 1.0
            np.testing.assert_allclose(got, wanted, atol=1e-8 * scale, rtol=1e-8, err_msg=name)


@pytest.mark.parametrize("slope", [0.0, 4e-3])
@pytest.mark.parametrize(
    "field", ["linear", "radiative", "quadratic", "forcing", "heating", "lower", "upper", "initial"]
)
def test_gradient_agrees_with_finite_differences_across_a_switch(field, slope):
    # Seeds whose switches stay clear of the grid's points.
    structure, system, drive = random_system(5 if slope else 2, slope=slope)
    run = integrate(structure, system, drive)
    assert len(run.switches.time) >= 4
    got, expected = derivatives_along(structure, system, drive, run, field)
    assert got == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("case", [{}, {"slope": 4e-3, "seed": 5}, {"heaters": 3, "measured_heaters": 1, "seed": 3}])
def test_the_derivative_of_switching_times_agrees_with_differences(case):
    """Of the times alone and with the states; differences of the fourth order along the gradient of each field."""
    structure, system, drive = random_system(**{"seed": 2, **case})
    run = integrate(structure, system, drive)
    rng = np.random.default_rng(0)
    of_states, of_times = rng.normal(size=run.states.shape), 0.1 * rng.normal(size=len(run.switches.time))
    assert len(of_times) >= 4
    for states_bar in (0.0 * of_states, of_states):

        def objective(system, states_bar=states_bar):
            moved = integrate(structure, system, drive)
            assert len(moved.switches.time) == len(of_times)
            return (moved.states * states_bar).sum() + moved.switches.time @ of_times

        gradient = run.pull_back(states_bar, of_times)
        fields = [field for field in System._fields if np.size(getattr(system, field))]
        for field in fields:
            value, slope = getattr(system, field), getattr(gradient, field)
            direction = np.sign(slope) * np.abs(value)
            found = (slope * direction).sum()
            size = 4e-3 / found  # far above the tolerance of a located switch, far below where it bends
            near = {k: objective(system._replace(**{field: value + k * size * direction})) for k in (-2, -1, 1, 2)}
            expected = (near[-2] - 8 * near[-1] + 8 * near[1] - near[2]) / (12 * size)
            assert found == pytest.approx(expected, rel=1e-6), field


def test_sensor_is_at_its_threshold_when_the_heater_switches():
    structure, system, drive = random_system(3)
    run = integrate(structure, system, drive)
    record = run.record
    event = record.event[0, : record.segments[0]]
    ends = np.flatnonzero(event >= 0)
    assert len(ends) >= 4
    for segment in ends:
        heater = event[segment]
        went_on = record.heater[0, segment, heater] == 0.0
        threshold = (system.lower if went_on else system.upper)[heater]
        # The state after the switch is the next segment's initial state.
        if segment + 1 < len(event):
            assert record.state[0, segment + 1, structure.sensor[heater]] == pytest.approx(threshold, abs=1e-8)


def test_a_likelihood_slice_is_smooth_in_a_threshold():
    """The design's measured fact: with located switching no jumps as a parameter moves."""
    structure, system, drive = random_system(2)
    target = integrate(structure, system, drive).states
    misfit = []
    for shift in np.linspace(-0.05, 0.05, 201):
        states = integrate(structure, system._replace(lower=system.lower + shift), drive).states
        misfit.append(((states - target) ** 2).sum())
    second = np.diff(misfit, 2)
    assert np.abs(second).max() < 20 * np.median(np.abs(second)) + 1e-9


def test_the_derivative_is_the_same_whether_steps_are_kept_or_computed_again(monkeypatch):
    structure, system, drive = random_system(2)
    kept = integrate(structure, system, drive)
    module = sys.modules["flightcal.simulator.integrate"]
    size = kept.record.steps.shape[1]
    segments = int(kept.record.segments[0])
    weights = np.random.default_rng(0).normal(size=kept.states.shape)
    expected = kept.pull_back(weights)
    assert len(kept.record.steps) > segments
    for most in (0, 1, segments // 2, segments - 1, segments):
        monkeypatch.setattr(module, "_MOST_KEPT", most * size)
        noted = integrate(structure, system, drive)
        assert len(noted.record.steps) == most + 1
        np.testing.assert_array_equal(noted.states, kept.states)
        for first, second in zip(expected, noted.pull_back(weights), strict=True):
            np.testing.assert_allclose(second, first, rtol=1e-11, atol=1e-11 * np.abs(first).max(initial=0.0))


def test_a_diverging_trajectory_and_a_chattering_thermostat_are_reported():
    from flightcal.simulator import SimulationFailure

    structure, system, drive = random_system(1)
    with pytest.raises(SimulationFailure, match="finite"):
        integrate(structure, system._replace(initial=system.initial * np.nan), drive)
    tight = system._replace(upper=system.lower + 1e-7, heating=system.heating * 1e3)
    with pytest.raises(SimulationFailure, match="chatters"):
        integrate(structure, tight, drive)


def test_a_switch_on_a_grid_point_acts_from_there():
    """The sensor is past its threshold at the step's end by rounding only, so the switch is located at that end."""
    structure, system, drive = random_system(3, heaters=1, massless=0)
    never = system._replace(lower=np.array([1.0]), upper=np.array([1e3]))
    drive = Drive(drive.times, drive.inputs, drive.measured, np.ones(1))
    sensor = integrate(structure, never, drive).states[:, structure.sensor[0]]
    highest = np.maximum.accumulate(sensor)
    point = int(np.flatnonzero(sensor[1:] > highest[:-1])[5]) + 1
    ends = []
    for upper in (np.nextafter(sensor[point], 0.0), sensor[point] - 1e-7):
        run = integrate(structure, never._replace(upper=np.array([upper])), drive)
        assert run.switches.time[0] == pytest.approx(drive.times[point], abs=1e-3)
        ends.append(run.states)
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-4)


@pytest.mark.parametrize("apart", [-3.0, -1e-3, 0.0, 1e-3, 3.0])
def test_two_heaters_in_one_step_switch_in_their_own_order(apart):
    """Nodes that know nothing of each other warm at 0.02 and 0.05 K/s; seconds apart they pass their thresholds."""
    none, rates = np.zeros((2, 2)), np.array([0.02, 0.05])
    at = np.array([100.0, 100.0 + apart])
    structure, system = from_dense(
        np.ones(2), none, none, np.zeros((2, 1)), np.diag(rates), range(2), [1.0, 1.0], 280.0 + rates * at, [280.0] * 2
    )
    times = np.arange(0.0, 300.0, 60.0)
    drive = Drive(times, np.ones((len(times) - 1, 2, 1)), np.full((len(times) - 1, 2), np.nan), np.ones(2))
    run = integrate(structure, system, drive)
    assert run.switches.on.tolist() == [0.0, 0.0]
    if apart:
        np.testing.assert_array_equal(run.switches.heater, np.argsort(at))
    assert sorted(run.switches.heater) == [0, 1]
    np.testing.assert_allclose(run.switches.time, np.sort(at), rtol=0, atol=1e-8)
    np.testing.assert_allclose(run.states, 280.0 + rates * np.minimum(times[:, None], at), rtol=0, atol=1e-9)


def test_a_simulation_that_leaps_past_two_thresholds_at_once_comes_to_an_end():
    """A panel of megawatts leaps far below zero in one step, and two heated nodes with it."""
    links = np.array([[-2e-5, 0.0, 2e-5], [0.0, -4e-5, 4e-5], [1e-5, 1e-5, -2e-5]])
    radiating, into = np.diag([0.0, 0.0, -3.5e-11]), np.array([[0.0], [0.0], [1000.0]])
    heating = np.array([[1e-3, 0.0, 0.0], [0.0, 1e-3, 0.0]])
    structure, system = from_dense(
        np.ones(3), links, radiating, into, heating, range(2), [290.0, 285.0], [295.0, 290.0], [292.0, 288.0, 297.0]
    )
    times = np.arange(0.0, 900.0, 30.0)
    drive = Drive(times, np.ones((len(times) - 1, 2, 1)), np.full((len(times) - 1, 2), np.nan), np.zeros(2))

    ended = []

    def fly():
        with contextlib.suppress(SimulationFailure):
            integrate(structure, system, drive)
        ended.append(True)

    flying = threading.Thread(target=fly, daemon=True)
    flying.start()
    flying.join(30.0)
    assert ended


def test_what_runs_side_by_side_is_returned_in_order():
    def task(k):
        time.sleep(0.01 * (k % 3))
        return k

    assert in_parallel(task, 20) == list(range(20))


def test_after_an_error_side_by_side_nothing_else_begins():
    begun = []

    def task(k):
        begun.append(k)
        if k == 1:
            raise ValueError("the second")
        time.sleep(0.2)

    with pytest.raises(ValueError, match="the second"):
        in_parallel(task, 10 * cores() + 10)
    assert len(begun) <= max(2, cores())
