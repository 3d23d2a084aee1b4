"""Two posteriors of differential equations, against the references of posteriordb.

https://github.com/stan-dev/posteriordb: means and mean squares of 10,000 draws of Stan, with their Monte Carlo errors.
hudson_lynx_hare-lotka_volterra: Lotka-Volterra on the Hudson's Bay furs; data of Howard (2009), after Odum (1971).
one_comp_mm_elim_abs-one_comp_mm_elim_abs: one compartment with absorption and Michaelis-Menten elimination; the data
were simulated by Betancourt and stand in https://github.com/stan-dev/example-models, knitr/convert-odes.
"""

import numpy as np
import pytest

from flightcal.calibration import calibrate_nuts
from flightcal.scenario import NutsSettings
from tests.workers import close_workers

from . import problems

HARE = (
    30.0, 47.2, 70.2, 77.4, 36.3, 20.6, 18.1, 21.4, 22.0, 25.4, 27.1, 40.3, 57.0, 76.6, 52.3, 19.5, 11.2, 7.6, 14.6,
    16.2, 24.7,
)  # fmt: skip
LYNX = (
    4.0, 6.1, 9.8, 35.2, 59.4, 41.7, 19.0, 13.0, 8.3, 9.1, 7.4, 8.0, 12.3, 19.5, 45.7, 51.1, 29.7, 15.8, 9.7, 10.1,
    8.6,
)  # fmt: skip
"""Thousands of pelts in the years 1900 to 1920."""

REFERENCE = {
    # mean, its Monte Carlo error, mean square, its Monte Carlo error
    "alpha": (0.546864499783931, 0.00062626907415417, 0.3030362900, 0.000702338064),
    "beta": (0.0277472877678081, 4.11604266143508e-05, 0.0007871719, 0.000002383326),
    "gamma": (0.800095360233122, 0.000884603225898987, 0.6481388153, 0.001458682363),
    "delta": (0.0240859152534545, 3.50047668143892e-05, 0.0005925775, 0.000001773506),
    "hare": (34.0352224770469, 0.0293082761729642, 1166.9038171313, 2.021219162061),
    "lynx": (5.93589713368062, 0.00533872103038814, 35.5163321009, 0.064593205736),
    "noise.y0": (0.24805686320252, 0.000439337727695207, 0.0634036795, 0.000237267243),
    "noise.y1": (0.251016914583618, 0.000439525598676463, 0.0649094189, 0.000238366766),
}

MODEL = """
import jax

STEPS = 20  # of a fourth-order Runge-Kutta scheme in a year, which is a minute here

def simulate(inputs, times, start):
    alpha, beta, gamma, delta = (inputs[name] for name in ("alpha", "beta", "gamma", "delta"))

    def slope(z):  # of the logarithms of both populations
        return jnp.stack([alpha - beta * jnp.exp(z[1]), delta * jnp.exp(z[0]) - gamma])

    def step(z, _):
        h = 1.0 / STEPS
        a = slope(z)
        b = slope(z + h / 2 * a)
        c = slope(z + h / 2 * b)
        d = slope(z + h * c)
        return z + h / 6 * (a + 2 * b + 2 * c + d), None

    def year(z, _):
        return jax.lax.scan(step, z, None, STEPS)[0], z

    first = jnp.log(jnp.stack([inputs["hare"], inputs["lynx"]]))
    return jax.lax.scan(year, first, None, len(times))[1]
"""


@pytest.fixture(autouse=True)
def _no_idle_workers():
    yield
    close_workers()


@pytest.mark.slow
def test_lotka_volterra_has_the_reference_posterior(tmp_path):
    def positive(mean, deviation):
        return {
            "truncated_normal": {
                "mean": mean, "standard_deviation": deviation, "lower": 0.0, "upper": mean + 8 * deviation
            }
        }  # fmt: skip

    priors = {
        "alpha": positive(1.0, 0.5),
        "beta": positive(0.05, 0.05),
        "gamma": positive(1.0, 0.5),
        "delta": positive(0.05, 0.05),
        "hare": {"lognormal": {"median": 10.0, "factor": float(np.e)}},
        "lynx": {"lognormal": {"median": 10.0, "factor": float(np.e)}},
    }
    noise = {"lognormal": {"median": f"{np.exp(-1):.17g} K", "factor": float(np.e)}}
    observed = np.log(np.stack([HARE, LYNX], axis=1))
    problem = problems.problem(tmp_path, MODEL, priors, observed, noise)
    posterior = calibrate_nuts(problem, NutsSettings(chains=2, draws=1000, warmup=400), 1)
    assert [gate.name for gate in posterior.diagnostics.gates if not gate.passed] == []
    for name, (mean, of_mean, square, of_square) in REFERENCE.items():
        draws = posterior.theta[..., problem.names.index(name)]
        for found, expected, error in ((draws, mean, of_mean), (draws**2, square, of_square)):
            assert found.mean() == pytest.approx(expected, abs=4 * np.hypot(error, problems.standard_error(found))), (
                name
            )


