"""Whether the pages of finished runs are the same, byte for byte, by this checkout and by another one.

python -m benchmarks.unchanged.report OTHER FOLDER...

OTHER: a checkout of flightcal. FOLDER: of a run, a comparison or a validation. A run's page is also written with each
of its files left out.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

_HERE = Path(__file__).parents[2]
_WRITE = """
import sys
from pathlib import Path
from flightcal.report import write_comparison, write_report, write_validation

for name in sys.argv[1:]:
    folder = Path(name)
    if (folder / "comparison.json").exists():
        write_comparison(folder)
    elif (folder / "validation.json").exists():
        write_validation(folder)
    else:
        write_report(folder)
"""


def main(other: Path, folders: list[Path]) -> int:
    """Write every page by both checkouts and list the pages that differ. 1: some do."""
    with TemporaryDirectory() as temporary:
        copies = [copy for place in ("here", "other") for copy in _copies(folders, Path(temporary) / place)]
        for checkout, place in ((_HERE, "here"), (other, "other")):
            names = [str(copy) for copy in copies if copy.relative_to(temporary).parts[0] == place]
            environment = {"PYTHONPATH": str(checkout.resolve() / "src"), "PATH": "/usr/bin:/bin"}
            subprocess.run([sys.executable, "-c", _WRITE, *names], check=True, env=environment)
        here, there = ({page.relative_to(root): page.read_bytes() for page in root.rglob("*.html")}
                       for root in (Path(temporary) / "here", Path(temporary) / "other"))  # fmt: skip
    differ = [str(name.parent) for name in sorted(here.keys() | there.keys()) if here.get(name) != there.get(name)]
    print(f"{len(here)} pages, {len(differ)} differ", *differ, sep="\n  ")
    return int(bool(differ))


def _copies(folders: list[Path], target: Path) -> list[Path]:
    """The folders without their pages, each run's also without one of its files."""
    made = []
    for folder in folders:
        files = [file for file in folder.iterdir() if file.suffix in (".json", ".nc", ".yaml")]
        is_run = (folder / "priors.json").exists()
        for missing in [None, *(files if is_run and len(files) > 1 else [])]:
            copy = target / folder.name / ("whole" if missing is None else f"without {missing.name}") / "run"
            copy.mkdir(parents=True)
            for file in files:
                if file != missing:
                    shutil.copy(file, copy)
            made.append(copy)
    return made


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), [Path(name) for name in sys.argv[2:]]))
