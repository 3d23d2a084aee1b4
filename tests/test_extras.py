"""What the default install lacks: who needs it is told what to install, and nobody else needs it."""

import subprocess
import sys
import zipfile

import pytest
from typer.testing import CliRunner

from flightcal.cli import USER_ERROR, app
from tests.commands.test_calibrate import write
from tests.external.scenes import write as write_external
from tests.external.scenes import written

EXTRAS = ("jax", "dask", "distributed", "umbridge", "fmpy")
DESCRIPTION = """<fmiModelDescription fmiVersion="2.0" modelName="model" guid="model">
  <CoSimulation modelIdentifier="model"/>
  <ModelVariables>
    <ScalarVariable name="link" valueReference="0" causality="parameter"><Real/></ScalarVariable>
    <ScalarVariable name="load" valueReference="1" causality="parameter"><Real/></ScalarVariable>
    <ScalarVariable name="battery" valueReference="2" causality="output"><Real/></ScalarVariable>
    <ScalarVariable name="radiator" valueReference="3" causality="output"><Real/></ScalarVariable>
  </ModelVariables>
</fmiModelDescription>"""


@pytest.mark.parametrize(
    ("module", "extra", "simulator"),
    [
        ("fmpy", "fmu", {"fmu": {"file": "model.fmu"}}),
        ("umbridge", "umbridge", {"umbridge": {"url": "http://localhost:4242"}}),
        ("jax", "jax", {"callable": {"file": "model.py", "function": "simulate", "gradient": "jax"}}),
    ],
)
def test_a_simulator_that_needs_an_extra_says_how_to_install_it(tmp_path, monkeypatch, module, extra, simulator):
    monkeypatch.setitem(sys.modules, module, None)
    (tmp_path / "model.py").write_text("def simulate(inputs, times, start): return times\n")
    with zipfile.ZipFile(tmp_path / "model.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", DESCRIPTION)
    scenario = write_external(tmp_path, written(simulator))
    result = CliRunner().invoke(app, ["calibrate", str(scenario), "--out", str(tmp_path / "run")])
    assert result.exit_code == USER_ERROR
    message = result.output.strip().splitlines()[-1]
    assert message.startswith("error: simulator")
    assert message.endswith(f"found no package '{module}', which it needs: pip install \"flightcal[{extra}]\"")


def test_a_cluster_needs_an_extra_and_says_so_before_anything_is_written(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    options = ["--runs", "4", "--out", str(tmp_path / "c"), "--scheduler", "tcp://127.0.0.1:9"]
    result = CliRunner().invoke(app, ["campaign", str(write(tmp_path)), *options])
    assert result.exit_code == USER_ERROR
    assert result.output.strip() == (
        "error: --scheduler: found no package 'distributed', which it needs: pip install \"flightcal[cluster]\""
    )
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize(
    "command", [pytest.param(["calibrate"], marks=pytest.mark.slow), ["campaign", "--runs", "4", "--workers", "1"]]
)
def test_commands_that_need_no_extra_work_without_any(tmp_path, command):
    scenario = write(
        tmp_path, genetic={"generations": 2, "population": 10}, nuts={"draws": 100, "warmup": 100, "max_r_hat": 2.0}
    )
    code = (
        "import sys\n"
        f"sys.modules.update(dict.fromkeys({EXTRAS!r}))\n"  # None: as if it were not installed
        "from flightcal.cli import main\n"
        "main()\n"
    )
    arguments = [command[0], str(scenario), "--out", str(tmp_path / "run"), *command[1:]]
    found = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True)
    assert found.returncode == 0, found.stdout + found.stderr
