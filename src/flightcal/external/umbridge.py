"""A model behind HTTP as a simulator: the UM-Bridge protocol (Seelinger et al. 2023, doi:10.21105/joss.04748)."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .program import Outputs, RunFailure

if TYPE_CHECKING:  # the worker starts in a tenth of a second without it
    from ..simulator import FloatArray

MOST_BYTES = 64_000_000
"""Of a server's reply, unpacked: a million numbers, and room to spare."""
_NOT_FINITE = re.compile(r"\b(nan|-?inf(inity)?)\b", re.IGNORECASE)


@dataclass(frozen=True)
class ServerDescription:
    """Where the server is, and the window that it is asked for."""

    url: str
    model: str
    config: dict[str, Any]
    """What the server gets beside the inputs: `times` and `start` among it."""
    samples: int
    outputs: tuple[str, ...]
    heaters: tuple[str, ...]

    @property
    def has_gradient(self) -> None:
        """Only the server knows."""

    def open(self) -> ServerModel:
        """Ask the server for the model. Raises RunFailure."""
        return ServerModel(self)


class ServerModel:
    """One model of a server."""

    def __init__(self, description: ServerDescription) -> None:
        import umbridge

        self._given = description
        with self._asking():
            # The client reads whatever comes and follows any redirect; this worker asks nobody else.
            umbridge.um.requests = _Requests()
            self._model: Any = umbridge.HTTPModel(description.url.rstrip("/"), description.model)

    def has_gradient(self) -> bool:
        """Whether the server offers the model's gradient."""
        return bool(self._model.supports_gradient())

    def run(self, inputs: Mapping[str, float]) -> Outputs:
        """One evaluation. Raises RunFailure."""
        given = self._given
        with self._asking():
            vectors = self._model([list(inputs.values())], given.config)
        names = (*given.outputs, *given.heaters)
        if not isinstance(vectors, list) or len(vectors) != len(names):
            found = f"{len(vectors)} vectors" if isinstance(vectors, list) else type(vectors).__name__
            raise RunFailure("wrong shape", f"found {found}, expected one for each of {', '.join(names)}")
        for name, vector in zip(names, vectors, strict=True):
            if not isinstance(vector, list) or len(vector) != given.samples:
                found = f"{len(vector)} numbers" if isinstance(vector, list) else type(vector).__name__
                message = f"'{name}': found {found}, expected {given.samples}, one for each sample time"
                raise RunFailure("wrong shape", message)
        # A server in C++ writes null for what is not a number.
        table = np.array(vectors, dtype=float).T
        return Outputs(table[:, : len(given.outputs)], table[:, len(given.outputs) :])

    def pull_back(self, inputs: Mapping[str, float], temperatures_bar: FloatArray) -> FloatArray:
        """Cotangent of the inputs: one request for each output that matters. Raises RunFailure."""
        values, inputs_bar = list(inputs.values()), np.zeros(len(inputs))
        for k, column in enumerate(temperatures_bar.T):
            if column.any():
                with self._asking():
                    inputs_bar += self._model.gradient(k, 0, [values], column.tolist(), self._given.config)
        return inputs_bar

    @contextmanager
    def _asking(self) -> Iterator[None]:
        """What can go wrong with a request, in words."""
        import requests

        try:
            yield
        except json.JSONDecodeError as error:
            text = " ".join(error.doc.split())
            if _NOT_FINITE.search(text) and '"output"' in text:
                raise RunFailure("not finite", f"{self._given.url} gives {_NOT_FINITE.findall(text)[0][0]}") from None
            message = f"{self._given.url} answers what is not UM-Bridge: {text[:200] or 'nothing'}"
            raise RunFailure("crashed", message) from None
        except (requests.exceptions.ConnectionError, requests.exceptions.Timeout) as error:
            cause = next((str(part) for part in _causes(error) if isinstance(part, OSError) and part.strerror), "")
            message = f"no server at {self._given.url}{f': {cause}' if cause else ''}"
            raise RunFailure("unreachable", message) from None
        except requests.exceptions.RequestException as error:
            raise RunFailure("unreachable", f"{self._given.url} cannot be asked: {error}") from None
        except (KeyError, TypeError) as error:
            message = f"{self._given.url} answers what is not UM-Bridge: no {error}"
            raise RunFailure("crashed", message) from None
        except RunFailure:
            raise
        except Exception as error:  # the client's own, with the server's words in it
            raise RunFailure("crashed", f"{self._given.url}: {' '.join(str(error).split())[:300]}") from None


class _Requests:
    """What UM-Bridge's client uses of the package `requests`: replies of a limited size, from nowhere else."""

    def get(self, url: str) -> _Reply:
        return _asked("GET", url)

    def post(self, url: str, json: Any) -> _Reply:
        return _asked("POST", url, json=json)


@dataclass(frozen=True)
class _Reply:
    content: bytes

    def json(self) -> Any:
        return json.loads(self.content.decode("utf-8", "replace"))


def _asked(method: str, url: str, **content: Any) -> _Reply:
    """The reply to one request. Raises RunFailure where it is too large or a redirect."""
    import requests

    with requests.request(method, url, allow_redirects=False, stream=True, **content) as response:
        if response.is_redirect:
            place = response.headers["location"][:200]
            raise RunFailure("crashed", f"{url} redirects to {place}, expected an answer: redirects are not followed")
        parts, size = [], 0
        for part in response.iter_content(1 << 16):
            size += len(part)
            if size > MOST_BYTES:
                found = f"found a reply of more than {MOST_BYTES / 1e6:.0f} MB"
                raise RunFailure("wrong shape", f"{url}: {found}, expected {MOST_BYTES / 1e6:.0f} MB at most")
            parts.append(part)
    return _Reply(b"".join(parts))


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        inner = error.args[0] if error.args and isinstance(error.args[0], BaseException) else None
        error = inner or getattr(error, "reason", None) or error.__cause__ or error.__context__
