import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray
from typer.testing import CliRunner

from flightcal.campaign import open_campaign
from flightcal.cli import INTERRUPTED, USER_ERROR, app
from flightcal.commands.campaign import make_design, run_scenario_campaign, subject_of
from flightcal.errors import RunError
from flightcal.probability import Priors
from flightcal.problem import build_problem
from flightcal.scenario import load_scenario
from flightcal.telemetry import read
from tests.commands.test_calibrate import write
from tests.told import Told

run = CliRunner().invoke


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    return write(tmp_path_factory.mktemp("small"))


@pytest.fixture(scope="module")
def problem(scenario):
    loaded = load_scenario(scenario)
    return build_problem(loaded, read(loaded))


@pytest.fixture(scope="module")
def finished(scenario, tmp_path_factory):
    out = tmp_path_factory.mktemp("campaign") / "c"
    return out, run(app, ["campaign", str(scenario), "--runs", "50", "--out", str(out)])


def test_a_campaign_says_what_it_did_and_leaves_one_dataset(finished, problem):
    out, result = finished
    assert result.exit_code == 0, result.output
    assert "design: sobol, 50 runs of 5 parameters, seed 3" in result.output
    assert "found: 0 of 50 runs done; 50 left" in result.output
    assert "campaign: 50 of 50 runs done: 50 finished; 0 left" in result.output
    data = open_campaign(out)
    assert data["parameter"].values.tolist() == list(problem.windows[0].simulator.parameters)
    assert data["channel"].values.tolist() == ["body_temp", "panel_temp"]
    np.testing.assert_array_equal(data["time"], problem.windows[0].times)
    for k in (0, 49):
        expected = problem.windows[0].simulator.simulate(data["theta"].values[k])
        np.testing.assert_allclose(data["temperatures"].values[k], expected.temperatures, rtol=0, atol=1e-9)
        np.testing.assert_array_equal(data["status"].values[k], expected.status)
    assert (out / "scenario.yaml").read_text().startswith("name: small")


def test_the_same_command_runs_nothing_again(finished, scenario):
    out, _ = finished
    before = {
        file: file.stat().st_mtime_ns for file in out.rglob("*") if file.is_file() and file.name != "campaign.lock"
    }
    result = run(app, ["campaign", str(scenario), "--runs", "50", "--out", str(out)])
    assert result.exit_code == 0
    assert "found: 50 of 50 runs done: 50 finished; 0 left" in result.output
    assert before == {file: file.stat().st_mtime_ns for file in before}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--seed", "4"], "another seed (found 3, expected 4)"),
        (["--design", "prior"], "another kind (found sobol, expected prior)"),
        (["--window", "test"], "what differs: window test"),
        (["--window", "tset"], "window 'tset' is not in the scenario"),
        (["--design", "sobl"], "--design sobl: expected sobol, latin-hypercube, prior, posterior"),
        (["--design", "posterior"], "--design posterior needs --around"),
        (["--design", "prior", "--around", "x"], "--design prior does not go with --around"),
        (["--around", "nowhere"], "nowhere: found no posterior.nc"),
    ],
)
def test_mistakes_are_messages(finished, scenario, options, message):
    out, _ = finished
    result = run(app, ["campaign", str(scenario), "--runs", "50", "--out", str(out), *options])
    assert result.exit_code == USER_ERROR
    assert message in result.output


def test_a_scenario_that_changed_since_is_refused_and_its_prior_is_part_of_the_design(finished, tmp_path):
    out, _ = finished
    changed = write(tmp_path)
    text = changed.read_text()
    for old, new, message in (
        ("capacity: 3000 J/K", "capacity: 3001 J/K", "what differs: simulator"),
        ("factor: 1.3", "factor: 1.4", "another priors"),
    ):
        assert old in text
        changed.write_text(text.replace(old, new))
        result = run(app, ["campaign", str(changed), "--runs", "50", "--out", str(out)])
        assert result.exit_code == USER_ERROR
        assert message in result.output


def test_telemetry_that_changed_since_is_refused(finished, tmp_path):
    out, _ = finished
    changed = write(tmp_path)
    lines = (tmp_path / "telemetry.csv").read_text().splitlines()
    (tmp_path / "telemetry.csv").write_text("\n".join(lines[:-1]) + "\n")
    result = run(app, ["campaign", str(changed), "--runs", "50", "--out", str(out)])
    assert result.exit_code == USER_ERROR
    assert "what differs: telemetry.csv" in result.output


def test_a_scheduler_that_is_not_there_is_a_message(scenario, tmp_path, monkeypatch):
    monkeypatch.setattr("flightcal.campaign.cluster._CONNECTING", 0.5)
    for address in ("tcp://127.0.0.1:9", "nonsense", "127.0.0.1", "tcp://no.such.host.invalid:8786"):
        arguments = ["campaign", str(scenario), "--runs", "5", "--out", str(tmp_path / "c"), "--scheduler", address]
        result = run(app, arguments)
        assert result.exit_code == USER_ERROR, result.output
        assert f"--scheduler {address}: found no Dask scheduler there" in result.output


