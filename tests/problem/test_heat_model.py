"""Which heat a node can have, and how much flows through it."""

import numpy as np
import pytest

from flightcal.problem import as_sampled, build_problem, knots_of, sampled_windows, unit_heats
from flightcal.scenario import HalfNormal, HalfStudentT, Heat
from flightcal.simulator import flow_through
from flightcal.simulator.network import STEFAN_BOLTZMANN
from tests import small
from tests.problem.heated import model_of, problem_of, written


def test_each_heated_node_has_a_constant_a_pattern_and_a_slow_part_and_each_window_its_switches(problem, model):
    found = [(group.part, group.scale, group.node, group.window) for group in model.groups]
    assert found == [
        ("constant", "heat.body.constant", 0, ""),
        ("constant", "heat.panel.constant", 1, ""),
        ("pattern", "heat.body.pattern", 0, ""),
        ("pattern", "heat.panel.pattern", 1, ""),
        ("gains", "heat.gains", -1, ""),
        ("slow", "heat.body.slow", 0, ""),
        ("slow", "heat.panel.slow", 1, ""),
        ("slow_pattern", "heat.body.pattern", 0, ""),
        ("slow_pattern", "heat.panel.pattern", 1, ""),
        ("switches", "", -1, "train.first"),
        ("switches", "", -1, "train.second"),
    ]
    assert model.nodes == ("body", "panel")
    names = tuple(dict.fromkeys(scale for _, scale, *_ in found if scale))
    assert model.names == names
    assert model.scales == (*names, "")
    block = problem.scenario.heat
    for name in names:
        _, node, *part = name.split(".")
        if node == "gains":
            assert model.priors[name] == HalfNormal(scale=block.gains.scale)
            continue
        flow = model.flow[model.nodes.index(node)]
        if part[0] == "slow":
            assert model.priors[name] == HalfStudentT(scale=block.slow.scale * flow, degrees_of_freedom=3.0)
        else:
            assert model.priors[name] == HalfNormal(scale=block.pattern.scale * flow)


def test_parts_that_are_not_written_are_none(tmp_path):
    parts = {"pattern": None, "slow": {"time": "2 h", "scale": 0.1}, "gains": None, "nodes": ["panel"]}
    model = model_of(problem_of(tmp_path, written(heaters=False, heat=parts)))
    assert [(group.part, group.node) for group in model.groups] == [("slow", 0)]
    assert model.groups[0].size == pytest.approx(0.1 * model.flow[0])
    np.testing.assert_allclose(np.diff(model.slow.knots), 7200.0 / 3.0)


def test_slow_heat_has_3_h_and_a_longer_orbit_where_a_pattern_comes_again_in_it(tmp_path):
    content = written(heaters=False)
    assert model_of(problem_of(tmp_path, content)).slow.time == 10800.0
    content["environment"] = {"period": "12 h"}
    assert model_of(problem_of(tmp_path, content)).slow.time == 43200.0
    content["heat"] = {"pattern": {"harmonics": 0}}
    assert model_of(problem_of(tmp_path, content)).slow.time == 10800.0


def test_a_pattern_without_harmonics_is_a_constant(tmp_path):
    parts = {"pattern": {"harmonics": 0}, "slow": None, "gains": None}
    model = model_of(problem_of(tmp_path, written(heaters=False, heat=parts)))
    assert [(group.part, group.node) for group in model.groups] == [("constant", 0), ("constant", 1)]


def test_without_heaters_windows_are_sampled_as_they_are_and_no_switch_is_uncertain(unheated):
    assert sampled_windows(unheated) is unheated.windows
    assert "switches" not in {group.part for group in model_of(unheated).groups}


def test_a_switch_of_a_heater_whose_node_has_no_heat_is_not_uncertain(tmp_path):
    problem = problem_of(tmp_path, written(windows=1, heat={"nodes": ["panel"]}))
    (window,) = sampled_windows(problem)
    assert set(window.switching.heater) == {"heater"}
    model = model_of(problem)
    (switch_units,) = [
        group_units
        for group, group_units in zip(model.groups, unit_heats(model, window), strict=True)
        if group.part == "switches"
    ]
    assert len(switch_units.node) == len(switch_units.series) == 0


def test_with_a_measured_status_windows_are_sampled_in_open_loop(problem):
    assert sampled_windows(problem) is problem.open_loop.windows


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    return small.closed_loop(tmp_path_factory.mktemp("flown"))


def test_where_heat_is_learnt_heaters_are_driven_by_their_measured_status(flown):
    scenario, data = flown
    problem = build_problem(scenario.model_copy(update={"heat": Heat()}), data)
    assert as_sampled(problem).windows is problem.open_loop.windows
    assert as_sampled(problem).open_loop is None


