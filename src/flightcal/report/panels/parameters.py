"""Prior, posterior and what was learnt of each quantity, in a table."""

from __future__ import annotations

import numpy as np

from .. import block
from ..block import Block, section
from ..run_files import ParameterInfo, RunFiles, draws
from ..tables import Cell, Table, interval
from ..text import count, percent, unit

EDGE = 0.2
"""Share of the posterior in the prior's outer 5% above which it is called pressed against the prior's edge."""

INTERVAL = "median [95%]"

MOST_TARGETS = 2
"""Places that a parameter sets or scales that the table names; the scenario on the page has them all."""


@section("parameters", "Parameters")
def panel(run: RunFiles) -> list[Block]:
    """Prior, posterior and what was learnt, in a table."""
    if not run.parameters:
        return [block.note("There is no list of parameters in this run (parameters.json).")]
    blocks = [block.table(summary(run))]
    if run.posterior is None:
        blocks.insert(0, block.note("There is no posterior in this run (posterior.nc): priors only."))
    blocks.append(
        block.text(
            "Contraction is 1 − sd of the posterior / sd of the prior: 0% says that the telemetry taught nothing "
            "about the quantity. ESS: effective sample size. Absolute temperatures are in °C, all else in SI units."
        )
    )
    of_windows = window_values(run)
    if of_windows.rows:
        words = (
            "These parameters may differ between the training windows. “Common” is the centre around which they do; "
            "on a window that was not trained on, a value is drawn anew around it with the deviation drift.<parameter>."
        )
        blocks += [block.heading("Values by window"), block.text(words), block.table(of_windows)]
    return blocks


def summary(run: RunFiles) -> Table:
    """Prior against posterior of every uncertain quantity, with its diagnostics."""
    diagnosed = {p["name"]: p for p in (run.diagnostics or {}).get("parameters", [])}
    sampled = {info.name for info in run.sampled}
    edges = at_edge(run)
    rows = []
    for info in run.parameters:
        low, median, high = info.prior_quantiles
        more = f" and {len(info.target) - MOST_TARGETS} more" if len(info.target) > MOST_TARGETS else ""
        target = f"\n{info.mode} {', '.join(info.target[:MOST_TARGETS])}{more}" if info.target else ""
        symbol = f", {unit(info.unit)}" if unit(info.unit) else ""
        cells = [f"{info.name}{symbol}{target}", f"{_interval(info, median, low, high)}\n{_prior(info)}"]
        if info.name in sampled and run.posterior is not None:
            values = draws(run.posterior, "posterior", [info.name])
            q = np.quantile(values, [0.025, 0.5, 0.975])
            cells += [_interval(info, q[1], q[0], q[2]), percent(contraction(run, info.name))]
        else:
            cells += ["–"] * 2
        of = diagnosed.get(info.name, {})
        r_hat = of.get("r_hat")
        effective = f"{count(of.get('ess_bulk'))} / {count(of.get('ess_tail'))}"
        cells += [Cell("–" if r_hat is None else f"{r_hat:.3f}", "bad" if (r_hat or 0) > 1.01 else ""), effective]
        if info.name in edges:
            cells[2] = Cell(f"{cells[2]}\n⚠ at the prior's {edges[info.name]} edge", "warn")
        rows.append(cells)
    header = (
        "quantity, unit", f"prior, {INTERVAL}", f"posterior, {INTERVAL}", "contraction", "R-hat", "ESS bulk / tail",
    )  # fmt: skip
    return Table(header, rows, range(1, 6))


def _prior(info: ParameterInfo) -> str:
    """The prior in words, as parameters.json has it; in kelvin where the quantity is shown in degC."""
    words = info.prior.replace("standard_deviation", "sd").replace("_", " ")
    return f"{words}, in K" if info.offset else words


def _interval(info: ParameterInfo, median: float, low: float, high: float) -> str:
    return interval(median + info.offset, low + info.offset, high + info.offset)


def contraction(run: RunFiles, name: str) -> float | None:
    """1 - sd of posterior / sd of prior; None without a prior."""
    if run.posterior is None or "prior" not in run.posterior.children or name not in run.posterior["prior"]:
        return None
    prior, posterior = (draws(run.posterior, group, [name]).std() for group in ("prior", "posterior"))
    return 1.0 - float(posterior / prior) if prior > 0 else None


def at_edge(run: RunFiles) -> dict[str, str]:
    """Quantities whose posterior is pressed against an edge of the prior's 95%: "lower" or "upper".

    A noise level or discrepancy near zero is no finding: the lower edge of its prior is zero.
    """
    infos = run.sampled
    if not infos or run.posterior is None:
        return {}
    values = draws(run.posterior, "posterior", [i.name for i in infos]).reshape(-1, len(infos))
    edges = {}
    for info, column in zip(infos, values.T, strict=True):
        low, _, high = info.prior_quantiles
        if (column < low).mean() > EDGE and info.kind not in ("noise", "discrepancy"):
            edges[info.name] = "lower"
        elif (column > high).mean() > EDGE:
            edges[info.name] = "upper"
    return edges


def window_values(run: RunFiles) -> Table:
    """What the parameters that drift are in each training window, beside the common value."""
    if run.posterior is None or "windows" not in run.posterior.children:
        return Table((), [])
    values = run.posterior["windows"].to_dataset()
    labels = [str(label) for label in values["window"].values]
    rows = []
    for info in (i for i in run.parameters if i.name in values):
        common = draws(run.posterior, "posterior", [info.name])
        own = values[info.name].transpose("window", "chain", "draw").values
        cells = [_interval(info, *map(float, np.quantile(part, [0.5, 0.025, 0.975]))) for part in (common, *own)]
        rows.append([f"{info.name}, {info.unit}" if info.unit else info.name, *cells])
    header = ("parameter, unit", "common, median [95%]", *(f"in “{label}”" for label in labels))
    return Table(header, rows, range(1, 2 + len(labels)))
