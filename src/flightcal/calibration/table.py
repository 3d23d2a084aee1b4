"""Every uncertain quantity before and after a calibration."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import Any, Final

import numpy as np

from ..probability import Priors
from ..problem import Entry, Problem
from ..scenario import WrittenUnit, written_unit
from ..simulator import FloatArray

EACH = "SI"
"""In the place of a unit: each quantity has its own."""
INTERVAL: Final = 0.95
_LEVELS: Final = (0.5 - INTERVAL / 2, 0.5, 0.5 + INTERVAL / 2)
_FAR: Final = 30.0
_PRIOR_POINTS: Final = 4000
"""Quantiles of a prior over which its variance is taken."""


@dataclass(frozen=True)
class Calibrated:
    """An uncertain quantity before and after the calibration, in the unit in which the scenario writes it."""

    name: str
    kind: str
    """parameter, drift, noise, discrepancy, heat, timing, error_rate, time or initial"""
    unit: str
    before: float
    """Median of the prior."""
    before_lower: float
    before_upper: float
    """Ends of the prior's 95%."""
    mean: float
    median: float
    deviation: float
    lower: float
    upper: float
    """Ends of the 95% interval."""
    from_data: float
    """How much of it is the data's word and not the prior's, 0 to 1: 1 - variance of the posterior / of the prior.

    Both are of the prior's normal scores (logarithms of a half-normal prior, logits of a beta one): a wide lognormal
    prior whose posterior lies far out has learnt much, though it may be as wide in the unit.
    """
    considered_lower: float | None = None
    considered_upper: float | None = None
    """Ends of the 95% interval if the scenario's fixed numbers are off; None: not known. See `considered`."""

    @property
    def is_parameter(self) -> bool:
        """Whether it is a parameter, or its deviation in a window."""
        return self.kind in ("parameter", "drift")

    @property
    def considered(self) -> tuple[float, float] | None:
        """That interval."""
        if self.considered_lower is None or self.considered_upper is None:
            return None
        return self.considered_lower, self.considered_upper

    @property
    def times_as_wide(self) -> float:
        """That interval, over the one where fixed numbers are exact."""
        if self.considered is None or not self.upper > self.lower:
            return 1.0
        lower, upper = self.considered
        return (upper - lower) / (self.upper - self.lower)

    def rescaled(self, of: Callable[[float], float], factor: float, unit: str) -> Calibrated:
        """The same in another unit: `of` each value, and its deviation times a factor."""
        values = ("before", "before_lower", "before_upper", "mean", "median", "lower", "upper")
        moved: dict[str, Any] = {name: of(getattr(self, name)) for name in values}
        for name in ("considered_lower", "considered_upper"):
            value = getattr(self, name)
            moved[name] = None if value is None else of(value)
        return replace(self, unit=unit, deviation=self.deviation * factor, **moved)

    def __repr__(self) -> str:
        return f"<{self.name}: {_in_brackets(self.mean, self.lower, self.upper)} {self.unit}".rstrip() + ">"


def calibrated(
    problem: Problem,
    thetas: FloatArray,
    units: Mapping[str, WrittenUnit] | None = None,
    considered: FloatArray | None = None,
) -> tuple[Calibrated, ...]:
    """Every entry of theta before and after; thetas [S, d] are its posterior draws.

    units: of the parameters that are not shown in SI; absolute temperatures are in degC in any case. considered: draws
    [S, d] if the scenario's fixed numbers are off.
    """
    priors, units = problem.priors, {**_default_units(problem.entries), **(units or {})}
    before = priors.quantile(np.array(_LEVELS)[:, None])
    shares = (np.arange(_PRIOR_POINTS) + 0.5) / _PRIOR_POINTS
    wide = scores(priors, priors.quantile(shares[:, None])).var(axis=0)
    after = np.quantile(thetas, _LEVELS, axis=0)
    means, variances = thetas.mean(axis=0), thetas.var(axis=0, ddof=1)
    told = np.clip(1.0 - scores(priors, thetas).var(axis=0, ddof=1) / wide, 0.0, 1.0)
    wider = None if considered is None else np.quantile(considered, (_LEVELS[0], _LEVELS[-1]), axis=0)
    rows = []
    for k, entry in enumerate(problem.entries):
        unit = units[entry.name]
        # The two are made of the same draws; where nothing is added, they are the same but for chance.
        ends = (None, None) if wider is None else (min(wider[0, k], after[0, k]), max(wider[1, k], after[-1, k]))
        considered_lower, considered_upper = (None if end is None else unit.of(float(end)) for end in ends)
        lower, median, upper = (unit.of(value) for value in after[:, k].tolist())
        before_lower, middle, before_upper = (unit.of(value) for value in before[:, k].tolist())
        rows.append(
            Calibrated(
                name=entry.name,
                kind=entry.kind,
                unit=unit.name,
                before=middle,
                before_lower=before_lower,
                before_upper=before_upper,
                mean=unit.of(float(means[k])),
                median=median,
                deviation=float(np.sqrt(variances[k])) / unit.factor,
                lower=lower,
                upper=upper,
                from_data=float(told[k]),
                considered_lower=considered_lower,
                considered_upper=considered_upper,
            )
        )
    return tuple(rows)


def scores(priors: Priors, thetas: FloatArray) -> FloatArray:
    """Draws [S, d] in the unconstrained numbers of their priors; a draw at a bound is far out, not endless."""
    return np.clip(priors.to_z(thetas), -_FAR, _FAR)


def _default_units(entries: Sequence[Entry]) -> dict[str, WrittenUnit]:
    """The unit of each entry where no scenario's text says another: SI, and degC for absolute temperatures."""
    return {entry.name: written_unit("degC" if entry.is_temperature else entry.unit, entry.unit) for entry in entries}


def correlation(thetas: FloatArray) -> FloatArray:
    """Correlation [d, d] of posterior draws thetas [S, d]; NaN for what does not vary."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.atleast_2d(np.corrcoef(thetas, rowvar=False))


def html_table(rows: Iterable[Calibrated]) -> str:
    """The table as HTML, for notebooks: before, after, after if fixed numbers are off, how much is the data's word."""
    shown = list(rows)
    of_fixed = ["if fixed numbers are off [95%]"] if any(quantity.considered is not None for quantity in shown) else []
    headings, body = ["quantity", "unit", "before [95%]", "after [95%]", *of_fixed, "from data"], []
    for quantity in shown:
        before = _in_brackets(quantity.before, quantity.before_lower, quantity.before_upper)
        after = _in_brackets(quantity.mean, quantity.lower, quantity.upper)
        wider = (
            "" if quantity.considered is None else _in_brackets(quantity.mean, *quantity.considered).partition(" ")[2]
        )
        body.append(
            [quantity.name, quantity.unit, before, after, *([wider] if of_fixed else []), f"{quantity.from_data:.1%}"]
        )
    lines = ["".join(f"<td>{escape(text)}</td>" for text in cells) for cells in body]
    head = "".join(f"<th>{text}</th>" for text in headings)
    return f"<table><tr>{head}</tr>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


def _in_brackets(middle: float, lower: float, upper: float) -> str:
    return f"{middle:.4g} [{lower:.4g}, {upper:.4g}]"
