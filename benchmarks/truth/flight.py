"""The telemetry of a satellite: flightcal's own simulator at the true parameters, with heat that the scenario lacks."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray

from flightcal.environment import orbital_period
from flightcal.probability import Priors
from flightcal.scenario import ICE_POINT, Scenario, load_scenario
from flightcal.simulator import (
    FloatArray,
    IntArray,
    NetworkSimulator,
    Trajectory,
    assemble,
    integrate,
    network_simulator,
)
from flightcal.telemetry import read_telemetry

from .satellites import SETTLING, START, Satellite, random_satellite

KINDS = ("none", "constant", "square wave", "slow drift")
STEP = "10 s"
"""Of the integration, whatever steps the calibration chooses."""

_ROOM = 285.0  # K, at the beginning of the flight; forgotten in a day
_FINE = np.timedelta64(10, "s")
_LEAST, _MOST = 0.02, 0.10
"""Unmodelled heat over the heat that flows through its node."""
_COMFORTABLE = (230.0, 330.0)  # K, mean of a node without heaters
_NEVER, _ALWAYS = 1.0, 600.0
"""K, thresholds of heaters that are never and always on."""
_APART = {"on_below": 0.0, "off_above": 1.0}
_TRIED = 50
_INITIAL_KNOWN = 5.0  # K, flightcal's prior deviation for a node without telemetry

Heat = Mapping[str, FloatArray]
"""Node -> W, at `drivers_times`."""


@dataclass(frozen=True)
class Flight:
    """A satellite that has flown."""

    satellite: Satellite
    truth: dict[str, float]
    """Parameter -> true value, SI."""
    kind: str
    """Of the unmodelled heat."""
    size: dict[str, float]
    """Node -> root mean square of its unmodelled heat over the heat that flows through it."""
    flow: dict[str, float]
    """Node -> mean absolute heat through it, W."""
    telemetry: pd.DataFrame
    """As its file has it."""
    on: dict[str, list[tuple[float, float]]]
    """Heater -> when it was on, s from the start of the training."""

    def duty(self, heater: str, first: float, last: float) -> float:
        """True share of a time, s from the start of the training, in which a heater was on."""
        inside = [max(0.0, min(end, last) - max(begin, first)) for begin, end in self.on[heater]]
        return float(sum(inside)) / (last - first)


@dataclass(frozen=True)
class Whole:
    """The simulator of a whole flight, from half a day before the training on; all nodes are observed."""

    simulator: NetworkSimulator
    """Its parameters are the scenario's and the heaters' thresholds, `on_below_<heater>` and `off_above_<heater>`."""
    priors: Priors
    """Of the scenario's parameters."""

    def theta(self, values: Mapping[str, float]) -> FloatArray:
        """theta [d]; what is not given has its median or, an initial temperature, that of a room."""
        medians = dict(zip(self.priors.names, self.priors.median().tolist(), strict=True))
        found = medians | dict(values)
        return np.array([found.get(name, _ROOM) for name in self.simulator.parameters])

    def fly(self, values: Mapping[str, float]) -> Trajectory:
        """The flight at the times of the telemetry."""
        return self.simulator.simulate(self.theta(values))

    def with_heat(self, times: Any, heat: Heat) -> Whole:
        """The same with heat that the scenario does not have, at `times` [M] (UTC) and linear in between."""
        drive, columns = self.simulator.drive, self.simulator.network.columns
        at = (times - times[0]) / np.timedelta64(1, "s")
        inputs = drive.inputs.copy()
        for node, watts in heat.items():
            series = np.interp(drive.times, at, watts)
            inputs[:, :, columns.index(f"driver.{_load(node)}")] = np.stack([series[:-1], series[1:]], axis=1)
        return replace(self, simulator=replace(self.simulator, drive=replace(drive, inputs=inputs)))

    def means(self, values: Mapping[str, float]) -> dict[str, float]:
        """Mean temperature of each node, K."""
        nodes = [channel.removesuffix("_temp") for channel in self.simulator.channels]
        return dict(zip(nodes, self.fly(values).temperatures.mean(axis=0).tolist(), strict=True))


