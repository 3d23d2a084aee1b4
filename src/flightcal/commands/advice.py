"""What is not wrong with a scenario and its telemetry, and had better be otherwise."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from itertools import pairwise, product
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray

    from ..problem import Window
    from ..scenario import Scenario

_RARE = 1e-9
"""Probability of a prior, beyond which nobody means what is written."""
_ALIKE = 0.1
"""Of the prior's range, by which what is written may lie beyond it."""
_LARGE = 100.0
"""m^2, of a face, beyond which it may be in cm^2."""
_MUCH = 0.5
"""Share of a channel's samples beyond a table or its limits, from which it is told."""
_MANY_DROPPED = 0.1
"""Share of the rows that have another row's time, from which they are no accident."""
_SHORT = 10.0
"""s, by which temperatures do not tell that a driver is late."""
_LEAD = 12
"""Hours that are simulated before a plan, from which on little is left of how they began."""
_APART = 3
"""Windows that tell what changes steadily from what does not."""
_COARSE = 0.05
"""K, of the integration: more than a thermistor's step."""


def advice(scenario: Scenario, data: xarray.Dataset, trained: Sequence[Window]) -> Iterator[str]:
    """What is not wrong, and had better be otherwise; trained: the windows to train on."""
    yield from _of_conflicts(data)
    yield from _of_sampling(data, sum(len(window.times) for window in trained))
    yield from _of_channels(scenario, data)
    yield from _of_faces(scenario)
    yield from _of_priors(scenario)
    yield from _of_tables(scenario, data)
    yield from _of_observations(scenario, data)
    yield from _of_heaters(scenario, data, trained)
    yield from _of_plans(scenario, data)
    yield from _of_limits(scenario, data)
    yield from _of_drivers_before(scenario, data)
    yield from _of_trends(scenario, len(trained))
    yield from _of_age(scenario, trained)
    yield from of_steps(trained)


def _of_conflicts(data: xarray.Dataset) -> Iterator[str]:
    """Of rows that have their time in common with others, which are dropped."""
    dropped, rows = data.attrs["conflicts"], data.attrs["rows_read"]
    if dropped > _MANY_DROPPED * rows:
        yield (
            f"telemetry: {dropped} of {rows} rows are dropped, for another row has the same time and other values; "
            "where a file has a row for each reading, 'readings' says so, and files of one parameter each are 'packets'"
        )


def _of_sampling(data: xarray.Dataset, rows: int) -> Iterator[str]:
    """Of samples that means would tell as much as."""
    from ..telemetry import ENOUGH, LONG, MANY, dense_channels, length_in_common

    together = length_in_common(data, rows)
    if together is not None:
        yield (
            f"telemetry: the packets are sampled at times of their own, {rows} of them in the windows to train on; "
            f"write 'average: {together / 60:g} min' below 'telemetry:': means have their times in common, and "
            "calibration takes a fraction of the time and memory"
        )
        return
    dense, length = dense_channels(data), ENOUGH
    if not dense and rows > MANY:
        dense, length = dense_channels(data, below=0.5 * LONG), LONG
    if dense:
        some, more = next(iter(dense)), f" and {len(dense) - 1} more" if len(dense) > 1 else ""
        yield (
            f"telemetry: samples are {dense[some]:.3g} s apart ({some}{more}); "
            f"write 'average: {length:g} s' below 'telemetry:': means tell as much of temperatures that change in "
            "minutes, and calibration takes a fraction of the time and memory"
        )


def _of_channels(scenario: Scenario, data: xarray.Dataset) -> Iterator[str]:
    """Of drivers that are held though they are sampled, and of samples to leave out that are not there."""
    import numpy as np

    from ..telemetry import sampled_every

    times, half = data["time"].values, np.timedelta64(round(5e8 * data.attrs.get("average_s", 0.0)), "ns")
    for channel, block in scenario.telemetry.channels.items():
        every = sampled_every(data, channel) if block.kind == "driver" and block.fill == "hold" else None
        if every is not None and every > _SHORT:
            yield (
                f"telemetry.channels.{channel}: its samples come every {every:.3g} s, so with 'fill: hold' a change is "
                f"up to {every:.3g} s late; leave 'fill' out, unless a sample is sent at the moment of each change"
            )
        for span in block.leave_out:
            start, end = np.datetime64(span.start) - half, np.datetime64(span.end) + half
            if not ((times >= start) & (times <= end)).any():
                yield (
                    f"telemetry.channels.{channel}: no sample is from {span.start.isoformat()} to "
                    f"{span.end.isoformat()}, which 'leave_out' names; check its dates"
                )


