import sys
import textwrap
import time

import numpy as np
import pytest

from flightcal.errors import ScenarioError
from flightcal.scenario import lint, load_scenario, resolved_yaml
from flightcal.simulator import SimulationFailure

from .scenes import SAMPLES, THETA, TIMES, simulator_of, write, written

TEMPLATE = "{{ inputs.link }}\n{{ inputs['load'] }}\n{{ start.isoformat() }}\n{{ times | join(' ') }}\n"
GOOD = """
import sys
link, load, start, times = open("input.txt").read().splitlines()
link, load, times = float(link), float(load), [float(t) for t in times.split()]
rows = [(t, link * t / 100, load, 1 if t > 600 else 0) for t in times]
def write(rows, header="time,battery,radiator,heater"):
    with open("output.csv", "w") as file:
        print(header, file=file)
        for row in rows:
            print(*row, sep=",", file=file)
"""


def block(folder, program, **changes):
    (folder / "input.txt.jinja").write_text(TEMPLATE)
    (folder / "program.py").write_text(textwrap.dedent(program))
    executable = {
        "command": [sys.executable, "-I", "-S", "program.py"],
        "files": ["program.py"],
        "templates": {"input.txt": "input.txt.jinja"},
    }
    outputs = {"battery": {"unit": "degC"}, "radiator": {}}
    simulator = {"outputs": outputs, "executable": {**executable, **changes.pop("executable", {})}}
    return {**simulator, **changes}


def build(folder, program, **changes):
    return simulator_of(folder, block(folder, program, **changes))


def record_of(folder, program, **changes):
    return build(folder, program, **changes).run(THETA)


def test_output_is_read_in_kelvin_at_the_sample_times(tmp_path):
    record = record_of(tmp_path, GOOD + "write(rows)")

    assert (record.outcome, record.message, record.attempts) == ("finished", "", 1)
    np.testing.assert_allclose(record.temperatures[:, 0], 273.15 + 0.8 * TIMES / 100)
    np.testing.assert_allclose(record.temperatures[:, 1], 5.0)
    assert record.status.shape == (SAMPLES, 0)
    assert 0 < record.seconds < 20


def test_heater_status_gives_duty_cycle_switches_and_power(tmp_path):
    heaters = {"warmer": {"name": "heater", "power": "load"}}
    simulator = build(tmp_path, GOOD + "write(rows)", heaters=heaters)
    run = simulator.simulate(THETA)

    np.testing.assert_array_equal(run.status[:, 0], TIMES > 600)
    # Each sample stands for the time from halfway to its neighbours: on from 630 s to the window's end, 1860 s.
    np.testing.assert_allclose(run.duty_cycle, [1230 / 1860])
    assert run.switches.time.tolist() == [660.0]
    assert run.switches.on.tolist() == [1.0]
    np.testing.assert_allclose(simulator.heater_power(THETA), [5.0])


def test_start_and_inputs_reach_the_program_through_the_template(tmp_path):
    program = (
        GOOD + "assert start == '2024-03-01T00:00:00' and (link, load) == (0.8, 5.0) and len(times) == 31\nwrite(rows)"
    )
    assert record_of(tmp_path, program).outcome == "finished"


def test_many_runs_keep_their_order_and_their_failures(tmp_path):
    simulator = build(tmp_path, GOOD + "if link > 1: sys.exit(4)\nwrite(rows)")
    thetas = np.array([[link, 3.0] for link in (0.2, 1.5, 0.4, 0.6, 1.2)])

    runs = simulator.simulate_many(thetas)

    assert [run is None for run in runs] == [False, True, False, False, True]
    last = [run.temperatures[-1, 0] - 273.15 for run in runs if run is not None]
    np.testing.assert_allclose(last, np.array([0.2, 0.4, 0.6]) * TIMES[-1] / 100)


