"""No process outlives the one that started it, however that ends."""

import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from .scenes import write, written

ROOT = Path(__file__).parents[2]
START = """
import sys
import numpy as np
from tests.external.scenes import THETA, simulator_of
from flightcal.scenario import load_scenario
from flightcal.telemetry import read
from flightcal.problem import build_problem
scenario = load_scenario(sys.argv[1])
simulator = build_problem(scenario, read(scenario)).windows[0].simulator
print("ready", flush=True)
try:
    simulator.simulate_many(np.tile(THETA, (3, 1)))
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""
HANG = """
import os, time
with open(PIDS, "a") as file:
    print(os.getpid(), file=file)
def simulate(inputs, times, start):
    while True:
        time.sleep(0.01)
"""
START_CHILD = """
import subprocess, sys
subprocess.Popen([sys.executable, "child.py"])
"""


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def until(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.05)
    return condition()


@pytest.fixture(params=["executable", pytest.param("callable", marks=pytest.mark.slow)])
def running(request, tmp_path):
    """A process in the midst of simulations that hang, and the numbers of the processes that simulate."""
    pids = tmp_path / "pids"
    (tmp_path / "model.py").write_text(f"PIDS = {str(pids)!r}\n{HANG}\n")
    (tmp_path / "child.py").write_text(f"PIDS = {str(pids)!r}\n{HANG}\nsimulate(0, 0, 0)\n")
    (tmp_path / "program.py").write_text(START_CHILD + (tmp_path / "child.py").read_text())
    block = {
        "callable": {"callable": {"file": "model.py"}},
        "executable": {"executable": {"command": [sys.executable, "program.py"], "files": ["program.py", "child.py"]}},
    }[request.param]
    path = write(tmp_path, written({**block, "timeout": "600 s", "retries": 50}))
    (tmp_path / "temporary").mkdir()
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(START), str(path)],
        cwd=ROOT,
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT)]),
            "TMPDIR": str(tmp_path / "temporary"),
        },
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "ready\n"
    assert until(pids.exists)
    time.sleep(0.5)
    yield process, lambda: [int(line) for line in pids.read_text().split()]
    process.kill()
    process.wait()


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks at processes in /proc")
def test_interruption_ends_all_runs_at_once(running):
    process, pids = running
    started = time.monotonic()

    process.send_signal(signal.SIGINT)

    assert process.communicate(timeout=30)[0] == "interrupted\n"
    assert time.monotonic() - started < 20
    assert until(lambda: not any(map(alive, pids())), 5)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks at processes in /proc")
def test_what_simulates_ends_when_its_parent_is_killed(running, tmp_path):
    process, pids = running
    assert any(map(alive, pids()))
    temporary = tmp_path / "temporary"
    assert any(temporary.iterdir())

    process.kill()

    assert until(lambda: not any(map(alive, pids())), 10)
    assert until(lambda: not any(temporary.iterdir()), 10)
