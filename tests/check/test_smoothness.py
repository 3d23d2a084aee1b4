"""Jumps at known places, a graze of a real thermostat, and wrong gradients."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import brentq

from flightcal.check.evaluate import THOROUGH, signature
from flightcal.check.smoothness import REACH, TOLERANCE, _candidates, check_gradient, scan_all, smoothness
from flightcal.problem import Problem, build_problem
from flightcal.scenario import Normal
from flightcal.simulator.system import Switch

from .. import small
from .problems import NOISE, centre_at, formula_problem, observing, samples, several

PRIORS = {"level": Normal(mean=1.0, standard_deviation=1.0), "slope": Normal(mean=0.0, standard_deviation=1.0)}
EDGE = 1.003
STEP = 0.01  # K


def problem_with_a_step(*, told: bool, edge: float = EDGE, step: float = STEP):
    """Level and slope of both channels; above the edge the level is a step higher and the heater switches twice more.

    told: whether it does switch.
    """
    time = np.linspace(-1.0, 1.0, samples())[:, None]

    def temperatures(theta):
        return 290.0 + np.ones((1, 2)) * (theta[0] + step * (theta[0] > edge) + theta[1] * time)

    def switches(theta):
        times = [600.0, 900.0, 4000.0, 4300.0] if theta[0] > edge and told else [600.0, 900.0]
        return Switch(np.array(times), np.zeros(len(times), np.int64), np.tile([1.0, 0.0], len(times) // 2))

    return formula_problem(PRIORS, temperatures, {"level": 1.0, "slope": 0.0}, switches=switches, heaters=("heater",))


@pytest.mark.parametrize("told", [True, False])
def test_a_jump_is_found_at_its_place_with_its_size_and_its_cause(told):
    problem = problem_with_a_step(told=told)
    centre = centre_at(problem, level=1.0, slope=0.0)
    scan = scan_all(problem, centre, THOROUGH)[0]
    (jump,) = scan.jumps
    assert jump.name == "level"
    assert jump.theta == pytest.approx(EDGE, abs=1e-7)
    sides = problem.to_z(np.array([[EDGE - 1e-9, 0.0], [EDGE + 1e-9, 0.0]]))
    along = centre.covariance[:, 0] / np.sqrt(centre.covariance[0, 0])
    ends = centre.z + np.array([[jump.place - 1e-6], [jump.place + 1e-6]]) * along
    expected = problem.log_density(ends[1]) - problem.log_density(ends[0])
    assert abs(problem.log_density(sides[1]) - problem.log_density(sides[0])) > 0.1
    assert jump.nats == pytest.approx(expected, rel=1e-3)
    assert len(set(scan.sequence)) == 1 + told
    if told:
        assert (jump.heater, jump.seconds, jump.switches) == ("heater", 4000.0, (2, 4))
    else:
        assert jump.heater == ""


def test_a_jump_of_one_of_two_windows_is_found_with_its_window():
    level = {"level": 1.0, "slope": 0.0}
    smooth = formula_problem(PRIORS, lambda t: 290.0 + t[0] * np.ones((samples(), 2)), level, heaters=("heater",))
    both = several(smooth=smooth, jumping=problem_with_a_step(told=True))
    (jump,) = scan_all(both, centre_at(both, **level), THOROUGH)[0].jumps
    assert jump.theta == pytest.approx(EDGE, abs=1e-7)
    assert (jump.window, jump.heater, jump.seconds, jump.switches) == ("jumping", "heater", 4000.0, (2, 4))


def test_a_jump_against_a_steep_slope_is_found():
    deviation = NOISE / np.sqrt(2 * samples())
    edge = 1.0 + 2.53 * deviation
    # Two and a half deviations off the log density falls by 0.25 nats from point to point; the jump lifts it by 0.2.
    problem = problem_with_a_step(told=False, edge=edge, step=-0.08 * deviation)
    observed = problem.windows[0].observed
    problem = observing(problem, observed - observed.mean() + 291.0)
    (jump,) = scan_all(problem, centre_at(problem, level=1.0, slope=0.0), THOROUGH)[0].jumps
    assert jump.theta == pytest.approx(edge, abs=1e-7)
    assert jump.nats == pytest.approx(0.2, abs=0.01)


def test_a_smooth_density_has_no_jumps_and_a_right_gradient():
    time = np.linspace(-1.0, 1.0, samples())[:, None]
    problem = formula_problem(
        PRIORS, lambda t: 290.0 + np.ones((1, 2)) * (np.exp(t[0]) + t[1] * time), {"level": 1.0, "slope": 0.0}
    )
    found = smoothness(problem, centre_at(problem, level=1.0, slope=0.0), THOROUGH, 0, gradient=True)
    assert found.jumps == ()
    assert found.points == 4
    assert max(item.error for item in found.gradient) < 1e-4 < TOLERANCE


@dataclass(frozen=True)
class WrongGradient(Problem):
    """The derivative by the second parameter is 2% too large."""

    def log_density_and_gradient(self, z):
        value, gradient = super().log_density_and_gradient(z)
        return value, gradient * np.array([1.0, 1.02])


def test_a_gradient_that_is_two_percent_off_is_found():
    time = np.linspace(-1.0, 1.0, samples())[:, None]
    right = formula_problem(
        PRIORS, lambda t: 290.0 + np.ones((1, 2)) * (np.exp(t[0]) + t[1] * time), {"level": 1.0, "slope": 0.0}
    )
    wrong = WrongGradient(**{name: getattr(right, name) for name in right.__dataclass_fields__})
    errors, _, _ = check_gradient(wrong, centre_at(right, level=1.0, slope=0.0), 0)
    assert [item.name for item in errors if item.error > TOLERANCE] == ["slope"]


MARGIN = 0.02  # K


def without_heater(folder, on_below="-150 degC"):
    """The small satellite in stronger sunlight, with a thermostat that only a cold body would switch on."""
    written = small.content()
    written["simulator"]["loads"]["sun"]["coefficient"] = "60 W/A"
    heater = written["simulator"]["heaters"]["heater"]
    heater["on_below"], heater["off_above"] = on_below, "40 degC"
    for channel in ("body_temp", "panel_temp"):
        written["observations"][channel]["noise"] = "0.3 K"
    return build_problem(*small.closed_loop(folder, written, noise=0.3))


def coldest(runs):
    """The body's lowest temperature in the middle of a run, K: the vertex of a parabola through its lowest samples."""
    body = runs[0].temperatures[:, 0]
    lowest = 30 + int(np.argmin(body[30:150]))
    rise = np.polyfit([-1.0, 0.0, 1.0], body[lowest - 1 : lowest + 2], 2)
    return np.polyval(rise, -0.5 * rise[1] / rise[0])


