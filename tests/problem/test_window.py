"""What a window is asked for."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from flightcal.errors import FlightcalError
from flightcal.problem import build_window
from tests import small


def test_a_window_of_another_simulator_has_no_network(tmp_path):
    window = build_window(*small.load(tmp_path), "train")
    assert window.is_network
    assert window.network is window.simulator
    other = replace(window, simulator=SimpleNamespace())
    assert not other.is_network
    with pytest.raises(FlightcalError, match="window 'train': found another simulator, expected a thermal network"):
        _ = other.network
