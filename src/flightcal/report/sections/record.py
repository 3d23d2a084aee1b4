"""Heaters, telemetry and where the run comes from."""

from __future__ import annotations

import json

from .. import block, tables
from ..block import Block
from ..run_files import RunFiles
from ..text import listed


def heaters(run: RunFiles) -> list[Block]:
    """Duty cycles, switches and energy."""
    with_heaters = {n: w for n, w in run.windows.items() if w.sizes.get("heater", 0)}
    if not with_heaters:
        return [block.note("There is no heater in this run's prediction.")]
    blocks = [
        block.table(tables.heaters(with_heaters)),
        block.text(
            "Telemetry has the status of a heater, not its power: its energy is its duty cycle at the power of the "
            "posterior's mean. Its duty cycle is that of its valid samples and its switches are those between them; "
            "simulations run through gaps."
        ),
    ]
    if run.metrics:
        blocks.append(Block("folded", "Errors and agreement of every method", table=tables.heater_scores(run.metrics)))
    attributes = {} if run.posterior is None else run.posterior.attrs
    counted = json.loads(attributes.get("status_likelihood", "{}"))
    if counted:
        forms = listed([f"{form} of {channel}" for channel, form in counted.items()])
        blocks.append(block.text(f"In the likelihood besides the temperatures: {forms}."))
    sequences = json.loads(attributes.get("switch_sequences", "[]"))
    if sequences:
        several = any(s["sequences"] > 1 for s in sequences)
        words = (
            "Draws of the posterior differ in the order in which the heaters switch; where they do, the likelihood "
            "has jumps."
            if several
            else "All draws of the posterior switch the heaters in the same order."
        )
        blocks += [block.text(words), block.table(tables.switch_sequences(sequences))]
    return blocks


def quality(run: RunFiles) -> list[Block]:
    """Findings in the telemetry."""
    if run.quality is None:
        return [block.note("There is no record of the telemetry's quality in this run (telemetry_quality.json).")]
    return [block.table(tables.quality(run.quality), "No findings: every sample of every channel was usable.")]


def provenance(run: RunFiles) -> list[Block]:
    """Versions, machine, seeds, times and the scenario."""
    blocks = [
        block.table(tables.provenance(run.provenance))
        if run.provenance is not None
        else block.note("There is no provenance in this run (provenance.json).")
    ]
    if run.scenario is None:
        return [*blocks, block.note("There is no scenario in this run (scenario.yaml).")]
    return [*blocks, Block("source", run.scenario)]
