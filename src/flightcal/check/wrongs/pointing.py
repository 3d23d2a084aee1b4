"""Stretches in which the satellite was in another attitude than the scenario says."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from datetime import timedelta
from functools import partial
from typing import Any

from ...errors import FlightcalError
from ...scenario import AlignedAttitude, AttitudeChange, AttitudeTimeline, Pointing, SunTracking, spins_fast
from ...simulator import FloatArray
from ..network_view import View
from .normals import AXES, alike, turnable, written
from .stretches import Flown, Nats, Stretch, flown_otherwise, with_stretches
from .wrong import Wrong, attitude_of, brought, elsewhere, shine, span_of


def otherwise_pointed(view: View, z: FloatArray, nats: Nats) -> Iterator[Wrong]:
    """Stretches of the window in another attitude that has a name: a slew that the scenario lacks, or a safe mode.

    Heat is the prior's median of what faces absorb, z [d] where its effects are simulated. Raises SimulationFailure.
    """
    attitude = _timeline(view)
    if attitude is None:
        return
    attitude = _with_wing_to_the_sun(view, attitude)
    names = dict.fromkeys([*attitude.named, *_written(attitude), "nadir", "sun_pointing"])
    absorbed, more = _absorbed(view, attitude), {}
    for name in names:
        change = attitude.timeline[0].model_copy(update={"attitude": name})
        with suppress(FlightcalError):  # its quaternions are not known so long
            more[name] = _absorbed(view, attitude.model_copy(update={"timeline": (change,)})) - absorbed
    flown = Flown(
        "attitude",
        "The satellite was in",
        "in another attitude",
        "Check 'environment: attitude' against what was flown: a timeline says when it changes",
        partial(_driven, view, attitude),
    )
    yield from flown_otherwise(view, z, more, nats, flown)


def _timeline(view: View) -> AttitudeTimeline | None:
    """The scenario's attitudes one after another; None: there is none, or nothing depends on it."""
    attitude = attitude_of(view)
    if attitude is None or spins_fast(attitude):
        return None
    if isinstance(attitude, AttitudeTimeline):
        return attitude
    return AttitudeTimeline(timeline=(AttitudeChange(at=span_of(view)[0] - timedelta(days=1), attitude=attitude),))


def _with_wing_to_the_sun(view: View, attitude: AttitudeTimeline) -> AttitudeTimeline:
    """With the face that takes most of the Sun turned to it, among those that have names: so batteries are charged."""
    fixed = {name: way for name, way in turnable(view).items() if not isinstance(way, SunTracking)}
    faces = view.window.scenario.network.faces
    if not fixed:
        return attitude
    way = fixed[max(fixed, key=lambda name: faces[name].area * faces[name].absorptivity)]
    other = min(AXES, key=lambda axis: (abs(alike(axis, way)), -axis[2]))
    charging = AlignedAttitude(
        aligned=Pointing(axis=way, towards="sun"), constrained=Pointing(axis=other, towards="nadir")
    )
    named = {f"{written(way)} to the Sun": charging, **attitude.named}
    return attitude.model_copy(update={"named": named})


def _written(attitude: AttitudeTimeline) -> list[str]:
    return [change.attitude for change in attitude.timeline if isinstance(change.attitude, str)]


def _absorbed(view: View, attitude: AttitudeTimeline) -> FloatArray:
    """[h, 2 K] W that flow into heated nodes in an attitude, in the steps of the view's window, all else apart.

    Raises OrbitError.
    """
    inputs = view.network.drive.inputs.copy()
    shine(view, elsewhere(view, attitude=attitude), inputs, view.network.drive.times)
    return brought(view, inputs)


def _driven(view: View, attitude: AttitudeTimeline, stretches: Sequence[Stretch]) -> dict[str, Any]:
    """With stretches in the place of what was there."""
    changes = with_stretches(attitude.timeline, stretches, AttitudeChange, "attitude")
    return {"scenario": elsewhere(view, attitude=attitude.model_copy(update={"timeline": changes}))}
