"""The child process in which code that is not ours runs: what crashes or hangs there is a message here.

Started as ``python -m flightcal.external.worker SOCKET`` by `in_worker`; it ends when its parent does.
"""

from __future__ import annotations

import os
import sys
import threading
import traceback
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from .program import RunFailure


def main() -> None:
    """Open the model that the parent sends, then answer its requests until it hangs up."""
    connection: Any = Connection(int(sys.argv[1]))
    threading.Thread(target=_end_with_parent, daemon=True).start()
    model = None
    while True:
        try:
            request, *arguments = connection.recv()
        except EOFError:
            return
        try:
            if request == "open":
                model, answer = arguments[0].open(), None
            else:
                answer = getattr(model, request)(*arguments)
            connection.send(("done", answer))
        except RunFailure as failure:
            connection.send(("failed", failure.outcome, failure.message))
        except Exception as error:
            connection.send(("failed", "crashed", _what_happened(error)))


def _end_with_parent() -> None:
    """The parent holds the other end of standard input; when that closes, even by a kill, so must this."""
    while os.read(0, 1):
        pass
    os._exit(1)


def _what_happened(error: Exception) -> str:
    """The error and the line in the user's code, not in ours, where it came up."""
    ours = str(Path(__file__).parent)
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if not frame.filename.startswith(ours)]
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {' '.join(str(error).split())[:300]}{place}"


if __name__ == "__main__":
    main()
