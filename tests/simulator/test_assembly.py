"""The table of terms against a plain evaluation, and its adjoint against differences."""

import numpy as np
import pytest

from flightcal.simulator import build_network
from flightcal.simulator.assembly import ParameterMap, Terms, assemble, own_initial
from flightcal.simulator.system import System, pack

from .. import small
from .systems import assembled, no_parameters, pull_back_assembly
from .test_network import rich

UNUSED = np.zeros((0, 0), np.int64)


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    return build_network(small.load(tmp_path_factory.mktemp("rich"), rich())[0])


def pulled_back(network, numbers, bar):
    """Cotangent of the scenario's numbers: of parameters that each set one of them."""
    places = np.arange(len(numbers))
    nothing = np.zeros(0, np.int64)
    mapping = ParameterMap(len(numbers), np.zeros(len(numbers)), places, places, nothing, nothing)
    theta = np.concatenate([numbers, np.full(len(network.diffusive), 290.0)])
    found = pull_back_assembly(mapping, network.terms, theta, numbers, bar, UNUSED, np.zeros((0, 0)))
    return found[: len(numbers)]


def test_an_entry_is_the_sum_of_its_terms_each_a_product_of_numbers_and_reciprocals():
    one = 3  # position of the one behind three numbers; the reciprocal of number 2 follows it
    terms = Terms(
        entry=np.array([0, 0, 1, 2]),
        constant=np.array([2.0, -1.0, 3.0, 1.0]),
        factors=np.array([[0, 1, one, one, one, one], [4, one, one, one, one, one], [1, 1, 1, 1, 4, one], [one] * 6]),
        inverse=np.array([2]),
        entries=3,
        initial=np.array([0]),
    )
    _, packed = assemble(no_parameters([5.0, 7.0, 4.0]), terms, np.array([290.0]))
    assert packed == pytest.approx([2.0 * 5.0 * 7.0 - 1 / 4.0, 3.0 * 7.0**4 / 4.0, 1.0, 290.0])


def test_a_parameter_sets_its_numbers_and_scales_what_is_written_with_all_that_scale_it():
    factors, nothing = np.array([[k] + [3] * 5 for k in range(3)]), np.zeros(0, np.int64)
    terms = Terms(np.arange(3), np.ones(3), factors, nothing, 3, np.array([0]))
    mapping = ParameterMap(3, np.array([5.0, 7.0, 4.0]), *map(np.array, ([2], [1], [0, 1, 0], [0, 0, 2])))
    thetas = np.array([[2.0, 9.0, 10.0, 280.0], [0.0, 8.0, 3.0, 290.0]])
    numbers, packed = assemble(mapping, terms, thetas)
    np.testing.assert_array_equal(numbers, [[100.0, 14.0, 9.0], [0.0, 0.0, 8.0]])
    np.testing.assert_array_equal(packed, [[100.0, 14.0, 9.0, 280.0], [0.0, 0.0, 8.0, 290.0]])
    bar = np.array([1.0, 10.0, 100.0, 7.0])
    for theta, found, expected in (
        (thetas[0], numbers[0], [50.0 + 70.0, 100.0, 10.0, 7.0]),
        (thetas[1], numbers[1], [15.0 + 70.0, 100.0, 0.0, 7.0]),
    ):
        got = pull_back_assembly(mapping, terms, theta, found, bar, UNUSED, np.zeros((0, 0)))
        np.testing.assert_allclose(got, expected)
    # A number that is used elsewhere too: the first is 5 theta_0 theta_2.
    used = (np.array([[0]]), np.array([[2.0]]))
    got = pull_back_assembly(mapping, terms, thetas[0], numbers[0], 0.0 * bar, *used)
    np.testing.assert_allclose(got, [2.0 * 50.0, 0.0, 2.0 * 10.0, 0.0])


def nothing_but_initial(initial):
    return Terms(
        *(np.zeros(shape, kind) for shape, kind in ((0, int), (0, float), ((0, 6), int), (0, int))), 0, initial
    )


def test_a_massless_state_starts_from_the_mean_of_the_others():
    terms = nothing_but_initial(own_initial(np.array([1.0, 0.0, 1.0])))
    _, packed = assemble(no_parameters([]), terms, np.array([280.0, 300.0]))
    np.testing.assert_array_equal(packed, [280.0, 290.0, 300.0])


def test_an_initial_temperature_that_two_states_start_from_gets_the_cotangent_of_both():
    terms = nothing_but_initial(np.array([1, 0, 1]))
    numbers, packed = assemble(no_parameters([]), terms, np.array([280.0, 300.0]))
    np.testing.assert_array_equal(packed, [300.0, 280.0, 300.0])
    bar = np.array([1.0, 2.0, 4.0])
    got = pull_back_assembly(no_parameters([]), terms, np.array([280.0, 300.0]), numbers, bar, UNUSED, np.zeros((0, 0)))
    np.testing.assert_array_equal(got, [2.0, 5.0])


def test_the_adjoint_is_the_transpose_of_the_derivative(network):
    rng = np.random.default_rng(0)
    initial = np.full(len(network.nodes), 290.0)

    def at(values):
        return pack(assembled(network, values, initial))

    system = at(network.values)
    scale = np.abs(system) + 1e-300
    weights = rng.normal(size=len(system)) / scale
    gradient = pulled_back(network, network.values, weights)
    for k, path in enumerate(network.paths):
        step = np.zeros_like(network.values)
        step[k] = 1e-5 * max(abs(network.values[k]), 1e-3)
        difference = (at(network.values + step) - at(network.values - step)) / (2 * step[k])
        expected = float((weights * difference).sum())
        floor = 1e-9 * float(np.abs(weights * scale).sum()) / max(abs(network.values[k]), 1e-3)
        assert gradient[k] == pytest.approx(expected, rel=1e-5, abs=floor), path


def test_a_number_that_several_terms_use_gets_the_cotangent_of_all(network):
    """The panel's capacity divides every entry of its row: d entry / d capacity = -entry / capacity."""
    system = assembled(network, network.values, np.full(3, 290.0))
    bar = System(*(np.zeros_like(part) for part in system))
    row = network.nodes.index("panel")
    inside = slice(network.structure.linear_start[row], network.structure.linear_start[row + 1])
    bar.linear[inside] = 1.0
    gradient = pulled_back(network, network.values, pack(bar))
    assert gradient[network.position("nodes.panel.capacity")] == pytest.approx(-system.linear[inside].sum() / 800.0)
