"""Heat that is not what the scenario says."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from flightcal.check.evidence import climbed
from flightcal.check.prepared import prepared
from flightcal.check.wrongs.heat import constant_heat, missing_heat, shares, turning, upper
from tests import small

from ..cases import named, silent, switching


@pytest.mark.slow
def test_a_mode_of_another_power_is_named_too_in_a_node_whose_heater_has_no_status(tmp_path):
    written = small.content()
    written["simulator"]["modes"] = {"quiet": {"body": "2 W"}, "loud": {"body": "40 W"}}
    written["simulator"]["timeline"] = [
        {"at": f"2024-03-01T0{k // 2}:{30 * (k % 2):02d}:00", "mode": ("quiet", "loud")[k % 2]} for k in range(6)
    ]
    _, data = small.closed_loop(tmp_path, written)
    scenario, _ = small.load(tmp_path, silent(written))
    assert named(scenario, data) == ()
    written["simulator"]["modes"]["loud"]["body"] = "2 W"
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert first.kind in ("mode", "number")
    assert "loud" in first.title


def test_a_mode_that_the_scenario_lacks_is_named_with_its_times(tmp_path):
    written = small.content()
    written["simulator"]["modes"] = {"quiet": {"panel": "2 W"}, "loud": {"panel": "14 W"}}
    at = [("2024-03-01T00:00:00", "quiet"), ("2024-03-01T01:00:00", "loud"), ("2024-03-01T01:30:00", "quiet"),
          ("2024-03-01T02:10:00", "loud"), ("2024-03-01T02:30:00", "quiet")]  # fmt: skip
    written["simulator"]["timeline"] = [{"at": time, "mode": mode} for time, mode in at]
    _, data = small.closed_loop(tmp_path, written)
    del written["simulator"]["modes"]["loud"], written["simulator"]["timeline"]
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert (first.kind, first.about) == ("missing heat", "panel")
    assert "2024-03-01T01:00 to 01:3" in first.sentence
    assert "2024-03-01T02:" in first.sentence


def test_heat_that_is_on_or_off_is_told_from_a_sine_and_from_noise():
    rng = np.random.default_rng(1)
    on, share = upper(np.repeat([0.0, 5.0, 0.0], 16) + 0.3 * rng.standard_normal(48))
    assert np.flatnonzero(on).tolist() == list(range(16, 32))
    assert share > 0.95
    sine = np.sin(np.linspace(0.0, 4.0 * np.pi, 4800))
    assert upper(sine)[1] == pytest.approx(8.0 / np.pi**2, abs=0.01)
    assert upper(rng.standard_normal(4800))[1] == pytest.approx(2.0 / np.pi, abs=0.03)


def test_turns_of_a_thermostat_are_found_and_noise_is_not():
    cycle = np.abs((np.arange(200) % 40) - 20.0) / 5.0
    rising = turning(cycle, 1.0)
    assert rising is not None
    assert rising[25:38].all()
    assert not rising[45:58].any()
    assert turning(0.1 * np.random.default_rng(0).standard_normal(200), 1.0) is None


def test_a_step_has_that_share_of_a_wave_that_is_in_it():
    states = np.array([0.0, 1.0, 1.0, 0.0])
    grid = np.array([0.0, 50.0, 100.0, 100.0, 400.0])
    np.testing.assert_allclose(shares(np.array([0.0, 80.0, 160.0, 200.0]), states, grid), [0.0, 0.4, 0.0, 1.0 / 3.0])


def test_heat_whose_times_a_status_tells_is_likelier_than_heat_whose_times_the_temperatures_tell(flown):
    scenario, data = flown
    heater = scenario.simulator.heaters["heater"].model_copy(update={"measured_by": None})
    simulator = scenario.simulator.model_copy(update={"heaters": {}})
    assert heater.node == "body"
    observations = {
        name: observation for name, observation in scenario.observations.items() if observation.heater is None
    }
    update = {"simulator": simulator, "observations": observations, "parameters": {}}
    view = prepared(scenario.model_copy(update=update), data)
    odds = {bool("heater_status" in wrong.words(SimpleNamespace(added=[1.0])).sentence): wrong.odds
            for wrong in missing_heat(view) if wrong.about == "body"}  # fmt: skip
    assert odds[False] > odds[True] + 2.0


def test_heat_that_is_missing_all_the_time_is_tried_at_every_node(flown):
    view = prepared(*flown)
    found = {wrong.about: wrong for wrong in constant_heat(view)}
    assert set(found) == {"body", "panel"}
    t = len(view.rows.kept)
    warmer = {
        name: _warmer(view, wrong.window).reshape(-1)[: 2 * t].reshape(2, t)[:, -1] for name, wrong in found.items()
    }
    body, panel = (view.channels.index(f"{name}_temp") for name in ("body", "panel"))
    assert warmer["panel"][panel] > warmer["panel"][body] > 0.0
    assert warmer["body"][body] > warmer["body"][panel] > 0.0


def _warmer(view, window):
    """[R] K."""
    return view.temperatures(window, view.middle) - view.modelled


def test_heat_that_is_missing_all_the_time_is_more_usual_heat_too(flown):
    """With more heat a node's links and its unmodelled heat do more; a bias, that has neither, is no better."""
    view = prepared(*flown)
    always = next(wrong for wrong in constant_heat(view) if wrong.about == "panel")
    k = view.heat.nodes.index("panel")
    assert view.heat_of(always.window).flow[k] > 1.1 * view.heat.flow[k]


