import pickle

import numpy as np
import pytest
import xarray
from typer.testing import CliRunner

from flightcal.cli import app
from flightcal.commands.calibrate import run_experiment
from flightcal.errors import ScenarioError
from flightcal.external import ExternalSimulator
from flightcal.prediction.predict import STOCHASTIC
from flightcal.report import write_report
from flightcal.scenario import load_scenario
from flightcal.simulator import NetworkSimulator, build_network
from tests.workers import close_workers

from ..small import load
from ..small import simulator_of as network_of
from .scenes import SAMPLES, THETA, TIMES, simulator_of, write, written

MODEL = """
import numpy as np
with open(TRACE, "a") as file:
    file.write("x")
def simulate(inputs, times, start):
    if inputs["link"] > 1.5:
        raise ValueError("too much")
    battery = inputs["first"] + inputs["load"] / inputs["link"] * (1 - np.exp(-inputs["link"] * times / 900))
    return np.stack([battery, battery - 15], axis=1), (times[:, None] > 600) * 1.0
"""


@pytest.fixture(autouse=True)
def _no_idle_workers():
    yield
    close_workers()


@pytest.fixture
def trace(tmp_path):
    """A file that the model writes to when it is imported."""
    file = tmp_path / "trace"
    (tmp_path / "model.py").write_text(f"TRACE = {str(file)!r}\n{MODEL}")
    return file


def block():
    return {
        "callable": {"file": "model.py"},
        "inputs": {"link": "0.5 W/K", "load": "4 W", "first": "20 degC"},
        "heaters": {"warmer": {"power": "load"}},
    }


STATUS = {"heater_status": {"heater": "warmer"}}


def test_simulator_can_be_sent_to_another_process(tmp_path, trace):
    simulator = simulator_of(tmp_path, block())

    there = pickle.loads(pickle.dumps(simulator))

    assert isinstance(there, ExternalSimulator)
    np.testing.assert_array_equal(there.run(THETA).temperatures, simulator.run(THETA).temperatures)


def test_one_worker_serves_many_runs(tmp_path, trace):
    simulator = simulator_of(tmp_path, block())
    for _ in range(3):
        assert simulator.run(THETA).outcome == "finished"

    assert trace.read_text() == "x"


def test_failures_are_none_among_many_and_records_among_records(tmp_path, trace):
    simulator = simulator_of(tmp_path, block())
    thetas = np.array([[0.5, 4.0], [1.8, 4.0], [0.7, 4.0]])

    records = simulator.run_many(thetas)

    assert [record.outcome for record in records] == ["finished", "crashed", "finished"]
    assert [run is None for run in simulator.simulate_many(thetas)] == [False, True, False]
    np.testing.assert_array_equal([record.theta for record in records], thetas)
    assert simulator.run_many(np.empty((0, 2))) == []


def test_nothing_runs_before_the_first_simulation(tmp_path, trace):
    path = write(tmp_path, written(block(), observations=STATUS))
    runner = CliRunner()

    linted = runner.invoke(app, ["lint", str(path)])
    assert linted.exit_code == 0, linted.output
    assert "window train: 31 samples of 2 channels" in linted.output
    assert not trace.exists()

    simulated = runner.invoke(app, ["simulate", str(path), "--set", "link=0.8", "--out", str(tmp_path / "out.csv")])
    assert simulated.exit_code == 0, simulated.output
    assert "warmer: duty cycle" in simulated.output
    assert trace.exists()


def test_failed_simulation_is_a_message(tmp_path, trace):
    path = write(tmp_path, written(block()))
    result = CliRunner().invoke(app, ["simulate", str(path), "--set", "link=1.8"])

    assert result.exit_code == 1
    message = "the simulation of window 'train' fails: callable: crashed: ValueError: too much (model.py, line 8)"
    assert message in result.output


def test_a_derivative_of_what_has_none_is_a_message(tmp_path, trace):
    with pytest.raises(ScenarioError, match="Calibrate through an emulator"):
        simulator_of(tmp_path, block()).linearise(THETA)


def test_network_is_built_as_ever(tmp_path):
    scenario, data = load(tmp_path)

    assert isinstance(network_of(scenario, data), NetworkSimulator)


def test_what_needs_a_network_says_so(tmp_path, trace):
    scenario = load_scenario(write(tmp_path, written(block())))

    with pytest.raises(ScenarioError, match=r"found an external simulator \(callable\), expected a thermal network"):
        build_network(scenario)


@pytest.mark.slow
def test_experiment_with_a_function_in_jax_finds_the_truth_and_its_report_needs_no_simulator(tmp_path, trace):
    text = (tmp_path / "model.py").read_text().replace("np.", "jnp.")
    text = text.replace("import numpy as np", "import jax.numpy as jnp")
    text = text.replace('    if inputs["link"] > 1.5:\n        raise ValueError("too much")\n', "")
    (tmp_path / "model.py").write_text(text)
    simulator = {
        **block(),
        "callable": {"file": "model.py", "gradient": "jax"},
        "inputs": {"link": "0.5 W/K", "load": "4 W", "first": {"value": "20 degC", "initial_of": "battery"}},
    }
    content = written(
        simulator,
        observations=STATUS,
        windows={"test": {"start": "2024-03-01T01:00:00", "end": "2024-03-01T01:31:00"}},
        calibration={
            "genetic": {"runs": 2, "population": 16, "generations": 8},
            "nuts": {"chains": 2, "draws": 200, "warmup": 200, "max_r_hat": 1.1, "min_ess": 50},
            "prediction": {"simulations": 40, "initial_span": "5 min"},
        },
    )
    path = write(tmp_path, content)
    rng = np.random.default_rng(0)
    battery = np.full(121, 20.0)
    for start in (0, 60):
        battery[start : start + SAMPLES] = 20.0 + 5.0 / 0.8 * (1 - np.exp(-0.8 * TIMES / 900))
    rows = (tmp_path / "telemetry.csv").read_text().splitlines()
    for k, row in enumerate(rows[1:]):
        time, _, _, heater, sun = row.split(",")
        measured = battery[k] + 0.1 * rng.standard_normal(2) - [0.0, 15.0]
        rows[k + 1] = ",".join([time, *(f"{value:.3f}" for value in measured), heater, sun])
    (tmp_path / "telemetry.csv").write_text("\n".join(rows) + "\n")

    summary = run_experiment(path, tmp_path / "run")
    (tmp_path / "model.py").unlink()
    close_workers()
    page = write_report(tmp_path / "run", tmp_path / "report.html")

    assert summary.passed
    assert page.stat().st_size > 10_000
    posterior = xarray.open_datatree(tmp_path / "run" / "posterior.nc", engine="h5netcdf")["posterior"]
    for name, truth in {"link": 0.8, "load": 5.0}.items():
        draws = posterior[name].values
        assert abs(draws.mean() - truth) < 4 * draws.std()
    found = {(m.method, m.window): m.value for m in summary.metrics if m.metric == "rmse" and m.channel == "all"}
    assert found[STOCHASTIC, "test"] == pytest.approx(0.1, rel=0.25)
