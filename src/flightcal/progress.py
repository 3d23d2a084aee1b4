"""Who is told how work goes on: the one convention. Work says it; a display, a log or nobody hears it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from time import monotonic
from typing import Final, Protocol

EVERY: Final = 60.0
"""s between two lines on one stage, where there is no terminal."""


class Progress(Protocol):
    """Is told how work goes on."""

    def stage(self, title: str, total: float | None = None) -> AbstractContextManager[Progress]:
        """A stage that lasts as long as the block, and whom to tell of it.

        total: what `at` counts to; None: that is not known. A stage of a stage is shown in its place.
        """

    def at(self, done: float, note: str = "") -> None:
        """So much of the stage is done; `note` says it in words."""

    def say(self, line: str) -> None:
        """A line that stays."""


class Silent:
    """Says nothing."""

    @contextmanager
    def stage(self, title: str, total: float | None = None) -> Iterator[Progress]:
        """Nothing."""
        yield self

    def at(self, done: float, note: str = "") -> None:
        """Nothing."""

    def say(self, line: str) -> None:
        """Nothing."""


SILENT: Final[Progress] = Silent()


def about(seconds: float) -> str:
    """A time that is not known well, in words."""
    if seconds < 90.0:
        return f"about {seconds:.0f} s"
    return f"about {seconds / 60:.0f} min" if seconds < 5400.0 else f"about {seconds / 3600:.1f} h"


def _to_the_error_output(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


class Lines:
    """Prints a line for each stage, and its note each minute and at its end, so that a log shows how far it is."""

    def __init__(self, write: Callable[[str], None] = _to_the_error_output) -> None:
        self._write = write
        self._within: str | None = None
        """What stands before a note; None: this is not a stage."""
        self._total: float | None = None
        self._printed = monotonic()

    @contextmanager
    def stage(self, title: str, total: float | None = None) -> Iterator[Progress]:
        """Print the title; that of a stage of a stage stands before its notes."""
        inside = Lines(self._write)
        inside._total = total
        if self._within is None:
            self._write(title)
            inside._within = ""
            yield inside
        else:
            inside._within, inside._printed = f"{self._within}{title}: ", self._printed
            yield inside
            self._printed = inside._printed

    def at(self, done: float, note: str = "") -> None:
        """Print the note where it is the last one, or a minute after the last line."""
        whole = self._total is not None and done >= self._total
        if note and (whole or monotonic() - self._printed >= EVERY):
            self._write(f"  {self._within}{note}")
            self._printed = monotonic()
            self._total = None if whole else self._total

    def say(self, line: str) -> None:
        """Print the line."""
        self._write(line)
