"""Where origins stand: spread over the telemetry, with training and an orbit after each, and not in gaps."""

import numpy as np
import pytest

from flightcal.errors import RunError
from flightcal.scenario import Window
from flightcal.telemetry import select_window
from flightcal.validation import plan_origins, read_length
from flightcal.validation.origins import measured_drivers
from tests import small

OTHER_PACKET = 32
HOUR = np.timedelta64(1, "h")
MINUTE = np.timedelta64(1, "m")


@pytest.fixture
def scenario(tmp_path):
    """Telemetry of 30 h, of which 3 h (two orbits) are to train on."""
    return small.load(tmp_path, hours=30.0)


def without(data, begin, end, *channels):
    """The telemetry without samples of these channels between two hours."""
    made = data.copy(deep=True)
    hours = (made["time"].values - small.START) / HOUR
    for channel in channels:
        made[channel].values[(hours >= begin) & (hours < end)] = np.nan
    return made


def hours_of(plan):
    return np.array([(origin.time - small.START) / HOUR for origin in plan.origins])


def test_origins_are_spread_evenly_from_the_first_training_to_the_last_orbit(scenario):
    plan = plan_origins(*scenario, 5)
    assert hours_of(plan) == pytest.approx(np.linspace(3.0, 28.5, 5), abs=0.3)
    assert plan.train == pytest.approx(3 * 3600)
    assert plan.horizon == pytest.approx(12 * 3600)
    assert plan.skipped == ()


def test_an_origin_trains_up_to_its_time_and_predicts_to_the_horizon_or_the_telemetrys_end(scenario):
    plan = plan_origins(*scenario, 3)
    for origin in plan.origins:
        assert abs(origin.time - origin.start - 3 * HOUR) <= MINUTE
    assert plan.origins[0].end - plan.origins[0].time == 12 * HOUR
    assert plan.origins[-1].end == scenario[1]["time"].values[-1] + MINUTE
    of_origin = plan.origins[1].scenario(scenario[0])
    assert of_origin.train_windows == ("train",)
    assert np.datetime64(of_origin.windows["train"].end) == np.datetime64(of_origin.windows["ahead"].start)


def test_origins_stand_beside_passes_where_samples_come_in_passes_alone(scenario):
    hours = (scenario[1]["time"].values - small.START) / HOUR
    data = without(scenario[1], 0.0, 0.0)
    for channel in ("body_temp", "panel_temp"):
        # Ten minutes of every three hours, two orbits of 90 min each.
        data[channel].values[hours % 3.0 >= 1 / 6] = np.nan
    plan = plan_origins(scenario[0], data, 4, train=6 * 3600.0)
    assert len(plan.origins) == 4
    # The next pass begins within an orbit.
    assert (-hours_of(plan) % 3.0 <= 1.5).all()
    assert any("orbit after has less than half as many samples as usual" in line for line in plan.skipped)


def test_lengths_can_be_chosen(scenario):
    plan = plan_origins(*scenario, 4, train=5400.0, horizon=7200.0)
    assert hours_of(plan)[0] == pytest.approx(1.5, abs=0.1)
    assert all(origin.end - origin.time <= 2 * HOUR for origin in plan.origins)


def test_no_origin_stands_where_training_or_the_orbit_after_are_mostly_gaps(scenario):
    data = without(scenario[1], 10.0, 16.0, "body_temp", "panel_temp")
    plan = plan_origins(scenario[0], data, 8)
    hours = hours_of(plan)
    # Half of an orbit must be there after it, and half of two orbits before.
    assert not ((hours > 9.3) & (hours < 17.4)).any()
    assert len(plan.skipped) == 2
    assert "orbit after has less than half as many samples as usual" in plan.skipped[0]
    assert "training before has less than half" in plan.skipped[1]


