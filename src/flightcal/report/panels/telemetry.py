"""What was found in the telemetry."""

from __future__ import annotations

from ...words import count, moment, percent
from .. import block
from ..block import Block, section
from ..run_files import Record, RunFiles
from ..tables import Table


@section("telemetry", "Telemetry quality")
def panel(run: RunFiles) -> list[Block]:
    """Findings in the telemetry."""
    if run.quality is None:
        return [block.note("There is no record of the telemetry's quality in this run (telemetry_quality.json).")]
    return [block.table(findings(run.quality), "No findings: every sample of every channel was usable.")]


def findings(records: list[Record]) -> Table:
    """Findings about the telemetry."""
    rows = [
        [r["channel"] or "(rows of the file)", str(r["finding"]).replace("_", " "), count(r["samples"]),
         percent(r["share"], 2), moment(r.get("first")), moment(r.get("last")), str(r.get("detail") or "")]
        for r in records
    ]  # fmt: skip
    header = ("channel", "finding", "samples", "share", "first, UTC", "last, UTC", "detail")
    return Table(header, rows, (2, 3))
