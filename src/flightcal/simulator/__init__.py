"""From theta to temperatures and heater status: network, canonical form, compiled integration."""

from .integrate import SimulationFailure, integrate
from .network import Network, build_network
from .simulate import NetworkSimulator, Simulator, Trajectory, network_simulator, open_loop
from .system import Drive, Structure, Switch, System

__all__ = [
    "Drive",
    "Network",
    "NetworkSimulator",
    "SimulationFailure",
    "Simulator",
    "Structure",
    "Switch",
    "System",
    "Trajectory",
    "build_network",
    "integrate",
    "network_simulator",
    "open_loop",
]
