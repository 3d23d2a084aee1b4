"""Samplers of the same posterior, each in a process of its own: `python -m benchmarks.peers.samplers NAME SECONDS`.

Each prints one line of JSON: seconds, gradients or simulations, ESS (bulk) and R-hat. The peers start where flightcal's
chains do, around the mode that flightcal had to find, NUTS in its whitened coordinates; their time counts from there,
without compilation and without warm-up. So does flightcal's; how long it took from nothing is said too.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from typing import Any

import numpy as np

CHAINS = 2
"""Of the gradient-based peers: one a core."""


def main() -> None:
    """One sampler."""
    name, seconds = sys.argv[1], float(sys.argv[2])
    if name == "numpyro":
        os.environ["XLA_FLAGS"] = f"--xla_force_host_platform_device_count={CHAINS}"
    print(json.dumps({"flightcal": flightcal, "numpyro": numpyro, "nutpie": nutpie, "emcee": emcee}[name](seconds)))


def flightcal(seconds: float) -> dict[str, Any]:
    """The scenario's 4 chains of 1,000 draws, from when their warm-up draws are made; a small run before compiles."""
    from flightcal.calibration import calibrate_nuts
    from flightcal.progress import Silent
    from flightcal.scenario import NutsSettings

    from ..problem import benchmark_problem

    problem, _ = benchmark_problem()
    calibrate_nuts(problem, NutsSettings(chains=2, draws=50, warmup=50))
    settings = NutsSettings(draws=1000 if seconds > 60 else 300)
    marks: list[float] = []

    class Marks(Silent):
        def at(self, done: float, note: str = "") -> None:
            if not marks and done >= settings.chains * settings.warmup:
                marks.append(time.perf_counter())

    begin = time.perf_counter()
    posterior = calibrate_nuts(problem, settings, progress=Marks())
    end = time.perf_counter()
    warmed = marks[0] if marks else begin
    return {
        **_judged(posterior.theta, problem.names),
        "seconds": end - warmed,
        "evaluations": posterior.draws.gradients - posterior.draws.warmup_gradients,
        "divergences": int(posterior.draws.statistics["diverging"].sum()),
        "how": f"{settings.chains} chains of {settings.draws} draws; mode search, {settings.warmup} warm-up draws and "
        f"diagnostics take it to {end - begin:.1f} s",
    }


def _start() -> tuple[Any, Any, Any]:
    """Problem, mode z [d], and starts z [chain, d] around it as flightcal takes them."""
    from flightcal.calibration import climb
    from flightcal.calibration.nuts import overdispersed_starts
    from flightcal.problem.coordinates import whitening

    from ..problem import benchmark_problem

    problem, theta = benchmark_problem()
    mode = climb(problem, problem.to_z(theta)).z
    coordinates = whitening(mode, problem.gauss_newton_hessian(mode))
    return problem, coordinates, overdispersed_starts(problem.log_density_and_gradient, coordinates, 64, 1)


def numpyro(seconds: float) -> dict[str, Any]:
    """NUTS with a dense mass matrix on diffrax; warm-up and then draws in blocks until the time is over."""
    import numpyro as package
    from numpyro.infer import MCMC, NUTS
    from tests.oracle import jax, jnp

    from ..canonical import canonical
    from .diffrax_ode import Configuration, log_density

    package.set_host_device_count(CHAINS)
    problem, coordinates, starts = _start()
    factor, mean = jnp.asarray(coordinates.factor), jnp.asarray(coordinates.mean)
    density = log_density(canonical(problem), Configuration("Tsit5", adjoint="ForwardMode"))
    kernel = NUTS(
        potential_fn=lambda w: -density(mean + factor @ w),
        dense_mass=True,
        forward_mode_differentiation=True,
    )
    warmup, block = (100, 10) if seconds > 60 else (20, 5)
    mcmc = MCMC(kernel, num_warmup=warmup, num_samples=block, num_chains=CHAINS, progress_bar=False)
    begin = time.perf_counter()
    begins = jnp.asarray(coordinates.to_w(starts[:CHAINS]))
    mcmc.warmup(jax.random.PRNGKey(1), init_params=begins, extra_fields=("num_steps", "diverging"))
    warmed = time.perf_counter() - begin
    blocks, steps, divergences, spent = [], 0, 0, 0.0
    mcmc.run(mcmc.post_warmup_state.rng_key, extra_fields=("num_steps", "diverging"))  # compiles, and is not kept
    while spent < seconds:
        mcmc.post_warmup_state = mcmc.last_state
        begin = time.perf_counter()
        mcmc.run(mcmc.post_warmup_state.rng_key, extra_fields=("num_steps", "diverging"))
        draws = np.asarray(mcmc.get_samples(group_by_chain=True))
        spent += time.perf_counter() - begin
        blocks.append(draws)
        extra = mcmc.get_extra_fields()
        steps += int(np.sum(extra["num_steps"]))
        divergences += int(np.sum(extra["diverging"]))
    z = coordinates.to_z(np.concatenate(blocks, axis=1))
    return {
        **_judged(problem.to_theta(z), problem.names),
        "seconds": spent,
        "evaluations": steps,
        "divergences": divergences,
        "how": f"{CHAINS} chains of {z.shape[1]} draws; {warmup} warm-up draws "
        f"({warmed:.0f} s, compilation included) not in time",
    }


