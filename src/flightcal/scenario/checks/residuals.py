"""Noise and discrepancy: what goes together, and priors of what they are made of."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..blocks import Blocks, External, readable
from ..document import Issue, Location
from ..external import PythonFunction, Umbridge
from ..priors import support
from ..reading import Reading
from ..residuals import NEEDS, Noise
from .common import known

_POSITIVE = "expected one of positive values: half_normal, lognormal or truncated_normal"


def check(reading: Reading, folder: Path) -> Iterator[Issue]:
    """Noise has what its model has; a discrepancy stands beside normal noise, and its lengthscales have bounds."""
    blocks = reading.blocks
    if blocks.noise is not None:
        yield from _check_noise(blocks.noise, ("noise",))
    for name, observation in readable(blocks.observations).items():
        place = ("observations", name, "noise")
        written = observation.noise
        if isinstance(written, Noise):
            yield from _check_noise(written, place)
        elif written is not None:
            yield from _check_positive(written, place)
        noise = written if isinstance(written, Noise) else blocks.noise if written is None else None
        if noise is not None and observation.heater is None:
            yield from _check_channel(noise, blocks, name, place if isinstance(written, Noise) else ("noise",))
    yield from _check_discrepancy(blocks)


def _check_noise(noise: Noise, location: Location) -> Iterator[Issue]:
    written = noise.model_fields_set
    for key, (needed, value) in NEEDS.items():
        if key in written and getattr(noise, key) is not None and getattr(noise, needed) != value:
            yield Issue((*location, key), f"found {key!r} without '{needed}: {value}', expected both or neither")
    if noise.quantisation is not None and (noise.model, noise.distribution) != ("iid", "normal"):
        message = f"found 'quantisation' with {noise.model} {noise.distribution} noise, expected iid normal noise"
        yield Issue((*location, "quantisation"), f"{message}: only its probability of a step is known exactly")
    if noise.distribution == "student_t" and noise.white is not None:
        message = "found 'white' beside correlated Student's t noise, expected 'distribution: normal'"
        yield Issue((*location, "white"), f"{message}: the two cannot be told apart exactly")
    for key in ("standard_deviation", *NEEDS):
        yield from _check_positive(getattr(noise, key), (*location, key))


def _check_positive(value: Any, location: Location) -> Iterator[Issue]:
    if value is not None and not isinstance(value, float) and support(value)[0] < 0:
        yield Issue(location, f"found a {value.kind} prior with negative values, {_POSITIVE}")


def _check_channel(noise: Noise, blocks: Blocks, channel: str, location: Location) -> Iterator[Issue]:
    kind = noise.not_normal
    if kind is None:
        return
    has_discrepancy = blocks.discrepancy is not None and (
        not blocks.discrepancy.channels or channel in blocks.discrepancy.channels
    )
    beside = (
        (has_discrepancy, "a discrepancy"),
        (blocks.has_errors, "'simulator.errors'"),
        (_is_emulated(blocks.external), "the error of an emulator, which simulators without derivatives get"),
    )
    for there, what in beside:
        if there:
            message = f"found {kind} noise of {channel!r} beside {what}, expected normal noise"
            yield Issue(location, f"{message}: only with that can its weights be integrated out")
    source = blocks.channels.get(channel)
    if noise.quantisation is not None and source is not None and len(source.column) > 1:
        message = f"found 'quantisation' of {channel!r}, which is made of {len(source.column)} columns"
        yield Issue((*location, "quantisation"), f"{message}, expected one column: their {source.combine} has no steps")


def _is_emulated(external: External | None) -> bool:
    """Whether an emulator surely takes the simulator's place; only its server knows of an UM-Bridge model."""
    if external is None or external.block is None or isinstance(external.block, Umbridge):
        return False
    return not (isinstance(external.block, PythonFunction) and external.block.gradient == "jax")


def _check_discrepancy(blocks: Blocks) -> Iterator[Issue]:
    discrepancy = blocks.discrepancy
    if discrepancy is None:
        return
    temperatures = [name for name, item in blocks.observations.items() if item is None or item.heater is None]
    for k, name in enumerate(discrepancy.channels):
        yield from known("observed temperature channel", name, temperatures, ("discrepancy", "channels", k))
    yield from _check_positive(discrepancy.phase.amplitude, ("discrepancy", "phase", "amplitude"))
    length = discrepancy.phase.lengthscale
    if not isinstance(length, float):
        lower, upper = support(length)
        if not (lower > 0.0 and math.isfinite(upper)):
            message = f"found a {length.kind} prior from {lower:g} to {upper:g}, expected two bounds above zero"
            wanted = "uniform, truncated_normal or beta, or the discrepancy becomes noise or takes up parameters"
            yield Issue(("discrepancy", "phase", "lengthscale"), f"{message}: {wanted}")
