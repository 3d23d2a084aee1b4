import importlib.util
import shutil
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from flightcal.errors import ScenarioError
from flightcal.external.build import communication_points
from tests.workers import close_workers

from .scenes import SAMPLES, THETA, TIMES, findings, simulator_of

pytest.importorskip("fmpy", reason="needs the extra 'fmu'")
pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")

EXAMPLE = Path(__file__).parents[2] / "examples" / "fmu"
MODEL = """
#include <math.h>
#include <stdlib.h>
#include "model.h"
enum { LINK, LOAD, SUN, FIRST, BATTERY, RADIATOR, DUTY };
const char *const model_variables =
    "battery.link parameter 0.5\\nload input 4\\nsun input 0\\nfirst parameter 20\\n"
    "battery.temperature output 0\\nradiator output 0\\nduty output 0\\n";
void model_start(double *v) { v[BATTERY] = v[FIRST]; v[RADIATOR] = 5.0; v[DUTY] = 0.0; }
int model_step(double *v, double time, double step) {
    double gain = 1.0 - exp(-v[LINK] * step / 900.0);
    BODY
    v[BATTERY] += ((v[LOAD] + v[SUN]) / v[LINK] - v[BATTERY]) * gain;
    v[DUTY] = time + step > 600.0;
    return 0;
}
"""


@pytest.fixture(autouse=True)
def _no_idle_workers():
    yield
    close_workers()


def builder(folder):
    """`build` of the build.py in a folder."""
    specification = importlib.util.spec_from_file_location("build_fmu", folder / "build.py")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module.build


@pytest.fixture(scope="module")
def compile_fmu():
    return builder(EXAMPLE)


def block(**changes):
    changes = {"drivers": {}, **changes}
    return {
        "fmu": {"file": "model.fmu", "drivers": changes.pop("drivers"), **changes.pop("fmu", {})},
        "inputs": {
            "link": {"value": "0.5 W/K", "name": "battery.link"},
            "load": "4 W",
            "first": {"value": "293.15 K", "unit": "degC"},
        },
        "outputs": {"battery": {"name": "battery.temperature", "unit": "degC"}, "radiator": {}},
        **changes,
    }


def build(folder, compile_fmu, body="", fmi=3, **changes):
    (folder / "model.c").write_text(MODEL.replace("BODY", body))
    compile_fmu(folder / "model.c", folder / "model.fmu", fmi)
    return simulator_of(folder, block(**changes))


def exact(link, power, first=20.0):
    """Of 900 J/K: 900 dT/dt = power - link T, in degC."""
    return 273.15 + power / link + (first - power / link) * np.exp(-link * TIMES / 900)


@pytest.mark.parametrize("fmi", [2, 3])
def test_fmu_follows_the_exact_solution_of_its_equation(tmp_path, compile_fmu, fmi):
    record = build(tmp_path, compile_fmu, fmi=fmi).run(THETA)

    assert (record.outcome, record.message) == ("finished", "")
    np.testing.assert_allclose(record.temperatures[:, 0], exact(0.8, 5.0), atol=1e-9)
    np.testing.assert_allclose(record.temperatures[:, 1], 5.0)


@pytest.mark.parametrize("fmi", [2, 3])
def test_measured_driver_is_held_from_one_communication_point_to_the_next(tmp_path, compile_fmu, fmi):
    # The telemetry's driver is 10 W + 1 mW/s.
    record = build(tmp_path, compile_fmu, fmi=fmi, drivers={"sun": "sun"}, fmu={"step": "10 s"}).run(THETA)

    temperature, expected = 20.0, [20.0]
    for step in range(180):
        power = 5.0 + 10.0 + 1e-3 * 10.0 * step
        temperature += (power / 0.8 - temperature) * (1 - np.exp(-0.8 * 10 / 900))
        expected.append(temperature)
    np.testing.assert_allclose(record.temperatures[:, 0] - 273.15, expected[::6], atol=1e-9)


def test_heater_status_is_a_variable(tmp_path, compile_fmu):
    run = build(tmp_path, compile_fmu, heaters={"warmer": {"name": "duty", "power": "20 W"}}).simulate(THETA)

    np.testing.assert_array_equal(run.status[:, 0], TIMES > 600)
    np.testing.assert_allclose(run.duty_cycle, [1230 / 1860])


def test_runs_are_independent_of_each_other(tmp_path, compile_fmu):
    thetas = np.array([[0.2 + 0.1 * k, 3.0] for k in range(7)])
    runs = build(tmp_path, compile_fmu).simulate_many(thetas)

    for run, (link, power) in zip(runs, thetas, strict=True):
        np.testing.assert_allclose(run.temperatures[:, 0], exact(link, power), atol=1e-9)


