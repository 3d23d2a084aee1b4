"""What a scenario means where it writes nothing: its noise, its heat, the error of its time tags, its tolerance."""

from __future__ import annotations

from .external import ExternalModel
from .heat import Heat, HeatPattern
from .network import SimulatorModel
from .priors import HalfNormal, LogNormal
from .residuals import Discrepancy, Noise, PhaseDiscrepancy, StatusLikelihood
from .schema import Scenario

_FINEST = 5e-3
"""K, error of the integration that no telemetry shows."""
_DRIFT, _DAY = 0.02, 86400.0
"""Of the heat that flows, and s: how much and how slowly heat drifts where no orbit comes again. The temperatures of
Chandra's boxes do."""
_TIME_ERROR = 3.0
"""s, where a scenario with unmodelled heat does not write `time_error`."""
NOISE_BESIDE_HEAT = Noise(
    model="ar1",
    standard_deviation=HalfNormal(scale=1.0),
    correlation_time=LogNormal(median=300.0, factor=2.0),
    white=HalfNormal(scale=0.5),
)
"""Noise where none is written: heat, or a discrepancy in its place, leaves what lasts for minutes."""


def not_normal(scenario: Scenario) -> list[str]:
    """What the noise of temperature channels is called where it is not normal."""
    channels = (name for name, item in scenario.observations.items() if item.heater is None)
    return sorted({found for name in channels if (found := _written_noise(scenario, name).not_normal)})


def noise_of(scenario: Scenario, channel: str) -> Noise:
    """The noise of a temperature channel: its own, or else the scenario's `default_noise`."""
    has_own = scenario.observations[channel].noise is not None
    return _written_noise(scenario, channel) if has_own else default_noise(scenario)


def default_noise(scenario: Scenario) -> Noise:
    """The noise of channels that have none of their own.

    Where the scenario writes none, it is AR(1) beside heat, and beside an external simulator, which takes none.
    """
    written = "noise" in scenario.model_fields_set
    lacks = heat_of(scenario) is not None or _lacks(scenario)
    return NOISE_BESIDE_HEAT if lacks and not written else scenario.noise


def heat_of(scenario: Scenario) -> Heat | None:
    """The heat that the simulator does not know of; None: there is none.

    Where the scenario does not write it, it has the defaults, unless the scenario has what heat cannot stand beside.
    """
    heat = scenario.heat if isinstance(scenario.heat, Heat) else None
    if scenario.heat is None and can_have_heat(scenario):
        heat = Heat()
    return heat if heat is None or scenario.environment.comes_again else _without_an_orbit(scenario, heat)


def _without_an_orbit(scenario: Scenario, heat: Heat) -> Heat:
    """What heat means where nothing comes again: over an angle, if there is one; and it drifts by more, in days."""
    pattern, slow = heat.pattern, heat.slow
    if pattern is not None and pattern.over is None:
        angle = _angle(scenario)
        pattern = HeatPattern(over=angle, scale=pattern.scale) if angle else pattern.model_copy(update={"harmonics": 0})
    if slow is not None:
        scale = slow.scale if "scale" in slow.model_fields_set else _DRIFT
        slow = slow.model_copy(update={"time": slow.time or _DAY, "scale": scale})
    return heat.model_copy(update={"pattern": pattern, "slow": slow})


def _angle(scenario: Scenario) -> str | None:
    """The driver that is an angle, of several that which loads follow; None: there is not one alone."""
    angles = [
        name for name, channel in scenario.telemetry.channels.items() if channel.kind == "driver" and channel.is_angle
    ]
    followed = {load.driver for load in scenario.network.loads.values()}
    one = [name for name in angles if name in followed] or angles
    return one[0] if len(one) == 1 else None


def discrepancy_of(scenario: Scenario) -> Discrepancy | None:
    """What the simulator lacks, in temperature; None: there is none.

    Where the scenario does not write it, an external simulator has the defaults, if the length of the orbit is known.
    """
    if scenario.discrepancy is not None:
        return scenario.discrepancy if isinstance(scenario.discrepancy, Discrepancy) else None
    around = scenario.environment.comes_again
    return Discrepancy(phase=PhaseDiscrepancy()) if around and _lacks(scenario) and not not_normal(scenario) else None