def fly(seed: int, number: int, kind: str, folder: Path) -> Flight:
    """Satellite `number` of a seed; the same satellite, sensors and truth whatever the kind of heat."""
    rng = np.random.default_rng([seed, number])
    satellite, whole, thresholds = _comfortable(rng, folder)
    truth = dict(zip(whole.priors.names, whole.priors.sample(rng, 1)[0].tolist(), strict=True))
    flow = mean_heat(whole.simulator, whole.theta(truth | thresholds))
    heat, size = _unmodelled(np.random.default_rng([seed, number, 1]), satellite, kind, flow)
    whole = whole.with_heat(drivers_times(satellite), heat)
    return _observed(satellite, truth, kind, size, flow, whole.simulator, whole.fly(truth | thresholds), rng)


def _load(node: str) -> str:
    """What heat into a node that the scenario does not have is called in that of the flight."""
    return f"unmodelled_{node}"


def drivers_times(satellite: Satellite) -> Any:
    """At which heat is given: every 10 s from the beginning of the flight."""
    return np.arange(START - SETTLING, satellite.times[-1] + _FINE, _FINE)


def written_to(folder: Path, written: Mapping[str, Any]) -> Scenario:
    """The scenario, from its file."""
    file = folder / "scenario.yaml"
    file.write_text(json.dumps(written), encoding="utf-8")
    return load_scenario(file)


def priors_of(scenario: Scenario, names: Sequence[str]) -> Priors:
    """Of some of its parameters."""
    return Priors(tuple(names), tuple(scenario.parameters[name].prior for name in names))


def with_drivers(written: Mapping[str, Any], nodes: Mapping[str, str]) -> dict[str, Any]:
    """The scenario with heat into nodes that a driver in watts gives. nodes: name of load and driver -> node."""
    made = deepcopy(dict(written))
    loads = {name: {"node": node, "driver": name, "coefficient": 1} for name, node in nodes.items()}
    drivers = {name: {"column": name, "unit": "W", "kind": "driver"} for name in nodes}
    made["simulator"]["loads"] = loads
    made["telemetry"]["channels"] |= drivers
    return made


def whole_flight(satellite: Satellite, folder: Path) -> Whole:
    """The simulator of a satellite's flight, with a load at every node whose driver is zero."""
    nodes = [name for name, node in satellite.written["simulator"]["nodes"].items() if "capacity" in node]
    made = with_drivers(satellite.written, {_load(node): node for node in nodes})
    temperature = {"unit": "degC", "kind": "temperature", "stale_after": None}
    kept = {name: item for name, item in made["telemetry"]["channels"].items() if item["kind"] == "driver"}
    made["telemetry"]["channels"] = {f"{node}_temp": {"column": "zero", **temperature} for node in nodes} | kept
    made["telemetry"]["file"] = "flight.csv"
    made["observations"] = {f"{node}_temp": {"node": node} for node in nodes}
    made["simulator"]["step"] = STEP
    parameters = list(made["parameters"])
    for name, heater in made["simulator"]["heaters"].items():
        heater.pop("measured_by")
        for threshold in ("on_below", "off_above"):
            prior = {"normal": {"mean": heater[threshold], "standard_deviation": "100 K"}}
            made["parameters"][f"{threshold}_{name}"] = {"sets": f"heaters.{name}.{threshold}", "prior": prior}
    times = drivers_times(satellite)
    table = {"time": np.datetime_as_string(times, unit="s"), "zero": np.zeros(len(times))}
    table |= {_load(node): np.zeros(len(times)) for node in nodes}
    pd.DataFrame(table).to_csv(folder / "flight.csv", index=False)
    scenario = written_to(folder, made)
    period = orbital_period(scenario.environment, scenario.folder)
    data = read_telemetry(scenario.telemetry, scenario.folder, period=period)
    simulator = network_simulator(scenario, data, times[0], times[-1], satellite.times, period=period)
    return Whole(simulator, priors_of(scenario, parameters))


