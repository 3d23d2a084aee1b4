"""What was learnt of the parameters, and whether the search and the chains came to an end."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from .. import block, discrepancy, tables
from .. import figures as draw
from ..block import Block
from ..figures.style import GENETIC, PRIOR, chain_colour
from ..run_files import RunFiles, draws
from ..text import count, duration, listed

MOST_PAIRS = 8
MOST_TRACES = 6


def densities(run: RunFiles) -> list[Block]:
    """Figure 5: prior and posterior of each quantity."""
    if run.posterior is None or "prior" not in run.posterior.children or not run.parameters:
        return [block.note("Figure 5: this run has no posterior with its prior (posterior.nc, parameters.json).")]
    prior, posterior = (run.posterior[g].to_dataset() for g in ("prior", "posterior"))
    infos = [i for i in run.parameters if i.name in posterior and i.name in prior]
    genetic = {}
    if run.genetic is not None:
        values = run.genetic["mean_theta"].values
        genetic = {str(n): float(v) for n, v in zip(run.genetic["parameter"].values, values, strict=True)}
    shown = [
        draw.figure_density(
            info, draws(run.posterior, "prior", [info.name])[..., 0].ravel(),
            draws(run.posterior, "posterior", [info.name])[..., 0], genetic.get(info.name), large=number_ < 3,
        )
        for number_, info in enumerate(infos)
    ]  # fmt: skip
    chains = run.posterior["posterior"].to_dataset().sizes["chain"]
    caption = (
        f"Figure 5. Prior (dashed grey) and posterior of the {chains} chains (solid), each scaled to its own peak; "
        "▲ the genetic algorithm's mean. Where the prior is more than 12 times as wide as the posterior, the axis "
        "shows the posterior's surroundings only; a double click shows all of the prior."
    )
    key = (
        ("prior", PRIOR, "dash"),
        *((f"chain {k + 1}", chain_colour(k), "line") for k in range(chains)),
        *((("genetic algorithm, mean", GENETIC, "mark"),) if genetic else ()),
    )
    blocks = [Block("grid", caption, figures=tuple(shown[:3]), key=key, wide=True)]
    if shown[3:]:
        blocks.append(Block("grid", "Figure 5, the other quantities.", figures=tuple(shown[3:]), key=key))
    return blocks


def parameters(run: RunFiles) -> list[Block]:
    """Prior, posterior and what was learnt, in a table."""
    if not run.parameters:
        return [block.note("There is no list of parameters in this run (parameters.json).")]
    blocks = [block.table(tables.parameters(run))]
    if run.posterior is None:
        blocks.insert(0, block.note("There is no posterior in this run (posterior.nc): priors only."))
    blocks.append(
        block.text(
            "Contraction is 1 − sd of the posterior / sd of the prior: 0% says that the telemetry taught nothing "
            "about the quantity. ESS: effective sample size. Absolute temperatures are in °C, all else in SI units."
        )
    )
    of_windows = discrepancy.window_values(run)
    if of_windows.rows:
        words = (
            "These parameters may differ between the training windows. “Common” is the centre around which they do; "
            "on a window that was not trained on, a value is drawn anew around it with the deviation drift.<parameter>."
        )
        blocks += [Block("heading", "Values by window"), block.text(words), block.table(of_windows)]
    return blocks


def pairs(run: RunFiles) -> list[Block]:
    """Correlations, as a map and as draws."""
    if run.posterior is None or not run.parameters:
        return [block.note("There is no posterior in this run (posterior.nc).")]
    dataset = run.posterior["posterior"].to_dataset()
    infos = [i for i in run.parameters if i.name in dataset]
    values = draws(run.posterior, "posterior", [i.name for i in infos]).reshape(-1, len(infos))
    vary = np.ptp(values, axis=0) > 0
    infos, values = [i for i, v in zip(infos, vary, strict=True) if v], values[:, vary]
    if len(infos) < 2:
        return [block.note("There are fewer than two quantities, so none to compare.")]
    correlation = np.corrcoef(values.T)
    chosen = draw.most_correlated(correlation, MOST_PAIRS)
    diverging = np.zeros(len(values), bool)
    if "sample_stats" in run.posterior.children and "diverging" in run.posterior["sample_stats"]:
        diverging = run.posterior["sample_stats"]["diverging"].transpose("chain", "draw").values.astype(bool).ravel()
    others = [i.name for k, i in enumerate(infos) if k not in chosen]
    rest = f" Not shown: {listed(others)}; the heat map above has them all." if others else ""
    return [
        block.figure(
            draw.figure_correlation([i.name for i in infos], correlation),
            "Correlation of the posterior's quantities.", wide=True,
        ),
        block.figure(
            draw.figure_pairs([infos[k] for k in chosen], values[:, chosen], diverging),
            f"Posterior draws of the {len(chosen)} quantities that correlate most (300 draws; red crosses: divergent "
            f"draws, {int(diverging.sum())} in all).{rest}",
            wide=True,
        ),
    ]  # fmt: skip


def convergence(run: RunFiles) -> list[Block]:
    """Gates, searches and chains."""
    blocks = []
    if run.diagnostics is not None:
        blocks += [block.table(tables.gates(run.diagnostics), "There are no gates in diagnostics.json.")]
        work = run.diagnostics.get("gradient_evaluations")
        if work is not None:
            seconds = ((run.provenance or {}).get("stages") or {}).get("nuts")
            effective = [p["ess_bulk"] for p in run.diagnostics.get("parameters", []) if p.get("ess_bulk")]
            blocks.append(
                block.text(
                    f"{count(float(work))} gradients of the log density were computed, warm-up included"
                    + (
                        f", {float(work) / min(effective):.1f} for each effective draw of the worst"
                        if effective
                        else ""
                    )
                    + (f"; search of the mode and sampling took {duration(float(seconds))}." if seconds else ".")
                )
            )
    blocks += _genetic_convergence(run)
    if run.posterior is None:
        return [*blocks, block.note("There are no chains in this run (posterior.nc).")]
    blocks += _mode_search(run.posterior.attrs)
    dataset = run.posterior["posterior"].to_dataset()
    infos = [i for i in run.parameters if i.name in dataset]
    if infos:
        of = {p["name"]: p for p in (run.diagnostics or {}).get("parameters", [])}
        worst = sorted(infos, key=lambda i: -(of.get(i.name, {}).get("r_hat") or 0.0))[:MOST_TRACES]
        caption = (
            f"Traces and ranks of the {len(worst)} quantities with the highest R-hat. Chains that agree have rank "
            "histograms that stay near the dotted line."
        )
        figure = draw.figure_traces(worst, draws(run.posterior, "posterior", [i.name for i in worst]))
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
            draw.figure_genetic_history(run.genetic),
            f"The {runs} runs of the genetic algorithm on the window “train”.{work}",
        )
    ]
    known = {i.name: i for i in run.parameters}
    names = [str(n) for n in run.genetic["parameter"].values if str(n) in known]
    if names:
        part = run.genetic.sel(parameter=names)
        available = run.posterior["posterior"].to_dataset() if run.posterior is not None else {}
        median = None
        if run.posterior is not None and all(n in available for n in names):
            median = np.median(draws(run.posterior, "posterior", names), axis=(0, 1))
        figure = draw.figure_genetic_spread(
            [known[n] for n in names], part["best"].transpose("run", "parameter").values, part["best_theta"].values,
            part["mean_theta"].values, median,
        )  # fmt: skip
        caption = (
            "Where the runs of the genetic algorithm ended, between the prior's 2.5th (0) and 97.5th percentile (1). "
            "A mean that lies off the ridge of good fits (◆) can be worse than the best run (★)."
        )
        blocks.append(block.figure(figure, caption))
    return blocks


def _mode_search(attributes: Mapping[Any, Any]) -> list[Block]:
    """How the mode was sought, and where the chains start."""
    search = json.loads(attributes.get("mode_search", "{}"))
    if not search.get("modes"):
        return []
    best = search["modes"][0]
    found = len(search["modes"])
    words = f"The mode was sought {search['sought']}. The chains start around the best of {found} found"
    return [
        block.text(f"{words} ({best['origin']})" + ("." if best["converged"] else "; the search did not converge."))
    ]
