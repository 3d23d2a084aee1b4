"""A Python function as a simulator: NumPy, or JAX with its exact gradient."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .program import Outputs, RunFailure, checked

if TYPE_CHECKING:  # the worker starts in a tenth of a second without it
    from ..simulator import FloatArray


@dataclass(frozen=True)
class FunctionDescription:
    """Where the function is, and the window that it is called for."""

    file: Path
    function: str
    in_jax: bool
    start: datetime
    times: FloatArray
    """[T] s from `start`."""
    outputs: tuple[str, ...]
    heaters: tuple[str, ...]
    modified: int
    """When the file was, ns: a worker that has opened an older one is not asked again."""

    @property
    def has_gradient(self) -> bool:
        """Of a function in JAX."""
        return self.in_jax

    def open(self) -> FunctionModel | JaxModel:
        """Import the file, in the worker. Raises RunFailure."""
        sys.path.insert(0, str(self.file.parent))  # it may have modules of its own beside it
        specification = importlib.util.spec_from_file_location(self.file.stem, self.file)
        if specification is None or specification.loader is None:
            raise RunFailure("crashed", f"'{self.file.name}' is not a Python file")
        module = importlib.util.module_from_spec(specification)
        sys.modules[self.file.stem] = module
        if self.in_jax:
            import jax

            jax.config.update("jax_enable_x64", True)  # before the file builds any array
        # Bytecode is told from that of an edited file by whole seconds, and nothing is left in a user's folder.
        sys.dont_write_bytecode = True
        specification.loader.exec_module(module)
        function = getattr(module, self.function, None)
        if not callable(function):
            raise RunFailure("crashed", f"'{self.file.name}' has no function '{self.function}'")
        return (JaxModel if self.in_jax else FunctionModel)(self, function)


class FunctionModel:
    """A function on NumPy arrays."""

    def __init__(self, description: FunctionDescription, function: Callable[..., Any]) -> None:
        self._description = description
        self._function = function

    def run(self, inputs: Mapping[str, float]) -> Outputs:
        """One call. Raises RunFailure."""
        given = self._description
        return _outputs(self._function(dict(inputs), given.times.copy(), given.start), given)


class JaxModel:
    """A function in JAX, compiled for the window."""

    def __init__(self, description: FunctionDescription, function: Callable[..., Any]) -> None:
        import jax

        def at(inputs: Mapping[str, Any]) -> Any:
            return function(inputs, description.times, description.start)

        def temperatures_at(inputs: Mapping[str, Any]) -> Any:
            result = at(inputs)
            return result[0] if isinstance(result, tuple) else result

        def pull_back(inputs: Mapping[str, Any], temperatures_bar: Any) -> Any:
            return jax.vjp(temperatures_at, inputs)[1](temperatures_bar)[0]

        self._description = description
        self._run, self._pull_back = jax.jit(at), jax.jit(pull_back)

    def run(self, inputs: Mapping[str, float]) -> Outputs:
        """One call of the compiled function. Raises RunFailure."""
        return _outputs(self._run(dict(inputs)), self._description)

    def pull_back(self, inputs: Mapping[str, float], temperatures_bar: FloatArray) -> FloatArray:
        """Cotangent of the inputs, in their order."""
        inputs_bar = self._pull_back(dict(inputs), temperatures_bar)
        return np.array([float(inputs_bar[name]) for name in inputs])


def _outputs(result: Any, given: FunctionDescription) -> Outputs:
    if isinstance(result, tuple):
        if len(result) != 2:
            found = f"found {len(result)} results"
            raise RunFailure("wrong shape", f"{found}, expected temperatures, or temperatures and heater status")
        temperatures, status = result
    elif given.heaters:
        message = f"found temperatures alone, expected the status of {', '.join(given.heaters)} beside them"
        raise RunFailure("wrong shape", message)
    else:
        temperatures, status = result, np.empty((len(given.times), 0))
    return checked(Outputs(temperatures, status), len(given.times), given.outputs, given.heaters)
