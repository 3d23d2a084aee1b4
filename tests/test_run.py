import json
from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest
import xarray

from flightcal.errors import RunError
from flightcal.run import open_run, plain, read_dataset, read_provenance, read_records, read_tree, typed


def opened(path, identity="a"):
    with open_run(path, {"the scenario": identity}, "name: x\n", {"telemetry.csv": "0"}, 1) as run:
        return run


def test_a_stage_is_done_only_with_its_files_and_the_same_inputs(tmp_path):
    run = opened(tmp_path / "run")
    with run.stage("genetic", "key"):
        assert not run.is_done("genetic", "key", ())
        run.write_json("genetic.json", {})
    assert run.is_done("genetic", "key", ("genetic.json",))
    assert not run.is_done("genetic", "other key", ("genetic.json",))
    run.file("genetic.json").unlink()
    assert not run.is_done("genetic", "key", ("genetic.json",))


def test_a_stage_that_fails_is_not_done(tmp_path):
    run = opened(tmp_path / "run")
    with pytest.raises(ValueError, match="broken"), run.stage("nuts", "key"):
        raise ValueError("broken")
    assert not run.is_done("nuts", "key", ())


def test_a_stage_that_has_begun_again_is_not_done_and_keeps_its_files(tmp_path):
    run = opened(tmp_path / "run")
    with run.stage("nuts", "key"):
        run.write_json("posterior.json", {})
    run.begin("nuts")
    assert not run.is_done("nuts", "key", ())
    assert run.file("posterior.json").exists()


def test_reopening_keeps_what_is_done(tmp_path):
    with opened(tmp_path / "run").stage("genetic", "key"):
        pass
    assert opened(tmp_path / "run").is_done("genetic", "key", ())


def test_another_scenario_is_refused(tmp_path):
    opened(tmp_path / "run").write_json("genetic.json", {})
    with pytest.raises(RunError, match=r"run of another scenario.*\(what differs: the scenario\)"):
        opened(tmp_path / "run", identity="b")


def test_a_folder_whose_command_was_refused_before_its_first_result_is_free(tmp_path):
    opened(tmp_path / "run")
    assert read_provenance(opened(tmp_path / "run", identity="b").path)["parts"] == {"the scenario": "b"}


def test_a_folder_of_other_files_is_refused_and_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(RunError, match="holds files but no run"):
        opened(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_file_in_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "run").write_text("mine")
    with pytest.raises(RunError, match="found a file"):
        opened(tmp_path / "run")


@pytest.mark.parametrize("content", ["{", "[]"])
def test_damaged_provenance_is_named(tmp_path, content):
    opened(tmp_path / "run")
    (tmp_path / "run" / "provenance.json").write_text(content)
    with pytest.raises(RunError, match=r"provenance.json: found"):
        read_provenance(tmp_path / "run")


def test_a_failed_write_leaves_the_old_file_and_no_other(tmp_path):
    run = opened(tmp_path / "run")
    run.write_json("metrics.json", {"value": 1})
    before = sorted(file.name for file in run.path.iterdir())
    with pytest.raises(ValueError, match="JSON"):
        run.write_json("metrics.json", {"value": float("nan")})
    assert json.loads(run.file("metrics.json").read_text()) == {"value": 1}
    assert sorted(file.name for file in run.path.iterdir()) == before


def test_datasets_and_trees_come_back_as_written(tmp_path):
    run = opened(tmp_path / "run")
    data = xarray.Dataset({"x": ("time", [1.0, 2.0])}, attrs={"seed": 1})
    run.write_netcdf("a.nc", data)
    run.write_netcdf("b.nc", xarray.DataTree.from_dict({"train": data}))
    xarray.testing.assert_identical(run.read_dataset("a.nc"), data)
    xarray.testing.assert_identical(run.read_tree("b.nc")["train"].to_dataset(), data)


@dataclass(frozen=True)
class Part:
    name: str
    values: tuple[float, ...]


@dataclass(frozen=True)
class Whole:
    first: np.datetime64 | None
    share: float
    limit: float | None
    parts: tuple[Part, ...]
    note: str = ""


def test_a_dataclass_comes_back_as_written(tmp_path):
    run = opened(tmp_path / "run")
    record = Whole(np.datetime64("2024-03-01T00:00:00"), np.nan, None, (Part("a", (1.0, 2.0)), Part("b", ())))
    run.write_json("records.json", [plain(record) | {"of a later version": 1}])
    assert repr(read_records(run.file("records.json"), partial(typed, Whole))) == repr([record])


def test_a_record_that_lacks_a_field_is_named(tmp_path):
    file = tmp_path / "records.json"
    for content, words in (('[{"name": "a"}]', "no field 'values'"), ("[1]", "not as expected"), ("{", "not JSON")):
        file.write_text(content)
        with pytest.raises(RunError, match=rf"records\.json: .*{words}"):
            read_records(file, partial(typed, Part))


@pytest.mark.parametrize("read", [read_dataset, read_tree])
def test_a_damaged_netcdf_file_is_named(tmp_path, read):
    (tmp_path / "a.nc").write_text("{")
    with pytest.raises(RunError, match=r"a\.nc: not a netCDF file"):
        read(tmp_path / "a.nc")
