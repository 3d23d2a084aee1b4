"""Whether the chains can be believed: rank-normalised R-hat, effective sample sizes, divergences, E-BFMI.

The measures are ArviZ's (Vehtari et al. 2021, Bayesian Analysis 16, 667-718; Betancourt 2016, arXiv:1604.00695).
Here they become gates that can fail, with a verdict for an engineer who does not know them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from ..scenario import NutsSettings
from ..simulator import FloatArray
from .nuts import MAXIMUM_DEPTH

MINIMUM_E_BFMI = 0.3
"""Below it a chain's energy changes too little from draw to draw (Betancourt 2016; Stan warns at the same value)."""

LARGEST_SATURATED_SHARE = 0.01
"""Of draws whose trajectory was cut at the greatest depth; more than that and the sampler is a random walk."""

LARGEST_DIVERGENT_SHARE = 0.02
"""Of draws whose trajectory broke off; fewer, scattered over the posterior, bias nothing that can be seen."""

_OUTER = 0.05
"""Share of the draws at each end of a quantity: where divergences crowd, chains do not reach further out."""
_FEWEST_DIVERGENT = 8
"""With fewer nothing can be said of where they lie."""
_TAIL = (0.05, 0.95)
_CHANCE = 0.01
"""That chains which agree fail for their R-hat."""
BROKEN_OFF = "divergences"
"""The gate that judges how many trajectories broke off, and where."""
LINEAR = "response to heat"
"""The gate that judges how heat was taken into account, not the chains."""
EMULATOR_ERROR, HELD_OUT, EMULATED_DENSITY = (
    "Emulator's error", "Emulator against simulator", "Posterior against simulator"
)  # fmt: skip
OF_EMULATOR = frozenset({EMULATOR_ERROR, HELD_OUT, EMULATED_DENSITY})
"""The gates that judge the emulator: where one fails, chains that agree, or not, say nothing of the simulator."""
_FEWEST_DRAWS = 4
"""With fewer a chain, R-hat and effective sample sizes are not defined."""


class PriorScore(NamedTuple):
    """Where a posterior lies in its prior; see `ParameterSummary`."""

    prior_score: float = math.nan
    usual_score: float = math.nan


@dataclass(frozen=True)
class ParameterSummary:
    """One uncertain quantity's posterior, in its own unit, and how well it was sampled (NaN: cannot be said)."""

    name: str
    mean: float
    sd: float
    q2_5: float
    median: float
    q97_5: float
    r_hat: float
    ess_bulk: float
    ess_tail: float
    mcse_mean: float
    prior_score: float = math.nan
    """Normal score of the posterior's median in its prior: 0 at the prior's median, 1.96 at its 97.5%."""
    usual_score: float = math.nan
    """Its deviation where the prior is right, from how much narrower than the prior the posterior is."""


@dataclass(frozen=True)
class Gate:
    """One condition on the chains."""

    name: str
    passed: bool
    found: str
    required: str
    advice: str
    """What to do; empty when passed."""


@dataclass(frozen=True)
class Diagnostics:
    """The chains' measures, the gates, and what they come to."""

    parameters: tuple[ParameterSummary, ...]
    gates: tuple[Gate, ...]
    passed: bool
    """All gates passed."""
    verdict: str

    @property
    def converged(self) -> bool:
        """Whether all gates passed that judge the chains."""
        return all(gate.passed or gate.name == LINEAR for gate in self.gates)


def diagnose(
    posterior: Mapping[str, FloatArray],
    statistics: Mapping[str, NDArray[Any]],
    settings: NutsSettings,
    prior_scores: Mapping[str, PriorScore] | None = None,
) -> Diagnostics:
    """Judge chains by `settings.max_r_hat`, `settings.min_ess` and the sampler's own statistics.

    posterior: values [chain, draw] by name. statistics: diverging, depth and energy, [chain, draw] each.
    prior_scores: see `ParameterSummary`.
    """
    scores = prior_scores or {}
    parameters = tuple(
        replace(_summary(name, values), **scores.get(name, PriorScore())._asdict())
        for name, values in posterior.items()
    )
    chains, draws = statistics["energy"].shape
    gates = (
        _r_hat_gate(parameters, posterior, settings),
        _ess_gate(parameters, settings, draws, tail=False),
        _ess_gate(parameters, settings, draws, tail=True),
        _divergence_gate(posterior, statistics["diverging"], settings),
        _depth_gate(statistics["depth"]),
        _energy_gate(statistics["energy"]),
    )
    passed = all(gate.passed for gate in gates)
    return Diagnostics(parameters, gates, passed, _verdict(gates, passed, chains, draws))


def with_gate(diagnostics: Diagnostics, gate: Gate) -> Diagnostics:
    """The diagnostics with one more condition, which the calibration fails where it is not met."""
    verdict = diagnostics.verdict
    if not gate.passed:
        verdict = f"{verdict} {gate.name}: {gate.found}. {gate.advice}"
    passed = diagnostics.passed and gate.passed
    return replace(diagnostics, gates=(*diagnostics.gates, gate), passed=passed, verdict=verdict.strip())


