"""The No-U-Turn sampler: nutpie on a log density of Python or of C, in whitened coordinates.

z = mean + factor w, with the factor from the Gauss-Newton Hessian at the mode: what is correlated and badly scaled
in z is nearly standard normal in w. nutpie's low-rank adaptation then corrects what the Hessian got wrong. In 30
dimensions it takes 3% more gradients than the diagonal one where the whitening is perfect, and a twelfth per
effective draw where principal directions are off by a factor of e^(+-0.5).

nutpie's interface for a density of one's own is not documented; the tests hold down what is relied on (nutpie 0.16.8):
an exception or a value of the wrong kind ends a sampler with a panic, while a density that is not finite is a
divergence; a chain starts exactly where it is told; every chain of a sampler is told that it is chain 0,
so each chain has a sampler of its own here, with its own seed and start. All chains run at the same time, so an
interrupted run has about as many draws of each.
"""

from __future__ import annotations

import inspect
import math
import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import FlightcalError
from ..problem import STOPPED, NativeDensity, Problem, Whitening
from ..progress import SILENT, Progress
from ..scenario import NutsSettings
from ..simulator import FloatArray
from .nutpie_models import native_model, python_model

LogDensity = Callable[[FloatArray], tuple[float, FloatArray]]
"""z [d] -> (log density, gradient [d]). Called from several threads; its compiled part should release the GIL."""

MAXIMUM_DEPTH = 10
"""Of a trajectory's tree: at most 2^10 - 1 gradients a draw (the usual choice: Stan, PyMC)."""

OVERDISPERSION = 1.5
"""Chains start at w ~ N(0, 1.5^2 I). In 20 dimensions that is 3 standard deviations outside the typical distance,
enough for R-hat to see chains that do not forget their start; farther out a closed-loop thermostat's density has
other, far worse modes."""

_START_ATTEMPTS = 100
_POLL = 0.05  # s

_STATISTICS: dict[str, tuple[str, type]] = {
    "diverging": ("diverging", bool),
    "depth": ("depth", int),
    "n_steps": ("n_steps", int),
    "energy": ("energy", float),
    "step_size": ("step_size", float),
    "acceptance": ("mean_tree_accept", float),
    "log_density": ("logp", float),
}
"""Our name -> nutpie's, and its type (nutpie's integers are unsigned, and wrap around when subtracted)."""


@dataclass(frozen=True)
class Draws:
    """What the chains drew after warm-up."""

    z: FloatArray
    """[chain, draw, d]"""
    statistics: dict[str, NDArray[Any]]
    """[chain, draw] each: diverging, depth, n_steps, energy, step_size, acceptance, log_density."""
    gradients: int
    """Evaluations of the density, warm-up included."""
    warmup_gradients: int
    warmup_divergences: int
    failures: int
    """Evaluations that raised or were not finite, warm-up included; each ended its trajectory as a divergence, but for
    those of the search for a first step size."""
    last_failure: str | None
    interrupted: bool
    """Stopped by Ctrl-C; chains are cut to the shortest, which may be empty."""