def test_ctrl_c_says_what_is_left(scenario, tmp_path, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("flightcal.campaign.run.Here.run_missing", interrupt)
    result = run(app, ["campaign", str(scenario), "--runs", "5", "--workers", "1", "--out", str(tmp_path / "c")])
    assert result.exit_code == INTERRUPTED
    assert "stopped: 0 of 5 runs done; 5 left" in result.output
    assert "takes up where this one stopped" in result.output


def test_a_campaign_of_which_no_run_finishes_is_an_error_that_says_why(tmp_path):
    scenario = write(tmp_path)
    text = scenario.read_text()
    # The heater's thresholds are so close to each other, and its power so large, that it chatters.
    assert "13 degC" in text
    scenario.write_text(text.replace("13 degC", "10.0000001 degC").replace("30 W", "40 kW").replace("45 W", "50 kW"))
    options = ["--runs", "3", "--workers", "1", "--out", str(tmp_path / "c")]
    result = run(app, ["campaign", str(scenario), *options])
    assert result.exit_code == USER_ERROR
    assert "none of the 3 runs finished; run 0: not finite: " in result.output
    assert open_campaign(tmp_path / "c")["outcome"].values.tolist() == ["not finite"] * 3


def test_a_campaign_of_an_executable_keeps_its_failures_as_records(tmp_path):
    shutil.copytree(Path(__file__).parents[2] / "examples" / "executable", tmp_path / "e")
    scenario, program = tmp_path / "e" / "scenario.yaml", tmp_path / "e" / "simulator.py"
    # It counts its runs, and refuses an absorptivity above the prior's median.
    log = tmp_path / "log"
    program.write_text(
        f"open({str(log)!r}, 'a').write('run\\n')\n"
        "import json, sys\n"
        "if json.load(open(sys.argv[1]))['parameters']['absorptivity'] > 0.28: sys.exit('too absorptive')\n"
        + program.read_text()
    )
    scenario.write_text(scenario.read_text().replace("retries: 1", "retries: 0"))
    options = ["campaign", str(scenario), "--runs", "8", "--out", str(tmp_path / "c")]
    result = run(app, options)
    assert result.exit_code == 0, result.output
    assert "8 of 8 runs done: 4 finished, 4 crashed; 0 left" in result.output
    data = open_campaign(tmp_path / "c")
    failed = data["theta"].sel(parameter="absorptivity").values > 0.28
    assert (data["outcome"].values == np.where(failed, "crashed", "finished")).all()
    assert all("too absorptive" in message for message in data["message"].values[failed])
    assert np.isfinite(data["temperatures"].values[~failed]).all()
    assert run(app, options).exit_code == 0
    assert len(log.read_text().split()) == 8
    # Nor does a longer time-out make it another simulator: the failed runs, and no others, are run again.
    scenario.write_text(scenario.read_text().replace("timeout: 20 s", "timeout: 30 s"))
    assert "4 finished, 4 crashed" in run(app, [*options, "--retry-failed"]).output
    assert len(log.read_text().split()) == 12


def posterior_of(problem, folder, draws=60):
    """A run's folder with a posterior near the truth."""
    theta = problem.priors.to_theta(0.1 * np.random.default_rng(1).standard_normal((2, draws, len(problem.names))))
    group = xarray.Dataset({name: (("chain", "draw"), theta[..., k]) for k, name in enumerate(problem.names)})
    folder.mkdir()
    xarray.DataTree.from_dict({"posterior": group}).to_netcdf(folder / "posterior.nc", engine="h5netcdf")
    return theta.reshape(-1, theta.shape[-1])


def test_a_design_around_a_run_is_made_of_its_posterior_draws(problem, tmp_path):
    draws = posterior_of(problem, tmp_path / "run")
    design = make_design(problem, 100, 1, around=tmp_path / "run")
    simulated = {tuple(row) for row in draws[:, problem.simulated]}
    assert {tuple(row) for row in design.theta} < simulated
    assert set(design.origin) == {"priors", "posterior", "spread"}
    json.dumps(dict(design.origin))


def test_on_another_window_initial_temperatures_are_that_windows(scenario, tmp_path):
    loaded = load_scenario(scenario)
    data = read(loaded)
    draws = posterior_of(build_problem(loaded, data), tmp_path / "run")
    test = build_problem(loaded, data, "test")
    design = make_design(test, 100, 1, around=tmp_path / "run")
    initial = test.windows[0].simulator.parameters.index("initial.body")
    assert not set(design.theta[:, initial]) & set(draws.ravel())
    prior = test.priors.priors[test.names.index("initial.body")]
    assert abs(design.theta[:, initial].mean() - prior.mean) < 5 * prior.standard_deviation / 10
    assert set(design.theta[:, 0]) <= set(draws.ravel())


def test_a_damaged_posterior_is_a_message(problem, tmp_path):
    (tmp_path / "posterior.nc").write_text("not netCDF")
    with pytest.raises(RunError, match=r"posterior\.nc: found a damaged posterior"):
        make_design(problem, 10, 1, around=tmp_path)


def test_a_campaigns_theta_is_what_the_simulator_takes(problem):
    design = make_design(problem, 8, 1, kind="latin-hypercube")
    subject = subject_of(problem)
    assert design.theta.shape == (8, len(subject.parameters))
    chosen = [problem.names.index(name) for name in subject.parameters]
    priors = Priors(subject.parameters, tuple(problem.priors.priors[k] for k in chosen))
    assert np.all((design.theta > priors.quantile(1e-9)) & (design.theta < priors.quantile(1.0 - 1e-9)))


def test_a_scenarios_campaign_can_be_run_from_python(scenario, finished):
    out, _ = finished
    told = Told()
    assert run_scenario_campaign(scenario, out, 20, progress=told).outcomes == {"finished": 20}
    assert told.said[-1] == "campaign: 20 of 20 runs done: 20 finished; 0 left"
