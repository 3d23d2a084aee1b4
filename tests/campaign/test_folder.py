import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray

from flightcal.campaign import Design, Subject, input_hashes, open_campaign, scenario_parts
from flightcal.campaign.folder import locked, prepare
from flightcal.errors import RunError
from flightcal.external.record import Record
from flightcal.scenario import load_scenario
from tests import small
from tests.commands.test_calibrate import write

EXAMPLES = Path(__file__).parents[2] / "examples"
SUBJECT = Subject(
    parts={"simulator": "s1", "window train": "w1"},
    inputs={"somewhere/telemetry.csv": "t1"},
    parameters=("a", "b"),
    channels=("body",),
    heaters=("h1", "h2"),
    times=np.datetime64("2024-03-01", "ns") + np.arange(3) * np.timedelta64(60, "s"),
)
THETA = np.arange(8.0).reshape(4, 2)
DESIGN = Design("sobol", 1, {"priors": "p1", "posterior": None}, THETA)


def prepared(folder, subject=SUBJECT, design=DESIGN):
    with locked(folder):
        return prepare(folder, subject, design)


def record(theta, outcome="finished"):
    values = theta[0] if outcome == "finished" else np.nan
    return Record(theta, outcome, "", 1, 0.5, np.full((3, 1), values), np.full((3, 2), values))


def test_a_campaign_opens_as_one_dataset(tmp_path):
    store = prepared(tmp_path / "c")
    store.write(THETA[1], record(THETA[1]))
    store.write(THETA[2], record(THETA[2], "timed out"))
    store.write(THETA[3], record(THETA[3]))
    store.file(THETA[3]).write_bytes(b"half")
    data = open_campaign(tmp_path / "c")
    assert dict(data.sizes) == {"run": 4, "parameter": 2, "time": 3, "channel": 1, "heater": 2}
    np.testing.assert_array_equal(data["theta"], THETA)
    assert data["outcome"].values.tolist() == ["not run", "finished", "timed out", "damaged"]
    assert data["attempts"].values.tolist() == [0, 1, 1, 0]
    np.testing.assert_array_equal(data["temperatures"][1, :, 0], np.full(3, 2.0))
    assert np.isnan(data["temperatures"][[0, 2, 3]]).all()
    assert data["time"].values[1] == SUBJECT.times[1]
    assert data["parameter"].values.tolist() == ["a", "b"]


def test_the_dataset_can_be_kept_as_a_file(tmp_path):
    store = prepared(tmp_path / "c")
    store.write(THETA[1], record(THETA[1]))
    data = open_campaign(tmp_path / "c")
    data.to_netcdf(tmp_path / "c.nc", engine="h5netcdf")
    with xarray.open_dataset(tmp_path / "c.nc", engine="h5netcdf") as again:
        xarray.testing.assert_equal(again.load(), data)


def test_the_same_campaign_is_taken_up_and_a_longer_design_grows_it(tmp_path):
    store = prepared(tmp_path / "c")
    store.write(THETA[1], record(THETA[1]))
    before = (tmp_path / "c" / "campaign.json").read_bytes()
    assert prepared(tmp_path / "c").read(THETA[1]) is not None
    longer = dataclasses.replace(DESIGN, theta=np.arange(20.0).reshape(10, 2))
    prepared(tmp_path / "c", design=longer)
    prepared(tmp_path / "c")  # a shorter one leaves it long
    assert open_campaign(tmp_path / "c")["outcome"].values.tolist() == ["not run", "finished", *["not run"] * 8]
    assert (tmp_path / "c" / "campaign.json").read_bytes() == before


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"parts": {"simulator": "s2", "window train": "w1"}}, r"what differs: simulator\)"),
        ({"parts": {"simulator": "s1", "window test": "w1"}}, r"what differs: window test\)"),
        ({"inputs": {"telemetry.csv": "t2"}}, r"what differs: telemetry.csv\)"),
        ({"channels": ("panel",)}, "the scenario has changed"),
    ],
)
def test_another_simulator_is_refused_and_what_differs_is_named(tmp_path, change, message):
    prepared(tmp_path / "c")
    with pytest.raises(RunError, match=message):
        prepared(tmp_path / "c", subject=dataclasses.replace(SUBJECT, **change))


def test_an_input_file_in_another_place_is_the_same_input(tmp_path):
    prepared(tmp_path / "c")
    prepared(tmp_path / "c", subject=dataclasses.replace(SUBJECT, inputs={"elsewhere/telemetry.csv": "t1"}))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "prior"}, "another kind .found sobol, expected prior"),
        ({"seed": 2}, "another seed .found 1, expected 2"),
        ({"origin": {"priors": "p2", "posterior": None}}, "another priors .found p1, expected p2"),
        ({"origin": {"priors": "p1", "posterior": "x"}}, "another posterior .found none, expected x"),
        ({"theta": THETA + 1e-12}, "other versions of scipy"),
    ],
)
def test_another_design_is_refused_and_what_differs_is_named(tmp_path, change, message):
    prepared(tmp_path / "c")
    with pytest.raises(RunError, match=message):
        prepared(tmp_path / "c", design=dataclasses.replace(DESIGN, **change))