CONCENTRATION = (
    5.70812264865215, 7.10126075072086, 8.38520678426651, 9.79008249883381, 13.4390409239245, 11.4478987597702,
    11.2124282696837, 11.4269217682577, 12.2432859438401, 13.8201804108938, 13.8408670746042, 11.422291744251,
    10.5031943081843, 11.9121452242965, 14.0849980781312, 10.5505145523917, 10.1905539351877, 12.2232272590821,
    11.7290653047821, 12.2719396535996,
)  # fmt: skip
"""mg/L, twice a day from noon of the first day."""

COMPARTMENT = {
    # mean, its Monte Carlo error
    "k_a": (0.761013422876304, 0.000780642770834883),
    "K_m": (2.53728053955015, 0.0782881153190289),
    "V_m": (0.981820806365048, 0.00603334688230323),
    "sigma": (0.128834841818538, 0.000236057749956237),
}
COMPARTMENT_SQUARES = {
    # mean square, its Monte Carlo error; K_m and V_m have none, their tails fall as the third power
    "k_a": (0.58520983, 0.00123539179),
    "sigma": (0.01714603, 0.00006652375),
}

CONCENTRATED = 12.0  # mg/L, about which the concentration stays: the rate at which that is eliminated is known best

COMPARTMENT_MODEL = """
import jax

STEPS = 20  # of a fourth-order Runge-Kutta scheme in half a day, which is a minute here
DOSE, VOLUME, CONCENTRATED = 30.0, 2.0, 12.0  # mg, L, mg/L

def simulate(inputs, times, start):
    k_a, K_m = inputs["k_a"], jnp.tan(jnp.pi / 2 * inputs["K_m"])
    V_m = inputs["rate"] * (K_m + CONCENTRATED)

    def slope(t, concentration):
        absorbed = jnp.exp(-k_a * t) * DOSE * k_a / VOLUME
        return absorbed - V_m / VOLUME * concentration / (K_m + concentration)

    def step(state, _):
        t, y = state
        h = 0.5 / STEPS
        a = slope(t, y)
        b = slope(t + h / 2, y + h / 2 * a)
        c = slope(t + h / 2, y + h / 2 * b)
        d = slope(t + h, y + h * c)
        return (t + h, y + h / 6 * (a + 2 * b + 2 * c + d)), None

    def half_a_day(state, _):
        state = jax.lax.scan(step, state, None, STEPS)[0]
        return state, jnp.log(state[1])

    return jax.lax.scan(half_a_day, (0.0, 0.0), None, len(times))[1][:, None]
"""


@pytest.mark.slow
def test_one_compartment_has_the_reference_posterior(tmp_path):
    """Its priors are half-Cauchy: that of K_m as the tangent of a uniform angle, the others by weights on the draws."""
    medians = {"k_a": 1.0, "rate": 0.1, "noise.y0": 0.1}
    priors = {name: {"lognormal": {"median": medians[name], "factor": float(np.e)}} for name in ("k_a", "rate")}
    priors["K_m"] = {"uniform": [0.0, 1.0]}
    noise = {"lognormal": {"median": f"{medians['noise.y0']} K", "factor": float(np.e)}}
    observed = np.log(np.array(CONCENTRATION))[:, None]
    problem = problems.problem(tmp_path, COMPARTMENT_MODEL, priors, observed, noise)
    posterior = calibrate_nuts(problem, NutsSettings(chains=2, draws=2000, warmup=500, target_acceptance=0.9), 1)
    assert [gate.name for gate in posterior.diagnostics.gates if not gate.passed] == []
    sampled = {name: posterior.theta[..., k] for k, name in enumerate(problem.names)}
    half_maximum = np.tan(np.pi / 2 * sampled["K_m"])
    scale = half_maximum + CONCENTRATED
    draws = {"k_a": sampled["k_a"], "K_m": half_maximum, "V_m": sampled["rate"] * scale, "sigma": sampled["noise.y0"]}
    weights = scale / np.prod([1 + draws[name] ** 2 for name in ("k_a", "V_m", "sigma")], axis=0)
    for name, median in medians.items():
        weights *= sampled[name] * np.exp(0.5 * np.log(sampled[name] / median) ** 2)
    weights /= weights.mean()
    squares = [(f"{name} squared", draws[name] ** 2, reference) for name, reference in COMPARTMENT_SQUARES.items()]
    for name, values, (expected, error) in [(n, draws[n], COMPARTMENT[n]) for n in COMPARTMENT] + squares:
        mean = (weights * values).mean()
        sampling_error = problems.standard_error(weights * (values - mean))
        assert mean == pytest.approx(expected, abs=4 * np.hypot(error, sampling_error)), name
