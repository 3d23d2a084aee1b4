"""Heat that no block of the scenario describes: its pattern over the orbit, its sizes, and which are too large."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go

from ...words import number, percent
from .. import block
from ..block import Block, section
from ..run_files import Record, RunFiles, draws
from ..style import BAND, LINE, STOCHASTIC, band, finish, plots, polygons, small_titles, title_below
from ..tables import Cell, Table
from ..thinning import Array

LARGE, IMPLAUSIBLE = 0.1, 0.3
"""Shares of the flow through a node above which its heat wants caution, and above which it is hardly believed."""

USUAL = 0.05
"""The prior scale of both parts for which these hold: where the scenario writes more, so much more is believed."""

WANDERING = 0.03
"""The same of its slow part: up to 1.3% in satellites that are right, up to 6% where heat drifts."""

MOST_NODES = 12
"""Nodes that the figure shows; the table has all of them."""

PHASE = "orbit phase, orbits"
ROW_HEIGHT = 170

WORDS = {
    "": "–",
    "warn": f"caution: above {LARGE:.0%}, or twice what the scenario expects",
    "bad": "implausibly large: heat can hide a wrong set-up",
}


@dataclass(frozen=True)
class Size:
    """Prior deviation of a part of the heat, as the posterior has it: W, of gains a share."""

    quantiles: tuple[float, float, float]
    """At 2.5, 50 and 97.5 percent."""
    prior: float
    """Scale of its half-normal prior."""


@dataclass(frozen=True)
class NodeHeat:
    """What a node takes up beside what the scenario describes; a part that was not modelled is None."""

    node: str
    flow: float
    """W, mean absolute heat through it at the prior's median."""
    constant: Size | None
    pattern: Size | None
    """Of what varies; None without harmonics."""
    slow: Size | None
    places: Array
    """[P] orbits; over a driver its values, in its SI unit."""
    expected: Array
    """[P] W, of constant and pattern together."""
    band: tuple[Array, Array]
    """[P] W, 95% of it."""

    @property
    def share(self) -> float:
        """Of the flow: what telemetry shows for sure, the pattern's distance from zero beyond its 95% interval.

        A mean of absolute values over the orbit, as the flow is one. What could as well be parameters is not counted.
        """
        low, high = self.band
        return float(np.maximum(0.0, np.maximum(low, -high)).mean()) / self.flow

    @property
    def allowed(self) -> float:
        """How many times as much heat as usual the scenario expects, at least 1."""
        priors = [part.prior for part in (self.constant, self.pattern) if part is not None]
        return max([1.0, *(prior / (USUAL * self.flow) for prior in priors)])

    @property
    def wandering(self) -> float:
        """Of the flow: the slow part's size, where it is for sure beyond its prior's; else 0."""
        if self.slow is None or self.slow.quantiles[0] < self.slow.prior:
            return 0.0
        return self.slow.quantiles[1] / self.flow

    @property
    def most(self) -> float:
        """Of the flow: mean absolute value of the expected pattern."""
        return float(np.abs(self.expected).mean()) / self.flow

    @property
    def peak(self) -> float:
        """W, largest absolute value of the expected pattern."""
        return float(np.abs(self.expected).max())


