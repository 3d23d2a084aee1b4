"""Plates and boxes that a network is meshed from, as a scenario or a spacecraft file writes them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from .fields import Block, Count, Pair, Part
from .units import Quantity

_Length = Annotated[float, Quantity("m")]
_Thickness = Annotated[float, Quantity("m", above=0)]
_Cells = Annotated[Count, Field(ge=1, le=100)]
_ContactConductance = Annotated[float, Quantity("W/m/K", above=0)]


@dataclass(frozen=True)
class Material(Part):
    """What plates are made of."""

    conductivity: Annotated[float, Quantity("W/m/K", above=0)]
    """W/(m K), in the plane."""
    density: Annotated[float, Quantity("kg/m^3", above=0)]
    """kg/m^3"""
    specific_heat: Annotated[float, Quantity("J/kg/K", above=0)]
    """J/(kg K)"""


@dataclass(frozen=True)
class Coating(Part):
    """A surface."""

    absorptivity: Annotated[float, Quantity("", at_least=0, at_most=1)]
    emissivity: Annotated[float, Quantity("", above=0, at_most=1)]


@dataclass(frozen=True)
class Insulation(Part):
    """Multi-layer insulation over a side: its outer layer radiates to space and to the plate below."""

    effective_emissivity: Annotated[float, Quantity("", above=0, at_most=1)]
    coating: str
    """Of the outer layer."""
    heat_capacity: Annotated[float, Quantity("J/K/m^2", above=0)] = 77.0
    """Of the outer layer, J/(m^2 K): 50 um of polyimide (1420 kg/m^3, 1090 J/(kg K)). Without one its temperature would
    jump by 200 K when the Sun comes up, farther than a step that solves linear equations can follow."""


@dataclass(frozen=True)
class Side(Part):
    """One side of a plate."""

    coating: str
    enclosure: str | None = None
    """Which one it looks into; null: outside."""
    insulation: str | None = None


@dataclass(frozen=True)
class Plate(Part):
    """A rectangle whose edges are parallel to the body axes, and its mesh."""

    corner: tuple[_Length, _Length, _Length]
    """With the smallest coordinates, m."""
    size: tuple[_Length, _Length, _Length]
    """Along x, y, z, m; exactly one is zero: the plate's normal."""
    thickness: _Thickness
    """m"""
    material: str
    mesh: tuple[_Cells, _Cells]
    """Cells along the two edges, in the order of the axes."""
    positive: Side | None = None
    """The side towards larger coordinates; null: adiabatic."""
    negative: Side | None = None

    @property
    def axis(self) -> int:
        """0, 1 or 2: that of the normal."""
        return self.size.index(0.0)

    @property
    def edges(self) -> tuple[int, int]:
        """The axes of the two edges."""
        first, second = (k for k in range(3) if k != self.axis)
        return first, second


@dataclass(frozen=True)
class Box(Part):
    """Six plates, ``<box>.x-`` to ``<box>.z+``; the inside is an enclosure named after the box."""

    corner: tuple[_Length, _Length, _Length]
    size: tuple[_Length, _Length, _Length]
    thickness: _Thickness
    material: str
    mesh: Annotated[Count, Field(ge=1, le=20)]
    """Cells along each edge."""
    outside: Side
    inside: str
    """Coating."""
    joints: _ContactConductance
    """Conductance of its edges."""


@dataclass(frozen=True)
class Joint(Part):
    """Two plates that touch along an edge."""

    between: Pair
    conductance: _ContactConductance
    """W/K for each metre of the edge."""


class Body(Block):
    """Plates and boxes, what they are made of, and how plates are joined; each by its name."""

    materials: dict[str, Material] = Field(default_factory=dict)
    coatings: dict[str, Coating] = Field(default_factory=dict)
    insulations: dict[str, Insulation] = Field(default_factory=dict)
    boxes: dict[str, Box] = Field(default_factory=dict)
    plates: dict[str, Plate] = Field(default_factory=dict)
    joints: tuple[Joint, ...] = ()
