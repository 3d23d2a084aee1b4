"""Simple ways in which a scenario and its telemetry may not belong together; one module and one line here a family."""

from collections.abc import Iterator
from contextlib import suppress

from ...simulator import SimulationFailure
from ..view import View
from . import channels, clocks, drivers, faces, heat, heaters, orbit, slow, timeline, written
from .wrong import Words, Wrong

_FAMILIES = (channels, clocks, faces, heaters, heat, drivers, timeline, orbit, slow, written)
_WRONGS = tuple(wrong for family in _FAMILIES for wrong in family.WRONGS)


def all_wrongs(view: View) -> Iterator[Wrong]:
    """Every simple wrong that can be tried on a view: of a family, up to one for which a simulation fails."""
    for wrongs in _WRONGS:
        with suppress(SimulationFailure):
            yield from wrongs(view)


__all__ = ["Words", "Wrong", "all_wrongs"]