@dataclass(frozen=True)
class OneSided(Problem):
    """Derivatives from above, which at a kink are as good as those from below."""

    def log_density_and_gradient(self, z):
        steps = 1e-7 * np.eye(len(z))
        value = self.log_density(z)
        return value, np.array([(self.log_density(z + step) - value) / 1e-7 for step in steps])


def test_a_gradient_of_one_side_of_a_kink_is_right():
    time = np.linspace(-1.0, 1.0, samples())[:, None]

    def temperatures(theta):
        return 290.0 + np.ones((1, 2)) * (theta[0] + 0.5 * abs(theta[0] - 1.0) + theta[1] * time)

    problem = formula_problem(PRIORS, temperatures, {"level": 1.02, "slope": 0.0})
    sided = OneSided(**{name: getattr(problem, name) for name in problem.__dataclass_fields__})
    centre = centre_at(problem, level=1.0, slope=0.0)
    errors, _, _ = check_gradient(sided, centre, 0)
    assert max(item.error for item in errors) < TOLERANCE
    step = np.array([1e-5, 0.0])
    both = (problem.log_density(centre.z + step) - problem.log_density(centre.z - step)) / 2e-5
    assert abs(both / sided.log_density_and_gradient(centre.z)[1][0]) < 0.8


@pytest.fixture(scope="module")
def grazing(tmp_path_factory):
    """A problem whose body stays just above its thermostat's threshold, and the same without a thermostat."""
    truth = small.TRUTH | {"initial.body": 285.0, "initial.panel": 262.0}
    cold = without_heater(tmp_path_factory.mktemp("cold"))
    theta = np.array([({"initial.body": 285.0, "initial.panel": 262.0} | truth)[name] for name in cold.names])
    threshold = coldest(cold.simulate(theta)) - MARGIN
    problem = without_heater(tmp_path_factory.mktemp("grazing"), f"{threshold - 273.15:.9f} degC")
    problem = replace(observing(problem, cold.windows[0].observed), open_loop=None)
    return problem, cold, centre_at(problem, **{name: truth[name] for name in problem.names}), threshold


@pytest.mark.parametrize("name", ["link", "panel_size"])
def test_a_thermostat_that_is_grazed_is_found_where_the_body_touches_its_threshold(grazing, name):
    problem, cold, centre, threshold = grazing
    k = problem.names.index(name)
    along = centre.covariance[:, k] / np.sqrt(centre.covariance[k, k])
    scan = scan_all(problem, centre, THOROUGH)[k]

    def above(place):
        return coldest(cold.simulate(cold.to_theta(centre.z + place * along))) - threshold

    expected = brentq(above, *((-REACH, 0.0) if above(-REACH) < 0.0 else (0.0, REACH)))
    nearest = min(scan.jumps, key=lambda jump: abs(jump.place - expected))
    assert nearest.place == pytest.approx(expected, abs=0.05)
    assert nearest.heater == "heater"
    assert abs(nearest.switches[1] - nearest.switches[0]) >= 1
    body = cold.simulate(cold.to_theta(centre.z + expected * along))[0].temperatures[:, 0]
    assert nearest.seconds == pytest.approx(60.0 * (30 + np.argmin(body[30:150])), abs=120.0)
    assert abs(nearest.nats) > 1.0


def test_a_network_has_a_right_gradient_at_a_kink_too(grazing):
    problem, _, centre, _ = grazing
    errors, points, _ = check_gradient(problem, centre, 1)
    assert points == 4
    assert max(item.error for item in errors) < TOLERANCE


@pytest.mark.filterwarnings("error")
def test_simulations_that_fail_in_a_row_are_no_jump():
    values = np.array([[-np.inf, -np.inf, -np.inf, -1.0, 0.0, -1.0, -4.0, -np.inf, -np.inf]])
    assert _candidates(values, [[(1,)] * values.size]) == []


def test_a_failed_simulation_has_a_signature_of_its_own():
    assert signature(None, 2) == (-1,)
    problem = problem_with_a_step(told=False)
    assert signature(problem.simulate(np.array([1.0, 0.0])), 1) == (2, 1)
