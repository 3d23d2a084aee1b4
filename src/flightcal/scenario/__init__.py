"""What a user writes: the scenario file as immutable objects in SI, and all that is wrong with it; imports: errors.

Imports: errors.
"""

from .attitude import (
    AlignedAttitude,
    Attitude,
    AttitudeChange,
    AttitudeTimeline,
    InertialAttitude,
    Pointing,
    SampledAttitude,
    SpinningAttitude,
    Target,
    spins_fast,
)
from .blocks import blocks_of
from .body import Body
from .calibrated import (
    RewritingError,
    calibrated_numbers,
    calibrated_text,
    number_in,
    parameter_units,
    written_values,
)
from .calibration import Calibration, EmulatorSettings, GeneticSettings, NutsSettings, PredictionSettings
from .defaults import (
    NOISE_BESIDE_HEAT,
    can_have_heat,
    default_noise,
    discrepancy_of,
    heat_of,
    noise_of,
    not_normal,
    status_likelihoods,
    step_tolerance,
    thermostats_act,
    threshold_parameters,
    time_error_of,
    timed_together,
    uncertain_thermostats,
)
from .document import Issue, read_document
from .environment import (
    OF_EARTH_AND_SUN,
    CircularOrbit,
    Earth,
    Environment,
    KeplerianOrbit,
    Orbit,
    SampledOrbit,
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
)
from .fields import AnyBlock, Block, Count, Number, Part, Time, Vector
from .geometry import MeshError, mesh_plates
from .heat import Heat, HeatPattern, HeatSlow
from .json_schema import json_schema, schema_of
from .lint import file_error, lint, load_scenario, read_file
from .network import (
    DEEP_SPACE,
    Conductor,
    Face,
    FaceNormal,
    Heater,
    Load,
    ModeChange,
    Node,
    ReducedNumber,
    SimulatorError,
    SimulatorModel,
    SunTracking,
)
from .numbers import Numbers, load_coefficient, load_driver, numbers_of, settable, table_places
from .parameters import read_parameters, set_twice
from .priors import Beta, HalfNormal, HalfStudentT, LogNormal, Normal, Prior, TruncatedNormal, Uniform
from .reduced import REDUCED_MODEL_FORMAT
from .residuals import NEEDS, Discrepancy, DutyCycle, Noise, PhaseDiscrepancy, SwitchTimes
from .resolved import resolved_yaml
from .schema import InitialState, Observation, Parameter, Scenario, input_files, is_difference
from .telemetry import Channel, Fill, Packet, Readings, TelemetryFile, TimeColumn
from .template import write_new, write_template
from .timeline import NamedChange, changes_in
from .units import (
    ICE_POINT,
    Duration,
    Kelvins,
    Power,
    Quantity,
    Seconds,
    Temperature,
    WrittenUnit,
    is_temperature,
    kind_of,
    si_unit,
    to_si,
    written_unit,
)
from .windows import Stretch, Window, is_trained
