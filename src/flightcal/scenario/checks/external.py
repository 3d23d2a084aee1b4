"""Simulators that are not ours: what can be known of one without running it, importing it or asking a server."""

from __future__ import annotations

import ast
import os
import re
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from ..blocks import External, readable
from ..document import Issue, Location
from ..external import Executable, PythonFunction, Umbridge
from ..reading import Reading
from ..units import show
from .common import channel_of_kind, file_exists, known, unknown
from .fmu import check_fmu

_SIMULATOR: Location = ("simulator",)
_TEMPLATE_NAMES = ("inputs", "times", "start", "end")
_URL = re.compile(r"https?://[^\s/]+(/\S*)?")


def check(reading: Reading, folder: Path) -> Iterator[Issue]:
    """Names fit each other, and the files that the scenario names are there and are what they should be."""
    external = reading.blocks.external
    if external is None:
        return
    yield from _check_inputs(external)
    yield from _check_heaters(external)
    yield from _check_same_name(external)
    block, location = external.block, (*_SIMULATOR, external.kind)
    if isinstance(block, PythonFunction):
        yield from _check_function(block, folder, location)
    elif isinstance(block, Executable):
        yield from _check_executable(block, external, folder, location)
    elif isinstance(block, Umbridge):
        if not _URL.fullmatch(block.url):
            message = f"found {show(block.url)}, expected an address such as 'http://localhost:4242'"
            yield Issue((*location, "url"), message)
    elif block is not None:
        yield from check_fmu(block, external, folder, location)
        for variable, channel in block.drivers.items():
            yield from channel_of_kind(reading.blocks, channel, "driver", (*location, "drivers", variable))


def _check_inputs(external: External) -> Iterator[Issue]:
    first: dict[str, str] = {}
    for name, item in readable(external.inputs).items():
        location = (*_SIMULATOR, "inputs", name)
        if external.kind == "executable" and hasattr({}, name):
            yield Issue(location, f"found the name {name!r}, expected another: templates know it as something else")
        if item.initial_of is None:
            continue
        yield from known("output", item.initial_of, external.outputs, (*location, "initial_of"))
        if item.initial_of in first and item.initial_of in external.outputs:
            other = first[item.initial_of]
            message = f"found the output {item.initial_of!r}, whose initial temperature is the input {other!r} already"
            yield Issue((*location, "initial_of"), message)
        first.setdefault(item.initial_of, name)
        if item.si[0] != "K":
            yield Issue((*location, "value"), f"found {show(item.value)}, expected a temperature such as '20 degC'")


def _check_heaters(external: External) -> Iterator[Issue]:
    for name, heater in readable(external.heaters).items():
        if not isinstance(heater.power, str):
            continue
        location = (*_SIMULATOR, "heaters", name, "power")
        yield from known("input", heater.power, external.inputs, location)
        if (item := external.inputs.get(heater.power)) is not None and item.si[0] != "W":
            yield Issue(location, f"found the input {heater.power!r}, {show(item.value)}, expected one in W")


def _check_same_name(external: External) -> Iterator[Issue]:
    """What the simulator tells apart by name has different names: its inputs, and all that it gives."""
    for sections in (("inputs",), ("outputs", "heaters")):
        first: dict[str, str] = {}
        for section in sections:
            blocks: Mapping[str, Any] = getattr(external, section)
            for name, block in readable(blocks).items():
                called = block.name or name
                if called in first:
                    message = f"found {called!r}, which {first[called]!r} is called too, expected different names"
                    yield Issue((*_SIMULATOR, section, name), message)
                first.setdefault(called, name)


def _check_function(block: PythonFunction, folder: Path, location: Location) -> Iterator[Issue]:
    """The file is read as text and parsed; nothing in it runs."""
    here = (*location, "file")
    if missing := list(file_exists(folder, block.file, "a Python file,", here)):
        yield from missing
        return
    try:
        tree = ast.parse((folder / block.file).read_bytes(), block.file)
    except (SyntaxError, ValueError, OSError) as error:
        line = f", line {error.lineno}" if isinstance(error, SyntaxError) else ""
        reason = error.msg if isinstance(error, SyntaxError) else str(error)
        yield Issue(here, f"found {show(block.file)}, which is not Python{line}: {reason}")
        return
    functions = {item.name: item for item in tree.body if isinstance(item, ast.FunctionDef)}
    assigned = {
        target.id
        for item in tree.body
        if isinstance(item, (ast.Assign, ast.ImportFrom, ast.Import, ast.AnnAssign))
        for target in ast.walk(item)
        if isinstance(target, ast.Name)
    } | {alias.asname or alias.name for item in tree.body if isinstance(item, ast.ImportFrom) for alias in item.names}
    function = functions.get(block.function)
    if function is None:
        if block.function not in assigned and "*" not in assigned:
            yield Issue((*location, "function"), unknown("function", block.function, functions))
        return
    arguments = function.args
    positional = [*arguments.posonlyargs, *arguments.args]
    least = len(positional) - len(arguments.defaults)
    keyword_only = [default for default in arguments.kw_defaults if default is None]
    if keyword_only or least > 3 or (len(positional) < 3 and arguments.vararg is None):
        found = f"found {block.function}({ast.unparse(arguments)})"
        yield Issue((*location, "function"), f"{found}, expected a function of three: (inputs, times, start)")


