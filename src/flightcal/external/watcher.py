"""The process that ends what a process has started, should that be killed: run as a script, by `_processes`.

Standard input tells which process groups live: a line with +, the number of one that starts and the folder that it
works in, or with - and the number of one that has ended. When it closes, whoever wrote it is gone. What still lives is
killed, and its folder deleted.
"""

from __future__ import annotations

import os
import shutil
import signal
import sys
from collections.abc import Iterable
from contextlib import suppress


def main(lines: Iterable[str]) -> None:
    """Follow the lines to their end, then kill."""
    folders: dict[int, str] = {}
    for line in lines:
        group, _, folder = line[1:].rstrip("\n").partition(" ")
        if line[0] == "+":
            folders[int(group)] = folder
        else:
            folders.pop(int(group), None)
    for number, place in folders.items():
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(number, signal.SIGKILL)
        shutil.rmtree(place, ignore_errors=True)


if __name__ == "__main__":
    main(sys.stdin)
