"""Measured loads whose driver is not what the scenario says."""

import numpy as np
import pytest

from tests import small

from ..cases import named, spoilt


def test_the_sign_of_a_driver_is_named(flown):
    scenario, data = flown
    first = named(scenario, spoilt(data, sun=-data["sun"]))[0]
    assert (first.kind, first.about) == ("driver", "sun")
    assert "sign" in first.title


def test_a_load_that_follows_the_size_of_its_driver_is_named(tmp_path, named_of):
    written = small.content()
    scenario, data = small.load(tmp_path, written)
    seconds = (data["time"].values - data["time"].values[0]) / np.timedelta64(1, "s")
    charge = np.sin(seconds / 1500.0)
    data = small.telemetry_of(scenario, spoilt(data, sun=np.abs(charge)))
    first = named_of(scenario, spoilt(data, sun=charge), "drivers", "clocks")[0]
    assert (first.kind, first.about) == ("driver", "sun size")
    assert "absolute: true" in first.advice


def test_a_driver_that_is_of_no_column_of_the_telemetry_is_named(tmp_path):
    scenario, data = small.load(tmp_path)
    seconds = (data["time"].values - data["time"].values[0]) / np.timedelta64(1, "s")
    true, other = (0.5 + 0.4 * np.sign(np.sin(seconds / period)) for period in (1500.0, 2100.0))
    data = small.telemetry_of(scenario, spoilt(data, sun=true))
    assert named(scenario, data) == ()
    first = named(scenario, spoilt(data, sun=other))[0]
    assert (first.kind, first.about) == ("driver", "sun")
    assert "not as its driver" in first.title


def test_a_driver_of_another_unit_is_named_by_how_many_times(flown, named_of):
    scenario, data = flown
    first = named_of(scenario, spoilt(data, sun=data["sun"] / 6.0), "drivers", "written")[0]
    assert (first.kind, first.about) == ("driver", "sun")
    assert float(first.title.split(" is ")[1].split()[0]) == pytest.approx(6.0, rel=0.2)


def test_a_driver_with_several_times_the_heat_is_named_by_how_many_times(flown, named_of):
    scenario, data = flown
    first = named_of(scenario, spoilt(data, sun=4.0 * data["sun"]), "drivers", "written")[0]
    assert (first.kind, first.about) == ("driver", "sun")
    assert float(first.title.split(" is ")[1].split()[0]) == pytest.approx(0.25, rel=0.05)


def test_a_driver_in_amperes_that_is_read_as_a_thousand_times_as_many_is_named_by_its_size(tmp_path, named_of):
    scenario, data = with_a_bus(tmp_path)
    first = named_of(scenario, spoilt(data, bus=1000.0 * data["bus"]), "drivers", "written")[0]
    assert (first.kind, first.about) == ("driver", "bus")
    assert "nothing" not in first.title
    assert "'unit' of bus" in first.advice


def with_a_bus(folder, **drivers):
    """The satellite with a bus that is switched on and off, whose current heats the body, and telemetry of it.

    drivers: of loads, in the place of those by which it flew; None: the load is not written.
    """
    written = small.content()
    written["telemetry"]["channels"]["bus"] = {"column": "bus", "kind": "driver", "unit": "A"}
    loads = written["simulator"]["loads"]
    loads["electronics"] = {"node": "body", "driver": "bus", "coefficient": "15 W/A"}
    minutes = np.arange(421)
    bus = 0.2 + 0.6 * (minutes % 37 < 15)
    _, data = small.closed_loop(folder, written, columns={"bus": bus})
    for load, driver in drivers.items():
        if driver is None:
            del loads[load]
        else:
            loads[load]["driver"] = driver
    return small.load(folder, written, columns={"bus": bus})[0], data


def test_a_load_that_follows_another_column_is_named(tmp_path):
    first = named(*with_a_bus(tmp_path, electronics="sun"))[0]
    assert first.title == "Load electronics follows bus, not sun"


def test_a_load_that_is_left_out_is_named_by_the_driver_that_nothing_follows(tmp_path, named_of):
    first = named_of(*with_a_bus(tmp_path, electronics=None), "drivers", "clocks")[0]
    assert first.title == "A load of body is missing in the scenario: bus heats it"
    assert float(first.sentence.split(" W ")[0].split()[-1]) == pytest.approx(12.0, rel=0.1)


def with_a_current(folder, change):
    """The satellite with a battery's current, which warms the body while it is below zero, and telemetry of it.

    change: of the loads, after that.
    """
    written = small.content()
    written["telemetry"]["channels"]["current"] = {"column": "current", "kind": "driver", "unit": "A"}
    loads = written["simulator"]["loads"]
    table = [["-4 A", 1], ["0 A", 0], ["4 A", 0]]
    loads["discharge"] = {"node": "body", "driver": "current", "coefficient": "12 W", "table": table}
    columns = {"current": np.where(np.arange(421) % 37 < 15, -4.0, 1.5)}
    _, data = small.closed_loop(folder, written, columns=columns)
    change(loads)
    return small.load(folder, written, columns=columns)[0], data


