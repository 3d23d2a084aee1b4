"""What all ways to run an external simulator share: one run in, its outputs or the reason of its failure out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from .record import Outcome

if TYPE_CHECKING:  # the worker starts in a tenth of a second without it
    from ..simulator import FloatArray


class RunFailure(Exception):  # noqa: N818 - a value of the domain, not a programming error
    """A run that did not finish: what became of it, and why."""

    def __init__(self, outcome: Outcome, message: str) -> None:
        super().__init__(outcome, message)
        self.outcome = outcome
        self.message = message


class Outputs(NamedTuple):
    """What a run gives at the sample times."""

    temperatures: FloatArray
    """[T, N] as the simulator gives them, one column for each output of the scenario."""
    status: FloatArray
    """[T, H] 0 or 1, or a share of full power."""


class ExternalProgram(Protocol):
    """A way to run a simulator on one window; plain data, so that it can be sent to another machine."""

    @property
    def has_gradient(self) -> bool:
        """Whether `pull_back` works."""

    def run(self, inputs: Mapping[str, float], timeout: float) -> Outputs:
        """One run. inputs: by the simulator's own names, in its own units. Raises RunFailure, after `timeout` s too."""

    def pull_back(self, inputs: Mapping[str, float], temperatures_bar: FloatArray, timeout: float) -> FloatArray:
        """Cotangent of the inputs [.], in their order, from that of the temperatures [T, N]. Raises RunFailure."""


def checked(outputs: Outputs, samples: int, names: tuple[str, ...], heaters: tuple[str, ...]) -> Outputs:
    """The outputs, if they have their shapes [T, N] and [T, H] and every number is finite. Raises RunFailure."""
    arrays = []
    for what, found, columns in (("temperatures", outputs[0], names), ("heater status", outputs[1], heaters)):
        expected = (samples, len(columns))
        try:
            array = np.asarray(found, dtype=float)
        except (TypeError, ValueError):
            raise RunFailure(
                "wrong shape", f"{what}: found {type(found).__name__}, expected an array of {_shape(expected)}"
            ) from None
        if array.shape != expected:
            why = f"{samples} sample times by {len(columns)} ({', '.join(columns) or 'none'})"
            raise RunFailure("wrong shape", f"{what}: found {_shape(array.shape)}, expected {_shape(expected)}: {why}")
        bad = np.argwhere(~np.isfinite(array))
        if len(bad):
            row, column = bad[0]
            found_there = f"{array[row, column]} in '{columns[column]}' at sample {row + 1} of {samples}"
            raise RunFailure("not finite", f"{what}: found {found_there}, {len(bad)} such in all")
        arrays.append(array)
    return Outputs(*arrays)


def _shape(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape)) or "a single number"
