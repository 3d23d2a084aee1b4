"""Prior and posterior of each quantity: figure 5 of the paper."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from arviz_stats.base import array_stats
from numpy.typing import NDArray

from ...words import labelled
from .. import block
from ..block import Block, section
from ..run_files import ParameterInfo, RunFiles, draws
from ..style import GENETIC, PRIOR, chain_colour, finish
from ..thinning import Array

ZOOM = 12.0
"""A prior wider than so many posteriors is not shown whole: the posterior would be a needle."""


@section("densities", "Prior and posterior")
def panel(run: RunFiles) -> list[Block]:
    """Figure 5: prior and posterior of each quantity."""
    if run.posterior is None or "prior" not in run.posterior.children or not run.parameters:
        return [block.note("Figure 5: this run has no posterior with its prior (posterior.nc, priors.json).")]
    infos = [i for i in run.sampled if i.name in run.posterior["prior"]]
    genetic = {}
    if run.genetic is not None:
        values = run.genetic["mean_theta"].values
        genetic = {str(n): float(v) for n, v in zip(run.genetic["parameter"].values, values, strict=True)}
    shown = [
        figure_density(
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
    blocks = [block.grid(shown[:3], caption, key, large=True)]
    return [*blocks, block.grid(shown[3:], "Figure 5, the other quantities.", key)] if shown[3:] else blocks


def figure_density(
    info: ParameterInfo, prior: Array, posterior: Array, genetic: float | None = None, *, large: bool = False
) -> go.Figure:
    """Prior and posterior density of one parameter for each chain (figure 5), each scaled to its own peak.

    prior: [draw], posterior: [chain, draw], SI; genetic: the genetic algorithm's value, SI.
    The axis holds the prior's central 95% and the posterior; where the prior is more than 12 times as wide it
    holds the posterior's surroundings only.
    """
    figure = go.Figure()
    prior, posterior = prior + info.offset, posterior + info.offset
    low, high = _shown(prior, posterior)
    support = (float(prior.min()), float(prior.max()))
    x, density = _density(prior, support, smoothing=2.0)
    figure.add_scatter(
        x=x, y=density, name="prior", mode="lines", line={"color": PRIOR, "width": 1.5, "dash": "dash"},
        hovertemplate="prior, %{x:.5g}<extra></extra>",
    )  # fmt: skip
    for chain, values in enumerate(posterior):
        x, density = _density(values, support)
        figure.add_scatter(
            x=x, y=density, name=f"chain {chain + 1}", mode="lines",
            line={"color": chain_colour(chain), "width": 1.6},
            hovertemplate=f"chain {chain + 1}, %{{x:.5g}}<extra></extra>",
        )  # fmt: skip
    if genetic is not None:
        value = genetic + info.offset
        low, high = min(low, value), max(high, value)
        figure.add_scatter(
            x=[value], y=[0.0], name="genetic algorithm", mode="markers", cliponaxis=False,
            marker={"symbol": "triangle-up", "size": 11, "color": GENETIC},
            hovertemplate="genetic algorithm, %{x:.5g}<extra></extra>",
        )  # fmt: skip
    finish(figure, 340 if large else 230, legend=False, top=12)
    pad = 0.03 * (high - low)
    figure.update_layout(margin={"l": 40, "r": 14, "b": 46}, meta={"tools": False})
    title = labelled(info.name, info.unit)
    # A long name, as of a discrepancy's amplitude, has to fit under a small plot.
    font = {"size": min(12, max(9, 12 * 36 // len(title)))}
    figure.update_xaxes(title={"text": title, "font": font}, range=[low - pad, high + pad], nticks=6)
    figure.update_yaxes(range=[0, 1.08], tickvals=[0, 1], title_text="density / peak, –", rangemode="nonnegative")
    return figure


def _density(
    values: Array, support: tuple[float, float], smoothing: float = 1.0
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Kernel density of draws on 200 points, scaled to a peak of one; a spike where most are the same.

    support: where the quantity can be. The density ends at zero inside it and is mirrored at its bounds, so that a
    posterior pressed against a prior's bound does not seem to fall off before it.
    """
    quarter, three_quarters = np.quantile(values, [0.25, 0.75])
    if quarter == three_quarters:
        return np.repeat(quarter, 2).astype(np.float32), np.array([0, 1], np.float32)
    margin = 0.8 * values.std()
    limits = (max(support[0], values.min() - margin), min(support[1], values.max() + margin))
    limits = (min(limits[0], values.min()), max(limits[1], values.max()))
    grid, density, _ = array_stats.kde(
        values, bound_correction=True, bw="silverman", bw_fct=smoothing, grid_len=200, custom_lims=limits
    )
    return np.asarray(grid, np.float32), np.asarray(density / density.max(), np.float32)


def _shown(prior: Array, posterior: Array) -> tuple[float, float]:
    """Range of the axis."""
    low, high = np.quantile(posterior, [0.0005, 0.9995])
    prior_low, prior_high = np.quantile(prior, [0.025, 0.975])
    if prior_high - prior_low > ZOOM * (high - low):
        return float(low - (high - low)), float(high + (high - low))
    return float(min(low, prior_low)), float(max(high, prior_high))
