"""docs/benchmarks.md: the machine, the versions and the tables."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

PACKAGES = ("flightcal", "numba", "jax", "diffrax", "numpyro", "nutpie", "emcee", "scipy", "numpy")


class DataMissingError(Exception):
    """A table cannot be measured here, and why; what the document says of it stays."""


@dataclass(frozen=True)
class Table:
    """Cells are text; the first column names the row."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""

    def markdown(self) -> str:
        """A Markdown table."""
        lines = [self.columns, ["---"] + ["---:"] * (len(self.columns) - 1), *self.rows]
        text = "\n".join("| " + " | ".join(line) + " |" for line in lines)
        return f"{self.caption}\n\n{text}" if self.caption else text


@dataclass(frozen=True)
class Section:
    """One question, its tables, and what a reader must know to judge them."""

    title: str
    question: str
    tables: Sequence[Table]
    notes: Sequence[str] = ()

    def markdown(self) -> str:
        """The section as it stands in the document."""
        parts = [f"## {self.title}", self.question, *(table.markdown() for table in self.tables)]
        if self.notes:
            parts.append("\n".join(f"- {note}" for note in self.notes))
        return "\n\n".join(parts)


def machine() -> Table:
    """Processor, memory, system and compiler; nothing that names the host."""
    rows = [
        ["processor", f"{_processor()}, {len(os.sched_getaffinity(0))} cores usable"],
        ["memory", f"{os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 2**30:.0f} GiB"],
        ["system", f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"],
        ["C compiler", _compiler()],
        ["load before the run", f"{os.getloadavg()[0]:.1f} processes (1 min)"],
    ]
    for package in PACKAGES:
        try:
            rows.append([package, metadata.version(package)])
        except metadata.PackageNotFoundError:
            rows.append([package, "not installed"])
    return Table(["machine and versions", ""], rows)


def _processor() -> str:
    try:
        found = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(encoding="utf-8"), re.MULTILINE)
    except OSError:
        found = None
    return found.group(1).strip() if found else platform.machine()


def _compiler() -> str:
    from .peers.c_program import compiler_version

    return compiler_version() or "none found: the C program is left out"


def write(path: Path, sections: Sequence[Section], before: Table) -> None:
    """Write the document; sections of it that were not measured now stay as they are."""
    introduction = (
        "# Benchmarks\n\n"
        "Written by `make bench` (`python -m benchmarks`; `--only` measures some of the sections anew). "
        "All numbers of a section are measured in one run. What is compared takes turns (A B C A B C ...); "
        "given are medians and, in brackets, quartiles over the rounds; a ratio is formed round by round. "
        "Everything is compiled, and its result checked, before it is timed."
    )
    stamp = f"Measured {datetime.now(UTC):%Y-%m-%d %H:%M} UTC."
    texts = _sections(path) | {section.title: f"{section.markdown()}\n\n{stamp}" for section in sections}
    path.write_text("\n\n".join([introduction, before.markdown(), *texts.values()]) + "\n", encoding="utf-8")


def _sections(path: Path) -> dict[str, str]:
    """Title and text of each section of a document, if it is there."""
    if not path.exists():
        return {}
    found = re.split(r"^## ", path.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    return {text.splitlines()[0].strip(): f"## {text.strip()}" for text in found}
