import os
import textwrap
import time

import numpy as np
import pytest

from flightcal.errors import ScenarioError
from flightcal.external import in_worker
from flightcal.prediction import predict
from flightcal.problem import build_problem
from flightcal.scenario import load_scenario
from flightcal.telemetry import read
from tests.workers import close_workers

from .scenes import SAMPLES, THETA, TIMES, findings, simulator_of, write, written

GOOD = """
import numpy as np

def simulate(inputs, times, start):
    battery = 300 + inputs["load"] / inputs["link"] * (1 - np.exp(-inputs["link"] * times / 900))
    return np.stack([battery, battery - 20], axis=1)
"""
JAX = """
import jax.numpy as jnp

def simulate(inputs, times, start):
    battery = 300 + inputs["load"] / inputs["link"] * (1 - jnp.exp(-inputs["link"] * times / 900))
    return jnp.stack([battery, battery**2 / 300], axis=1), jnp.ones((len(times), 1))
"""


@pytest.fixture(autouse=True)
def _no_idle_workers():
    yield
    close_workers()


def expected(theta):
    link, load = theta
    return 300 + load / link * (1 - np.exp(-link * TIMES / 900))


def build(folder, program, gradient="none", **changes):
    (folder / "model.py").write_text(textwrap.dedent(program))
    return simulator_of(folder, {"callable": {"file": "model.py", "gradient": gradient}, **changes})


def test_function_gives_temperatures(tmp_path):
    record = build(tmp_path, GOOD).run(THETA)

    assert (record.outcome, record.message) == ("finished", "")
    np.testing.assert_allclose(record.temperatures[:, 0], expected(THETA), rtol=1e-12)
    assert record.status.shape == (SAMPLES, 0)


def test_function_gets_the_start_and_may_use_modules_beside_it(tmp_path):
    (tmp_path / "constants.py").write_text("BASE = 290.0")
    program = """
    import numpy as np
    from constants import BASE
    def simulate(inputs, times, start):
        assert start.isoformat() == "2024-03-01T00:00:00"
        print("noise on standard output does no harm")
        return np.full((len(times), 2), BASE), (times > 900).astype(float)[:, None]
    """
    run = build(tmp_path, program, heaters={"warmer": None}).simulate(THETA)

    np.testing.assert_array_equal(run.temperatures, 290.0)
    np.testing.assert_array_equal(run.status[:, 0], TIMES > 900)


def test_parallel_runs_keep_their_order(tmp_path):
    thetas = np.array([[0.2 + 0.1 * k, 3.0] for k in range(9)])
    runs = build(tmp_path, GOOD).simulate_many(thetas)

    for run, theta in zip(runs, thetas, strict=True):
        np.testing.assert_allclose(run.temperatures[:, 0], expected(theta), rtol=1e-12)


