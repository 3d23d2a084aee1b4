"""Effective samples per second of the same posterior."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

from ..report import Section, Table

_AGREEING = 1.05  # R-hat
_NAMES = {
    "flightcal": "flightcal",
    "numpyro": "NumPyro NUTS on diffrax (Tsit5)",
    "nutpie": "nutpie on the lax.scan model (switch located)",
    "emcee": "emcee on flightcal's forward",
}


def measure(quick: bool) -> Section:
    """The table; the samplers run one after the other, each on all cores."""
    seconds = 20 if quick else 180
    found, failed = {}, []
    for name, label in _NAMES.items():
        try:
            found[label] = _run(name, seconds)
        except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
            failed.append(f"{label}: did not finish ({_reason(error)}).")
    if "flightcal" not in found:
        raise AssertionError(failed[0])
    base = _rate(found["flightcal"])
    rows = [
        [
            label,
            f"{'' if _believable(result) else 'at most '}{_rate(result):.3g}",
            f"{'' if _believable(result) else 'at least '}{base / _rate(result):.3g}" if _rate(result) > 0 else "-",
            f"{result['ess']:.0f} ({result['ess_median']:.0f})",
            f"{result['r_hat']:.3f}",
            f"{result['seconds']:.1f} s",
            f"{result['evaluations']:,}",
            f"{result['evaluations'] / result['ess']:.1f}",
        ]
        for label, result in found.items()
    ]
    columns = [
        "", "ESS a second", "flightcal's over it", "ESS, worst (median)", "R-hat, worst", "time", "evaluations",
        "evaluations per effective sample",
    ]  # fmt: skip
    return Section(
        "Effective samples per second",
        "The posterior of the same problem, 18 parameters. ESS is the bulk effective sample size of the worst "
        "parameter, all chains together; R-hat the rank-normalised one of the worst. Each sampler has all cores.",
        [Table(columns, rows)],
        [
            *(f"{label}: {result['how']}; {result['divergences']} divergences." for label, result in found.items()),
            f"The peers are stopped after about {seconds} s and their rate is taken from what they had: an ESS of a "
            "few dozen is uncertain by a third, and with an R-hat above 1.05 it is an upper bound.",
            "All peers start around the mode that flightcal found; both NUTS peers also sample in flightcal's whitened "
            "coordinates. The time counts from the end of the warm-up, for all.",
            *failed,
        ],
    )


def _rate(result: dict[str, Any]) -> float:
    return float(result["ess"]) / float(result["seconds"])


def _believable(result: dict[str, Any]) -> bool:
    """Whether the chains agree; if not, their ESS is too high."""
    return bool(result["r_hat"] < _AGREEING)


def _run(name: str, seconds: float) -> dict[str, Any]:
    command = [sys.executable, "-m", "benchmarks.peers.samplers", name, str(seconds)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=6 * seconds + 300)
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


def _reason(error: Any) -> str:
    if isinstance(error, subprocess.TimeoutExpired):
        return "out of time"
    return (error.stderr or "no message").strip().splitlines()[-1][:200]