def test_what_all_modes_take_does_not_hide_what_one_of_them_takes(tmp_path):
    """The panel takes 14 W always, and 6 W more in a mode, which the scenario does not say."""
    written = small.content()
    at = [f"2024-03-01T0{hour}:{minute}:00" for hour in range(3) for minute in ("05", "35")]
    written["simulator"]["modes"] = {"idle": {"panel": "14 W"}, "busy": {"panel": "20 W"}}
    written["simulator"]["timeline"] = [
        {"at": "2024-02-29T00:00:00", "mode": "idle"},
        *({"at": time, "mode": ("busy", "idle")[k % 2]} for k, time in enumerate(at)),
    ]
    _, data = small.closed_loop(tmp_path, written)
    written["simulator"]["modes"]["busy"] = written["simulator"]["modes"]["idle"]
    scenario, _ = small.load(tmp_path, written)
    first = named(scenario, data)[0]
    assert first.kind == "mode"
    assert "in panel" in first.title


def test_less_in_a_node_all_the_time_than_written_is_named_beside_a_bias(tmp_path):
    written = small.content()
    written["simulator"]["modes"] = {"idle": {"panel": "8 W"}}
    written["simulator"]["timeline"] = [{"at": "2024-02-29T00:00:00", "mode": "idle"}]
    _, data = small.closed_loop(tmp_path, written)
    written["simulator"]["modes"]["idle"]["panel"] = "24 W"
    scenario, _ = small.load(tmp_path, written)
    titles = [suspicion.title for suspicion in named(scenario, data)]
    (always,) = (title for title in titles if title.endswith("than the scenario says, all the time"))
    assert always.startswith("panel takes ")
    assert float(always.split()[2]) == pytest.approx(16.0, rel=0.2)
    assert "W less" in always


def test_a_timeline_of_another_time_zone_is_named_with_the_hours(tmp_path):
    written = small.content()
    minutes, mode = np.array([0, 37, 52, 121, 139, 200, 226, 310, 330, 371, 402]), ("idle", "busy")
    at = np.datetime64("2024-03-01T00:03") + minutes.astype("timedelta64[m]")
    written["simulator"]["modes"] = {"idle": {"panel": "1 W"}, "busy": {"panel": "9 W"}}
    timeline = [{"at": "2024-02-28T00:00:00", "mode": "idle"}]
    written["simulator"]["timeline"] = timeline + [{"at": f"{t}:00", "mode": mode[k % 2]} for k, t in enumerate(at)]
    _, data = small.closed_loop(tmp_path, written)
    late = at + np.timedelta64(5, "h")
    written["simulator"]["timeline"] = timeline + [{"at": f"{t}:00", "mode": mode[k % 2]} for k, t in enumerate(late)]
    scenario, _ = small.load(tmp_path, written)
    # No face is lit here: the telemetry's clock could be off as well.
    assert "The timeline of modes is 5 h late" in [suspicion.title for suspicion in named(scenario, data)]


def test_modes_that_are_exchanged_are_named(tmp_path):
    written = small.content()
    at = [f"2024-03-01T0{hour}:{minute}:00" for hour in range(3) for minute in ("05", "35")]
    written["simulator"]["modes"] = {"idle": {"panel": "1 W"}, "busy": {"panel": "9 W", "body": "3 W"}}
    written["simulator"]["timeline"] = [
        {"at": "2024-02-29T00:00:00", "mode": "idle"},
        *({"at": time, "mode": ("busy", "idle")[k % 2]} for k, time in enumerate(at)),
    ]
    _, data = small.closed_loop(tmp_path, written)
    modes = written["simulator"]["modes"]
    modes["idle"], modes["busy"] = modes["busy"], modes["idle"]
    scenario, _ = small.load(tmp_path, written)
    assert named(scenario, data)[0].title == "Modes 'idle' and 'busy' are exchanged"


