"""The page: sections in order, figures as data, one template; written whole or not at all."""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import jinja2
import numpy as np
import plotly.graph_objects as go
from markupsafe import Markup
from numpy.typing import NDArray
from plotly.offline import get_plotlyjs
from plotly.utils import PlotlyJSONEncoder

from ..run import write_text
from ..words import moment, without_paths
from .block import Part, Section
from .findings import Finding
from .masking import REMARK, masked
from .panels import first_screen, parts
from .run_files import RunFiles, read_run
from .style import DARK, TEMPLATE
from .verdict import Verdict, verdict_of

FINE: Final = 3
"""Digits to which figures have their numbers, of what they span."""
LARGEST: Final = 2_450_000
"""Characters of a page, which nearly all are bytes."""
STRETCHES: Final = (1_500, 500)
"""Stretches of long series in the figures of a page, of all plots together: fewer where it would be too large."""
HARMLESS: Final = str.maketrans("<>&", ",.:")
"""Characters of base 85 that mean something in HTML, and those that stand for them."""


def write_report(run: Path, output: Path | None = None, *, mask: bool = False) -> Path:
    """Writes a run directory as one self-contained HTML page, `report.html` in it unless `output` says otherwise.

    mask: with neutral names and without absolute temperatures, to be passed on; `masked.html` in the run.
    Reads only the run directory; what is not there is named on the page. Returns the page's path.
    Raises RunError where `run` is no run directory or a file in it is damaged.
    """
    files_of_run = read_run(Path(run))
    if mask:
        files_of_run = masked(files_of_run)
    output = Path(output) if output is not None else Path(run) / ("masked.html" if mask else "report.html")
    beside = output.absolute().parent == Path(run).absolute()
    for stretches in STRETCHES:
        text = render(replace(files_of_run, stretches=stretches), beside=beside, remark=REMARK if mask else "")
        if len(text) <= LARGEST:
            break
    write_text(output, text)
    return output


def render(run: RunFiles, *, beside: bool = True, remark: str = "") -> str:
    """The page of a run as text; beside: it will lie in the run's folder, so that it can link to its files.

    remark: what a reader has to know before all else.
    """
    created = str((run.provenance or {}).get("created", ""))
    judged = verdict_of(run)
    return compose(
        "flightcal report", _scenario_name(run), run.folder, created, judged.beside, first_screen(run),
        judged=judged, folded=parts(run), beside=beside, remark=remark,
        paths=list((run.provenance or {}).get("inputs") or {}),
    )  # fmt: skip


def compose(
    kind: str,
    name: str,
    folder: Path,
    created: str,
    findings: Sequence[Finding],
    content: Sequence[Section],
    *,
    judged: Verdict | None = None,
    folded: Sequence[Part] = (),
    beside: bool = True,
    paths: Sequence[str] = (),
    remark: str = "",
) -> str:
    """A page as text: what kind of page it is, the scenario's name, the run's folder and time, findings and sections.

    judged: the verdict on a calibration, which stands before everything else; its findings, and `findings` beside
    them, begin the first of the parts. folded: what stands under the sections. beside: its files lie where the
    page does. paths: files that are told by their names alone.
    """
    drawn = _Drawn()
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("flightcal.report"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        finalize=partial(_told, paths=[*paths, str(folder.resolve()), str(Path.home())]),
    )
    templates = files("flightcal.report") / "templates"
    return environment.get_template("report.html").render(
        kind=kind,
        name=name,
        folder=folder.resolve().name,
        created=created and moment(created),
        findings=findings,
        verdict=judged,
        sections=content,
        parts=folded,
        beside=beside,
        remark=remark,
        figure_id=drawn.add,
        drawn=drawn,
        css=(templates / "report.css").read_text(encoding="utf-8"),
        script=(templates / "report.js").read_text(encoding="utf-8"),
        plotly=Markup(_plotly()),
    )


def _told(value: object, paths: Sequence[str]) -> object:
    """A value of the template: text names no place on the machine that made the page."""
    return without_paths(value, paths) if isinstance(value, str) and not isinstance(value, Markup) else value