def overdispersed_starts(log_density: LogDensity, whitening: Whitening, chains: int, seed: int) -> FloatArray:
    """Starts z [chain, d], wider than the posterior (see `OVERDISPERSION`); those of no finite density redrawn.

    Raises FlightcalError when a chain finds none.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0,)))
    density = _Density(log_density, whitening)
    starts = []
    for chain in range(chains):
        for _ in range(_START_ATTEMPTS):
            w = OVERDISPERSION * rng.standard_normal(len(whitening.mean))
            if _can_start(density, w):
                starts.append(whitening.to_z(w))
                break
        else:
            raise FlightcalError(
                f"NUTS: found no start for chain {chain + 1} in {_START_ATTEMPTS} draws around the mode, expected "
                f"a point with a finite density; the last failure: {density.last_failure}"
            )
    return np.array(starts)


def _can_start(density: _Density, w: FloatArray) -> bool:
    """Whether nutpie takes w [d] as a start: a finite density, and every derivative different from zero."""
    value, gradient = density(w)
    if math.isfinite(value) and not gradient.all():
        density.last_failure = "a derivative is exactly zero, as at the mode or along an unused parameter"
    return math.isfinite(value) and bool(gradient.all())


def sample(
    log_density: LogDensity,
    whitening: Whitening,
    settings: NutsSettings,
    seed: int,
    *,
    native: Callable[[Whitening], NativeDensity | None] = lambda _: None,
    in_turn: bool = False,
    progress: Progress = SILENT,
    depth: int = MAXIMUM_DEPTH,
) -> Draws:
    """Draw from a density with `settings.chains` chains at the same time.

    native: the same density in whitened coordinates as a C function, one for each chain; None: there is none.
    in_turn: the Python density is of many short calls, so it is evaluated for one chain at a time: chains that ask
    each other for the interpreter at each of them take ten times as long.
    progress: told the draws of all chains about five times a second, in the calling thread.
    depth: of a draw's tree at most.

    The same seed gives the same draws on any number of cores. Ctrl-C ends the chains and returns what they have.
    Raises FlightcalError when a chain cannot start.
    """
    starts = overdispersed_starts(log_density, whitening, settings.chains, seed)
    seeds = np.random.SeedSequence(seed, spawn_key=(1,)).generate_state(settings.chains, np.uint64)
    turn = threading.Lock() if in_turn else None
    densities = [native(whitening) or _Density(log_density, whitening, turn) for _ in seeds]
    samplers: list[Any] = []
    traces: dict[int, Any] = {}
    total = settings.chains * (settings.warmup + settings.draws)
    with progress.stage("sampling", total) as sampling, _interruption() as interrupted:
        try:
            for density, start, chain_seed in zip(densities, whitening.to_w(starts), seeds, strict=True):
                samplers.append(_start(density, start, settings, int(chain_seed), depth))
            while len(traces) < len(samplers) and not interrupted.is_set():
                for chain, sampler in enumerate(samplers):
                    if chain not in traces and (trace := _wait(sampler)) is not None:
                        traces[chain] = trace
                drawn, gradients = (sum(getattr(d, what) for d in densities) for what in ("draws", "gradients"))
                sampling.at(drawn, f"{drawn}/{total} draws, {gradients} gradients")
            # Counted before the density is stopped: the draw that this cuts short is not one of the posterior's.
            kept = [density.draws for density in densities]
            for density in densities:
                density.stop()
            for chain, sampler in enumerate(samplers):
                if chain not in traces:
                    traces[chain] = _abort(sampler)
        finally:
            # A nutpie thread that outlives the interpreter crashes it, so every chain is ended; one that panicked
            # panics again, which must not hide the first panic nor keep the others running.
            for density in densities:
                density.stop()
            for sampler in samplers:
                with suppress(BaseException):
                    sampler.cancel()
    drawn = [traces[chain] for chain in range(len(samplers))]
    return _collect(drawn, kept, densities, whitening, settings, interrupted.is_set())


def sample_problem(
    problem: Problem,
    coordinates: Whitening,
    settings: NutsSettings,
    seed: int,
    *,
    progress: Progress = SILENT,
    depth: int = MAXIMUM_DEPTH,
) -> Draws:
    """`sample` of a problem, compiled where it can be; of a size of heat no z is below zero."""
    density, native = problem.log_density_and_gradient, problem.native_density
    emulated = all(window.simulator.error_basis is not None for window in problem.windows)
    draws = sample(
        density, coordinates, settings, seed, native=native, in_turn=emulated, progress=progress, depth=depth
    )
    return replace(draws, z=problem.priors.unsigned(draws.z))


class _Density:
    """One chain's density in whitened coordinates; counts, and turns failures into a density of zero.

    The log determinant of the factor is left out, so it is the log density of z.
    """

    def __init__(
        self, log_density: LogDensity, whitening: Whitening, turn: AbstractContextManager[Any] | None = None
    ) -> None:
        """turn: to be held while the density is evaluated; None: it may be at any time."""
        self._turn = nullcontext() if turn is None else turn
        self._log_density = log_density
        self._whitening = whitening
        self._stopped = False
        self.draws = self.gradients = self.failures = 0
        self.last_failure: str | None = None

    def __call__(self, w: FloatArray) -> tuple[float, FloatArray]:
        if self._stopped:
            return STOPPED, np.ones_like(w)
        self.gradients += 1
        try:
            with self._turn:
                z = self._whitening.to_z(w)
                value, gradient = self._log_density(z)
                gradient = self._whitening.pull_back(z, np.asarray(gradient, float))
                value = float(value)
        # Whatever goes wrong in a simulation at one point of the parameter space must not end the other chains.
        except Exception as error:
            return self._failed(w, f"{type(error).__name__}: {error}")
        if not math.isfinite(value + float(gradient.sum())):
            return self._failed(w, "the log density or its gradient is not finite")
        return value, gradient

    def _failed(self, w: FloatArray, reason: str) -> tuple[float, FloatArray]:
        self.failures += 1
        self.last_failure = reason
        return -math.inf, np.zeros_like(w)

    def record(self, w: FloatArray) -> dict[str, FloatArray]:
        """What nutpie keeps of each draw."""
        self.draws += 1
        return {"w": w}

    def stop(self) -> None:
        """From now on every trajectory ends at once."""
        self._stopped = True


_ChainDensity = _Density | NativeDensity


def _start(density: _ChainDensity, start: FloatArray, settings: NutsSettings, seed: int, depth: int) -> Any:
    """A running nutpie sampler of one chain from w = `start` [d]."""
    if isinstance(density, NativeDensity):
        model = native_model(density, start)
    else:
        model = python_model(density, density.record, start)
    import nutpie

    return nutpie.sample(
        model,
        draws=settings.draws,
        tune=settings.warmup,
        chains=1,
        cores=1,
        seed=seed,
        target_accept=settings.target_acceptance,
        maxdepth=depth,
        **_low_rank_adaptation(nutpie.sample),
        blocking=False,
        progress_bar=False,
    )


def _low_rank_adaptation(sample: Callable[..., Any]) -> dict[str, Any]:
    """How to ask for a low-rank mass matrix: nutpie renamed it after 0.16.8, the last for Python 3.11."""
    if "adaptation" in inspect.signature(sample).parameters:
        return {"adaptation": "low_rank"}
    return {"low_rank_modified_mass_matrix": True}


def _wait(sampler: Any) -> Any:
    """The trace of a sampler that finishes now; None while it runs."""
    try:
        return sampler.wait(timeout=_POLL)
    except TimeoutError:
        return None


def _abort(sampler: Any) -> Any:
    """The trace of a sampler so far."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "More chains", UserWarning)
        return sampler.abort()


