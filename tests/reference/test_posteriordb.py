"""Lotka-Volterra on the Hudson's Bay furs, against the reference posterior of posteriordb.

https://github.com/stan-dev/posteriordb, hudson_lynx_hare-lotka_volterra: means and mean squares of 10,000 draws of
Stan, with their Monte Carlo errors. Data: Howard (2009), after Odum (1971).
"""

import numpy as np
import pytest

from flightcal.calibration import calibrate_nuts
from flightcal.external.in_worker import close_workers
from flightcal.scenario import NutsSettings

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
