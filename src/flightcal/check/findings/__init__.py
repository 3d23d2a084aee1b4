"""What a check says, in plain words: what matters (bad), cautions (warn), what is well (good). A question is a file."""

from __future__ import annotations

from collections.abc import Sequence

from ...report import ORDER, Finding
from .checked import Checked
from .heat import heat_findings, times
from .reach import failures, reach, reaches
from .sensitivity import profile, sensitivity
from .smooth import gradient, jumps
from .suspected import suspected
from .told import centre, identifiability


def findings_of(checked: Checked) -> list[Finding]:
    """All findings, the worst first, and of those the ones that a user should mend first."""
    found = [
        *suspected(checked.suspects, reached=reaches(checked)),
        *centre(checked),
        *reach(checked),
        *failures(checked),
        *identifiability(checked),
        *heat_findings(checked.heat),
        *gradient(checked),
        *jumps(checked),
        sensitivity(checked),
        *(profile(checked, one) for one in checked.profiles),
    ]
    return sorted(found, key=lambda finding: ORDER.index(finding.state), reverse=True)


def verdict_of(findings: Sequence[Finding]) -> tuple[bool, str]:
    """Whether nothing stands against sampling, and one sentence."""
    bad = [finding for finding in findings if finding.state == "bad"]
    cautions = sum(finding.state == "warn" for finding in findings)
    beside = f"{cautions} caution{'s' if cautions != 1 else ''}"
    if bad:
        many = "1 finding matters" if len(bad) == 1 else f"{len(bad)} findings matter"
        beside = f", and there {'is' if cautions == 1 else 'are'} {beside}" if cautions else ""
        return False, f"Mend this before sampling, or know why not: {many}{beside}."
    return True, f"Ready to sample, with {beside}." if cautions else "Ready to sample: nothing stands against it."