@section("heat", "Heat that the simulator lacks")
def panel(run: RunFiles) -> list[Block]:
    """Pattern over the orbit, sizes, and what both mean."""
    if run.heat is None:
        return []
    nodes, over = node_heats(run), str(run.heat.get("over") or "")
    shown = sorted(sorted(nodes, key=lambda node_heat: -node_heat.most)[:MOST_NODES], key=nodes.index)
    rest = f" The {len(shown)} nodes with the largest shares; the table has all." if len(shown) < len(nodes) else ""
    is_constant = not over and all(node_heat.pattern is None for node_heat in nodes)
    carries = (
        f"The pattern is a function of {f'the driver {over}' if over else 'the orbit phase'}. Where that is the same, "
        "so is the heat, and it carries over to every window."
    )
    if is_constant:
        carries = "It has no pattern: beside what drifts it is a constant, which carries over to every window."
    patterns = block.figure(
        figure_pattern(shown, over or PHASE),
        f"Expected pattern of unmodelled heat over {over or 'the orbit'}, its constant included. Left axis: W. "
        f"Right axis: share of the mean heat that flows through the node. Band: its 95% interval.{rest}",
        wide=True,
    )
    return [
        block.text(
            "Each node takes up heat that no block of the scenario describes. It is calibrated with the parameters. "
            f"{carries} The slow part belongs to the time it was "
            "learnt from, and fades. Gains are relative errors of modes, loads and absorbed fluxes; "
            "they carry over too. Predictions contain all of this: it is injected into the simulator, so that "
            "thermostats answer to it."
        ),
        *([] if is_constant else [patterns]),
        block.table(sizes(nodes, gains(run))),
        block.text(
            "Size: standard deviation, posterior median [95%]; beneath, its share of the flow and its prior's scale. "
            "Flow: mean absolute heat through the node at the prior's median. Heat that is for sure, beyond its 95% "
            f"interval, above {LARGE:.0%} of the flow wants a reason, such as a load or a shadow that the scenario "
            f"lacks. Above {IMPLAUSIBLE:.0%} look for a wrong set-up first: attitude, areas, time tags, units. Heat "
            "can make up for these in the fit, but not in another season or attitude. Where the scenario expects more "
            f"than {USUAL:.0%} ('heat: pattern: scale'), these limits are higher by as many times. A slow part above "
            f"{WANDERING:.0%} that is for sure larger than its prior's scale wants a reason too, such as a mode or a "
            "load that comes and goes."
        ),
    ]


def node_heats(run: RunFiles) -> list[NodeHeat]:
    """Heat of each node, in the scenario's order; none without unmodelled heat."""
    model = run.heat
    if model is None:
        return []
    assert run.posterior is not None
    of_draws = run.posterior["heat"]["pattern"].transpose("node", "heat_draw", "place")
    places = np.asarray(of_draws["place"].values, float)
    found = []
    for k, (node, flow, pattern) in enumerate(zip(model["nodes"], model["flow"], of_draws.values, strict=True)):
        sizes = {group["part"]: _size(run, group) for group in model["groups"] if group["node"] == k}
        low, high = np.quantile(pattern, [0.025, 0.975], axis=0)
        found.append(
            NodeHeat(
                node, float(flow), sizes.get("constant"), sizes.get("pattern"), sizes.get("slow"), places,
                pattern.mean(axis=0), (low, high),
            )
        )  # fmt: skip
    return found


def largest_heat(run: RunFiles) -> dict[str, float]:
    """The largest heat that is expected in each node, as a share of what flows through it; the largest share first."""
    shares = {node_heat.node: node_heat.peak / node_heat.flow for node_heat in node_heats(run)}
    return dict(sorted(shares.items(), key=lambda share: -share[1]))


def gains(run: RunFiles) -> Size | None:
    """Size of the relative errors of modes, loads and absorbed fluxes; None without any."""
    of_gains = next((group for group in (run.heat or {"groups": []})["groups"] if group["part"] == "gains"), None)
    return None if of_gains is None else _size(run, of_gains)


def _size(run: RunFiles, group: Record) -> Size | None:
    name = group["scale"]
    if run.posterior is None or name not in run.posterior["posterior"]:
        return None
    low, median, high = np.quantile(draws(run.posterior, "posterior", [name]), [0.025, 0.5, 0.975]).tolist()
    return Size((low, median, high), float(group["size"]))


def state(share: float, allowed: float = 1.0) -> str:
    """State of a share of the flow: nothing, warn or bad. allowed: see `NodeHeat`."""
    return "bad" if share > IMPLAUSIBLE * allowed else "warn" if share > LARGE * allowed else ""