def test_rows_of_a_faster_packet_do_not_make_temperatures_seem_rare(scenario):
    loaded, data = scenario
    seconds = np.arange(0, 30 * 3600, 10).astype("timedelta64[s]")
    merged = data.reindex(time=np.unique(np.concatenate([data["time"].values, small.START + seconds])))
    merged["flags"] = merged["flags"].fillna(OTHER_PACKET).astype(np.uint8)
    merged.attrs["sampling_interval_s"] = 10.0
    expected = hours_of(plan_origins(loaded, data, 5))
    np.testing.assert_allclose(hours_of(plan_origins(loaded, merged, 5)), expected)


@pytest.mark.parametrize("seed", range(3))
def test_a_prediction_ends_within_the_telemetry_where_rows_are_lost_at_random(scenario, seed):
    loaded, data = scenario
    kept = np.flatnonzero(np.random.default_rng(seed).random(data.sizes["time"]) > 0.35)
    lossy = data.isel(time=kept)
    plan = plan_origins(loaded, lossy, 5)
    assert len(plan.origins) == 5
    for origin in plan.origins:
        ahead = Window.model_construct(start=at(origin.time), end=at(origin.end), orbits=None, planned=False)
        assert select_window(lossy, ahead, plan.period).sizes["time"] > 0


def at(time):
    return time.astype("datetime64[us]").item()


def test_one_channel_that_is_missing_is_no_gap(scenario):
    plan = plan_origins(scenario[0], without(scenario[1], 10.0, 16.0, "panel_temp"), 8)
    assert plan.skipped == ()


def test_a_prediction_ends_where_a_measured_driver_does(scenario):
    data = without(scenario[1], 20.0, 22.0, "sun")
    plan = plan_origins(scenario[0], data, 6)
    gap = small.START + 20 * HOUR
    assert all(origin.end <= gap + 2 * MINUTE for origin in plan.origins if origin.time < gap)
    assert any("measured driver has a gap" in line for line in plan.skipped)


def test_fewer_origins_where_there_is_no_room(tmp_path):
    scenario, data = small.load(tmp_path, hours=4.55)
    assert 1 <= len(plan_origins(scenario, data, 9).origins) < 9


def test_telemetry_that_is_too_short_is_a_message(tmp_path):
    scenario, data = small.load(tmp_path, hours=4.0)
    with pytest.raises(RunError, match=r"found telemetry of 2\.67 orbits, expected 2 to train on and one more"):
        plan_origins(scenario, data, 5)


def test_a_horizon_below_an_orbit_is_a_message(scenario):
    with pytest.raises(RunError, match=r"--horizon: found 0\.667 orbits"):
        plan_origins(*scenario, 5, horizon=3600.0)


def test_telemetry_without_any_place_for_an_origin_is_a_message(scenario):
    with pytest.raises(RunError, match="no origin can stand in this telemetry"):
        plan_origins(scenario[0], without(scenario[1], 0.5, 29.5, "body_temp", "panel_temp"), 5)


def test_measured_drivers_are_loads_boundaries_and_heaters_driven_by_their_status(tmp_path):
    written = small.content()
    assert measured_drivers(small.load(tmp_path, written)[0]) == ("sun",)
    written["simulator"]["heater_input"] = "measured"
    assert measured_drivers(small.load(tmp_path, written)[0]) == ("sun", "heater_status")
    del written["simulator"]["loads"]
    written["parameters"]["panel_size"]["scales"] = ["conductors.panel-space.radiative"]
    written["simulator"]["heater_input"] = "simulated"
    assert measured_drivers(small.load(tmp_path, written)[0]) == ()


def test_lengths_are_read_in_orbits_or_units_of_time():
    assert read_length("2 orbits", 5400.0, "--train") == 10800.0
    assert read_length("1.5 orbit", 5400.0, "--train") == 8100.0
    assert read_length("3 h", 5400.0, "--train") == 10800.0
    for text in ("3", "3 K", "soon", "-2 orbits", "0 h", "nan orbits"):
        with pytest.raises(RunError, match="--train: found"):
            read_length(text, 5400.0, "--train")
