"""The integration scheme against solutions that it has no part in."""

import os
from pathlib import Path

import numpy as np
import pandas
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from flightcal.simulator import integrate
from flightcal.simulator.network import STEFAN_BOLTZMANN

from .. import oracle
from .systems import drive_of, from_dense, linear_network, random_system

DATA = Path(os.environ.get("FLIGHTCAL_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))


def test_two_conducting_nodes_follow_the_analytic_solution():
    capacity, conductance, times = np.array([500.0, 2000.0]), 1.5, np.linspace(0, 3600, 121)
    structure, system, drive = linear_network(capacity, {(0, 1): conductance}, [0.0, 0.0], [320.0, 280.0], times)
    rate = conductance * (1 / capacity[0] + 1 / capacity[1])
    mean = (capacity @ [320.0, 280.0]) / capacity.sum()
    difference = 40.0 * np.exp(-rate * times)
    expected = np.stack(
        [mean + difference * capacity[1] / capacity.sum(), mean - difference * capacity[0] / capacity.sum()],
        axis=1,
    )
    np.testing.assert_allclose(integrate(structure, system, drive).states, expected, atol=1e-3)


def test_a_radiating_node_follows_the_analytic_solution():
    # dT/dt = -k T^4 has T = (T0^-3 + 3 k t)^(-1/3).
    k, times = 0.1 * STEFAN_BOLTZMANN / 800.0, np.linspace(0, 7200, 241)
    structure, system = from_dense(
        np.ones(1), np.zeros((1, 1)), np.array([[-k]]), np.zeros((1, 1)), np.zeros((0, 1)), [], [], [], [400.0]
    )
    drive = drive_of(times, np.zeros((len(times), 1)))
    expected = (400.0**-3 + 3 * k * times) ** (-1 / 3)
    np.testing.assert_allclose(integrate(structure, system, drive).states[:, 0], expected, atol=2e-4)


def test_esatan_simple_transient_is_reproduced_within_ten_millikelvin():
    file = DATA / "esatan" / "SimpleTransient.csv"
    if not file.exists():
        pytest.skip(f"reference data not found at {file}")
    table = pandas.read_csv(file, skiprows=5).to_numpy(float)
    times, reference = table[:, 0], table[:, 1::2]
    times[0] = 0.0
    # Nodes numbered 0 to 4 as in the data's README; the fifth is heated by none.
    links = {(1, 0): 10.0, (1, 2): 1.0, (1, 3): 5.0, (4, 3): 2.0}
    structure, system, drive = linear_network(
        [1.0, 2.0, 3.0, 4.0, 1000.0],
        links,
        [5.0, 0, 0, 0, 0],
        np.array([20.0, 30, 40, 50, 0]) + 273.15,
        times,
    )
    error = np.abs(integrate(structure, system, drive).states - 273.15 - reference)
    assert error.max() < 0.01


def test_error_falls_with_the_third_power_of_the_step():
    errors = []
    for steps in (40, 80, 160):
        structure, system, drive = random_system(5, heaters=0, massless=0, steps=1)
        times = np.linspace(0.0, 6000.0, steps + 1)
        inputs = np.stack([np.ones(steps + 1), times / 6000.0, times / 6000.0], axis=1)
        drive = drive_of(times, inputs)
        A, N, _, B, _ = (np.array(matrix) for matrix in oracle.dense(structure, system))

        def rate(t, x, A=A, N=N, B=B):
            return A @ x + N @ x**4 + B @ [1.0, t / 6000.0, t / 6000.0]

        reference = solve_ivp(rate, (0, 6000), system.initial, method="Radau", rtol=1e-12, atol=1e-11).y[:, -1]
        errors.append(np.abs(integrate(structure, system, drive).states[-1] - reference).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 2.7).all(), f"errors {errors}"


def test_a_stiff_node_neither_blows_up_nor_needs_small_steps():
    # A 1 J/K node behind 50 W/K (time constant 0.02 s) follows its neighbour with 60 s steps.
    capacity, times = np.array([1.0, 3000.0]), np.linspace(0, 6000, 101)
    structure, system, drive = linear_network(capacity, {(0, 1): 50.0}, [2.0, 0.0], [250.0, 300.0], times)
    states = integrate(structure, system, drive).states
    augmented = np.zeros((3, 3))
    A, _, _, B, _ = oracle.dense(structure, system)
    augmented[:2, :2], augmented[:2, 2] = A, B[:, 0]
    expected = np.array([(expm(augmented * t) @ [250.0, 300.0, 1.0])[:2] for t in times])
    np.testing.assert_allclose(states[2:], expected[2:], atol=2e-3)


def test_a_massless_node_obeys_its_heat_balance_and_equals_the_limit_of_a_small_capacity():
    structure, system, drive = random_system(4, heaters=0, massless=1)
    x = integrate(structure, system, drive).states
    A, N, _, B, _ = (np.array(matrix) for matrix in oracle.dense(structure, system))
    inputs = np.concatenate([drive.inputs[:1, 0], drive.inputs[:, 1]])
    balance = x @ A[-1] + x**4 @ N[-1] + inputs @ B[-1]
    jump = int(np.flatnonzero(np.diff(drive.times) < 1e-3)[1])
    settled = np.ones(len(x), bool)
    settled[[0, 1, jump + 1, jump + 2]] = False
    assert np.abs(balance[settled]).max() < 1e-5 * np.abs(x * A[-1]).max()

    small = np.array([1.0] * (len(A) - 1) + [1 / 0.05])  # 0.05 J/K: a time constant of milliseconds

    def rate(t, y):
        acting = np.array([np.interp(t, drive.times, column) for column in inputs.T])
        return small * (A @ y + N @ y**4 + B @ acting)

    # Up to the jump, which interpolation would smear.
    span = (drive.times[2], drive.times[jump])
    reference = solve_ivp(rate, span, x[2], method="Radau", rtol=1e-9, atol=1e-8)
    np.testing.assert_allclose(x[jump], reference.y[:, -1], atol=1e-2)


def test_stored_heat_equals_heat_that_came_in():
    """Conduction and radiation between nodes move heat and make none: to rounding, whatever the step."""
    rng = np.random.default_rng(3)
    n, times = 5, np.sort(rng.uniform(0, 5000, 60))
    capacity = rng.uniform(300, 3000, n)
    exchange = np.triu(rng.uniform(0, 2, (n, n)), 1)
    exchange = exchange + exchange.T
    laplacian = exchange - np.diag(exchange.sum(axis=1))
    inputs = rng.uniform(0, 1, (len(times), 2))
    power = rng.uniform(0, 50, (n, 2))
    scale = capacity[:, None]
    structure, system = from_dense(
        np.ones(n), laplacian / scale, 0.02 * STEFAN_BOLTZMANN * laplacian / scale, power / scale, np.zeros((0, n)),
        [], [], [], rng.uniform(250, 320, n),
    )  # fmt: skip
    drive = drive_of(times, inputs)
    states = integrate(structure, system, drive).states
    stored = (states[-1] - states[0]) @ capacity
    received = np.trapezoid(inputs @ power.sum(axis=0), times)
    assert stored == pytest.approx(received, rel=1e-10)


def test_radau_with_events_agrees_to_a_millikelvin_through_twenty_heater_cycles():
    capacity = np.array([2000.0, 5000.0])
    emitting, link, power, lower, upper = 0.12 * STEFAN_BOLTZMANN, 1.2, 45.0, 283.0, 286.0
    steps, step = 1000, 30.0
    times = np.linspace(0, steps * step, steps + 1)
    A = np.array([[-link, link], [link, -link]]) / capacity[:, None]
    N = np.diag([0.0, -emitting]) / capacity[:, None]
    heat = np.array([4.0, 16.0])
    structure, system = from_dense(
        np.ones(2), A, N, (heat / capacity)[:, None], np.array([[power / capacity[0], 0.0]]), [0], [lower], [upper],
        [290.0, 285.0],
    )  # fmt: skip
    drive = drive_of(times, np.ones((steps + 1, 1)), heaters=1)
    run = integrate(structure, system, drive)

    on, t, x, switch_times = False, 0.0, system.initial, []
    expected = np.full((steps + 1, 2), np.nan)
    while t < times[-1]:
        threshold = upper if on else lower

        def crossing(_, y, threshold=threshold):
            return y[0] - threshold

        crossing.terminal, crossing.direction = True, (1.0 if on else -1.0)
        u = power / capacity[0] * on

        def rate(_, y, u=u):
            return A @ y + N @ y**4 + heat / capacity + [u, 0.0]

        piece = solve_ivp(rate, (t, times[-1]), x, "Radau", rtol=1e-10, atol=1e-10, events=crossing, dense_output=True)
        inside = (times >= t) & (times <= piece.t[-1])
        expected[inside] = piece.sol(times[inside]).T
        t, x = piece.t[-1], piece.y[:, -1]
        if piece.status == 1:
            on = not on
            switch_times.append(t)
    assert len(switch_times) >= 40
    assert len(run.switches.time) == len(switch_times)
    assert np.abs(run.switches.time - switch_times).max() < 0.5
    assert np.abs(run.states - expected).max() < 1e-3
