"""Whole matrices against the same system by its pattern."""

import sys

import numpy as np
import pytest

from flightcal.simulator import integrate
from flightcal.simulator.dense import whole_matrices
from flightcal.simulator.system import System

from .systems import derivatives_along, drive_of, from_dense, random_system

MODULE = sys.modules["flightcal.simulator.integrate"]


def linked_to_all(seed, nodes=18, massless=3):
    """A system in which every node is linked to every other, about half of them radiate, and two have heaters."""
    rng = np.random.default_rng(seed)
    mass, capacity = np.ones(nodes), rng.uniform(300.0, 1500.0, nodes)
    mass[-massless:], capacity[-massless:] = 0.0, 1.0
    links = np.triu(rng.uniform(0.01, 0.3, (nodes, nodes)), 1)
    links = links + links.T
    emitted = np.where(np.arange(nodes) % 2 == 1, rng.uniform(0.005, 0.03, nodes), 0.0) * 5.67e-8
    exchange = 0.03 * emitted[:, None] * emitted / emitted.max()
    np.fill_diagonal(exchange, 0.0)
    A = links - np.diag(links.sum(axis=1))
    N = exchange - np.diag(emitted + exchange.sum(axis=1))
    times = np.arange(0.0, 5000.0, 40.0)
    times = np.insert(times, 1, 1e-4)
    inputs = np.stack([np.ones(len(times)), np.maximum(np.sin(2 * np.pi * times / 2800.0), 0.0)], axis=1)
    B = rng.uniform(0.0, 4.0, (nodes, 2))
    heating = np.zeros((2, nodes))
    heating[[0, 1], [0, 1]] = 60.0
    scale = capacity[:, None]
    structure, system = from_dense(
        mass, A / scale, N / scale, B / scale, heating / capacity, [0, 1], [281.0, 283.0], [282.5, 284.5],
        np.full(nodes, 283.0) + rng.normal(size=nodes),
    )  # fmt: skip
    return structure, system, drive_of(times, inputs, 2)


@pytest.mark.parametrize("nodes", [12, 16, 18, 25])
def test_states_and_gradient_are_those_by_the_pattern(monkeypatch, nodes):
    structure, system, drive = linked_to_all(1, nodes)
    assert whole_matrices(structure) is not None
    run = integrate(structure, system, drive)
    assert len(run.switches.time) >= 4
    rng = np.random.default_rng(0)
    weights, of_times = rng.normal(size=run.states.shape), rng.normal(size=len(run.switches.time))
    gradient = run.pull_back(weights, of_times)
    monkeypatch.setattr(MODULE, "whole_matrices", lambda structure: None)
    sparse = integrate(structure, system, drive)
    np.testing.assert_allclose(run.states, sparse.states, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.switches.time, sparse.switches.time, rtol=0, atol=1e-6)
    for field, got, wanted in zip(System._fields, gradient, sparse.pull_back(weights, of_times), strict=True):
        np.testing.assert_allclose(got, wanted, rtol=1e-6, atol=1e-8 * np.abs(wanted).max(initial=0.0), err_msg=field)


@pytest.mark.parametrize("field", ["linear", "radiative", "forcing", "heating", "lower", "upper", "initial"])
def test_gradient_agrees_with_finite_differences_across_a_switch(field):
    structure, system, drive = linked_to_all(1)
    run = integrate(structure, system, drive)
    assert len(run.switches.time) >= 4
    got, expected = derivatives_along(structure, system, drive, run, field)
    assert got == pytest.approx(expected, rel=1e-5)


def test_the_derivative_is_the_same_whether_steps_are_kept_or_computed_again(monkeypatch):
    structure, system, drive = linked_to_all(1)
    kept = integrate(structure, system, drive)
    weights = np.random.default_rng(0).normal(size=kept.states.shape)
    expected = kept.pull_back(weights)
    monkeypatch.setattr(MODULE, "_MOST_KEPT", 5 * kept.record.steps.shape[1])
    again = integrate(structure, system, drive)
    assert len(again.record.steps) == 6
    for first, second in zip(expected, again.pull_back(weights), strict=True):
        np.testing.assert_allclose(second, first, rtol=1e-11, atol=1e-11 * np.abs(first).max(initial=0.0))


def test_a_tree_a_small_system_and_one_with_sloped_conductances_keep_their_patterns():
    tree, _, _ = random_system(1, nodes=14)
    small, _, _ = linked_to_all(1, nodes=8)
    sloped, _, _ = random_system(1, nodes=20, slope=4e-3)
    assert whole_matrices(tree) is None
    assert whole_matrices(small) is None
    assert whole_matrices(sloped) is None
