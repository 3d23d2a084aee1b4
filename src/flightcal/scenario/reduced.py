"""A reduced order model in a scenario: its file's blocks, with what the scenario writes over them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from .document import Issue
from .units import did_you_mean, show, to_si

_HERE = ("simulator", "reduced_model")
_SECTIONS = ("nodes", "faces", "heaters", "modes")
REDUCED_MODEL_FORMAT = "4"


def fill_in(written: dict[str, Any], folder: Path) -> tuple[dict[str, Any], list[Issue]]:
    """The simulator's block with what its reduced model says; a block without one as it is."""
    name, missing = written.get("reduced_model"), _missing(written.get("checked_on"), folder)
    if name is None:
        if written.get("reduced"):
            expected = "expected 'reduced_model' beside it: these are numbers of a reduced model"
            missing.append(Issue(("simulator", "reduced"), f"found 'reduced', {expected}"))
        return written, missing
    if not isinstance(name, str):
        return written, [Issue(_HERE, f"found {show(name)}, expected the name of a file that 'flightcal reduce' wrote")]
    about, wrong = _read(folder / name)
    if about is None:
        return {**written, "nodes": {}}, [Issue(_HERE, f"found {show(name)}, {wrong}")]
    numbers, problems = _with_numbers(about["parameters"], written.get("reduced"))
    filled_in = {"reduced_numbers": numbers, "full_nodes": about["simulator"]["full_nodes"]}
    block = {**about["simulator"], **written, **filled_in}
    problems += missing
    for section in _SECTIONS:
        known = about["simulator"].get(section, {})
        changes = written.get(section, {})
        if not isinstance(changes, dict):
            continue
        for key in changes:
            if key not in known:
                message = f"found {show(key)}, which the reduced model does not have{did_you_mean(str(key), known)}"
                problems.append(Issue(("simulator", section, key), message))
        block[section] = {
            key: {**value, **changes[key]} if isinstance(changes.get(key), dict) else value
            for key, value in known.items()
        }
    block.setdefault("errors", {})
    if not written.get("errors"):
        block["errors"] = about["errors"]
    return block, problems


def _with_numbers(known: dict[str, Any], written: Any) -> tuple[dict[str, Any], list[Issue]]:
    """The file's numbers, by ``reduced.<name>``, with the values that the scenario writes."""
    numbers, problems = dict(known), []
    for name, value in (written if isinstance(written, dict) else {}).items():
        path, location = f"reduced.{name}", ("simulator", "reduced", name)
        if path not in known:
            message = f"found {show(name)}, which the reduced model does not have"
            names = [number.removeprefix("reduced.") for number in known]
            problems.append(Issue(location, f"{message}{did_you_mean(str(name), names)}"))
            continue
        try:
            numbers[path] = {**known[path], "value": to_si(value, known[path]["unit"])}
        except ValueError as error:
            problems.append(Issue(location, str(error)))
    return numbers, problems


def _missing(name: Any, folder: Path) -> list[Issue]:
    """What is wrong with the reduction file that posterior draws are to be checked on."""
    if not isinstance(name, str) or (folder / name).is_file():
        return []
    message = f"found {show(name)}, which is not there, expected a path relative to the scenario"
    return [Issue(("simulator", "checked_on"), message)]


def _read(path: Path) -> tuple[Any, str]:
    """What a file says of itself; or null, and what is wrong with it."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("flightcal_reduced_model") != REDUCED_MODEL_FORMAT:
                return None, "which is not a reduced model of this version, expected one that 'flightcal reduce' wrote"
            return json.loads(file.attrs["about"]), ""
    except FileNotFoundError:
        return None, "which is not there, expected a path relative to the scenario"
    except (OSError, KeyError, ValueError) as error:
        return None, f"which cannot be read as a reduced model: {error}"
