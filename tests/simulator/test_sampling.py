"""What the sensors say of the states inside the steps, and its derivative."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flightcal.simulator.integrate import check_outcome
from flightcal.simulator.sampling import Observation, Sensors
from flightcal.simulator.system import Drive, System, pack, unpack

from .. import oracle
from ..oracle import QUICKLY_COMPILED, jax
from .systems import drive_of, from_dense, linear_network, random_system, simulated


def no_errors(channels):
    return np.array([[1.0], [0.0], [0.0]]) * np.ones(channels)


def said(structure, system, drive, samples, sensors, errors=None):
    """A run, after which `outputs.temperatures` has what the sensors say."""
    errors = no_errors(len(sensors.state)) if errors is None else errors
    run = simulated(structure, pack(system), drive, Observation(np.asarray(samples, float), sensors), errors)
    check_outcome(run.outputs.outcome[0])
    return run


def unmoved(*states):
    return Sensors(np.array(states), np.zeros(len(states), bool))


def ramp(rate=0.02, duration=300.0, steps=10):
    """One node that warms at a constant rate, K/s, from 280 K."""
    return linear_network([1.0], {}, [rate], [280.0], np.linspace(0.0, duration, steps + 1))


def test_a_straight_line_is_read_off_exactly_wherever_the_samples_lie():
    samples = np.sort(np.random.default_rng(0).uniform(0.0, 300.0, 1000))
    run = said(*ramp(), samples, unmoved(0))
    np.testing.assert_allclose(run.outputs.temperatures[0, :, 0], 280.0 + 0.02 * samples)


def test_a_reading_in_celsius_is_gain_times_the_temperature_in_celsius_plus_bias():
    run = said(*ramp(), [0.0, 300.0], unmoved(0), np.array([[1.02], [0.5], [0.0]]))
    expected = 1.02 * (np.array([280.0, 286.0]) - 273.15) + 0.5
    np.testing.assert_allclose(run.outputs.temperatures[0, :, 0] - 273.15, expected)


@pytest.mark.parametrize("offset", [-70.0, -3.0, 0.0, 11.0, 70.0])
def test_a_time_offset_moves_the_samples_of_a_ramp_and_a_minute_further_than_the_window(offset):
    samples = np.linspace(0.0, 300.0, 21)
    errors = no_errors(2)
    errors[2, 0] = offset
    run = said(*ramp(), samples, Sensors(np.array([0, 0]), np.array([True, False])), errors)
    seen = run.outputs.temperatures[0]
    np.testing.assert_allclose(seen[:, 0], 280.0 + 0.02 * np.clip(samples + offset, -60.0, 360.0))
    np.testing.assert_allclose(seen[:, 1], 280.0 + 0.02 * samples)


def warming(steps, *, massless):
    """A tree of nodes whose heat grows evenly for 6,000 s."""
    structure, system, _ = random_system(5, heaters=0, massless=massless, steps=1)
    times = np.linspace(0.0, 6000.0, steps + 1)
    inputs = np.stack([np.ones(steps + 1), times / 6000.0, times / 6000.0], axis=1)
    return structure, system, drive_of(times, inputs)


def test_inside_the_steps_the_error_falls_with_the_third_power_of_the_step_too():
    errors = []
    samples = np.linspace(0.0, 6000.0, 997)
    for steps in (20, 40, 80):
        structure, system, drive = warming(steps, massless=0)
        A, N, _, B, _ = (np.array(matrix) for matrix in oracle.dense(structure, system))

        def rate(t, x, A=A, N=N, B=B):
            return A @ x + N @ x**4 + B @ [1.0, t / 6000.0, t / 6000.0]

        exact = solve_ivp(rate, (0, 6000), system.initial, method="Radau", rtol=1e-11, atol=1e-10, t_eval=samples).y.T
        run = said(structure, system, drive, samples, unmoved(*range(len(system.initial))))
        errors.append(np.abs(run.outputs.temperatures[0] - exact).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 2.7).all(), f"errors {errors}"


@pytest.mark.parametrize(("mass", "order"), [(0.0, 1.7), (1.0, 2.7)])
def test_a_massless_node_is_read_off_to_second_order_inside_a_step_and_others_beside_it_to_third(mass, order):
    errors = []
    samples = np.linspace(500.0, 5800.0, 397)
    for steps in (20, 40, 80):
        structure, system, drive = warming(steps, massless=1)
        seen = np.flatnonzero(structure.mass == mass).tolist()
        exact = said(structure, system, dense(drive, 64), samples, unmoved(*seen)).outputs.temperatures[0]
        run = said(structure, system, drive, samples, unmoved(*seen))
        errors.append(np.abs(run.outputs.temperatures[0] - exact).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > order).all(), f"errors {errors}"


def dense(drive, parts):
    """The same drive in steps that are parts of its own; its inputs are straight lines in them."""
    share = np.arange(parts) / parts
    times = np.append((drive.times[:-1, None] + share * np.diff(drive.times)[:, None]).ravel(), drive.times[-1])
    points = drive.inputs[:, :1] + share[:, None] * (drive.inputs[:, 1:] - drive.inputs[:, :1])
    points = np.concatenate([points.reshape(-1, drive.inputs.shape[2]), drive.inputs[-1, 1:]])
    finer = drive_of(times, points, heaters=len(drive.initially_on))
    return Drive(finer.times, finer.inputs, finer.measured, drive.initially_on)


CASES = {
    "two thermostats and a massless node": {},
    "one heater measured, two simulated": {"heaters": 3, "measured_heaters": 1, "seed": 3},
    "long steps": {"steps": 40, "step": 110.0, "seed": 2},
    "no heater": {"heaters": 0},
    "conductances with a slope": {"slope": 4e-3, "massless": 0},
}


# JAX compiles for several seconds, so half of them are slow tests.
SLOW = ("one heater measured, two simulated", "long steps", "conductances with a slope")


@pytest.mark.parametrize(
    "options", [pytest.param(CASES[name], id=name, marks=[pytest.mark.slow] * (name in SLOW)) for name in CASES]
)
def test_what_sensors_say_and_its_derivative_are_the_oracles(options):
    """Through heaters' switches inside the steps, before the start, after the end, and with offsets in time."""
    structure, system, drive = random_system(**{"seed": 1, **options})
    rng = np.random.default_rng(0)
    samples = np.sort(np.append(rng.uniform(0.0, drive.times[-1], 150), [0.0, drive.times[-1]]))
    sensors = Sensors(np.array([2, 0, 1, len(structure.mass) - 1, 0]), np.array([True, False, False, False, True]))
    errors = np.array([[0.9, 1.1, 1.0, 1.0, 1.3], [0.3, 0.0, -1.0, 0.0, 2.0], [97.0, 0.0, 0.0, 0.0, -71.0]])
    weights = rng.normal(size=(len(samples), 5))
    run = said(structure, system, drive, samples, sensors, errors)
    if options.get("heaters", 2) > options.get("measured_heaters", 0):
        assert run.outputs.switches[0] >= 4, "the case must switch to test anything"
    run.temperatures_bar[:] = weights
    run.adjoint()

    def objective(system, errors):
        seen = oracle.simulate(structure, system, drive, samples, sensors.state, errors, max_segments=6)
        return (seen * weights).sum(), seen

    judge = jax.jit(jax.value_and_grad(objective, argnums=(0, 1), has_aux=True), compiler_options=QUICKLY_COMPILED)
    (_, seen), (by_system, by_errors) = judge(system, errors)
    np.testing.assert_allclose(run.outputs.temperatures[0], seen, atol=1e-8)
    for name, got, wanted in zip(System._fields, unpack(structure, run.packed_bar), by_system, strict=True):
        if np.size(wanted):
            np.testing.assert_allclose(got, wanted, atol=1e-7 * (np.abs(wanted).max() or 1.0), rtol=1e-7, err_msg=name)
    wanted = np.array(by_errors)
    wanted[2] *= sensors.moved
    np.testing.assert_allclose(run.errors_bar, wanted, rtol=1e-6, atol=1e-6)
    assert np.abs(run.errors_bar[2, sensors.moved]).min() > 1e-3


