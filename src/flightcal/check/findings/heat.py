"""What unmodelled heat takes from the parameters."""

from __future__ import annotations

from ...report import Finding
from ...words import listed, percent
from ..heat import ALIKE, BesideHeat, Imitated, Kind

_TELLS: dict[Kind, str] = {
    "surface": "eclipses or attitudes",
    "power": "modes or powers",
    "path": "heater pulses, modes or powers",
    "other": "changes of sunlight, modes or heaters",
}
"""What would tell a parameter from heat that the model lacks."""


def heat_findings(heat: BesideHeat | None) -> list[Finding]:
    """What unmodelled heat takes from the parameters, and what would tell them; empty where there is none."""
    if heat is None:
        return []
    matter = [imitation for imitation in heat.parameters if imitation.matters]
    if not matter:
        text = (
            "No parameter's effect is like what heat of its prior's size can do, or it is well told beside that heat."
        )
        return [Finding("good", "Unmodelled heat takes little from the parameters", text)]
    found = []
    for kind, advice in _TELLS.items():
        alike = [imitation for imitation in matter if imitation.kind == kind]
        if alike:
            title = f"Unmodelled heat makes {listed([imitation.name for imitation in alike])} hard to tell"
            details = tuple(imitated_words(imitation) for imitation in alike)
            text = (
                "This is so where heat has its prior's size; where the telemetry shows less, intervals are narrower. "
                f"Other {advice} than those in the training windows would tell."
            )
            found.append(Finding("warn", title, text, details))
    if heat.pairs:
        shown = tuple(f"{a} and {b}: heat in {node}, cosine {cosine:.2f}." for a, b, node, cosine in heat.pairs)
        title = f"One heat imitates both of {len(shown)} pair{'s' if len(shown) > 1 else ''} of parameters"
        found.append(Finding("warn", title, "Neither of the two should be read alone.", shown))
    return found


def imitated_words(imitation: Imitated) -> str:
    """What heat takes from a parameter."""
    what = (
        f"Heat in {imitation.node} can imitate {imitation.name}"
        if imitation.cosine > ALIKE
        else f"Heat hides {imitation.name}"
    )
    return (
        f"{what} (cosine {imitation.cosine:.2f}): its interval will be about {times(imitation.growth)} times as wide "
        f"as without heat, {percent(imitation.beside, 0)} as wide as the prior's."
    )


def times(growth: float) -> str:
    """How many times, as it is shown."""
    return f"{growth:.0f}" if growth >= 9.95 else f"{growth:.1f}"
