"""Where the run comes from: versions, machine, seeds, times and the scenario."""

from __future__ import annotations

from ...words import duration, moment
from .. import block
from ..block import Block, section
from ..run_files import Record, RunFiles
from ..tables import Table


@section("provenance", "Provenance")
def panel(run: RunFiles) -> list[Block]:
    """Versions, machine, seeds, times and the scenario."""
    blocks = [
        block.table(origins(run.provenance, run.integration))
        if run.provenance is not None
        else block.note("There is no provenance in this run (provenance.json).")
    ]
    if run.scenario is None:
        return [*blocks, block.note("There is no scenario in this run (scenario.yaml).")]
    return [*blocks, Block("source", run.scenario)]


def origins(record: Record, integration: list[Record]) -> Table:
    """Versions, inputs, seed, steps of the integration, wall times, machine."""
    packages = [f"{n} {v}" for n, v in (record.get("packages") or {}).items() if n != "flightcal"]
    stages = record.get("stages") or {}
    rows = [
        ["created, UTC", moment(record.get("created"))],
        ["flightcal", str(record.get("flightcal", "–"))],
        ["Python", str(record.get("python", "–"))],
        ["packages", ", ".join(packages) or "–"],
        ["seed", str(record.get("seed", "–"))],
        *([f"integration, {of['window']}", steps(of)] for of in integration),
        *([f"wall time, {name}", duration(float(s))] for name, s in stages.items()),
        *([["wall time, all", duration(sum(float(s) for s in stages.values()))]] if stages else []),
        ["machine", ", ".join(f"{k}: {v}" for k, v in (record.get("machine") or {}).items()) or "–"],
        *([f"SHA-256 of {name}", digest] for name, digest in (record.get("inputs") or {}).items()),
    ]
    return Table(("", ""), rows)


def steps(record: Record) -> str:
    """How many steps a window's integration has, and their error."""
    return (
        f"{record['steps']} steps; error {1e3 * record['error']:.2g} mK (root mean square, worst channel), "
        f"at most {1e3 * record['largest']:.2g} mK, at draws of the prior"
    )