def mean_heat(simulator: NetworkSimulator, theta: FloatArray) -> dict[str, float]:
    """Mean absolute heat through each node after the settling, W: half of what all flows in and out amount to."""
    network, drive = simulator.network, simulator.drive
    structure, system = network.structure, simulator.system(theta)
    numbers = assemble(simulator.mapping, network.terms, theta)[0]
    run = integrate(structure, system, drive, derivative=False)
    lasting = np.diff(drive.times) * (drive.times[:-1] >= SETTLING / np.timedelta64(1, "s"))
    x, inputs, count = run.states[:-1], drive.inputs[:, 0], len(network.nodes)
    linear = _dense(structure.linear_start, structure.linear_column, system.linear, count)
    radiative = _dense(structure.radiative_start, structure.radiative_column, system.radiative, count)
    found = {}
    for i, node in enumerate(network.nodes):
        others = np.arange(count) != i
        links = linear[i, others] * (x[:, others] - x[:, [i]])
        links_4 = radiative[i, others] * (x[:, others] ** 4 - x[:, [i]] ** 4)
        to_outside = linear[i].sum() * x[:, i] + radiative[i].sum() * x[:, i] ** 4
        flows = [*links.T, *links_4.T]
        for k in np.flatnonzero(structure.forcing_row == i):
            forcing = system.forcing[k] * inputs[:, structure.forcing_column[k]]
            if network.columns[structure.forcing_column[k]] == "one":
                to_outside = to_outside + forcing
            else:
                flows.append(forcing)
        for k in np.flatnonzero(structure.heating_row == i):
            flows.append(system.heating[k] * run.status[:-1, structure.heating_heater[k]])
        absolute = np.abs([to_outside, *flows]).sum(axis=0)
        capacity = numbers[network.position(f"nodes.{node}.capacity")]
        found[node] = float(0.5 * capacity * (absolute @ lasting) / lasting.sum())
    return found


def _dense(start: IntArray, column: IntArray, values: FloatArray, count: int) -> FloatArray:
    """A matrix [n, n] that is stored by rows."""
    found = np.zeros((count, count))
    row = np.repeat(np.arange(count), np.diff(start.astype(np.int64)))
    found[row, column] = values
    return found


# --- what flies -----------------------------------------------------------------------------------------------


def _comfortable(rng: np.random.Generator, folder: Path) -> tuple[Satellite, Whole, dict[str, float]]:
    """A satellite that is neither hot nor cold at the medians of its priors, with thermostats that act there.

    Nothing here depends on the truth: else the priors would not be what it is drawn from. Also its thresholds, K.
    """
    for _ in range(_TRIED):
        satellite = random_satellite(rng)
        whole, heaters = whole_flight(satellite, folder), satellite.written["simulator"]["heaters"]
        cold, warm = (
            whole.means({f"{kind}_{name}": level + more for name in heaters for kind, more in _APART.items()})
            for level in (_NEVER, _ALWAYS)
        )
        if not all(_COMFORTABLE[0] < mean < _COMFORTABLE[1] for mean in cold.values()):
            continue
        written, thresholds = deepcopy(satellite.written), {}
        for name, heater in written["simulator"]["heaters"].items():
            rise = warm[heater["node"]] - cold[heater["node"]]
            below = round(cold[heater["node"]] + rng.uniform(0.25, 0.65) * rise, 1)
            above = round(below + rng.uniform(1.0, 4.0), 1)
            heater |= {"on_below": f"{below} K", "off_above": f"{above} K"}
            thresholds |= {f"on_below_{name}": below, f"off_above_{name}": above}
        return replace(satellite, written=written), whole, thresholds
    raise RuntimeError(f"none of {_TRIED} random satellites is comfortable")


