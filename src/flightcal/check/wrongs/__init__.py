"""Simple ways in which a scenario and its telemetry may not belong together; one module and one line here a family."""

from collections.abc import Iterator
from contextlib import suppress

from ...simulator import SimulationFailure
from ..compared_window import ComparedWindow
from ..network_view import View
from . import attitude, channels, clocks, drivers, faces, heat, heaters, lacking, orbit, slow, timeline, written
from .channels import COLDEST, HOTTEST, in_other_units
from .clocks import clocks_as_read
from .wrong import SHIFT, SHIFTS, Words, Wrong

_FAMILIES = (channels, clocks, faces, heaters, heat, drivers, timeline, attitude, orbit, slow, lacking, written)
_WRONGS = tuple(wrong for family in _FAMILIES for wrong in family.WRONGS)


def all_wrongs(view: View) -> Iterator[Wrong]:
    """Every simple wrong that can be tried on a view: of a family, up to one for which a simulation fails."""
    for wrongs in _WRONGS:
        with suppress(SimulationFailure):
            yield from wrongs(view)


def wrongs_of_channels(view: ComparedWindow) -> Iterator[Wrong]:
    """Those that can be tried beside any simulator."""
    for wrongs in (*channels.OF_ANY, clocks.channel_clocks):
        yield from wrongs(view)


__all__ = [
    "COLDEST",
    "HOTTEST",
    "SHIFT",
    "SHIFTS",
    "Words",
    "Wrong",
    "all_wrongs",
    "clocks_as_read",
    "in_other_units",
    "wrongs_of_channels",
]
