"""Did the sampling converge?"""

from __future__ import annotations

import json

from ...calibration import LINEAR, OF_EMULATOR
from ...words import shown, unit
from ..run_files import Record, RunFiles
from .finding import AGAIN, Finding, value_of


def interrupted(run: RunFiles) -> list[Finding]:
    """Whether sampling was stopped."""
    if run.posterior is None or str(run.posterior.attrs.get("interrupted", "false")).lower() != "true":
        return []
    sizes = run.posterior["posterior"].to_dataset().sizes
    kept = f"{sizes.get('draw', 0)} draws of each of {sizes.get('chain', 0)} chains"
    text = f"Sampling was stopped early; all that follows rests on {kept}."
    return [Finding("bad", "The run was interrupted", text, then=AGAIN)]


def convergence(diagnostics: Record | None) -> Finding:
    """Whether the chains passed their gates."""
    if diagnostics is None:
        text = "There is no diagnosis of the chains (diagnostics.json), so nothing here is a calibration."
        return Finding("bad", "The sampling did not finish", text, then=AGAIN)
    gates = diagnostics.get("gates", [])
    failed = sorted((g for g in gates if not g["passed"]), key=lambda g: g["name"] not in OF_EMULATOR)
    words = str(diagnostics.get("verdict") or "")
    if diagnostics["passed"]:
        text = f"All {len(gates)} gates are passed. {words} This judges the sampling, not the model."
        return Finding("good", "The chains have converged", " ".join(text.split()))
    details = tuple(
        f"{g['name']}: found {shown(g['found'])}, required {shown(g['required'])}. {g.get('advice') or ''}".strip()
        for g in failed
    )
    then = str(failed[0].get("advice") or "")
    share = f"{len(failed)} of {len(gates)} gates {'is' if len(failed) == 1 else 'are'} not passed."
    if all(g["name"] == LINEAR for g in failed):
        text = (
            f"{share} The chains agree, but they take the response of temperatures to heat for linear, and it is not: "
            "parameters may be further off than their intervals say. What is predicted is simulated with its heat, and "
            "unseen telemetry judges it."
        )
        title = "Do not rely on the parameters: the response to heat is not linear"
        return Finding("warn", title, text, details, ("parameters",), then)
    if failed[0]["name"] in OF_EMULATOR:
        text = f"{share} The chains went through the emulator's posterior, which is not the simulator's."
        title = f"The emulator does not follow the simulator: {shown(failed[0]['found'])}"
        return Finding("bad", title, text, details, then=then)
    # The rest of the words names the gates, as the details do.
    first = f"{words.split('. ')[0]}." if not words.startswith("Converged") else "Do not rely on this posterior."
    title = f"The chains have not converged: {failed[0]['name']}, {shown(failed[0]['found'])}"
    return Finding("bad", title, f"{share} {first}", details, then=then)


def explanations(run: RunFiles) -> list[Finding]:
    """Optima that were found beside the one that was sampled, and that explain the telemetry nearly as well."""
    found = [] if run.posterior is None else json.loads(run.posterior.attrs.get("other_explanations", "[]"))
    if not found:
        return []
    infos = {info.name: info for info in run.parameters}

    def differs(name: str, here: float, there: float) -> str:
        info = infos.get(name)
        offset, shown_unit = (info.offset, unit(info.unit)) if info else (0.0, "")
        return f"{name} {there + offset:.6g} instead of {here + offset:.6g} {shown_unit}".rstrip()

    details = []
    for other in found:
        entries = other["differs"]
        values = [differs(*entry) for entry in entries[:3]]
        more = f", and {len(entries) - 3} more" if len(entries) > 3 else ""
        details.append(f"{', '.join(values)}{more}: {other['below']:.1f} nats below the best.")
    text = (
        "The search found optima where no chain has been, of nearly the same density; intervals leave them out. They "
        "often are of a sensor that starts near its thermostat's threshold: a window that begins at another time tells "
        "them apart."
    )
    differ = dict.fromkeys(value_of(name) for other in found for name, *_ in other["differs"])
    title = "Another explanation fits nearly as well"
    return [
        Finding("warn", title, text, tuple(details), tuple(differ), "Train on a window that begins at another time.")
    ]
