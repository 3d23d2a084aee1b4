"""One stretch of telemetry and the simulator for it: a likelihood, without priors.

A window reads theta of its own [q], in physical units, ordered: the scenario's parameters;
``telemetry.time_error`` (s); what is inferred of noise and discrepancy (``noise.<channel>``,
``noise.<channel>.<what>``, ``discrepancy.phase.<what>[.<channel>]``); ``timing.<channel>`` (s) and
``error_rate.<channel>`` of a heater's status where these are; ``initial.<node>`` (K).
`problem.Problem` says where these come from among what is calibrated.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..compiled import Spare
from ..environment import orbital_period
from ..errors import FlightcalError
from ..probability import (
    DEVIATION,
    THRESHOLD_ERROR,
    Bars,
    HeaterStatus,
    Likelihood,
    NoiseKind,
    Priors,
    PriorTerms,
    ResidualModel,
    Residuals,
    WindowHeat,
)
from ..scenario import Numbers, Prior, Scenario
from ..simulator import FloatArray, NetworkSimulator, SimulationFailure, Simulator, Switch, Trajectory
from ..telemetry import window_bounds

_DIFFERENCE = 1e-4
"""Of a coordinate, whose prior has a standard deviation of about one."""
_BLOCKS = ("nodes", "conductors", "faces", "environment", "modes", "heaters", "loads")
PIN = "telemetry of "
"""Begins the names of what holds nodes at their telemetry, which no scenario has: see `pinned.py`."""
_NO_SIZES = ("boundary", "on_below", "off_above")
"""Numbers in these that are temperatures."""


@dataclass(frozen=True)
class Switching:
    """Switches of heaters that are driven by their measured status: each lies somewhere between two samples."""

    time: FloatArray
    """[E] s from the window's start, midway."""
    interval: FloatArray
    """[E] s, between the samples."""
    heater: tuple[str, ...]
    """[E] that has switched, and with it those that are switched with it."""


@dataclass(frozen=True)
class Change:
    """A change of mode."""

    time: float
    """s from the window's start."""
    before: str
    after: str
    within: float = 0.0
    """s, how long a time it lies in, `time` in its middle."""


@dataclass(frozen=True)
class Bridged:
    """A load whose driver is not known for a time: between samples that are far apart, or from which it jumps."""

    load: str
    begin: float
    """s from the window's start."""
    end: float
    deviation: float
    """Of the driver from what is taken for it, in its SI unit."""


@dataclass(frozen=True)
class Course:
    """A driver over a window, of which unmodelled heat is a function."""

    seconds: FloatArray
    """[M] s from the window's start."""
    values: FloatArray
    """[M] in the driver's SI unit, linear in between."""
    range: tuple[float, float]
    """Over all telemetry."""