def fewest_effective(parameters: Sequence[ParameterSummary]) -> float:
    """Effective draws of the quantity with the fewest, of the middle or of the tails; NaN where one's are unknown."""
    return float(np.min([[summary.ess_bulk, summary.ess_tail] for summary in parameters]))


def draws_wanted(draws: int, effective: float, settings: NutsSettings) -> float:
    """Of a chain, where so many have so few effective ones: in proportion, and a fifth more."""
    return 1.2 * draws * settings.min_ess / effective


def least_effective(draws: FloatArray) -> float:
    """Least bulk effective sample size over the last axis of draws [chain, draw, d]."""
    from arviz_stats.base import array_stats

    return float(min(array_stats.ess(draws[..., k], method="bulk") for k in range(draws.shape[-1])))


def _summary(name: str, values: FloatArray) -> ParameterSummary:
    """Posterior moments, quantiles and sampling measures of one quantity [chain, draw]."""
    # Imported here: arviz-stats needs a second to load.
    from arviz_stats.base import array_stats

    if values.shape[1] < _FEWEST_DRAWS:
        return ParameterSummary(name, *[math.nan] * 9)
    low, median, high = np.quantile(values, (0.025, 0.5, 0.975))
    varies = bool(np.isfinite(values).all() and np.ptp(values) > 0.0)
    return ParameterSummary(
        name=name,
        mean=float(values.mean()),
        sd=float(values.std(ddof=1)),
        q2_5=float(low),
        median=float(median),
        q97_5=float(high),
        r_hat=float(array_stats.rhat(values, method="rank")) if varies else math.nan,
        ess_bulk=float(array_stats.ess(values, method="bulk")) if varies else math.nan,
        ess_tail=float(array_stats.ess(values, method="tail", prob=_TAIL)) if varies else math.nan,
        mcse_mean=float(array_stats.mcse(values, method="mean")) if varies else math.nan,
    )


def gate(name: str, passed: bool, found: str, required: str, advice: str) -> Gate:
    """A gate, which gives advice only where it is not passed."""
    return Gate(name, passed, found, required, "" if passed else advice)


def _r_hat_gate(
    parameters: tuple[ParameterSummary, ...], posterior: Mapping[str, FloatArray], settings: NutsSettings
) -> Gate:
    limits = {p.name: settings.max_r_hat for p in parameters}
    for name in (p.name for p in parameters if p.r_hat >= settings.max_r_hat):
        limits[name] = max(settings.max_r_hat, _r_hat_by_chance(posterior[name], len(parameters)))
    # What cannot be computed is worse than any number.
    worst = max(parameters, key=lambda p: math.inf if math.isnan(p.r_hat) else p.r_hat - limits[p.name])
    advice = (
        f"'{worst.name}' never changed or is not a number: no chain moved, or it does not act on the simulation."
        if math.isnan(worst.r_hat)
        else f"The chains do not agree on '{worst.name}'. Give them a longer warm-up (nuts: warmup); if they still "
        "disagree, the data allow more than one explanation: compare the chains, and narrow a prior or add data."
    )
    limit = limits[worst.name]
    required = f"below {settings.max_r_hat:g}"
    if limit > settings.max_r_hat:
        required = f"below {limit:.3f}, which chains that agree reach by chance, for their draws are correlated"
    return gate("R-hat", worst.r_hat < limit, f"{_number(worst.r_hat, '.3f')} ({worst.name})", required, advice)


def _r_hat_by_chance(values: FloatArray, quantities: int) -> float:
    """R-hat that draws [chain, draw] of one of so many quantities exceed by chance, once in 100 posteriors.

    Of m half-chains that agree, whose means scatter by the effective draws that each chain has by itself. With 500 of
    these in all, R-hat is above 1.01 more often than not.
    """
    from arviz_stats.base import array_stats

    halves = 2 * len(values)
    bulk = sum(float(array_stats.ess(value[None], method="bulk")) for value in values)
    tail = sum(float(array_stats.ess(value[None], method="tail", prob=_TAIL)) for value in values)
    # Of the values, and folded around their median.
    scatter = chdtri(halves - 1, _CHANCE / (2 * quantities)) / (halves - 1)
    return math.sqrt(1.0 + halves / min(bulk, tail) * scatter)


def _ess_gate(parameters: tuple[ParameterSummary, ...], settings: NutsSettings, draws: int, *, tail: bool) -> Gate:
    sizes = {p.name: p.ess_tail if tail else p.ess_bulk for p in parameters}
    worst = min(sizes, key=lambda name: -math.inf if math.isnan(sizes[name]) else sizes[name])
    size = sizes[worst]
    advice = (
        f"There are too few independent draws of '{worst}' for {'the ends of its interval' if tail else 'its mean'}."
    )
    # A chain that is stuck has hardly any independent draws, and more of them are as stuck.
    if size > 0.1 * settings.min_ess:
        needed = math.ceil(draws_wanted(draws, size, settings) / 100.0) * 100
        advice += f" Ask for about {needed} draws a chain (nuts: draws)."
    else:
        advice += " More draws alone will not mend it: heed the other findings first."
    name = "effective draws, tails" if tail else "effective draws"
    found = f"{_number(size, '.0f')} ({worst})"
    return gate(name, size > settings.min_ess, found, f"above {settings.min_ess:g}", advice)


