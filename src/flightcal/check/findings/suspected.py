"""What is likely to be wrong, before anything else."""

from __future__ import annotations

from dataclasses import asdict, replace

from ...report import Finding, likely
from ..suspicion import Suspects


def suspected(suspects: Suspects, *, reached: bool = True) -> list[Finding]:
    """What is likely to be wrong before anything else: of comparisons with the simulator the best, the others below.

    reached: whether the prior reaches the telemetry without heat.
    """
    compared = any(suspicion.nats is not None for suspicion in suspects.found)
    found = [
        replace(finding, text=f"{finding.text} {finding.then}", then="")
        for finding in likely([asdict(suspicion) for suspicion in suspects.found])
    ]
    if suspects.misfit is not None and not compared:
        title = "No simple wrong explains how far the model is off"
        text = f"Unmodelled heat has to make up for more than is usual. {suspects.misfit.words}"
        if suspects.partly is not None:
            title = f"A part of how far the model is off may be this: {suspects.partly.title}"
            text = f"{text} The rest is of something else, or the model is too simple. {suspects.partly.advice}."
        found.append(Finding("warn", title, text))
    if suspects.looked and not found:
        text = "Clocks, units, biases, swapped channels, status, heaters, modes, drivers and the orbit were tried."
        if suspects.why_not:
            text = (
                "Clocks, units, biases, swapped channels, status and priors were tried. What parameters or initial "
                "temperatures can make up for is not told from them."
            )
        title = "No simple wrong explains the telemetry better than the scenario"
        if not reached:
            title = "No simple wrong explains what the prior does not reach"
            text = f"Unmodelled heat or noise may hide it from this search: look for what matters below first. {text}"
        found.append(Finding("good" if reached else "warn", title, text))
    if suspects.why_not:
        text = (
            f"Nothing of this kind was compared with the simulator: {suspects.why_not}. Look for it yourself where the "
            "prior does not reach the telemetry, or where a value or a noise is far out in its prior."
        )
        found.append(Finding("warn", f"Not looked for: {suspects.left_out}", text))
    return found
