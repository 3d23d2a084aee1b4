"""The table of terms against a plain evaluation, and its adjoint against differences."""

import numpy as np
import pytest

from flightcal.simulator import build_network
from flightcal.simulator.assembly import Terms, assemble, pull_back_assembly
from flightcal.simulator.system import System, make_structure

from .. import small
from .test_network import rich


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    return build_network(small.load(tmp_path_factory.mktemp("rich"), rich())[0])


def flat(system):
    return np.concatenate([system.linear, system.radiative, system.forcing, system.heating, system.lower, system.upper])


def test_an_entry_is_the_sum_of_its_terms_each_a_product_of_numbers_and_reciprocals():
    structure = make_structure(np.ones(1), [(0, 0)], [(0, 0)], [(0, 0)], [], [])
    one = 3  # position of the one behind three numbers; the reciprocal of number 2 follows it
    terms = Terms(
        entry=np.array([0, 0, 1, 2]),
        constant=np.array([2.0, -1.0, 3.0, 1.0]),
        factors=np.array([[0, 1, one, one, one, one], [4, one, one, one, one, one], [1, 1, 1, 1, 4, one], [one] * 6]),
        inverse=np.array([2]),
        entries=3,
    )
    system = assemble(terms, structure, np.array([5.0, 7.0, 4.0]), np.zeros((2, 0), int), np.zeros(1))
    assert system.linear == pytest.approx([2.0 * 5.0 * 7.0 - 1 / 4.0])
    assert system.radiative == pytest.approx([3.0 * 7.0**4 / 4.0])
    assert system.forcing == pytest.approx([1.0])


def test_the_adjoint_is_the_transpose_of_the_derivative(network):
    rng = np.random.default_rng(0)
    initial = np.zeros(len(network.nodes))

    def at(values):
        return assemble(network.terms, network.structure, values, network.thresholds, initial)

    system = at(network.values)
    scale = np.abs(flat(system)) + 1e-300
    weights = System(*(rng.normal(size=np.shape(part)) / (np.abs(part) + 1e-300) for part in system))
    gradient = pull_back_assembly(network.terms, network.values, network.thresholds, weights)
    for k, path in enumerate(network.paths):
        step = np.zeros_like(network.values)
        step[k] = 1e-5 * max(abs(network.values[k]), 1e-3)
        difference = (flat(at(network.values + step)) - flat(at(network.values - step))) / (2 * step[k])
        expected = float((flat(weights) * difference).sum())
        floor = 1e-9 * float(np.abs(flat(weights) * scale).sum()) / max(abs(network.values[k]), 1e-3)
        assert gradient[k] == pytest.approx(expected, rel=1e-5, abs=floor), path


def test_a_number_that_several_terms_use_gets_the_cotangent_of_all(network):
    """The panel's capacity divides every entry of its row: d entry / d capacity = -entry / capacity."""
    system = assemble(network.terms, network.structure, network.values, network.thresholds, np.zeros(3))
    bar = System(*(np.zeros_like(part) for part in system))
    row = network.nodes.index("panel")
    inside = slice(network.structure.linear_start[row], network.structure.linear_start[row + 1])
    bar.linear[inside] = 1.0
    position = network.position("nodes.panel.capacity")
    gradient = pull_back_assembly(network.terms, network.values, network.thresholds, bar)
    assert gradient[position] == pytest.approx(-system.linear[inside].sum() / 800.0)
