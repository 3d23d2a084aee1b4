"""The operational simulator as a whole: energy, control, failures, telemetry, mesh and step."""

import math
import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from flightcal.errors import FlightcalError
from flightcal.operational.onboard import (
    Branch,
    HeaterLine,
    OnboardSoftware,
    OnOff,
    TemperatureTransition,
    VotedSensor,
)
from flightcal.operational.simulator import Downlink, Spacecraft, Thermistor, ThermistorFailure, fly
from flightcal.scenario import Conductor, Environment, Node, Scenario, SimulatorModel
from flightcal.scenario.body import Body, Box, Coating, Material, Side
from flightcal.scenario.geometry import box_joints, box_plates, mesh_plates
from flightcal.scenario.network import DEEP_SPACE
from flightcal.simulator.network import STEFAN_BOLTZMANN

from .. import small

DATA = Path(os.environ.get("FLIGHTCAL_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
START = small.START
ALUMINIUM = {"aluminium": Material(conductivity=150.0, density=2700.0, specific_heat=900.0)}


def scenario_of(folder, nodes, conductors, faces=None, modes=None, step=10.0, environment=None):
    """A scenario whose network is given in blocks."""
    scenario, _ = small.closed_loop(folder)
    model = SimulatorModel.model_construct(
        step=step,
        nodes=nodes,
        conductors=tuple(conductors),
        faces=faces or {},
        heaters={},
        modes=modes or {},
        loads={},
        timeline=(),
    )
    changes = {"simulator": model, "parameters": {}, "observations": {}}
    if environment is not None:
        changes["environment"] = environment
    return Scenario.model_construct(**{**{k: getattr(scenario, k) for k in Scenario.model_fields}, **changes})


def tank(folder, **changes):
    """A tank behind a panel that radiates to space, held by a thermostat with three thermistors on the tank."""
    nodes = {
        "tank": Node.model_construct(capacity=4000.0, initial=285.0),
        "panel": Node.model_construct(capacity=900.0, initial=260.0),
        "space": Node.model_construct(boundary=DEEP_SPACE),
    }
    conductors = [
        Conductor.model_construct(between=("tank", "panel"), conductance=0.4),
        Conductor.model_construct(between=("panel", "space"), radiative=0.05),
    ]
    scenario = scenario_of(
        folder,
        nodes,
        conductors,
        modes={"nominal": {"panel": 5.0}, "safe": {"panel": 1.0}},
        step=changes.pop("step", 10.0),
    )
    branches = {name: Branch({"tank": 20.0}) for name in ("nominal", "redundant")} | changes.pop("branches", {})
    line = HeaterLine("tank", branches, OnOff(283.0, 286.0), failure_time=600.0)
    settings = {
        "period": 10.0,
        "sensors": {"tank": VotedSensor(("t1", "t2", "t3"))},
        "heaters": {"heater": line},
        "enabled": {"nominal": ("heater",), "safe": ("heater",)},
        "initial_mode": "nominal",
        **changes.pop("software", {}),
    }
    return Spacecraft(
        **{
            "scenario": scenario,
            "software": OnboardSoftware(**settings),
            "thermistors": {f"t{k}": Thermistor("tank", bias=0.1 * (k - 2)) for k in (1, 2, 3)},
            "downlink": Downlink(("t1", "t2"), period=60.0),
            **changes,
        }
    )


def of(flight, node):
    return flight.temperatures[:, flight.nodes.index(node)]


def test_stored_heat_is_what_went_in_less_what_was_radiated(tmp_path):
    flight = fly(tank(tmp_path), START, 12_000.0)
    x, panel = of(flight, "tank"), of(flight, "panel")
    stored = 4000.0 * (x[-1] - x[0]) + 900.0 * (panel[-1] - panel[0])
    lost = 0.05 * STEFAN_BOLTZMANN * (panel**4 - DEEP_SPACE**4)
    radiated = np.sum(0.5 * (lost[:-1] + lost[1:])) * 10.0
    given = flight.power[:-1].sum() * 10.0 + 5.0 * flight.cycle_times[-1]
    assert 0.0 < np.mean(flight.power > 0.0) < 1.0, "the heater must switch to test anything"
    assert stored == pytest.approx(given - radiated, abs=1e-4 * given)


def test_the_thermostat_holds_the_voted_temperature(tmp_path):
    x = of(fly(tank(tmp_path), START, 20_000.0), "tank")
    assert 282.9 < x.min() < 283.0
    assert 286.0 < x[200:].max() < 286.1


def test_one_stuck_thermistor_changes_nothing_and_two_open_ones_leave_the_third(tmp_path):
    craft = tank(tmp_path)
    healthy = fly(craft, START, 10_000.0)
    given = craft.thermistors
    failed = replace(given["t1"], failures=(ThermistorFailure(0.0, "stuck", 320.0),))
    stuck = replace(craft, thermistors={**given, "t1": failed})
    # The median of what is left is that of the two others: 0.1 K higher than t2.
    assert np.abs(of(fly(stuck, START, 10_000.0), "tank") - of(healthy, "tank")).max() < 0.5
    opened = (ThermistorFailure(3000.0, "open"),)
    lone = replace(craft, thermistors={**given, **{k: replace(given[k], failures=opened) for k in ("t1", "t2")}})
    flight = fly(lone, START, 10_000.0)
    assert of(flight, "tank").min() > 282.7
    assert flight.telemetry["t1"].iloc[51:].isna().all()


def test_a_branch_that_fails_is_replaced_and_the_tank_stays_warm(tmp_path):
    failing = Branch({"tank": 20.0}, fails_at=2000.0)
    flight = fly(tank(tmp_path, branches={"nominal": failing}), START, 20_000.0)
    assert of(flight, "tank").min() > 280.0
    assert of(flight, "tank")[-400:].min() > 282.9
    dead = tank(tmp_path, branches={"nominal": failing, "redundant": failing})
    assert of(fly(dead, START, 20_000.0), "tank")[-1] < 275.0


def test_safe_mode_by_temperature_changes_the_dissipation(tmp_path):
    transition = TemperatureTransition("safe", "tank", below=284.0)
    flight = fly(tank(tmp_path, software={"transitions": (transition,)}), START, 12_000.0)
    first = flight.modes.index("safe")
    assert set(flight.modes[first:]) == {"safe"}
    assert np.flatnonzero(of(flight, "tank") < 284.0)[0] + 2 == first
    usual = fly(tank(tmp_path), START, 12_000.0)
    np.testing.assert_array_equal(of(flight, "panel")[: first + 1], of(usual, "panel")[: first + 1])
    assert (of(flight, "panel")[first + 1 :] < of(usual, "panel")[first + 1 :]).all()


def test_telemetry_is_sampled_and_rounded_to_its_quantum(tmp_path):
    flight = fly(tank(tmp_path, downlink=Downlink(("t2",), period=60.0, quantum=0.5)), START, 6000.0)
    assert list(flight.telemetry.columns) == ["t2", "heater.heater", "mode"]
    assert flight.telemetry.index[1] - flight.telemetry.index[0] == pd.Timedelta("60s")
    values = flight.telemetry["t2"].to_numpy()
    np.testing.assert_allclose(values % 0.5, 0.0, atol=1e-9)
    assert np.abs(values - of(flight, "tank")[::6]).max() <= 0.25 + 1e-9
    np.testing.assert_array_equal(flight.telemetry["heater.heater"], (flight.power[::6, 0] > 0).astype(float))


def test_noise_depends_on_the_seed_alone(tmp_path):
    craft = tank(tmp_path)
    noisy = replace(craft, thermistors={k: replace(t, noise=0.2) for k, t in craft.thermistors.items()})
    first, second, other = (fly(noisy, START, 3000.0, seed=seed).telemetry for seed in (1, 1, 2))
    pd.testing.assert_frame_equal(first, second)
    assert not first.equals(other)


def test_the_pace_is_kept_and_the_real_time_factor_is_without_the_waiting(tmp_path):
    craft = tank(tmp_path)
    fly(craft, START, 100.0)
    begin = time.perf_counter()
    flight = fly(craft, START, 1000.0, pace=1000.0)
    assert time.perf_counter() - begin > 0.99
    assert flight.real_time_factor > 2000.0


def test_the_result_converges_in_the_step(tmp_path):
    """Cycles of 60 s in 1, 2 and 4 steps; the heater's cycle times are the software's, so all are smooth in between."""
    ends = []
    for step in (60.0, 30.0, 15.0):
        craft = tank(tmp_path, step=step, software={"period": 60.0})
        ends.append(fly(craft, START, 6000.0).temperatures)
    first, second = np.abs(ends[0] - ends[1]).max(), np.abs(ends[1] - ends[2]).max()
    assert first < 1e-3
    assert second < 0.3 * first


def test_esatan_simple_transient_is_reproduced(tmp_path):
    file = DATA / "esatan" / "SimpleTransient.csv"
    if not file.exists():
        pytest.skip(f"reference data not found at {file}")
    table = pd.read_csv(file, skiprows=5).to_numpy(float)
    capacities, begins = [1.0, 2.0, 3.0, 4.0, 1000.0], [20.0, 30.0, 40.0, 50.0, 0.0]
    nodes = {
        f"n{k}": Node.model_construct(capacity=c, initial=t + 273.15)
        for k, (c, t) in enumerate(zip(capacities, begins, strict=True))
    }
    links = {(1, 0): 10.0, (1, 2): 1.0, (1, 3): 5.0, (4, 3): 2.0}
    conductors = [Conductor.model_construct(between=(f"n{i}", f"n{j}"), conductance=g) for (i, j), g in links.items()]
    software = OnboardSoftware(0.1, "on", {"on": ()})
    scenario = scenario_of(tmp_path, nodes, conductors, modes={"on": {"n0": 5.0}}, step=0.01)
    craft = Spacecraft(scenario, software, {}, Downlink((), period=0.1))
    flight = fly(craft, START, 10.0)
    reference = table[::10, 1::2][:100]
    for k in range(5):
        assert np.abs(of(flight, f"n{k}") - 273.15 - reference[:, k]).max() < 0.02


def box_in_orbit(folder, mesh, duration):
    """Temperatures of a sunlit box's middle cells after some time."""
    bus = Box((0.0, 0.0, 0.0), (0.5, 0.5, 0.5), 0.002, "aluminium", mesh, Side("outer"), "inner", joints=50.0)
    coatings = {"outer": Coating(0.4, 0.7), "inner": Coating(0.5, 0.8)}
    made = mesh_plates(Body(materials=ALUMINIUM, coatings=coatings, boxes={"bus": bus}))
    nodes = {name: node.model_copy(update={"initial": 290.0}) for name, node in made.nodes.items()}
    environment = Environment.model_validate(
        {
            "orbit": {"altitude": "600 km", "inclination": "97.8 deg", "ltan": "10:30", "epoch": str(START)[:19]},
            "attitude": "nadir",
        }
    )
    scenario = scenario_of(folder, nodes, made.conductors, made.faces, {"on": {}}, 20.0, environment)
    craft = Spacecraft(scenario, OnboardSoftware(60.0, "on", {"on": ()}), {}, Downlink((), period=60.0))
    return fly(craft, START, duration)


def test_a_meshed_box_converges_to_a_mean_temperature_of_each_side(tmp_path):
    means = []
    for mesh in (1, 3, 5):
        flight = box_in_orbit(tmp_path, mesh, 6000.0)
        names = [f"bus.{axis}{sign}[" for axis in "xyz" for sign in "-+"]
        sides = [[k for k, n in enumerate(flight.nodes) if n.startswith(name)] for name in names]
        means.append(np.array([flight.temperatures[-1][side].mean() for side in sides]))
    coarse, fine = np.abs(means[0] - means[2]).max(), np.abs(means[1] - means[2]).max()
    assert fine < 0.5 * coarse
    assert fine < 1.0
    assert np.ptp(means[2]) > 3.0, "the sides must differ to test anything"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"thermistors": {"t1": Thermistor("pump")}}, "thermistor 't1': found 'pump'"),
        ({"downlink": Downlink(("t9",), period=60.0)}, "downlink: found 't9'"),
        ({"downlink": Downlink(("t1",), period=25.0)}, "expected a multiple of the control cycle"),
        ({"branches": {"nominal": Branch({"pump": 20.0})}}, "branch 'nominal': found 'pump'"),
    ],
)
def test_what_does_not_fit_together_is_an_error(tmp_path, changes, message):
    with pytest.raises(FlightcalError, match=message):
        fly(tank(tmp_path, **changes), START, 100.0)


