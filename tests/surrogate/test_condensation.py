"""Condensation: what is conserved, what stays apart, and the exact cases."""

from dataclasses import replace

import numpy as np
import pytest

from flightcal.errors import FlightcalError
from flightcal.simulator import build_network
from flightcal.surrogate.candidate import errors_of
from flightcal.surrogate.condensation import condense
from flightcal.surrogate.file import load_task
from flightcal.surrogate.full_order import run_full
from flightcal.surrogate.grouping import merge_alike, name_groups
from flightcal.surrogate.patterns import matching
from flightcal.surrogate.reduce import _condensed, reduce

from . import craft


@pytest.fixture(scope="module")
def task(tmp_path_factory):
    return load_task(craft.write(tmp_path_factory.mktemp("craft")))


def nominal(task, temperature=280.0):
    return {
        name: node.boundary if node.boundary is not None else temperature
        for name, node in task.scenario.simulator.nodes.items()
    }


def sides(task):
    names = list(task.scenario.simulator.nodes)
    return {f"panel_{axis}{sign}": matching(f"bus.{axis}{sign}[*]", names) for axis in "xyz" for sign in "-+"}


def test_capacities_areas_and_couplings_are_conserved(task):
    full = task.scenario.simulator
    condensed = condense(task.scenario, sides(task), nominal(task))
    small = condensed.scenario.simulator
    assert sum(n.capacity or 0.0 for n in small.nodes.values()) == pytest.approx(
        sum(n.capacity or 0.0 for n in full.nodes.values())
    )
    assert sum(f.area for f in small.faces.values()) == pytest.approx(sum(f.area for f in full.faces.values()))
    group_of = {name: group for group, names in condensed.groups.items() for name in names}
    for law in ("conductance", "radiative"):
        cut = sum(
            getattr(c, law) for c in full.conductors if getattr(c, law) and len({group_of[n] for n in c.between}) == 2
        )
        assert sum(getattr(c, law) or 0.0 for c in small.conductors) == pytest.approx(cut)
    for mode, powers in full.modes.items():
        assert sum(small.modes[mode].values()) == pytest.approx(sum(powers.values()))


def test_radiation_between_groups_is_that_between_their_nodes_at_nominal_temperatures(task):
    rng = np.random.default_rng(1)
    temperatures = {name: value + 20.0 * rng.random() for name, value in nominal(task).items()}
    for name in matching("bus.x-[*]", temperatures):
        temperatures[name] += 60.0
    groups = {name: nodes for name, nodes in sides(task).items() if name in ("panel_x-", "panel_x+")}
    condensed = condense(task.scenario, groups, temperatures)
    means = {group: float(np.mean([temperatures[name] for name in names])) for group, names in condensed.groups.items()}
    group_of = {name: group for group, names in condensed.groups.items() for name in names}

    def heat(conductors, label, at):
        total = 0.0
        for c in conductors:
            if c.radiative and {label(n) for n in c.between} == {"panel_x-", "panel_x+"}:
                a, b = sorted(c.between, key=label)
                total += c.radiative * (at[a] ** 4 - at[b] ** 4)
        return total

    by_nodes = heat(task.scenario.simulator.conductors, lambda n: group_of[n], temperatures)
    by_groups = heat(condensed.scenario.simulator.conductors, lambda n: n, means)
    assert by_groups == pytest.approx(by_nodes, rel=1e-12)


def test_groups_of_one_give_the_full_network(task):
    condensed = condense(task.scenario, {}, nominal(task))
    network = build_network(task.scenario)
    runs = run_full(task, task.reduction.training.model_copy(update={"draws": 2}))
    fine = replace(task, reduction=task.reduction.model_copy(update={"step": 10.0}))
    capacity = np.array([task.scenario.simulator.nodes[name].capacity for name in network.nodes])
    candidate, _ = _condensed(fine, network, condensed, capacity)
    (errors,) = errors_of(candidate, runs)
    assert np.abs(errors.temperatures).max() < 1e-6


def test_parameters_go_on_setting_and_scaling_what_they_did(task):
    condensed = condense(task.scenario, sides(task), nominal(task))
    parameters = condensed.scenario.parameters
    labels = {c.label: c for c in condensed.scenario.simulator.conductors}
    assert parameters["battery_link"].sets == ("conductors.battery-panel_z- battery_link.conductance",)
    assert parameters["battery_capacity"].sets == ("nodes.battery.capacity",)
    scaled = [path.removeprefix("conductors.").removesuffix(".radiative") for path in parameters["blanket"].scales]
    assert sum(labels[label].radiative for label in scaled) == pytest.approx(24 * 0.05 * 2 * (0.36 + 0.3 + 0.3) / 24)
    build_network(condensed.scenario)


def test_a_group_that_parameters_touch_differently_is_refused(task):
    with pytest.raises(FlightcalError, match="capacities that parameters touch differently"):
        condense(task.scenario, {"both": ["battery", "unit"]}, nominal(task))


def test_a_sensor_in_a_group_keeps_its_distance_from_the_mean(task):
    temperatures = nominal(task)
    temperatures["bus.z-[1,1]"] += 4.0
    condensed = condense(task.scenario, {"panel": matching("bus.z-[*]", temperatures)}, temperatures)
    assert condensed.scenario.observations["structure_1"].bias == pytest.approx(3.0)
    assert condensed.scenario.observations["structure_1"].node == "panel"


def test_nodes_that_behave_alike_are_merged_first():
    time = np.linspace(0.0, 10.0, 200)
    temperatures = np.stack(
        [np.sin(time), np.sin(time) + 0.01, np.cos(time), np.cos(time) + 0.02, np.sin(time) + 0.001], axis=1
    )
    groups = merge_alike(temperatures, np.ones(5), ["a"] * 5, [4], 3)
    assert sorted(map(sorted, groups)) == [[0, 1], [2, 3], [4]]
    apart = merge_alike(temperatures, np.ones(5), ["a", "b", "a", "a", "a"], [], 1)
    assert sorted(map(sorted, apart)) == [[0, 2, 3, 4], [1]]
    assert name_groups([["p[0,0]", "p[0,1]"], ["p[1,1]"]], {}) == {"p_1": ["p[0,0]", "p[0,1]"]}


def test_more_nodes_are_chosen_for_a_smaller_tolerance(tmp_path):
    changes = {"method": "condensation", "condensation": {"most_nodes": 40}}
    sizes = []
    for tolerance in ("4 K", "1 K"):
        task = load_task(craft.write(tmp_path, {**changes, "tolerance": tolerance}))
        reduced = reduce(task)
        sizes.append(reduced.candidate.states)
        assert reduced.tried[-1].error <= task.reduction.tolerance
    assert sizes[0] < sizes[1] < 50
