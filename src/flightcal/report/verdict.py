"""The verdict on a run, from three questions: the page begins with it, and terminal and exit code say the same."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from ..errors import GATE_FAILED, MODEL_FAILED, WITH_LIMITS
from ..words import listed
from .findings import (
    ORDER,
    Finding,
    State,
    convergence,
    explanations,
    heat,
    heaters,
    held_channels,
    holding,
    in_few_words,
    interrupted,
    lasting_noise,
    likely,
    missing,
    noise,
    prior_conflict,
    resting,
    scores,
    stand_in,
    temperatures_of,
    thresholds,
    time_tags,
    valued,
    width,
)
from .panels.parameters import MOST_NAMED
from .run_files import RunFiles

CONVERGED: Final = "Did the sampling converge?"
RIGHT: Final = "Is the model right for this telemetry?"
HOLD: Final = "Do its intervals hold on orbits that it has not seen?"

MEANING: Final = {
    CONVERGED: "The chains, searches that start apart, end in the same place.",
    RIGHT: "What is left over (residuals: telemetry minus prediction) looks like noise.",
    HOLD: "As much unseen telemetry lies inside the intervals as should.",
}
"""What a yes to each question says."""

_BACKTEST: Final = "flightcal backtest scenario.yaml --out backtest"
_ANOTHER_WINDOW: Final = (
    "Predict more that it has not seen: add a window, windows: {later: {start: ..., end: ...}}, and run the same "
    "command again."
)
"""What tries a good run further; a backtest takes no simulator that needs an emulator."""
_WITHOUT_LIMIT = "what no test here has looked at"


@dataclass(frozen=True)
class Answer:
    """To one of the three questions: the worst of what was found."""

    question: str
    findings: tuple[Finding, ...]

    @property
    def meaning(self) -> str:
        """What a yes says."""
        return MEANING[self.question]

    @property
    def worst(self) -> Finding:
        """The finding that decides."""
        return max(self.findings, key=lambda found: ORDER.index(found.state))

    @property
    def state(self) -> State:
        """Of the worst finding."""
        return self.worst.state


@dataclass(frozen=True)
class Verdict:
    """Whether a run can be used, for what, and why."""

    answers: tuple[Answer, ...]
    """To whether the sampling converged, the model is right, and its intervals hold."""
    beside: tuple[Finding, ...]
    """What is told and decides nothing."""
    channels: tuple[str, ...]
    """Scored on windows that were not trained on."""
    parameters: tuple[str, ...] = ()
    """Of the scenario."""
    emulated: bool = False
    """Whether an emulator stood in for the simulator."""

    def __repr__(self) -> str:
        return f"<Verdict: {self.use}>"

    @property
    def state(self) -> State:
        """Of the worst answer; what is not known is a caution."""
        known = (("warn" if answer.state == "none" else answer.state) for answer in self.answers)
        return max(known, key=ORDER.index)

    @property
    def use(self) -> str:
        """What the run can be used for, in a sentence."""
        if self.state == "good":
            return "Use it."
        if self.state == "bad":
            return "Do not use it."
        cautions = [found for answer in self.answers for found in answer.findings if found.state != "good"]
        limits = [limit for found in cautions for limit in found.not_for]
        left = [name for name in self.channels if temperatures_of(name) not in limits]
        named = listed(left)
        if len(left) > MOST_NAMED:
            named = f"{len(left)} of {len(self.channels)} channels"
        if left == list(self.channels) and len(left) > 1:
            named = "both channels" if len(left) == 2 else f"all {len(left)} channels"
        uses = f"temperatures of {named}" if left else "the windows that it was trained on"
        return f"Use it for {uses}, but not for {in_few_words(limits, self.parameters) or _WITHOUT_LIMIT}."

    @property
    def doubted(self) -> tuple[str, ...]:
        """Parameters whose values are in doubt."""
        cautions = [found for answer in self.answers for found in answer.findings if found.state != "good"]
        return tuple(name for found in cautions for name in map(valued, found.not_for) if name)

    @property
    def then(self) -> str:
        """What to do next: of the worst finding that says so."""
        found = [found for answer in self.answers for found in answer.findings if found.then and found.state != "good"]
        if not found:
            return _ANOTHER_WINDOW if self.emulated else _BACKTEST
        return max(found, key=lambda finding: ORDER.index(finding.state)).then

    @property
    def exit_code(self) -> int:
        """0: use it; 3: sampling failed; 4: the model does not fit, or intervals do not hold; 5: with limits."""
        if self.answers[0].state == "bad":
            return GATE_FAILED
        return {"good": 0, "warn": WITH_LIMITS}.get(self.state, MODEL_FAILED)

    @property
    def record(self) -> dict[str, object]:
        """Content of verdict.json."""
        return {
            "use": self.use,
            "state": self.state,
            "exit_code": self.exit_code,
            "answers": [
                {
                    "question": answer.question,
                    "state": answer.state,
                    "answer": answer.worst.title,
                    "findings": [
                        {"state": finding.state, "title": finding.title, "text": finding.text,
                         "details": list(finding.details),
                         "not_for": list(finding.not_for) if finding.state != "good" else []}
                        for finding in answer.findings
                    ],
                }
                for answer in self.answers
            ],
            "next": self.then,
        }  # fmt: skip


def verdict_of(run: RunFiles) -> Verdict:
    """The verdict on a run."""
    return Verdict(
        (
            Answer(CONVERGED, (*interrupted(run), convergence(run.diagnostics), *explanations(run))),
            Answer(
                RIGHT,
                (
                    *likely(run.suspects),
                    noise(run),
                    *lasting_noise(run),
                    *heat(run),
                    prior_conflict(run),
                    *stand_in(run),
                    *thresholds(run),
                ),
            ),
            Answer(HOLD, (holding(run), *width(run), *heaters(run))),
        ),
        (*scores(run), *resting(run), *time_tags(run), *missing(run)),
        tuple(held_channels(run)),
        tuple(info.name for info in run.parameters if info.kind == "parameter"),
        emulated=run.emulator is not None,
    )
