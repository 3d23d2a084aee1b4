"""How the searches went: the genetic algorithm's history, traces and ranks of the chains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
import xarray as xr
from numpy.typing import NDArray
from plotly.subplots import make_subplots
from scipy.stats import rankdata

from ..run_files import ParameterInfo
from ..text import unit
from .style import GENETIC, GENETIC_BEST, LINE, chain_colour, finish, small_titles

Array = NDArray[np.float64]

MOST_DRAWS = 400
"""Draws of a chain that a trace shows."""

RANK_BINS = 20


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


def figure_traces(infos: Sequence[ParameterInfo], posterior: Array) -> go.Figure:
    """Trace and rank histogram of some quantities: one row each.

    posterior: [chain, draw, quantity], SI. Chains that have converged have ranks that are all alike: every line of
    the histogram stays near one (Vehtari et al. 2021, Bayesian Anal. 16, sec. 4.4).
    """
    rows, chains, draws = len(infos), posterior.shape[0], posterior.shape[1]
    row_height, gap = 150, 60
    inner = rows * row_height + (rows - 1) * gap
    titles = [t for i in infos for t in (f"{i.name}: trace", f"{i.name}: ranks")]
    figure = make_subplots(
        rows, 2, subplot_titles=titles, column_widths=[0.64, 0.36], horizontal_spacing=0.09,
        vertical_spacing=gap / inner if rows > 1 else 0.0,
    )  # fmt: skip
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
        figure.add_hline(y=1.0, line={"color": LINE, "width": 1, "dash": "dot"}, row=row, col=2)
        figure.update_yaxes(title_text=unit(info.unit) or "–", row=row, col=1, nticks=5)
        figure.update_yaxes(title_text="relative count, –", row=row, col=2, rangemode="tozero", nticks=5)
    finish(figure, inner + 34 + 30 + 52)
    small_titles(figure)
    figure.update_xaxes(title_text="draw, –", row=rows, col=1)
    figure.update_xaxes(range=[0, 1], tickvals=[0, 0.25, 0.5, 0.75, 1], col=2)
    figure.update_xaxes(title_text="rank among all draws, share", row=rows, col=2)
    return figure
