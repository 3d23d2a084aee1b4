"""Whether the searches and the chains came to an end."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go
import xarray as xr
from scipy.stats import rankdata

from ...words import count, duration, number, shown, unit
from .. import block
from ..block import Block, section
from ..run_files import ParameterInfo, Record, RunFiles, draws
from ..style import GENETIC, GENETIC_BEST, LINE, STOCHASTIC, chain_colour, finish, levels, plots, small_titles
from ..tables import Cell, Table
from ..thinning import Array

MOST_TRACES = 6

MOST_DRAWS = 400
"""Draws of a chain that a trace shows."""

RANK_BINS = 20


@section("convergence", "Convergence")
def panel(run: RunFiles) -> list[Block]:
    """Gates, searches and chains."""
    blocks = []
    if run.diagnostics is not None:
        blocks += [block.table(gates(run.diagnostics), "There are no gates in diagnostics.json.")]
        work = run.diagnostics.get("gradient_evaluations")
        if work is not None:
            seconds = ((run.provenance or {}).get("stages") or {}).get("nuts")
            effective = [p["ess_bulk"] for p in run.diagnostics.get("parameters", []) if p.get("ess_bulk")]
            words = f"{count(float(work))} gradients of the log density were computed, warm-up included"
            if effective:
                words += f", {float(work) / min(effective):.1f} for each effective draw of the worst"
            if seconds:
                words += f"; search of the mode and sampling took {duration(float(seconds))}"
            blocks.append(block.text(f"{words}."))
    blocks += _genetic_convergence(run)
    if run.posterior is None:
        return [*blocks, block.note("There are no chains in this run (posterior.nc).")]
    blocks += _mode_search(run.posterior.attrs, with_heat=run.heat is not None)
    infos = run.sampled
    if infos:
        of = {p["name"]: p for p in (run.diagnostics or {}).get("parameters", [])}
        worst = sorted(infos, key=lambda i: -(of.get(i.name, {}).get("r_hat") or 0.0))[:MOST_TRACES]
        caption = (
            f"Traces and ranks of the {len(worst)} quantities with the highest R-hat. Chains that agree have rank "
            "histograms that stay near the dotted line."
        )
        figure = figure_traces(worst, draws(run.posterior, "posterior", [i.name for i in worst]))
        blocks.append(block.figure(figure, caption, wide=True))
    return blocks


def _genetic_convergence(run: RunFiles) -> list[Block]:
    if run.genetic is None:
        return [block.note("There is no genetic algorithm in this run (genetic.nc).")]
    evaluations = run.genetic.attrs.get("evaluations")
    work = f" {count(float(evaluations))} simulations in all." if evaluations is not None else ""
    runs = run.genetic.sizes["run"]
    blocks = [
        block.figure(
            figure_genetic_history(run.genetic),
            f"The {runs} runs of the genetic algorithm on the window “train”.{work}{_converged(run.genetic)}",
        )
    ]
    known = {i.name: i for i in run.parameters}
    names = [str(n) for n in run.genetic["parameter"].values if str(n) in known]
    if names:
        part = run.genetic.sel(parameter=names)
        median = None
        if run.posterior is not None and {info.name for info in run.sampled} >= set(names):
            median = np.median(draws(run.posterior, "posterior", names), axis=(0, 1))
        figure = figure_genetic_spread(
            [known[n] for n in names], part["best"].transpose("run", "parameter").values, part["best_theta"].values,
            part["mean_theta"].values, median,
        )  # fmt: skip
        caption = (
            "Where the runs of the genetic algorithm ended, between the prior's 2.5th (0) and 97.5th percentile (1). "
            "A mean that lies off the ridge of good fits (◆) can be worse than the best run (★)."
        )
        blocks.append(block.figure(figure, caption))
    return blocks


def _converged(genetic: xr.Dataset) -> str:
    """How many runs ended by themselves."""
    generations = genetic["generations"].values
    return (
        f" {int(genetic['converged'].sum())} of {genetic.sizes['run']} converged, after {generations.min()} to "
        f"{generations.max()} generations: {genetic.attrs['converged_when']}."
    )


def _mode_search(attributes: Mapping[Any, Any], *, with_heat: bool) -> list[Block]:
    """How the mode was sought, and where the chains start."""
    search = json.loads(attributes.get("mode_search", "{}"))
    if not search.get("modes"):
        return []
    best = search["modes"][0]
    found = len(search["modes"])
    how = search["sought"]
    if with_heat and "open loop" not in how:
        how = "without unmodelled heat, heaters driven by their measured status where there is one"
    words = f"The mode was sought {how}. The chains start around the best of {found} found"
    end = "." if best["converged"] else "; the search did not converge."
    return [block.text(f"{words} ({best['origin']}){end}")]


def gates(diagnostics: Record) -> Table:
    """Gates of convergence, each with what was found and what is required."""
    passed = {True: Cell("✓ passed", "good"), False: Cell("✕ failed", "bad")}
    rows = [
        [passed[bool(g["passed"])], g["name"], shown(g["found"]), shown(g["required"]),
         g.get("advice") or ""]
        for g in diagnostics["gates"]
    ]  # fmt: skip
    return Table(("", "gate", "found", "required", "advice"), rows)


def figure_genetic_history(genetic: xr.Dataset) -> go.Figure:
    """Best RMSE so far against generation, for each run. genetic: genetic.nc."""
    figure = go.Figure()
    history = genetic["history"].transpose("run", "generation").values
    best = int(np.argmin(genetic["rmse"].values))
    generations = np.arange(history.shape[1])
    for run in [r for r in range(len(history)) if r != best] + [best]:
        chosen = run == best
        figure.add_scatter(
            x=generations, y=history[run].astype(np.float32), mode="lines",
            name=f"best run ({run + 1})" if chosen else "other runs", legendgroup="best" if chosen else "other",
            showlegend=chosen or run == (0 if best else 1),
            line={"color": GENETIC_BEST if chosen else GENETIC, "width": 2.4 if chosen else 1.3},
            hovertemplate=f"run {run + 1}, generation %{{x}}: %{{y:.4g}} K<extra></extra>",
        )  # fmt: skip
    finish(figure, 360, top=8)
    figure.update_xaxes(title_text="generation, –")
    figure.update_yaxes(title_text="best RMSE so far, K", type="log", dtick="D2", tickformat=".3~g")
    return figure


def figure_genetic_spread(
    infos: Sequence[ParameterInfo], runs: Array, best: Array, mean: Array, posterior: Array | None
) -> go.Figure:
    """Parameters of every run of the genetic algorithm, its best and its mean, within the prior's central 95%.

    runs: [run, parameter], best, mean: [parameter]; posterior: median [parameter] or None; SI.
    """
    figure = go.Figure()
    low = np.array([i.prior_quantiles[0] for i in infos])
    span = np.array([i.prior_quantiles[2] for i in infos]) - low
    labels = [i.name for i in infos]

    def marks(values: Array, name: str, colour: str, symbol: str, size: int, opacity: float = 1.0) -> None:
        shown = [
            [number(v + i.offset) + (f" {unit(i.unit)}" if i.unit else "") for v, i in zip(row, infos, strict=True)]
            for row in np.atleast_2d(values)
        ]
        figure.add_scatter(
            x=((np.atleast_2d(values) - low) / span).ravel().astype(np.float32),
            y=labels * len(np.atleast_2d(values)), customdata=np.ravel(shown).tolist(), name=name, mode="markers",
            marker={"color": colour, "symbol": symbol, "size": size, "opacity": opacity},
            hovertemplate="%{y}: %{customdata}",
        )  # fmt: skip

    marks(runs, "each run", GENETIC, "circle-open", 8, 0.8)
    marks(mean, "mean of the runs (as published)", GENETIC, "diamond", 11)
    marks(best, "best run", GENETIC_BEST, "star", 11)
    if posterior is not None:
        marks(posterior, "posterior median", STOCHASTIC, "line-ns-open", 16)
    finish(figure, 150 + 28 * len(infos), top=8)
    figure.update_xaxes(title_text="place in the prior's<br>central 95%, –", zeroline=False)
    for edge in (0, 1):
        figure.add_vline(x=edge, line={"color": LINE, "width": 1, "dash": "dot"})
    figure.update_yaxes(autorange="reversed", automargin=True)
    return figure


def figure_traces(infos: Sequence[ParameterInfo], posterior: Array) -> go.Figure:
    """Trace and rank histogram of some quantities: one row each.

    posterior: [chain, draw, quantity], SI. Chains that have converged have ranks that are all alike: every line of
    the histogram stays near one (Vehtari et al. 2021, Bayesian Anal. 16, sec. 4.4).
    """
    rows, chains, draws = len(infos), posterior.shape[0], posterior.shape[1]
    titles = [t for i in infos for t in (f"{i.name}: trace", f"{i.name}: ranks")]
    figure, height = plots(titles, 2, 150, column_widths=[0.64, 0.36], horizontal_spacing=0.09)
    shown = np.unique(np.linspace(0, draws - 1, MOST_DRAWS).astype(int))
    for row, info in enumerate(infos, start=1):
        values = posterior[..., row - 1] + info.offset
        ranks = rankdata(values).reshape(values.shape)
        for chain in range(chains):
            look = {"name": f"chain {chain + 1}", "legendgroup": f"chain {chain + 1}", "mode": "lines"}
            figure.add_scatter(
                x=shown, y=values[chain, shown].astype(np.float32), showlegend=row == 1, opacity=0.8,
                line={"color": chain_colour(chain), "width": 0.9}, row=row, col=1, **look,
            )  # fmt: skip
            counts, edges = np.histogram(ranks[chain], bins=RANK_BINS, range=(0.5, ranks.size + 0.5))
            figure.add_scatter(
                x=edges / ranks.size, y=np.append(counts, counts[-1]) * RANK_BINS / draws, showlegend=False,
                line={"color": chain_colour(chain), "width": 1.4, "shape": "hv"}, row=row, col=2, **look,
            )  # fmt: skip
        figure.update_yaxes(title_text=unit(info.unit) or "–", row=row, col=1, nticks=5)
        figure.update_yaxes(title_text="relative count, –", row=row, col=2, rangemode="tozero", nticks=5)
    levels(figure, 1.0, range(1, rows + 1), 2, "dot")
    finish(figure, height)
    small_titles(figure)
    figure.update_xaxes(title_text="draw, –", row=rows, col=1)
    figure.update_xaxes(range=[0, 1], tickvals=[0, 0.25, 0.5, 0.75, 1], col=2)
    figure.update_xaxes(title_text="rank among all draws, share", row=rows, col=2)
    return figure