def _unmodelled(
    rng: np.random.Generator, satellite: Satellite, kind: str, flow: Mapping[str, float]
) -> tuple[dict[str, FloatArray], dict[str, float]]:
    """Heat into one to all nodes, and its root mean square over the heat that flows through each."""
    if kind == "none":
        return {}, {}
    at = (drivers_times(satellite) - START) / np.timedelta64(1, "s")
    nodes = list(satellite.written["simulator"]["nodes"])
    chosen = [nodes[k] for k in rng.permutation(len(nodes))[: int(rng.integers(1, len(nodes) + 1))]]
    heat, size = {}, {}
    for node in chosen:
        amplitude = rng.choice([-1.0, 1.0]) * rng.uniform(_LEAST, _MOST)
        if kind == "constant":
            shape = np.ones(len(at))
        elif kind == "square wave":
            shape = ((at / satellite.period + rng.random()) % 1.0 < rng.uniform(0.2, 0.6)).astype(float)
        else:
            shape = _drift(rng, at, rng.uniform(2.0, 8.0) * 3600.0)
            shape /= np.sqrt(np.mean(shape[at >= 0.0] ** 2))
        heat[node] = np.round(amplitude * flow[node] * shape, 9)
        size[node] = float(abs(amplitude) * np.sqrt(np.mean(shape[at >= 0.0] ** 2)))
    return heat, size


def _drift(rng: np.random.Generator, at: FloatArray, correlation: float) -> FloatArray:
    """An Ornstein-Uhlenbeck process of deviation one at knots 20 minutes apart, linear in between."""
    apart = 1200.0
    knots = np.arange(at[0], at[-1] + apart, apart)
    kept = np.exp(-apart / correlation)
    values = rng.standard_normal(len(knots))
    for k in range(1, len(knots)):
        values[k] = kept * values[k - 1] + np.sqrt(1.0 - kept**2) * values[k]
    return np.interp(at, knots, values)


def _observed(
    satellite: Satellite,
    truth: dict[str, float],
    kind: str,
    size: dict[str, float],
    flow: dict[str, float],
    simulator: NetworkSimulator,
    run: Trajectory,
    rng: np.random.Generator,
) -> Flight:
    """Telemetry of a simulated flight. Of a node without a sensor, the first temperature is known to some kelvin."""
    table: dict[str, Any] = {"time": np.datetime_as_string(satellite.times, unit="s")}
    written = deepcopy(satellite.written)
    for channel, temperatures in zip(simulator.channels, run.temperatures.T, strict=True):
        sensor, node = satellite.sensors.get(channel), channel.removesuffix("_temp")
        if sensor is None:
            known = temperatures[0] + _INITIAL_KNOWN * rng.standard_normal()
            written["simulator"]["nodes"][node]["initial"] = f"{known:.3f} K"
            continue
        noisy = temperatures - ICE_POINT + sensor.noise * rng.standard_normal(len(temperatures))
        table[channel] = np.round(np.round(noisy / sensor.step) * sensor.step, 6)
    settling = SETTLING / np.timedelta64(1, "s")
    last, switches, on = float(simulator.drive.times[-1]), run.switches, {}
    for k, heater in enumerate(simulator.heaters):
        table[f"{heater}_status"] = run.status[:, k]
        mine = switches.heater == k
        changes = [float(time) for time in switches.time[mine]]
        on_at_first = switches.on[mine][0] < 0.5 if mine.any() else run.status[0, k] > 0.5
        if on_at_first:
            changes.insert(0, 0.0)
        changes += [last] * (len(changes) % 2)
        on[heater] = [
            (begin - settling, end - settling) for begin, end in zip(changes[::2], changes[1::2], strict=True)
        ]
    return Flight(replace(satellite, written=written), truth, kind, size, flow, pd.DataFrame(table), on)


def read_flight(
    flight: Flight, written: Mapping[str, Any], folder: Path, drivers: Mapping[str, FloatArray] | None = None
) -> tuple[Scenario, xarray.Dataset]:
    """A scenario for the flight and its telemetry, from files; drivers: further columns."""
    pd.concat([flight.telemetry, pd.DataFrame(dict(drivers or {}))], axis=1).to_csv(
        folder / "telemetry.csv", index=False
    )
    scenario = written_to(folder, written)
    period = orbital_period(scenario.environment, scenario.folder)
    return scenario, read_telemetry(scenario.telemetry, scenario.folder, period=period)