@pytest.mark.parametrize(
    ("fmi", "body", "outcome", "message"),
    [
        (3, "if (time > 100) abort();", "crashed", "killed by signal 6 (SIGABRT)"),
        (3, "if (time > 100) *(volatile int *)0 = 1;", "crashed", "killed by signal 11 (SIGSEGV)"),
        (2, "if (time > 100) exit(3);", "crashed", "exit code 3"),
        (3, "if (time > 100) return 3;", "crashed", "at 120 s: fmi3DoStep failed with status 3 (error)"),
        (2, "if (time > 100) return 2;", "partial output", "at 120 s: fmi2DoStep failed with status 2 (discard)"),
        (3, "if (time > 100) return 1;", "partial output", "the FMU ends the simulation at 180 s of 1800 s"),
        (3, "if (time > 100) v[RADIATOR] = NAN;", "not finite", "nan in 'radiator' at sample 4 of 31, 28 such in all"),
    ],
)
def test_bad_fmu_gives_a_record_that_says_what_is_wrong(tmp_path, compile_fmu, fmi, body, outcome, message):
    record = build(tmp_path, compile_fmu, body, fmi).run(THETA)

    assert record.outcome == outcome, record.message
    assert message in record.message
    assert np.isnan(record.temperatures).all()
    assert record.temperatures.shape == (SAMPLES, 2)


def test_fmu_that_stops_before_the_communication_point_is_a_record(tmp_path):
    copy = shutil.copytree(EXAMPLE, tmp_path / "copy")
    wrapper = (copy / "fmi3.c").read_text()
    (copy / "fmi3.c").write_text(wrapper.replace("*reached = time + step;", "*reached = time + step / 2;"))

    record = build(tmp_path, builder(copy)).run(THETA)

    assert (record.outcome, record.message) == ("wrong times", "found the FMU at 30 s after a step to 60 s")


def test_fmu_that_hangs_is_killed_and_the_next_run_is_as_good_as_new(tmp_path, compile_fmu):
    simulator = build(tmp_path, compile_fmu, "while (v[LINK] > 1.0 && time > 100) {}", timeout="1 s")
    started = time.perf_counter()

    records = [simulator.run(np.array([link, 5.0])) for link in (0.8, 1.5, 0.8)]

    assert [record.outcome for record in records] == ["finished", "timed out", "finished"]
    assert time.perf_counter() - started < 30


def test_fmu_of_another_platform_is_a_record(tmp_path, compile_fmu):
    simulator = build(tmp_path, compile_fmu)
    with zipfile.ZipFile(tmp_path / "model.fmu") as archive:
        description = archive.read("modelDescription.xml")
    with zipfile.ZipFile(tmp_path / "model.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", description)

    record = simulator.run(THETA)

    assert record.outcome == "crashed"
    assert "cannot be instantiated" in record.message


def test_fmu_has_no_gradient_and_says_what_to_use(tmp_path, compile_fmu):
    with pytest.raises(ScenarioError, match=r"no gradient .fmu.*Calibrate through an emulator"):
        build(tmp_path, compile_fmu).linearise(THETA)


@pytest.mark.parametrize("fmi", [2, 3])
def test_lint_reads_the_description_without_loading_the_library(tmp_path, compile_fmu, fmi):
    build(tmp_path, compile_fmu, "", fmi)
    wrong = {
        "inputs": {"link": {"value": "0.5 W/K", "name": "batery.link"}, "load": {"value": "4 W", "name": "duty"}},
        "drivers": {"first": "sun", "load": "battery_temp"},
    }

    assert findings(tmp_path, block(drivers={"sun": "sun"})) == []
    found = findings(tmp_path, block(**wrong))

    assert len(found) == 4
    assert any("unknown real variable of the FMU 'batery.link'" in finding for finding in found)
    assert any("found the variable 'duty', an output of the FMU" in finding for finding in found)
    assert any("found the variable 'first', a parameter of the FMU, expected an input" in finding for finding in found)
    assert any("found 'battery_temp', a temperature channel, expected a driver channel" in f for f in found)


def test_communication_points_hold_all_sample_times_and_are_close_enough():
    grid, samples = communication_points(np.array([30.0, 90.0, 100.0]), 25.0)

    assert grid.tolist() == [0.0, 15.0, 30.0, 50.0, 70.0, 90.0, 100.0]
    assert grid[samples].tolist() == [30.0, 90.0, 100.0]
    assert communication_points(np.array([0.0, 60.0]), None)[0].tolist() == [0.0, 60.0]
