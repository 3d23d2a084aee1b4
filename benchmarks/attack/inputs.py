"""`python -m benchmarks.attack.inputs`: 1,000 mutated scenarios and 90 mutated telemetry files, linted.

Each is a bundled example that was changed in one to three places. Whatever is wrong with it, lint has to say so or to
accept it: a traceback, or no answer within three minutes, is a fault. Faults are written with their seed, so that
`--only SEED` makes one of them again.
"""

from __future__ import annotations

import argparse
import copy
import faulthandler
import io
import re
import shutil
import signal
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML
from typer.testing import CliRunner

from flightcal.cli import app

SCENARIOS, FILES = 1000, 90
EXAMPLES = Path(__file__).parents[2] / "examples"
BUNDLED = ("validation/scenario", "leo_observer/scenario", "leo_observer/with_discrepancy", "executable/scenario")
_SHARES = (0.6, 0.15, 0.1, 0.15)
"""Of the mutations; the smallest example answers in a second."""
LONGEST = 180
"""s, for an answer."""
_NUMBER = re.compile(r"^\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)(.*)$", re.DOTALL)
_EXTREMES = ("0", "-1", "1e-300", "1e-30", "1e-9", "1e9", "1e30", "1e300", "1e308", "1e400", "nan", "inf", "-inf")
_UNITS = ("K", "degC", "W", "J/K", "W/K", "m^2", "s", "min", "day", "deg", "km", "parsec", "", "m^9^9", "%")
_ODD: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 3, 1.5, 10**17, "", " ", "on", "nan", "[/b]", "a/b", "../x", "\N{SNOWMAN}", "x" * 3000),
    *([], {}, [1], [[]], ["a", "a"], {"a": {}}, {"": 1}, "2024-03-01T00:00:00", "9999-12-31T00:00:00", "all", "none"),
)
Random = np.random.Generator
Place = tuple[Any, Any]
"""A mapping or list, and the key in it."""


@dataclass(frozen=True)
class Outcome:
    """What lint made of a mutated input."""

    seed: int
    kind: str
    said: str
    """refused, accepted, traceback or late."""
    detail: str = ""


# --- scenarios --------------------------------------------------------------------------------------------------


def places(data: Any) -> list[Place]:
    """Every key and item of nested mappings and lists."""
    keys = list(data) if isinstance(data, dict) else range(len(data)) if isinstance(data, list) else []
    return [found for key in keys for found in ((data, key), *places(data[key]))]


def _pick(data: Any, rng: Random, fits: Callable[[Any], bool] = lambda value: True) -> Place | None:
    found = [(parent, key) for parent, key in places(data) if fits(parent[key])]
    return found[rng.integers(len(found))] if found else None


def _is_number(value: Any) -> bool:
    return not isinstance(value, bool) and bool(_NUMBER.match(str(value)))


def missing_key(data: Any, rng: Random) -> None:
    """One key or item less."""
    if place := _pick(data, rng):
        del place[0][place[1]]


def other_type(data: Any, rng: Random) -> None:
    """A value of a kind that does not belong there."""
    if place := _pick(data, rng):
        place[0][place[1]] = copy.deepcopy(_ODD[rng.integers(len(_ODD))])


def extreme_number(data: Any, rng: Random) -> None:
    """A number, with its unit, far from any that is meant."""
    if place := _pick(data, rng, _is_number):
        value = place[0][place[1]]
        number = _EXTREMES[rng.integers(len(_EXTREMES))]
        unit = _NUMBER.match(str(value))[2]  # type: ignore[index]
        place[0][place[1]] = f"{number}{unit}" if isinstance(value, str) else float(number)


def scaled_number(data: Any, rng: Random) -> None:
    """A number that is off by some powers of ten."""
    if place := _pick(data, rng, _is_number):
        value = place[0][place[1]]
        number, unit = _NUMBER.match(str(value)).groups()  # type: ignore[union-attr]
        try:
            changed = float(number) * 10.0 ** int(rng.integers(-4, 5)) * (-1.0 if rng.random() < 0.3 else 1.0)
        except ValueError:
            return
        whole = isinstance(value, int) and abs(changed) < 1e15
        place[0][place[1]] = f"{changed:g}{unit}" if isinstance(value, str) else int(changed) if whole else changed


def other_unit(data: Any, rng: Random) -> None:
    """A number in a unit of something else."""
    if place := _pick(data, rng, lambda value: isinstance(value, str) and _is_number(value)):
        number = _NUMBER.match(place[0][place[1]])[1]  # type: ignore[index]
        place[0][place[1]] = f"{number} {_UNITS[rng.integers(len(_UNITS))]}"


def renamed_key(data: Any, rng: Random) -> None:
    """A key that is written wrongly, or as another one."""
    found = [(parent, key) for parent, key in places(data) if isinstance(parent, dict)]
    parent, key = found[rng.integers(len(found))]
    other = found[rng.integers(len(found))][1] if rng.random() < 0.5 else f"{key}"[:-1] + "x"
    parent[other] = parent.pop(key)


