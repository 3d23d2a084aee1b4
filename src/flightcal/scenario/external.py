"""Simulators that flightcal did not write, as a scenario describes them; nothing here runs or imports one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, SerializationInfo, field_serializer, model_validator

from .fields import Block, Count, FileName, Flag, Marker, from_folder, read_empty
from .units import ICE_POINT, Duration, QuantityOrName, read_any, show, si_unit, written_unit

# --- what goes in and what comes out --------------------------------------------------------------------------


class Input(Block):
    """A number that the simulator takes; may also be written as the value alone."""

    value: Marker
    """Where no parameter sets it; with its unit, which is the unit of a parameter that sets it."""
    name: str | None = None
    """What the simulator calls it, such as an FMU's variable; null: as here."""
    unit: str | None = None
    """Unit in which the simulator takes it; null: SI."""
    initial_of: str | None = None
    """It is this output's temperature at the window's start: estimated in every window, and set by no parameter."""

    @model_validator(mode="after")
    def _quantity(self) -> Input:
        unit, _ = read_any(self.value)
        if self.unit is not None and si_unit(self.unit) != unit:
            raise ValueError(f"found the unit {show(self.unit)} for {show(self.value)}, expected one that suits it")
        return self

    @property
    def si(self) -> tuple[str, float]:
        """SI unit ("" if dimensionless) and value."""
        return read_any(self.value)

    @property
    def scale(self) -> tuple[float, float]:
        """Factor and offset from SI to what the simulator takes: factor * SI + offset."""
        unit = written_unit(self.unit or "", si_unit(self.unit or ""))
        return 1.0 / unit.factor, -unit.offset / unit.factor


class Output(Block):
    """A temperature that the simulator gives."""

    name: str | None = None
    """What the simulator calls it: a column, an FMU's variable; null: as here."""
    unit: Literal["K", "degC"] = "K"
    """Unit in which the simulator gives it."""

    @property
    def offset(self) -> float:
        """Kelvin to add to what the simulator gives."""
        return ICE_POINT if self.unit == "degC" else 0.0


class ExternalHeater(Block):
    """A heater whose status the simulator gives: 1 on, 0 off, or the share of full power between."""

    name: str | None = None
    """What the simulator calls the status: a column, an FMU's variable; null: as here."""
    power: Annotated[float | str, QuantityOrName("W", at_least=0.0)] | None = None
    """While it is on: a power, or the name of the input that says it; null: not known, so neither is its energy."""


def _read_input(value: Any) -> Any:
    return value if isinstance(value, (dict, Input)) else {"value": value}


WrittenInput = Annotated[Input, BeforeValidator(_read_input, json_schema_input_type=float | str | Input)]
WrittenOutput = Annotated[Output, BeforeValidator(read_empty, json_schema_input_type=Output | None)]
WrittenHeater = Annotated[ExternalHeater, BeforeValidator(read_empty, json_schema_input_type=ExternalHeater | None)]


class ExternalModel(Block):
    """What simulators of all kinds share: inputs, outputs, and how long and how often to try."""

    inputs: dict[str, WrittenInput] = Field(min_length=1)
    outputs: dict[str, WrittenOutput] = Field(min_length=1)
    heaters: dict[str, WrittenHeater] = Field(default_factory=dict)
    timeout: Duration = 60.0
    """A run that takes longer is killed, with all that it has started."""
    retries: Annotated[Count, Field(ge=0, le=100)] = 0
    """So often is a run tried again that crashed, timed out, stopped half-way or found no server."""

    @property
    def switches(self) -> dict[str, ExternalHeater]:
        """The heaters; a thermal network may have some that share a switch."""
        return self.heaters


# --- the kinds -------------------------------------------------------------------------------------------------


class PythonFunction(Block):
    """A function ``f(inputs, times, start)`` in a Python file.

    inputs: name -> number; times: s from the window's start, an array [T]; start: the window's start, a UTC datetime.
    It returns temperatures [T, N], one column for each output, or these and the heaters' status [T, H].
    """

    file: FileName
    function: str = "simulate"
    gradient: Literal["none", "jax"] = "none"
    """jax: written in JAX, which gives its exact gradient."""