def nutpie(seconds: float) -> dict[str, Any]:
    """nutpie, its defaults, on the located lax.scan model."""
    import nutpie as package
    from nutpie.compiled_pyfunc import from_pyfunc

    from ..canonical import canonical
    from .jax_scan import located, log_density_and_gradient

    problem, coordinates, starts = _start()
    model = canonical(problem)
    gradient = log_density_and_gradient(model, located(model))
    gradient(starts[0])
    calls: list[float] = []

    stop = threading.Event()

    def density(w: Any) -> tuple[float, Any]:
        if stop.is_set():  # or a trajectory of up to 1,023 gradients would have to end first
            return -1e300, np.ones_like(w)
        calls.append(time.perf_counter())
        value, slope = gradient(coordinates.mean + coordinates.factor @ w)
        return float(value), coordinates.factor.T @ np.asarray(slope)

    tune = 50 if seconds > 60 else 10
    samplers = []
    marks: list[list[float]] = [[] for _ in range(CHAINS)]
    for chain in range(CHAINS):

        def record(z: Any, mark: list[float] = marks[chain]) -> dict[str, Any]:
            mark.append(time.perf_counter())
            return {"z": z}

        compiled = from_pyfunc(
            ndim=len(starts[0]),
            make_logp_fn=lambda: density,
            make_expand_fn=lambda *_, record=record: record,
            expanded_dtypes=[np.dtype(np.float64)],
            expanded_shapes=[(len(starts[0]),)],
            expanded_names=["z"],
            make_initial_point_fn=lambda _, chain=chain: coordinates.to_w(starts[chain]),
        )
        samplers.append(
            package.sample(
                compiled, draws=20_000, tune=tune, chains=1, cores=1, seed=chain + 1, blocking=False, progress_bar=False
            )
        )
    limit = time.perf_counter() + seconds * 3
    while time.perf_counter() < limit:
        time.sleep(0.5)
        if all(len(mark) > tune and time.perf_counter() - mark[tune] > seconds for mark in marks):
            break
    stop.set()
    end = time.perf_counter()
    drawn = [len(mark) for mark in marks]
    traces = [sampler.abort() for sampler in samplers]
    z = [np.asarray(trace.posterior["z"])[0] for trace in traces]
    z = [coordinates.to_z(chain) for chain in z]
    kept = max(0, min(min(drawn) - tune, *(len(chain) for chain in z)))
    warmed = max((mark[tune] for mark in marks if len(mark) > tune), default=end)
    result = {
        "seconds": end - min(mark[tune] if len(mark) > tune else end for mark in marks),
        "evaluations": sum(call > warmed for call in calls),
        "divergences": 0,
        "how": f"{CHAINS} chains of {kept} draws; {tune} warm-up draws not in time",
    }
    return {**_judged(problem.to_theta(np.stack([chain[:kept] for chain in z])), problem.names), **result}


def emcee(seconds: float) -> dict[str, Any]:
    """The stretch move with 64 walkers on flightcal's batch; the first half of the time is burn-in."""
    import emcee as package

    problem, _, starts = _start()

    def log_probability(z: Any) -> Any:
        thetas = problem.to_theta(z)
        values = np.asarray(problem.priors.at(z).log_density).copy()
        (window,) = problem.windows
        for k, run in enumerate(window.simulate_many(thetas)):
            values[k] += -np.inf if run is None else window.of_residuals(thetas[k], run)
        return values

    sampler = package.EnsembleSampler(len(starts), starts.shape[1], log_probability, vectorize=True)
    np.random.seed(1)  # emcee's own generator
    state = starts
    for _ in range(2):
        sampler.reset()
        begin = time.perf_counter()
        while time.perf_counter() - begin < 0.5 * seconds:
            state = sampler.run_mcmc(state, 10)
        spent = time.perf_counter() - begin
    chain = sampler.get_chain()
    steps = len(chain)
    tau = package.autocorr.integrated_time(chain, quiet=True)
    judged = _judged(problem.to_theta(np.swapaxes(chain, 0, 1)), problem.names)
    return {
        **judged,
        "seconds": spent,
        "evaluations": len(starts) * steps,
        "divergences": 0,
        "how": f"{len(starts)} walkers of {steps} steps, after as long a burn-in not in time; autocorrelation time "
        f"{tau.max():.0f} steps, so the chain holds {steps / tau.max():.0f} of them",
    }


def _judged(theta: Any, names: tuple[str, ...]) -> dict[str, float]:
    """Worst and median ESS (bulk) and the worst R-hat of theta [chain, draw, d], as flightcal reports them."""

    from flightcal.calibration.diagnostics import _summary

    chains = [_summary(name, theta[..., k]) for k, name in enumerate(names)]
    return {
        "r_hat": float(np.max([one.r_hat for one in chains])),
        "ess": float(np.min([one.ess_bulk for one in chains])),
        "ess_median": float(np.median([one.ess_bulk for one in chains])),
    }


if __name__ == "__main__":
    main()
