"""The command line: a table of verbs, each a file in `commands`. They import what they need, so --help is instant."""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
from collections.abc import Callable
from functools import wraps
from importlib import import_module
from importlib.metadata import version
from typing import Annotated, Any, Final

import typer

from .errors import GATE_FAILED, INTERRUPTED, MODEL_FAILED, USER_ERROR, WITH_LIMITS, FlightcalError

VERBS: Final = (
    "demo",
    "init",
    "lint",
    "schema",
    "simulate",
    "calibrate",
    "check",
    "fly",
    "reduce",
    "report",
    "show",
    "diff",
    "campaign",
    "compare",
    "validate",
    "backtest",
)
"""Each is a module in `commands` with a function of its name, whose signature is what the user types."""

_PIPE_CLOSED = 141
"""Exit code of what writes to a program that has ended: 128 and SIGPIPE, as of other programs."""
_MOMENT: Final = 0.05
"""s, after which a signal that was dropped comes again."""
_COLLECTED: Final = 50_000, 20, 100
"""New objects after which cycles are looked for, and how often older ones are: a run keeps a million objects, and each
look through all of them takes a tenth of a second."""

app = typer.Typer(
    name="flightcal",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    help="Calibrate spacecraft operational simulation models in flight, with honest uncertainty.\n\n"
    "Exit codes: 0 done, and what came of it can be used; 1 something in the input is wrong; 2 wrong usage; 3 the "
    "sampling or the validation failed, or a check found what matters; 4 the model does not fit, or its intervals do "
    "not hold; 5 to be used for some of it and not for the rest, which the verdict names; 130 interrupted.",
)


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"flightcal {version('flightcal')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and end.")
    ] = False,
) -> None:
    """What stands before a verb."""


def _user_errors_are_messages(command: Callable[..., None]) -> Callable[..., None]:
    """Show what is the user's to mend as a message, never as a traceback."""

    @wraps(command)
    def wrapped(*args: Any, **kwargs: Any) -> None:
        try:
            command(*args, **kwargs)
        except FlightcalError as error:
            typer.echo(f"error: {error}", err=True)
            raise typer.Exit(USER_ERROR) from None
        except BrokenPipeError:
            # Who reads, such as `head`, has had enough. Python would write once more as it ends.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit(_PIPE_CLOSED) from None
        except OSError as error:
            where = f"{error.filename}: " if error.filename else ""
            typer.echo(f"error: {where}{error.strerror or error}", err=True)
            raise typer.Exit(USER_ERROR) from None
        except MemoryError as error:
            typer.echo(f"error: the memory is full: {error or 'nothing says what was asked for'}", err=True)
            raise typer.Exit(USER_ERROR) from None
        except KeyboardInterrupt:
            typer.echo("interrupted; the same command takes up where this one stopped", err=True)
            raise typer.Exit(INTERRUPTED) from None

    return wrapped


def _add(verb: str) -> None:
    """The last paragraph of a command's docstring is its example, which stands below the options."""
    command = getattr(import_module(f".commands.{verb}", __package__), verb)
    text, _, example = (command.__doc__ or "").rpartition("\n\n")
    app.command(verb, help=text, epilog=example.strip())(_user_errors_are_messages(command))


for _verb in VERBS:
    _add(_verb)


def main() -> None:
    """Entry point of the `flightcal` command.

    Ctrl-C and SIGTERM both raise KeyboardInterrupt, and end in the exit code of an interruption whatever becomes of
    that: click turns it into its own. Python drops it in what it calls back while objects are freed: then the signal
    comes again a moment later.
    """
    gc.set_threshold(*_COLLECTED)
    arrived: list[int] = []
    repeats: list[threading.Timer] = []
    usual = sys.unraisablehook

    def interrupt(number: int, _: object) -> None:
        arrived.append(number)
        raise KeyboardInterrupt

    def again(what: sys.UnraisableHookArgs) -> None:
        if not (arrived and issubclass(what.exc_type, KeyboardInterrupt)):
            return usual(what)
        # To this thread, so that it is woken from what it waits for.
        repeats.append(threading.Timer(_MOMENT, signal.pthread_kill, [threading.main_thread().ident, arrived[-1]]))
        repeats[-1].daemon = True
        repeats[-1].start()

    signals = [number for number in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(number) is not signal.SIG_IGN]
    for number in signals:
        signal.signal(number, interrupt)
    sys.unraisablehook = again
    try:
        app(prog_name="flightcal")
    finally:
        sys.unraisablehook = usual
        for repeat in repeats:
            repeat.cancel()
        for number in signals:
            signal.signal(number, lambda *_: os._exit(INTERRUPTED))
        if arrived:
            sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()

__all__ = ["GATE_FAILED", "INTERRUPTED", "MODEL_FAILED", "USER_ERROR", "WITH_LIMITS", "app", "main"]
