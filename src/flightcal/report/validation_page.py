"""The page of `flightcal validate`: ranks, coverage, contraction."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from flightcal.validation.simulation_based import ecdf_band, joint

from . import figures as draw
from .block import Block, Section
from .page import compose, write_page
from .run_files import Record, read_content
from .tables import Table
from .text import count, duration, listed, number, percent
from .verdict import Finding


def write_validation(folder: Path) -> Path:
    """Writes validation.html from the validation.json in `folder`. Raises RunError where that is not there."""
    content = read_content(folder, "validation")
    output = folder / "validation.html"
    findings = [_uniform(content), _sampler(content)]
    write_page(output, compose("flightcal validate", content["name"], folder, "", findings, _made(content)))
    return output


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


def _made(content: Record) -> list[Section]:
    quantities = content["quantities"]
    names = [quantity["name"] for quantity in quantities]
    ranks = np.array(content["ranks"], float)
    band = ecdf_band(len(ranks), joint(0.95, len(names)))
    kept = [q for q, quantity in enumerate(quantities) if quantity["contraction"] is not None]
    contractions, scores = (np.array(content[name], float)[:, kept] for name in ("contractions", "scores"))
    return [
        Section(
            "ranks",
            "Ranks",
            [
                Block(
                    "text",
                    "Each repeat draws all quantities from their priors, makes telemetry with them at the scenario's "
                    "own sample times and gaps, and calibrates that. The rank of what was drawn among the posterior's "
                    "draws is uniform where the machinery is right (Talts et al. 2018).",
                ),
                Block(
                    "figure",
                    "Distribution of the ranks less the uniform one. A hump to the left and a dip to the right: too "
                    "narrow; the reverse: too wide; one-sided: biased.",
                    figures=(draw.figure_ranks(names, ranks, [quantity["inside"] for quantity in quantities], band),),
                    wide=True,
                ),
                Block("table", table=_table(content)),
                Block(
                    "text",
                    "p: probability that uniform ranks stray as far, of each quantity alone. With so many quantities "
                    "some are low by chance, so the verdict asks that the bands of all hold together.",
                ),
            ],
        ),
        Section(
            "contraction",
            "Contraction",
            [
                Block(
                    "figure",
                    "Left: 1 − variance of the posterior / variance of the prior; near 0 the telemetry teaches "
                    "nothing. Right: by how many of its standard deviations the posterior's mean missed the truth.",
                    figures=(draw.figure_contraction([names[q] for q in kept], contractions, scores),),
                    wide=True,
                )
            ],
        ),
    ]


def _table(content: Record) -> Table:
    repeats = content["repeats"]
    rows, states = [], {}
    for row, quantity in enumerate(content["quantities"]):
        states[row, 1] = "good" if quantity["inside"] else "bad"
        rows.append(
            [quantity["name"], "✓ uniform" if quantity["inside"] else "✕ not uniform", number(quantity["p_value"], 2)]
            + [f"{percent(share)}\n{count(share * repeats)} of {count(repeats)}" for share in quantity["coverage"]]
            + [percent(quantity["contraction"]), number(quantity["score"], 3)]
        )
    header = (
        "quantity", "ranks", "p", *(f"{percent(share, 0)} interval covers" for share in content["intervals"]),
        "contraction, median", "score, root mean square",
    )  # fmt: skip
    return Table(header, rows, range(2, len(header)), states=states)