BAD = {
    "exit code": ("sys.stderr.write('no licence'); sys.exit(3)", "crashed", "exit code 3; it said: no licence"),
    "signal": ("import os; os.kill(os.getpid(), 11)", "crashed", "killed by signal 11 (SIGSEGV)"),
    "no file": ("pass", "partial output", "no output file 'output.csv', though the exit code is 0; the folder has"),
    "empty file": ("open('output.csv', 'w')", "partial output", "output.csv is empty"),
    "garbage": ("open('output.csv', 'wb').write(bytes(range(256)))", "wrong shape", "output.csv is not a CSV file"),
    "too long": ("open('output.csv', 'w').truncate(400_000_000)", "wrong shape", "found 400 MB, expected 300 MB at m"),
    "words": ("write([(t, 'hot', 1, 0) for t in times])", "wrong shape", "row 2, 'battery': found 'hot', expected a n"),
    "column": ("write(rows, 'time,battery,radiatr,heater')", "wrong shape", "expected radiator too"),
    "nan": ("write([(*r[:2], 'nan', 0) for r in rows])", "not finite", "nan in 'radiator' at sample 1 of 31, 31 such"),
    "infinite": ("write([(t, '-inf' if t == 60 else 1, 1, 0) for t in times])", "not finite", "-inf in 'battery' at"),
    "half the rows": ("write(rows[:12])", "partial output", "found 12 times from 0 s to 660 s, expected 31 times"),
    "half a row": ("write([*rows[:-1], rows[-1][:2]])", "partial output", "row 32: found 2 values, expected 4"),
    "short row inside": ("write([rows[0][:2], *rows[1:]])", "wrong shape", "row 2: found 2 values, expected 4"),
    "minutes": ("write([(t / 60, *r) for t, *r in rows])", "wrong times", "to 30 s, expected 31 times from 0 s to"),
    "finer": ("write([(10 * k, 1, 1, 0) for k in range(190)])", "wrong times", "'interpolate: true' allows other tim"),
    "backwards": ("write(rows[::-1])", "wrong times", "found times that do not rise"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_simulator_gives_a_record_that_says_what_is_wrong(tmp_path, name):
    program, outcome, message = BAD[name]
    simulator = build(tmp_path, GOOD + program)

    record = simulator.run(THETA)

    assert record.outcome == outcome, record.message
    assert message in record.message
    assert np.isnan(record.temperatures).all()
    assert record.temperatures.shape == (SAMPLES, 2)
    np.testing.assert_array_equal(record.theta, THETA)
    with pytest.raises(SimulationFailure, match=f"executable: {outcome}: "):
        simulator.simulate(THETA)


def test_simulator_that_hangs_is_killed_with_all_that_it_started(tmp_path):
    alive = tmp_path / "alive"
    child = f"import time\nwhile True:\n    open({str(alive)!r}, 'a').write('x'); time.sleep(0.05)"
    program = f"import subprocess, time\nsubprocess.Popen([sys.executable, '-c', {child!r}])\ntime.sleep(600)"
    started = time.perf_counter()

    record = record_of(tmp_path, GOOD + program, timeout="2 s")

    assert record.outcome == "timed out"
    assert "still running after 2 s, killed" in record.message
    assert time.perf_counter() - started < 10
    time.sleep(0.3)
    size = alive.stat().st_size
    assert size > 0
    time.sleep(0.5)
    assert alive.stat().st_size == size


def test_child_that_outlives_its_simulator_is_killed_too(tmp_path):
    alive = tmp_path / "alive"
    child = f"import time\nwhile True:\n    open({str(alive)!r}, 'a').write('x'); time.sleep(0.05)"
    program = (
        f"import subprocess, time\nsubprocess.Popen([sys.executable, '-c', {child!r}])\ntime.sleep(0.5); write(rows)"
    )

    assert record_of(tmp_path, GOOD + program).outcome == "finished"
    time.sleep(0.3)
    size = alive.stat().st_size if alive.exists() else 0
    time.sleep(0.5)
    assert (alive.stat().st_size if alive.exists() else 0) == size


def test_run_is_tried_again_as_often_as_asked(tmp_path):
    tries = tmp_path / "tries"
    program = f"open({str(tries)!r}, 'a').write('x')\nif len(open({str(tries)!r}).read()) < 3: sys.exit(9)\nwrite(rows)"

    record = record_of(tmp_path, GOOD + program, retries=5)

    assert (record.outcome, record.attempts) == ("finished", 3)


def test_what_is_wrong_every_time_is_not_tried_again(tmp_path):
    record = record_of(tmp_path, GOOD + "write([(t, 'nan', 1, 0) for t in times])", retries=5)

    assert (record.outcome, record.attempts) == ("not finite", 1)


def test_program_that_vanishes_after_lint_is_a_record(tmp_path):
    program = tmp_path / "tool.sh"
    program.write_text("#!/bin/sh\nexit 0\n")
    program.chmod(0o755)
    simulator = build(tmp_path, "", executable={"command": ["./tool.sh"]})
    program.unlink()

    record = simulator.run(THETA)

    assert record.outcome == "crashed"
    assert "cannot be started: No such file" in record.message


def test_folder_of_a_failed_run_is_kept_if_asked_and_removed_otherwise(tmp_path):
    kept = record_of(tmp_path, GOOD + "write(rows[:3])", executable={"keep_failed": "failed"})

    (folder,) = (tmp_path / "failed").iterdir()
    assert kept.message.endswith(f"folder of the run: {folder}")
    assert (folder / "input.txt").read_text().startswith("0.8\n5.0\n2024-03-01T00:00:00\n0.0 60.0")
    assert (folder / "output.csv").read_text().count("\n") == 4
    assert (folder / "stderr.txt").exists()


def test_folders_of_runs_leave_nothing_behind(tmp_path, monkeypatch):
    place = tmp_path / "temporary"
    place.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(place))

    assert record_of(tmp_path, GOOD + "write(rows)").outcome == "finished"
    assert record_of(tmp_path, GOOD + "write(rows[:3])").outcome == "partial output"
    assert list(place.iterdir()) == []


def test_run_without_room_for_its_folder_is_a_record(tmp_path, monkeypatch):
    simulator = build(tmp_path, GOOD + "write(rows)")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "nowhere"))

    record = simulator.run(THETA)

    assert record.outcome == "crashed"
    assert record.message.startswith("the folder of the run cannot be used: ")


