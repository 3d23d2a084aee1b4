"""`python -m benchmarks.attack.storage`: a small calibration is killed, interrupted, damaged and left without room.

It is killed before and after every file that it replaces, interrupted at moments spread over its time, finds every file
of a finished run damaged in four ways, and gets a disk of every size. Then the same command runs again, undisturbed.
Afterwards its metrics must be those of a run that nothing disturbed, to the bit, with no temporary file left; and no
end may be a crash or a traceback. Each call is a fork of a process that has imported and compiled everything. Takes
half an hour.
"""

from __future__ import annotations

import argparse
import atexit
import ctypes
import os
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from flightcal import cli
from flightcal.commands.calibrate import run_experiment
from flightcal.run import files

EXAMPLE = Path(__file__).parents[2] / "examples" / "validation"
SHORT = """
calibration:
  seed: 5
  genetic: {runs: 2, population: 8, generations: 4}
  nuts: {chains: 2, draws: 60, warmup: 60, max_r_hat: 2, min_ess: 1}
  prediction: {simulations: 20}
"""
SIZES, MOMENTS = 40, 10
"""Disks and interruptions of either kind."""
LONGEST = 120.0
"""s, for a call."""
_NEW_MOUNTS, _NEW_USER, _REMOUNT = 0x20000, 0x10000000, 32
"""CLONE_NEWNS, CLONE_NEWUSER, MS_REMOUNT of Linux."""
_LIBC = ctypes.CDLL(None, use_errno=True)

VERDICTS = (0, cli.GATE_FAILED, cli.MODEL_FAILED, cli.WITH_LIMITS)
"""Exit codes of a calibration that is finished."""

Disturb = Callable[[], object]


@dataclass(frozen=True)
class End:
    """How a call ended: its exit code, negative for a signal, and what it said."""

    code: int
    said: str

    @property
    def fault(self) -> str:
        """What must never be, or ""."""
        if "Traceback" in self.said:
            return "traceback"
        known = (*VERDICTS, 1, cli.INTERRUPTED, -signal.SIGKILL)
        return "" if self.code in known else f"ended with {self.code}"


@dataclass(frozen=True)
class Case:
    """What became of a disturbed calibration; fault: "" where all is as it must be."""

    what: str
    fault: str
    ended: int
    said: str


def calibrate(scenario: Path, out: Path, disturb: Disturb = lambda: None) -> End:
    """`flightcal calibrate` in a fork, where `disturb` is called first."""
    said = scenario.with_name("said.txt")
    child = os.fork()
    if not child:
        handle = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(handle, 1)
        os.dup2(handle, 2)
        sys.argv = ["flightcal", "calibrate", str(scenario), "--out", str(out)]
        code: object = 1
        try:
            disturb()
            cli.main()
        except SystemExit as end:
            code = end.code or 0
        except BaseException:
            sys.excepthook(*sys.exc_info())
        # As at the end of a process, where HDF5 writes what it has not written yet.
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        _LIBC.exit(code)
    return End(_wait(child), said.read_text(errors="replace"))


def _wait(child: int) -> int:
    """Exit code of a process, which is killed when it takes too long."""
    deadline = time.monotonic() + LONGEST
    while not (ended := os.waitpid(child, os.WNOHANG))[0]:
        if time.monotonic() > deadline:
            os.kill(child, signal.SIGALRM)
        time.sleep(0.01)
    return os.waitstatus_to_exitcode(ended[1])


# --- what happens ----------------------------------------------------------------------------------------------


def kill_at(count: int, *, after: bool) -> None:
    """Have the replacement of the file after `count` others be the last thing that happens, or not happen any more."""
    replace, left = os.replace, [count]

    def counted(*arguments: object) -> None:
        left[0] -= 1
        if left[0] < 0 and not after:
            os.kill(os.getpid(), signal.SIGKILL)
        replace(*arguments)  # type: ignore[arg-type]
        if left[0] < 0:
            os.kill(os.getpid(), signal.SIGKILL)

    files.os.replace = counted  # type: ignore[assignment]


