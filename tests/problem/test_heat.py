"""Problems with unmodelled heat, against simulations with that heat and against dense normal distributions."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.linalg import block_diag, cho_factor, cho_solve

from flightcal.probability import Gains, Profile, Shaped, Slow
from flightcal.problem import (
    SLOW,
    at_sizes,
    build_problem,
    errors_of_weights,
    exact_heat,
    followed,
    heat_model,
    heat_of_weights,
    heat_units,
    held_by,
    hold,
    kept_responses,
    knots_of,
    patterns_of,
    places_of,
    responses,
    sampled_windows,
    split,
    unit_heats,
    with_heat,
)
from flightcal.scenario import HalfNormal, HalfStudentT
from flightcal.simulator import SimulationFailure, flow_through
from flightcal.simulator.network import STEFAN_BOLTZMANN
from tests import small

HARMONICS = 2
SHAPES = (Shaped(480.0, 0.3), Shaped(0.0, 1.0))


def written(*, heaters=True, windows=2, **more):
    """Windows to train on, of one orbit and of less; with heat."""
    content = small.content() | {"heat": {"pattern": {"harmonics": HARMONICS}}} | more
    content["noise"] = {"model": "ar1", "correlation_time": "8 min", "white": "0.05 K"}
    spans = {
        "first": {"start": "2024-03-01T00:00:00", "end": "2024-03-01T01:30:00"},
        "second": {"start": "2024-03-01T02:30:00", "end": "2024-03-01T03:40:00"},
    }
    content["windows"] = {"train": dict(list(spans.items())[:windows])}
    if not heaters:
        del content["simulator"]["heaters"], content["observations"]["heater_status"], content["parameters"]["power"]
    return content


def problem_of(folder, content=None):
    scenario, data = small.closed_loop(folder, content or written())
    # A status that is not seen all the time.
    if "heater_status" in data:
        data["heater_status"].values[60:63] = np.nan
    return build_problem(scenario, data)


def model_of(problem):
    windows = sampled_windows(problem)
    theta = problem.at(windows[0], problem.priors.median()[None])[0]
    return heat_model(problem.scenario, problem.scenario.heat, windows, theta)


def looked_at(model, windows):
    """A model of which some directions of each group are kept, and heat at the centre."""
    rng = np.random.default_rng(0)
    counts = np.max([[len(own.node) for own in unit_heats(model, window)] for window in windows], axis=0)
    kept = []
    for count in counts:
        directions = np.linalg.qr(rng.normal(size=(count, count)))[0]
        kept.append(directions[:, : count - count // 4])
    # What errors of the simulator are is linear everywhere, so they are not at the centre.
    sizes = [0.0 if g.part == "error" else g.size for g in model.groups]
    scales = np.repeat(sizes, [basis.shape[1] for basis in kept])
    return replace(model, kept=tuple(kept), centre=0.5 * scales * rng.normal(size=len(scales)), shapes=SHAPES)


TRUE = {"noise.body_temp": 0.1} | small.TRUTH


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    return problem_of(tmp_path_factory.mktemp("heat"))


@pytest.fixture(scope="module")
def unheated(tmp_path_factory):
    """Without heaters."""
    return problem_of(tmp_path_factory.mktemp("heat"), written(heaters=False))


@pytest.fixture(scope="module")
def model(problem):
    return model_of(problem)


def middle(problem):
    """theta [d] of a problem without heat."""
    known = dict(zip(problem.names, problem.priors.median(), strict=True)) | TRUE
    return np.array([known[name] for name in problem.names])


@pytest.fixture(scope="module")
def centre(problem):
    return middle(problem)


def with_some_heat(problem):
    """A problem, and the same with heat."""
    model, theta = model_of(problem), middle(problem)
    windows = sampled_windows(problem)
    found = [held_by(window, problem.at(window, theta[None])[0]) for window in windows]
    model = replace(model, held=tuple(own for own in found if own is not None))
    windows = [window if own is None else hold(window, own) for window, own in zip(windows, found, strict=True)]
    return problem, with_heat(problem, looked_at(model, windows), theta)


def in_place_of_another(problem):
    """The same problem, whose simulator stands in for another: the shapes of its error are of one channel each."""

    def erring(window):
        samples = len(window.times)
        basis, wave = np.zeros((samples, 2, 3)), np.linspace(0.0, 6.0, samples)
        basis[:, 0, 0], basis[:, 0, 1], basis[:, 1, 2] = 1.0, np.sin(wave), np.cos(wave)
        simulator = replace(window.simulator, error_basis=basis, error_variance=np.array([0.2, 0.1, 0.05]) ** 2)
        return replace(window, simulator=simulator)

    return replace(problem, windows=tuple(map(erring, problem.windows)))


@pytest.fixture(scope="module", params=["open loop", "two windows without heaters", "with an error"])
def both(request, tmp_path_factory):
    """Problem without heat and with it."""
    content = written(windows=1) if request.param == "open loop" else written(heaters=False)
    problem = problem_of(tmp_path_factory.mktemp("heat"), content)
    return with_some_heat(in_place_of_another(problem) if request.param == "with an error" else problem)


@pytest.fixture(scope="module")
def heated(both):
    return both[1]


@pytest.fixture(scope="module")
def at_centre(both):
    """z [d] of the problem with heat."""
    problem, heated = both
    known = dict(zip(problem.names, middle(problem), strict=True))
    theta = [known.get(name, median) for name, median in zip(heated.names, heated.priors.median(), strict=True)]
    return heated.to_z(np.array(theta))


@pytest.fixture(scope="module")
def known(heated, at_centre):
    """At known sizes."""
    return at_sizes(heated, heated.to_theta(at_centre))


@pytest.fixture(scope="module")
def at_known(heated, known, at_centre):
    return np.array([at_centre[heated.names.index(name)] for name in known.names])


# --- what it is made of -----------------------------------------------------------------------------------------


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
        ("slow_pattern", "heat.body.slow_pattern", 0, ""),
        ("slow_pattern", "heat.panel.slow_pattern", 1, ""),
        ("switches", "", -1, "train.first"),
        ("switches", "", -1, "train.second"),
    ]
    assert model.nodes == ("body", "panel")
    names = tuple(dict.fromkeys(scale for _, scale, *_ in found if scale))
    assert model.names == names
    assert model.scales == (*names, "")
    block = problem.scenario.heat
    of_flow = dict.fromkeys(("constant", "pattern"), block.pattern.scale)
    for name in names:
        _, node, *part = name.split(".")
        if node == "gains":
            assert model.priors[name] == HalfNormal(scale=block.gains.scale)
            continue
        flow = model.flow[model.nodes.index(node)]
        if part[0] == "slow":
            assert model.priors[name] == HalfStudentT(scale=block.slow.scale * flow, degrees_of_freedom=3.0)
        else:
            assert model.priors[name] == HalfNormal(scale=of_flow.get(part[0], block.slow.scale) * flow)


def test_parts_that_are_not_written_are_none(tmp_path):
    parts = {"pattern": None, "slow": {"time": "2 h", "scale": 0.1}, "gains": None, "nodes": ["panel"]}
    model = model_of(problem_of(tmp_path, written(heaters=False, heat=parts)))
    assert [(group.part, group.node) for group in model.groups] == [("slow", 0)]
    assert model.groups[0].size == pytest.approx(0.1 * model.flow[0])
    np.testing.assert_allclose(np.diff(model.slow.knots), 7200.0 / 3.0)


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
    (own,) = [
        own for group, own in zip(model.groups, unit_heats(model, window), strict=True) if group.part == "switches"
    ]
    assert len(own.node) == len(own.series) == 0


def test_with_a_measured_status_windows_are_sampled_in_open_loop(problem):
    assert sampled_windows(problem) is problem.open_loop.windows


def test_knots_cover_each_window_on_one_lattice(problem, model):
    apart = problem.scenario.heat.slow.time / 3.0
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


# --- in a window --------------------------------------------------------------------------------------------------


def by_group(model, units, part):
    return [own for group, own in zip(model.groups, units, strict=True) if group.part == part]


def energy(window, series):
    """J of heat [..., 2 K]."""
    steps = np.diff(window.network.drive.times)
    return series.reshape(*series.shape[:-1], -1, 2).mean(axis=-1) @ steps


def test_over_an_orbit_a_patterns_harmonics_add_nothing_to_the_constant(problem, model):
    window = sampled_windows(problem)[0]
    assert window.network.drive.times[-1] == small.PERIOD
    units = unit_heats(model, window)
    for own in by_group(model, units, "constant"):
        np.testing.assert_allclose(own.series, 1.0, rtol=1e-12)
        assert len(own.series) == 1
    for own in by_group(model, units, "pattern"):
        assert len(own.series) == 2 * HARMONICS
        # Linear between points at most 20 s apart.
        curvature = (2.0 * np.pi * HARMONICS / small.PERIOD) ** 2
        found = energy(window, own.series)
        np.testing.assert_allclose(found, 0.0, atol=20.0**2 / 12.0 * curvature * small.PERIOD)


def test_a_simulators_error_is_that_of_its_own_window_and_no_heat(unheated):
    problem = in_place_of_another(unheated)
    model = model_of(problem)
    for window in problem.windows:
        units = unit_heats(model, window)
        theta = problem.at(window, problem.priors.median()[None])[0]
        found = zip(model.groups, units, responses(window, theta, model, units), strict=True)
        errors = [(group, own, response) for group, own, response in found if group.part == "error"]
        assert [group.window for group, *_ in errors] == ["train.first", "train.second"]
        simulator = window.simulator
        for group, own, response in errors:
            assert not own.series.any()
            if group.window == window.name:
                expected = simulator.error_basis * np.sqrt(simulator.error_variance)
                np.testing.assert_allclose(response, expected, rtol=1e-12)
            else:
                assert response.shape[2] == 0
        weights = [np.ones(len(own.node)) for own in units]
        expected = (simulator.error_basis * np.sqrt(simulator.error_variance)).sum(axis=2)
        np.testing.assert_allclose(errors_of_weights(units, weights), expected, rtol=1e-12)
        alone = [np.zeros(len(own.node)) if own.error is None else np.ones(len(own.node)) for own in units]
        assert not heat_of_weights(model, units, alone).any()


def test_a_pattern_is_the_same_at_the_same_phase_of_every_window(problem, model):
    phase = np.linspace(3700.0, 5300.0, 30)
    found = []
    for window, start in zip(sampled_windows(problem), (0.0, 9000.0), strict=True):
        series = by_group(model, unit_heats(model, window), "pattern")[0].series
        middle = start + 0.5 * (window.network.drive.times[1:] + window.network.drive.times[:-1])
        order = np.argsort(middle % small.PERIOD)
        means = series.reshape(len(series), -1, 2).mean(axis=2)[:, order]
        found.append([np.interp(phase, (middle % small.PERIOD)[order], own) for own in means])
    np.testing.assert_allclose(found[0], found[1], rtol=0.0, atol=1e-3)


def test_the_gain_of_a_load_is_the_heat_of_that_load(problem, model):
    window = sampled_windows(problem)[1]
    (own,) = by_group(model, unit_heats(model, window), "gains")
    drive = window.network.drive
    amperes = drive.series[window.network.network.columns.index("driver.sun")]
    theta = problem.at(window, problem.priors.median()[None])[0]
    coefficient = 12.0 * theta[window.names.index("panel_size")]
    assert own.node.tolist() == [1]
    np.testing.assert_allclose(own.series[0], coefficient * amperes, rtol=1e-12)


def test_a_gain_does_what_a_larger_coefficient_does(problem, model, centre):
    window = sampled_windows(problem)[0]
    theta = problem.at(window, problem.priors.median()[None])[0]
    (own,) = by_group(model, unit_heats(model, window), "gains")
    heat = np.zeros((2, own.series.shape[1]))
    heat[1] = 0.1 * own.series[0]
    simulator, mapping = window.network, window.network.mapping
    numbers = mapping.written.copy()
    numbers[simulator.network.position("loads.sun.coefficient")] *= 1.1
    expected = replace(simulator, mapping=mapping._replace(written=numbers)).simulate(theta[window.simulated])
    found = simulator.with_heat(heat).simulate(theta[window.simulated])
    np.testing.assert_allclose(found.temperatures, expected.temperatures, rtol=0.0, atol=1e-8)


def test_a_switch_is_uncertain_by_its_heaters_power_over_a_sampling_interval(problem, model):
    windows = sampled_windows(problem)
    for window, other in zip(windows, reversed(windows), strict=True):
        units = dict(
            zip([group.window or group.scale for group in model.groups], unit_heats(model, window), strict=True)
        )
        switching, own = window.switching, units[window.name]
        assert len(switching.time) > 4
        assert len(own.node) == len(switching.time)
        np.testing.assert_allclose(energy(window, own.series), 30.0 * switching.interval / np.sqrt(12.0), rtol=1e-9)
        assert set(own.node) == {model.nodes.index("body")}
        assert not len(units[other.name].node)


def over_the_sun(folder):
    """A problem whose pattern is over the Sun sensor's current."""
    return problem_of(folder, written(heat={"pattern": {"over": "sun"}}))


