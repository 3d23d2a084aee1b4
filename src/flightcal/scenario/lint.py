"""A scenario file as a scenario, or all that is wrong with it, at once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..errors import ScenarioError
from .blocks import read_block
from .checks import CHECKS
from .document import Document, Issue, Location, read_document
from .fields import AnyBlock
from .meshed import MESHED, source
from .reading import Reading, read_scenario
from .schema import Scenario
from .units import show

_UNNAMED = ("telemetry", "simulator")
"""Blocks that locations leave out before their sections, as the paths of parameters do."""
_SECTIONS = (
    *("channels", "nodes", "conductors", "faces", "heaters", "modes", "timeline", "loads", "inputs", "outputs"),
    *MESHED,
)


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong, or doubtful: where, what was found and what was expected."""

    file: str
    line: int | None
    """From 1; null: of the file as a whole."""
    location: str
    """Dotted path such as ``channels.battery_temp.unit``; "": of the file as a whole."""
    message: str
    warning: bool = False
    """It could be meant: the scenario can be used as it is."""

    def __str__(self) -> str:
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        return ": ".join(part for part in (place, "warning" * self.warning, self.location, self.message) if part)


def lint(path: str | Path, *, telemetry: str | Path | None = None) -> list[Finding]:
    """Everything wrong with the scenario file at `path`, by line, or else warnings; an empty list if there is nothing.

    telemetry: replaces where telemetry is read from: a file, or a folder with files of the same names.
    """
    return examine(path, telemetry)[1]


def load_scenario(path: str | Path, *, telemetry: str | Path | None = None) -> Scenario:
    """The scenario in the file at `path`; its `folder` is the file's.

    telemetry: replaces where telemetry is read from: a file, or a folder with files of the same names.
    Raises ScenarioError, whose message lists everything wrong with the file, a line each.
    """
    scenario, findings = examine(path, telemetry)
    if scenario is None:
        raise ScenarioError("\n".join(str(finding) for finding in findings if not finding.warning))
    return scenario


def examine(path: str | Path, telemetry: str | Path | None = None) -> tuple[Scenario | None, list[Finding]]:
    """The scenario, if nothing is wrong with it, and the findings, warnings among them."""
    file = Path(path)
    reading = read_scenario(file, None if telemetry is None else Path(telemetry))
    problems = list(reading.problems)
    if isinstance(reading.document.data, dict):
        problems += [problem for check in CHECKS for problem in check(reading, file.parent)]
    wrong = any(not problem.warning for problem in problems)
    # What is doubtful waits until nothing is wrong.
    told = [problem for problem in problems if not (wrong and problem.warning)]
    findings = list(dict.fromkeys(_finding(problem, reading, str(path)) for problem in told))
    findings.sort(key=lambda finding: finding.line or 0)
    return (None if wrong else reading.scenario), findings


def read_file(path: Path, kind: type[AnyBlock]) -> tuple[AnyBlock, Document]:
    """The YAML file at `path`, whose whole content is a block, and where in it things stand.

    Raises ScenarioError, whose message lists what is wrong with the file, a line each.
    """
    document = read_document(path)
    problems = list(document.problems)
    content: AnyBlock | None = None
    if isinstance(document.data, dict):
        content = read_block(kind, document.data, (), problems)
    elif not problems:
        problems.append(Issue((), f"found {show(document.data)}, expected a mapping (key: value)"))
    if content is None or problems:
        raise file_error(path, document, problems)
    return content, document


def file_error(path: Path, document: Document, problems: list[Issue]) -> ScenarioError:
    """What is wrong with a file, a line each."""
    findings = (
        Finding(str(path), p.line or document.line(p.location), ".".join(map(str, p.location)), p.message)
        for p in problems
    )
    return ScenarioError("\n".join(map(str, findings)))


def _finding(problem: Issue, reading: Reading, file: str) -> Finding:
    location, lines = problem.location, reading.document.lines
    if len(location) > 2 and location[:3] not in lines:
        # A cell is written as its plate or box.
        location = source(str(location[2])) or location
    line = problem.line or reading.document.line(location)
    return Finding(file, line, _dotted(location, reading), problem.message, problem.warning)


def _dotted(location: Location, reading: Reading) -> str:
    parts = list(location)
    if len(parts) > 1 and parts[0] in _UNNAMED and parts[1] in _SECTIONS:
        del parts[0]
    if len(parts) > 1 and parts[0] == "conductors" and isinstance(parts[1], int):
        conductors = reading.blocks.conductors
        conductor = conductors[parts[1]] if parts[1] < len(conductors) else None
        parts[1] = conductor.label if conductor else parts[1]
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts).lstrip(".")
