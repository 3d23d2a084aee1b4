"""The page of `flightcal validate`: ranks, coverage, contraction."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from ..run import write_text
from ..validation import Band, ecdf, ecdf_band, joint
from ..words import count, duration, listed, number, percent
from . import block
from .block import Section
from .findings import Finding
from .page import compose
from .run_files import Record, read_content
from .style import LINE, STATUS_FILL, STOCHASTIC, WARNING, band, finish, plots, small_titles
from .tables import Cell, Table

COLUMNS = 3
ROW_HEIGHT = 140


def write_validation(folder: Path) -> Path:
    """Writes validation.html from the validation.json in `folder`. Raises RunError where that is not there."""
    content = read_content(folder, "validation")
    output = folder / "validation.html"
    sections = [_ranks(content), _contraction(content)]
    write_text(output, compose("flightcal validate", content["name"], folder, "", findings(content), sections))
    return output


def first_tables(content: Record) -> list[Table]:
    """Ranks, coverage and contraction of each quantity."""
    return [_table(content)]


def findings(content: Record) -> list[Finding]:
    """Whether posteriors cover what made the telemetry, and whether the sampling passed its gates."""
    return [_uniform(content), _sampler(content)]


def _uniform(content: Record) -> Finding:
    outside = [quantity["name"] for quantity in content["quantities"] if not quantity["inside"]]
    repeats = count(content["repeats"])
    if not outside:
        return Finding(
            "good",
            "Posteriors cover what made the telemetry",
            f"In {repeats} repeats the ranks of all {len(content['quantities'])} quantities stay in the band that "
            "uniform ones stay in together with 95% probability.",
        )
    return Finding(
        "bad",
        "Posteriors do not cover what made the telemetry",
        f"In {repeats} repeats the ranks of {listed(outside)} leave the band that those of all quantities stay in "
        "together with 95% probability. Ends too frequent: the posterior is too narrow; the middle: too wide; one end: "
        "biased.",
    )


def _sampler(content: Record) -> Finding:
    failed = Counter(gate for gates in content["gates"] for gate in gates)
    affected = sum(bool(gates) for gates in content["gates"])
    work = f"{duration(content['seconds'])} in all; {count(content['redrawn'])} prior draws could not be simulated."
    if not affected:
        return Finding("good", "The sampler passed its gates in every repeat", work)
    return Finding(
        "warn",
        f"The sampler failed a gate in {affected} of {count(content['repeats'])} repeats",
        f"They are among the ranks: leaving them out would make these say less. {work}",
        tuple(f"{gate}: {count(times)} repeats" for gate, times in failed.most_common()),
    )


def _ranks(content: Record) -> Section:
    quantities = content["quantities"]
    names = [quantity["name"] for quantity in quantities]
    ranks = np.array(content["ranks"], float)
    figure = figure_ranks(
        names, ranks, [quantity["inside"] for quantity in quantities], ecdf_band(len(ranks), joint(0.95, len(names)))
    )
    blocks = [
        block.text(
            "Each repeat draws all quantities from their priors, makes telemetry with them at the scenario's own "
            "sample times and gaps, and calibrates that. The rank of what was drawn among the posterior's draws is "
            "uniform where the machinery is right (Talts et al. 2018)."
        ),
        block.figure(
            figure,
            "Distribution of the ranks less the uniform one. A hump to the left and a dip to the right: too narrow; "
            "the reverse: too wide; one-sided: biased.",
            wide=True,
        ),
        block.table(_table(content)),
        block.text(
            "p: probability that uniform ranks stray as far, of each quantity alone. With so many quantities some are "
            "low by chance, so the verdict asks that the bands of all hold together."
        ),
    ]
    return Section("ranks", "Ranks", blocks)


def _contraction(content: Record) -> Section:
    kept = [q for q, quantity in enumerate(content["quantities"]) if quantity["contraction"] is not None]
    names = [content["quantities"][q]["name"] for q in kept]
    contractions, scores = (np.array(content[name], float)[:, kept] for name in ("contractions", "scores"))
    caption = (
        "Left: 1 − variance of the posterior / variance of the prior; near 0 the telemetry teaches nothing. Right: by "
        "how many of its standard deviations the posterior's mean missed the truth."
    )
    figure = figure_contraction(names, contractions, scores)
    return Section("contraction", "Contraction", [block.figure(figure, caption, wide=True)])


def _table(content: Record) -> Table:
    repeats = content["repeats"]
    uniform = {True: Cell("✓ uniform", "good"), False: Cell("✕ not uniform", "bad")}
    rows = [
        [quantity["name"], uniform[bool(quantity["inside"])], number(quantity["p_value"], 2),
         *(f"{percent(share)}\n{count(share * repeats)} of {count(repeats)}" for share in quantity["coverage"]),
         percent(quantity["contraction"]), number(quantity["score"], 3)]
        for quantity in content["quantities"]
    ]  # fmt: skip
    header = (
        "quantity", "ranks", "p", *(f"{percent(share, 0)} interval covers" for share in content["intervals"]),
        "contraction, median", "score, root mean square",
    )  # fmt: skip
    return Table(header, rows, range(2, len(header)))


def figure_ranks(names: Sequence[str], ranks: NDArray[np.float64], inside: Sequence[bool], allowed: Band) -> go.Figure:
    """Distribution of each quantity's ranks less the uniform one, in the band of all together. ranks: [R, q]."""
    figure, height = plots(names, COLUMNS, ROW_HEIGHT, gap=56, horizontal_spacing=0.08, shared_yaxes="all")
    points = np.concatenate([[0.0], allowed.points, [1.0]])
    low, high = (np.concatenate([[0.0], bound - allowed.points, [0.0]]) for bound in (allowed.lower, allowed.upper))
    for q, within in enumerate(inside):
        place = {"row": q // COLUMNS + 1, "col": q % COLUMNS + 1}
        outline = np.concatenate([points, points[::-1]]), np.concatenate([low, high[::-1]])
        band(figure, *outline, "95% band of all quantities together", "band", STATUS_FILL, **place)
        figure.add_scatter(
            x=points, y=ecdf(ranks[:, q], points) - points, mode="lines",
            line={"color": STOCHASTIC if within else WARNING, "width": 1.6, "shape": "hv"}, name="ranks",
            legendgroup="ranks", showlegend=q == 0, hovertemplate="%{x:.2f}: %{y:.3f}<extra></extra>", **place,
        )  # fmt: skip
        figure.update_yaxes(nticks=5, **place)
        figure.update_xaxes(range=[0, 1], nticks=5, **place)
        if place["col"] == 1:
            figure.update_yaxes(title_text="ECDF − uniform, –", **place)
        if q >= len(names) - COLUMNS:
            figure.update_xaxes(title_text="rank, –", **place)
    for empty in range(len(names), -(-len(names) // COLUMNS) * COLUMNS):
        row, col = empty // COLUMNS + 1, empty % COLUMNS + 1
        figure.update_xaxes(visible=False, row=row, col=col)
        figure.update_yaxes(visible=False, row=row, col=col)
    finish(figure, height)
    small_titles(figure)
    return figure


def figure_contraction(
    names: Sequence[str], contractions: NDArray[np.float64], scores: NDArray[np.float64]
) -> go.Figure:
    """How much posteriors narrowed their priors, and by how many deviations they missed the truth; [R, q] each."""
    figure = make_subplots(1, 2, shared_yaxes=True, horizontal_spacing=0.04)
    for column, values in enumerate((contractions, scores), start=1):
        for q, name in enumerate(names):
            figure.add_box(
                x=values[:, q], y=[name] * len(values), orientation="h", name=name, boxpoints="outliers",
                marker={"color": STOCHASTIC, "size": 3}, line={"width": 1.2}, showlegend=False, row=1, col=column,
            )  # fmt: skip
    for bound in (-1.96, 0.0, 1.96):
        figure.add_vline(x=bound, line={"color": LINE, "width": 1, "dash": "solid" if not bound else "dot"}, col=2)
    finish(figure, 60 + 26 * len(names) + 82, legend=False)
    figure.update_layout(margin={"l": 160})
    figure.update_xaxes(title_text="contraction, –", range=[min(-0.05, np.nanmin(contractions)), 1.02], row=1, col=1)
    figure.update_xaxes(title_text="(posterior mean − truth) / deviation, –", row=1, col=2)
    figure.update_yaxes(autorange="reversed")
    return figure