def test_a_pattern_over_a_driver_is_the_same_at_the_same_value_of_it_and_of_no_other_time(tmp_path):
    problem = over_the_sun(tmp_path)
    model = model_of(problem)
    found, current = [], []
    for window in sampled_windows(problem):
        (own, _) = by_group(model, unit_heats(model, window), "pattern")
        weights = np.random.default_rng(1).standard_normal(len(own.node))
        drive = window.network.drive
        found.append((weights @ own.series).reshape(-1, 2))
        current.append(
            np.stack([drive.inputs[:, k, window.network.network.columns.index("driver.sun")] for k in (0, 1)], axis=1)
        )
    heat, amperes = np.concatenate(found), np.concatenate(current)
    # In shadow the current is zero: one heat, whatever the time.
    dark = amperes.max(axis=1) == 0.0
    assert dark.sum() > 20
    assert np.ptp(heat[dark]) < 1e-9
    assert np.ptp(heat[~dark]) > 0.1


def test_a_profile_is_a_smooth_process_that_goes_back_to_its_prior_beyond_a_length():
    profile = Profile(np.linspace(0.0, 10.0, 101), 2.0, (0.0, 10.0))
    draws = np.random.default_rng(0).standard_normal((4000, 101)) @ profile.at(np.array([1.0, 1.1, 3.0, 9.0]))
    correlation = np.corrcoef(draws.T)
    # Of 4000 draws a correlation is known to 0.016, a deviation to 1.1%.
    np.testing.assert_allclose(draws.std(axis=0), 1.0, atol=0.05)
    x = np.sqrt(3.0) * np.array([0.05, 1.0, 4.0])
    np.testing.assert_allclose(correlation[0, 1:], (1.0 + x) * np.exp(-x), atol=0.07)


