"""How the body is turned: the block `environment: attitude`."""

from __future__ import annotations

import math
from datetime import datetime
from typing import Annotated, Any, Literal, TypeGuard, cast, get_args

from pydantic import AfterValidator, Field, model_validator

from .document import Issue
from .fields import Block, FileName, Number, OneOf, Time, Vector, of_length
from .units import Duration, Quantity, did_you_mean, show
from .wording import refusal


def _check_length(quaternion: tuple[float, ...]) -> tuple[float, ...]:
    if not any(quaternion):
        raise ValueError("found a quaternion of length 0, expected length 1 (w, x, y, z)")
    return quaternion


Quaternion = Annotated[
    tuple[Number, Number, Number, Number], of_length(4, "four numbers [w, x, y, z]"), AfterValidator(_check_length)
]


class InertialAttitude(Block):
    """Body axes fixed in inertial space: unit quaternion (w, x, y, z), from body to inertial vectors."""

    inertial: Quaternion


class SpinningAttitude(Block):
    """Spin about a body axis that points along an inertial direction."""

    spin_axis: Vector
    """In the body."""
    direction: Vector
    """Inertial direction that the spin axis points to."""
    period: Duration | None = None
    """null: fast spin; fluxes are averaged over one turn."""
    phase: Annotated[float, Quantity("rad")] = 0.0
    """Turned by at `epoch`, from where the shortest turn from `spin_axis` to `direction` leaves the body."""
    epoch: Time = datetime(2000, 1, 1, 12)


def spins_fast(attitude: object) -> TypeGuard[SpinningAttitude]:
    """Whether the body turns so fast that fluxes are means over a turn."""
    return isinstance(attitude, SpinningAttitude) and attitude.period is None


Target = Literal["nadir", "sun", "velocity", "orbit_normal", "ecliptic_north"]
"""The orbit's normal is along its angular momentum."""


class Pointing(Block):
    """An axis of the body, and what it points towards."""

    axis: Vector
    """In the body."""
    towards: Annotated[
        Target | Vector,
        OneOf(
            lambda value: Target if isinstance(value, str) else Vector,
            f"one of {', '.join(get_args(Target))}, or an inertial direction [x, y, z]",
        ),
    ]


class AlignedAttitude(Block):
    """One axis of the body points towards one thing, and a second one as near as it can towards another."""

    aligned: Pointing
    constrained: Pointing

    @model_validator(mode="after")
    def _two_axes(self) -> AlignedAttitude:
        for key in ("axis", "towards"):
            one, other = getattr(self.aligned, key), getattr(self.constrained, key)
            named = isinstance(one, str) or isinstance(other, str)
            if one == other if named else _parallel(one, other):
                message = f"found {_written(other)}, expected another direction than 'aligned' has, {_written(one)}"
                raise refusal(Issue(("constrained", key), message))
        return self


def _written(direction: str | Vector) -> str:
    return show(direction) if isinstance(direction, str) else f"[{', '.join(f'{number:g}' for number in direction)}]"


def _parallel(one: Vector, other: Vector) -> bool:
    """Whether two directions are along one line."""
    dot = sum(a * b for a, b in zip(one, other, strict=True))
    return math.isclose(abs(dot), math.hypot(*one) * math.hypot(*other), rel_tol=1e-6)


class SampledAttitude(Block):
    """Quaternions from a CSV file with a column time (ISO 8601 UTC) and one for each component."""

    quaternions: FileName
    columns: tuple[str, str, str, str] = ("w", "x", "y", "z")
    """What the file calls the real part and the other three."""
    turns: Literal["body_to_inertial", "inertial_to_body"] = "body_to_inertial"
    """Which vectors the quaternions turn into which."""


NamedAttitude = Literal["nadir", "sun_pointing"]


def _one_kind(value: Any) -> Any:
    if isinstance(value, str):
        return NamedAttitude
    if not isinstance(value, dict):
        return None
    if "inertial" in value:
        return InertialAttitude
    if {"aligned", "constrained"} & set(value):
        return AlignedAttitude
    return SampledAttitude if "quaternions" in value else SpinningAttitude


