"""A scenario to start from."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

from ..errors import ScenarioError


def write_template(folder: str | Path) -> list[Path]:
    """Writes a commented scenario and made-up telemetry into `folder` (made if need be); returns the files' paths.

    Raises ScenarioError where one of the files is there already, or the folder cannot be written.
    """
    sources = {"scenario.yaml": "template.yaml", "telemetry.csv": "template.csv"}
    return write_new(
        Path(folder),
        {name: (files(__package__) / source).read_text(encoding="utf-8") for name, source in sources.items()},
    )


def write_new(target: Path, texts: Mapping[str, str]) -> list[Path]:
    """Writes files, by name, into a folder; returns their paths. Raises ScenarioError as `write_template` does."""
    for name in texts:
        if (target / name).exists():
            raise ScenarioError(f"{target / name}: found a file, expected none: nothing is overwritten")
    try:
        target.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            # "x" fails where the file has appeared meanwhile.
            with (target / name).open("x", encoding="utf-8", newline="\n") as file:
                file.write(text)
    except OSError as error:
        raise ScenarioError(f"{target}: cannot be written: {error.strerror}") from None
    return [target / name for name in texts]