def test_patterns_over_a_driver_are_over_its_range(tmp_path):
    problem = over_the_sun(tmp_path)
    model = model_of(problem)
    assert model.profile.range == (0.0, pytest.approx(1.0, abs=1e-3))
    # Three lengths beyond, each a fifth of the range.
    assert (model.profile.knots[0], model.profile.knots[-1]) == (
        pytest.approx(-0.6, abs=2e-3),
        pytest.approx(1.6, abs=2e-3),
    )
    kept = tuple(np.eye(len(own.node)) for own in unit_heats(model, sampled_windows(problem)[0]))
    looked = replace(model, kept=kept)
    weights = np.random.default_rng(2).standard_normal((1, sum(own.shape[1] for own in kept)))
    places = places_of(model, 3)
    whole = patterns_of(looked, weights, places)
    groups = dict(zip([group.scale for group in model.groups], split(looked, weights), strict=True))
    constant, functions = groups["heat.panel.constant"][0], groups["heat.panel.pattern"][0]
    expected = constant[0] + functions @ model.profile.at(places[1:2])[:, 0]
    assert whole[0, model.nodes.index("panel"), 1] == pytest.approx(expected)


def with_gap(folder, content, first, last):
    """The problem with the Sun sensor's samples from minute `first` to `last` missing, and how much it varies, A."""
    scenario, data = small.closed_loop(folder, content)
    data["sun"].values[first : last + 1] = np.nan
    return build_problem(scenario, data), float(np.nanstd(data["sun"].values))


