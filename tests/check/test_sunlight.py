"""Sunlight on faces at other times than the window's."""

import numpy as np

from flightcal.check.prepared import prepared
from flightcal.check.sunlight import FINE
from tests import small

from .cases import sunlit


def test_sunlight_is_looked_up_where_a_shadow_begins_and_ends(tmp_path):
    view = prepared(*small.closed_loop(tmp_path, sunlit()))
    seconds = view.sunlight.times(view.window.scenario, 0.0, 10800.0)
    assert np.diff(seconds).max() == FINE
    assert 4 <= (seconds % FINE > 0.0).sum() <= 16
