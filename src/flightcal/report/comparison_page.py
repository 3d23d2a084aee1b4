"""The page of `flightcal compare`: the models of the residuals side by side."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ..run import write_text
from ..words import number, percent
from . import block
from .block import Block, Section
from .findings import Finding
from .page import compose
from .run_files import Record, read_content
from .tables import Cell, Table

WORDS = {
    "heat": "heat that the model does not know of, the default",
    "iid": "independent noise, as published",
    "ar1": "noise correlated from sample to sample",
    "phase": "discrepancy in orbit phase",
    "phase+ar1": "discrepancy in orbit phase, and correlated noise",
}

SCORES = {
    # title, digits, and whether more is better (None: neither)
    "rmse": ("RMSE, K", 3, False),
    "mape_kelvin": ("MAPE, % of kelvin", 3, False),
    "picp": ("PICP", 3, None),
    "mpiw": ("MPIW, K", 3, False),
    "crps": ("CRPS, K", 3, False),
    "log_score": ("log score, nat", 3, True),
}


def write_comparison(folder: Path) -> Path:
    """Writes comparison.html from the comparison.json in `folder`. Raises RunError where that is not there."""
    content = read_content(folder, "comparison")
    output = folder / "comparison.html"
    sections = [
        *([Section("backtest", "Rolling origins", _backtest(content))] if content.get("backtest") else []),
        Section("comparison", "Unseen windows", _scores(content)),
        Section("channels", "By window and channel", [block.table(_channels(content))]),
    ]
    if content.get("left_out"):
        sections.append(Section("windows", "Training windows left out", _left_out(content)))
    write_text(output, compose("flightcal compare", content["name"], folder, "", findings(content), sections))
    return output


def first_tables(content: Record) -> list[Table]:
    """Scores of the models: over rolling origins, where there are any, and over unseen windows."""
    return [*([_rolling(content)] if content["backtest"] else []), _means(content)]


def findings(content: Record) -> list[Finding]:
    """What is recommended, and which models are not to be used."""
    recommended = content["recommended"]
    share = None if recommended is None else content["means"][recommended]["picp"]
    right = share is not None and _covers(share, content["interval"])
    if rolling := content.get("backtest", {}).get(recommended):
        right = rolling["held"] == rolling["origins"]
    title = "No model is recommended"
    if recommended is not None:
        title = f"Recommended: {recommended}, {WORDS[recommended]}"
    found = [Finding("good" if right else "warn", title, content["reason"], tuple(_least_covered(content)))]
    failed = [model for model, passed in content["passed"].items() if not passed]
    if failed:
        gates = content.get("failed_gates", {})
        details = tuple(f"{model}: {', '.join(gates[model])}" for model in failed if gates.get(model))
        words = "See their own reports before using their scores."
        found.append(Finding("warn", f"Not converged: {', '.join(failed)}", words, details))
    if content["useless"]:
        title = f"Not to be used, by their own verdict: {', '.join(content['useless'])}"
        found.append(Finding("warn", title, "Their own pages say why."))
    return found


def _least_covered(content: Record) -> Iterator[str]:
    """Of each model, the channel of which least lies inside its interval."""
    for model in content["means"]:
        rows = [score for score in content["scores"] if score["model"] == model and score["channel"] != "all"]
        if worst := min(
            (row for row in rows if row["picp"] is not None), key=lambda record: record["picp"], default=None
        ):
            yield f"{model} covers least: {percent(worst['picp'])} of {worst['channel']} in “{worst['window']}”."


def _rolling(content: Record) -> Table:
    best = min(backtest["crps"] for backtest in content["backtest"].values())
    rows = [
        [
            f"{model}\n{WORDS[model]}", Cell(number(scores["crps"], 3), "good" if scores["crps"] == best else ""),
            f"{percent(scores['coverage'])} ± {percent(scores['coverage_error'])}",
            Cell(f"{scores['held']} of {scores['origins']}", "" if scores["held"] == scores["origins"] else "warn"),
            number(scores["rmse"], 3), number(scores["width"], 3), "yes" if scores["passed"] else "no",
        ]
        for model, scores in content["backtest"].items()
    ]  # fmt: skip
    header = ("model", "CRPS, K", "PICP", "origins after which it held", "RMSE, K", "MPIW, K", "converged")
    return Table(header, rows, range(1, len(header) - 1))


def _backtest(content: Record) -> list[Block]:
    return [
        block.table(_rolling(content)),
        block.text(
            "Each model is trained up to several origins all over the telemetry and predicts what follows. That is "
            "more telemetry than a few windows have, so models are ranked by it. Each has a report in its own folder."
        ),
    ]


def _means(content: Record) -> Table:
    best = {}
    for metric, (_, _, more) in SCORES.items():
        known = [value for means in content["means"].values() if (value := means[metric]) is not None]
        best[metric] = None if more is None or not known else max(known) if more else min(known)
    rows = []
    for model in content["models"]:
        cells = [f"{model}\n{WORDS[model]}"]
        for metric, value in ((metric, content["means"][model][metric]) for metric in SCORES):
            off = metric == "picp" and value is not None and not _covers(value, content["interval"])
            is_best = value is not None and value == best[metric]
            cells.append(Cell(_shown(metric, value), "bad" if off else "good" if is_best else ""))
        rows.append(cells)
    header = ("model", *(title for title, _, _ in SCORES.values()))
    return Table(header, rows, range(1, len(header)))


def _scores(content: Record) -> list[Block]:
    share = f"{100 * content['interval']:g}%"
    return [
        block.table(_means(content)),
        block.text(
            "Means over the windows that the calibration has not seen, of all channels together; the best of each "
            f"score is set off. PICP: share of telemetry inside the {share} interval, to be near {share}; MPIW: its "
            "mean width, which counts only where the interval covers; CRPS and log score judge the whole predicted "
            "distribution. The log score is the mean logarithm of the predicted density (per kelvin): larger is better."
        ),
    ]


def _channels(content: Record) -> Table:
    rows = [
        [row["window"], row["channel"], row["model"], *(_shown(metric, row[metric]) for metric in SCORES)]
        for row in sorted(content["scores"], key=lambda row: (row["window"], row["channel"]))
    ]
    header = ("window", "channel", "model", *(title for title, _, _ in SCORES.values()))
    return Table(header, rows, range(3, len(header)))


def _left_out(content: Record) -> list[Block]:
    rows = [
        [window, model, *(_shown(metric, scores[metric]) for metric in SCORES), "yes" if scores["passed"] else "no"]
        for model, windows in content["left_out"].items()
        for window, scores in windows.items()
    ]
    header = ("window", "model", *(title for title, _, _ in SCORES.values()), "converged")
    return [
        block.table(Table(header, sorted(rows), range(2, len(header) - 1))),
        block.text(
            "Each training window is predicted by a calibration on the others, as a window is that nobody has seen. "
            "So settings can be chosen by this table, and the unseen windows above remain unseen.",
        ),
    ]


def _covers(share: float, nominal: float) -> bool:
    """Whether an interval leaves out about as much as it should: a fifth of it to twice as much."""
    return 0.2 * (1.0 - nominal) <= 1.0 - share <= 2.0 * (1.0 - nominal)


def _shown(metric: str, value: float | None) -> str:
    if metric == "picp":
        return percent(value)
    return number(value, SCORES[metric][1])