def test_output_at_other_times_is_interpolated_only_if_asked(tmp_path):
    program = GOOD + "write([(7 * k, 7 * k / 10, 300, int(7 * k > 600)) for k in range(300)])"
    heaters = {"heater": {}}
    assert record_of(tmp_path, program, heaters=heaters).outcome == "wrong times"

    record = record_of(tmp_path, program, heaters=heaters, executable={"interpolate": True})

    assert record.outcome == "finished"
    np.testing.assert_allclose(record.temperatures[:, 0], 273.15 + TIMES / 10)
    np.testing.assert_array_equal(record.status[:, 0], TIMES > 600)


@pytest.mark.parametrize(
    ("times", "outcome"), [("range(0, 900, 7)", "partial output"), ("range(100, 2000, 7)", "wrong times")]
)
def test_interpolation_does_not_reach_beyond_the_output(tmp_path, times, outcome):
    program = GOOD + f"write([(t, 1, 1, 0) for t in {times}])"
    assert record_of(tmp_path, program, executable={"interpolate": True}).outcome == outcome


def test_output_times_may_be_dates(tmp_path):
    dates = "from datetime import datetime, timedelta as d\nt0 = datetime.fromisoformat(start)\n"
    program = GOOD + dates + "write([((t0 + d(seconds=t)).isoformat() + 'Z', *r) for t, *r in rows])"
    time_column = {"column": "time", "format": "iso8601"}

    assert record_of(tmp_path, program, executable={"time": time_column}).outcome == "finished"
    late = program.replace("seconds=t", "seconds=t + 3600")
    assert record_of(tmp_path, late, executable={"time": time_column}).outcome == "wrong times"


def test_template_that_cannot_be_filled_in_is_a_record(tmp_path):
    simulator = build(tmp_path, GOOD + "write(rows)")
    (tmp_path / "input.txt.jinja").write_text("{{ inputs.lnk }}")

    record = simulator.run(THETA)

    assert record.outcome == "crashed"
    assert "template 'input.txt.jinja' of 'input.txt' cannot be filled in" in record.message


@pytest.mark.parametrize(
    "template",
    [
        "{{ ''.__class__.__mro__[1].__subclasses__() }}",
        "{{ inputs.items.__func__.__globals__ }}",
        "{{ range(10 ** 9) | list }}",
        "{{ 1 / 0 }}",
    ],
)
def test_a_template_fills_in_numbers_and_runs_nothing_else(tmp_path, template):
    simulator = build(tmp_path, GOOD + "write(rows)")
    (tmp_path / "input.txt.jinja").write_text(template)

    record = simulator.run(THETA)

    assert record.outcome == "crashed"
    assert "cannot be filled in" in record.message


@pytest.mark.parametrize("key", ["files", "templates", "keep_failed"])
def test_names_that_leave_the_scenarios_folder_are_refused(tmp_path, key):
    (tmp_path / "outside.txt").write_text("secret")
    folder = tmp_path / "inside"
    folder.mkdir()
    (folder / "link.txt").symlink_to("../outside.txt")
    for name in ("../outside.txt", "link.txt", str(tmp_path / "outside.txt")):
        value = {"files": [name], "templates": {"a.txt": name}, "keep_failed": name}[key]
        path = write(folder, written(block(folder, GOOD, executable={key: value})))
        told = [finding for finding in lint(path) if "outside of the scenario's folder" in finding.message]
        assert len(told) == 1
        assert told[0].line is not None


def test_the_folder_in_which_names_stay_is_inside_of_the_scenarios(tmp_path):
    found = [f.message for f in lint(write(tmp_path, written(block(tmp_path, GOOD, executable={"folder": ".."}))))]
    assert "found '..', outside of the scenario's folder, expected a name inside of it" in found


def test_a_copy_that_lies_elsewhere_takes_its_files_from_the_first_scenarios_folder(tmp_path):
    first = tmp_path / "first"
    first.mkdir()
    scenario = load_scenario(write(first, written(block(first, GOOD))))
    copy = tmp_path / "copies" / "scenario.yaml"
    copy.parent.mkdir()
    copy.write_text(resolved_yaml(scenario, absolute=True), encoding="utf-8")
    (warning,) = (finding for finding in lint(copy) if "executable" in finding.location)
    assert (warning.warning, warning.location) == (True, "simulator.executable.folder")
    assert "which is meant for copies of a scenario alone" in warning.message
    assert load_scenario(copy).simulator.executable.files == (str(first / "program.py"),)
    (tmp_path / "outside.txt").write_text("secret")
    copy.write_text(copy.read_text().replace(str(first / "program.py"), str(tmp_path / "outside.txt")))
    assert any("outside of the scenario's folder" in finding.message and not finding.warning for finding in lint(copy))


def test_executable_has_no_gradient_and_says_what_to_use(tmp_path):
    with pytest.raises(ScenarioError, match=r"no gradient .executable.*Calibrate through an emulator"):
        build(tmp_path, GOOD).linearise(THETA)