def _lacks(scenario: Scenario) -> bool:
    """Whether a simulator that takes no heat is meant to lack something, as every simulator does."""
    return isinstance(scenario.simulator, ExternalModel) and scenario.heat is None


def time_error_of(scenario: Scenario) -> float | None:
    """Prior standard deviation, s, of the error that time tags have in common; None: they have none."""
    if not timed_together(scenario):
        return None
    if scenario.time_error is not None:
        return None if scenario.time_error == "none" else scenario.time_error
    return _TIME_ERROR if heat_of(scenario) is not None else None


def timed_together(scenario: Scenario) -> tuple[str, ...]:
    """Paths of the time offsets that the error of all time tags sets: of channels with none of their own."""
    if not isinstance(scenario.simulator, SimulatorModel):
        return ()
    found = [
        f"observations.{name}.time_offset"
        for name, item in scenario.observations.items()
        if item.node is not None and item.time_offset == 0.0
    ]
    return tuple(path for path in found if path not in scenario.uncertain)


def status_likelihoods(scenario: Scenario) -> dict[str, StatusLikelihood]:
    """How the status of heaters counts in the likelihood, by channel.

    With unmodelled heat a status drives its heater in training, and what it says of the temperatures is all used.
    """
    if heat_of(scenario) is not None and not thermostats_act(scenario):
        return {}
    return {
        name: observation.likelihood
        for name, observation in scenario.observations.items()
        if observation.likelihood is not None
    }


def uncertain_thermostats(scenario: Scenario) -> set[str]:
    """Heaters with a threshold that is a parameter."""
    return {path.split(".")[1] for path in scenario.uncertain if _is_threshold(path)}


def threshold_parameters(scenario: Scenario) -> tuple[str, ...]:
    """Names of the parameters that set a threshold."""
    return tuple(name for name, parameter in scenario.parameters.items() if any(map(_is_threshold, parameter.targets)))


def thermostats_act(scenario: Scenario) -> bool:
    """Whether thermostats act in training beside unmodelled heat: temperatures alone tell of a threshold.

    That of a heater without a status; of a parameter that sets other numbers too, or is not always the same.
    """
    switches = scenario.network.switches
    unseen = any(switches[name].measured_by is None for name in uncertain_thermostats(scenario) if name in switches)
    others = [scenario.parameters[name] for name in threshold_parameters(scenario)]
    return unseen or any(parameter.moves or not all(map(_is_threshold, parameter.targets)) for parameter in others)


def _is_threshold(path: str) -> bool:
    return path.startswith("heaters.") and path.endswith((".on_below", ".off_above"))


def can_have_heat(scenario: Scenario) -> bool:
    """Whether the simulator takes heat, and the scenario has nothing that heat cannot stand beside."""
    model = scenario.simulator
    if not isinstance(model, SimulatorModel) or (model.errors and model.reduced_model is None):
        return False
    holds_heat = any(node.capacity is not None for node in model.nodes.values())
    return holds_heat and not isinstance(scenario.discrepancy, Discrepancy) and not not_normal(scenario)


def _written_noise(scenario: Scenario, channel: str) -> Noise:
    noise = scenario.observations[channel].noise
    if noise is None:
        return scenario.noise
    return noise if isinstance(noise, Noise) else Noise.model_construct(standard_deviation=noise)


def step_tolerance(scenario: Scenario) -> float:
    """On the integration's error, K: see `SimulatorModel.tolerance`. Raises ScenarioError without a network."""
    if scenario.network.tolerance is not None:
        return scenario.network.tolerance
    noises = [noise_of(scenario, name) for name, item in scenario.observations.items() if item.heater is None]
    written = [(noise.quantisation, noise.standard_deviation, noise.white) for noise in noises]
    return min([_FINEST, *(0.1 * value for values in written for value in values if isinstance(value, float))])
