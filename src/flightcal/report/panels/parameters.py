"""Prior, posterior and what was learnt of each quantity, in a table."""

from __future__ import annotations

import numpy as np

from ...words import count, interval, listed, number, percent, unit
from .. import block
from ..block import Block, section
from ..run_files import ParameterInfo, RunFiles, draws
from ..tables import Cell, Table

EDGE = 0.2
"""Share of the posterior in the prior's outer 5% above which it is called pressed against the prior's edge."""

WIDER = 1.5
"""Times as wide an interval has to be with unmodelled heat for the parameter to be named."""

MOST_NAMED = 5

INTERVAL = "median [95%]"

MOST_TARGETS = 2
"""Places that a parameter sets or scales that the table names; the scenario on the page has them all."""


@section("parameters", "Parameters in full")
def panel(run: RunFiles) -> list[Block]:
    """Prior, posterior and what was learnt, in a table."""
    if not run.parameters:
        return [block.note("There is no list of parameters in this run (priors.json).")]
    blocks = [block.table(summary(run))]
    if run.posterior is None:
        blocks.insert(0, block.note("There is no posterior in this run (posterior.nc): priors only."))
    blocks.append(
        block.text(
            "Contraction is 1 − sd of the posterior / sd of the prior: 0% says that the telemetry taught nothing "
            "about the quantity. ESS: effective sample size. Absolute temperatures are in °C, all else in SI units."
        )
    )
    if words := taken_by_heat(run):
        blocks.append(block.text(words))
    if run.fixed_numbers is not None and run.fixed_numbers.footings:
        words = (
            "These values depend on numbers that the scenario has as fixed: the telemetry tells the two together. "
            f"Before telemetry each of these is taken to be off by {percent(run.fixed_numbers.within, 0)}. The columns "
            "say by how much it may still be off, and how a number that is larger by that moves the value."
        )
        blocks += [block.heading("What they rest on"), block.text(words), block.table(footing(run))]
    of_windows = window_values(run)
    if of_windows.rows:
        words = (
            "These parameters may differ between the training windows. “Common” is the centre around which they do, "
            "with a trend in the middle of all windows. On a window that was not trained on a trend goes on, and a "
            "value that drifts is drawn anew with the deviation drift.<parameter>."
        )
        blocks += [block.heading("Values by window"), block.text(words), block.table(of_windows)]
    return blocks


def summary(run: RunFiles) -> Table:
    """Prior against posterior of every uncertain quantity, with its diagnostics."""
    diagnosed = {p["name"]: p for p in (run.diagnostics or {}).get("parameters", [])}
    sampled = {info.name for info in run.sampled}
    gates = (run.diagnostics or {}).get("gates", [])
    # Above 1.01 chains that agree may be by chance; the gate knows how far.
    disagree = any(gate["name"] == "R-hat" and not gate["passed"] for gate in gates)
    edges, wider, held = at_edge(run), times_as_wide(run), held_shapes(run)
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
            cells += [held.get(info.name, "–"), "–"]
        if wider:
            cells.append(number(wider.get(info.name), 2))
        of = diagnosed.get(info.name, {})
        r_hat = of.get("r_hat")
        effective = f"{count(of.get('ess_bulk'))} / {count(of.get('ess_tail'))}"
        colour = "bad" if disagree and (r_hat or 0) > 1.01 else ""
        cells += [Cell("–" if r_hat is None else f"{r_hat:.3f}", colour), effective]
        if info.name in edges:
            cells[2] = Cell(f"{cells[2]}\n⚠ at the prior's {edges[info.name]} edge", "warn")
        rows.append(cells)
    with_heat = ("with heat, times as wide",) if wider else ()
    header = (
        "quantity, unit", f"prior, {INTERVAL}", f"posterior, {INTERVAL}", "contraction", *with_heat, "R-hat",
        "ESS bulk / tail",
    )  # fmt: skip
    return Table(header, rows, range(1, len(header)))


def times_as_wide(run: RunFiles) -> dict[str, float]:
    """Posterior deviation of each parameter over that without unmodelled heat; empty where the run does not say."""
    if run.heat is None or run.posterior is None or "deviation_without_heat" not in run.posterior["heat"]:
        return {}
    without = run.posterior["heat"].to_dataset()["deviation_without_heat"]
    alone = dict(zip(map(str, without["parameter"].values), without.values.tolist(), strict=True))
    sampled = [info.name for info in run.sampled if alone.get(info.name, 0.0) > 0]
    return {name: float(draws(run.posterior, "posterior", [name]).std()) / alone[name] for name in sampled}