def other_value(data: Any, rng: Random) -> None:
    """A value from another place of the file."""
    place, other = _pick(data, rng), _pick(data, rng)
    if place and other:
        place[0][place[1]] = copy.deepcopy(other[0][other[1]])


def doubled_key(text: str, rng: Random) -> str:
    """A line twice."""
    lines = text.splitlines(keepends=True)
    k = int(rng.integers(len(lines)))
    return "".join([*lines[: k + 1], lines[k], *lines[k + 1 :]])


def damaged_text(text: str, rng: Random) -> str:
    """A few characters lost, doubled or replaced."""
    for _ in range(int(rng.integers(1, 4))):
        k, length = int(rng.integers(len(text))), int(rng.integers(0, 4))
        marks = ":-{}[]#&*!|>'\"%@`,\n\t .\x00é"
        text = text[:k] + marks[rng.integers(len(marks))] * int(rng.integers(0, 3)) + text[k + length :]
    return text


IN_DATA = (missing_key, other_type, extreme_number, scaled_number, other_unit, renamed_key, other_value)
IN_TEXT = (doubled_key, damaged_text)


def mutated_scenario(seed: int, folder: Path) -> tuple[str, list[str]]:
    """A mutated example in `folder`: what was done to it, and what lint is to be asked."""
    rng = np.random.default_rng(seed)
    example = EXAMPLES / f"{BUNDLED[rng.choice(len(BUNDLED), p=_SHARES)]}.yaml"
    for file in example.parent.iterdir():
        if file.is_file():
            shutil.copyfile(file, folder / file.name)
    kinds = (*IN_DATA, *IN_TEXT)
    kind = kinds[seed % len(kinds)]
    text = example.read_text(encoding="utf-8")
    if kind in IN_DATA:
        data = YAML(typ="safe", pure=True).load(text)
        for _ in range(int(rng.choice([1, 1, 1, 2, 3]))):
            kind(data, rng)  # type: ignore[call-arg, arg-type]
        written = io.StringIO()
        YAML(typ="safe", pure=True).dump(data, written)
        text = written.getvalue()
    else:
        text = kind(text, rng)  # type: ignore[assignment, arg-type]
    (folder / "mutated.yaml").write_text(text, encoding="utf-8")
    return kind.__name__.replace("_", " "), ["lint", str(folder / "mutated.yaml")]


# --- telemetry --------------------------------------------------------------------------------------------------


def _cut(data: bytes, rng: Random) -> bytes:
    return data[: rng.integers(len(data))]


def _bytes(data: bytes, rng: Random) -> bytes:
    changed = bytearray(data)
    for k in rng.integers(len(data), size=rng.integers(1, 20)):
        changed[k] = rng.integers(256)
    return bytes(changed)


def _rows(change: Callable[[list[str], Random], list[str]]) -> Callable[[bytes, Random], bytes]:
    """A change of the rows below the header."""

    def apply(data: bytes, rng: Random) -> bytes:
        header, *rows = data.decode().splitlines()
        return "\n".join([header, *change(rows, rng), ""]).encode()

    return apply


def _cells(words: tuple[str, ...], *, time: bool = False) -> Callable[[bytes, Random], bytes]:
    """Some cells of a column, or all, with other words in them."""

    def change(rows: list[str], rng: Random) -> list[str]:
        cells = [row.split(",") for row in rows]
        column = 0 if time else int(rng.integers(1, len(cells[0])))
        chosen = range(len(rows)) if rng.random() < 0.3 else rng.integers(len(rows), size=rng.integers(1, 20))
        for k in chosen:
            cells[k][column] = words[rng.integers(len(words))]
        return [",".join(row) for row in cells]

    return _rows(change)


def _column(data: bytes, rng: Random) -> bytes:
    rows = [row.split(",") for row in data.decode().splitlines()]
    k = int(rng.integers(len(rows[0])))
    return "\n".join(",".join(cells[:k] + cells[k + 1 :]) for cells in rows).encode()


def _columns(data: bytes, rng: Random) -> bytes:
    rows = [row.split(",") for row in data.decode().splitlines()]
    k = int(rng.integers(len(rows[0])))
    return "\n".join(",".join([*cells, cells[k]]) for cells in rows).encode()


def _ragged(rows: list[str], rng: Random) -> list[str]:
    k = int(rng.integers(len(rows)))
    return [*rows[:k], rows[k].rsplit(",", int(rng.integers(1, 3)))[0], *rows[k + 1 :]]


def _every(share: float) -> Callable[[list[str], Random], list[str]]:
    return lambda rows, rng: [row for row in rows if rng.random() < share]