BAD = {
    "raises": ("raise ValueError('no convergence')", "crashed", "ValueError: no convergence (model.py, line 3)"),
    "exits": ("import os; os._exit(7)", "crashed", "exit code 7"),
    "segmentation fault": ("import ctypes; ctypes.string_at(0)", "crashed", "killed by signal 11 (SIGSEGV)"),
    "nothing": ("return None", "wrong shape", "found a single number, expected 31 x 2"),
    "words": ("return 'hot'", "wrong shape", "found str, expected an array of 31 x 2"),
    "transposed": ("return np.zeros((2, len(times)))", "wrong shape", "found 2 x 31, expected 31 x 2"),
    "other times": ("return np.zeros((30, 2))", "wrong shape", "found 30 x 2, expected 31 x 2: 31 sample times by 2"),
    "too much": ("return 1, 2, 3", "wrong shape", "found 3 results"),
    "not a number": ("return times[:, None] * [1, np.nan]", "not finite", "nan in 'radiator' at sample 1 of 31, 31"),
    "no import": ("import nothing_of_this_name", "crashed", "ModuleNotFoundError: No module named 'nothing_of_th"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_function_gives_a_record_that_says_what_is_wrong(tmp_path, name):
    body, outcome, message = BAD[name]
    record = build(tmp_path, f"import numpy as np\ndef simulate(inputs, times, start):\n    {body}").run(THETA)

    assert record.outcome == outcome, record.message
    assert message in record.message
    assert np.isnan(record.temperatures).all()


def test_function_that_hangs_is_killed_and_the_next_run_is_as_good_as_new(tmp_path):
    hang = "    while inputs['link'] > 1: pass\n    battery"
    simulator = build(tmp_path, GOOD.replace("    battery", hang, 1), timeout="1 s")
    started = time.perf_counter()

    records = [simulator.run(np.array([link, 5.0])) for link in (0.5, 1.5, 0.5)]

    assert [record.outcome for record in records] == ["finished", "timed out", "finished"]
    assert records[1].message == "still running after 1 s, killed"
    assert time.perf_counter() - started < 30


def test_what_a_model_prints_does_not_pile_up(tmp_path):
    simulator = build(tmp_path, GOOD.replace("    battery", "    print('x' * 1000, flush=True)\n    battery", 1))
    for _ in range(3):
        assert simulator.run(THETA).outcome == "finished"
    (worker,) = in_worker._IDLE
    assert os.fstat(worker.said.fileno()).st_size == 1001


def test_file_that_is_edited_is_read_again_by_the_next_simulator(tmp_path):
    before = build(tmp_path, GOOD).run(THETA).temperatures
    after = build(tmp_path, GOOD.replace("300 +", "301 +")).run(THETA).temperatures

    np.testing.assert_allclose(after, before + 1.0)


def test_no_bytecode_is_left_beside_the_file(tmp_path, monkeypatch):
    monkeypatch.delenv("PYTHONDONTWRITEBYTECODE", raising=False)
    assert build(tmp_path, GOOD).run(THETA).outcome == "finished"
    assert not list(tmp_path.rglob("*.pyc"))


def test_file_that_cannot_be_imported_is_a_record(tmp_path):
    record = build(tmp_path, "raise RuntimeError('no licence')\ndef simulate(a, b, c): pass").run(THETA)

    assert record.outcome == "crashed"
    assert record.message == "RuntimeError: no licence (model.py, line 1)"


def test_status_that_the_scenario_expects_must_be_given(tmp_path):
    record = build(tmp_path, GOOD, heaters={"warmer": {}}).run(THETA)

    assert record.outcome == "wrong shape"
    assert "expected the status of warmer" in record.message


def test_gradient_of_a_jax_function_agrees_with_finite_differences(tmp_path):
    simulator = build(
        tmp_path,
        JAX,
        gradient="jax",
        heaters={"warmer": {}},
        inputs={"link": "0.5 W/K", "load": {"value": "4 W", "unit": "mW"}},
    )
    (tmp_path / "model.py").write_text(JAX.replace('inputs["load"]', '(inputs["load"] / 1000)'))
    weights = np.random.default_rng(1).standard_normal((SAMPLES, 2))

    trajectory, cotangent = simulator.linearise(THETA)
    gradient = cotangent(weights)

    np.testing.assert_allclose(trajectory.temperatures[:, 0], expected(THETA), rtol=1e-9)
    for k in range(len(THETA)):
        step = 1e-5 * THETA[k] * np.eye(len(THETA))[k]
        above, below = (simulator.simulate(THETA + sign * step).temperatures for sign in (1, -1))
        difference = ((above - below) * weights).sum() / (2 * step[k])
        np.testing.assert_allclose(gradient[k], difference, rtol=1e-6)


def test_gradient_holds_for_scaled_inputs_several_channels_of_one_output_and_biases(tmp_path):
    changes = {
        "parameters": {
            "link": {"scales": "inputs.link", "prior": {"uniform": [0.5, 2]}},
            "size": {"scales": ["inputs.link", "inputs.load"], "prior": {"uniform": [0.5, 2]}},
            "more": {"scales": "inputs.load", "prior": {"uniform": [0.5, 2]}},
            "load": {"sets": "observations.spare_temp.bias", "prior": {"uniform": ["-1 K", "1 K"]}},
        },
        "observations": {"spare_temp": {"output": "battery", "bias": "0.1 K"}},
        "telemetry": {
            "file": "telemetry.csv",
            "time": {"column": "time"},
            "channels": {
                "battery_temp": {"column": "battery", "unit": "degC", "kind": "temperature"},
                "radiator_temp": {"column": "radiator", "unit": "degC", "kind": "temperature"},
                "spare_temp": {"column": "battery", "unit": "degC", "kind": "temperature"},
            },
        },
    }
    (tmp_path / "model.py").write_text(JAX)
    block = {"callable": {"file": "model.py", "gradient": "jax"}, "heaters": {"warmer": {}}}
    simulator = simulator_of(tmp_path, block, **changes)
    names = list(simulator.parameters)
    theta = np.array([{"link": 0.8, "load": 0.3, "size": 1.2, "more": 0.7}[name] for name in names])
    weights = np.random.default_rng(1).standard_normal((SAMPLES, 3))

    trajectory, cotangent = simulator.linearise(theta)

    battery = expected((0.5 * 0.8 * 1.2, 4.0 * 1.2 * 0.7))
    np.testing.assert_allclose(trajectory.temperatures[:, 0], battery, rtol=1e-9)
    np.testing.assert_allclose(trajectory.temperatures[:, 2], battery + 0.3, rtol=1e-9)
    gradient = cotangent(weights)
    for k in range(len(theta)):
        step = 1e-5 * np.eye(len(theta))[k]
        above, below = (simulator.simulate(theta + sign * step).temperatures for sign in (1, -1))
        np.testing.assert_allclose(gradient[k], ((above - below) * weights).sum() / 2e-5, rtol=1e-5)


def test_log_density_of_a_problem_uses_the_gradient(tmp_path):
    (tmp_path / "model.py").write_text(JAX.replace("300 +", "293 +").replace("battery**2 / 300", "battery - 15"))
    block = {"callable": {"file": "model.py", "gradient": "jax"}, "heaters": {"warmer": {}}}
    scenario = load_scenario(write(tmp_path, written(block)))
    problem = build_problem(scenario, read(scenario))
    z = problem.to_z(np.array([0.9, 2.0]))

    value, gradient = problem.log_density_and_gradient(z)

    assert problem.names == ("link", "load")
    assert problem.open_loop is None
    assert value == pytest.approx(problem.log_density(z))
    for k in range(len(z)):
        step = 1e-5 * np.eye(len(z))[k]
        difference = (problem.log_density(z + step) - problem.log_density(z - step)) / 2e-5
        np.testing.assert_allclose(gradient[k], difference, rtol=1e-5)


def test_function_in_numpy_has_no_gradient_and_says_what_to_use(tmp_path):
    with pytest.raises(ScenarioError, match=r"no gradient .callable.*Calibrate through an emulator"):
        build(tmp_path, GOOD).linearise(THETA)


def test_initial_temperature_among_the_inputs_is_estimated_around_the_first_samples(tmp_path):
    program = GOOD.replace("300 +", 'inputs["first"] +')
    (tmp_path / "model.py").write_text(program)
    inputs = {"link": "0.5 W/K", "load": "4 W", "first": {"value": "10 degC", "initial_of": "battery"}}
    scenario = load_scenario(write(tmp_path, written({"callable": {"file": "model.py"}, "inputs": inputs})))

    problem = build_problem(scenario, read(scenario))

    assert problem.names == ("link", "load", "initial.battery")
    prior = problem.priors.priors[2]
    assert (prior.mean, prior.standard_deviation) == (pytest.approx(293.15), 2.0)
    (run,) = problem.simulate(np.array([0.8, 5.0, 281.0]))
    np.testing.assert_allclose(run.temperatures[:, 0], expected(THETA) - 19.0, rtol=1e-12)


def test_temperatures_and_duty_of_a_functions_test_window_are_predicted(tmp_path):
    program = GOOD.replace("axis=1)", "axis=1), (times % 600 < 240)[:, None]")
    (tmp_path / "model.py").write_text(program)
    block = {"callable": {"file": "model.py"}, "heaters": {"warmer": {}}}
    test = {"test": {"start": "2024-03-01T00:40:00", "end": "2024-03-01T01:20:00"}}
    scenario = load_scenario(write(tmp_path, written(block, windows=test)))

    draws = np.tile(THETA, (4, 1))
    result = predict(build_problem(scenario, read(scenario)), read(scenario), "test", {"point": THETA}, draws, seed=1)[
        0
    ]

    inside = np.arange(40) * 60.0
    battery = 300 + THETA[1] / THETA[0] * (1 - np.exp(-THETA[0] * inside / 900))
    np.testing.assert_allclose(result["mean"].sel({"by": "point", "channel": "battery_temp"}), battery)
    # On for four of ten samples, of which the window's first stands for half a minute.
    np.testing.assert_allclose(result["duty_cycle"], np.full((4, 1), (16 - 0.5) / 40))
    assert result.attrs["duty_cycle_contains"] == "parameters, initial temperatures"


@pytest.mark.parametrize(("gradient", "refused"), [("none", 1), ("jax", 0)])
def test_students_noise_is_refused_where_an_emulator_takes_the_functions_place(tmp_path, gradient, refused):
    (tmp_path / "model.py").write_text(textwrap.dedent(JAX))
    noise = {"observations": {"battery_temp": {"output": "battery", "noise": {"distribution": "student_t"}}}}

    found = findings(tmp_path, {"callable": {"file": "model.py", "gradient": gradient}}, **noise)

    assert len(found) == refused
    assert all("beside the error of an emulator" in finding for finding in found)