def test_a_gap_in_a_driver_is_unknown_heat_of_its_load_while_it_lasts(tmp_path):
    # From 01:41 to 02:39 in shadow and sunlight; "first" has ended at 01:30, "second" begins at 02:30.
    for (first, last), window, seconds in (((20, 45), 0, 27 * 60), ((101, 159), 1, 10 * 60)):
        folder = tmp_path / str(first)
        folder.mkdir()
        content = written()
        content["telemetry"]["channels"]["sun"]["fill"] = "previous_orbit"
        problem, deviation = with_gap(folder, content, first, last)
        model = model_of(problem)
        windows = sampled_windows(problem)
        (own,) = by_group(model, unit_heats(model, windows[window]), "gaps")
        theta = problem.at(windows[window], problem.priors.median()[None])[0]
        coefficient = 12.0 * theta[windows[window].names.index("panel_size")]
        pieces = max(1, round(seconds / 600.0))
        assert own.node.tolist() == [model.nodes.index("panel")] * pieces
        np.testing.assert_allclose(
            energy(windows[window], own.series), coefficient * deviation * seconds / pieces, rtol=1e-9
        )
        (other,) = by_group(model, unit_heats(model, windows[1 - window]), "gaps")
        assert not len(other.node)


def test_a_driver_without_a_gap_leaves_no_heat_unknown(model):
    assert not any(group.part == "gaps" for group in model.groups)


