"""What a window simulates, and what moves it."""

import numpy as np

from flightcal.check.prepared import prepared
from flightcal.check.wrongs.wrong import driven

from .. import small
from .cases import sunlit


def test_nobody_knows_what_a_heater_did_while_its_status_has_a_gap(tmp_path):
    """Ten minutes of 30 W more or less move a body of 3000 J/K by kelvins, from the gap on."""
    scenario, data = small.closed_loop(tmp_path)
    status = data["heater_status"].to_numpy().astype(float)
    status[60:75] = np.nan
    view = prepared(scenario, data.assign(heater_status=("time", status)))
    t, body = len(view.rows.kept), view.channels.index("body_temp")
    moved = view.point(view.window, view.middle).jitter[body * t : (body + 1) * t]
    before = view.rows.seconds < 3600.0
    (large,) = np.nonzero(moved.max(axis=0) > 1.0)
    assert len(large) > 0
    np.testing.assert_allclose(moved[before][:, large], 0.0, atol=1e-3)


def test_a_light_node_is_not_thrown_off_where_the_sun_comes_at_other_times(tmp_path):
    """The steps of the window are short where its own shadows begin, and long where those of a later orbit do."""
    written = sunlit()
    simulator = written["simulator"]
    del simulator["step"]
    simulator["nodes"]["blanket"] = {"capacity": "20 J/K", "initial": "-50 degC"}
    simulator["conductors"].append({"between": ["blanket", "panel"], "radiative": "0.05 m^2"})
    looks = {"area": "1 m^2", "absorptivity": 0.5, "emissivity": 0.8}
    simulator["faces"]["blanket"] = {"node": "blanket", "normal": [0, 0, -1], **looks}
    simulator["faces"]["other"] = {"node": "blanket", "normal": [0, 0, 1], **looks}
    view = prepared(*small.closed_loop(tmp_path, written))
    usual = view.simulated(view.window, view.middle)
    for late in (-1800.0, 600.0, 1500.0):
        moved = view.simulated(driven(view, sunlight=late), view.middle)
        assert np.abs(moved - usual).max() < 60.0
