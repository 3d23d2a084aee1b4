"""Stages: read where nothing that they were made from has changed, made elsewhere."""

import json

import numpy as np
import pytest

from flightcal.errors import FlightcalError
from flightcal.run import Run, Stage, open_run, read_json
from flightcal.scenario import GeneticSettings
from tests.told import Told


class Thing:
    """A result that says nothing of itself, as an array or a problem does."""


def double(run, number, *, settings=None):
    run.progress.say(f"doubling {number}")
    run.folder.write_json("double.json", 2 * number)


DOUBLE = Stage("double", "doubling", ("double.json",), double, lambda run, *_: Number(run, "double.json"))


class Number:
    def __init__(self, run, name):
        self.value = read_json(run.folder.file(name))


def square(run, number):
    run.folder.write_json("square.json", number.value**2)


SQUARE = Stage("square", "squaring", ("square.json",), square, lambda run, *_: Number(run, "square.json"))


@pytest.fixture
def again(tmp_path):
    """A new call on the same folder: the run and what it tells."""

    def opened():
        told = Told()
        with open_run(tmp_path / "run", {"all": "1"}, "name: x\n", {}, 1, told) as folder:
            return Run(folder, told), told

    return opened


def test_a_stage_is_made_once_and_its_title_shown_each_time(again):
    for before in (False, True):
        run, told = again()
        assert run.stage(DOUBLE, 4).value == 8
        assert told.done_before("doubling") == before
        assert told.said == ([] if before else ["doubling 4"])


def test_another_input_or_setting_makes_it_anew_and_those_after_it(again):
    calls = [(4, None), (5, None), (5, GeneticSettings(runs=3)), (5, GeneticSettings(runs=3))]
    made = []
    for number, settings in calls:
        run, told = again()
        assert run.stage(SQUARE, run.stage(DOUBLE, number, settings=settings)).value == 4 * number**2
        made.append([title for title in told.stages if not told.done_before(title)])
    assert made == [["doubling", "squaring"]] * 3 + [[]]


def test_a_lost_file_makes_it_anew(again):
    run, _ = again()
    run.stage(DOUBLE, 4)
    run.folder.file("double.json").unlink()
    run, told = again()
    assert run.stage(DOUBLE, 4).value == 8
    assert not told.done_before("doubling")


def test_what_no_stage_has_made_counts_by_what_it_is_said_to_follow_from(again):
    made = []
    for key in ("a", "a", "b"):
        run, told = again()
        thing = Thing()
        run.given(key, thing)
        run.stage(Stage("nothing", "nothing", (), lambda *_: None, lambda *_: None), thing)
        made.append(not told.done_before("nothing"))
    assert made == [True, False, True]
    with pytest.raises(TypeError):
        run.stage(DOUBLE, Thing())


def test_an_interrupted_stage_is_used_and_made_anew_by_the_next_call_and_so_is_what_follows(again):
    values = iter([10, 20, 20])

    def measure(run):
        run.folder.write_json("measured.json", next(values))

    stage = Stage(
        "measure", "measuring", ("measured.json",), measure, lambda run: Number(run, "measured.json"),
        lambda made: made.value == 20,
    )  # fmt: skip
    found, squared = [], []
    for _ in range(3):
        run, told = again()
        found.append(run.stage(SQUARE, run.stage(stage)).value)
        squared.append(not told.done_before("squaring"))
    assert found == [100, 400, 400]
    assert squared == [True, True, False]


def test_a_stage_that_fails_is_made_anew_even_with_what_it_was_made_from_before(again):
    def fail(run, *_, **__):
        run.folder.write_json("double.json", 0)
        raise ValueError("broken")

    run, _ = again()
    run.stage(DOUBLE, 4)
    run, _ = again()
    with pytest.raises(ValueError, match="broken"):
        run.stage(Stage("double", "doubling", ("double.json",), fail, DOUBLE.read), 5)
    run, told = again()
    assert run.stage(DOUBLE, 4).value == 8
    assert not told.done_before("doubling")


@pytest.mark.parametrize("error", [ArithmeticError, np.linalg.LinAlgError])
def test_numbers_that_cannot_be_computed_are_told_as_the_users_to_mend(again, error):
    def fail(run, *_, **__):
        raise error("not finite")

    run, _ = again()
    with pytest.raises(FlightcalError, match="doubling: not finite: the scenario is too far from its telemetry"):
        run.stage(Stage("double", "doubling", ("double.json",), fail, DOUBLE.read))


def test_stages_of_a_stage_are_kept_and_what_is_said_goes_to_the_log(again):
    def outer(run):
        run.folder.write_json("outer.json", run.stage(DOUBLE, 3).value + 1)

    stage = Stage("outer", "outside", ("outer.json",), outer, lambda run: Number(run, "outer.json"))
    run, told = again()
    assert run.stage(stage).value == 7
    assert told.said == ["doubling 3"]
    log = [json.loads(line) for line in run.folder.file("log.jsonl").read_text().splitlines()]
    assert ("double", "doubling 3") in [(line["stage"], line.get("text")) for line in log]
    run, told = again()
    run.stage(DOUBLE, 3)
    assert told.done_before("doubling")