def test_slow_heat_is_the_process_on_the_constant_and_on_each_harmonic(problem, model):
    window = sampled_windows(problem)[0]
    units, count = unit_heats(model, window), len(model.slow.knots)
    constant, around = (by_group(model, units, part)[1].series for part in SLOW)
    assert (len(constant), len(around)) == (count, 2 * HARMONICS * count)
    constant = constant.reshape(count, -1, 2).mean(axis=2)
    cosine, sine, *_ = around.reshape(2 * HARMONICS, count, -1, 2).mean(axis=3)
    middle = 0.5 * (window.network.drive.times[1:] + window.network.drive.times[:-1])
    process = Slow(model.slow.knots, model.slow.time).at(middle)
    np.testing.assert_allclose(constant, process, atol=1e-6)
    angle = 2.0 * np.pi * middle / small.PERIOD
    shift = np.arctan2(sine[0] / process[0], cosine[0] / process[0])
    np.testing.assert_allclose(np.angle(np.exp(1j * (shift - angle - (shift - angle)[0]))), 0.0, atol=2e-3)


def test_responses_are_what_a_little_heat_does(problem, model, centre):
    window = sampled_windows(problem)[0]
    theta = problem.at(window, centre[None])[0]
    units = unit_heats(model, window)
    found = responses(window, theta, model, units)
    rng = np.random.default_rng(0)
    weights = [
        0.02 * group.size * rng.normal(size=len(own.node)) for group, own in zip(model.groups, units, strict=True)
    ]
    heat = heat_of_weights(model, units, weights)
    sides = [window.network.with_heat(sign * heat).simulate(theta[window.simulated]).temperatures for sign in (1, -1)]
    expected = sum(own @ of_group for own, of_group in zip(found, weights, strict=True))
    assert np.abs(expected).max() > 0.01
    # A heat's third power is left: temperatures cubed over the absolute one squared, and the nudge's.
    np.testing.assert_allclose(0.5 * (sides[0] - sides[1]), expected, rtol=0.0, atol=1e-4 * np.abs(expected).max())


def test_heat_that_changes_a_temperature_without_bound_is_a_failure(problem, model, centre, monkeypatch):
    monkeypatch.setattr(heat_units, "_MOST_CHANGED", 1e-3)
    window = sampled_windows(problem)[0]
    with pytest.raises(SimulationFailure, match=r"more than 0\.001 K"):
        responses(window, problem.at(window, centre[None])[0], model, unit_heats(model, window))


def test_held_heaters_do_what_they_did_where_the_status_is_not_known(problem, centre):
    window = sampled_windows(problem)[0]
    assert np.isnan(window.network.drive.measured).any()
    theta = problem.at(window, centre[None])[0]
    held = held_by(window, theta)
    found = hold(window, held)
    assert not np.isnan(found.network.drive.measured).any()
    run, expected = found.simulate(theta), window.simulate(theta)
    # Within a step a share of the power stands for a switch.
    step, power, capacity = 30.0, 30.0, 3000.0
    assert np.abs(run.temperatures - expected.temperatures).max() < 0.25 * step * power / capacity
    np.testing.assert_allclose(run.duty_cycle, expected.duty_cycle, atol=1e-9)
    assert len(found.switching.time) == len(window.switching.time) + len(held.switches)


def test_a_heater_that_leaves_a_gap_otherwise_than_simulated_has_switched_once_more_in_it(problem, centre):
    window = sampled_windows(problem)[0]
    theta = problem.at(window, centre[None])[0]
    simulator, drive = window.network, window.network.drive
    as_simulated = held_by(window, theta)
    gap = np.array([step for step, _, _ in as_simulated.shares])
    begin, end = drive.times[gap[0]], drive.times[gap[-1] + 1]
    for after in (0.0, 1.0):
        measured = drive.measured.copy()
        measured[gap[-1] + 1 : gap[-1] + 5, 0] = after
        told = replace(window, simulator=replace(simulator, drive=replace(drive, measured=measured)))
        held = held_by(told, theta)
        assert held.shares[-1][2] == pytest.approx(after)
        if after == as_simulated.shares[-1][2]:
            assert held == as_simulated
            continue
        assert len(held.switches) == len(as_simulated.switches) + 1
        time, _, within = held.switches[-1]
        last = max((time for time, _, _ in as_simulated.switches), default=begin)
        # Anywhere between the last switch and the end, of which that is mean and width.
        assert (time, within) == pytest.approx((0.5 * (last + end), end - last))
        on = sum(share * (drive.times[step + 1] - drive.times[step]) for step, _, share in held.shares)
        before = sum(share * (drive.times[step + 1] - drive.times[step]) for step, _, share in as_simulated.shares)
        assert abs(on - before) == pytest.approx(0.5 * (end - last))


