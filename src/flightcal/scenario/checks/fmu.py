"""What an FMU says of itself: its description is read; its code is not loaded."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from ..blocks import External, readable
from ..document import Issue, Location
from ..external import Fmu
from ..units import show
from .common import file_exists, known

_DESCRIPTION = "modelDescription.xml"
_MOST = 50_000_000
"""Bytes of a description that are read at most."""
_REAL = ("Real", "Float64", "Float32")


def check_fmu(block: Fmu, external: External, folder: Path, location: Location) -> Iterator[Issue]:
    """The file is a co-simulation FMU of version 2 or 3 with the variables that the scenario names."""
    here = (*location, "file")
    path = folder / block.file
    if missing := list(file_exists(folder, block.file, "an FMU,", here)):
        yield from missing
        return
    try:
        with zipfile.ZipFile(path) as archive:
            if archive.getinfo(_DESCRIPTION).file_size > _MOST:
                raise ValueError("its description is too long")
            root = ElementTree.fromstring(archive.read(_DESCRIPTION))
    except (zipfile.BadZipFile, KeyError, ElementTree.ParseError, OSError, ValueError) as error:
        reason = f"it has no {_DESCRIPTION}" if isinstance(error, KeyError) else str(error)
        yield Issue(here, f"found {show(block.file)}, which is not an FMU: {reason}")
        return
    version = root.get("fmiVersion", "")
    if version.partition(".")[0] not in ("2", "3"):
        yield Issue(here, f"found an FMU of FMI version {show(version)}, expected version 2 or 3")
        return
    if root.find("CoSimulation") is None:
        yield Issue(here, "found an FMU for model exchange only, expected one for co-simulation")
    yield from _check_variables(block, external, _causalities(root), location)


def _causalities(root: ElementTree.Element) -> dict[str, str]:
    """Causality of each real variable by name."""
    found = {}
    for variable in root.iterfind("ModelVariables/*"):
        kind = variable.find("Real") if variable.tag == "ScalarVariable" else variable
        if kind is not None and kind.tag in _REAL:
            found[variable.get("name", "")] = variable.get("causality", "local")
    return found


def _check_variables(block: Fmu, external: External, causality: dict[str, str], location: Location) -> Iterator[Issue]:
    named = {section: readable(getattr(external, section)) for section in ("inputs", "outputs", "heaters")}
    for section, blocks in named.items():
        for name, item in blocks.items():
            variable = item.name or name
            where: Location = ("simulator", section, name)
            yield from known("real variable of the FMU", variable, causality, where)
            kind = causality.get(variable, "input")
            if section == "inputs" and kind not in ("parameter", "input", "local"):
                message = f"found the variable {show(variable)}, {_article(kind)} of the FMU"
                yield Issue(where, f"{message}, expected a parameter or an input")
    taken = {item.name or name for name, item in named["inputs"].items()}
    for variable in block.drivers:
        where = (*location, "drivers", variable)
        yield from known("real variable of the FMU", variable, causality, where)
        kind = causality.get(variable, "input")
        if kind != "input":
            yield Issue(where, f"found the variable {show(variable)}, {_article(kind)} of the FMU, expected an input")
        elif variable in taken:
            yield Issue(where, f"found the variable {show(variable)}, which 'inputs' sets too, expected it once")


def _article(causality: str) -> str:
    return f"{'an' if causality[0] in 'aeiou' else 'a'} {causality}"