def interrupt_after(seconds: float, number: int) -> None:
    """Have the signal come after some time: from outside, as a user's does."""
    # A handle, for the process may have ended by then, and another may have its number.
    target = os.pidfd_open(os.getpid())
    if not os.fork():
        time.sleep(seconds)
        with suppress(ProcessLookupError):
            signal.pidfd_send_signal(target, number)
        os._exit(0)


def count_replacements(scenario: Path, out: Path) -> tuple[int, int]:
    """How many files a whole run replaces."""
    counts, replace = scenario.with_name("count.txt"), os.replace

    def disturb() -> None:
        def counted(*arguments: object) -> None:
            with counts.open("a") as file:
                file.write("+")
            replace(*arguments)  # type: ignore[arg-type]

        files.os.replace = counted  # type: ignore[assignment]

    end = calibrate(scenario, out, disturb)
    assert end.code in VERDICTS, end.said
    return len(counts.read_text()), end.code


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda content: b"",
    "half": lambda content: content[: len(content) // 2],
    "without its last byte": lambda content: content[:-1],
    "with a flipped bit": lambda content: (
        content[: len(content) // 3] + bytes([content[len(content) // 3] ^ 16]) + content[len(content) // 3 + 1 :]
    ),
}


# --- campaigns -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Yard:
    """Where calibrations are disturbed, and the undisturbed one."""

    folder: Path
    scenario: Path
    whole: Path
    code: int
    """With which the undisturbed one ends."""

    def new(self) -> Path:
        """A folder that is not there."""
        out = self.folder / "run"
        shutil.rmtree(out, ignore_errors=True)
        return out

    def resumed(self, what: str, first: End, out: Path) -> Case:
        """The case, after the same command has run again."""
        second = calibrate(self.scenario, out)
        return Case(what, self.fault(first, second, out), first.code, first.said + second.said)

    def fault(self, first: End, second: End, out: Path) -> str:
        """The first of what must not be, or ""."""
        if first.fault or second.fault:
            return first.fault or second.fault
        if second.code != self.code:
            return f"did not resume: exit {second.code}"
        if any(files.is_part(file) for file in out.rglob("*")):
            return "temporary files left"
        if {file.name for file in out.iterdir()} != {file.name for file in self.whole.iterdir()}:
            return "other files"
        same = (out / "metrics.json").read_bytes() == (self.whole / "metrics.json").read_bytes()
        return "" if same else "other metrics"


def killed(yard: Yard, count: int) -> Iterable[Case]:
    """At every replaced file."""
    for place in range(count):
        for after in (False, True):
            out = yard.new()
            first = calibrate(yard.scenario, out, lambda place=place, after=after: kill_at(place, after=after))
            what = f"killed {'after' if after else 'before'} file {place + 1} of {count}"
            lived = "" if first.code == -signal.SIGKILL else "was not killed"
            case = yard.resumed(what, first, out)
            yield Case(what, lived or case.fault, case.ended, case.said)


def interrupted(yard: Yard, seconds: float) -> Iterable[Case]:
    """At moments spread over a run's time; one that comes too late changes nothing."""
    for number in (signal.SIGINT, signal.SIGTERM):
        for k in range(MOMENTS):
            out, at = yard.new(), seconds * (k + 0.5) / MOMENTS
            first = calibrate(yard.scenario, out, lambda at=at, number=number: interrupt_after(at, number))
            what = f"{signal.Signals(number).name} after {at:.2f} s"
            early = "" if first.code in (yard.code, cli.INTERRUPTED, -number) else f"exit {first.code}"
            before_main = first.code == -number and not out.exists()
            case = yard.resumed(what, End(0, first.said) if before_main else first, out)
            yield Case(what, early or case.fault, case.ended, case.said)


def damaged(yard: Yard) -> Iterable[Case]:
    """Every file of a finished run, in each way."""
    for name in sorted(file.name for file in yard.whole.iterdir() if file.stat().st_size):
        for how, damage in DAMAGES.items():
            out = yard.new()
            shutil.copytree(yard.whole, out)
            content = (out / name).read_bytes()
            (out / name).write_bytes(damage(content))
            yield yard.resumed(f"{name} {how}", End(0, ""), out)


def without_room(yard: Yard) -> Iterable[Case]:
    """Disks of many sizes: a file system in memory, which grows before the second call."""
    needed = sum(-(-file.stat().st_size // 4096) + 1 for file in yard.whole.iterdir())
    for k in range(SIZES):
        pages = 4 + needed * k // SIZES
        what = f"a disk of {4 * pages} KiB"
        reading, writing = os.pipe()
        child = os.fork()
        if not child:
            os._exit(_on_small_disk(yard, what, pages, writing))
        os.close(writing)
        with os.fdopen(reading, errors="replace") as line:
            ended, fault, said = line.read().split("\n", 2)
        os.waitpid(child, 0)
        yield Case(what, fault, int(ended), said)


def _on_small_disk(yard: Yard, what: str, pages: int, writing: int) -> int:
    """A case in a process with mounts of its own; it is written as lines of exit code, fault and what was said."""
    disk = yard.folder / "disk"
    disk.mkdir(exist_ok=True)
    try:
        _mount(disk, pages)
        out = disk / "run"
        first = calibrate(yard.scenario, out)
        _mount(disk, 100_000, _REMOUNT)
        case = yard.resumed(what, first, out)
        named = first.code != 1 or f"error: {out}" in first.said
        lines = [str(case.ended), case.fault or ("" if named else "the file is not named"), case.said]
    except OSError as error:
        lines = ["0", f"no disk of a size of its own here: {error}", ""]
    with os.fdopen(writing, "w") as line:
        line.write("\n".join(lines))
    return 0


def _mount(disk: Path, pages: int, flags: int = 0) -> None:
    """A file system of so many pages in memory, seen by this process and its children alone."""
    if not flags:
        flag = _NEW_MOUNTS if os.getuid() == 0 else _NEW_MOUNTS | _NEW_USER
        _checked(_LIBC.unshare(flag))
    _checked(_LIBC.mount(b"tmpfs", bytes(disk), b"tmpfs", flags, f"size={4 * pages}k".encode()))


def _checked(code: int) -> None:
    if code:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


def table(title: str, cases: list[Case]) -> str:
    """Cases, exit codes of the disturbed calls, faults; then each fault."""
    ends = ", ".join(f"{code}: {count}" for code, count in sorted(Counter(case.ended for case in cases).items()))
    faults = [case for case in cases if case.fault]
    lines = [f"{title:<14} {len(cases):5} {len(faults):7}   {ends}"]
    for case in faults:
        lines += [f"    {case.what}: {case.fault}", *(f"      | {line}" for line in case.said.splitlines()[-12:])]
    return "\n".join(lines)


def main(only: Iterable[str] = ("killed", "interrupted", "damaged", "without room")) -> int:
    """Run the campaigns, print the table, and return the number of faults."""
    faults = 0
    folder = Path(tempfile.mkdtemp())  # no TemporaryDirectory, which the end of each fork would delete
    try:
        shutil.copy(EXAMPLE / "telemetry.csv", folder)
        scenario = folder / "scenario.yaml"
        text = (EXAMPLE / "scenario.yaml").read_text(encoding="utf-8")
        scenario.write_text(text[: text.index("calibration:")] + SHORT.lstrip(), encoding="utf-8")
        run_experiment(scenario, folder / "whole")
        started = time.monotonic()
        count, code = count_replacements(scenario, folder / "counted")
        seconds = time.monotonic() - started
        yard = Yard(folder, scenario, folder / "whole", code)
        campaigns: dict[str, Callable[[], Iterable[Case]]] = {
            "killed": lambda: killed(yard, count),
            "interrupted": lambda: interrupted(yard, seconds),
            "damaged": lambda: damaged(yard),
            "without room": lambda: without_room(yard),
        }
        print(f"a calibration of {seconds:.1f} s that replaces {count} files")
        print(f"{'campaign':<14} {'cases':>5} {'faults':>7}   exit codes of the disturbed calls", flush=True)
        for name in only:
            cases = list(campaigns[name]())
            faults += sum(bool(case.fault) for case in cases)
            print(table(name, cases), flush=True)
    finally:
        shutil.rmtree(folder)
    return faults


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.attack.storage", description=__doc__)
    parser.add_argument("--only", nargs="+", default=["killed", "interrupted", "damaged", "without room"])
    sys.exit(1 if main(parser.parse_args().only) else 0)
