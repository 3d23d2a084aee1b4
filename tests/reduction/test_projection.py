"""Projection: exact where nothing is left out, differentiable, close where little is kept."""

from dataclasses import replace

import numpy as np
import pytest

from flightcal.reduction.affine import decompose, product_of
from flightcal.reduction.candidate import errors_of, simulator_on, theta_of
from flightcal.reduction.file import load_task
from flightcal.reduction.full_heat import full_heat
from flightcal.reduction.full_order import run_full, window_simulator
from flightcal.reduction.names import node_name
from flightcal.reduction.projection import choose_shapes, collect, project
from flightcal.reduction.reduce import reduce
from flightcal.reduction.reduced_model import initial_given
from flightcal.reduction.reduced_scenario import reduced_scenario
from flightcal.reduction.spacecraft import medians_of
from flightcal.reduction.storage import load, save, stored_of
from flightcal.simulator import build_network
from tests.reduction import craft

OWN = ["battery", "unit", "bus.z-[1,1]"]


@pytest.fixture(scope="module")
def task(tmp_path_factory):
    return load_task(craft.write(tmp_path_factory.mktemp("craft")))


@pytest.fixture(scope="module")
def training(task):
    return run_full(task, task.reduction.training)


def model_of(task, training, order, sampled, light=300.0):
    network = build_network(task.scenario)
    affine = decompose(network, task.scenario, medians_of(task.scenario))
    snapshots = collect(network, affine, training, OWN, order, light)
    shapes = choose_shapes(snapshots, OWN, order)
    return project(network, affine, task.scenario, shapes, snapshots, sampled, OWN)


def test_the_affine_matrices_give_the_networks_own_entries_at_any_theta(task):
    network = build_network(task.scenario)
    run = task.reduction.training.windows["march"]
    simulator, _ = window_simulator(task.with_timeline(run), *task.bounds(run), task.period)
    theta = np.array([1.7, 0.33, 0.51, 6100.0, 17.0])
    affine = decompose(network, task.scenario, theta)
    system = simulator.system(np.concatenate([theta, np.full(len(network.diffusive), 280.0)]))
    capacity = sum(product_of(affine.values, p) * c for p, c in affine.capacity.items())
    for kind, values in (("linear", system.linear), ("radiative", system.radiative)):
        start = getattr(network.structure, f"{kind}_start").astype(int)
        rows = np.repeat(np.arange(len(network.nodes)), np.diff(start))
        columns = getattr(network.structure, f"{kind}_column").astype(int)
        matrix = sum(product_of(affine.values, p) * m for p, m in affine.matrices[kind].items())
        np.testing.assert_allclose(np.asarray(matrix[rows, columns]).ravel() / capacity[rows], values, rtol=1e-12)


def test_the_whole_basis_gives_the_full_network(task, training):
    n = len(build_network(task.scenario).nodes)
    fine = replace(task, reduction=task.reduction.model_copy(update={"step": 10.0}))
    model = model_of(fine, training, n, n, light=1e-9)
    assert len(model.states) == n
    (errors,) = errors_of(fine, model, training, 3)
    assert errors.failed == 0
    # At the steps' ends they are equal; inside, massless states take another form of the cubic (see `sampling`).
    assert np.abs(errors.temperatures).max() < 1e-5
    assert np.abs(errors.duty).max() < 1e-8


def test_a_few_states_keep_unseen_runs_within_tenths_of_a_kelvin(task, training):
    model = model_of(task, training, 10, 12)
    assert model.followers > 0
    errors = errors_of(task, model, run_full(task, task.reduction.held_out))
    assert np.quantile(np.abs(errors[0].temperatures), 0.95) < 0.3
    # Fewer states are worse, so the measure measures something.
    poor = model_of(task, training, 4, 6)
    worse = errors_of(task, poor, run_full(task, task.reduction.held_out))
    assert np.abs(worse[0].temperatures).mean() > 2.0 * np.abs(errors[0].temperatures).mean()


