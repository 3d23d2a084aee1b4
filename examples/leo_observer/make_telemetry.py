"""Makes telemetry.csv: flies spacecraft.yaml, and does to its telemetry what happens on the way to the ground.

Seeds are fixed: run it again and the file is the same, byte for byte.

    python examples/leo_observer/make_telemetry.py
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from flightcal.commands.fly import fly_to_csv

FOLDER = Path(__file__).parent
FIRST_ROW = "2024-03-01T00:00:00"
"""What was sent before was not kept."""
OUTAGES = (range(341, 367), range(456, 461))
"""Rows without reception."""
FROZEN = range(185, 193)
"""Rows in which the ground system repeats the row before."""
INVALID = {"TT_PEL": (131, 132, 420), "TT_TANK": (247, 500, 501), "TT_ARR": (260,)}
MARKER = "-999.0"


def received(sent: list[str]) -> list[str]:
    """The lines of the file that the ground keeps, of those that the spacecraft sent."""
    header, *rows = sent
    columns = header.split(",")
    cells = [row.split(",") for row in rows if row >= FIRST_ROW]
    for name, numbers in INVALID.items():
        for number in numbers:
            cells[number][columns.index(name)] = MARKER
    for number in FROZEN:
        cells[number][1:] = cells[number - 1][1:]
    lost = {number for outage in OUTAGES for number in outage}
    return [header, *(",".join(row) for number, row in enumerate(cells) if number not in lost)]


def main(file: Path = FOLDER / "telemetry.csv") -> None:
    """Fly and write the file."""
    with tempfile.TemporaryDirectory() as folder:
        flight = Path(folder) / "flight.csv"
        fly_to_csv(FOLDER / "spacecraft.yaml", flight, pace=None)
        sent = flight.read_text(encoding="utf-8").splitlines()
    file.write_text("\n".join(received(sent)) + "\n", encoding="ascii", newline="\n")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
