"""A run's stages: one that is made from what it was made from before is read, not made."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from ..errors import FlightcalError
from ..progress import SILENT, Progress
from .folder import RunDirectory, hash_of, hash_of_file
from .records import plain

K = TypeVar("K")


@dataclass(frozen=True)
class Stage(Generic[K]):
    """How something that a run keeps is made, and how it is read."""

    name: str
    """In provenance.json."""
    title: str
    """As shown while it is made; "": its parts are shown as stages instead."""
    files: tuple[str, ...]
    make: Callable[..., None]
    """make(run, *inputs, **settings) writes the files."""
    read: Callable[..., K]
    """read(run, *inputs) is what later stages take in."""
    whole: Callable[[K], bool] = lambda _: True
    """False: it was interrupted. It is kept and used, and the next call makes it anew."""


@dataclass(frozen=True)
class Run:
    """A run's folder, and whom to tell how its stages go on."""

    folder: RunDirectory
    progress: Progress = SILENT
    _known: list[tuple[Any, str]] = field(default_factory=list)

    @property
    def path(self) -> Path:
        """Of the folder."""
        return self.folder.path

    def given(self, key: str, *things: Any) -> None:
        """Things that stages take in and that no stage has made; key: hash of what they follow from."""
        self._known.extend((thing, key) for thing in things if thing is not None)

    def key(self, thing: Any) -> str:
        """Hash of what a stage's result, or a thing that was `given`, follows from; of anything else, of its content.

        Raises TypeError where that is more than JSON can say.
        """
        return hash_of(json.dumps(self._content(thing), sort_keys=True))

    def stage(self, stage: Stage[K], *inputs: Any, **settings: Any) -> K:
        """Make a stage, or read it where the name, the inputs and the settings are those that it was made from.

        Raises FlightcalError also where its numbers overflow, or its matrices lose all digits.
        """
        key = self.key([stage.name, list(inputs), settings])
        if self.folder.is_done(stage.name, key, stage.files):
            with self._shown(stage, 1.0) as progress:
                if stage.title:
                    progress.at(1.0, "done before")
            made = stage.read(self, *inputs)
        else:
            started = self.folder.begin(stage.name)
            # Threads of linear algebra spin where others want the processor, and then take many times as long.
            with self._shown(stage) as progress, threadpool_limits(1), numbers_told(stage.title or stage.name):
                inside = replace(self, progress=_Logged(progress, self.folder, stage.name))
                stage.make(inside, *inputs, **settings)
                made = stage.read(self, *inputs)
            if not stage.whole(made):
                key = hash_of(key, [hash_of_file(self.folder.file(name)) for name in stage.files])
            self.folder.end(stage.name, key, started)
        self.given(key, made)
        return made

    def _shown(self, stage: Stage[K], total: float | None = None) -> AbstractContextManager[Progress]:
        return self.progress.stage(stage.title, total) if stage.title else nullcontext(self.progress)

    def _content(self, thing: Any) -> Any:
        for known, key in self._known:
            if known is thing:
                return key
        if hasattr(thing, "model_dump"):
            return thing.model_dump(mode="json")
        if isinstance(thing, Mapping):
            return {str(name): self._content(value) for name, value in thing.items()}
        if isinstance(thing, (list, tuple)):
            return [self._content(value) for value in thing]
        return plain(thing)


_TOO_FAR = (
    "the scenario is too far from its telemetry. Check units, powers and capacities, and what is said to be likely "
    "wrong"
)


@contextmanager
def numbers_told(what: str, advice: str = _TOO_FAR) -> Iterator[None]:
    """What cannot be computed becomes a message: a scenario that is far from its telemetry does that to any stage.

    Raises FlightcalError for numbers that overflow, matrices that lose all digits, and simulations that fail.
    """
    try:
        yield
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise FlightcalError(f"{what}: {error}: {advice}") from error


@dataclass(frozen=True)
class _Logged:
    """Progress of a stage whose lines also go to the run's log."""

    progress: Progress
    folder: RunDirectory
    name: str

    @contextmanager
    def stage(self, title: str, total: float | None = None) -> Iterator[Progress]:
        with self.progress.stage(title, total) as inside:
            yield _Logged(inside, self.folder, self.name)

    def at(self, done: float, note: str = "") -> None:
        self.progress.at(done, note)

    def say(self, line: str) -> None:
        self.progress.say(line)
        self.folder.log(stage=self.name, event="said", text=line)
