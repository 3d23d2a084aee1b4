"""The blocks of a draft after `telemetry`: a node for each temperature, a heater for each status."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

from . import guess
from .channels import Channel, slug

if TYPE_CHECKING:
    import xarray

    from ...telemetry import FoundModes

TIMELINE = "timeline.csv"


def other_blocks(dataset: xarray.Dataset, channels: Sequence[Channel], modes: FoundModes | None) -> str:
    """The other blocks: a node for each temperature, a heater for each status."""
    from ...scenario import kind_of

    nodes = [channel.name for channel in channels if channel.kind == "temperature"]
    statuses = [channel.name for channel in channels if channel.kind == "status"]
    heaters = guess.heaters(dataset, statuses, nodes)
    same = guess.same_heaters(dataset, heaters)
    heaters = {name: node for name, node in heaters.items() if name not in same}
    shadow = [name for name in statuses if guess.tells_shadow(name)][:1]
    period = guess.period(dataset, nodes)
    links = [f"    - {{between: [{a}, {b}], conductance: 0.5 W/K}}" for a, b in pairwise(nodes)]
    lines = [
        "",
        "# PLACEHOLDER: the orbital period; with `orbit` and `attitude`, sunlight on `faces` is computed.",
        "# Of a probe without an orbit, leave the block out.",
        *(["# In these telemetry files the temperatures come again after about this time."] if period else []),
        f"environment: {{period: {f'{period / 60:.4g}' if period else '95'} min}}",
        *(f"# With `orbit`, `eclipse: {{measured_by: {name}}}` takes the shadow from the flag." for name in shadow),
        "",
        "# PLACEHOLDER: every number of the thermal network.",
        "simulator:",
        "  nodes:",
        *(f"    {name}: {{capacity: 1000 J/K}}" for name in nodes),
        "    space: {boundary: -270 degC}",
        "  conductors:",
        *links,
        *(f"    - {{between: [{name}, space], radiative: 0.02 m^2}}" for name in nodes),
        *(["  heaters:"] if heaters else []),
    ]
    for name, other in same.items():
        lines.append(f"    # {name} is on and off as {other} is: the same heater.")
    for name, node in heaters.items():
        low, high = guess.thresholds(dataset["time"].values, dataset[node].values, dataset[name].values)
        lines.append(
            f"    {name}: {{node: {node}, power: 10 W, sensor: {node}, on_below: {low} degC, off_above: {high} degC, "
            f"measured_by: {name}}}"
        )
    powers = ", ".join(f"{name}: 5 W" for name in nodes)
    if modes is None:
        lines += ["  modes:", f"    nominal: {{{powers}}}", ""]
    else:
        lines += ["  modes:                            # PLACEHOLDER: what each unit takes in each mode"]
        lines += [f"    {name}: {{{powers}}}" for name in dict.fromkeys(map(slug, modes.names))]
        lines += [f"  timeline_file: {TIMELINE}", ""]
    if any(channel.kind == "driver" for channel in channels):
        driver = next(channel for channel in channels if channel.kind == "driver")
        # Of a power the coefficient is a share.
        power = driver.unit is not None and kind_of(driver.unit) == "a power"
        per = "" if driver.unit in (None, "1") else f"/{driver.unit}"
        coefficient = f"0.2 {driver.unit}{per}" if power else f"1 W{per}"
        lines += [
            "  # A driver heats a node by its value times a coefficient, such as",
            f"  # loads: {{sun: {{node: {nodes[0]}, driver: {driver.name}, coefficient: {coefficient}}}}}",
            "",
        ]
    if others := [name for name in statuses if name not in heaters and name not in same]:
        lines += [
            f"  # On or off, and by no temperature a heater's: {', '.join(others)}.",
            "  # To heat a node meanwhile, make it a driver (`kind: driver`, with `bits` or `on: [1]`), and add a load",
            "  # with the power as its coefficient, such as 2 W.",
            "",
        ]
    lines += ["# Uncertain numbers, each with what is believed of it.", "parameters:"]
    for name in nodes:
        lines.append(
            f"  {name}_capacity: {{scales: nodes.{name}.capacity, prior: {{lognormal: {{median: 1, factor: 2}}}}}}"
        )
        target = f"modes.nominal.{name}" if modes is None else f'"modes.*.{name}"'
        lines.append(f"  {name}_power: {{sets: {target}, prior: {{half_normal: 10 W}}}}")
    lines += ["", "# Which channel measures what.", "observations:"]
    lines += [f"  {name}: {{node: {name}}}" for name in nodes]
    lines += [f"  {name}: {{heater: {name}}}" for name in heaters]
    start, middle, end = guess.windows(dataset, {channel.name: channel.packet for channel in channels}, period)
    lines += [
        "",
        "# train is calibrated on; test is unseen, and scored.",
        "windows:",
        f"  train: {{start: {start}, end: {middle}}}",
        f"  test:  {{start: {middle}, end: {end}}}",
    ]
    return "\n".join(lines) + "\n"
