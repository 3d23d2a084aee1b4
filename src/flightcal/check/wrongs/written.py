"""What the scenario writes of orbit and attitude, and its numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ...report import number
from ...scenario import CircularOrbit
from ..evidence import View
from .wrong import FACTORS, Words, Wrong, driven_otherwise, duration


def attitudes(view: View) -> Iterator[Wrong]:
    """Another attitude than the scenario's."""
    environment = view.window.scenario.environment
    if environment.orbit is None or not view.window.scenario.network.faces:
        return
    for attitude in ("nadir", "sun_pointing"):
        if attitude == environment.attitude:
            continue
        changed = environment.model_copy(update={"attitude": attitude})
        scenario = view.window.scenario.model_copy(update={"environment": changed})
        words = Words(
            f"The satellite flew {attitude.replace('_', '-')}",
            f"With the attitude '{attitude}', sunlight and Earth's heat explain the telemetry.",
            f"Write 'attitude: {attitude}' in 'environment', or check the quaternions",
        )
        yield from driven_otherwise("attitude", attitude, words, view, tries=2, scenario=scenario)


def orbits(view: View) -> Iterator[Wrong]:
    """Another plane of the orbit, or another place in it."""
    environment = view.window.scenario.environment
    orbit = environment.orbit
    if not isinstance(orbit, CircularOrbit) or not view.window.scenario.network.faces:
        return
    changes: list[tuple[str, str, dict[str, Any]]] = []
    if orbit.ltan is not None:
        hour, minute = (int(part) for part in orbit.ltan.split(":"))
        for more in range(3, 24, 3):
            text = f"{(hour + more) % 24:02d}:{minute:02d}"
            changes.append((f"ltan {text}, not {orbit.ltan}", f"ltan: {text}", {"ltan": text}))
    for height in (0.7, 1.3, 2.0):
        text = f"{orbit.altitude * height / 1e3:.0f} km"
        changes.append((f"an altitude of {text}", f"altitude: {text}", {"altitude": orbit.altitude * height}))
    for what, advice, update in changes:
        changed = environment.model_copy(update={"orbit": orbit.model_copy(update=update)})
        scenario = view.window.scenario.model_copy(update={"environment": changed})
        words = Words(
            "The orbit is another one",
            f"The telemetry agrees with {what}: its sunlight and eclipses are those of the telemetry.",
            f"Check 'environment: orbit' ({advice})",
        )
        about = next(iter(update))
        yield from driven_otherwise("orbit", about, words, view, tries=len(changes), scenario=scenario)


def places(view: View) -> Iterator[Wrong]:
    """The satellite is at another place of its orbit than the scenario says, while modes are right."""
    if not view.window.scenario.network.faces or not view.window.scenario.network.timeline:
        return
    count = 24
    for k in range(1, count):
        late = (k if k <= count // 2 else k - count) * view.window.period / count
        how = "later" if late > 0 else "earlier"
        words = Words(
            f"Sunlight and eclipses come {duration(late)} {how} than the orbit says",
            f"With the orbit moved by {duration(late)}, and the timeline of modes as it is, the model explains the "
            "telemetry.",
            "Check 'epoch' and 'argument_of_latitude' in 'environment: orbit'",
        )
        yield from driven_otherwise("orbit", "place", words, view, tries=count, sunlight=late)


def numbers(view: View) -> Iterator[Wrong]:
    """A number of the scenario has the wrong unit, or a digit too many."""
    mapping = view.network.mapping
    moved = set(mapping.set_positions.tolist())
    for k, path in enumerate(view.network.network.paths):
        first, *_, last = path.split(".")
        if first not in ("nodes", "conductors", "faces", "modes", "heaters") or k in moved:
            continue
        if last in ("on_below", "off_above", "boundary") or mapping.written[k] == 0.0:
            continue
        for factor in FACTORS:
            if last in ("absorptivity", "emissivity") and mapping.written[k] * factor > 1.0:
                continue
            written = mapping.written.copy()
            written[k] *= factor
            window = view.simulated_by(mapping=mapping._replace(written=written))
            words = Words(
                f"{path} is {number(1.0 / factor, 4)} times what it should be",
                f"The telemetry agrees with a value of {number(float(written[k]), 4)} (SI), not "
                f"{number(float(mapping.written[k]), 4)}.",
                f"Check the unit of '{path}'",
            )
            yield Wrong("number", path, words, window=window, tries=50)


WRONGS = (attitudes, orbits, places, numbers)
"""What looks for them."""
