"""From theta to temperatures and heater status: network, canonical form, compiled integration.

Imports: compiled, environment, errors, scenario, telemetry.
"""

from .assembly import ParameterMap, assemble, own_initial
from .build import TIME_ERROR, network_simulator, open_loop
from .drive import Times, divided, face_series, in_steps, spread, step_weights
from .heat_flow import courses, flow_through, heat_of_inputs
from .integrate import SimulationFailure, cores, in_parallel, integrate, sensor_temperatures
from .kernels.forward import NOT_FINITE, TOO_MANY_SWITCHES
from .kernels.lanes import WIDTH
from .kernels.march import MarchCall, march
from .kernels.step import step_size
from .network import FIELDS, Network, Term, build_network, canonical_form, flux_kinds
from .sampling import Observation, Sensors
from .simulate import SCATTERED, NetworkSimulator, Simulator, Trajectory
from .system import Drive, FloatArray, IntArray, Structure, Switch, System, unpack