def test_what_sensors_say_of_sloped_conductances_has_the_derivative_of_differences():
    structure, system, drive = random_system(1, slope=4e-3, massless=0)
    samples = np.random.default_rng(0).uniform(0.0, drive.times[-1], 100)
    samples.sort()
    sensors, weights = unmoved(0, 2, 4), np.random.default_rng(1).normal(size=(100, 3))
    run = said(structure, system, drive, samples, sensors)
    run.temperatures_bar[:] = weights
    run.adjoint()
    gradient = unpack(structure, run.packed_bar).quadratic
    direction = np.sign(gradient) * np.abs(system.quadratic)

    def objective(size):
        moved = system._replace(quadratic=system.quadratic + size * direction)
        return (said(structure, moved, drive, samples, sensors).outputs.temperatures[0] * weights).sum()

    size = 1e-6
    expected = (objective(size) - objective(-size)) / (2 * size)
    assert gradient @ direction == pytest.approx(expected, rel=1e-6)


def hump(upper):
    """One node in a step of 300 s, in which it first warms and then cools; its heater is on until `upper` K."""
    structure, system = from_dense(
        np.ones(1), np.array([[-1.0 / 600.0]]), np.zeros((1, 1)), np.array([[1.0 / 600.0]]), np.array([[1e-4]]),
        [0], [200.0], [upper], [290.0],
    )  # fmt: skip
    drive = drive_of([0.0, 300.0], [[310.0], [262.0]], heaters=1)
    return structure, system, Drive(drive.times, drive.inputs, drive.measured, np.ones(1))


def test_a_moment_past_the_threshold_inside_a_long_step_is_not_missed():
    """The sensor is back within its band when the step ends."""
    structure, system, drive = hump(1e3)
    top = said(structure, system, drive, np.linspace(0.0, 300.0, 601), unmoved(0)).outputs.temperatures.max()
    structure, system, drive = hump(top - 0.05)
    run = said(structure, system, drive, [300.0], unmoved(0))
    assert run.states[-1, 0] < top - 0.5
    exact = said(structure, system, dense(drive, 64), [300.0], unmoved(0))
    assert list(run.switches.on) == list(exact.switches.on) == [0.0]
    np.testing.assert_allclose(run.switches.time, exact.switches.time, atol=3.0)
    run.temperatures_bar[:] = 1.0
    run.adjoint()
    assert np.isfinite(run.packed_bar).all()


def test_a_moment_past_the_threshold_that_only_the_cubic_has_is_none():
    """Where the solution stays short of the threshold that its continuation passes, no heater switches."""
    outcomes = set()
    structure, system, drive = hump(1e3)
    top = said(structure, system, drive, np.linspace(0.0, 300.0, 601), unmoved(0)).outputs.temperatures.max()
    for below in np.linspace(-0.08, 0.02, 81):
        structure, system, drive = hump(top + below)
        run = said(structure, system, drive, [300.0], unmoved(0))
        assert (run.outputs.status[0] == 1.0 - len(run.switches.time)).all()
        outcomes.add(len(run.switches.time))
    assert outcomes == {0, 1}
