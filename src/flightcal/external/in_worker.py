"""Runs of models that live in this Python or in a library: in worker processes, kept from one run to the next."""

from __future__ import annotations

import hashlib
import os
import pickle
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ..simulator import FloatArray, cores
from ._processes import at_fork, live
from .executable import ending, last_words
from .program import Outputs, RunFailure

_OPENING = 120.0
"""Seconds for the start of a worker, imports and all; a run's own time-out holds if it is longer."""


class Model(Protocol):
    """An open model, in the worker."""

    def run(self, inputs: Mapping[str, float]) -> Outputs:
        """As of any `ExternalProgram`. A model with a gradient has its `pull_back` too, without the time-out."""


class Description(Protocol):
    """What opens a model in the worker; plain data."""

    @property
    def has_gradient(self) -> bool | None:
        """See `ExternalProgram`; None: the open model knows, see its own `has_gradient`."""

    def open(self) -> Model:
        """The model. Raises RunFailure where it cannot be opened."""


@dataclass(frozen=True)
class WorkerProgram:
    """Runs a model in worker processes, one run at a time in each."""

    description: Description

    @property
    def has_gradient(self) -> bool:
        """Whether the model has one. Raises RunFailure where it must be asked and does not answer."""
        known = self.description.has_gradient
        return bool(self._ask("has_gradient", _OPENING)) if known is None else known

    @cached_property
    def key(self) -> bytes:
        """Tells programs apart."""
        return hashlib.sha256(pickle.dumps(self.description)).digest()

    def run(self, inputs: Mapping[str, float], timeout: float) -> Outputs:
        """One run. Raises RunFailure."""
        return Outputs(*self._ask("run", timeout, dict(inputs)))

    def pull_back(self, inputs: Mapping[str, float], temperatures_bar: FloatArray, timeout: float) -> FloatArray:
        """Cotangent of the inputs. Raises RunFailure."""
        return np.asarray(self._ask("pull_back", timeout, dict(inputs), temperatures_bar), dtype=float)

    def _ask(self, request: str, timeout: float, *arguments: Any) -> Any:
        worker = _borrow(self.key)
        if worker is None:
            try:
                worker = _Worker(self.key)
            except OSError as error:
                raise RunFailure("crashed", f"no process can be started for it: {error}") from None
            worker.ask(max(timeout, _OPENING), "open", self.description)
        answer = worker.ask(timeout, request, *arguments)
        _give_back(worker)
        return answer


class _Worker:
    """A child process and the line to it. A request that fails in the child leaves it alive; anything else ends it."""

    def __init__(self, key: bytes) -> None:
        self.key, self.resources = key, ExitStack()
        ours, theirs = socket.socketpair()
        self.connection: Any = self.resources.enter_context(Connection(ours.detach()))
        self.said = self.resources.enter_context(tempfile.TemporaryFile())  # noqa: SIM115 - closed by `resources`
        package = str(Path(__file__).parents[2])
        paths = [package, *filter(None, [os.environ.get("PYTHONPATH")])]
        # Runs are parallel already: threads of their own would only be in each other's way.
        folder = self.resources.enter_context(tempfile.TemporaryDirectory(prefix="flightcal-"))
        alone = {name: os.environ.get(name, "1") for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
        self.process: Any = subprocess.Popen(
            [sys.executable, "-P", "-m", "flightcal.external.worker", str(theirs.fileno())],
            pass_fds=[theirs.fileno()],
            stdin=subprocess.PIPE,
            stdout=self.said,
            stderr=self.said,
            env={**os.environ, **alone, "TMPDIR": folder, "PYTHONPATH": os.pathsep.join(paths)},
            start_new_session=True,
        )
        theirs.close()
        self.resources.enter_context(live(self.process, Path(folder)))

    def ask(self, timeout: float, request: str, *arguments: Any) -> Any:
        """The answer to a request. Raises RunFailure; after one that is not the child's own word, it is gone."""
        # Of what a model prints, only what it says last is ever shown, and a campaign runs it many times.
        self.said.seek(0)
        self.said.truncate()
        try:
            self.connection.send((request, *arguments))
            if not self.connection.poll(timeout):
                self.close()
                what = "starting" if request == "open" else "running"
                raise RunFailure("timed out", f"still {what} after {timeout:g} s, killed")
            answer = self.connection.recv()
        except (EOFError, OSError):
            raise RunFailure("crashed", self._how_it_ended()) from None
        except BaseException:
            self.close()
            raise
        if answer[0] == "failed":
            if request == "open":
                self.close()
            else:
                _give_back(self)
            raise RunFailure(answer[1], answer[2])
        return answer[1]

    def _how_it_ended(self) -> str:
        self.process.wait()
        words = last_words(self.said)
        self.close()
        return f"{ending(self.process.returncode)}{words}"

    def close(self) -> None:
        """End the process with all that it has started."""
        self.resources.close()
        self.process.stdin.close()


_IDLE: list[_Worker] = []
_LOCK = threading.Lock()
at_fork(_IDLE.clear)


def _borrow(key: bytes) -> _Worker | None:
    with _LOCK:
        for worker in _IDLE.copy():
            if worker.key == key:
                _IDLE.remove(worker)
                if worker.process.poll() is None:  # an interruption kills idle ones too
                    return worker
        return None


def _give_back(worker: _Worker) -> None:
    """Keep the worker for the next run; of too many idle ones, the one that has been idle longest ends."""
    with _LOCK:
        _IDLE.append(worker)
        surplus = [_IDLE.pop(0)] if len(_IDLE) > cores() else []
    for old in surplus:
        old.close()
