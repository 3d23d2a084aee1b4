"""What a user writes: the scenario file as immutable objects in SI, and all that is wrong with it; imports: errors.

Imports: errors.
"""

from .blocks import blocks_of
from .calibration import Calibration, EmulatorSettings, GeneticSettings, NutsSettings, PredictionSettings
from .document import Document, Problem, read_document
from .environment import (
    Attitude,
    CircularOrbit,
    Environment,
    InertialAttitude,
    KeplerianOrbit,
    Orbit,
    SampledAttitude,
    SampledOrbit,
    SpinningAttitude,
    TleOrbit,
)
from .external import (
    CallableSimulator,
    Executable,
    ExecutableSimulator,
    ExternalModel,
    FmuSimulator,
    UmbridgeSimulator,
    kind_of_simulator,
    simulator_files,
)
from .fields import Block, Count, Number, Pair, Time, Vector
from .json_schema import json_schema, schema_of
from .lint import Finding, lint, load_scenario
from .network import (
    Conductor,
    Face,
    Heater,
    Load,
    ModeChange,
    Node,
    ReducedNumber,
    SimulatorError,
    SimulatorModel,
)
from .numbers import Numbers, Settable, numbers_of, settable
from .parameters import read_parameters, set_twice
from .priors import Beta, HalfNormal, LogNormal, Normal, Prior, TruncatedNormal, Uniform, support
from .reduced import REDUCED_MODEL_FORMAT
from .residuals import NEEDS, Discrepancy, DutyCycle, Noise, PhaseDiscrepancy, SwitchTimes, TimeDiscrepancy
from .resolved import resolved_yaml
from .schema import (
    Channel,
    InitialState,
    Observation,
    Parameter,
    Scenario,
    TelemetryFile,
    TimeColumn,
    input_files,
    noise_of,
    not_normal,
)
from .template import write_template
from .units import Duration, Power, Quantity, Temperature, is_temperature, kind_of, show, si_unit, to_si
from .windows import Window, is_trained
from .wording import problems_of

__all__ = [
    "NEEDS",
    "REDUCED_MODEL_FORMAT",
    "Attitude",
    "Beta",
    "Block",
    "Calibration",
    "CallableSimulator",
    "Channel",
    "CircularOrbit",
    "Conductor",
    "Count",
    "Discrepancy",
    "Document",
    "Duration",
    "DutyCycle",
    "EmulatorSettings",
    "Environment",
    "Executable",
    "ExecutableSimulator",
    "ExternalModel",
    "Face",
    "Finding",
    "FmuSimulator",
    "GeneticSettings",
    "HalfNormal",
    "Heater",
    "InertialAttitude",
    "InitialState",
    "KeplerianOrbit",
    "Load",
    "LogNormal",
    "ModeChange",
    "Node",
    "Noise",
    "Normal",
    "Number",
    "Numbers",
    "NutsSettings",
    "Observation",
    "Orbit",
    "Pair",
    "Parameter",
    "PhaseDiscrepancy",
    "Power",
    "PredictionSettings",
    "Prior",
    "Problem",
    "Quantity",
    "ReducedNumber",
    "SampledAttitude",
    "SampledOrbit",
    "Scenario",
    "Settable",
    "SimulatorError",
    "SimulatorModel",
    "SpinningAttitude",
    "SwitchTimes",
    "TelemetryFile",
    "Temperature",
    "Time",
    "TimeColumn",
    "TimeDiscrepancy",
    "TleOrbit",
    "TruncatedNormal",
    "UmbridgeSimulator",
    "Uniform",
    "Vector",
    "Window",
    "blocks_of",
    "input_files",
    "is_temperature",
    "is_trained",
    "json_schema",
    "kind_of",
    "kind_of_simulator",
    "lint",
    "load_scenario",
    "noise_of",
    "not_normal",
    "numbers_of",
    "problems_of",
    "read_document",
    "read_parameters",
    "resolved_yaml",
    "schema_of",
    "set_twice",
    "settable",
    "show",
    "si_unit",
    "simulator_files",
    "support",
    "to_si",
    "write_template",
]
