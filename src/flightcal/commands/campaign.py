"""`flightcal campaign`: a scenario's simulator at the thetas of a design."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path

import xarray

from ..campaign import (
    FINISHED,
    NOT_RUN,
    Design,
    Here,
    Runner,
    Subject,
    Tally,
    input_hashes,
    open_campaign,
    run_campaign,
    run_function,
    scenario_parts,
)
from ..environment import orbital_period
from ..errors import RunError, require
from ..probability import KINDS, Priors, around_posterior, latin_hypercube, prior_draws, sobol
from ..problem import Problem, build_problem
from ..run import hash_of, hash_of_file
from ..scenario import load_scenario, resolved_yaml
from ..telemetry import read_telemetry


def run_scenario_campaign(
    scenario_file: Path,
    out: Path,
    runs: int,
    *,
    window: str = "train",
    kind: str | None = None,
    seed: int | None = None,
    around: Path | None = None,
    spread: float = 1.0,
    workers: int = 2,
    scheduler: str | None = None,
    retry_failed: bool = False,
    telemetry: Path | None = None,
    say: Callable[[str], None] = lambda _: None,
    on_progress: Callable[[Tally], None] = lambda _: None,
) -> Tally:
    """Run a campaign of a scenario, or take it up where it stopped; what became of its runs.

    kind, seed, around, spread: see `make_design`; seed None: the scenario's. say: told in words what is done.
    Raises FlightcalError for what is the user's to mend, also where no run at all finished.
    """
    if scheduler is not None:
        require("distributed", "cluster", "--scheduler")
    scenario = load_scenario(scenario_file, telemetry=telemetry)
    period = orbital_period(scenario.environment, scenario.folder)
    data = read_telemetry(scenario.telemetry, scenario.folder, period=period)
    problem = build_problem(scenario, data, window)
    subject = subject_of(problem)
    seed = scenario.calibration.seed if seed is None else seed
    design = make_design(problem, runs, seed, kind=kind, around=around, spread=spread)
    say(f"design: {design.kind}, {runs} runs of {len(subject.parameters)} parameters, seed {seed}")
    (own,) = problem.windows
    run, together = run_function(own.simulator, len(own.times))
    connect = partial(_runner, workers, scheduler)
    try:
        tally = run_campaign(
            out,
            subject,
            design,
            run,
            connect,
            together=together,
            retry_failed=retry_failed,
            on_begin=lambda before: say(f"found: {before}"),
            on_progress=on_progress,
        )
    except KeyboardInterrupt:
        say(f"stopped: {Tally(Counter(open_campaign(out)['outcome'].values.tolist()))}")
        raise
    say(f"campaign: {tally}")
    if not tally.outcomes[FINISHED]:
        raise RunError(f"{out}: none of the {tally.total} runs finished; {first_failure(out)}")
    return tally


def _runner(workers: int, scheduler: str | None) -> AbstractContextManager[Runner]:
    if scheduler is None:
        return nullcontext(Here(workers))
    from ..campaign import remote_cluster

    return remote_cluster(scheduler)


def first_failure(folder: Path) -> str:
    """What the first failed run of a campaign says."""
    data = open_campaign(folder)
    for k, (outcome, message) in enumerate(zip(data["outcome"].values, data["message"].values, strict=True)):
        if outcome not in (FINISHED, NOT_RUN):
            return f"run {k}: {outcome}: {message}"
    return "no run has a record"


def subject_of(problem: Problem) -> Subject:
    """What a campaign of a problem's simulator runs."""
    (window,) = problem.windows
    scenario, simulator = problem.scenario, window.simulator
    return Subject(
        parts=scenario_parts(scenario, window.name),
        inputs=input_hashes(scenario),
        parameters=simulator.parameters,
        channels=simulator.channels,
        heaters=simulator.heaters,
        times=window.times,
        text=resolved_yaml(scenario, absolute=True),
    )


def make_design(
    problem: Problem,
    runs: int,
    seed: int,
    *,
    kind: str | None = None,
    around: Path | None = None,
    spread: float = 1.0,
) -> Design:
    """A design over the parameters of a problem's simulator.

    kind: one of `designs.KINDS`; None: posterior where `around` is given, else sobol. around: the folder of the run
    whose posterior a design of kind posterior takes its draws from, their distance from their mean scaled by `spread`.
    Raises RunError where these do not go together.
    """
    kind = kind or ("sobol" if around is None else "posterior")
    if kind not in KINDS:
        raise RunError(f"--design {kind}: expected {', '.join(KINDS)}")
    if (kind == "posterior") != (around is not None):
        raise RunError(
            f"--design {kind} {'needs' if around is None else 'does not go with'} --around, the run to draw from"
        )
    (window,) = problem.windows
    names = window.simulator.parameters
    priors = Priors(names, tuple(problem.priors.priors[problem.names.index(name)] for name in names))
    origin = {"priors": hash_of([prior.model_dump(mode="json") for prior in priors.priors])}
    if around is not None:
        file = around / "posterior.nc"
        posterior = _posterior(file, window.name)
        try:
            theta = around_posterior(priors, posterior, runs, seed, spread=spread)
        except RunError as error:
            raise RunError(f"{file}: {error}") from None
        return Design(kind, seed, {**origin, "posterior": hash_of_file(file), "spread": spread}, theta)
    draw = {"sobol": sobol, "latin-hypercube": latin_hypercube, "prior": prior_draws}[kind]
    return Design(kind, seed, origin, draw(priors, runs, seed))


def _posterior(file: Path, window: str) -> xarray.Dataset:
    """The draws in a run's posterior.nc; on another window than that of the calibration, without the initial state."""
    try:
        with xarray.open_dataset(file, group="posterior", engine="h5netcdf") as opened:
            posterior = opened.load()
    except FileNotFoundError:
        raise RunError(f"{file.parent}: found no posterior.nc, expected the folder of a finished run") from None
    except (OSError, ValueError, KeyError) as error:
        raise RunError(f"{file}: found a damaged posterior ({error})") from None
    if window == "train":
        return posterior
    return posterior.drop_vars([name for name in map(str, posterior.data_vars) if name.startswith("initial.")])