class OutputTime(Block):
    """The time column of an executable's output."""

    column: str = "time"
    format: Literal["seconds", "iso8601"] = "seconds"
    """seconds: from the window's start."""


class Executable(Block):
    """A command line, run in a fresh folder for each run; never through a shell."""

    command: tuple[str, ...] = Field(min_length=1)
    """Program and arguments. A program with a '/' in it is relative to the scenario; others are looked for in PATH."""
    templates: dict[str, FileName] = Field(default_factory=dict)
    """File to write in the folder -> Jinja template with `inputs`, `times` (s from the start), `start` and `end`."""
    files: tuple[FileName, ...] = ()
    """Copied into the folder as they are."""
    output: str = "output.csv"
    """The CSV file that it writes in the folder: a time column, one for each output, one for each heater."""
    time: OutputTime = OutputTime()
    interpolate: Flag = False
    """Linearly, from the output's times to the telemetry's (a status: as it was last); false: they must be the same."""
    keep_failed: FileName | None = None
    """Keep the folders of failed runs in this one; null: they are removed."""
    folder: str = "."
    """Folder in which all these names stay. Copies that flightcal writes have the first scenario's."""

    @field_serializer("folder", when_used="json")
    def _write_folder(self, folder: str, info: SerializationInfo) -> str:
        return from_folder(folder, info)

    @field_serializer("command", when_used="json")
    def _write_command(self, command: tuple[str, ...], info: SerializationInfo) -> list[str]:
        program, *arguments = command
        return [from_folder(program, info) if "/" in program else program, *arguments]

    def program(self, folder: Path) -> str:
        """The program as the system finds it."""
        return str((folder / self.command[0]).absolute()) if "/" in self.command[0] else self.command[0]


class Fmu(Block):
    """A co-simulation FMU of FMI 2 or 3."""

    file: FileName
    step: Duration | None = None
    """Longest communication step; null: from one sample to the next."""
    drivers: dict[str, str] = Field(default_factory=dict)
    """Input variable of the FMU -> measured driver channel, in its SI unit."""


class Umbridge(Block):
    """A model on an UM-Bridge server.

    It takes one vector, the inputs, and gives one vector [T] for each output and then for each heater. Its
    configuration gets `times` (s from the window's start) and `start` (ISO 8601) beside what `config` says.
    """

    url: str
    model: str = "forward"
    config: dict[str, Any] = Field(default_factory=dict)


class CallableSimulator(ExternalModel):
    """A Python function as the simulator."""

    callable: PythonFunction


class ExecutableSimulator(ExternalModel):
    """An executable as the simulator."""

    executable: Executable


class FmuSimulator(ExternalModel):
    """An FMU as the simulator."""

    fmu: Fmu


class UmbridgeSimulator(ExternalModel):
    """A model behind HTTP as the simulator."""

    umbridge: Umbridge


KINDS: dict[str, type[ExternalModel]] = {
    "callable": CallableSimulator,
    "executable": ExecutableSimulator,
    "fmu": FmuSimulator,
    "umbridge": UmbridgeSimulator,
}


def kind_of_simulator(value: Any) -> str | None:
    """The key that tells which kind of external simulator a block describes; None: there is none."""
    keys = type(value).model_fields if isinstance(value, Block) else value if isinstance(value, dict) else ()
    return next((kind for kind in KINDS if kind in keys), None)


def is_external(value: Any) -> bool:
    """Whether what is written describes an external simulator, be it of a kind that there is or not."""
    if kind_of_simulator(value) is not None:
        return True
    return isinstance(value, dict) and "nodes" not in value and bool({"inputs", "outputs"} & set(value))


def simulator_files(model: Any, folder: Path) -> list[Path]:
    """Files that say what an external simulator computes, as far as the scenario names them; a network has none."""
    if isinstance(model, CallableSimulator):
        return [folder / model.callable.file]
    if isinstance(model, FmuSimulator):
        return [folder / model.fmu.file]
    if isinstance(model, ExecutableSimulator):
        executable = model.executable
        program = [executable.program(folder)] if "/" in executable.command[0] else []
        return [folder / name for name in (*program, *executable.templates.values(), *executable.files)]
    return []