def test_a_modes_heat_in_another_node_is_named_with_both(tmp_path):
    _, data = small.closed_loop(tmp_path, switching(idle={"panel": "3 W"}, busy={"panel": "15 W"}))
    scenario, _ = small.load(tmp_path, switching(idle={"panel": "3 W"}, busy={"panel": "3 W", "body": "12 W"}))
    assert named(scenario, data)[0].title == "Mode 'busy' heats panel, not body"


def test_all_that_modes_heat_a_node_with_is_named_where_another_has_it(tmp_path):
    _, data = small.closed_loop(tmp_path, switching(idle={"panel": "8 W"}, busy={"panel": "20 W"}))
    scenario, _ = small.load(tmp_path, switching(idle={"body": "8 W"}, busy={"body": "20 W"}))
    first = named(scenario, data)[0]
    assert first.title == "All modes heat panel, not body"
    in_all, more = (float(words.split(" W")[0]) for words in re.split("With |and (?=[0-9])", first.sentence)[1:])
    assert in_all == pytest.approx(8.0, abs=2.0)
    assert more == pytest.approx(12.0, abs=1.5)


def test_a_heater_that_is_missing_may_be_much_stronger_than_what_flows_through_its_node(tmp_path):
    """What leaves a body of 20 degC through a link of 0.1 W/K says little of its heater."""
    written = small.content()
    del written["parameters"]["link"], written["parameters"]["power"]
    written["simulator"]["conductors"][0]["conductance"] = "0.1 W/K"
    written["simulator"]["heaters"]["heater"]["power"] = "60 W"
    scenario, data = small.closed_loop(tmp_path, written)
    simulator = scenario.simulator.model_copy(update={"heaters": {}})
    observations = {
        name: observation for name, observation in scenario.observations.items() if observation.heater is None
    }
    first = named(scenario.model_copy(update={"simulator": simulator, "observations": observations}), data)[0]
    assert (first.kind, first.about) == ("missing heat", "body")
    assert 30.0 < float(first.sentence.split()[1]) < 90.0


def without_its_heater(scenario):
    """The scenario with neither its heater nor the status of that, and with no parameters."""
    channels = {name: channel for name, channel in scenario.telemetry.channels.items() if channel.kind != "status"}
    observations = {
        name: observation for name, observation in scenario.observations.items() if observation.heater is None
    }
    update = {
        "simulator": scenario.simulator.model_copy(update={"heaters": {}}),
        "telemetry": scenario.telemetry.model_copy(update={"channels": channels}),
        "observations": observations,
        "parameters": {},
    }
    return scenario.model_copy(update=update)


@pytest.mark.parametrize("apart", [1, 3, 4, 5])
def test_a_heater_that_is_missing_is_named_however_seldom_its_node_is_read(flown, apart):
    scenario, data = flown
    first = named(without_its_heater(scenario), data.isel(time=slice(None, None, apart)))[0]
    assert (first.kind, first.about) == ("missing heat", "body")


def test_times_of_a_missing_heater_are_known_to_about_the_time_between_two_readings(flown):
    scenario, data = flown
    view = prepared(without_its_heater(scenario), data.isel(time=slice(None, None, 3)))
    base = view.point(view.window, view.middle)
    missing = next(wrong for wrong in missing_heat(view) if wrong.about == "body")
    exact, shifted = (
        climbed(view, view.window, view.observed, base, columns)
        for columns in (missing.columns[:, :1], missing.columns)
    )
    assert shifted.evidence > exact.evidence + 10.0


def test_a_mode_with_other_powers_in_two_nodes_is_told_of_both(tmp_path, named_of):
    _, data = small.closed_loop(tmp_path, switching(idle={"panel": "3 W"}, busy={"panel": "18 W", "body": "22 W"}))
    scenario, _ = small.load(tmp_path, switching(idle={"panel": "3 W"}, busy={"panel": "6 W", "body": "4 W"}))
    first = named_of(scenario, data, "heat")[0]
    assert first.title == "Mode 'busy' has other powers in body and panel"
    body, panel = (float(power) for power in re.findall(r"takes ([\d.]+) W, not", first.sentence))
    assert (body, panel) == (pytest.approx(22.0, abs=4.0), pytest.approx(18.0, abs=3.0))
