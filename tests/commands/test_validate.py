"""`flightcal validate`: what it writes, that it resumes, and its exit codes; the repeats themselves are made up."""

import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

from flightcal.cli import GATE_FAILED, USER_ERROR, app
from flightcal.commands.validate import validate_scenario
from flightcal.errors import RunError
from flightcal.problem import heat_in_prior
from flightcal.validation import repeats
from flightcal.validation.simulation_based import Repeat
from tests.commands.test_calibrate import write
from tests.told import Told

run = CliRunner().invoke


@pytest.fixture
def scenario(tmp_path, monkeypatch):
    """The small scenario, whose repeats are draws of a posterior N(0, width^2) around a truth of N(0, 1)."""
    file = write(tmp_path)
    made = []

    def one(source, number):
        made.append(number)
        rng = np.random.default_rng([4, number])
        return Repeat(
            rng.normal(size=7), rng.random(7) ** one.power, np.zeros(7), np.ones(7), 100,
            ("R-hat",) if number == 3 else (), 0, 1.5,
        )  # fmt: skip

    one.power = 1.0
    monkeypatch.setattr(repeats, "_one", one)
    monkeypatch.setattr(repeats, "warm", lambda problem: None)
    return file, tmp_path / "out", made, one


def test_a_validation_leaves_its_repeats_its_result_and_a_page(scenario):
    file, out, _, _ = scenario
    told = Told()
    found = validate_scenario(file, out, 20, workers=1, progress=told)
    assert found.passed
    assert len(list((out / "repeats").iterdir())) == 20
    assert re.fullmatch(r"20 repeats, each a short calibration, 1 at a time: about \d+ (s|min) in all", told.said[0])
    content = json.loads((out / "validation.json").read_text())
    assert [quantity["name"] for quantity in content["quantities"]] == [*found.names]
    assert found.names[-1] == "log density"
    assert np.array(content["ranks"]).shape == (20, 7)
    page = (out / "validation.html").read_text(encoding="utf-8")
    assert "Posteriors cover what made the telemetry" in page
    assert "failed a gate in 1 of 20 repeats" in page
    places = re.findall(r'class="plot" id="(figure-\d+)"', page)
    assert len(places) == 2


def test_repeats_that_are_done_are_not_run_again_and_more_can_be_asked_for(scenario):
    file, out, made, _ = scenario
    validate_scenario(file, out, 20, workers=1)
    first = (out / "repeats" / "0007.json").read_bytes()
    (out / "repeats" / "0011.json").unlink()
    made.clear()
    told = Told()
    found = validate_scenario(file, out, 25, workers=1, progress=told)
    assert made == [11, 20, 21, 22, 23, 24]
    assert told.stages["validating"][0] == (19, "")
    assert told.stages["validating"][-1] == (25, "25 of 25 repeats")
    assert len(found.repeats) == 25
    assert (out / "repeats" / "0007.json").read_bytes() == first


def test_another_scenario_is_refused(scenario, tmp_path):
    file, out, _, _ = scenario
    validate_scenario(file, out, 20, workers=1)
    file.write_text(file.read_text().replace("3000 J/K", "3100 J/K"))
    repeats.prepared.cache_clear()
    with pytest.raises(RunError, match="another scenario"):
        validate_scenario(file, out, 20, workers=1)


def test_a_damaged_repeat_is_said_and_run_again(scenario):
    file, out, made, _ = scenario
    validate_scenario(file, out, 20, workers=1)
    whole = (out / "repeats" / "0002.json").read_bytes()
    (out / "repeats" / "0002.json").write_bytes(whole[:-9])
    made.clear()
    told = Told()
    validate_scenario(file, out, 20, workers=1, progress=told)
    assert made == [2]
    assert any("0002.json: damaged" in line for line in told.said)
    assert (out / "repeats" / "0002.json").read_bytes() == whole


def test_ranks_outside_of_the_band_have_the_exit_code_of_a_failed_gate(scenario):
    file, out, _, one = scenario
    arguments = ["validate", str(file), "--repeats", "40", "--workers", "1", "--out"]
    assert run(app, [*arguments, str(out)]).exit_code == 0
    one.power = 3.0
    result = run(app, [*arguments, str(out.with_name("wrong"))])
    assert result.exit_code == GATE_FAILED
    assert "Posteriors do not cover what made the telemetry" in result.output


def test_a_simulator_without_derivatives_is_a_message(tmp_path, monkeypatch):
    monkeypatch.setattr(repeats, "needs_emulator", lambda problem: True)
    result = run(app, ["validate", str(write(tmp_path)), "--out", str(tmp_path / "out")])
    assert result.exit_code == USER_ERROR
    assert "without derivatives" in result.output


def test_with_unmodelled_heat_its_sizes_are_ranked_and_the_noises_shape_is_not(tmp_path):
    file = write(tmp_path)
    file.write_text(file.read_text().replace("heat: none", "heat: {}"))
    problem, _ = repeats.prepared(str(file), None, None)
    names = repeats.ranked_names(problem)
    assert {name for name in names if name.startswith("heat.")} == set(heat_in_prior(problem).names)
    assert repeats.LOG_DENSITY not in names
    assert not any(name.endswith("correlation_time") for name in names)
    deviations = repeats._prior_deviations(problem, names)
    assert np.isfinite(deviations).all()