def taken_by_heat(run: RunFiles) -> str:
    """Which parameters unmodelled heat takes most from, in words; nothing where the run does not say."""
    wider = times_as_wide(run)
    if not wider:
        return ""
    named = [f"{name} ({number(wider[name], 2)})" for name in widened(run)]
    most = (
        f"Heat takes most from {shortened(named)}: part of the effect of each could as well be heat."
        if named
        else f"Heat widens no parameter's interval by more than a factor of {WIDER:g}."
    )
    return f"“With heat, times as wide”: the posterior's sd over its sd without unmodelled heat. {most}"


def widened(run: RunFiles) -> list[str]:
    """Parameters, without noise and initial temperatures, that heat widens by more than WIDER, the most first."""
    wider = times_as_wide(run)
    names = [info.name for info in run.parameters if info.kind == "parameter" and wider.get(info.name, 0.0) > WIDER]
    return sorted(names, key=lambda name: -wider[name])


def shortened(items: list[str]) -> str:
    """The first of a list, and how many more there are."""
    more = len(items) - MOST_NAMED
    return listed(items if more <= 1 else [*items[:MOST_NAMED], f"{more} more"])


def held_shapes(run: RunFiles) -> dict[str, str]:
    """Numbers of the noise that a calibration with heat holds at their most probable value, by name, in words."""
    if run.heat is None or run.posterior is None:
        return {}
    posterior = run.posterior["posterior"].to_dataset()
    channels = [info.name.removeprefix("noise.") for info in run.parameters if info.kind == "noise"]
    channels = [name for name in channels if f"noise.{name}" in posterior]
    if len(channels) != len(run.heat["shapes"]):
        return {}
    found = {}
    for channel, shape in zip(channels, run.heat["shapes"], strict=True):
        if shape["time"] > 0:
            found[f"noise.{channel}.correlation_time"] = f"held at {number(shape['time'], 3)}"
            found[f"noise.{channel}.white"] = f"held at {number(shape['white_share'], 3)} times\nnoise.{channel}"
    return found


def _prior(info: ParameterInfo) -> str:
    """The prior in words, as priors.json has it; in kelvin where the quantity is shown in degC."""
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

    A noise level, discrepancy or heat near zero is no finding: the lower edge of its prior is zero.
    """
    infos = run.sampled
    if not infos or run.posterior is None:
        return {}
    values = draws(run.posterior, "posterior", [i.name for i in infos]).reshape(-1, len(infos))
    edges = {}
    for info, column in zip(infos, values.T, strict=True):
        low, _, high = info.prior_quantiles
        if (column < low).mean() > EDGE and info.kind not in ("noise", "discrepancy", "heat"):
            edges[info.name] = "lower"
        elif (column > high).mean() > EDGE:
            edges[info.name] = "upper"
    return edges


def footing(run: RunFiles) -> Table:
    """Fixed numbers that values depend on."""
    units = {quantity.name: unit(quantity.unit) for quantity in run.calibrated}
    footings = () if run.fixed_numbers is None else run.fixed_numbers.footings
    rows = [
        [
            candidate.name,
            candidate.number,
            percent(candidate.off),
            f"{candidate.change:+.2g} {units[candidate.name]}".strip().replace("-", "−"),
        ]
        for candidate in footings
    ]
    return Table(("parameter", "fixed number", "off by", "moves it by"), rows, (2, 3))


def window_values(run: RunFiles) -> Table:
    """What the parameters that are not the same in all training windows are in each, beside the common value."""
    if run.posterior is None or "windows" not in run.posterior.children:
        return Table((), [])
    values = run.posterior["windows"].to_dataset()
    labels = [str(label) for label in values["window"].values]
    rows = []
    for info in (i for i in run.parameters if i.name in values):
        common = draws(run.posterior, "posterior", [info.name])
        by_window = values[info.name].transpose("window", "chain", "draw").values
        cells = [_interval(info, *map(float, np.quantile(part, [0.5, 0.025, 0.975]))) for part in (common, *by_window)]
        symbol = f", {unit(info.unit)}" if unit(info.unit) else ""
        rows.append([f"{info.name}{symbol}", *cells])
    header = ("parameter, unit", "common, median [95%]", *(f"in “{label}”" for label in labels))
    return Table(header, rows, range(1, 2 + len(labels)))