def _of_faces(scenario: Scenario) -> Iterator[str]:
    """Of faces that are larger than a satellite's, have no other side, or that the Earth sends nothing to."""
    from ..scenario import SimulatorModel, SunTracking

    if not isinstance(scenario.simulator, SimulatorModel):
        return
    faces = scenario.simulator.faces
    for name, face in faces.items():
        if face.area > _LARGE:
            yield f"simulator.faces.{name}: its area is {face.area:g} m^2; check its unit"
        if not isinstance(face.normal, SunTracking):
            continue
        sides = {
            each_face.normal.back
            for each_face in faces.values()
            if each_face.node == face.node and isinstance(each_face.normal, SunTracking)
        }
        if len(sides) == 1:
            other = "false" if face.normal.back else "true"
            yield (
                f"simulator.faces.{name}: what turns to the Sun has two sides, and {face.node} has no face with "
                f"'back: {other}'; write the other side, unless it is insulated"
            )
    environment = scenario.environment
    for field, does, usual, feel in (
        ("albedo", "reflects", "about 0.3", any(face.absorptivity for face in faces.values())),
        ("earth_infrared", "radiates", "about 237 W/m^2", any(face.emissivity for face in faces.values())),
    ):
        zero = not getattr(environment, field) and f"environment.{field}" not in scenario.uncertain
        if zero and environment.orbit is not None and feel:
            yield (
                f"environment.{field}: it is 0, so the Earth {does} nothing to the satellite, and other numbers make "
                f"up for that; write {usual}, unless something else brings this heat"
            )


def _of_priors(scenario: Scenario) -> Iterator[str]:
    """Of numbers that the priors in their place do not reach."""
    from ..probability import Priors
    from ..scenario import written_values

    priors = Priors(tuple(scenario.parameters), tuple(parameter.prior for parameter in scenario.parameters.values()))
    lowest, highest = (priors.quantile(share) for share in (_RARE, 1.0 - _RARE))
    for (name, value), low, high in zip(written_values(scenario).items(), lowest, highest, strict=True):
        beyond = max(low - value, value - high) > _ALIKE * (high - low)
        if beyond and (sets := scenario.parameters[name].sets):
            yield (
                f"parameters.{name}: its prior is from {low:.3g} to {high:.3g} (SI), and {sets[0]} is written as "
                f"{value:.3g}; the prior is what counts: check the units of both"
            )


def _of_tables(scenario: Scenario, data: xarray.Dataset) -> Iterator[str]:
    """Of drivers that lie beyond the tables of loads."""
    import numpy as np

    from ..scenario import SimulatorModel, table_places

    loads = scenario.simulator.loads if isinstance(scenario.simulator, SimulatorModel) else {}
    for name, load in loads.items():
        values = data[load.driver].values[np.isfinite(data[load.driver].values)]
        if not load.table or not len(values):
            continue
        values = np.abs(values) if load.absolute else values
        first, *_, last = table_places(load, scenario.telemetry.channels[load.driver])
        outside = np.mean((values < first) | (values > last))
        if outside > _MUCH:
            yield (
                f"simulator.loads.{name}: {outside:.0%} of the samples of '{load.driver}' lie beyond its table, whose "
                f"ends then count; check 'unit' of '{load.driver}'"
            )


def _of_observations(scenario: Scenario, data: xarray.Dataset) -> Iterator[str]:
    """Of a status that never changes, and of correlated noise beside steps that it does not explain."""
    import numpy as np

    from ..scenario import noise_of
    from ..telemetry import quantisation_step

    for channel, item in scenario.observations.items():
        on = data[channel].values[np.isfinite(data[channel].values)]
        if item.heater is not None and len(on) and (on == on[0]).all():
            state = "on" if on[0] > 0.5 else "off"
            yield f"observations.{channel}: it is {state} in all {len(on)} samples; check what tells that it is {state}"
        step = None if item.heater is not None else quantisation_step(data[channel].values)
        if step is None:
            continue
        noise = noise_of(scenario, channel)
        if noise.model == "ar1" and noise.white is None:
            yield (
                f"observations.{channel}: its samples come in steps of {step:.3g} K, which correlated noise alone does "
                f"not explain; write 'white' beside 'model: ar1', such as 'white: {step / 12**0.5:.2g} K' (a step over "
                "root 12)"
            )


def _of_plans(scenario: Scenario, data: xarray.Dataset) -> Iterator[str]:
    """Of planned windows in which no mode or attitude changes any more, for longer than any has lasted."""
    import numpy as np

    from ..scenario import AttitudeTimeline, SimulatorModel
    from ..telemetry import window_bounds

    model, attitude = scenario.simulator, scenario.environment.attitude
    timelines: dict[str, list[tuple[datetime, str]]] = {}
    if isinstance(model, SimulatorModel):
        timelines["simulator.timeline"] = [(change.at, f"mode '{change.mode}'") for change in model.timeline]
    if isinstance(attitude, AttitudeTimeline):
        timelines["environment.attitude.timeline"] = [
            (change.at, f"attitude '{change.attitude}'") for change in attitude.timeline
        ]
    plans = {name: window for name, window in scenario.windows.items() if window.planned}
    for (window, plan), (place, changes) in product(plans.items(), timelines.items()):
        if len(changes) < 2:
            continue
        at, kept = changes[-1]
        longest = max(after - before for (before, _), (after, _) in pairwise(changes))
        _, end = window_bounds(plan, data.attrs.get("period_s"))
        if at < plan.start or end - np.datetime64(at) > np.timedelta64(longest):
            rest = "all" if at < plan.start else "the rest"
            yield (
                f"windows.{window}: {place} has no change after {at.isoformat()}, so {rest} of the plan is in {kept}; "
                "add what is planned"
            )