@contextmanager
def _interruption() -> Iterator[threading.Event]:
    """An event that Ctrl-C sets, instead of an exception that could fall between two statements.

    So does SIGTERM where it means the same. Outside of the main thread Python delivers neither, and the event stays
    unset.
    """
    event = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield event
        return
    previous = signal.getsignal(signal.SIGINT)
    same = [number for number in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(number) is previous]
    for number in same:
        signal.signal(number, lambda *_: event.set())
    try:
        yield event
    finally:
        for number in same:
            signal.signal(number, previous or signal.SIG_DFL)


def _collect(
    traces: list[Any],
    kept: list[int],
    densities: list[_ChainDensity],
    whitening: Whitening,
    settings: NutsSettings,
    interrupted: bool,
) -> Draws:
    """The chains' traces as arrays, cut to the shortest chain."""
    length = max(0, min(kept) - settings.warmup)
    w = np.stack([trace["posterior"]["w"].values[0, :length] for trace in traces])
    statistics: dict[str, NDArray[Any]] = {
        name: np.stack([trace["sample_stats"][theirs].values[0, :length] for trace in traces]).astype(kind)
        for name, (theirs, kind) in _STATISTICS.items()
    }
    warmup = [trace["warmup_sample_stats"] for trace in traces]
    failures = [density.last_failure for density in densities if density.last_failure is not None]
    return Draws(
        z=whitening.to_z(w),
        statistics=statistics,
        gradients=sum(density.gradients for density in densities),
        warmup_gradients=sum(int(group["n_steps"].sum()) for group in warmup),
        warmup_divergences=sum(int(group["diverging"].sum()) for group in warmup),
        failures=sum(density.failures for density in densities),
        last_failure=failures[-1] if failures else None,
        interrupted=interrupted,
    )
