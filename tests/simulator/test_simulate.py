"""Scenario in, telemetry out: the simulator of a whole scenario against an integration that shares nothing with it."""

import gc
import threading
import time
import weakref

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from flightcal.environment import face_fluxes
from flightcal.problem import build_window
from flightcal.scenario.network import DEEP_SPACE
from flightcal.simulator import SimulationFailure, open_loop
from flightcal.simulator.assembly import assemble
from flightcal.simulator.network import STEFAN_BOLTZMANN
from flightcal.simulator.simulate import _CHUNK
from flightcal.simulator.system import System, packed_bounds

from .. import oracle, small
from ..oracle import QUICKLY_COMPILED, jax, jnp
from .systems import pull_back_assembly
from .test_network import rich


def without_heater(written):
    written["simulator"].pop("heaters")
    written["observations"].pop("heater_status")
    written["parameters"].pop("power")
    return written


def test_every_kind_of_node_link_and_load_agrees_with_an_independent_integration(tmp_path):
    """Massless, measured boundary and fixed boundary; both laws; face in eclipse; modes with jumps; measured load."""
    scenario, data = small.load(tmp_path, without_heater(rich()))
    data["body_temp"].values[:] = 285.0 + 4.0 * np.sin(np.arange(data.sizes["time"]) / 20.0)
    simulator = small.simulator_of(scenario, data, hours=1.5)
    got = simulator.simulate(small.theta_of(simulator, initial_panel=262.0)).temperatures[:, 0]

    s, minutes = STEFAN_BOLTZMANN, np.arange(data.sizes["time"])
    fine = np.arange(0, 5401.0)
    normal = {"top": scenario.simulator.faces["top"].normal}
    flux = face_fluxes(scenario.environment, normal, small.START + (fine * 1e9).astype("timedelta64[ns]"))

    def shell_of(body, bus, heat):
        def balance(shell):
            return 0.2 * (body - shell) - s * 0.01 * (shell**4 - 4.0**4) + s * 0.02 * (bus**4 - shell**4) + heat

        return brentq(balance, 150.0, 350.0, xtol=1e-10)

    def rate(t, y, busy):
        body, panel = y
        bus = np.interp(t / 60, minutes, data["body_temp"].values)
        sun = np.interp(t / 60, minutes, data["sun"].values)
        solar, albedo, infrared = (np.interp(t, fine, getattr(flux, k)[:, 0]) for k in ("solar", "albedo", "infrared"))
        shell = shell_of(body, bus, 0.0 if busy else 1.0)
        link = 0.6 * (body - panel)
        face = 0.2 * (solar + 0.35 * albedo) + 0.8 * (240.0 * infrared - s * (panel**4 - DEEP_SPACE**4))
        into_body = -link - 0.2 * (body - shell) + (11.0 if busy else 3.0)
        into_panel = link - s * 0.05 * (panel**4 - 4.0**4) + 0.15 * (bus - panel) + 12.0 * sun + 0.03 * face
        return [into_body / 3000.0, into_panel / 800.0]

    expected, y = np.full(91, np.nan), [285.0, 262.0]
    for begin, end, busy in ((0, 1230, False), (1230, 3000, True), (3000, 5400, False)):
        inside = np.arange(-(-begin // 60), end // 60 + 1)
        piece = solve_ivp(rate, (begin, end), y, args=(busy,), rtol=1e-7, atol=1e-6, max_step=60.0, dense_output=True)
        expected[inside], y = piece.sol(60.0 * inside)[1], piece.y[:, -1]
    assert np.abs(got - 0.3 - expected).max() < 0.01
    assert np.ptp(expected) > 5.0


def test_a_node_at_a_fixed_boundary_decays_to_it_exponentially(tmp_path):
    written = without_heater(small.content())
    written["simulator"]["nodes"] = {"body": {"capacity": "3000 J/K"}, "wall": {"boundary": "300 K"}}
    written["simulator"]["conductors"] = [{"between": ["body", "wall"], "conductance": "1.5 W/K"}]
    written["simulator"].pop("loads")
    written["observations"] = {"body_temp": {"node": "body", "bias": "-0.5 K"}}
    written["parameters"] = {"wall": {"sets": "nodes.wall.boundary", "prior": {"uniform": ["290 K", "310 K"]}}}
    scenario, data = small.load(tmp_path, written)
    simulator = small.simulator_of(scenario, data)
    got = simulator.simulate(small.theta_of(simulator, wall=305.0, initial_body=280.0)).temperatures[:, 0]
    t = 60.0 * np.arange(len(got))
    np.testing.assert_allclose(got, 305.0 - 25.0 * np.exp(-1.5 / 3000.0 * t) - 0.5, atol=1e-4)


def test_a_massless_node_that_only_radiates_is_in_balance_as_soon_as_a_mode_has_changed(tmp_path):
    written = without_heater(small.content())
    model = written["simulator"]
    model.pop("loads")
    model["nodes"] = {"body": {"capacity": "3000 J/K"}, "panel": {"arithmetic": True}, "space": {"boundary": "4 K"}}
    model["conductors"] = [
        {"between": ["body", "panel"], "radiative": "0.03 m^2"},
        {"between": ["panel", "space"], "radiative": "0.2 m^2"},
    ]
    model["modes"] = {"off": {"panel": "0 W"}, "on": {"panel": "50 W"}}
    model["timeline"] = [{"at": f"2024-03-01T0{hour}:00:00", "mode": "on" if hour % 2 else "off"} for hour in range(4)]
    written["parameters"] = {
        "area": {"sets": "conductors.panel-space.radiative", "prior": {"uniform": ["0.1 m^2", "0.3 m^2"]}}
    }
    scenario, data = small.load(tmp_path, written, hours=4.0)
    simulator = small.simulator_of(scenario, data)
    body, panel = simulator.simulate(small.theta_of(simulator, area=0.2, initial_body=285.0)).temperatures.T
    power = np.where(np.arange(len(panel)) // 60 % 2, 50.0, 0.0)
    balance = ((power / STEFAN_BOLTZMANN + 0.03 * body**4 + 0.2 * 4.0**4) / 0.23) ** 0.25
    between = np.arange(len(panel)) % 60 != 0
    np.testing.assert_allclose(panel[between], balance[between], atol=1e-4)
    assert np.ptp(panel) > 80.0


def test_stored_heat_is_what_heaters_and_loads_gave_less_what_was_radiated(tmp_path):
    scenario, data = small.closed_loop(tmp_path)
    simulator = small.simulator_of(scenario, data)
    theta = small.theta_of(simulator, **small.TRUTH)
    run = simulator.simulate(theta)
    at = simulator.drive.times
    system = simulator.system(theta)
    from flightcal.simulator import integrate

    states = integrate(simulator.network.structure, system, simulator.drive).states
    body, panel = (states[:, simulator.network.nodes.index(name)] for name in ("body", "panel"))
    np.testing.assert_array_equal(run.temperatures[0], [body[0], panel[0]])
    stored = 3000.0 * (body[-1] - body[0]) + 800.0 * (panel[-1] - panel[0])
    heated = run.duty_cycle[0] * at[-1] * 28.0
    loaded = 1.1 * 12.0 * np.trapezoid(np.interp(at, 60.0 * np.arange(data.sizes["time"]), data["sun"].values), at)
    radiated = 1.1 * 0.05 * STEFAN_BOLTZMANN * np.trapezoid(panel**4 - 4.0**4, at)
    assert stored == pytest.approx(heated + loaded - radiated, abs=1e-4 * radiated)
    assert heated > 0.2 * radiated


def test_the_thermostat_keeps_its_node_between_the_thresholds(tmp_path):
    scenario, data = small.load(tmp_path)
    simulator = small.simulator_of(scenario, data)
    run = simulator.simulate(small.theta_of(simulator, initial_panel=262.0))
    body = run.temperatures[:, 0]
    assert 283.15 - 1e-6 <= body.min() < 283.5
    assert 286.0 < body.max() < 286.15 + 0.1  # heat still flows in from nowhere else
    assert len(run.switches.time) >= 20
    np.testing.assert_array_equal(run.switches.on[:4], 1.0 - run.switches.on[1:5])


def test_status_at_a_sample_is_that_of_the_last_switch_before_it(tmp_path):
    scenario, data = small.load(tmp_path)
    simulator = small.simulator_of(scenario, data)
    run = simulator.simulate(small.theta_of(simulator, initial_panel=262.0))
    at = 60.0 * np.arange(len(run.status))
    before = np.searchsorted(run.switches.time, at, side="right") - 1
    expected = np.where(before < 0, 0.0, run.switches.on[np.maximum(before, 0)])
    np.testing.assert_array_equal(run.status[:, 0], expected)
    on = np.diff(np.append(run.switches.time, at[-1]))[run.switches.on == 1.0].sum()
    assert run.duty_cycle[0] == pytest.approx(on / at[-1])


def test_open_loop_with_the_simulated_status_follows_the_closed_loop(tmp_path):
    """Sampled once a minute, so the heater's on-time is off by a share of a minute at each switch."""
    scenario, data = small.closed_loop(tmp_path, noise=0.0)
    closed, opened = small.simulator_of(scenario, data), small.simulator_of(open_loop(scenario), data)
    theta = small.theta_of(closed, **small.TRUTH)
    first, second = closed.simulate(theta), opened.simulate(theta)
    assert second.duty_cycle == pytest.approx(first.duty_cycle, abs=0.01)
    assert np.sqrt(np.mean((first.temperatures - second.temperatures) ** 2)) < 0.6
    # The thresholds act in closed loop only.
    warmer = {"on_below": 281.15, "off_above": 284.15}
    heater = scenario.simulator.heaters["heater"].model_copy(update=warmer)
    shifted = scenario.model_copy(
        update={"simulator": scenario.simulator.model_copy(update={"heaters": {"heater": heater}})}
    )
    np.testing.assert_array_equal(
        small.simulator_of(open_loop(shifted), data).simulate(theta).temperatures, second.temperatures
    )
    moved = small.simulator_of(shifted, data).simulate(theta).temperatures
    assert (first.temperatures - moved)[60:, 0].mean() == pytest.approx(2.0, abs=0.3)


def values_at(folder, parameters, **values):
    written = small.content()
    written["parameters"] = parameters
    scenario, data = small.load(folder, written)
    simulator = small.simulator_of(scenario, data)
    network = simulator.network
    numbers, _ = assemble(simulator.mapping, network.terms, small.theta_of(simulator, **values))
    return lambda path: numbers[network.position(path)]


def test_a_parameter_sets_or_scales_several_places(tmp_path):
    value = values_at(
        tmp_path,
        {
            "size": {
                "scales": ["nodes.body.capacity", "nodes.panel.capacity"],
                "prior": {"uniform": [0.5, 2]},
            },
            "level": {
                "sets": ["nodes.space.boundary", "heaters.heater.on_below"],
                "prior": {"uniform": ["3 K", "283 K"]},
            },
        },
        size=1.5,
        level=100.0,
    )
    assert value("nodes.body.capacity") == pytest.approx(4500.0)
    assert value("nodes.panel.capacity") == pytest.approx(1200.0)
    assert value("nodes.space.boundary") == value("heaters.heater.on_below") == 100.0
    assert value("heaters.heater.power") == 30.0


def test_two_parameters_that_scale_the_same_number_both_do(tmp_path):
    value = values_at(
        tmp_path,
        {
            "all": {"scales": ["nodes.body.capacity", "nodes.panel.capacity"], "prior": {"uniform": [0.5, 2]}},
            "one": {"scales": "nodes.body.capacity", "prior": {"uniform": [0.5, 2]}},
        },
        all=1.5,
        one=1.2,
    )
    assert value("nodes.body.capacity") == pytest.approx(3000.0 * 1.5 * 1.2)
    assert value("nodes.panel.capacity") == pytest.approx(800.0 * 1.5)


def test_a_bias_is_added_to_what_the_sensor_reports_and_to_nothing_else(tmp_path):
    written = small.content()
    prior = {"normal": {"mean": "0 K", "standard_deviation": "1 K"}}
    written["parameters"]["bias"] = {"sets": "observations.body_temp.bias", "prior": prior}
    scenario, data = small.load(tmp_path, written)
    simulator = small.simulator_of(scenario, data)
    none, some = (simulator.simulate(small.theta_of(simulator, bias=bias)) for bias in (0.0, 1.25))
    np.testing.assert_allclose(some.temperatures[:, 0] - none.temperatures[:, 0], 1.25)
    np.testing.assert_array_equal(some.temperatures[:, 1], none.temperatures[:, 1])
    np.testing.assert_array_equal(some.status, none.status)


def observed(folder, **sensor):
    """The small satellite with a sensor of the panel that has errors, and one without beside it in the telemetry."""
    written = without_heater(small.content())
    written["observations"] = {"body_temp": {"node": "panel"}, "panel_temp": {"node": "panel", **sensor}}
    scenario, data = small.load(folder, written)
    return small.simulator_of(scenario, data, hours=1.5)


def test_gain_and_bias_are_those_of_the_reading_in_celsius(tmp_path):
    simulator = observed(tmp_path, gain=1.05, bias="-0.5 K")
    exact, seen = simulator.simulate(small.theta_of(simulator, initial_panel=262.0)).temperatures.T - 273.15
    np.testing.assert_allclose(seen, 1.05 * exact - 0.5, atol=1e-9)


def test_a_time_offset_shows_what_the_node_does_later_or_earlier(tmp_path):
    simulator = observed(tmp_path, time_offset="-90 s")
    exact, seen = simulator.simulate(small.theta_of(simulator, initial_panel=262.0)).temperatures.T
    # A minute and a half: halfway between the samples before, whose grid points are 30 s apart.
    np.testing.assert_allclose(
        seen[2:], np.interp(60.0 * np.arange(2, len(exact)) - 90.0, 60.0 * np.arange(len(exact)), exact), atol=0.02
    )
    assert np.abs(seen - exact).max() > 0.5
    # Before the window it goes on in a straight line for a minute.
    rate = (exact[1] - exact[0]) / 60.0
    np.testing.assert_allclose(seen[:2], exact[0] - rate * np.array([60.0, 30.0]), atol=0.03)
    assert exact[0] - seen[0] == pytest.approx(2.0 * (exact[0] - seen[1]))


def test_a_sensor_that_lags_answers_a_ramp_as_a_first_order_filter_does(tmp_path):
    written = without_heater(small.content())
    written["simulator"]["nodes"] = {"body": {"capacity": "3000 J/K"}}
    written["simulator"]["conductors"] = []
    written["simulator"]["loads"]["sun"] = {"node": "body", "driver": "sun", "coefficient": "12 W/A"}
    written["observations"] = {
        "panel_temp": {"node": "body"},
        "body_temp": {"node": "body", "lag": "200 s", "bias": "1 K"},
    }
    written["parameters"] = {"lag": {"sets": "observations.body_temp.lag", "prior": {"uniform": ["10 s", "900 s"]}}}
    scenario, data = small.load(tmp_path, written)
    data["sun"].values[:] = 2.5
    simulator = small.simulator_of(scenario, data, hours=1.0)
    assert simulator.parameters == ("lag", "initial.body")
    for lag in (20.0, 200.0, 700.0):
        exact, seen = simulator.simulate(small.theta_of(simulator, lag=lag, initial_body=280.0)).temperatures.T
        rate, t = 12.0 * 2.5 / 3000.0, 60.0 * np.arange(61)
        np.testing.assert_allclose(exact, 280.0 + rate * t, atol=1e-9)
        expected = 280.0 + rate * (t - lag * (1.0 - np.exp(-t / lag))) + 1.0
        np.testing.assert_allclose(seen, expected, atol=0.02 if lag < 30.0 else 2e-4)


@pytest.mark.parametrize("look", [lambda way: way, lambda axis: {"tracks_sun_about": axis}], ids=["fixed", "driven"])
def test_a_small_offset_of_the_attitude_does_what_turned_normals_do(tmp_path, look):
    """A rotation of 1.5 deg about the body's y axis, to first order."""
    written, theta = without_heater(rich()), {}
    found = {}
    for name, angle, offset in (("straight", 0.0, 0.0), ("turned", 1.5, 0.0), ("offset", 0.0, 1.5)):
        cosine, sine = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
        normal = np.array([1.0, 0.2, -1.0])
        turned = [cosine * normal[0] + sine * normal[2], normal[1], cosine * normal[2] - sine * normal[0]]
        looks = look([float(part) for part in turned])
        written["simulator"]["faces"]["top"] |= {"normal": looks, "area": "0.3 m^2"}
        written["environment"]["attitude_offset"] = {"y": f"{offset} deg"}
        (tmp_path / name).mkdir()
        simulator = small.simulator_of(*small.load(tmp_path / name, written), hours=1.5)
        theta = small.theta_of(simulator, initial_panel=262.0)
        found[name] = simulator.simulate(theta).temperatures[:, 0]
    effect = found["turned"] - found["straight"]
    assert np.abs(effect).max() > 0.3
    np.testing.assert_allclose(found["offset"] - found["straight"], effect, atol=0.06 * np.abs(effect).max())


def test_a_sensor_that_lags_takes_no_heat_from_its_node(tmp_path):
    (tmp_path / "with").mkdir(), (tmp_path / "without").mkdir()
    with_lag = observed(tmp_path / "with", lag="300 s")
    without = observed(tmp_path / "without")
    theta = small.theta_of(without, initial_panel=262.0)
    seen = with_lag.simulate(theta).temperatures
    np.testing.assert_allclose(seen[:, 0], without.simulate(theta).temperatures[:, 0], atol=1e-9)
    assert np.abs(seen[:, 1] - seen[:, 0]).max() > 0.5


def test_a_simulation_with_errors_of_all_kinds_and_its_gradient_are_the_oracles(tmp_path):
    written = small.content()
    written["observations"]["body_temp"] |= {"gain": 1.03, "bias": "0.4 K", "lag": "150 s"}
    written["observations"]["panel_temp"] |= {"lag": "40 s", "time_offset": "-23 s"}
    for name in ("body_temp.lag", "body_temp.gain", "panel_temp.lag", "panel_temp.time_offset"):
        written["parameters"][name.replace(".", "_")] = {
            "sets": f"observations.{name}",
            "prior": {"uniform": [0.9, 1.1] if "gain" in name else ["-100 s" if "offset" in name else "5 s", "900 s"]},
        }
    scenario, data = small.load(tmp_path, written)
    simulator = small.simulator_of(scenario, data, hours=1.0)
    network, drive, observation = simulator.network, simulator.drive, simulator.observation
    theta = small.theta_of(simulator, initial_body=284.0, initial_panel=262.0)
    trajectory, pull_back = simulator.linearise(theta)
    assert len(trajectory.switches.time) >= 3
    weights = np.random.default_rng(0).normal(size=trajectory.temperatures.shape)
    numbers, packed = assemble(simulator.mapping, network.terms, theta)

    def seen(packed, errors):
        system = System(*jnp.split(packed, packed_bounds(network.structure)))
        temperatures = oracle.simulate(
            network.structure,
            system,
            drive,
            60.0 * np.arange(len(weights)),
            np.array(observation.sensors.state),
            errors,
        )
        return (temperatures * weights).sum(), temperatures

    errors = numbers[simulator.channel_errors]
    value_and_gradient = jax.value_and_grad(seen, argnums=(0, 1), has_aux=True)
    value_and_gradient = jax.jit(value_and_gradient, compiler_options=QUICKLY_COMPILED)
    (_, expected), (packed_bar, errors_bar) = value_and_gradient(packed, errors)
    np.testing.assert_allclose(trajectory.temperatures, expected, atol=1e-8)
    gradient = pull_back_assembly(
        simulator.mapping, network.terms, theta, numbers, np.array(packed_bar),
        simulator.channel_errors, np.array(errors_bar),
    )  # fmt: skip
    np.testing.assert_allclose(pull_back(weights), gradient, rtol=1e-6, atol=1e-7 * np.abs(gradient).max())
    assert (np.abs(gradient) > 0.0).all()


def test_many_simulations_with_errors_of_sensors_are_those_of_each(tmp_path):
    simulator = observed(tmp_path, gain=0.95, lag="100 s", time_offset="13 s")
    thetas = small.theta_of(simulator, initial_panel=262.0) + np.linspace(0.0, 0.05, 11)[:, None]
    for theta, run in zip(thetas, simulator.simulate_many(thetas), strict=True):
        np.testing.assert_allclose(run.temperatures, simulator.simulate(theta).temperatures, rtol=0, atol=1e-9)


EVERYTHING = {
    "capacity": ("nodes.body.capacity", 3000.0),
    "space": ("nodes.space.boundary", 60.0),
    "link": ("conductors.body-panel.conductance", 0.6),
    "gap": ("conductors.panel-space.radiative", 0.05),
    "area": ("faces.top.area", 0.03),
    "absorptivity": ("faces.top.absorptivity", 0.2),
    "emissivity": ("faces.top.emissivity", 0.8),
    "power": ("heaters.heater.power", 30.0),
    "on_below": ("heaters.heater.on_below", 283.15),
    "off_above": ("heaters.heater.off_above", 286.15),
    "dissipation": ("modes.busy.body", 11.0),
    "coefficient": ("loads.sun.coefficient", 12.0),
    "albedo": ("environment.albedo", 0.35),
    "infrared": ("environment.earth_infrared", 240.0),
    "solar_constant": ("environment.solar_constant", 1361.0),
    "turn": ("environment.attitude_offset.y", 0.02),
    "bias": ("observations.panel_temp.bias", 0.3),
    "gain": ("observations.panel_temp.gain", 1.02),
    "time_offset": ("observations.body_temp.time_offset", -17.0),
    "lag": ("observations.body_temp.lag", 90.0),
    "skin": ("conductors.body-shell.conductance", 0.2),
}
SCALED = ("conductors.shell-space.radiative", "modes.quiet.shell", "modes.quiet.body")


def test_open_loop_status_is_the_measured_one_on_both_sides_of_a_gap(tmp_path):
    scenario, data = small.closed_loop(tmp_path)
    measured = data["heater_status"].values.copy()
    gap = np.zeros(len(measured), bool)
    gap[100:160] = True
    assert np.abs(np.diff(measured[gap])).sum() >= 2, "the thermostat has something to do in the gap"
    data["heater_status"].values[gap] = np.nan
    opened = small.simulator_of(open_loop(scenario), data)
    status = opened.simulate(small.theta_of(opened, **small.TRUTH)).status[:, 0]
    # A status changes halfway between two samples, so a sample next to a change has a share.
    steady = np.flatnonzero(
        (np.diff(measured, prepend=measured[0]) == 0) & (np.diff(measured, append=measured[-1]) == 0)
    )
    known = steady[(steady < 99) | (steady > 160)]
    np.testing.assert_array_equal(status[known], measured[known])


@pytest.fixture(scope="module", params=["thermostat", "measured"])
def differentiated(request, tmp_path_factory):
    """Every kind of number as a parameter, at theta; in closed and in open loop."""
    written = rich()
    units = {"capacity": "J/K", "power": "W", "dissipation": "W", "area": "m^2", "gap": "m^2", "link": "W/K"}
    units |= {"skin": "W/K", "infrared": "W/m^2", "coefficient": "W/A"}
    units |= dict.fromkeys(("space", "on_below", "off_above", "bias"), "K") | dict.fromkeys(("time_offset", "lag"), "s")
    units |= {"solar_constant": "W/m^2", "turn": "rad"}
    written["observations"]["body_temp"] = {"node": "body", "lag": "90 s"}
    written["environment"]["attitude_offset"] = {"x": "0.5 deg"}
    written["parameters"] = {}
    for name, (path, value) in EVERYTHING.items():
        spread = 1e-3 * abs(value)
        bounds = [f"{bound:.9g} {units.get(name, '')}".strip() for bound in (value - spread, value + spread)]
        bounds = bounds if name in units else [float(bound) for bound in bounds]
        written["parameters"][name] = {"sets": path, "prior": {"uniform": bounds}}
    for name, paths in {"scale": list(SCALED), "again": [SCALED[0]]}.items():
        written["parameters"][name] = {"scales": paths, "prior": {"uniform": [0.5, 1.5]}}
    scenario, data = small.load(tmp_path_factory.mktemp("everything"), written)
    if request.param == "measured":
        data["heater_status"].values[20:35] = 1.0
        scenario = open_loop(scenario)
    simulator = small.simulator_of(scenario, data, hours=1.5)
    theta = small.theta_of(
        simulator, **{name: value for name, (_, value) in EVERYTHING.items()}, scale=1.1, again=0.9, initial_panel=262.0
    )
    trajectory, pull_back = simulator.linearise(theta)
    weights = np.random.default_rng(0).normal(size=trajectory.temperatures.shape) / 10.0
    return request.param, simulator, theta, trajectory, weights, pull_back(weights)


@pytest.mark.parametrize("name", [*EVERYTHING, "scale", "again", "initial.body", "initial.panel"])
def test_the_derivative_by_every_kind_of_number_agrees_with_differences(differentiated, name):
    loop, simulator, theta, trajectory, weights, gradient = differentiated
    if loop == "thermostat":
        assert len(trajectory.switches.time) >= 3, "the case must switch to test anything"
    k = simulator.parameters.index(name)
    step = np.zeros_like(theta)
    step[k] = 1e-5 * max(abs(theta[k]), 0.1) if theta[k] < 200 or theta[k] > 300 else 1e-4

    def objective(sign):
        return float((simulator.simulate(theta + sign * step).temperatures * weights).sum())

    expected = (objective(1) - objective(-1)) / (2 * step[k])
    thresholds_act = loop == "thermostat" or name not in ("on_below", "off_above")
    assert (gradient[k] != 0.0) == thresholds_act
    assert gradient[k] == pytest.approx(expected, rel=2e-4, abs=1e-6 / max(abs(theta[k]), 0.1))


def test_many_simulations_are_those_of_each_and_a_failed_one_is_none(tmp_path):
    scenario, data = small.load(tmp_path)
    simulator = small.simulator_of(scenario, data, hours=1.0)
    good = small.theta_of(simulator)
    bad = small.theta_of(simulator, initial_panel=np.nan)
    first, second, third = simulator.simulate_many(np.stack([good, bad, good + 0.01]))
    np.testing.assert_array_equal(first.temperatures, simulator.simulate(good).temperatures)
    np.testing.assert_array_equal(third.temperatures, simulator.simulate(good + 0.01).temperatures)
    assert second is None
    with pytest.raises(SimulationFailure):
        simulator.simulate(bad)


def test_scores_of_many_simulations_are_those_of_each_and_that_of_a_failed_one_is_nan(tmp_path):
    scenario, data = small.load(tmp_path)
    simulator = small.simulator_of(scenario, data, hours=1.0)
    # More than one call of the compiled code has room for.
    thetas = small.theta_of(simulator) + np.linspace(0.0, 0.05, 2 * _CHUNK + 3)[:, None]
    thetas[[1, 200]] = small.theta_of(simulator, initial_panel=np.nan)

    def score(temperatures, status):
        assert len(temperatures) <= _CHUNK
        return temperatures.mean(axis=(1, 2)) + 100.0 * status.mean(axis=(1, 2))

    found = simulator.score_many(thetas, score)
    for k, run in enumerate(simulator.simulate_many(thetas)):
        expected = np.nan if run is None else score(run.temperatures[None], run.status[None])[0]
        np.testing.assert_array_equal(found[k], expected)
    assert np.flatnonzero(np.isnan(found)).tolist() == [1, 200]


def test_heater_power_follows_the_parameter_that_sets_it(tmp_path):
    scenario, data = small.load(tmp_path)
    simulator = small.simulator_of(scenario, data, hours=1.0)
    assert simulator.heater_power(small.theta_of(simulator, power=26.0)) == [26.0]


def test_a_simulation_that_diverges_ends_and_the_others_choose_the_steps(tmp_path):
    """A load of 5,000 W/A: the sensor's end is past its threshold, and no trial of the step meets it."""
    written = small.content()
    del written["simulator"]["step"]
    written["parameters"]["sun"] = {
        "sets": "loads.sun.coefficient",
        "prior": {"normal": {"mean": "12 W/A", "standard_deviation": "5000 W/A"}},
    }
    written["parameters"]["panel_size"]["scales"] = "conductors.panel-space.radiative"
    scenario, data = small.load(tmp_path, written)
    window = build_window(scenario, data, "train")
    assert window.network.accuracy is not None
    assert np.isfinite(window.network.accuracy.error)


def test_thermostats_of_one_sensor_do_not_give_way_to_each_other_for_ever(tmp_path):
    """Powers that no satellite has make the sensor jump over its threshold: both are past it in any step."""
    written = small.content()
    model = written["simulator"]
    model["heaters"]["heater"].pop("measured_by")
    model["heaters"]["second"] = dict(model["heaters"]["heater"])
    model["conductors"].append({"between": ["body", "space"], "radiative": "0.02 m^2"})
    model["modes"], model["timeline"] = {"on": {"panel": "2 W"}}, [{"at": "2024-03-01T00:00:00", "mode": "on"}]
    del model["step"], written["parameters"]["power"]
    written["parameters"]["more"] = {"sets": "modes.on.panel", "prior": {"half_normal": "10 W"}}
    scenario, data = small.load(tmp_path, written)
    simulator = small.simulator_of(scenario, data)
    powers = 10.0 ** np.linspace(14.0, 34.0, 40)
    thetas = np.stack([small.theta_of(simulator, more=power, initial_panel=262.0) for power in powers])
    simulating = threading.Thread(target=simulator.simulate_many, args=(thetas,), daemon=True)
    simulating.start()
    simulating.join(60.0)
    assert not simulating.is_alive()


def test_memory_that_is_given_back_changes_no_simulation(tmp_path):
    simulator = small.simulator_of(*small.load(tmp_path, small.content()))
    theta = small.theta_of(simulator)
    before = simulator.simulate(theta).temperatures
    assert "_memories" in vars(simulator)
    simulator.release()
    assert "_memories" not in vars(simulator)
    np.testing.assert_array_equal(simulator.simulate(theta).temperatures, before)


def test_a_simulator_that_is_let_go_gives_back_its_memory_at_once(tmp_path):
    """Without garbage collection, which arrays of gigabytes do not hasten."""
    scenario, data = small.load(tmp_path, small.content())
    simulator = small.simulator_of(scenario, data, hours=1.0)
    theta = small.theta_of(simulator)
    gc.collect()
    gc.disable()
    try:
        simulator.simulate_many(np.tile(theta, (9, 1)))
        simulator.linearise(theta)
        kept = weakref.ref(simulator)
        del simulator
        # A thread that has just done its part may hold it for a moment.
        assert any(kept() is None or time.sleep(0.01) for _ in range(200))
    finally:
        gc.enable()