@pytest.mark.parametrize(
    ("projection", "settled"), [({"states": 5}, 6), ({"states": 20, "most_states": 20, "follow_within": "40 s"}, 0)]
)
def test_shapes_settle_at_once_only_where_that_is_better(tmp_path, projection, settled):
    found = reduce(load_task(craft.write(tmp_path, {"projection": projection, "tolerance": "0.01 K"})))
    assert len(found.tried) == 2
    assert len(found.model.settled) == settled
    chosen, other = sorted(item.error for item in found.tried)
    assert chosen < 0.6 * other
    assert found.model.massless == min(found.tried, key=lambda item: item.error).massless


def test_the_gradient_agrees_with_finite_differences(task, training):
    model = model_of(task, training, 8, 10)
    run = training[0]
    simulator, theta = simulator_on(task, model, run), theta_of(model, run, 0)
    weights = np.random.default_rng(3).standard_normal((len(run.times), len(simulator.channels)))
    trajectory, cotangent = simulator.linearise(theta)
    assert len(trajectory.switches.time) > 0
    gradient = cotangent(weights)
    for k in range(len(theta)):
        h = 1e-6 * max(abs(theta[k]), 1.0)
        above, below = theta.copy(), theta.copy()
        above[k] += h
        below[k] -= h
        difference = np.sum(
            weights * (simulator.simulate(above).temperatures - simulator.simulate(below).temperatures)
        ) / (2.0 * h)
        assert gradient[k] == pytest.approx(difference, rel=2e-4, abs=2e-6 * np.abs(gradient).max())


def test_heat_that_goes_in_is_stored_or_goes_out(task, training):
    """The isothermal shape is nearly in the basis, so the model keeps the balance of the whole spacecraft."""
    network = build_network(task.scenario)
    affine = decompose(network, task.scenario, medians_of(task.scenario))
    snapshots = collect(network, affine, training, OWN, 10, 300.0)
    shapes = choose_shapes(snapshots, OWN, 10)
    capacity = sum(product_of(affine.values, p) * c for p, c in affine.capacity.items())[snapshots.stored]
    # A uniform change of all temperatures by 1 K, as the states see it.
    uniform = shapes.lift @ np.ones(10)
    stored = capacity @ uniform / capacity.sum()
    assert stored == pytest.approx(1.0, abs=0.05)


def test_a_model_read_back_gives_the_same_numbers(task, training, tmp_path):
    model = model_of(task, training, 8, 10)
    run = training[0]
    scenario = reduced_scenario(task.scenario, model, 60.0)
    save(tmp_path / "rom.nc", stored_of(model, task.scenario, scenario.network, {}, full_heat(task)))
    again = load(tmp_path / "rom.nc")
    theta = theta_of(model, run, 1)
    first, second = (simulator_on(task, item, run).simulate(theta) for item in (model, again.model))
    np.testing.assert_array_equal(first.temperatures, second.temperatures)
    assert again.parameters["reduced.battery_link"].unit == "W/K"


def test_a_state_without_a_thermistor_starts_where_the_others_say(task, training):
    model = model_of(task, training, 10, 12)
    states = [training[0].nodes.index(name) for name in model.states]
    reached = training[0].temperatures[:, ::20][..., states].reshape(-1, len(states))
    seen = [k for k, name in enumerate(model.states) if name in OWN]
    rest = [k for k in range(len(states)) if k not in seen]
    off = []
    for temperatures in reached:
        known = {node_name(model.states[k]): temperatures[k] for k in seen}
        found = initial_given(model, known, 0.1)
        assert found.keys() == {node_name(model.states[k]) for k in rest}
        off.append([(temperatures[k] - found[node_name(model.states[k])][0]) for k in rest])
    deviations = np.array([found[node_name(model.states[k])][1] for k in rest])
    errors = np.sqrt(np.mean(np.square(off), axis=0))
    np.testing.assert_allclose(errors, deviations, rtol=0.35)
    assert (deviations < 0.8 * np.sqrt(np.diag(model.initial_covariance))[rest]).all()
