"""Who is told how an experiment goes on: the stages say it, a display or nobody hears it."""

from __future__ import annotations

from typing import Any, Protocol


class Listener(Protocol):
    """Is told how the experiment goes on."""

    def stage(self, name: str, done_before: bool) -> None:
        """A stage begins, or is taken from an earlier call."""

    def generation(self, run: int, generation: int, best: float) -> None:
        """The genetic algorithm has finished a generation."""

    def learning(self, said: str) -> None:
        """What a round of the active learning did."""

    def search(self, what: str) -> None:
        """What the mode search is at."""

    def sampling(self, chains: Any) -> None:
        """State of the chains (`calibration.nuts.ChainProgress` each)."""


class Silent:
    """A listener that says nothing."""

    def stage(self, name: str, done_before: bool) -> None:
        """Nothing."""

    def generation(self, run: int, generation: int, best: float) -> None:
        """Nothing."""

    def learning(self, said: str) -> None:
        """Nothing."""

    def search(self, what: str) -> None:
        """Nothing."""

    def sampling(self, chains: Any) -> None:
        """Nothing."""