def test_a_temperature_that_is_not_finite_is_an_error(tmp_path):
    hot = tank(tmp_path, branches={"nominal": Branch({"tank": math.inf})})
    with pytest.raises(FlightcalError, match="not finite at"):
        fly(hot, START, 10_000.0)


@pytest.mark.slow
def test_five_thousand_nodes_fly_and_keep_the_balance_of_energy(tmp_path):
    """52 boxes of 96 cells, each bolted to the next, of which the first is heated: stored heat is what went in, less
    what was radiated."""
    units, capacities = 52, {}
    nodes, conductors = {"space": Node.model_construct(boundary=DEEP_SPACE)}, []
    for k in range(units):
        name, coating = f"unit{k}", {"grey": Coating(0.5, 0.8)}
        unit = Box((0.0, 0.0, 0.0), (0.5, 0.5, 0.5), 0.003, "aluminium", 4, Side("grey"), "grey", joints=20.0)
        bare = {key: replace(p, positive=None, negative=None) for key, p in box_plates(name, unit).items()}
        made = mesh_plates(
            Body(materials=ALUMINIUM, coatings=coating, plates=bare, joints=tuple(box_joints(name, unit)))
        )
        nodes |= {name: node.model_copy(update={"initial": 290.0}) for name, node in made.nodes.items()}
        capacities |= {name: node.capacity for name, node in made.nodes.items()}
        conductors += made.conductors
        if k:
            between = (f"unit{k - 1}.x+[1,1]", f"unit{k}.x-[1,1]")
            conductors.append(Conductor.model_construct(between=between, conductance=0.5))
    area = 0.8 * 0.5**2 / 16
    conductors += [Conductor.model_construct(between=(name, "space"), radiative=area) for name in capacities]
    scenario = scenario_of(tmp_path, nodes, conductors, modes={"on": {"unit0.z-[1,1]": 40.0}}, step=20.0)
    craft = Spacecraft(scenario, OnboardSoftware(60.0, "on", {"on": ()}), {}, Downlink((), period=60.0))
    flight = fly(craft, START, 3000.0)
    assert len(flight.nodes) == 4992
    weights = np.array([capacities[name] for name in flight.nodes])
    stored = (flight.temperatures[-1] - flight.temperatures[0]) @ weights
    lost = STEFAN_BOLTZMANN * area * (flight.temperatures**4 - DEEP_SPACE**4).sum(axis=1)
    seconds = flight.cycle_times[-1] - flight.cycle_times[0]
    radiated = np.trapezoid(lost, flight.cycle_times)
    assert stored == pytest.approx(40.0 * seconds - radiated, abs=1e-4 * radiated)
