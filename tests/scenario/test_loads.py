"""What loads make of their drivers: absolute values and tables."""

import numpy as np
import pytest

from flightcal.errors import ScenarioError
from flightcal.problem import build_window
from flightcal.scenario import load_driver, settable
from tests import small


def loaded(folder, **more):
    content = small.content()
    content["simulator"]["loads"]["sun"] |= more
    content["parameters"] = {}
    return small.load(folder, content)


def driver(folder, **more):
    """Scenario, and what its load makes of measured amperes."""
    scenario, data = loaded(folder, **more)
    return scenario, data, load_driver(scenario.network.loads["sun"], scenario.telemetry.channels["sun"])


def test_the_absolute_value_of_a_driver_has_no_sign(tmp_path):
    _, _, plain = driver(tmp_path)
    _, _, absolute = driver(tmp_path, absolute=True)
    currents = np.array([-2.0, 0.5])
    assert plain(currents).tolist() == [-2.0, 0.5]
    assert absolute(currents).tolist() == [2.0, 0.5]


def test_a_table_is_linear_between_its_points_and_constant_beyond(tmp_path):
    table = [[0, 0.0], ["500 mA", 1.0], ["1 A", 1.5]]
    scenario, _, found = driver(tmp_path, table=table, coefficient="4 W")
    assert found(np.array([-1.0, 0.25, 0.5, 0.75, 9.0])) == pytest.approx([0.0, 0.5, 1.0, 1.25, 1.5])
    coefficient = settable(scenario)["loads.sun.coefficient"]
    assert (coefficient.value, coefficient.unit) == (4.0, "W")


def test_a_simulation_gets_the_heat_of_the_table(tmp_path):
    scenario, data, found = driver(tmp_path, table=[[0, 1.0], ["0.2 A", 0.25]], coefficient="4 W")
    window = build_window(scenario, data, "train")
    drive, place = window.network.drive, window.network.network.columns.index("driver.sun")
    # Of each step its two ends.
    begin = drive.series[place][::2]
    measured = np.interp(drive.times[:-1], 60.0 * np.arange(len(data.time)), data["sun"].values)
    off = np.abs(begin - found(measured))
    # A bend of the table inside of a step is spread over it.
    assert np.median(off) < 1e-9
    assert off.max() < 0.03
    assert np.ptp(begin) > 0.5


@pytest.mark.parametrize(
    ("more", "wrong"),
    [
        (
            {"table": [[0, 1.0], [0, 2.0]], "coefficient": "4 W"},
            "loads.sun.table: found 0 A after a larger",
        ),
        ({"table": [[0, 1.0]], "coefficient": "4 W"}, "found one point, expected two or more"),
        ({"table": [[0, 1.0], ["1 K", 2.0]], "coefficient": "4 W"}, "loads.sun.table"),
        ({"table": [[0, 1.0], [1, 2.0]]}, "loads.sun.coefficient"),
        ({"table": [[0, 1.0, 2.0]]}, "expected a point of a table"),
    ],
)
def test_a_table_that_is_wrong_is_an_error_with_its_place(tmp_path, more, wrong):
    with pytest.raises(ScenarioError) as raised:
        loaded(tmp_path, **more)
    assert wrong in str(raised.value)


def test_a_load_is_on_while_the_bit_of_a_word_is(tmp_path):
    content = small.content()
    content["telemetry"]["channels"]["radio"] = {"column": "heater", "kind": "driver", "bits": 0}
    content["simulator"]["loads"]["radio"] = {"node": "body", "driver": "radio", "coefficient": "3 W"}
    scenario, data = small.load(tmp_path, content)
    assert settable(scenario)["loads.radio.coefficient"].unit == "W"
    window = build_window(scenario, data, "train")
    heat = window.network.drive.series[window.network.network.columns.index("driver.radio")]
    assert set(np.unique(heat)) == {0.0}  # the file has it off
