"""Parameters: each number is set once, and priors stay within what the quantity can physically be."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path

from ..blocks import readable
from ..document import Issue
from ..network import Heater
from ..numbers import Settable
from ..parameters import set_twice
from ..priors import LogNormal, Normal, Prior, TruncatedNormal, support
from ..reading import Reading
from ..schema import Parameter, is_difference
from ..units import celsius

_SIZES = ("lower", "upper", "mean", "standard_deviation", "median", "scale")
"""Arguments of priors that are in the unit of what they are of."""
_FAR_OUT = 5.0
"""Standard deviations from a truncated normal's mean to its bounds, beyond which sampling it fails."""
_NEVER = 5.0
"""Standard deviations from a normal prior's middle, beyond which no draw is that matters: one of 10^6."""


def check(reading: Reading, folder: Path) -> Iterator[Issue]:
    """No two parameters set the same number, and no draw from a prior is impossible."""
    # One that refers to a block which could not be read waits for that.
    parameters = {
        name: parameter
        for name, parameter in readable(reading.blocks.parameters).items()
        if reading.numbers.keys() >= {*parameter.sets, *parameter.scales}
    }
    yield from set_twice(parameters)
    for name, parameter in parameters.items():
        message = _prior_problem(parameter, reading.numbers)
        if message:
            yield Issue(("parameters", name, "prior"), message)
        if parameter.trend is not None and reading.blocks.external is not None:
            message = "found 'trend' of a simulator that is not flightcal's own, expected it with a thermal network"
            yield Issue(("parameters", name, "trend"), message)
    yield from _check_thresholds(parameters, reading)


def _prior_problem(parameter: Parameter, numbers: Mapping[str, Settable]) -> str | None:
    prior = parameter.prior
    if isinstance(prior, TruncatedNormal):
        outside = max(prior.lower - prior.mean, prior.mean - prior.upper) / prior.standard_deviation
        if outside > _FAR_OUT:
            return f"found a mean {outside:.0f} standard deviations outside the bounds, expected it near or inside"
    problems = [_set_problem(path, prior, numbers[path]) for path in parameter.sets]
    problems += [_scale_problem(path, prior, numbers[path]) for path in parameter.scales]
    problems += [_unbelievable(path, prior, numbers[path], 1.0) for path in parameter.sets]
    problems += [_unbelievable(path, prior, numbers[path], numbers[path].value) for path in parameter.scales]
    return next(filter(None, problems), None)


def _set_problem(path: str, prior: Prior, number: Settable) -> str | None:
    lower, upper = _ends(prior, 1.0, number)
    if _is_absolute_temperature(path, number):
        if support(prior) == (0.0, math.inf):
            return f"found a {prior.kind} prior of a temperature, expected normal, truncated_normal or uniform"
        # The tail of a normal prior below absolute zero has no weight.
        lower = number.lower if math.isinf(lower) else lower
    return _beyond(prior.kind, lower, upper, number, "")


def _scale_problem(path: str, prior: Prior, number: Settable) -> str | None:
    if number.value == 0:
        return f"found a prior that scales {path}, which is 0, expected 'sets': scaling does nothing to it"
    if _is_absolute_temperature(path, number):
        return f"found a prior that scales the temperature {path}, expected 'sets': kelvin are not scaled"
    lower, upper = _ends(prior, number.value, number)
    written = f"{number.value:g} {number.unit}".strip()
    return _beyond(prior.kind, lower, upper, number, f" for {path} of {written}")


def _ends(prior: Prior, times: float, number: Settable) -> tuple[float, float]:
    """Where a prior ends, times a number; at the quantity's own bound where it has no end and never comes near that."""
    lower, upper = sorted(times * end for end in support(prior))
    least, most = sorted(times * end for end in _reached(prior))
    if math.isinf(lower) and least >= number.lower:
        lower = number.lower
    if math.isinf(upper) and most <= number.upper:
        upper = number.upper
    return lower, upper


def _reached(prior: Prior) -> tuple[float, float]:
    """Between which all draws are that matter."""
    if isinstance(prior, Normal):
        return prior.mean - _NEVER * prior.standard_deviation, prior.mean + _NEVER * prior.standard_deviation
    if isinstance(prior, LogNormal):
        reach = _NEVER * math.log(prior.factor)
        most = prior.median * math.exp(reach) if reach < math.log(1e300) else math.inf
        return prior.median * math.exp(-reach), most
    return support(prior)


def _unbelievable(path: str, prior: Prior, number: Settable, unit: float) -> str | None:
    """A prior of a size that the number itself may not be written with; unit: what the prior's numbers count."""
    written = {key: unit * value for key, value in prior if key in _SIZES}
    largest = max(written.values(), key=abs)
    if abs(largest) <= number.believable:
        return None
    found = f"found a prior that reaches {largest:g} {number.unit}".rstrip()
    return f"{found} for {path}, expected at most {number.believable:g} {number.unit}".rstrip()


def _beyond(kind: str, lower: float, upper: float, number: Settable, target: str) -> str | None:
    """Where a prior that reaches from one number to another leaves what the quantity can be."""
    two_ends = "uniform, beta or truncated_normal"
    one_end = "lognormal or truncated_normal" if math.isinf(number.upper) else two_ends
    for beyond, end, limit, side, down, least, advice in (
        (lower < number.lower, lower, number.lower, "below", "down", "at least", one_end),
        (upper > number.upper, upper, number.upper, "above", "up", "at most", two_ends),
    ):
        expected = f"expected {f'{least} {limit:g} {number.unit}'.strip()}{target}"
        if beyond and math.isinf(end):
            found = f"found a {kind} prior, which goes {side} {limit:g} within {_NEVER:g} deviations"
            return f"{found}, {expected}: use {advice}"
        if beyond:
            return f"{f'found a prior that reaches {down} to {end:g} {number.unit}'.strip()}, {expected}"
    return None


def _check_thresholds(parameters: Mapping[str, Parameter], reading: Reading) -> Iterator[Issue]:
    """No draw puts a heater's `on_below` over its `off_above`, as far as the priors have ends."""
    setter = {path: name for name, parameter in parameters.items() for path in parameter.sets}
    for heater, block in readable(reading.blocks.heaters).items():
        if not isinstance(block, Heater):
            continue
        on_path, off_path = f"heaters.{heater}.on_below", f"heaters.{heater}.off_above"
        names = [setter[path] for path in (on_path, off_path) if path in setter]
        if not names or setter.get(on_path) == setter.get(off_path):
            continue
        highest_on = _range(on_path, setter, parameters, reading.numbers)[1]
        lowest_off = _range(off_path, setter, parameters, reading.numbers)[0]
        if math.isfinite(highest_on) and math.isfinite(lowest_off) and highest_on >= lowest_off:
            found = f"found on_below up to {celsius(highest_on)} and off_above down to {celsius(lowest_off)}"
            message = f"{found} for heater {heater!r}, expected bounds that keep on_below under off_above"
            yield Issue(("parameters", names[0], "prior"), message)


def _range(
    path: str, setter: Mapping[str, str], parameters: Mapping[str, Parameter], numbers: Mapping[str, Settable]
) -> tuple[float, float]:
    if path in setter:
        return support(parameters[setter[path]].prior)
    return numbers[path].value, numbers[path].value


def _is_absolute_temperature(path: str, number: Settable) -> bool:
    return number.unit == "K" and not is_difference(path)