@dataclass(frozen=True)
class Window:
    """Telemetry of one window, what simulates it, and how the two may differ."""

    scenario: Scenario
    name: str
    start: np.datetime64
    """UTC, before the first sample, or at it."""
    times: Any
    """[T] datetime64, UTC."""
    observed: FloatArray
    """[T, N] K, NaN where there is no valid sample."""
    status: FloatArray
    """[T, H] measured heater status, NaN where unknown."""
    simulator: Simulator
    residuals: ResidualModel
    """Noise and discrepancy."""
    reads: dict[str, Prior]
    """Names of what it reads of theta [q], and the prior that this window alone would give to each."""
    heater_status: HeaterStatus | None = None
    """What the telemetry says of the heaters, where the scenario gives it a likelihood."""
    measured_switches: Switch | None = None
    """In open loop, when heaters with uncertain thresholds switched; None: in closed loop."""
    switching: Switching | None = None
    """In open loop, what is known of when heaters switched."""
    changes: tuple[Change, ...] = ()
    """Changes of mode in it."""
    bridged: tuple[Bridged, ...] = ()
    """Loads whose drivers have gaps in it."""
    course: Course | None = None
    """What the pattern of unmodelled heat is a function of; None: the orbit's phase."""
    heat: WindowHeat | None = None
    """How temperatures respond to unmodelled heat; None: there is none, or it has not been looked at."""

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of its theta's entries [q]."""
        return tuple(self.reads)

    @property
    def label(self) -> str:
        """What it is called among several to train on: the part after ``train.``."""
        return self.name.removeprefix("train.")

    @cached_property
    def period(self) -> float:
        """Of the orbit, s."""
        return orbital_period(self.scenario.environment, self.scenario.folder)

    @cached_property
    def span(self) -> tuple[np.datetime64, np.datetime64]:
        """Its start and its end, UTC."""
        return self.start, window_bounds(self.scenario.windows[self.name], self.period)[1]

    @property
    def duration(self) -> float:
        """s, what duty cycles are shares of."""
        return float((self.span[1] - self.start) / np.timedelta64(1, "s"))

    @cached_property
    def valid(self) -> Any:
        """[T, N] whether there is a valid sample."""
        return np.isfinite(self.observed)

    @cached_property
    def simulated(self) -> Any:
        """Positions in theta of what the simulator takes, in its order."""
        return np.array([self.names.index(name) for name in self.simulator.parameters], dtype=np.int64)

    @cached_property
    def places(self) -> Any:
        """Of the residuals' numbers that are entries of theta: channels, columns and positions in theta, [.] each."""
        entries = self.residuals.entries
        found = [(entry.channel, entry.column, self.names.index(entry.name)) for entry in entries]
        return tuple(np.array(found, np.int64).reshape(-1, 3).T)

    @cached_property
    def inferred_noise(self) -> Any:
        """Channels [.] whose noise is inferred, and the positions in theta [.] of its standard deviation."""
        channels, columns, positions = self.places
        return channels[columns == DEVIATION], positions[columns == DEVIATION]

    @cached_property
    def written(self) -> Numbers:
        """Numbers of noise and discrepancy [N n], settings of the status [P], of heat [g + c]; what theta sets."""
        fixed, status = self.residuals.fixed, self.heater_status
        sets = [
            (channel * fixed.shape[1] + column, position)
            for channel, column, position in zip(*self.places, strict=True)
        ]
        if status is not None:
            inferred = zip(status.inferred, status.priors, strict=True)
            sets += [(fixed.size + place, self.names.index(name)) for place, name in inferred]
        settings = np.empty(0) if status is None else status.settings
        first = fixed.size + len(settings)
        entries = () if self.heat is None else self.heat.entries
        sets += [(first + place, self.names.index(name)) for place, name in enumerate(entries) if name]
        pairs = np.array(sets, np.int64).reshape(-1, 2)
        values = np.concatenate([fixed.ravel(), settings, np.ones(len(entries))])
        return Numbers((), values, pairs, np.empty((0, 2), np.int64))

    @cached_property
    def bounds(self) -> tuple[int, int]:
        """Where among these the settings of the status begin, and the scales of heat."""
        first, status = self.residuals.fixed.size, self.heater_status
        return first, first + (0 if status is None else len(status.settings))

    def status_settings(self, theta: FloatArray) -> FloatArray:
        """Settings [P] of the status likelihood at theta [q]."""
        first, last = self.bounds
        return self.written.at(theta)[first:last]

    def scales(self, theta: FloatArray) -> FloatArray:
        """Prior deviations [g] of the weights of heat at theta [q], and what the response follows [c]."""
        return self.written.at(theta)[self.bounds[1] :]

    def growth(self, theta: FloatArray) -> FloatArray:
        """[m] by how much more each weight of heat does at theta [q] than where the response was looked at."""
        assert self.heat is not None
        if self.heat.follows is None:
            return np.ones(len(self.heat.group))
        return self.heat.follows.growth(self.scales(theta)[None, len(self.heat.scales) :])[0]

    def roots(self, theta: FloatArray) -> FloatArray:
        """Prior deviations [m] of what each weight does, for the response as it was looked at."""
        assert self.heat is not None
        if self.heat.sizes is not None:
            return self.heat.sizes.roots
        return self.scales(theta)[self.heat.group] * self.growth(theta)

    @cached_property
    def target(self) -> FloatArray:
        """[T, N] K that a simulation is held to: telemetry, and the response to the heat that simulations have."""
        return self.observed if self.heat is None else self.observed + self.heat.centre

    @property
    def is_network(self) -> bool:
        """Whether the simulator is a thermal network: compiled, and with thermostats that are known."""
        return isinstance(self.simulator, NetworkSimulator)

    @property
    def network(self) -> NetworkSimulator:
        """The simulator, which is a thermal network. Raises FlightcalError where it is another."""
        if not isinstance(self.simulator, NetworkSimulator):
            raise FlightcalError(f"window '{self.name}': found another simulator, expected a thermal network")
        return self.simulator

    @cached_property
    def terms(self) -> Residuals:
        """What the residuals are made of, with the error of a simulator that stands in for another."""
        terms = self.residuals.terms.with_errors(self.simulator.error_basis)
        return terms if self.heat is None else replace(terms, heat=self.heat)

    def numbers(self, theta: FloatArray) -> FloatArray:
        """The numbers of noise and discrepancy [N, n] at theta [q]; see `noise`."""
        fixed = self.residuals.fixed
        return self.written.at(theta)[: fixed.size].reshape(fixed.shape)

    def noise(self, theta: FloatArray) -> FloatArray:
        """Standard deviation of the noise of one sample of each channel [N], K, at theta [q]; discrepancy apart."""
        return self.residuals.deviations(self.numbers(theta))

    def draw_errors(self, theta: FloatArray, rng: np.random.Generator, shared: FloatArray | None = None) -> FloatArray:
        """What telemetry at theta [q] differs by from the simulation, [T, N] K: noise and discrepancy, drawn anew.

        shared: as in `ResidualModel.draw_errors`.
        """
        return self.residuals.draw_errors(self.numbers(theta), rng, shared)

    # --- simulations --------------------------------------------------------------------------------------------

    def simulate(self, theta: FloatArray) -> Trajectory:
        """The simulation at theta [q]. Raises SimulationFailure."""
        return self.simulator.simulate(theta[self.simulated])

    def simulate_many(self, thetas: FloatArray, heat: FloatArray | None = None) -> list[Trajectory | None]:
        """Simulations at thetas [S, q]; None where one failed.

        heat: [S, h, 2 K] W that no block describes, of a thermal network.
        """
        if heat is None or not self.is_network:
            return self.simulator.simulate_many(thetas[:, self.simulated])
        return self.network.simulate_many(thetas[:, self.simulated], heat)

    def simulate_as_flown(
        self, thetas: FloatArray, rng: np.random.Generator, heat: FloatArray | None = None
    ) -> list[Trajectory | None]:
        """The same, with thermostats that switch around their thresholds as far as the scenario says (`scatter`)."""
        if not self.is_network:
            return self.simulate_many(thetas)
        return self.network.simulate_scattered(thetas[:, self.simulated], rng, heat)

    @cached_property
    def first_sample(self) -> float:
        """Time of the first sample, s from the window's start."""
        return float((self.times[0] - self.start) / np.timedelta64(1, "ns") * 1e-9)

    @cached_property
    def interval(self) -> float:
        """The usual one between samples, s."""
        seconds = (self.times - self.times[0]) / np.timedelta64(1, "ns") * 1e-9
        return float(np.median(np.diff(seconds)))

    # --- variants -----------------------------------------------------------------------------------------------

    def begun(self, on: FloatArray) -> Window:
        """The same whose heaters are on as in `on` [H], 0 or 1, at first; of a thermal network."""
        return replace(self, simulator=replace(self.network, drive=replace(self.network.drive, initially_on=on)))

    def with_written(self, numbers: FloatArray) -> Window:
        """The same with other numbers [V] written in the scenario; of a thermal network."""
        mapping = self.network.mapping._replace(written=numbers)
        return replace(self, simulator=replace(self.network, mapping=mapping))

    def multiplied(self, places: Sequence[int], factor: float) -> Window:
        """The same with some of the scenario's written numbers times a factor; of a thermal network."""
        numbers = self.network.mapping.written.copy()
        numbers[list(places)] *= factor
        return self.with_written(numbers)

    @cached_property
    def sizes(self) -> tuple[int, ...]:
        """Places of a thermal network's written numbers of which a relative error makes sense, and that are not zero.

        Of nodes, links, surfaces and heat, without temperatures and angles.
        """
        if not self.is_network:
            return ()
        written = self.network.mapping.written
        return tuple(k for k, path in enumerate(self.network.network.paths) if written[k] != 0.0 and _is_size(path))

    @cached_property
    def unmeasured(self) -> tuple[int, ...]:
        """Heaters of a thermal network whose status is not measured: for how long these are on is not known."""
        if not self.is_network:
            return ()
        switches = self.scenario.network.switches
        return tuple(k for k, name in enumerate(self.network.heaters) if switches[name].measured_by is None)

    def independent(self) -> Window:
        """The same window, its theta too, with independent normal noise alone: no discrepancy, no correlation."""
        return replace(self, residuals=self.residuals.independent())

    def with_known_shape(
        self, kinds: Sequence[NoiseKind], scales: Mapping[str, Prior], deviations: FloatArray | None = None
    ) -> Window:
        """The same with noise of kinds [N] whose deviations alone are inferred, or known, and reading scales of heat.

        deviations: [N] K; None: they are inferred.
        """
        residuals = self.residuals.with_known_shape(kinds, deviations)
        dropped = {entry.name for entry in self.residuals.entries} - {entry.name for entry in residuals.entries}
        kept = {name: prior for name, prior in self.reads.items() if name not in dropped}
        initial = {name: prior for name, prior in kept.items() if name.startswith("initial.")}
        reads = {name: prior for name, prior in kept.items() if name not in initial} | dict(scales) | initial
        return replace(self, residuals=residuals, reads=reads)

    # --- the likelihood -----------------------------------------------------------------------------------------

    def of_heaters(self, theta: FloatArray, run: Trajectory) -> float:
        """Log likelihood, up to a constant, of what is measured of the heaters, with the simulation at theta [q].

        Raises SimulationFailure.
        """
        if self.measured_switches is not None:
            return self.at_thresholds(theta)[0]
        if self.heater_status is not None:
            return float(self.heater_status.log_likelihood(run, self.status_settings(theta))[0])
        return 0.0

    def pull_back(
        self,
        theta: FloatArray,
        run: Trajectory,
        cotangent: Callable[..., FloatArray],
        bars: Bars,
    ) -> tuple[float, FloatArray]:
        """Log likelihood of the heaters' status, and the gradient [q] of that and of the residuals; thresholds apart.

        cotangent: of the simulation at theta [q]; bars: of the residuals.
        """
        value, settings_bar, switches_bar = 0.0, None, {}
        if self.heater_status is not None and self.measured_switches is None:
            settings = self.status_settings(theta)
            value, switches_bar["switches_bar"], settings_bar = self.heater_status.log_likelihood(run, settings)
        theta_bar = self.by_numbers(bars.numbers, settings_bar, bars.scales)
        theta_bar[self.simulated] += cotangent(*self._cotangents(bars.simulated, bars.variance), **switches_bar)
        return float(value), theta_bar

    def at_thresholds(self, theta: FloatArray) -> tuple[float, FloatArray, Callable[[FloatArray], FloatArray]]:
        """In open loop: log likelihood (up to a constant) of the sensors being at their thresholds when heaters switch.

        Also the scaled deviations [E], and the vector-Jacobian product of these, to theta [q]. Raises
        SimulationFailure.
        """
        assert self.measured_switches is not None
        excess, pull_back = self.network.threshold_excess(theta[self.simulated], self.measured_switches)
        scaled = excess / THRESHOLD_ERROR

        def to_theta(bar: FloatArray) -> FloatArray:
            theta_bar = np.zeros(len(self.names))
            theta_bar[self.simulated] = pull_back(bar / THRESHOLD_ERROR)
            return theta_bar

        return -0.5 * float((scaled**2).sum()), scaled, to_theta

    def of_residuals(self, theta: FloatArray, run: Trajectory) -> float:
        """Log likelihood of the temperatures, as if of this window alone, with the simulation at theta [q]."""
        given = self.target, run.temperatures, self.numbers(theta), run.error_variance, self.scales(theta)
        with self._likelihoods.borrowed(self._likelihood, given[2].shape[1]) as likelihood:
            return float(likelihood(given)[0])

    def _cotangents(self, temperatures_bar: FloatArray, variance_bar: FloatArray) -> tuple[FloatArray, ...]:
        """What the vector-Jacobian product of the simulator takes."""
        return (temperatures_bar,) if self.simulator.error_basis is None else (temperatures_bar, variance_bar)

    @cached_property
    def _likelihoods(self) -> Spare[Likelihood]:
        return Spare()

    def _likelihood(self, numbers: int) -> Likelihood:
        return Likelihood([self.terms], numbers)

    def by_numbers(
        self, numbers_bar: FloatArray, settings_bar: FloatArray | None = None, scales_bar: FloatArray | None = None
    ) -> FloatArray:
        """Derivative by theta [q] from that by the residuals' numbers [N, n], the status' settings [P] and the scales
        of heat [g] (None: 0)."""
        bar, (first, last) = np.zeros(len(self.written.values)), self.bounds
        bar[:first] = numbers_bar.ravel()
        if settings_bar is not None:
            bar[first:last] = settings_bar
        if scales_bar is not None:
            bar[last:] = scales_bar
        return self.written.pull_back(np.zeros(len(self.names)), bar)

    # --- its curvature ------------------------------------------------------------------------------------------

    def jacobian(self, priors: Priors, coordinates: FloatArray) -> FloatArray:
        """d temperatures [T, N, q] by coordinates [q] whose theta `priors` give: central differences of one batch.

        The located switching makes the simulation smooth, so they are good to about seven digits; zero for what is not
        simulated. Raises SimulationFailure.
        """
        steps = np.zeros((len(self.simulated), len(coordinates)))
        steps[np.arange(len(steps)), self.simulated] = _DIFFERENCE
        runs = self.simulate_many(priors.to_theta(np.concatenate([coordinates + steps, coordinates - steps])))
        jacobian = np.zeros((*self.observed.shape, len(coordinates)))
        for k, right, left in zip(self.simulated, runs, runs[len(steps) :], strict=False):
            if right is None or left is None:
                raise SimulationFailure(f"a simulation next to this point fails, in the direction of '{self.names[k]}'")
            jacobian[..., k] = (right.temperatures - left.temperatures) / (2.0 * _DIFFERENCE)
        return jacobian

    def noise_information(self, prior: PriorTerms) -> FloatArray:
        """Curvature [q, q] of minus the log likelihood in what is inferred of noise and discrepancy.

        By coordinates whose theta [q] and slopes are `prior`'s; as if a surrogate were exact, bent to be positive.
        Raises SimulationFailure.
        """
        run = self.simulate(prior.theta)
        residual = np.where(self.valid, self.observed - run.temperatures, 0.0)
        channels, columns, positions = self.places
        by_logarithm = self.residuals.curvature(residual, self.numbers(prior.theta))
        rate = prior.slope[positions] / prior.theta[positions]
        curvature = np.zeros((len(prior.theta), len(prior.theta)))
        same = channels[:, None] == channels
        blocks = by_logarithm[channels[:, None], columns[:, None], columns] * rate[:, None] * rate
        np.add.at(curvature, (positions[:, None], positions[None, :]), np.where(same, blocks, 0.0))
        noise_positions = np.unique(positions)
        eigenvalues, directions = np.linalg.eigh(curvature[np.ix_(noise_positions, noise_positions)])
        curvature[np.ix_(noise_positions, noise_positions)] = (directions * np.abs(eigenvalues)) @ directions.T
        return curvature

    def status_information(self, prior: PriorTerms) -> FloatArray:
        """What the heaters' status adds to `noise_information` [q, q], with an exact Jacobian of the switches."""
        hessian = np.zeros((len(prior.theta),) * 2)
        rows: list[FloatArray] = []
        if self.measured_switches is not None:
            _, scaled, pull_back = self.at_thresholds(prior.theta)
            rows = [pull_back(row)[self.simulated] for row in np.eye(len(scaled))]
        elif self.heater_status is not None:
            run, cotangent = self.simulator.linearise(prior.theta[self.simulated])
            settings = self.status_settings(prior.theta)
            weights, precision = self.heater_status.information(run, settings)
            none = self._cotangents(np.zeros(run.temperatures.shape), np.zeros(run.error_variance.shape))
            rows = [cotangent(*none, switches_bar=row) for row in weights]
            by_theta = self.by_numbers(np.zeros(self.residuals.fixed.shape), precision)
            hessian[np.diag_indices(len(hessian))] = by_theta * prior.slope**2
        jacobian = np.reshape(rows, (-1, len(self.simulated))) * prior.slope[self.simulated]
        hessian[np.ix_(self.simulated, self.simulated)] += np.einsum("ei,ej->ij", jacobian, jacobian)
        return hessian

    # --- how far off --------------------------------------------------------------------------------------------

    def residual(self, run: Trajectory) -> FloatArray:
        """Telemetry minus simulation [T, N], K; NaN where there is no valid sample."""
        return np.where(self.valid, self.observed - run.temperatures, np.nan)

    def mean_squares(self, thetas: FloatArray, status_weight: float) -> FloatArray:
        """Mean square error over all channels [S], K^2, of simulations at thetas [S, q]; NaN where one fails.

        status_weight: kelvin that a wrongly simulated heater status sample counts as.
        """
        observed, known = np.where(self.valid, self.observed, 0.0), np.isfinite(self.status).any()

        def score(temperatures: FloatArray, status: FloatArray) -> FloatArray:
            residual = temperatures - observed
            mean_squares = np.einsum("stk,stk,tk->s", residual, residual, self.valid) / self.valid.sum()
            if status_weight > 0.0 and known:
                mean_squares += status_weight**2 * np.nanmean(np.abs(self.status - status), axis=(1, 2))
            return np.asarray(mean_squares)

        if self.is_network:
            return self.network.score_many(thetas[:, self.simulated], score)
        runs = self.simulate_many(thetas)
        return np.array([np.nan if run is None else score(run.temperatures[None], run.status[None])[0] for run in runs])


def _is_size(path: str) -> bool:
    first, *_, last = path.split(".")
    return first in _BLOCKS and last not in _NO_SIZES and "attitude_offset" not in path and PIN not in path
