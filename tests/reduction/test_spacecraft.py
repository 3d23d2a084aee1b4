"""What a reduction knows of the satellite that flies: nothing that a calibration is to find, or that has gone wrong."""

from copy import deepcopy

import pytest

from flightcal.reduction.file import load_task
from tests.reduction import craft


def flown(**changes):
    """The small craft, and how it differs from what its builder knows."""
    content = deepcopy(craft.SPACECRAFT)
    content["thermistors"]["battery_2"] = {"node": "battery", "noise": "0.05 K"}
    content["software"]["sensors"]["battery"]["thermistors"] = ["battery_1", "battery_2"]
    for place, value in changes.items():
        *outer, last = place.split("__")
        block = content
        for name in outer:
            block = block[name]
        block[last] = value
    return content


@pytest.mark.parametrize(
    "changes",
    [
        {"seed": 99},
        {"thermistors__unit_1__bias": "0.5 K"},
        {"thermistors__battery_1__bias": "-0.3 K"},
        {"thermistors__battery_2__failures": [{"at": "900 s", "kind": "stuck", "stuck_at": "60 degC"}]},
        {"software__heaters__battery__branches__nominal__fails_at": "6000 s"},
        {"software__heaters__battery__branches__nominal__power": {"battery": "17 W"}},
        {"faces__window__absorptivity": 0.33},
        {"nodes__battery__capacity": "5400 J/K"},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_what_the_satellite_is_like_in_flight_does_not_reach_the_reduction(tmp_path, changes):
    known = load_task(craft.write(tmp_path, spacecraft=flown()))
    task = load_task(craft.write(tmp_path, spacecraft=flown(**changes)))
    assert task.scenario == known.scenario
    assert task.mission == known.mission


def test_what_the_builder_knows_does(tmp_path):
    known = load_task(craft.write(tmp_path, spacecraft=flown()))
    limits = {"on_below": "14 degC", "off_above": "16 degC"}
    for changes in (
        {"nodes__unit__capacity": "2500 J/K"},
        {"thermistors__battery_1__noise": "0.1 K"},
        {"software__heaters__battery__thermostat": limits},
    ):
        task = load_task(craft.write(tmp_path, spacecraft=flown(**changes)))
        assert (task.scenario, task.mission) != (known.scenario, known.mission)


def test_what_parameters_set_is_at_their_medians_and_factors_are_of_what_is_written(tmp_path):
    network = load_task(craft.write(tmp_path)).scenario.network
    assert network.faces["window"].absorptivity == pytest.approx(0.25)
    assert network.heaters["battery"].power == pytest.approx(20.0)
    narrow = {"scales": "conductors.bus*insulation.radiative", "prior": {"lognormal": {"median": 2, "factor": 1.3}}}
    parameters = {**craft.REDUCTION["parameters"], "blanket": narrow}
    doubled = load_task(craft.write(tmp_path, {"parameters": parameters})).scenario.network
    assert doubled.conductors == network.conductors


def test_that_flaws_are_left_out_is_noted(tmp_path):
    assert not any("biases" in note for note in load_task(craft.write(tmp_path)).notes)
    biased = flown(thermistors__unit_1__bias="0.5 K")
    assert any("biases" in note for note in load_task(craft.write(tmp_path, spacecraft=biased)).notes)