_KINDS = "an attitude: nadir, sun_pointing, or a mapping with 'aligned', 'inertial', 'spin_axis'"
OneAttitude = Annotated[
    NamedAttitude | AlignedAttitude | InertialAttitude | SpinningAttitude | SampledAttitude,
    OneOf(_one_kind, f"{_KINDS} or 'quaternions'"),
]


class AttitudeChange(Block):
    """From a time on the body is turned to another attitude."""

    at: Time
    attitude: Annotated[str | OneAttitude, OneOf(lambda value: str if isinstance(value, str) else OneAttitude, _KINDS)]
    """An attitude, or the name of one of those that the timeline names."""


class AttitudeTimeline(Block):
    """One attitude after another; before the first change the first one holds."""

    named: dict[str, OneAttitude] = Field(default_factory=dict)
    """Attitudes by the names that the timeline gives them."""
    timeline: tuple[AttitudeChange, ...] = ()
    timeline_file: FileName | None = None
    """CSV file with columns at (UTC) and attitude, in the place of `timeline`: a row for each change or sample."""
    slew: Annotated[float, Quantity("s", at_least=1.0)] = 120.0
    """How long each change takes, from its time on: a turn about one axis, at a constant rate."""

    @model_validator(mode="after")
    def _one_after_another(self) -> AttitudeTimeline:
        if not self.timeline and self.timeline_file is None:
            raise ValueError("found no change, expected at least one in 'timeline', or a 'timeline_file'")
        problems = []
        for k, change in enumerate(self.timeline):
            kind = self.attitude_of(change)
            place = ("timeline", k, "attitude")
            if kind is None:
                names = [*self.named, *get_args(NamedAttitude)]
                hint = did_you_mean(str(change.attitude), names)
                problems.append(
                    Issue(place, f"found {show(change.attitude)}, expected one of {', '.join(names)}{hint}")
                )
            elif spins_fast(kind):
                problems.append(Issue(place, "found a spin without period, expected one: the body slews from it"))
            before = self.timeline[k - 1].at if k else None
            if before is not None and (change.at - before).total_seconds() < self.slew:
                message = (
                    f"found {change.at.isoformat()}, expected a time after the slew of {self.slew:g} s that begins"
                )
                problems.append(Issue(("timeline", k, "at"), f"{message} at {before.isoformat()}"))
        if problems:
            raise refusal(*problems)
        return self

    def attitude_of(self, change: AttitudeChange) -> OneAttitude | None:
        """What the body is turned to; None: the name is not known."""
        if not isinstance(change.attitude, str):
            return change.attitude
        if change.attitude in self.named:
            return self.named[change.attitude]
        return cast("OneAttitude", change.attitude) if change.attitude in get_args(NamedAttitude) else None

    @property
    def attitudes(self) -> tuple[OneAttitude, ...]:
        """After each change."""
        found = [self.attitude_of(change) for change in self.timeline]
        return tuple(kind for kind in found if kind is not None)


def _attitude_kind(value: Any) -> Any:
    if isinstance(value, dict) and {"timeline", "timeline_file", "named", "slew"} & set(value):
        return AttitudeTimeline
    return _one_kind(value) and OneAttitude


Attitude = Annotated[
    NamedAttitude | AlignedAttitude | InertialAttitude | SpinningAttitude | SampledAttitude | AttitudeTimeline,
    OneOf(_attitude_kind, f"{_KINDS}, 'quaternions' or 'timeline'"),
]


class AttitudeOffset(Block):
    """Small rotation of the body against its attitude, about its own axes; heat fluxes are taken as linear in it."""

    x: Annotated[float, Quantity("rad", at_least=-0.1, at_most=0.1)] = 0.0
    y: Annotated[float, Quantity("rad", at_least=-0.1, at_most=0.1)] = 0.0
    z: Annotated[float, Quantity("rad", at_least=-0.1, at_most=0.1)] = 0.0
