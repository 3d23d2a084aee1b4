"""The satellites whose truth is known: how they are made, and how calibrations are held to it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.truth import measure
from benchmarks.truth.flight import drivers_times, fly, mean_heat, whole_flight
from benchmarks.truth.imitation import cosines
from benchmarks.truth.satellites import random_satellite
from benchmarks.truth.summary import mean_of, summary

from flightcal.scenario import NutsSettings

SEED, NUMBER = 1, 8
TINY = NutsSettings(chains=2, draws=50, warmup=50)


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    return fly(SEED, NUMBER, "square wave", tmp_path_factory.mktemp("flight"))


@pytest.mark.slow
def test_a_seed_gives_one_satellite_whatever_heat_it_lacks(flight, tmp_path):
    right = fly(SEED, NUMBER, "none", tmp_path)
    assert right.satellite == flight.satellite
    assert right.truth == flight.truth
    assert right.flow == flight.flow
    assert flight.size
    assert not right.size
    assert not right.telemetry.equals(flight.telemetry)
    assert random_satellite(np.random.default_rng(0)) == random_satellite(np.random.default_rng(0))
    assert random_satellite(np.random.default_rng(0)) != random_satellite(np.random.default_rng(1))


def test_satellites_are_as_many_sided_as_they_should_be():
    made = [random_satellite(np.random.default_rng(seed)).written for seed in range(60)]
    for written in made:
        model, priors = written["simulator"], written["parameters"]
        assert 4 <= len(priors) <= 8
        assert any(name.startswith("link") for name in priors)
        assert any(name.startswith("capacity") for name in priors)
        observed = {item["node"] for item in written["observations"].values() if "node" in item}
        assert len(model["nodes"]) - len(observed) in (0, 1)
        assert all(heater["sensor"] in observed for heater in model["heaters"].values())
    assert {len(written["simulator"]["nodes"]) for written in made} == {2, 3, 4, 5}
    assert {len(written["simulator"]["heaters"]) for written in made} == {0, 1, 2}


def simple():
    """Two nodes, of which one dissipates 12 W and the other radiates; no sunlight."""
    satellite = random_satellite(np.random.default_rng(4))
    written = json.loads(json.dumps(satellite.written))
    nodes = {name: {"capacity": "1500 J/K"} for name in ("node_0", "node_1")}
    written["simulator"] |= {
        "nodes": nodes | {"space": {"boundary": "4 K"}},
        "conductors": [
            {"between": ["node_0", "node_1"], "conductance": "1 W/K"},
            {"between": ["node_1", "space"], "radiative": "0.05 m^2"},
        ],
        "faces": {},
        "heaters": {},
        "modes": {mode: {"node_0": "12 W"} for mode in ("idle", "busy")},
    }
    prior = {"lognormal": {"median": "1 W/K", "factor": 1.5}}
    written["parameters"] = {"link": {"sets": "conductors.node_0-node_1.conductance", "prior": prior}}
    return replace(satellite, written=written)


@pytest.mark.slow
def test_unmodelled_heat_is_heat_as_that_of_a_mode(tmp_path):
    satellite, watts = simple(), 1.5
    whole = whole_flight(satellite, tmp_path)
    times = drivers_times(satellite)
    heated = whole.with_heat(times, {"node_1": np.full(len(times), watts)})
    for powers in satellite.written["simulator"]["modes"].values():
        powers["node_1"] = f"{watts} W"
    dissipating = whole_flight(satellite, tmp_path)
    found, expected, without = (each.fly({}).temperatures for each in (heated, dissipating, whole))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)
    # In the end what comes in goes out.
    radiated = 5.670374419e-8 * 0.05 * found[-1, whole.simulator.channels.index("node_1_temp")] ** 4
    assert radiated == pytest.approx(12.0 + watts, rel=0.01)
    assert (found > without).all()


def test_what_flows_through_a_node_is_what_it_takes_in(tmp_path):
    whole = whole_flight(simple(), tmp_path)
    found = mean_heat(whole.simulator, whole.theta({}))
    # It still cools down to its balance.
    assert found == pytest.approx({"node_0": 12.0, "node_1": 12.0}, rel=0.05)


@pytest.mark.slow
def test_the_telemetry_is_rounded_and_the_duty_that_of_the_status(flight):
    for channel, sensor in flight.satellite.sensors.items():
        steps = flight.telemetry[channel].values / sensor.step
        np.testing.assert_allclose(steps, steps.round(), atol=1e-4)
    assert flight.on
    last = 60.0 * (len(flight.telemetry) - 1)
    for heater in flight.on:
        assert flight.duty(heater, 0.0, last) == pytest.approx(flight.telemetry[f"{heater}_status"].mean(), abs=0.01)
        assert 0.05 < flight.duty(heater, 0.0, last) < 0.95


@pytest.mark.slow
def test_heat_imitates_the_power_of_all_modes_and_less_so_that_of_one(flight, tmp_path):
    written = json.loads(json.dumps(flight.satellite.written))
    modes = written["simulator"]["modes"]
    payload = next(node for node in modes["busy"] if node not in modes["idle"])
    paths = {"everywhere": ["modes.idle.node_0", "modes.busy.node_0"], "now_and_then": [f"modes.busy.{payload}"]}
    truth, written["parameters"] = {}, {}
    for name, of in paths.items():
        _, mode, node = of[-1].split(".")
        truth[name] = float(modes[mode][node].split()[0])
        prior = {"normal": {"mean": modes[mode][node], "standard_deviation": "1 W"}}
        written["parameters"][name] = {"sets": of, "prior": prior}
    made = replace(flight, satellite=replace(flight.satellite, written=written), truth=truth)
    found = cosines(made, tmp_path)
    assert found["everywhere"] == pytest.approx((1.0, 1.0), abs=1e-4)
    assert found["now_and_then"][1] < found["now_and_then"][0] < 0.999


@pytest.mark.slow
def test_a_satellite_is_measured_once(tmp_path, monkeypatch):
    out = tmp_path / "records.jsonl"
    (record,) = measure.run(1, SEED, "iid", out, workers=1, settings=TINY, random_starts=1)
    assert record["kind"] == "constant"
    assert len(record["parameters"]) >= 4
    for parameter in record["parameters"]:
        assert parameter["inside"] == (parameter["lower"] <= parameter["truth"] <= parameter["upper"])
        assert 0.0 <= parameter["cosine_of_one"] < parameter["cosine"] + 1e-6 < 1.0 + 2e-6
        assert parameter["deviation"] < 1.5
    assert {item["window"] for item in record["predicted"]} == {"soon", "late"}
    monkeypatch.setattr(measure, "measure", None)
    assert measure.run(1, SEED, "iid", out, workers=1, settings=TINY, random_starts=1) == [record]
    table = summary([record, record | {"variant": "heat"}])
    assert "| width of predictions, times the first's, median | - | 1.00 |" in table


def test_a_failure_costs_one_satellite_and_is_tried_again(tmp_path, monkeypatch, capsys):
    def fails(*_):
        raise measure.FlightcalError("too cold")

    monkeypatch.setattr(measure, "measure", fails)
    assert measure.run(2, SEED, "iid", tmp_path / "records.jsonl", workers=1) == []
    assert "satellite 1: FlightcalError: too cold" in capsys.readouterr().out


def test_the_error_of_a_mean_is_that_of_independent_satellites():
    rng = np.random.default_rng(0)
    means, errors = [], []
    for _ in range(400):
        # A satellite's values are all the same: forty values tell no more than ten.
        records = [{"values": [rng.normal()] * 4} for _ in range(10)]
        mean, error, count = mean_of(records, lambda record: record["values"])
        means.append(mean)
        errors.append(error)
        assert count == 40
    # The estimate is low by sqrt(9 / 10); standard error of a deviation of 400 draws: 3.5%.
    assert np.mean(errors) == pytest.approx(np.std(means), rel=0.15)
