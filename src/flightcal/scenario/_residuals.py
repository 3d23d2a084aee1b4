"""How noise and discrepancy are written: their numbers and priors to SI and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ._document import Location, Problem
from ._priors import FORMS, read_prior, written_prior
from ._units import Quantity, written
from .residuals import NEEDS, NOISE, Discrepancy, Noise
from .schema import Observation

_STAND_IN = 1.0
"""For a number with problems of its own, so that the rest of its block is still checked."""
TIME = {"amplitude": Quantity("K", above=0.0, difference=True), "lengthscale": Quantity("s", above=0.0)}
PHASE = {"amplitude": Quantity("K", above=0.0, difference=True), "lengthscale": Quantity("", above=0.0)}
"""Numbers of the blocks, which are known or have priors."""


def read_noise(value: Any, location: Location) -> tuple[Any, list[Problem]]:
    """A channel's noise: a standard deviation or its prior, or a mapping whose numbers are read."""
    if isinstance(value, dict) and not (len(value) == 1 and set(value) <= set(FORMS)):
        return _read_numbers(value, location, NOISE)
    return read_uncertain(value, location, NOISE["standard_deviation"])


def read_noise_block(value: Any, location: Location) -> tuple[Any, list[Problem]]:
    """The scenario's noise, with its numbers read."""
    return _read_numbers(value, location, NOISE) if isinstance(value, dict) else (value, [])


def read_discrepancy(value: Any, location: Location) -> tuple[Any, list[Problem]]:
    """The discrepancy, with its numbers read."""
    if not isinstance(value, dict):
        return value, []
    value, problems = dict(value), []
    for key, quantities in (("time", TIME), ("phase", PHASE)):
        if isinstance(value.get(key), dict):
            value[key], found = _read_numbers(value[key], (*location, key), quantities)
            problems += found
    return value, problems


def read_uncertain(value: Any, location: Location, quantity: Quantity) -> tuple[Any, list[Problem]]:
    """A number with its unit, or a prior, in SI."""
    if isinstance(value, dict):
        prior = read_prior(value, quantity.unit, location, difference=quantity.difference)
        return (_STAND_IN, prior) if isinstance(prior, list) else (prior, [])
    try:
        return quantity.read(value), []
    except ValueError as error:
        return _STAND_IN, [Problem(location, str(error))]


def _read_numbers(
    block: dict[str, Any], location: Location, quantities: Mapping[str, Quantity]
) -> tuple[dict[str, Any], list[Problem]]:
    block, problems = dict(block), []
    for key, quantity in quantities.items():
        if block.get(key) is not None:
            block[key], found = read_uncertain(block[key], (*location, key), quantity)
            problems += found
    return block, problems


# --- as a user writes it ----------------------------------------------------------------------------------------


def written_channel_noise(observation: Observation) -> Any:
    """A channel's own noise as a user writes it; None: it has none."""
    if observation.noise is None or isinstance(observation.noise, Noise):
        return None if observation.noise is None else written_noise(observation.noise)
    return written_number(observation.noise, "K")


def written_noise(noise: Noise) -> dict[str, Any]:
    """Noise as a user writes it, with what its model and distribution have."""
    block: dict[str, Any] = {"model": noise.model, "distribution": noise.distribution}
    for key in NOISE:
        needed, value = NEEDS.get(key, ("", None))
        if getattr(noise, key) is not None and getattr(noise, needed, None) == value:
            block[key] = written_number(getattr(noise, key), NOISE[key].unit)
    if noise.quantisation is not None:
        block["quantisation"] = written(noise.quantisation, "K")
    return block


def written_discrepancy(discrepancy: Discrepancy) -> dict[str, Any]:
    """The discrepancy as a user writes it."""
    block: dict[str, Any] = discrepancy.model_dump(mode="json", exclude_none=True)
    for part, quantities in (("time", TIME), ("phase", PHASE)):
        if part in block:
            for key, quantity in quantities.items():
                value = getattr(getattr(discrepancy, part), key)
                if value is not None:
                    block[part][key] = written_number(value, quantity.unit)
    return block


def written_number(value: Any, unit: str) -> Any:
    """A number that is known, or its prior, as a user writes it."""
    return written(value, unit) if isinstance(value, float) else written_prior(value, unit)
