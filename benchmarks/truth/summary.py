"""The records of satellites as a table."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ..report import Table
from .variants import VARIANTS

Record = Mapping[str, Any]

UPDATED = 0.5
"""Deviation of z, 1 for the prior's, below which a parameter counts as one that the telemetry told something of."""
_TOLD_APART = 0.9
"""Cosine below which heat does not imitate a parameter."""


def summary(records: Sequence[Record]) -> str:
    """Markdown: one column a variant; means with standard errors between satellites."""
    by_variant: dict[str, list[Record]] = {}
    for record in records:
        by_variant.setdefault(record["variant"], []).append(record)
    if not by_variant:
        return "no records"
    rows = [[name, *(cell(scores) for scores in by_variant.values())] for name, cell in _ROWS]
    rows += _relative(by_variant)
    return Table(["", *by_variant], rows).markdown()


def mean_of(records: Sequence[Record], values: Callable[[Record], Iterable[float]]) -> tuple[float, float, int]:
    """Mean over all values of all satellites, its standard error (satellites are independent), and their number.

    The error is that of a ratio of sums: a satellite's values depend on each other.
    """
    parts = [np.array(list(values(record)), float) for record in records]
    sums, counts = np.array([part.sum() for part in parts]), np.array([len(part) for part in parts])
    if not counts.sum():
        return np.nan, np.nan, 0
    mean = sums.sum() / counts.sum()
    error = np.sqrt(((sums - mean * counts) ** 2).sum()) / counts.sum()
    return float(mean), float(error), int(counts.sum())


def _share(values: Callable[[Record], Iterable[float]]) -> Callable[[Sequence[Record]], str]:
    def cell(records: Sequence[Record]) -> str:
        mean, error, count = mean_of(records, values)
        return f"{100 * mean:.1f} ± {100 * error:.1f}% of {count}" if count else "-"

    return cell


def _mean(values: Callable[[Record], Iterable[float]], form: str = ".2f") -> Callable[[Sequence[Record]], str]:
    def cell(records: Sequence[Record]) -> str:
        mean, error, count = mean_of(records, values)
        return f"{mean:{form}} ± {error:{form}}" if count else "-"

    return cell


def _median(values: Callable[[Record], Iterable[float]], form: str = ".2f") -> Callable[[Sequence[Record]], str]:
    def cell(records: Sequence[Record]) -> str:
        found = [value for record in records for value in values(record)]
        return f"{np.median(found):{form}}" if found else "-"

    return cell


def _inside(kind: str | None = None, updated: bool = False) -> Callable[[Record], Iterable[float]]:
    def values(record: Record) -> Iterable[float]:
        if kind in (None, record["kind"]):
            yield from (p["inside"] for p in record["parameters"] if not updated or p["deviation"] < UPDATED)

    return values


def _gained(record: Record) -> Iterable[float]:
    return (p["score"] - p["prior_score"] for p in record["parameters"])


def _holds(record: Record) -> Iterable[float]:
    return [all(p["inside"] for p in record["parameters"])]


def _of(items: str, name: str) -> Callable[[Record], Iterable[float]]:
    return lambda record: (item[name] for item in record[items])


_ROWS: list[tuple[str, Callable[[Sequence[Record]], str]]] = [
    ("satellites", lambda records: str(len(records))),
    ("true parameters inside 95%", _share(_inside())),
    *((f"... heat missing: {kind}", _share(_inside(kind))) for kind in ("constant", "square wave", "slow drift")),
    (f"... deviation below {UPDATED} of the prior's", _share(_inside(updated=True))),
    ("satellites with all parameters inside", _share(_holds)),
    ("log score of a true parameter, mean", _mean(_of("parameters", "score"))),
    ("... median", _median(_of("parameters", "score"))),
    ("... of the prior, mean", _mean(_of("parameters", "prior_score"))),
    ("... posterior less prior, mean", _mean(_gained)),
    ("parameters whose posterior scores better than the prior", _share(lambda r: (x > 0 for x in _gained(r)))),
    ("joint log score less the prior's, mean", _mean(lambda r: [r["joint_score"] - r["joint_prior_score"]])),
    ("... median", _median(lambda r: [r["joint_score"] - r["joint_prior_score"]])),
    ("satellites whose joint score is better than the prior's",
     _share(lambda r: [r["joint_score"] > r["joint_prior_score"]])),
    ("deviation of z (prior: 1), median", _median(_of("parameters", "deviation"), ".3f")),
    ("parameters that heat does not imitate (cosine below 0.9)",
     _share(lambda r: (p["cosine"] < _TOLD_APART for p in r["parameters"]))),
    ("test windows: samples inside 95%", _share(_of("predicted", "coverage"))),
    ("... channels and windows below 80%", _share(lambda r: (p["coverage"] < 0.8 for p in r["predicted"]))),
    ("... RMSE, K", _mean(_of("predicted", "rmse"))),
    ("... CRPS, K", _mean(_of("predicted", "crps"), ".3f")),
    ("... width, K", _mean(_of("predicted", "width"))),
    ("true duty inside 95%", _share(_of("duty", "inside"))),
    ("... width, points", _mean(lambda r: (100 * (d["upper"] - d["lower"]) for d in r["duty"]), ".1f")),
    ("calibrations with a failed gate", _share(lambda r: [bool(r["failed_gates"])])),
    ("calibration, s (median)", _median(lambda r: [r["seconds"]["calibration"]], ".0f")),
]  # fmt: skip


def _relative(by_variant: Mapping[str, Sequence[Record]]) -> list[list[str]]:
    """Each variant against the first that lacks as much heat, satellite by satellite."""
    rows: dict[str, list[str]] = {
        "width of parameters' posteriors, times the first's, median": [],
        "... greatest of those that heat does not imitate": [],
        "width of predictions, times the first's, median": [],
        "log score of a true parameter, less the first's, mean": [],
    }
    for variant, scores in by_variant.items():
        missing = VARIANTS[variant].missing
        first = next(other for name, other in by_variant.items() if VARIANTS[name].missing == missing)
        known = {(record["seed"], record["satellite"]): record for record in first}
        pairs = [(record, known[key]) for record in scores if (key := (record["seed"], record["satellite"])) in known]
        if first is scores or not pairs:
            for cells in rows.values():
                cells.append("-")
            continue
        both = [(a, b) for x, y in pairs for a, b in zip(x["parameters"], y["parameters"], strict=True)]
        apart = [a["deviation"] / b["deviation"] for a, b in both if a["cosine"] < _TOLD_APART]
        wider = [a["width"] / b["width"] for x, y in pairs for a, b in zip(x["predicted"], y["predicted"], strict=True)]
        cells = [
            f"{np.median([a['deviation'] / b['deviation'] for a, b in both]):.2f}",
            f"{max(apart):.2f} of {len(apart)}" if apart else "-",
            f"{np.median(wider):.2f}",
            f"{np.mean([a['score'] - b['score'] for a, b in both]):.2f}",
        ]
        for row, cell in zip(rows.values(), cells, strict=True):
            row.append(cell)
    return [[name, *cells] for name, cells in rows.items()] if len(by_variant) > 1 else []
