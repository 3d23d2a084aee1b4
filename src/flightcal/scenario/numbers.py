"""The numbers of a scenario that a parameter may set or scale, by dotted path, and what theta makes of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, get_args

from .blocks import Blocks, blocks_of, readable
from .fields import Block
from .network import Conductor, Load
from .schema import Scenario
from .telemetry import Channel
from .units import LARGEST, STRONGEST, Quantity, si_unit, to_si

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]
    IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Numbers:
    """Numbers by dotted path, and which entries of theta set or scale them.

    A number is what the scenario writes or the entry that sets it, times the entries that scale it. (NumPy is imported
    where it is used: to read a scenario must not wait for it.)
    """

    paths: tuple[str, ...]
    values: FloatArray
    """[P] SI, as the scenario writes them."""
    sets: IntArray
    """[., 2] position in the numbers, entry of theta."""
    scales: IntArray
    """[., 2] likewise."""

    def at(self, theta: FloatArray) -> FloatArray:
        """[..., P] SI at theta [..., d]."""
        numbers = self._unscaled(theta)
        for position, entry in self.scales:
            numbers[..., position] *= theta[..., entry]
        return numbers

    def pull_back(self, theta: FloatArray, numbers_bar: FloatArray) -> FloatArray:
        """Cotangent [..., d] of theta [..., d] from that of the numbers [..., P]."""
        import numpy as np

        theta_bar = np.zeros_like(theta)
        unscaled, factors = self._unscaled(theta), np.ones(numbers_bar.shape)
        scaling: dict[int, list[int]] = {}
        for position, entry in self.scales.tolist():
            scaling.setdefault(position, []).append(entry)
        for position, entries in scaling.items():
            factors[..., position] = np.prod(theta[..., entries], axis=-1)
            for k, entry in enumerate(entries):
                others = np.prod(theta[..., entries[:k] + entries[k + 1 :]], axis=-1)
                theta_bar[..., entry] += numbers_bar[..., position] * unscaled[..., position] * others
        for position, entry in self.sets:
            theta_bar[..., entry] += numbers_bar[..., position] * factors[..., position]
        return theta_bar

    def moved(self) -> NDArray[np.bool_]:
        """[P] whether theta touches a number."""
        import numpy as np

        touched = np.zeros(len(self.paths), dtype=np.bool_)
        touched[self.sets[:, 0]] = touched[self.scales[:, 0]] = True
        return touched

    def _unscaled(self, theta: FloatArray) -> FloatArray:
        import numpy as np

        numbers = np.broadcast_to(self.values, (*theta.shape[:-1], len(self.values))).copy()
        numbers[..., self.sets[:, 0]] = theta[..., self.sets[:, 1]]
        return numbers


def numbers_of(values: Mapping[str, float], entries: Iterable[tuple[Sequence[str], Sequence[str]]]) -> Numbers:
    """Numbers by path, and of each entry of theta the paths that it sets and that it scales; others are left out."""
    import numpy as np

    place = {path: k for k, path in enumerate(values)}
    sets, scales = [], []
    for entry, (set_paths, scaled_paths) in enumerate(entries):
        sets += [(place[path], entry) for path in set_paths if path in place]
        scales += [(place[path], entry) for path in scaled_paths if path in place]
    return Numbers(tuple(values), np.array([*values.values()], dtype=float), _pairs(sets), _pairs(scales))


def _pairs(pairs: list[tuple[int, int]]) -> IntArray:
    import numpy as np

    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


_NETWORK: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("nodes", ("capacity", "capacity_slope")),
    ("nodes", ("boundary",)),
    ("conductors", ("conductance", "conductance_slope")),
    ("conductors", ("radiative",)),
    ("faces", ("area", "absorptivity", "emissivity")),
    ("heaters", ("power", "on_below", "off_above")),
)
"""Sections of a network, and what parameters may set or scale in their blocks, in the order of the paths."""
_OTHERS: dict[str, tuple[str, ...]] = {"loads": ("coefficient",), "observations": ("bias", "lag")}


@dataclass(frozen=True)
class Settable:
    """A number that a parameter may set or scale: SI unit ("" if dimensionless), SI value and SI bounds."""

    unit: str
    value: float
    lower: float
    upper: float
    believable: float = LARGEST
    """Largest size of what a prior is written with, see `Quantity`."""


def settable(scenario: Scenario) -> dict[str, Settable]:
    """Dotted path -> number, for every number that a parameter may set or scale, in a fixed order.

    nodes.<n>.capacity and, where it is written, capacity_slope; nodes.<n>.boundary (fixed ones; initial temperatures
    are always estimated, see InitialState);
    conductors.<label>.conductance and, where it is written, conductance_slope; conductors.<label>.radiative;
    faces.<f>.area, absorptivity, emissivity (of a reduced order model reduced.<parameter> instead of these);
    heaters.<h>.power, on_below, off_above; modes.<mode>.<node>;
    loads.<l>.coefficient (W per SI unit of the driver); environment.albedo, earth_infrared, solar_constant and, where
    it is written, environment.attitude_offset.x, y, z; of an external simulator
    inputs.<n> (but initial temperatures) instead of all these; observations.<channel>.bias (temperatures), and of a
    thermal network observations.<channel>.gain, time_offset and, where it is written, lag. Within a line: order of the
    file.
    """
    return settable_of(blocks_of(scenario))


def settable_of(blocks: Blocks) -> dict[str, Settable]:
    """`settable` of the blocks that could be read."""
    return {
        path: Settable(quantity.unit, value, quantity.lower, quantity.upper, quantity.believable)
        for path, quantity, value in _numbers(blocks)
    }


def load_coefficient(load: Load, driver: Channel | None) -> tuple[str, float] | None:
    """Unit and value of a load's coefficient, W per SI unit of the driver; None where the driver's unit is no unit.

    Raises ValueError, as `to_si`.
    """
    bare = load.table or (driver is not None and driver.is_state and driver.unit is None)
    unit = "W" if bare else _coefficient_unit(driver.unit if driver else None)
    if unit is None:
        return None
    if isinstance(load.coefficient, str):
        return unit, to_si(load.coefficient, unit)
    if unit not in ("", "W"):
        number = f"{load.coefficient:g}"
        raise ValueError(f"found {number} without a unit, expected heat per unit of the driver: '{number} {unit}'")
    return unit, float(load.coefficient)


def load_driver(load: Load, driver: Channel) -> Callable[[FloatArray], FloatArray]:
    """What a load makes of its driver (SI) before the coefficient. Raises ValueError for a table that is wrong."""
    import numpy as np

    sign: Callable[[FloatArray], FloatArray] = np.abs if load.absolute else np.asarray
    if not load.table:
        return sign
    places, factors = table_places(load, driver), [factor for _, factor in load.table]
    return lambda values: np.interp(sign(values), places, factors)


def table_places(load: Load, driver: Channel) -> list[float]:
    """Values of the driver (SI) at which a load's table has factors. Raises ValueError for a table that is wrong."""
    unit = driver.unit or ""
    texts = [place if isinstance(place, str) else f"{place:g} {unit}".strip() for place, _ in load.table]
    places = [to_si(text, si_unit(unit) if unit else "") for text in texts]
    for earlier, later, text in zip(places, places[1:], texts[1:], strict=False):
        if not earlier < later:
            raise ValueError(f"found {text} after a larger or equal value, expected values of the driver that grow")
    return places