def test_with_a_status_all_the_time_nothing_is_held(problem, centre):
    window = sampled_windows(problem)[1]
    assert held_by(window, problem.at(window, centre[None])[0]) is None


# --- the problem with heat ----------------------------------------------------------------------------------------


def test_its_theta_has_the_scales_of_heat_beside_one_size_of_the_noise(both):
    problem, heated = both
    model = heated.heat
    assert [name for name in heated.names if name.startswith("heat.")] == list(model.names)
    assert [name for name in heated.names if name.startswith("noise.")] == ["noise.body_temp"]
    assert set(problem.names) - set(heated.names) == set()
    for entry in heated.entries:
        if entry.kind == "heat":
            assert entry.prior == model.priors[entry.name]
            assert entry.unit == ("" if entry.name == "heat.gains" else "W")


def test_at_known_sizes_its_theta_is_what_simulations_depend_on(heated, known):
    assert not [name for name in known.names if name.startswith(("heat.", "noise."))]
    assert list(known.names) == [heated.names[k] for k in heated.simulated]


def parts_of(heated):
    """Windows and channels, in order."""
    return [(w, k) for w in range(len(heated.windows)) for k in range(2)]


def stacked(heated, arrays):
    return np.concatenate([arrays[w][heated.windows[w].valid[:, k], k] for w, k in parts_of(heated)])


def dense_noise(heated, deviations):
    """Of all valid samples; deviations: of each channel."""
    found = []
    for w, k in parts_of(heated):
        terms = heated.windows[w].residuals.terms
        seconds = terms.seconds[terms.valid[k]]
        shape, apart = SHAPES[k], np.abs(seconds[:, None] - seconds)
        memory = np.exp(-apart / shape.time) if shape.time else 0.0
        found.append(deviations[k] ** 2 * (memory + shape.white_share**2 * np.eye(len(seconds))))
    return block_diag(*found)


def dense_covariance(heated, theta):
    """Of all residuals, at theta [d] of a problem with heat whose sizes are inferred."""
    value = dict(zip(heated.names, theta, strict=True))
    scales = np.array([value.get(name, 1.0) for name in heated.heat.scales])
    response = stacked(heated, [w.heat.response for w in heated.windows]) * scales[heated.heat.group]
    return dense_noise(heated, [value["noise.body_temp"], 0.1]) + response @ response.T


def dense(heated, theta, simulate):
    """Log likelihood, with temperatures that `simulate` gives for each window [T, N]."""
    model = heated.heat
    left = []
    for window in heated.windows:
        left.append(window.observed - simulate(window) + window.heat.response @ model.centre)
    factor = cho_factor(dense_covariance(heated, theta), lower=True)
    left = stacked(heated, left)
    determinant = 2.0 * np.log(np.diag(factor[0])).sum()
    return -0.5 * (left @ cho_solve(factor, left) + determinant + len(left) * np.log(2.0 * np.pi))


def points(heated, at_centre, count=3):
    return at_centre + 0.2 * np.random.default_rng(5).standard_normal((count, len(at_centre)))


def test_its_windows_are_simulated_with_the_heat_at_the_centre(both):
    problem, heated = both
    model = heated.heat
    for window, bare in zip(heated.windows, sampled_windows(problem), strict=True):
        bare = next((hold(bare, own) for own in model.held if own.window == bare.name), bare)
        heat = heat_of_weights(model, unit_heats(model, bare), split(model, model.centre))
        theta = heated.at(window, heated.priors.median()[None])[0]
        expected = bare.network.with_heat(heat).simulate(theta[window.simulated])
        np.testing.assert_allclose(window.simulate(theta).temperatures, expected.temperatures, rtol=0.0, atol=1e-9)


def test_the_log_density_is_the_priors_and_the_dense_normal_of_all_windows(heated, at_centre):
    for z in points(heated, at_centre):
        theta = heated.to_theta(z)
        likelihood = dense(heated, theta, lambda w, t=theta: w.simulate(heated.at(w, t[None])[0]).temperatures)
        expected = float(heated.priors.at(z).log_density) + likelihood
        assert heated.log_density(z) == pytest.approx(expected, rel=1e-8)
        assert heated.log_density_and_gradient(z)[0] == pytest.approx(expected, rel=1e-8)