def _scenario_name(run: RunFiles) -> str:
    """The `name` of the scenario; the folder's name where there is none."""
    return str(run.written.get("name") or run.folder.resolve().name)


@dataclass
class _Drawn:
    """Figures as JSON for the page's script. Each array is kept once: many traces share times and telemetry."""

    figures: dict[str, Any] = field(default_factory=dict)
    arrays: list[dict[str, Any]] = field(default_factory=list)
    known: dict[tuple[str, bytes], int] = field(default_factory=dict)

    def add(self, figure: go.Figure) -> str:
        """Adds a figure and gives the identifier of its place on the page."""
        content = figure.to_plotly_json()
        content["data"] = [self._trace(trace) for trace in content["data"]]
        content["layout"].pop("template", None)
        identifier = f"figure-{len(self.figures) + 1}"
        self.figures[identifier] = content
        return identifier

    def _trace(self, trace: dict[str, Any]) -> dict[str, Any]:
        """A trace with numbers in the place of its arrays."""
        found: dict[str, Any] = {}
        for key, value in trace.items():
            if isinstance(value, np.ndarray) and value.dtype.kind == "M":
                found[key] = {"array": self._kept(value)}
            elif isinstance(value, dict) and "bdata" in value:
                # So plotly has numbers already: bytes in base 64, which hardly pack.
                array = np.frombuffer(base64.b64decode(value["bdata"]), value["dtype"])
                columns = array.reshape(-1, int(str(value.get("shape", "1")).rpartition(",")[2])).T
                numbers = [self._kept(column) for column in columns]
                if "shape" in value:
                    found[key] = {"columns": numbers}
                else:
                    found[key] = {"array": numbers[0]}
            else:
                found[key] = value
        return found

    def _kept(self, array: NDArray[Any]) -> int:
        """Number of an array in the table."""
        key = array.dtype.str, array.tobytes()
        if key not in self.known:
            self.known[key] = len(self.arrays)
            self.arrays.append(times(array) if array.dtype.kind == "M" else steps(array))
        return self.known[key]

    @property
    def packed(self) -> str:
        """Figures, the template that they share, arrays and dark colours, packed."""
        content = {
            "figures": self.figures,
            "template": TEMPLATE.to_plotly_json(),
            "arrays": self.arrays,
            "dark": DARK,
        }
        return pack(json.dumps(content, cls=PlotlyJSONEncoder, separators=(",", ":")))


def times(values: NDArray[Any]) -> dict[str, Any]:
    """Times: milliseconds since 1970 of the first, and steps from there in a unit that they have in common."""
    milliseconds = values.astype("datetime64[ms]").astype(np.int64)
    first = int(milliseconds[0]) if milliseconds.size else 0
    found = np.diff(milliseconds, prepend=first)
    unit = int(np.gcd.reduce(found)) or 1
    return {"first": first, "unit": unit, "steps": (found // unit).tolist()}


def steps(values: NDArray[Any]) -> dict[str, Any]:
    """Numbers as whole steps from one to the next, null where there is none: few digits, which pack well.

    A step is a power of ten, and at most 1/1000 of their range, which is finer than any screen.
    """
    known = np.isfinite(values)
    present = np.asarray(values, float)[known]
    size = float(np.abs(present).max(initial=0.0)) or 1.0
    reach = float(np.ptp(present)) if present.size else 0.0
    # No more digits than a number of the script has.
    digits = min(FINE - math.floor(math.log10(reach or 1e-3 * size)), 14 - math.floor(math.log10(size)))
    whole = np.rint(present * 10.0**digits).astype(np.int64)
    taken = iter(np.diff(whole, prepend=0).tolist())
    return {"digits": digits, "steps": [next(taken) if here else None for here in known]}


@cache
def _plotly() -> str:
    """The library that draws the figures, packed."""
    return pack(get_plotlyjs())


def pack(text: str) -> str:
    """Text for the page's script to unpack: compressed, four bytes in five characters that HTML leaves as they are."""
    return base64.b85encode(zlib.compress(text.encode(), 9)).decode("ascii").translate(HARMLESS)