def _numbers(blocks: Blocks) -> Iterator[tuple[str, Quantity, float]]:
    """Path, unit with bounds, and value of every settable number that could be read."""
    for name, number in readable(blocks.reduced or {}).items():
        yield name, Quantity(number.unit, at_least=number.lower, at_most=number.upper), number.value
    # The first conductor of a label keeps it; a second one is reported by lint.
    conductors: dict[str, Conductor] = {}
    for conductor in blocks.conductors:
        if conductor is not None:
            conductors.setdefault(conductor.label, conductor)
    for section, fields in _NETWORK:
        if section == "heaters" or blocks.reduced is None:
            named = conductors if section == "conductors" else readable(getattr(blocks, section))
            for name, block in named.items():
                yield from _fields_of(f"{section}.{name}", block, fields)
    for mode, powers in readable(blocks.modes).items():
        for name, power in powers.items():
            yield f"modes.{mode}.{name}", Quantity("W", believable=STRONGEST), power
    yield from _coefficients(blocks)
    if blocks.external:
        for name, item in readable(blocks.external.inputs).items():
            if item.initial_of is None:
                yield f"inputs.{name}", Quantity(item.si[0]), item.si[1]
    elif blocks.environment:
        yield from _fields_of("environment", blocks.environment, ("albedo", "earth_infrared", "solar_constant"))
        if offset := blocks.environment.attitude_offset:
            yield from _fields_of("environment.attitude_offset", offset, ("x", "y", "z"))
    for name, observation in readable(blocks.observations).items():
        if observation.heater is None:
            fields = ("bias",) if blocks.external else ("bias", "gain", "time_offset", "lag")
            yield from _fields_of(f"observations.{name}", observation, fields)


def fields_in(section: str) -> list[str]:
    """What parameters may set in the blocks of a section, where it is written."""
    return [field for key, fields in (*_NETWORK, *_OTHERS.items()) if key == section for field in fields]


def _fields_of(prefix: str, block: Block, names: Iterable[str]) -> Iterator[tuple[str, Quantity, float]]:
    """What is written of a block's fields; text is the name of a channel that is measured."""
    for name in names:
        value = getattr(block, name, None)  # a heater may have no thresholds
        if value is not None and not isinstance(value, str):
            field = type(block).model_fields[name]
            kinds = [*field.metadata, *(item for part in get_args(field.annotation) for item in get_args(part))]
            yield f"{prefix}.{name}", next(item for item in kinds if isinstance(item, Quantity)), value


def _coefficients(blocks: Blocks) -> Iterator[tuple[str, Quantity, float]]:
    for name, load in readable(blocks.loads).items():
        try:
            found = load_coefficient(load, blocks.channels.get(load.driver))
        except ValueError:
            continue  # reported by lint, with its line
        if found:
            yield f"loads.{name}.coefficient", Quantity(found[0]), found[1]


def _coefficient_unit(driver_unit: str | None) -> str | None:
    """W per SI unit of the driver; None where the driver's unit is no unit."""
    try:
        unit = si_unit(driver_unit or "no unit")
    except ValueError:
        return None
    if unit in ("", "W"):
        return "W" if unit == "" else ""
    return f"W/{unit}" if unit.isalpha() else si_unit(f"W/({unit})")