def _divergence_gate(posterior: Mapping[str, FloatArray], diverging: FloatArray, settings: NutsSettings) -> Gate:
    """How many trajectories broke off, and where.

    A few in thousands, scattered, also come of a right model. Crowded at one end of a quantity they say that the
    posterior goes on where the chains do not follow. Beyond the lower end of a size of heat there is nothing: without
    heat the parameters are known better, and a chain that does not get there leaves intervals too wide.
    """
    count, share = int(diverging.sum()), float(diverging.mean()) if diverging.size else math.nan
    ends = []
    if count >= _FEWEST_DIVERGENT:
        ends = [(name, end, outer) for name, values in posterior.items() for end, outer in _outer_draws(values)]
    of_heat = [near for near in ends if near[0].startswith("heat.") and near[1] == "lower"]
    broken = diverging.astype(bool)
    excused, where = _crowd(broken, of_heat)
    crowded, elsewhere = _crowd(broken & ~excused, ends)
    words = elsewhere or where or ("scattered" if count else "")
    found = f"{count} of {diverging.size} draws" + (f", {words}" if words else "")
    advice = (
        "Some trajectories broke off, so part of the posterior may be missing: where simulations fail, or where "
        "a heater only just touches its threshold. Raise the acceptance (nuts: target_acceptance, now "
        f"{settings.target_acceptance:g}) towards 0.99, or narrow the priors to where the model works."
    )
    required = f"at most {100.0 * LARGEST_DIVERGENT_SHARE:g}%, scattered"
    return gate(BROKEN_OFF, share <= LARGEST_DIVERGENT_SHARE and not crowded.any(), found, required, advice)


def _crowd(
    diverging: NDArray[np.bool_], ends: Sequence[tuple[str, str, NDArray[np.bool_]]]
) -> tuple[NDArray[np.bool_], str]:
    """Which of the draws that broke off lie at the end of a quantity where most do, and this in words; none, and ""."""
    if diverging.sum() < _FEWEST_DIVERGENT:
        return np.zeros(diverging.shape, bool), ""
    shares = [float(outer[diverging].mean()) for _, _, outer in ends]
    if max(shares, default=0.0) <= 0.5:
        return np.zeros(diverging.shape, bool), ""
    name, end, outer = ends[int(np.argmax(shares))]
    return diverging & outer, f"{100.0 * max(shares):.0f}% of them at the {end} end of {name}"


def _outer_draws(values: FloatArray) -> tuple[tuple[str, NDArray[np.bool_]], ...]:
    """Which draws lie at the lower, and which at the upper end of a quantity."""
    low, high = np.quantile(values, (_OUTER, 1.0 - _OUTER))
    return ("lower", values < low), ("upper", values > high)


def _depth_gate(depth: FloatArray) -> Gate:
    share = float((depth >= MAXIMUM_DEPTH).mean()) if depth.size else math.nan
    found = f"{_number(100.0 * share, '.1f')}% cut at depth {MAXIMUM_DEPTH}"
    advice = (
        "The sampler takes very small steps through a very long posterior: some parameters can hardly be told "
        "apart by these data. Fix one of them, or give it a narrower prior."
    )
    required = f"at most {100.0 * LARGEST_SATURATED_SHARE:g}%"
    return gate("trajectory length", share <= LARGEST_SATURATED_SHARE, found, required, advice)


def _energy_gate(energy: FloatArray) -> Gate:
    from arviz_stats.base import array_stats

    enough = energy.shape[1] >= _FEWEST_DRAWS
    worst = float(np.min(array_stats.bfmi(energy))) if enough else math.nan
    advice = (
        "The chains move too slowly between likely and unlikely parts of the posterior, whose tails are heavy: "
        "give the widest priors, those of noise levels first, an upper end."
    )
    return gate("E-BFMI", worst > MINIMUM_E_BFMI, _number(worst, ".2f"), f"above {MINIMUM_E_BFMI:g}", advice)


def _number(value: float, form: str) -> str:
    return "undefined" if math.isnan(value) else format(value, form)


def _verdict(gates: tuple[Gate, ...], passed: bool, chains: int, draws: int) -> str:
    if passed:
        return (
            f"Converged: {chains} chains of {draws} draws agree (R-hat {gates[0].found} at worst), with at least "
            f"{gates[1].found} effective draws; trajectories that broke off: {gates[3].found}."
        )
    failed = [gate for gate in gates if not gate.passed]
    reasons = " ".join(f"{gate.name}: found {gate.found}, required {gate.required}. {gate.advice}" for gate in failed)
    if draws < _FEWEST_DRAWS:
        return f"Not converged: {chains} chains of {draws} draws say nothing; sampling was stopped in its warm-up."
    return f"Not converged: do not rely on this posterior. {reasons}"
