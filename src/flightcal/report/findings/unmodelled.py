"""How large is the heat that no block of the scenario describes?"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from ...words import listed, percent
from ..panels.duty import duties
from ..panels.heat import IMPLAUSIBLE, LARGE, WANDERING, gains, node_heats, state
from ..panels.parameters import WIDER, shortened, widened
from ..run_files import ParameterInfo, RunFiles
from .finding import CHECK, Finding, duty_of, value_of


def heat(run: RunFiles) -> list[Finding]:
    """How large the heat is that no block of the scenario describes."""
    wandering = _wandering_heat(run)
    return [*_lasting_heat(run, of="Unmodelled heat of every orbit" if wandering else "Unmodelled heat"), *wandering]


def _lasting_heat(run: RunFiles, of: str) -> list[Finding]:
    """How large the heat is that comes again with the orbit, which is called `of` where it is small."""
    if run.heat is None:
        return []
    found = [(node_heat.node, node_heat.share, node_heat.allowed) for node_heat in node_heats(run)]
    if of_gains := gains(run):
        found.append(("gains (relative errors of modes and absorbed fluxes)", of_gains.quantiles[0], 1.0))
    if not found:
        return []
    found.sort(key=lambda item: -item[1] / item[2])
    wider, taken = widened(run), ""
    if wider:
        taken = f" It takes most from {shortened(wider)}: their intervals are more than {WIDER:g} times as wide."
    large = listed([f"{name} ({percent(share, 0)})" for name, share, allowed in found if state(share, allowed)])
    worst, share, allowed = found[0]
    if state(share, allowed) == "bad":
        limit = percent(IMPLAUSIBLE * allowed, 0)
        text = (
            f"For sure, as a share of the mean heat through the node: {large}. Above {limit} heat can hide a "
            f"wrong set-up: look at attitude, areas, time tags and units before the parameters are used.{taken}"
        )
        title = f"Unmodelled heat is implausibly large: {worst}, {percent(share, 0)} of what flows"
        return [Finding("bad", title, text, then=CHECK)]
    if state(share, allowed):
        text = (
            f"For sure, as a share of the mean heat through the node: {large}. Look for what the scenario lacks, "
            f"such as a load or a shadow.{taken}"
        )
        title = f"Unmodelled heat is large: {worst}, {percent(share, 0)} of what flows"
        nodes = [name for name, share, allowed in found if state(share, allowed)]
        return [Finding("warn", title, text, not_for=_doubted_by_heat(run, nodes), then=_find(worst))]
    largest, share, _ = max(found, key=lambda item: item[1])
    text = f"The telemetry proves no more than {percent(share)} of the mean heat through any node ({largest})."
    if likely := max(node_heats(run), key=lambda node_heat: node_heat.most, default=None):
        text += f" Expected are up to {percent(likely.most)} ({likely.node}), which may as well be parameters."
    text += taken
    title = f"{of} is small" if share <= LARGE else f"{of} is no larger than the scenario expects"
    return [Finding("good", title, text)]


def _wandering_heat(run: RunFiles) -> list[Finding]:
    """Whether much heat comes and goes otherwise than with the orbit: a caution, and nothing else."""
    sizes = {node_heat.node: node_heat.wandering for node_heat in node_heats(run) if node_heat.wandering > WANDERING}
    if not sizes:
        return []
    named = listed([f"{name} ({percent(share, 0)})" for name, share in sizes.items()])
    worst = max(sizes, key=lambda name: sizes[name])
    text = (
        f"Standard deviation of the slow part, as a share of the mean heat through the node: {named}. Look for what "
        "the scenario lacks and the orbit does not repeat, such as a mode's power or a pass of the transmitter. "
        "Nothing foresees such heat: on unseen orbits intervals are wide."
    )
    title = f"Much of the unmodelled heat comes and goes: {worst}, {percent(sizes[worst], 0)} of what flows"
    return [Finding("warn", title, text, not_for=_doubted_by_heat(run, sizes), then=_find(worst))]


def _find(node: str) -> str:
    """What to do next where a node has much heat that nobody describes."""
    return f"Find what heats or cools {node} and the scenario lacks: a mode's power, a load, a pass, a shadow."


def _doubted_by_heat(run: RunFiles, nodes: Collection[str]) -> tuple[str, ...]:
    """What a run is not to be used for where much heat of these nodes is unmodelled: first what acts on them.

    A heater there whose status is not measured may be on for longer or shorter, and the heat make up for it.
    """
    simulator = run.written.get("simulator") or {}
    heaters = simulator.get("heaters")
    there = (
        [name for name, heater in heaters.items() if heater.get("node") in nodes]
        if isinstance(heaters, Mapping)
        else []
    )
    acting = [info.name for info in run.parameters if _acts_on(info, nodes, simulator)]
    doubted = sorted(widened(run), key=lambda name: name not in acting)
    return (*unmeasured(run, there), *(tuple(map(value_of, doubted)) or ("values of parameters",)))


def _acts_on(info: ParameterInfo, nodes: Collection[str], simulator: Mapping[str, Any]) -> bool:
    """Whether a parameter is a number of one of these nodes, or of a link, mode, heater, load or face that has one."""
    touched: set[str] = set()
    for path in info.target:
        block, *names = path.split(".")
        touched |= {part for name in names for part in (name, *name.split("-"))}
        blocks = simulator.get(block)
        item = blocks.get(names[0]) if isinstance(blocks, Mapping) and names else None
        touched |= {str(item.get("node"))} if isinstance(item, Mapping) else set()
    return not touched.isdisjoint(nodes)


def unmeasured(run: RunFiles, heaters: Collection[str]) -> list[str]:
    """The duty cycles of those of these heaters whose status is not measured."""
    found = [duty.heater for duty in duties(run) if duty.heater in heaters and not np.isfinite(duty.measured)]
    return list(map(duty_of, dict.fromkeys(found)))
