"""Files that survive what happens to disks and processes: full disks, kills, a second process, damage."""

import json
import resource
import signal
import subprocess
import sys
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest
import xarray

from flightcal.errors import RunError
from flightcal.run import Run, Stage, check_whole, files, open_run, read_dataset, read_json, write_bytes, write_netcdf
from tests.told import Told

PARTS = {"the scenario": "a"}


def opened(path, told=None):
    """The run, no longer held."""
    with open_run(path, PARTS, "name: x\n", {}, 1, told or Told()) as run:
        return run


def number(run):
    return read_json(run.folder.file("number.json"))


NUMBER = Stage("number", "counting", ("number.json",), lambda run: run.folder.write_json("number.json", 7), number)


class Killed(BaseException):
    """In the place of a kill, which would end the tests too."""


def killed_at(monkeypatch, count, *, replaced):
    """Have the next `count` files be replaced, and the one after them be the last thing, before or after it is."""
    left, put = [count], files.os.replace

    def last(source, target):
        if left[0] > 0 or replaced:
            put(source, target)
        left[0] -= 1
        if left[0] < 0:
            # What is killed tidies nothing up.
            monkeypatch.setattr(files.Path, "unlink", lambda *_, **__: None)
            raise Killed

    monkeypatch.setattr(files.os, "replace", last)


def names(folder):
    return sorted(file.name for file in folder.iterdir())


@pytest.mark.parametrize("replaced", [False, True])
def test_a_run_that_is_killed_at_any_file_resumes_and_leaves_no_temporaries(tmp_path, monkeypatch, replaced):
    whole = Run(opened(tmp_path / "whole"))
    assert whole.stage(NUMBER) == 7
    for count in range(20):
        folder = tmp_path / f"{count}"
        with monkeypatch.context() as patched:
            killed_at(patched, count, replaced=replaced)
            try:
                Run(opened(folder)).stage(NUMBER)
                break
            except Killed:
                pass
        told = Told()
        run = Run(opened(folder, told), told)
        assert told.said == []
        assert run.stage(NUMBER) == 7
        assert names(folder) == names(whole.path)
    assert count >= 8


def test_a_run_keeps_what_was_done_when_it_is_killed_at_any_file_of_a_later_call(tmp_path, monkeypatch):
    other = replace(NUMBER, name="other", make=lambda run: run.folder.write_json("other.json", 8))
    for count in range(20):
        path = tmp_path / f"{count}"
        Run(opened(path)).stage(NUMBER)
        with monkeypatch.context() as patched:
            killed_at(patched, count, replaced=False)
            try:
                Run(opened(path)).stage(other)
                break
            except Killed:
                pass
        told = Told()
        run = Run(opened(path, told), told)
        run.stage(NUMBER)
        assert told.done_before("counting")
        assert told.said == []
    assert count >= 6


@pytest.mark.parametrize("name", ["number.json", "provenance.json", "scenario.yaml"])
@pytest.mark.parametrize(
    "damage", [lambda content: content[:-1], lambda content: b"", lambda content: b"#" + content[1:]]
)
def test_a_damaged_file_is_said_and_made_again(tmp_path, name, damage):
    run = Run(opened(tmp_path / "run"))
    run.stage(NUMBER)
    file = run.folder.file(name)
    file.write_bytes(damage(file.read_bytes()))
    with pytest.raises(RunError, match=rf"{name}: damaged, its (length|content)"):
        check_whole(run.path)
    told = Told()
    again = Run(opened(run.path, told), told)
    (line,) = told.said
    assert f"{name}: damaged" in line
    assert "it is made again" in line
    assert again.stage(NUMBER) == 7
    assert told.done_before("counting") == (name == "scenario.yaml")
    check_whole(run.path)


@pytest.mark.parametrize("content", [None, "", "{", "[]", '{"number.json": 1}'])
def test_without_digests_nothing_is_trusted_and_this_is_said(tmp_path, content):
    run = Run(opened(tmp_path / "run"))
    run.stage(NUMBER)
    file = run.folder.file("digests.json")
    file.unlink() if content is None else file.write_text(content)
    told = Told()
    again = Run(opened(run.path, told), told)
    assert again.stage(NUMBER) == 7
    assert not told.done_before("counting")
    assert "digests.json: missing or damaged" in told.said[0]


