"""A window's telemetry as rows."""

import numpy as np
import pytest
from scipy.linalg import solve_triangular

from flightcal.check.evidence import gaussian
from flightcal.check.prepared import prepared

from .. import small


def test_moved_telemetry_has_no_gap_where_it_is_rough(tmp_path):
    """What is not there cannot be told from what is explained, so a shift would gain from it."""
    scenario, data = small.closed_loop(tmp_path)
    rough = data.copy(deep=True)
    rough["panel_temp"].values[::7] += 5.0
    view = prepared(scenario, rough)
    moved = view.readings(1230.0)
    inside = slice(0, -(1230 // 60 + 2))
    assert np.isfinite(moved[inside]).all()


def test_a_channel_gains_by_being_read_between_its_samples_what_its_noise_loses(tmp_path):
    scenario, data = small.closed_loop(tmp_path)
    noise = 0.3 * np.random.default_rng(8).standard_normal(data.sizes["time"])
    view = prepared(scenario, data.assign(panel_temp=data["panel_temp"] + noise))
    known = np.isfinite(view.as_read)
    around = gaussian(view.rows, view.point(view.window, view.middle), known, (1.0,))
    place = view.channels.index("panel_temp")

    def expected(share):
        """Half the mean square of noise alone, so far between two samples, of 400 draws."""
        samples = view.rows.noise[place] * np.random.default_rng(9).standard_normal((400, len(view.rows.kept) + 1))
        between = (1.0 - share) * samples[:, :-1] + share * samples[:, 1:]
        white = solve_triangular(around.factors[0], view.of_channel(place, between.T), lower=True)
        return 0.5 * np.mean(np.square(white).sum(axis=0))

    assert view.smoothed(60.0, ["panel_temp"]) == pytest.approx(0.0, abs=1e-9)
    assert view.smoothed(90.0, ["panel_temp"]) == pytest.approx(expected(0.0) - expected(0.5), rel=0.25)