def sizes(nodes: Sequence[NodeHeat], of_gains: Size | None) -> Table:
    """Sizes of heat by node, in W and as a share of the flow, and a mark where they are large."""
    rows: list[list[str]] = []
    for node_heat in nodes:
        largest = f"{number(node_heat.peak, 3)}\n{percent(node_heat.peak / node_heat.flow)} of the flow"
        mark = state(node_heat.share, node_heat.allowed)
        rows.append(
            [node_heat.node, number(node_heat.flow, 3), _cell(node_heat.constant, node_heat.flow),
             _cell(node_heat.pattern, node_heat.flow), Cell(largest, mark),
             Cell(_cell(node_heat.slow, node_heat.flow), "warn" if node_heat.wandering > WANDERING else ""),
             Cell(WORDS[mark], mark)]
        )  # fmt: skip
    if of_gains is not None:
        low, median, high = of_gains.quantiles
        text = f"{percent(median)} [{percent(low)}, {percent(high)}]\nprior {percent(of_gains.prior)}"
        mark = state(low)
        rows.append(["gains of all nodes", "–", "–", Cell(text, mark), "–", "–", Cell(WORDS[mark], mark)])
    header = (
        "node", "flow through it, W", "constant, size, W", "pattern or gain, size, W",
        "largest of the expected pattern, W", "slow part, size, W", "in words",
    )  # fmt: skip
    return Table(header, rows, range(1, 6))


def _cell(size: Size | None, flow: float) -> str:
    if size is None:
        return "–"
    low, median, high = size.quantiles
    watts = f"{number(median, 3)} [{number(low, 3)}, {number(high, 3)}]"
    return f"{watts}\n{percent(median / flow)} of the flow; prior {number(size.prior, 3)}"


def figure_pattern(nodes: Sequence[NodeHeat], over: str = PHASE) -> go.Figure:
    """Expected pattern with its band, two nodes in a row: W, and as a share of the flow. over: what it is over."""
    columns = min(2, len(nodes))
    rows = -(-len(nodes) // columns)
    specs = [[{"secondary_y": True}] * columns for _ in range(rows)]
    figure, height = plots(
        [node_heat.node.replace("_", " ") for node_heat in nodes],
        columns,
        ROW_HEIGHT,
        horizontal_spacing=0.18,
        specs=specs,
    )
    for k, node_heat in enumerate(nodes):
        place = {"row": k // columns + 1, "col": k % columns + 1}
        limits = [*node_heat.band, node_heat.expected, np.zeros(1)]
        low, high = min(values.min() for values in limits), max(values.max() for values in limits)
        pad = 0.06 * max(high - low, 1e-6 * node_heat.flow)
        ends = np.array([low - pad, high + pad])
        figure.add_hline(y=0.0, line={"color": LINE, "width": 1}, secondary_y=False, **place)
        x, y = polygons(node_heat.places, *node_heat.band)
        band(figure, x.astype(np.float32), y.astype(np.float32), "95% interval", "band", BAND, **place)
        figure.add_scatter(
            x=node_heat.places.astype(np.float32), y=node_heat.expected.astype(np.float32),
            name="expected pattern", mode="lines", legendgroup="pattern", showlegend=k == 0,
            line={"color": STOCHASTIC, "width": 1.8},
            customdata=(100 * node_heat.expected / node_heat.flow).astype(np.float32),
            hovertemplate="%{x:.3g}: %{y:.3g} W, %{customdata:.2g}% of the flow<extra></extra>", **place,
        )  # fmt: skip
        # Plotly draws an axis only where it has a trace.
        figure.add_scatter(
            x=[0.0], y=[0.0], showlegend=False, hoverinfo="skip", opacity=0.0, mode="markers", secondary_y=True, **place
        )
        figure.update_yaxes(title_text="heat, W", range=ends.tolist(), nticks=5, secondary_y=False, **place)
        figure.update_yaxes(
            title_text=f"% of {number(node_heat.flow, 3)} W", range=(100 * ends / node_heat.flow).tolist(), nticks=5,
            tickmode="auto", showgrid=False, secondary_y=True, **place,
        )  # fmt: skip
    finish(figure, height)
    figure.update_layout(margin={"r": 72})
    small_titles(figure)
    figure.update_xaxes(range=[float(nodes[0].places[0]), float(nodes[0].places[-1])], nticks=6)
    title_below(figure, over, len(nodes), columns)
    return figure
