"""A co-simulation FMU of FMI 2 or 3 as a simulator, through FMPy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .program import Outputs, RunFailure

if TYPE_CHECKING:  # the worker starts in a tenth of a second without it
    from ..simulator import FloatArray, IntArray

_REAL = ("Real", "Float64", "Float32")
"""Types whose variables FMPy gets and sets by functions of the same name."""
_DISCARD = 2
_TOLERANCE = 1e-6  # s


@dataclass(frozen=True)
class FmuDescription:
    """The FMU, and the window that it is run on."""

    file: Path
    grid: FloatArray
    """[K] s from the window's start: communication points; the first is 0."""
    samples: IntArray
    """[T] positions of the sample times in the grid."""
    drivers: dict[str, FloatArray]
    """Input variable -> its values [K] at the communication points; each holds until the next."""
    outputs: tuple[str, ...]
    heaters: tuple[str, ...]
    modified: int
    """When the file was, ns: a worker that has opened an older one is not asked again."""

    @property
    def has_gradient(self) -> bool:
        """Never: directional derivatives are at a point, not of a trajectory."""
        return False

    def open(self) -> FmuModel:
        """Unpack the FMU into the worker's folder. Raises RunFailure."""
        return FmuModel(self)


class FmuModel:
    """An unpacked FMU; each run is a new instance."""

    def __init__(self, description: FmuDescription) -> None:
        import fmpy

        self._given = description
        try:
            self._description = fmpy.read_model_description(str(description.file), validate=False)
            self._folder = str(fmpy.extract(str(description.file)))
        except Exception as error:  # FMPy raises plain Exception for what is wrong with a file
            raise RunFailure("crashed", f"'{description.file.name}' cannot be opened: {error}") from None
        self._variables = {variable.name: variable for variable in self._description.modelVariables}

    def run(self, inputs: Mapping[str, float]) -> Outputs:
        """One simulation from the window's start to its last sample. Raises RunFailure."""
        from fmpy.fmi1 import FMICallException
        from fmpy.simulation import instantiate_fmu

        try:
            fmu = instantiate_fmu(self._folder, self._description, "CoSimulation")
        except Exception as error:  # as above
            raise RunFailure("crashed", f"the FMU cannot be instantiated: {error}") from None
        time = 0.0
        try:
            self._initialise(fmu, inputs)
            names = (*self._given.outputs, *self._given.heaters)
            table = np.empty((len(self._given.grid), len(names)))
            table[0] = self._get(fmu, names)
            for k, (time, following) in enumerate(zip(self._given.grid[:-1], self._given.grid[1:], strict=True)):
                self._step(fmu, k, float(time), float(following))
                table[k + 1] = self._get(fmu, names)
            fmu.terminate()
        except FMICallException as error:
            outcome: Any = "partial output" if error.status == _DISCARD and "DoStep" in error.function else "crashed"
            raise RunFailure(outcome, f"at {time:g} s: {error}") from None
        finally:
            fmu.freeInstance()
        table = table[self._given.samples]
        return Outputs(table[:, : len(self._given.outputs)], table[:, len(self._given.outputs) :])

    def _initialise(self, fmu: Any, inputs: Mapping[str, float]) -> None:
        """Parameters first, then, in initialization mode, what may change during a run."""
        stop = float(self._given.grid[-1])
        changing = {name for name in inputs if self._variable(name).causality == "input"}
        before = [name for name in inputs if name not in changing]
        if self._description.fmiVersion == "2.0":
            fmu.setupExperiment(startTime=0.0, stopTime=stop)
        self._set(fmu, before, [inputs[name] for name in before])
        if self._description.fmiVersion == "2.0":
            fmu.enterInitializationMode()
        else:
            fmu.enterInitializationMode(startTime=0.0, stopTime=stop)
        self._set(fmu, list(changing), [inputs[name] for name in changing])
        self._drive(fmu, 0)
        fmu.exitInitializationMode()

    def _step(self, fmu: Any, k: int, time: float, following: float) -> None:
        self._drive(fmu, k)
        done = fmu.doStep(currentCommunicationPoint=time, communicationStepSize=following - time)
        if not isinstance(done, tuple):  # FMI 2
            return
        _, terminated, early, reached = done
        if terminated:
            message = f"the FMU ends the simulation at {reached:g} s of {self._given.grid[-1]:g} s"
            raise RunFailure("partial output", message)
        if early or abs(reached - following) > _TOLERANCE:
            raise RunFailure("wrong times", f"found the FMU at {reached:g} s after a step to {following:g} s")

    def _drive(self, fmu: Any, k: int) -> None:
        self._set(fmu, list(self._given.drivers), [float(values[k]) for values in self._given.drivers.values()])

    def _variable(self, name: str) -> Any:
        variable = self._variables.get(name)
        if variable is None or variable.type not in _REAL:
            found = "no variable" if variable is None else f"a variable of type {variable.type} as"
            raise RunFailure("crashed", f"the FMU has {found} '{name}', expected a real number")
        return variable

    def _set(self, fmu: Any, names: Sequence[str], values: Sequence[float]) -> None:
        for name, value in zip(names, values, strict=True):
            variable = self._variable(name)
            getattr(fmu, f"set{variable.type}")([variable.valueReference], [value])

    def _get(self, fmu: Any, names: Sequence[str]) -> list[float]:
        variables = [self._variable(name) for name in names]
        kinds = {variable.type for variable in variables}
        if len(kinds) == 1:
            read = getattr(fmu, f"get{kinds.pop()}")
            return list(read([variable.valueReference for variable in variables]))
        return [getattr(fmu, f"get{v.type}")([v.valueReference])[0] for v in variables]
