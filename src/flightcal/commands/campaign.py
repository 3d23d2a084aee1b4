"""`flightcal campaign`: a scenario's simulator at the thetas of a design."""

from __future__ import annotations

from collections import Counter
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import RunError, require
from ..progress import SILENT, Progress
from .options import ScenarioFile, TelemetryPlace

if TYPE_CHECKING:
    import xarray

    from ..campaign import Design, Runner, Subject, Tally
    from ..problem import Problem


def campaign(
    scenario: ScenarioFile,
    out: Annotated[Path, typer.Option(help="Folder of the campaign; runs that are done in it are not run again.")],
    runs: Annotated[int, typer.Option(min=1, help="Runs of the design; a larger number than before grows it.")],
    design: Annotated[
        str | None,
        typer.Option(help="sobol, latin-hypercube, prior or posterior; default: sobol, with --around posterior."),
    ] = None,
    around: Annotated[Path | None, typer.Option(help="Run whose posterior the design's draws are of.")] = None,
    spread: Annotated[float, typer.Option(min=0.0, help="Scales the posterior draws' distance from their mean.")] = 1.0,
    window: Annotated[str | None, typer.Option(help="Window of the scenario; default: the first to train on.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Of the design; default: the scenario's.")] = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes on this machine, one run at a time in each.")] = 2,
    scheduler: Annotated[
        str | None, typer.Option(help="Run on this Dask cluster instead, such as tcp://host:8786; it must see --out.")
    ] = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Run failed runs again, too.")] = False,
    telemetry: TelemetryPlace = None,
) -> None:
    """Run the simulator at every theta of a design, and keep what each run gave.

    Example: `flightcal campaign scenario.yaml --design sobol --runs 2000 --out runs/sobol`
    """
    from .display import display

    with display() as progress:
        run_scenario_campaign(
            scenario, out, runs, window=window, kind=design, seed=seed, around=around, spread=spread, workers=workers,
            scheduler=scheduler, retry_failed=retry_failed, telemetry=telemetry, progress=progress,
        )  # fmt: skip


def run_scenario_campaign(
    scenario_file: Path,
    out: Path,
    runs: int,
    *,
    window: str | None = None,
    kind: str | None = None,
    seed: int | None = None,
    around: Path | None = None,
    spread: float = 1.0,
    workers: int = 2,
    scheduler: str | None = None,
    retry_failed: bool = False,
    telemetry: Path | None = None,
    progress: Progress = SILENT,
) -> Tally:
    """Run a campaign of a scenario, or take it up where it stopped; what became of its runs.

    kind, seed, around, spread: see `make_design`; seed None: the scenario's.
    Raises FlightcalError for what is the user's to mend, also where no run at all finished.
    """
    from ..campaign import Tally, open_campaign, run_campaign, run_function
    from ..external import FINISHED
    from ..problem import build_problem
    from ..scenario import load_scenario
    from ..telemetry import read

    if scheduler is not None:
        require("distributed", "cluster", "--scheduler")
    scenario = load_scenario(scenario_file, telemetry=telemetry)
    problem = build_problem(scenario, read(scenario), window or scenario.train_windows[0])
    subject = subject_of(problem)
    seed = scenario.calibration.seed if seed is None else seed
    design = make_design(problem, runs, seed, kind=kind, around=around, spread=spread)
    progress.say(f"design: {design.kind}, {runs} runs of {len(subject.parameters)} parameters, seed {seed}")
    (only_window,) = problem.windows
    run, together = run_function(only_window.simulator, len(only_window.times))
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
            progress=progress,
        )
    except KeyboardInterrupt:
        progress.say(f"stopped: {Tally(Counter(open_campaign(out)['outcome'].values.tolist()))}")
        raise
    progress.say(f"campaign: {tally}")
    if not tally.outcomes[FINISHED]:
        raise RunError(f"{out}: none of the {tally.total} runs finished; {first_failure(out)}")
    return tally


def _runner(workers: int, scheduler: str | None) -> AbstractContextManager[Runner]:
    from ..campaign import Here

    if scheduler is None:
        return nullcontext(Here(workers))
    from ..campaign.cluster import remote_cluster

    return remote_cluster(scheduler)


def first_failure(folder: Path) -> str:
    """What the first failed run of a campaign says."""
    from ..campaign import NOT_RUN, open_campaign
    from ..external import FINISHED

    data = open_campaign(folder)
    for k, (outcome, message) in enumerate(zip(data["outcome"].values, data["message"].values, strict=True)):
        if outcome not in (FINISHED, NOT_RUN):
            return f"run {k}: {outcome}: {message}"
    return "no run has a record"


def subject_of(problem: Problem) -> Subject:
    """What a campaign of a problem's simulator runs."""
    from ..campaign import Subject, input_hashes, scenario_parts
    from ..scenario import resolved_yaml

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
    from ..campaign import Design
    from ..probability import KINDS, Priors, around_posterior, latin_hypercube, prior_draws, sobol
    from ..run import hash_of, hash_of_file

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
    import xarray

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
