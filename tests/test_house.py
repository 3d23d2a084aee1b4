"""The rooms of the house: who may import whom, and through which door."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import flightcal

ROOT = Path(flightcal.__file__).parent
PROJECT = Path(__file__).parents[1]
TOWER = [
    *("cli", "commands", "check", "report", "validation", "prediction", "emulation", "calibration", "problem"),
    *("reduction", "campaign", "external", "operational", "probability", "simulator", "telemetry", "environment"),
    *("scenario", "run", "words", "progress", "errors", "compiled"),
]
"""From the roof to the ground: a room imports only rooms that stand after it."""
ROOMS = sorted(path.parent.name for path in ROOT.glob("*/__init__.py"))
ROOT_MODULES = ["__init__", "cli", "compiled", "errors", "progress"]
DEEP: set[tuple[str, str]] = {("commands/campaign.py", "campaign.cluster")}
"""Imports (file, module) that go past a room's front door; the list may only shrink.

A cluster needs the extra of that name, which the room itself does without."""


def imports(file: Path) -> Iterator[tuple[str, ...]]:
    """Modules of flightcal that a file imports, each as its parts below `flightcal`."""
    package = file.relative_to(ROOT).parts[:-1]
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - (node.level - 1)]
            module = (*base, *(node.module.split(".") if node.module else ()))
            yield from ([module] if module else [(alias.name,) for alias in node.names])
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "flightcal":
            yield tuple((node.module or "").split(".")[1:])
        elif isinstance(node, ast.Import):
            yield from (tuple(a.name.split(".")[1:]) for a in node.names if a.name.split(".")[0] == "flightcal")


def _taken() -> dict[str, set[str]]:
    """Names that are imported from each room's front door, by other rooms and by what stands beside the package."""
    beside = [file for folder in ("tests", "benchmarks", "examples") for file in (PROJECT / folder).rglob("*.py")]
    taken: dict[str, set[str]] = {room: set() for room in ROOMS}
    for file in (*ROOT.rglob("*.py"), *beside):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.level != 1 or file.parent == ROOT):
                room = (node.module or "").removeprefix("flightcal.")
                taken.get(room, set()).update(alias.name for alias in node.names)
    return taken


TAKEN = _taken()


def files_of(room: str) -> list[Path]:
    return sorted((ROOT / room).rglob("*.py"))


def used_by(room: str) -> set[str]:
    return {module[0] for file in files_of(room) for module in imports(file) if module} - {room}


def test_the_root_has_five_modules():
    assert sorted(path.stem for path in ROOT.glob("*.py")) == ROOT_MODULES


def test_every_room_stands_in_the_tower():
    assert set(ROOMS) | set(ROOT_MODULES) - {"__init__"} == set(TOWER)


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_imports_only_what_stands_below_it(room):
    assert used_by(room) <= set(TOWER[TOWER.index(room) + 1 :])


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_says_what_it_imports(room):
    said = ast.get_docstring(ast.parse((ROOT / room / "__init__.py").read_text(encoding="utf-8"))) or ""
    line = " ".join(said.split("\n\n")[-1].split())
    used = "all rooms" if room == "commands" else ", ".join(sorted(used_by(room)))
    assert line == f"Imports: {used or 'nothing'}."


@pytest.mark.parametrize("module", ["compiled", "errors", "progress"])
def test_the_ground_imports_only_what_stands_below_it(module):
    used = {name[0] for name in imports(ROOT / f"{module}.py")}
    assert used <= set(TOWER[TOWER.index(module) + 1 :])


@pytest.mark.parametrize("room", ROOMS)
def test_a_front_door_has_nothing_that_nobody_takes(room):
    door = ast.parse((ROOT / room / "__init__.py").read_text(encoding="utf-8"))
    listed = [node for node in door.body if isinstance(node, ast.ImportFrom) and node.level]
    assert {alias.name for node in listed for alias in node.names} <= TAKEN[room]


def test_rooms_are_entered_by_their_front_doors():
    """A verb of the command line is a module: `commands` alone has no door."""
    found = {
        (str(file.relative_to(ROOT)), ".".join(module))
        for file in ROOT.rglob("*.py")
        for module in imports(file)
        if len(module) > 1 and module[0] in ROOMS and module[0] not in {"commands", file.relative_to(ROOT).parts[0]}
    }
    assert found == DEEP