def test_at_known_sizes_the_log_density_is_the_same_but_for_the_sizes_priors(heated, at_centre, known, at_known):
    own = [heated.names.index(name) for name in known.names]
    for step in 0.1 * np.random.default_rng(0).standard_normal((3, len(own))):
        z = at_centre.copy()
        z[own] += step
        whole, some = heated.log_density(z), known.log_density(at_known + step)
        priors = float(heated.priors.at(z).log_density - known.priors.at(at_known + step).log_density)
        # Directions of which the telemetry tells next to nothing are left out.
        assert some + priors == pytest.approx(whole, abs=1e-3)
        gradient = heated.log_density_and_gradient(z)[1][own]
        found = known.log_density_and_gradient(at_known + step)[1]
        np.testing.assert_allclose(found, gradient, rtol=1e-5, atol=1e-5 * np.abs(gradient).max())


@pytest.mark.parametrize("which", ["heated", "known"])
def test_the_gradient_is_that_of_differences(request, which, heated, at_centre, known, at_known):
    chosen, start = (heated, at_centre) if which == "heated" else (known, at_known)
    for z in start + 0.1 * np.random.default_rng(1).standard_normal((2, len(start))):
        gradient = chosen.log_density_and_gradient(z)[1]
        twin = chosen._in_python(z)[1]
        np.testing.assert_allclose(twin, gradient, rtol=1e-8, atol=1e-8 * np.abs(gradient).max())
        for k, step in enumerate(1e-4 * np.eye(len(z))):
            expected = (chosen.log_density(z + step) - chosen.log_density(z - step)) / 2e-4
            assert gradient[k] == pytest.approx(expected, rel=1e-4, abs=1e-5 * np.abs(gradient).max()), chosen.names[k]


def test_the_information_is_that_of_the_dense_covariance(heated, at_centre, known, at_known):
    covariance = dense_covariance(heated, heated.to_theta(at_centre))
    for chosen, z in ((heated, at_centre), (known, at_known)):
        jacobian = stacked(chosen, chosen.jacobians(z))
        expected = jacobian.T @ np.linalg.solve(covariance, jacobian) + np.diag(chosen.priors.precision(z))
        found = chosen.gauss_newton_hessian(z)
        of_simulated = np.ix_(chosen.simulated, chosen.simulated)
        np.testing.assert_allclose(found, found.T, rtol=0.0, atol=1e-9 * np.abs(found).max())
        np.testing.assert_allclose(
            found[of_simulated], expected[of_simulated], rtol=1e-8, atol=1e-8 * np.abs(expected).max()
        )


def test_the_information_on_sizes_is_the_curvature_bent_to_be_positive(heated, at_centre):
    own = np.array([k for k, entry in enumerate(heated.entries) if entry.kind in ("noise", "heat")])
    covered = heated.gauss_newton_hessian(at_centre)[np.ix_(own, own)]
    covered = covered - np.diag(heated.priors.precision(at_centre)[own])
    runs = heated.simulate(heated.to_theta(at_centre))
    step = 1e-3 * np.eye(len(at_centre))[own]

    def at(z):
        theta = heated.to_theta(z)
        return dense(heated, theta, lambda w: runs[heated.windows.index(w)].temperatures)

    middle = at(at_centre)
    second = np.zeros((len(own), len(own)))
    for i in range(len(own)):
        for j in range(i + 1):
            if i == j:
                value = (at(at_centre + step[i]) + at(at_centre - step[i]) - 2.0 * middle) / 1e-6
            else:
                sides = [at(at_centre + a * step[i] + b * step[j]) * a * b for a in (1, -1) for b in (1, -1)]
                value = sum(sides) / 4e-6
            second[i, j] = second[j, i] = -value
    eigenvalues, directions = np.linalg.eigh(second)
    expected = (directions * np.abs(eigenvalues)) @ directions.T
    np.testing.assert_allclose(covered, expected, rtol=0.0, atol=1e-3 * np.abs(expected).max())


# --- a response that follows the parameters -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def following(both, at_centre):
    """Around the same point, with a response that follows the parameters."""
    problem, heated = both
    found = followed(heated, heated.to_theta(at_centre))
    return with_heat(problem, replace(heated.heat, followed=found), middle(problem))