def _check_executable(block: Executable, external: External, folder: Path, location: Location) -> Iterator[Issue]:
    program = block.program(folder)
    if shutil.which(program) is None:
        place = "relative to the scenario" if "/" in block.command[0] else "in PATH"
        message = f"found {show(block.command[0])}, expected a program that can be run, {place}"
        yield Issue((*location, "command"), message)
    if os.path.isabs(block.folder):
        message = (
            f"found {show(block.folder)}: files are taken from there, which is meant for copies of a scenario alone"
        )
        yield Issue((*location, "folder"), message, warning=True)
    else:
        yield from _stays_inside(folder, ".", block.folder, (*location, "folder"))
    for k, name in enumerate(block.files):
        yield from file_exists(folder, name, "a file to copy,", (*location, "files", k))
        yield from _stays_inside(folder, block.folder, name, (*location, "files", k))
    if block.keep_failed is not None:
        yield from _stays_inside(folder, block.folder, block.keep_failed, (*location, "keep_failed"))
    written: dict[str, Location] = {}
    for name in (*block.templates, *(Path(name).name for name in block.files), block.output):
        where = (*location, "templates", name) if name in block.templates else location
        if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts or not name:
            message = f"found {show(name)}, expected the name of a file in the folder that the run gets"
            yield Issue((*location, "output") if name == block.output else where, message)
        elif name in written:
            yield Issue(where, f"found the file {show(name)} twice in the folder of a run, expected it once")
        written[name] = where
    for name, template in block.templates.items():
        where = (*location, "templates", name)
        yield from _stays_inside(folder, block.folder, template, where)
        if missing := list(file_exists(folder, template, "a template,", where)):
            yield from missing
        else:
            yield from _check_template(folder / template, template, external, where)


def _stays_inside(folder: Path, home: str, name: str, location: Location) -> Iterator[Issue]:
    """A name is that of something in `home`, which for all but copies is the scenario's folder."""
    home = os.path.realpath(folder / home)
    if not Path(os.path.realpath(folder / name)).is_relative_to(home):
        message = f"found {show(name)}, outside of the scenario's folder, expected a name inside of it"
        yield Issue(location, message)


def _check_template(path: Path, name: str, external: External, location: Location) -> Iterator[Issue]:
    """Syntax, and names that nothing defines; nothing is rendered."""
    from jinja2 import Environment, TemplateSyntaxError, meta, nodes

    try:
        tree = Environment().parse(path.read_text(encoding="utf-8"))
    except TemplateSyntaxError as error:
        yield Issue(location, f"found the template {show(name)}, whose line {error.lineno} is wrong: {error.message}")
        return
    except (OSError, UnicodeDecodeError) as error:
        yield Issue(location, f"found the template {show(name)}, which cannot be read as UTF-8: {error}")
        return
    for wrong in sorted(meta.find_undeclared_variables(tree) - {*_TEMPLATE_NAMES}):
        yield Issue(location, f"template {show(name)}: {unknown('placeholder', wrong, _TEMPLATE_NAMES)}")
    for node in tree.find_all((nodes.Getattr, nodes.Getitem)):
        assert isinstance(node, (nodes.Getattr, nodes.Getitem))
        if not isinstance(node.node, nodes.Name) or node.node.name != "inputs":
            continue
        key = node.attr if isinstance(node, nodes.Getattr) else getattr(node.arg, "value", None)
        if isinstance(key, str) and key not in external.inputs and not hasattr({}, key):
            yield Issue(
                location, f"template {show(name)}, line {node.lineno}: {unknown('input', key, external.inputs)}"
            )