@pytest.mark.parametrize("drifts", [False, True])
def test_thermostats_act_only_where_switches_do_not_tell_of_a_threshold(tmp_path, drifts):
    content = small.content() | {"heat": {}}
    prior = {"normal": {"mean": "10 degC", "standard_deviation": "1 K"}}
    content["parameters"]["threshold"] = {"sets": "heaters.heater.on_below", "prior": prior}
    content["parameters"]["threshold"] |= {"drift": 0.5} if drifts else {}
    problem = build_problem(*small.closed_loop(tmp_path, content))
    (opened,), (sampled,) = problem.open_loop.windows, sampled_windows(problem)
    assert opened.measured_switches is not None
    if drifts:
        assert sampled is problem.windows[0]
    else:
        assert sampled.measured_switches is None
        assert sampled.simulator is opened.simulator


def test_without_heat_thermostats_act(flown):
    scenario, data = flown
    problem = build_problem(scenario.model_copy(update={"heat": "none"}), data)
    assert as_sampled(problem) is problem


def test_knots_cover_each_window_on_one_lattice(problem, model):
    apart = 3600.0
    np.testing.assert_allclose(model.slow.knots % apart, 0.0, atol=1e-9)
    for window, (begin, end) in zip(sampled_windows(problem), ((0.0, 5400.0), (9000.0, 13200.0)), strict=True):
        knots = knots_of(model, window)
        assert set(knots) <= set(model.slow.knots)
        assert knots[0] <= begin < knots[0] + apart
        assert knots[-1] - apart < end <= knots[-1]


# --- heat that flows through a node -------------------------------------------------------------------------------


def network_of(folder, nodes, conductors, *, powers=None, loads=None):
    """A problem of nodes with `noise`; temperatures of the first is observed."""
    content = written(heaters=False)
    first = next(iter(nodes))
    content["simulator"] = {"step": "30 s", "nodes": nodes, "conductors": conductors, "loads": loads or {}}
    if powers:
        content["simulator"]["modes"] = {"on": powers}
    content["parameters"] = {
        "mass": {"scales": [f"nodes.{first}.capacity"], "prior": {"lognormal": {"median": 1.0, "factor": 1.3}}}
    }
    content["observations"] = {"body_temp": {"node": first}}
    return build_problem(*small.load(folder, content))


def flow_of(problem, **initial):
    window = problem.windows[0]
    theta = small.median(window)
    known = {f"initial_{name}": value for name, value in initial.items()}
    theta[window.simulated] = small.theta_of(window.network, **known)
    heated = window.network.network.heated
    found = flow_through(window.network, problem.scenario, heated, theta[window.simulated])
    return dict(zip(heated, found, strict=True))


def test_through_a_node_that_radiates_flows_what_it_dissipates(tmp_path):
    nodes = {"body": {"capacity": "3000 J/K"}, "space": {"boundary": "4 K"}}
    radiates = [{"between": ["body", "space"], "radiative": "0.05 m^2"}]
    problem = network_of(tmp_path, nodes, radiates, powers={"body": "10 W"})
    balance = (10.0 / (0.05 * STEFAN_BOLTZMANN) + 4.0**4) ** 0.25
    assert flow_of(problem, body=balance)["body"] == pytest.approx(10.0, rel=1e-6)


def test_through_a_node_between_two_conductors_flows_what_goes_in_and_out_again(tmp_path):
    # So heavy are the others that nothing changes within the window.
    heavy = {"capacity": "1e9 J/K", "initial": "0 degC"}
    nodes = {"middle": {"capacity": "50 J/K"}, "hot": heavy, "cold": heavy}
    conducts = [
        {"between": ["middle", "hot"], "conductance": "0.3 W/K"},
        {"between": ["middle", "cold"], "conductance": "0.6 W/K"},
    ]
    problem = network_of(tmp_path, nodes, conducts)
    found = flow_of(problem, hot=330.0, middle=290.0, cold=270.0)
    assert found["middle"] == pytest.approx(0.3 * 40.0, rel=1e-4)


def test_through_a_node_that_warms_up_flows_half_of_what_it_keeps(tmp_path):
    problem = network_of(tmp_path, {"body": {"capacity": "3000 J/K"}}, [], powers={"body": "8 W"})
    assert flow_of(problem, body=280.0)["body"] == pytest.approx(4.0, rel=1e-6)


def test_through_a_node_between_two_boundaries_flows_what_goes_in_and_out_again(tmp_path):
    nodes = {"body": {"capacity": "3000 J/K"}, "hot": {"boundary": "330 K"}, "cold": {"boundary": "270 K"}}
    conducts = [
        {"between": ["body", "hot"], "conductance": "0.3 W/K"},
        {"between": ["body", "cold"], "conductance": "0.6 W/K"},
    ]
    assert flow_of(network_of(tmp_path, nodes, conducts), body=290.0)["body"] == pytest.approx(12.0, rel=1e-6)