def test_a_response_that_follows_is_nearer_to_what_is_looked_at_anew(following, at_centre):
    model, same, with_growth = following.heat, 0.0, 0.0
    places = [k for k in following.simulated if following.entries[k].kind == "parameter"]
    for k, sign in product(places, (-1.0, 1.0)):
        z = at_centre.copy()
        z[k] += 0.5 * sign
        theta = following.to_theta(z)
        growth = following.heat_growth(theta[None])[0]
        for window, whitens in zip(following.windows, following.weighed.filters, strict=True):
            inside = following.at(window, theta[None])[0]
            anew = kept_responses(model.kept, responses(window, inside, model, unit_heats(model, window)))
            for response, grown in ((window.heat.response, False), (window.heat.response * growth, True)):
                off = whitens.whiten(np.moveaxis(response - anew, 1, 0), window.terms.valid)
                same, with_growth = same + (not grown) * (off**2).sum(), with_growth + grown * (off**2).sum()
    assert with_growth < 0.5 * same


def test_the_gradient_of_a_density_whose_response_follows_is_that_of_differences(following, at_centre):
    for z in at_centre + 0.1 * np.random.default_rng(1).standard_normal((2, len(at_centre))):
        gradient = following.log_density_and_gradient(z)[1]
        np.testing.assert_allclose(following._in_python(z)[1], gradient, rtol=1e-8, atol=1e-8 * np.abs(gradient).max())
        for k, step in enumerate(1e-4 * np.eye(len(z))):
            expected = (following.log_density(z + step) - following.log_density(z - step)) / 2e-4
            assert gradient[k] == pytest.approx(expected, rel=1e-4, abs=1e-5 * np.abs(gradient).max())


def test_where_it_was_looked_at_a_response_that_follows_is_the_same(heated, following, at_centre):
    assert following.log_density(at_centre) == pytest.approx(heated.log_density(at_centre), rel=1e-9)
    np.testing.assert_allclose(following.heat_growth(following.to_theta(at_centre)[None]), 1.0, rtol=1e-9)


# --- heat that does what the linear response says -----------------------------------------------------------------


def test_exact_heat_has_simulations_do_what_the_linear_response_says(heated, at_centre):
    rng = np.random.default_rng(2)
    z = np.tile(at_centre, (6, 1))
    moved = [k for k in heated.simulated if heated.entries[k].kind == "parameter"]
    z[:, moved] += 0.15 * rng.standard_normal((6, len(moved)))
    thetas = heated.to_theta(z)
    runs = heated.simulate_many(thetas)

    found = exact_heat(heated, runs, thetas, np.random.default_rng(0))

    gains = Gains([window.terms for window in heated.windows], heated.weighed, *heated.heat_sizes(thetas))
    weights = gains.draw(heated.heat_left(runs, thetas), np.random.default_rng(0))
    model, missed, before = heated.heat, [], []
    uncorrected = [own.copy() for own in found.linear]
    for place, (window, simulated, linear) in enumerate(
        zip(heated.windows, found.temperatures, found.linear, strict=True)
    ):
        units = unit_heats(model, window)
        for s, own in enumerate(found.weights):
            base = runs[s][place].temperatures
            expected = base + window.heat.response @ (weights[s] - model.centre)
            np.testing.assert_allclose(linear[s], expected, rtol=0.0, atol=1e-9)
            functions = split(model, own - model.centre)
            heat, error = heat_of_weights(model, units, functions), errors_of_weights(units, functions)
            run = window.network.with_heat(heat).simulate(heated.at(window, thetas[s : s + 1])[0][window.simulated])
            np.testing.assert_allclose(simulated[s], run.temperatures + error, rtol=0.0, atol=1e-8)
            missed.append(np.abs(simulated[s] - linear[s]).max())
            functions = split(model, weights[s] - model.centre)
            heat, error = heat_of_weights(model, units, functions), errors_of_weights(units, functions)
            run = window.network.with_heat(heat).simulate(heated.at(window, thetas[s : s + 1])[0][window.simulated])
            before.append(np.abs(run.temperatures + error - linear[s]).max())
            uncorrected[place][s] = run.temperatures
    # A tenth of the noise.
    assert max(missed) < 0.01
    assert max(missed) < 0.2 * max(before)
    # What is left is nearly all of a shape that no weights mend.
    steps, first = (
        gains([linear - own for linear, own in zip(found.linear, simulated, strict=True)])
        for simulated in (found.temperatures, uncorrected)
    )
    assert np.abs(steps).max() < 0.05 * np.abs(first).max()


def test_several_windows_in_open_loop_can_have_heat(problem):
    _, heated = with_some_heat(problem)
    assert [len(window.heat.response) for window in heated.windows] == [90, 70]
