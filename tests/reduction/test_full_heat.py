"""Heat into nodes of the full network, in a reduced model as in the full one."""

from dataclasses import replace

import numpy as np
import pytest
import xarray

from flightcal.reduction.candidate import errors_of, theta_of
from flightcal.reduction.file import load_task
from flightcal.reduction.full_heat import full_heat
from flightcal.reduction.full_order import run_full
from flightcal.reduction.names import node_name
from flightcal.reduction.reduced_scenario import network_for, reduced_scenario
from flightcal.reduction.storage import load, save, stored_of
from flightcal.scenario import SunTracking
from flightcal.simulator import network_simulator
from tests.reduction import craft
from tests.reduction.test_projection import model_of

UNITS, PANELS = ["battery", "unit"], ["bus.z-[1,1]", "bus.z-[0,0]"]
"""The last has neither a thermistor nor a heater, and is no state of the reduced model."""
HEATED = [*UNITS, *PANELS]


@pytest.fixture(scope="module")
def task(tmp_path_factory):
    return load_task(craft.write(tmp_path_factory.mktemp("craft")))


@pytest.fixture(scope="module")
def model(task):
    return model_of(task, run_full(task, task.reduction.training), 10, 12)


@pytest.fixture(scope="module")
def held_out(task):
    return run_full(task, task.reduction.held_out)


@pytest.fixture(scope="module")
def known(task):
    return full_heat(task)


def without_thermostats(simulator):
    """Heaters are off, so that what heat does has no jumps."""
    return replace(simulator, drive=replace(simulator.drive, measured=np.zeros_like(simulator.drive.measured)))


@pytest.fixture(scope="module")
def moved(task, model, held_out, known):
    """What heat of a tenth of the flow does, [T, N] K of each node: in the full network, and in the reduced model."""
    (runs,) = held_out
    full = runs.scenario.model_copy(
        update={"simulator": runs.scenario.network.model_copy(update={"step": 30.0})},
    )
    names, reduced = list(map(node_name, HEATED)), reduced_scenario(full, model, 30.0)
    window = xarray.Dataset(), runs.start, runs.end, runs.times
    large = network_simulator(full, *window, period=task.period, heated=HEATED)
    small = network_simulator(reduced, *window, period=task.period, network=network_for(model, reduced, names))
    at_start = runs.temperatures[0, 0, large.network.diffusive]
    found = []
    for simulator, theta in (
        (without_thermostats(large), np.concatenate([runs.parameters[0], at_start])),
        (without_thermostats(small), theta_of(model, runs, 0)),
    ):
        before, of_nodes = simulator.simulate(theta).temperatures, {}
        for k, name in enumerate(HEATED):
            heat = np.zeros((len(HEATED), 2 * (len(simulator.drive.times) - 1)))
            heat[k] = 0.1 * known.flow[known.nodes.index(names[k])]
            of_nodes[name] = simulator.with_heat(heat).simulate(theta).temperatures - before
        found.append(of_nodes)
    return found


def test_heat_at_a_full_node_moves_thermistors_as_in_the_full_network_within_the_models_error(
    task, model, held_out, moved
):
    assert PANELS[-1] not in (*model.states, *model.settled, *model.mixed)
    (errors,) = errors_of(task, model, held_out)
    usual = np.quantile(np.abs(errors.temperatures), 0.95, axis=(0, 1))
    for name in HEATED:
        full, reduced = (by_node[name] for by_node in moved)
        assert (np.abs(reduced - full).max(axis=0) < usual).all()


@pytest.mark.parametrize("name", UNITS)
def test_heat_at_a_unit_moves_thermistors_as_in_the_full_network_to_a_hundredth(moved, name):
    full, reduced = (by_node[name] for by_node in moved)
    assert np.abs(full).max() > 0.5
    assert np.abs(reduced - full).max() < 0.01 * np.abs(full).max()


def test_through_a_unit_flows_what_it_dissipates_and_stores(known):
    unit = known.nodes.index("unit")
    assert 12.0 < known.flow[unit] < 16.0  # 12 W, for some minutes 30 W
    assert (known.flow > 0.0).all()


def test_input_series_bring_what_the_full_network_says(task, model, known):
    brought = dict(zip(known.nodes, known.brought, strict=True))
    columns = dict(zip(model.columns, brought["unit"], strict=True))
    assert columns["mode.nominal"] == pytest.approx(12.0)
    assert columns["mode.imaging"] == pytest.approx(30.0)
    # Its only face: 0.05 m2, of an absorptivity whose prior's median is 0.25.
    (way,) = [name for name, normal in model.ways.items() if normal == (0.0, -1.0, 0.0)]
    of_cell = dict(zip(model.columns, brought["bus_y-_1_0"], strict=True))
    assert of_cell[f"solar.{way}"] == pytest.approx(0.05 * 0.25)


def test_ways_that_faces_look_are_read_back_as_they_were(task, model, known, tmp_path):
    ways = dict.fromkeys(model.ways, (0.0, -1.0, 0.0)) | {
        "body": "all", "array": SunTracking(tracks_sun_about=(0, 1, 0), back=True)
    }  # fmt: skip
    block = reduced_scenario(task.scenario, model, 60.0).network
    save(tmp_path / "rom.nc", stored_of(replace(model, ways=ways), task.scenario, block, {}, known))
    assert load(tmp_path / "rom.nc").model.ways == ways


def test_what_heat_needs_is_read_back_as_it_was(task, model, known, tmp_path):
    block = reduced_scenario(task.scenario, model, 60.0).network
    save(tmp_path / "rom.nc", stored_of(model, task.scenario, block, {}, known))
    again = load(tmp_path / "rom.nc")
    assert again.heat.nodes == known.nodes == again.simulator.full_nodes
    np.testing.assert_array_equal(again.heat.flow, known.flow)
    np.testing.assert_array_equal(again.heat.brought, known.brought)
    np.testing.assert_array_equal(again.model.entering, model.entering)
