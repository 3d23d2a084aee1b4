"""What is said of simple wrongs: which of those that help is named, and what is said where none explains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..report import UNEXPLAINED
from .evidence import Fit
from .misfit import Misfit
from .wrongs import Wrong

NOT_COMPARED = "wrong clocks, units, biases, swapped channels, status, heaters, modes, drivers and orbit"
"""What only a comparison with the simulator tells,"""
INSIDE = "wrong heaters, modes, drivers, faces, attitude and orbit"
"""and what only a simulator that is looked into."""
CLEAR = 10.0
"""Nats by which a wrong has to be better than nothing wrong, odds counted, to be named."""
BAD, _WORSE = 2.0, 4.0
"""Mean squares of deviations from which a scenario is beside its telemetry altogether: where simple wrongs help, and
where none does."""
_LEFT = 0.2
"""Share of what a right model has in more than nothing wrong, that one wrong may lack and still be what is named."""
_LITTLE = 0.1
"""Share in nats of what a right model has in more, that a wrong explains at least which leaves what is just usual."""
_NO_MORE = 2.0
"""Nats by which it may lack more than nothing wrong: what is more probable and fits worse makes up for something."""
NOT_IMITATED = frozenset({"clock", "orbit", "attitude", "driver"})
"""Kinds of wrongs that a model does not ask for which is only too simple:"""
_MOST, _MUCH = 0.2, 3.0 * CLEAR
"""one that explains so much of it, and so many nats, is named whatever is left. The model of a real satellite lacks
something where nothing is wrong."""
_LAST = frozenset({"doubled"})
"""Kinds that stand behind what explains about as much: two sensors of one node, and none of another that has one by the
scenario. Of two panels alike that is what any wrong of one of them looks like."""
_FAR = 5.0
"""Deviations of its prior, beyond which no parameter and no unmodelled heat is where a wrong is put right: of a hundred
of them, one is there about as seldom as `CLEAR` says."""
_FAR_BESIDE = 2.0 * _FAR
"""The same where a wrong that no model asks for leaves what is usual, or a packet's clock nearly nothing: an orbit is
found to a tenth of a degree, and a clock to half a minute."""
HELPS, _PART = 30.0, 0.7
"""Nats from which what does not explain the telemetry is worth a word, and share that it may leave unexplained."""
_SHOWN, _NEAR = 3, 0.2
"""So many are named at most, and only if the best is not better by `CLEAR` and by so much of what it explains."""


_WHOLE = 0.3
"""Of what the best explains: by so much less, what leaves nothing unusual is named, where the best leaves much."""


@dataclass(frozen=True)
class Suspicion:
    """A simple wrong that explains the telemetry far better than the scenario as it is."""

    kind: str
    about: str
    """A channel, a heater, a node, ..."""
    title: str
    sentence: str
    advice: str
    """What to do, in a line."""
    nats: float | None = None
    """How much more probable the telemetry is with it, log; None: the telemetry shows it by itself."""


@dataclass(frozen=True)
class Suspects:
    """What was found, the likeliest first."""

    found: tuple[Suspicion, ...] = ()
    looked: bool = False
    """Whether the telemetry was compared with the simulator, beside what it shows by itself."""
    why_not: str = ""
    """Why it was not, where it was not, or why not in all."""
    misfit: Misfit | None = None
    """Where the model is farthest off, if it is beyond what is usual and nothing says why."""
    partly: Suspicion | None = None
    """What explains a part of that."""

    @property
    def lines(self) -> tuple[str, ...]:
        """What was found, as lines, and what was not looked for."""
        alike = sum(suspicion.nats is not None for suspicion in self.found)

        def mark(suspicion: Suspicion) -> str:
            one_of = f", one of {alike}" if alike > 1 and suspicion.nats is not None else ""
            return "" if suspicion.kind == UNEXPLAINED else f"likely wrong{one_of}: "

        found = tuple(
            f"{mark(suspicion)}{suspicion.title}. {suspicion.sentence} Next: {suspicion.advice}."
            for suspicion in self.found
        )
        return (*found, f"not looked for: {self.left_out}; {self.why_not}") if self.why_not else found

    @property
    def left_out(self) -> str:
        """What nobody looked for."""
        return INSIDE if self.looked else NOT_COMPARED


def suspicion_of(wrong: Wrong, fit: Fit, nats: float | None) -> Suspicion:
    """What is said of a wrong that is better than nothing wrong by so many nats; None: it shows by itself."""
    words = wrong.words(fit) if callable(wrong.words) else wrong.words
    return Suspicion(wrong.kind, wrong.about, words.title, words.sentence, words.advice, nats)


def ranked(
    best: list[tuple[Fit, Suspicion]], nothing: Fit, left: float = _LEFT, far: float = _FAR, bad: float = np.inf
) -> list[Suspicion]:
    """What explains the telemetry, of what helps: it leaves what is usual or hardly anything, or explains much that no
    simple model asks for; and nothing is far off."""

    def is_near(fit: Fit, suspicion: Suspicion) -> bool:
        late = suspicion.kind == "channel clock" and fit.lacking < left * nothing.lacking
        beside = fit.is_usual and (suspicion.kind in NOT_IMITATED or late)
        return fit.farthest < (max(far, _FAR_BESIDE) if beside else far)

    near = [(fit, suspicion, suspicion.nats or 0.0) for fit, suspicion in best if is_near(fit, suspicion)]
    enough = max(_MUCH, _MOST * nothing.lacking)

    def explains(fit: Fit, suspicion: Suspicion, nats: float) -> bool:
        much = fit.lacking < left * nothing.lacking or (suspicion.kind in NOT_IMITATED and nats > enough)
        no_more = fit.lacking <= nothing.lacking + _NO_MORE
        enough_of_it = nats > _LITTLE * nothing.lacking
        return (fit.is_usual and no_more and enough_of_it) or (much and fit.misfit < bad)

    least = min((nats for fit, suspicion, nats in near if explains(fit, suspicion, nats)), default=np.inf)
    # What explains still more, odds counted, is no less likely for leaving more.
    named = [
        (fit, suspicion, nats)
        for fit, suspicion, nats in near
        if explains(fit, suspicion, nats) or (suspicion.kind in NOT_IMITATED and nats >= least)
    ]
    if not named:
        return []
    most = max(nats for _, _, nats in named)
    whole: list[Suspicion] = []
    if not named[0][0].is_usual:
        # What leaves nothing unusual stands before what leaves much, and may explain somewhat less. Without a channel
        # that belongs nowhere there is always less that is unusual.
        nearly = (1.0 - _WHOLE) * most
        whole = [
            suspicion
            for fit, suspicion, nats in named
            if fit.is_usual and nats > nearly and suspicion.kind != "unrelated"
        ]
    alike = [
        suspicion for _, suspicion, nats in named if most - nats < max(CLEAR, _NEAR * most) and suspicion not in whole
    ]
    return sorted([*whole, *alike][:_SHOWN], key=lambda suspicion: suspicion.kind in _LAST)


def part_of(helps: Sequence[tuple[Fit, Suspicion]], nothing: Fit) -> Suspicion | None:
    """What helps most, where it explains a good part of how far the model is off; the best first in `helps`."""
    if not helps:
        return None
    fit, suspicion = helps[0]
    explains = (suspicion.nats or 0.0) > HELPS and fit.lacking < _PART * nothing.lacking
    return suspicion if explains else None


def unexplained(
    nothing: Fit, where: Misfit | None, helps: list[tuple[Fit, Suspicion]], *, run_only: bool = False
) -> list[Suspicion]:
    """That no simple wrong brings the model to the telemetry, where it is far off; else it may be only too simple."""
    if nothing.misfit <= (BAD if helps else _WORSE):
        return []
    lacked = "what a simulator may lack" if run_only else "unmodelled heat of some percent"
    sentence = (
        f"Neither parameters nor {lacked} nor any one simple wrong do: its deviations are "
        f"{np.sqrt(nothing.misfit):.1f} times what is usual."
    )
    if not run_only:
        sentence = f"{sentence[:-1]}, beside heat of {0.05 * nothing.size:.0%} of what flows."
    if where:
        sentence += f" {where.words}"
    if helps:
        sentence += f" A part of it, at most: {helps[0][1].title}."
    advice = "Check that both are of the same satellite and time; then what the model leaves out there"
    return [nothing_simple(sentence, advice)]


def nothing_simple(sentence: str, advice: str) -> Suspicion:
    """What is said where no one simple wrong explains the telemetry."""
    return Suspicion(UNEXPLAINED, "", "No simple wrong explains the telemetry", sentence, advice, 0.0)
