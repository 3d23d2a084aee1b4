"""The process that ends what a process has started, should that be killed: run as a script, by `_processes`.

Standard input tells which process groups live: a line with + and the number of one that starts, - of one that has
ended. When it closes, whoever wrote it is gone, and what still lives is killed.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterable
from contextlib import suppress


def main(lines: Iterable[str]) -> None:
    """Follow the lines to their end, then kill."""
    groups: set[int] = set()
    for line in lines:
        (groups.add if line[0] == "+" else groups.discard)(int(line[1:]))
    for group in groups:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(group, signal.SIGKILL)


if __name__ == "__main__":
    main(sys.stdin)