def test_a_load_that_is_left_out_may_be_of_one_sign_of_its_driver_alone(tmp_path, named_of):
    first = named_of(*with_a_current(tmp_path, lambda loads: loads.pop("discharge")), "drivers", "clocks")[0]
    assert first.title == "A load of body is missing in the scenario: current below zero heats it"


def test_a_driver_that_counts_the_other_way_round_than_a_loads_table_is_named(tmp_path, named_of):
    mirrored = [["-4 A", 0], ["0 A", 0], ["4 A", 1]]
    first = named_of(
        *with_a_current(tmp_path, lambda loads: loads["discharge"].update(table=mirrored)), "drivers", "clocks"
    )[0]
    assert first.title == "The driver current has the wrong sign"


def test_a_driver_that_heats_nothing_is_no_load_that_is_left_out(tmp_path):
    written = small.content()
    written["telemetry"]["channels"]["bus"] = {"column": "bus", "kind": "driver", "unit": "A"}
    bus = 0.2 + 0.6 * (np.arange(421) % 37 < 15)
    assert named(*small.closed_loop(tmp_path, written, columns={"bus": bus})) == ()


def test_two_drivers_that_are_exchanged_are_named(tmp_path, named_of):
    first = named_of(*with_a_bus(tmp_path, electronics="sun", sun="bus"), "drivers", "clocks")[0]
    assert first.title == "The drivers bus and sun are exchanged"


def test_a_load_in_another_node_is_named(tmp_path, named_of):
    written = small.content()
    _, data = small.closed_loop(tmp_path, written)
    ((name, load),) = written["simulator"]["loads"].items()
    right = load["node"]
    load["node"] = next(node for node in written["simulator"]["nodes"] if node not in (right, "space"))
    scenario, _ = small.load(tmp_path, written)
    first = named_of(scenario, data, "drivers", "clocks")[0]
    assert first.title == f"Load {name} heats {right}, not {load['node']}"


def with_a_table(folder, *factors):
    """The satellite with a camera that is off, waits or works, and telemetry of it with the factors 0, 0.3 and 1."""
    written = small.content()
    written["telemetry"]["channels"]["state"] = {"column": "state", "kind": "driver", "unit": "1", "fill": "hold"}
    camera = {"node": "body", "driver": "state", "coefficient": "20 W", "table": [[0, 0], [1, 0.3], [2, 1]]}
    written["simulator"]["loads"]["camera"] = camera
    state = np.resize(np.repeat([0, 1, 2, 1, 0, 2], [20, 15, 9, 12, 17, 6]), 421)
    _, data = small.closed_loop(folder, written, columns={"state": state})
    camera["table"] = [[place, factor] for place, factor in enumerate(factors)]
    return small.load(folder, written, columns={"state": state})[0], data


def test_factors_of_a_table_that_are_exchanged_are_named(tmp_path, named_of):
    (only,) = named_of(*with_a_table(tmp_path, 0.0, 1.0, 0.3), "drivers", "clocks")
    assert only.title == "Two factors in the table of load camera are exchanged"
    assert only.sentence.startswith("With 0.3 at 1 and 1 at 2,")


def test_nothing_is_said_of_a_table_that_is_right(tmp_path):
    assert named(*with_a_table(tmp_path, 0.0, 0.3, 1.0)) == ()


def test_nothing_is_said_of_two_drivers_that_are_right(tmp_path):
    assert named(*with_a_bus(tmp_path)) == ()


@pytest.mark.parametrize(
    ("read", "title"),
    [
        (np.deg2rad, "The angle pitch is in rad, not in deg"),
        (lambda pitch: 180.0 - pitch, "The angle pitch is that from the opposite axis"),
    ],
)
def test_an_angle_of_another_unit_or_from_another_axis_is_named(tmp_path, read, title, named_of):
    written = small.content()
    written["telemetry"]["channels"]["pitch"] = {"column": "pitch", "kind": "driver", "unit": "deg"}
    load = {"node": "panel", "driver": "pitch", "coefficient": "15 W", "table": [[0, 1], [60, 0.3], [120, 0], [180, 0]]}
    written["simulator"]["loads"]["sunlight"] = load
    pitch = 20.0 + 130.0 * (np.arange(421) // 23 * 37 % 100 / 100.0)
    scenario, data = small.closed_loop(tmp_path, written, columns={"pitch": pitch})
    assert named(scenario, data) == ()
    scenario, _ = small.load(tmp_path, written, columns={"pitch": read(pitch)})
    first = named_of(scenario, spoilt(data, pitch=np.deg2rad(read(pitch))), "drivers", "clocks")[0]
    assert first.title == title