FILE_MUTATIONS: dict[str, Callable[[bytes, Random], bytes]] = {
    "truncated": _cut,
    "random bytes": _bytes,
    "no rows": lambda data, rng: data.splitlines()[0] + b"\n" * int(rng.integers(0, 3)),
    "bad numbers": _cells(("abc", "1,5", "--", "1e308", "-1e308", "1e400", "nan", "inf", "-inf", "", "0x10", "1e-320")),
    "bad times": _cells(("", "yesterday", "2024-13-01T00:00:00", "0001-01-01", "9999-12-31", "1e18"), time=True),
    "mixed zones": _cells(("2024-03-01T00:10:00Z", "2024-03-01T01:10:00+01:00"), time=True),
    "doubled times": _rows(lambda rows, rng: [row for row in rows for _ in range(int(rng.integers(1, 3)))]),
    "unsorted times": _rows(lambda rows, rng: [str(row) for row in rng.permutation(rows)]),
    "one time only": _rows(lambda rows, rng: rows[:1] * int(rng.integers(1, 4))),
    "few rows": _rows(_every(0.01)),
    "missing rows": _rows(_every(0.5)),
    "missing column": _column,
    "doubled column": _columns,
    "ragged row": _rows(_ragged),
    "other encoding": lambda data, rng: data.decode().replace("-", "\N{MINUS SIGN}").encode(
        str(rng.choice(["utf-16", "utf-32", "utf-8", "utf-8-sig", "utf-16-le"]))
    ),
}  # fmt: skip


def mutated_file(seed: int, folder: Path) -> tuple[str, list[str]]:
    """A small example whose telemetry is mutated: what was done to it, and what lint is to be asked."""
    rng = np.random.default_rng(seed)
    kind = list(FILE_MUTATIONS)[seed % len(FILE_MUTATIONS)]
    data = (EXAMPLES / "validation" / "telemetry.csv").read_bytes()
    (folder / "telemetry.csv").write_bytes(FILE_MUTATIONS[kind](data, rng))
    shutil.copyfile(EXAMPLES / "validation" / "scenario.yaml", folder / "scenario.yaml")
    return kind, ["lint", str(folder / "scenario.yaml")]


# --- running ----------------------------------------------------------------------------------------------------


class _Late(BaseException):
    """No answer in time."""


@contextmanager
def _limited(seconds: int) -> Iterator[None]:
    def late(*_: Any) -> None:
        raise _Late

    signal.signal(signal.SIGALRM, late)
    signal.alarm(seconds)
    # Compiled code hears no alarm: then the campaign ends, and says where.
    faulthandler.dump_traceback_later(3 * seconds, exit=True)
    try:
        yield
    finally:
        signal.alarm(0)
        faulthandler.cancel_dump_traceback_later()


def tried(seed: int, make: Callable[[int, Path], tuple[str, list[str]]]) -> Outcome:
    """What lint says of the input of this seed."""
    with tempfile.TemporaryDirectory() as folder:
        kind, arguments = make(seed, Path(folder))
        try:
            with _limited(LONGEST):
                result = CliRunner().invoke(app, arguments)
        except _Late:
            return Outcome(seed, kind, "late")
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        return Outcome(seed, kind, "traceback", "".join(traceback.format_exception(result.exception)))
    if "Traceback" in result.output or result.exit_code not in (0, 1):
        return Outcome(seed, kind, "traceback", result.output)
    return Outcome(seed, kind, "refused" if result.exit_code else "accepted", result.output)


def table(title: str, outcomes: list[Outcome]) -> str:
    """How many of each kind were refused, accepted, and ended otherwise."""
    columns = ("refused", "accepted", "traceback", "late")
    lines = [f"{title:<24}{''.join(f'{column:>11}' for column in columns)}"]
    counts = Counter((outcome.kind, outcome.said) for outcome in outcomes)
    for kind in dict.fromkeys(outcome.kind for outcome in outcomes):
        lines.append(f"{kind:<24}{''.join(f'{counts[kind, column]:>11}' for column in columns)}")
    total = Counter(outcome.said for outcome in outcomes)
    return "\n".join([*lines, f"{'all':<24}{''.join(f'{total[column]:>11}' for column in columns)}"])


def main(scenarios: int = SCENARIOS, files: int = FILES) -> int:
    """Run the campaign and print its table; 0: no fault."""
    faults = 0
    for title, count, make in (("scenarios", scenarios, mutated_scenario), ("telemetry", files, mutated_file)):
        outcomes = []
        for seed in range(count):
            outcomes.append(found := tried(seed, make))
            if seed % 100 == 99:
                print(f"{title}: {seed + 1} of {count}", file=sys.stderr, flush=True)
            if found.said in ("traceback", "late"):
                faults += 1
                print(f"{title}, seed {seed} ({found.kind}): {found.said}\n{found.detail}", flush=True)
        print(table(title, outcomes), end="\n\n", flush=True)
    return faults and 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.attack.inputs", description=__doc__)
    parser.add_argument("--scenarios", type=int, default=SCENARIOS)
    parser.add_argument("--files", type=int, default=FILES)
    parser.add_argument("--only", type=int, help="say what lint says of the scenario and the file of this seed")
    given = parser.parse_args()
    if given.only is not None:
        for make in (mutated_scenario, mutated_file):
            print(tried(given.only, make))
        sys.exit()
    sys.exit(main(given.scenarios, given.files))
