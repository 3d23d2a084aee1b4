"""What was likely wrong before any sampling."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from .finding import Finding

UNEXPLAINED = "everything"
"""Kind of the record that says that nothing simple is wrong, and the model far off."""


def likely(found: Sequence[Mapping[str, Any]]) -> list[Finding]:
    """Of the records of what is likely wrong: what telemetry shows by itself, and of what explains it the best.

    It was so before any sampling, and is not mended by it.
    """
    compared = [suspicion for suspicion in found if suspicion.get("nats") is not None]
    findings = [_likely(suspicion, "Likely wrong") for suspicion in found if suspicion.get("nats") is None]
    if len(compared) == 1:
        findings.append(_likely(compared[0], "Likely wrong"))
    elif compared:
        best = _likely(compared[0], f"Likely wrong, one of {len(compared)}")
        text = f"{best.text} What follows explains the telemetry nearly as well; or the model is too simple."
        findings.append(
            replace(best, text=text, details=tuple(f"Or: {suspicion['title']}." for suspicion in compared[1:]))
        )
    return findings


def _likely(suspicion: Mapping[str, Any], mark: str) -> Finding:
    title = suspicion["title"] if suspicion.get("kind") == UNEXPLAINED else f"{mark}: {suspicion['title']}"
    return Finding("bad", title, str(suspicion["sentence"]), then=f"{suspicion['advice']}.")