def test_a_latin_hypercube_does_not_grow(tmp_path):
    design = dataclasses.replace(DESIGN, kind="latin-hypercube")
    prepared(tmp_path / "c", design=design)
    with pytest.raises(RunError, match="4 runs, which cannot become one of 3"):
        prepared(tmp_path / "c", design=dataclasses.replace(design, theta=THETA[:3]))


def test_a_campaign_is_run_by_one_process_at_a_time(tmp_path):
    with locked(tmp_path / "c"), pytest.raises(RunError, match="another process is at work"), locked(tmp_path / "c"):
        pass
    with locked(tmp_path / "c"):
        pass


def test_a_folder_of_something_else_is_refused_and_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    for folder, message in ((tmp_path, "holds thesis.txt but no campaign"), (tmp_path / "thesis.txt", "found a file")):
        with pytest.raises(RunError, match=message), locked(folder):
            pass
        with pytest.raises(RunError, match=r"found no campaign\.json"):
            open_campaign(folder)
    assert [file.name for file in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_campaign_that_was_killed_while_it_was_described_begins_anew(tmp_path):
    prepared(tmp_path / "c")
    (tmp_path / "c" / "campaign.json").unlink()
    (tmp_path / "c" / ".campaign.json.x7").write_text("{")
    prepared(tmp_path / "c", design=dataclasses.replace(DESIGN, seed=2))
    assert open_campaign(tmp_path / "c").attrs["seed"] == 2


@pytest.mark.parametrize("content", ["", "[]", "{}"])
def test_a_damaged_description_is_named(tmp_path, content):
    prepared(tmp_path / "c")
    (tmp_path / "c" / "campaign.json").write_text(content)
    with pytest.raises(RunError, match=r"campaign.json: found damaged content"):
        prepared(tmp_path / "c")


def identity(folder, window="train", change=None, times=SUBJECT.times):
    written = small.content()
    if change:
        change(written)
    small.load(folder, written)
    scenario = load_scenario(folder / "scenario.yaml")
    parts, inputs = scenario_parts(scenario, window), input_hashes(scenario)
    return Subject(parts, inputs, ("a",), ("b",), (), times).identity


def test_the_identity_does_not_change_when_nothing_that_is_simulated_does(tmp_path):
    folders = [tmp_path / name for name in "abcde"]
    for folder in folders:
        folder.mkdir()
    changes = [
        None,
        lambda s: s["calibration"].update(seed=77),
        lambda s: s["parameters"]["link"].update(prior={"uniform": ["0.1 W/K", "1 W/K"]}),
        lambda s: s["observations"]["panel_temp"].update(noise="0.3 K"),
        lambda s: s["windows"].update(test={"start": "2024-03-01T04:00:00", "orbits": 1}),
    ]
    assert len({identity(folder, change=change) for folder, change in zip(folders, changes, strict=True)}) == 1


@pytest.mark.parametrize(
    "change",
    [
        lambda s: s["simulator"]["nodes"]["body"].update(capacity="3001 J/K"),
        lambda s: s["simulator"].update(step="20 s"),
        lambda s: s["environment"].update(period="91 min"),
        lambda s: s["telemetry"]["channels"]["sun"].update(valid_range=["-1 A", "2 A"]),
        lambda s: s["observations"]["panel_temp"].update(bias="0.1 K"),
        lambda s: (
            s["parameters"]["link"].update(
                sets="conductors.panel-space.radiative", prior={"uniform": ["1 m^2", "2 m^2"]}
            )
            or s["parameters"]["panel_size"].update(scales="loads.sun.coefficient")
        ),
        lambda s: s["windows"]["train"].update(end="2024-03-01T03:01:00"),
    ],
)
def test_the_identity_changes_with_anything_that_is_simulated(tmp_path, change):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    assert identity(tmp_path / "a") != identity(tmp_path / "b", change=change)


def test_the_identity_of_an_executable_has_its_files_and_not_how_long_it_is_tried(tmp_path):
    def identity():
        scenario = load_scenario(tmp_path / "e" / "scenario.yaml")
        return Subject(scenario_parts(scenario, "train"), input_hashes(scenario), (), (), (), []).identity

    shutil.copytree(EXAMPLES / "executable", tmp_path / "e")
    first, file = identity(), tmp_path / "e" / "scenario.yaml"
    text = file.read_text()
    file.write_text(text.replace("timeout: 20 s", "timeout: 30 s").replace("retries: 1", "retries: 4"))
    assert identity() == first
    for name in ("simulator.py", "input.json.jinja", "telemetry.csv"):
        before = identity()
        with (tmp_path / "e" / name).open("a") as stream:
            stream.write("\n")
        assert identity() != before
    before = identity()
    file.write_text(text.replace("emissivity: 0.7", "emissivity: 0.71"))
    assert identity() != before


def test_the_identity_changes_with_window_times_and_the_content_of_inputs(tmp_path):
    scenario = load_scenario(write(tmp_path))
    before = input_hashes(scenario)
    with (tmp_path / "telemetry.csv").open("a") as file:
        file.write("\n")
    assert input_hashes(scenario) != before
    assert scenario_parts(scenario, "train") != scenario_parts(scenario, "test")
    assert dataclasses.replace(SUBJECT, times=SUBJECT.times[:-1]).identity != SUBJECT.identity
    assert len(json.dumps(scenario_parts(scenario, "train"))) > 64
