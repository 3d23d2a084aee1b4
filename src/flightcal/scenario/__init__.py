"""The problem file: schema, units, lint."""

from ._priors import support
from .environment import (
    CircularOrbit,
    Environment,
    InertialAttitude,
    KeplerianOrbit,
    SampledAttitude,
    SampledOrbit,
    SpinningAttitude,
    TleOrbit,
)
from .external import (
    CallableSimulator,
    ExecutableSimulator,
    ExternalModel,
    FmuSimulator,
    UmbridgeSimulator,
    simulator_files,
)
from .inputs import input_files
from .json_schema import json_schema
from .lint import Finding, lint
from .load import load_scenario
from .network import Conductor, Face, Heater, Load, ModeChange, Node, SimulatorModel
from .priors import Beta, HalfNormal, LogNormal, Normal, Prior, TruncatedNormal, Uniform
from .residuals import Discrepancy, Noise
from .resolved import resolved_yaml
from .schema import (
    Calibration,
    Channel,
    GeneticSettings,
    InitialState,
    NutsSettings,
    Observation,
    Parameter,
    PredictionSettings,
    Scenario,
    TelemetryFile,
    TimeColumn,
    Window,
)
from .settable import Settable, settable
from .template import write_template

__all__ = [
    "Beta",
    "Calibration",
    "CallableSimulator",
    "Channel",
    "CircularOrbit",
    "Conductor",
    "Discrepancy",
    "Environment",
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
    "NutsSettings",
    "Observation",
    "Parameter",
    "PredictionSettings",
    "Prior",
    "SampledAttitude",
    "SampledOrbit",
    "Scenario",
    "Settable",
    "SimulatorModel",
    "SpinningAttitude",
    "TelemetryFile",
    "TimeColumn",
    "TleOrbit",
    "TruncatedNormal",
    "UmbridgeSimulator",
    "Uniform",
    "Window",
    "input_files",
    "json_schema",
    "lint",
    "load_scenario",
    "resolved_yaml",
    "settable",
    "simulator_files",
    "support",
    "write_template",
]