def test_digests_name_no_file_outside_of_the_run(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    run = opened(tmp_path / "run")
    digests = read_json(run.file("digests.json"))
    inside = {"../thesis.txt": [{"bytes": 1, "sha256": ""}], str(tmp_path / "thesis.txt"): [{"bytes": 1}]}
    run.file("digests.json").write_text(json.dumps(digests | inside))
    opened(run.path)
    assert (tmp_path / "thesis.txt").read_text() == "mine"


def test_half_a_line_of_the_log_is_dropped(tmp_path):
    run = opened(tmp_path / "run")
    run.log(event="one")
    with run.file("log.jsonl").open("a") as file:
        file.write('{"event": "tw')
    opened(run.path).log(event="three")
    assert [json.loads(line)["event"] for line in run.file("log.jsonl").read_text().splitlines()] == ["one", "three"]


def test_a_folder_is_held_by_one_run_at_a_time_and_by_none_after_it(tmp_path):
    with ExitStack() as stack:
        stack.enter_context(open_run(tmp_path / "run", PARTS, "", {}, 1))
        with pytest.raises(RunError, match="another process is at work in this folder"):
            opened(tmp_path / "run")
    opened(tmp_path / "run")


HOLDER = """
import sys, time
from pathlib import Path
from flightcal.run import open_run
with open_run(Path(sys.argv[1]), {"the scenario": "a"}, "name: x", {}, 1):
    print("held", flush=True)
    time.sleep(60)
"""


def test_the_folder_of_another_process_is_refused_and_that_of_a_killed_one_is_not(tmp_path):
    with subprocess.Popen([sys.executable, "-c", HOLDER, tmp_path / "run"], stdout=subprocess.PIPE) as holder:
        assert holder.stdout.readline() == b"held\n"
        with pytest.raises(RunError, match="another process is at work in this folder"):
            opened(tmp_path / "run")
        holder.send_signal(signal.SIGKILL)
        holder.wait()
        opened(tmp_path / "run")


def test_a_write_names_the_file_for_which_there_is_no_room_and_leaves_the_old_one(tmp_path, monkeypatch):
    write_bytes(tmp_path / "a.nc", b"old")

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.os, "fsync", full)
    with pytest.raises(OSError, match="the disk is full") as raised:
        write_bytes(tmp_path / "a.nc", b"new")
    assert raised.value.filename == str(tmp_path / "a.nc")
    assert names(tmp_path) == ["a.nc"]
    assert (tmp_path / "a.nc").read_bytes() == b"old"


SMALL_FILES = """
import sys
from pathlib import Path
import numpy, xarray
from flightcal.run import write_netcdf
try:
    write_netcdf(Path(sys.argv[1]), xarray.Dataset({"x": ("t", numpy.arange(50_000.0))}))
except OSError as error:
    print(error.filename)
    sys.exit(1)
"""


@pytest.mark.parametrize(
    "room", [0, 100_000, *(pytest.param(room, marks=pytest.mark.slow) for room in (4096, 399_000))]
)
def test_a_netcdf_file_for_which_there_is_no_room_is_an_error_and_no_crash(tmp_path, room):
    """A limit on the size of files is a full disk for one process alone."""
    command = [sys.executable, "-c", SMALL_FILES, str(tmp_path / "a.nc")]
    limit = resource.RLIMIT_FSIZE
    ended = subprocess.run(
        command, capture_output=True, text=True, check=False,
        preexec_fn=lambda: resource.setrlimit(limit, (room, resource.getrlimit(limit)[1])),
    )  # fmt: skip
    assert (ended.returncode, ended.stdout) == (1, f"{tmp_path / 'a.nc'}\n"), ended.stderr
    assert names(tmp_path) == []


def test_a_netcdf_file_comes_back_to_the_bit(tmp_path):
    data = xarray.Dataset({"x": ("t", np.random.default_rng(0).normal(size=100))}, attrs={"seed": 1})
    write_netcdf(tmp_path / "a.nc", data)
    xarray.testing.assert_identical(read_dataset(tmp_path / "a.nc"), data)