def _of_drivers_before(scenario: Scenario, data: xarray.Dataset) -> Iterator[str]:
    """Of planned windows that nothing can be simulated up to, for a driver is not known before them."""
    import numpy as np

    from ..telemetry import driver_gaps

    drivers = {name: channel for name, channel in scenario.telemetry.channels.items() if channel.kind == "driver"}
    gaps = {name: driver_gaps(data, name, channel.bridge)[0] for name, channel in drivers.items()}
    for window, plan in scenario.windows.items():
        start = np.datetime64(plan.start, "ns")
        for name, spans in gaps.items() if plan.planned else ():
            for begin, end in spans:
                if begin < start - np.timedelta64(1, "h") and end > start - np.timedelta64(_LEAD, "h"):
                    known = np.datetime_as_string(end, unit="s")
                    yield (
                        f"windows.{window}: '{name}' has no sample before {known}, so the temperatures at which the "
                        "plan begins are hardly known; add two days of it before the plan"
                    )
                    break


def _of_limits(scenario: Scenario, data: xarray.Dataset) -> Iterator[str]:
    """Of limits outside of which a channel always is."""
    import numpy as np

    for name, channel in scenario.telemetry.channels.items():
        if channel.limits is None or name not in data or not data[name].notnull().any():
            continue
        low, high = (
            limit if limit is not None else other for limit, other in zip(channel.limits, (0.0, np.inf), strict=True)
        )
        read = data[name].values[np.isfinite(data[name].values)]
        if np.mean((read < low) | (read > high)) > _MUCH:
            yield f"telemetry.channels.{name}.limits: more than half of its readings are outside; check their unit"


def _of_trends(scenario: Scenario, windows: int) -> Iterator[str]:
    """Of trends that so many windows to train on do not tell from drifts."""
    for name, parameter in scenario.parameters.items():
        if parameter.trend is not None and parameter.drift is not None and windows < _APART:
            yield (
                f"parameters.{name}: 'trend' beside 'drift' is told by {_APART} windows to train on or more, and there "
                f"{'is' if windows == 1 else 'are'} {windows}; leave 'drift' out"
            )


def _of_age(scenario: Scenario, trained: Sequence[Window]) -> Iterator[str]:
    """Of windows so long after what is trained on that a satellite ages."""
    import numpy as np

    from ..prediction import AGES

    if not trained or any(parameter.moves for parameter in scenario.parameters.values()):
        return
    last = max(window.span[1] for window in trained)
    for name, window in scenario.windows.items():
        days = (np.datetime64(window.start) - last) / np.timedelta64(1, "D")
        if days > AGES:
            yield (
                f"windows.{name}: it begins {days:.0f} days after what is trained on, and in no interval is how the "
                "satellite ages; write 'trend' at parameters that do, such as a radiator's absorptivity, or train on "
                "telemetry of that time too"
            )


def _of_heaters(scenario: Scenario, data: xarray.Dataset, trained: Sequence[Window]) -> Iterator[str]:
    """Of a status whose likelihood is not used, and of heaters that switch more often than telemetry shows."""
    from ..problem import fast_heaters, unseen_heaters
    from ..scenario import SimulatorModel, heat_of, status_likelihoods

    if not isinstance(scenario.simulator, SimulatorModel) or heat_of(scenario) is None:
        return
    used = status_likelihoods(scenario)
    for channel, item in scenario.observations.items():
        if item.likelihood is not None and channel not in used:
            yield (
                f"observations.{channel}.likelihood: it is not used; with unmodelled heat the status drives its heater "
                "in training, and tells more so; delete it, or write 'heat: none'"
            )
    for name in unseen_heaters(scenario, data, [window.span for window in trained], fast_heaters(trained)):
        node = scenario.network.heaters[name].node
        yield (
            f"simulator.heaters.{name}: it switches more often than the telemetry shows, so in training {node} is held "
            f"at its measured temperature, and nothing is found of numbers that act on {node} alone; ask for samples "
            "that come more often than it switches, if you need these"
        )


def of_steps(windows: Iterable[Window]) -> Iterator[str]:
    """Of simulators that no time grid makes exact."""
    for window in windows:
        accuracy = window.network.accuracy if window.is_network else None
        if accuracy is not None and accuracy.error > _COARSE:
            yield (
                f"window {window.name}: {accuracy.steps} steps leave an error of {accuracy.error:.2g} K; some number "
                "makes a node change by tens of kelvins in seconds: check the units of capacities, conductances, areas "
                "and powers"
            )
