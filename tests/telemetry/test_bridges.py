"""Gaps of measured inputs are said by name and length, in the windows that they reach into."""

import numpy as np
import pytest

from flightcal.telemetry import bridged

from .. import small


def case(folder, fill, gaps):
    """Telemetry of a sample a minute, whose driver has none in minutes from first to before last."""
    written = small.content()
    written["telemetry"]["channels"]["sun"]["fill"] = fill
    scenario, data = small.closed_loop(folder, written)
    for first, last in gaps:
        data["sun"].values[first:last] = np.nan
    return scenario, data


@pytest.mark.parametrize(("fill", "how"), [("previous_orbit", "values of other orbits"), ("interpolate", "a straight")])
def test_a_bridged_gap_has_its_channel_window_length_and_how(tmp_path, fill, how):
    (found,) = bridged(*case(tmp_path, fill, [(50, 58)]))
    assert (found.channel, found.finding, found.samples) == ("sun", "bridged", 8)
    assert (found.first, found.last) == (small.START + np.timedelta64(49, "m"), small.START + np.timedelta64(58, "m"))
    for words in ("'sun'", "9.0 min from 2024-03-01T00:49:00", "window 'train'", f"bridged by {how}"):
        assert words in found.detail


def test_short_gaps_and_gaps_outside_of_all_windows_are_not_said(tmp_path):
    # Training ends after 180 min, the test begins at 210.
    scenario, data = case(tmp_path, "previous_orbit", [(50, 52), (185, 205)])
    assert list(bridged(scenario, data)) == []
    data["sun"].values[175:205] = np.nan
    assert ["window 'train'" in record.detail for record in bridged(scenario, data)] == [True]


def test_a_driver_that_drives_nothing_is_not_said(tmp_path):
    scenario, data = case(tmp_path, "previous_orbit", [(50, 70)])
    unused = scenario.model_copy(update={"simulator": scenario.simulator.model_copy(update={"loads": {}})})
    assert list(bridged(unused, data)) == []


def test_a_driver_that_is_held_has_no_gaps(tmp_path):
    assert list(bridged(*case(tmp_path, "hold", [(50, 70)]))) == []


def test_inputs_that_have_one_gap_are_said_together(tmp_path):
    written = small.content()
    written["telemetry"]["channels"]["moon"] = written["telemetry"]["channels"]["sun"]
    written["simulator"]["loads"]["moon"] = written["simulator"]["loads"]["sun"] | {"driver": "moon"}
    scenario, data = small.closed_loop(tmp_path, written)
    for name in ("sun", "moon"):
        data[name].values[50:58] = np.nan
    (found,) = bridged(scenario, data)
    assert found.channel == "sun, moon"
    assert found.detail.startswith("'sun', 'moon' drive the simulator and have no sample for 9.0 min")
