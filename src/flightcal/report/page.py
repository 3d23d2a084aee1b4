"""The page: sections in order, figures as data, one template; written whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import plotly.graph_objects as go
from plotly.offline import get_plotlyjs
from plotly.utils import PlotlyJSONEncoder

from ..run import write_text
from .block import Section
from .findings import Finding
from .panels import panels
from .run_files import RunFiles, read_run
from .style import DARK
from .verdict import Verdict, verdict_of


def write_report(run: Path, output: Path | None = None) -> Path:
    """Writes a run directory as one self-contained HTML page, `report.html` in it unless `output` says otherwise.

    Reads only the run directory; what is not there is named on the page. Returns the page's path.
    Raises RunError where `run` is no run directory or a file in it is damaged.
    """
    files_of_run = read_run(Path(run))
    output = Path(output) if output is not None else Path(run) / "report.html"
    write_text(output, render(files_of_run))
    return output


def render(run: RunFiles) -> str:
    """The page of a run as text."""
    created = str((run.provenance or {}).get("created", ""))
    judged = verdict_of(run)
    return compose(
        "flightcal report", _scenario_name(run), run.folder, created, judged.beside, panels(run), judged=judged
    )


def compose(
    kind: str,
    name: str,
    folder: Path,
    created: str,
    findings: Sequence[Finding],
    content: Sequence[Section],
    *,
    judged: Verdict | None = None,
) -> str:
    """A page as text: what kind of page it is, the scenario's name, the run's folder and time, findings and sections.

    judged: the verdict on a calibration, which stands before everything else.
    """
    drawn = _Drawn()
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("flightcal.report"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    templates = files("flightcal.report") / "templates"
    return environment.get_template("report.html").render(
        kind=kind,
        name=name,
        folder=folder.resolve().name,
        created=created.replace("T", " ")[:19],
        findings=findings,
        verdict=judged,
        sections=content,
        figure_id=drawn.add,
        drawn=drawn,
        css=(templates / "report.css").read_text(encoding="utf-8"),
        script=(templates / "report.js").read_text(encoding="utf-8"),
        plotly=get_plotlyjs(),
        dark=_safe(json.dumps(DARK)),
    )


def _scenario_name(run: RunFiles) -> str:
    """The `name` of the scenario, from its text; the folder's name where there is none."""
    for line in (run.scenario or "").splitlines():
        if line.startswith("name:"):
            return line.removeprefix("name:").strip().strip("'\"")
    return run.folder.resolve().name


@dataclass
class _Drawn:
    """Figures as JSON for the page's script. Time axes are kept once: many traces share one."""

    figures: dict[str, str] = field(default_factory=dict)
    times: dict[bytes, int] = field(default_factory=dict)
    axes: list[dict[str, Any]] = field(default_factory=list)

    def add(self, figure: go.Figure) -> str:
        """Adds a figure and gives the identifier of its place on the page."""
        content = figure.to_plotly_json()
        for trace in content["data"]:
            if isinstance(trace.get("x"), np.ndarray) and trace["x"].dtype.kind == "M":
                trace["x"] = {"time": self._axis(trace["x"])}
        identifier = f"figure-{len(self.figures) + 1}"
        self.figures[identifier] = _safe(json.dumps(content, cls=PlotlyJSONEncoder, separators=(",", ":")))
        return identifier

    def _axis(self, time: np.ndarray) -> int:
        """Number of a time axis in the table: milliseconds since 1970 of its first time, and steps from there."""
        milliseconds = time.astype("datetime64[ms]").astype(np.int64)
        key = milliseconds.tobytes()
        if key not in self.times:
            self.times[key] = len(self.axes)
            first = int(milliseconds[0]) if milliseconds.size else 0
            self.axes.append({"first": first, "steps": np.diff(milliseconds, prepend=first).tolist()})
        return self.times[key]

    @property
    def times_json(self) -> str:
        """The table of time axes as JSON."""
        return _safe(json.dumps(self.axes, separators=(",", ":")))


def _safe(text: str) -> str:
    """JSON that can stand inside a script element, whatever names it holds."""
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
