import http.server
import socket
import subprocess
import sys
import textwrap
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest

from flightcal.commands.calibrate import run_experiment
from flightcal.errors import ScenarioError
from flightcal.simulator import SimulationFailure
from tests.workers import close_workers

from .scenes import SAMPLES, THETA, TIMES, simulator_of, write, written

pytest.importorskip("umbridge", reason="needs the extra 'umbridge'")

SERVER = """
import math, sys, time
import umbridge

class Thermal(umbridge.Model):
    def __init__(self, name="thermal"):
        super().__init__(name)
    def get_input_sizes(self, config): return [2]
    def get_output_sizes(self, config):
        return [len(config["times"])] * (1 if self.name == "single" else 2)
    def supports_evaluate(self): return True
    def supports_gradient(self): return self.name == "thermal"
    def curve(self, link, load, times): return [300 + load / link * (1 - math.exp(-link * t / 900)) for t in times]
    def __call__(self, parameters, config):
        (link, load), times = parameters[0], config["times"]
        if self.name == "failing": raise ValueError("no convergence")
        if self.name == "hanging": time.sleep(600)
        assert config["start"] == "2024-03-01T00:00:00" and config["base"] == 7
        battery = self.curve(link, load, times)
        if self.name == "nan": battery[4] = float("nan")
        if self.name == "short": return [battery[:5], battery]
        if self.name == "single": return [battery]
        return [battery, [2 * value for value in battery]]
    def gradient(self, out_wrt, in_wrt, parameters, sens, config):
        (link, load), times = parameters[0], config["times"]
        left = [math.exp(-link * t / 900) for t in times]
        d_load = [(1 - e) / link for e in left]
        d_link = [load * ((e - 1) / link + t / 900 * e) / link for t, e in zip(times, left)]
        factor = (1, 2)[out_wrt]
        return [factor * sum(s * d for s, d in zip(sens, column)) for column in (d_link, d_load)]

names = ["thermal", "failing", "hanging", "nan", "short", "single"]
umbridge.serve_models([Thermal(name) for name in names], int(sys.argv[1]), error_checks=False)
"""


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture(autouse=True)
def _direct(monkeypatch):
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    yield
    close_workers()


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """The address of a server that the `umbridge` package runs."""
    file, port = tmp_path_factory.mktemp("server") / "server.py", free_port()
    file.write_text(textwrap.dedent(SERVER))
    process = subprocess.Popen([sys.executable, str(file), str(port)], stdout=subprocess.DEVNULL)
    for _ in range(300):
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                break
        time.sleep(0.1)
    yield f"http://127.0.0.1:{port}"
    process.kill()
    process.wait()


def build(folder, url, model="thermal", **changes):
    return simulator_of(folder, {"umbridge": {"url": url, "model": model, "config": {"base": 7}}, **changes})


def test_server_gives_temperatures(tmp_path, server):
    record = build(tmp_path, server).run(THETA)

    assert (record.outcome, record.message) == ("finished", "")
    expected = 300 + 5.0 / 0.8 * (1 - np.exp(-0.8 * TIMES / 900))
    np.testing.assert_allclose(record.temperatures, np.stack([expected, 2 * expected], axis=1), rtol=1e-12)


def test_gradient_of_the_server_agrees_with_finite_differences(tmp_path, server):
    simulator = build(tmp_path, server)
    weights = np.random.default_rng(1).standard_normal((SAMPLES, 2))

    _, cotangent = simulator.linearise(THETA)

    gradient = cotangent(weights)
    for k in range(len(THETA)):
        step = 1e-5 * np.eye(len(THETA))[k]
        above, below = (simulator.simulate(THETA + sign * step).temperatures for sign in (1, -1))
        np.testing.assert_allclose(gradient[k], ((above - below) * weights).sum() / 2e-5, rtol=1e-5)


def test_server_without_gradient_says_what_to_use(tmp_path, server):
    with pytest.raises(ScenarioError, match=r"no gradient .umbridge.*Calibrate through an emulator"):
        build(tmp_path, server, "single").linearise(THETA)


def test_noise_that_is_not_normal_is_refused_where_the_server_has_no_gradient(tmp_path, server):
    noise = {"observations": {"battery_temp": {"output": "battery", "noise": {"quantisation": "0.5 K"}}}}
    simulator = {"umbridge": {"url": server, "model": "single", "config": {"base": 7}}}
    write(tmp_path, written(simulator, **noise))

    with pytest.raises(ScenarioError, match=r"noise: found quantised .* server offers no gradient"):
        run_experiment(tmp_path / "scenario.yaml", tmp_path / "run")


@pytest.mark.parametrize(
    ("model", "outcome", "message"),
    [
        ("nan", "not finite", "gives nan"),
        ("short", "wrong shape", "'battery': found 5 numbers, expected 31, one for each sample time"),
        ("single", "wrong shape", "found 1 vectors, expected one for each of battery, radiator"),
        ("absent", "crashed", "Model absent not supported by server! Supported models are: ['thermal', 'failing'"),
        ("failing", "crashed", "answers what is not UM-Bridge: 500 Internal Server Error"),
    ],
)
def test_bad_model_gives_a_record_that_says_what_is_wrong(tmp_path, server, model, outcome, message):
    record = build(tmp_path, server, model).run(THETA)

    assert record.outcome == outcome, record.message
    assert message in record.message
    assert np.isnan(record.temperatures).all()


def test_model_that_hangs_is_given_up(tmp_path, server):
    started = time.perf_counter()
    record = build(tmp_path, server, "hanging", timeout="2 s").run(THETA)

    assert (record.outcome, record.message) == ("timed out", "still running after 2 s, killed")
    assert time.perf_counter() - started < 20


def test_no_server_is_a_record_and_tried_again(tmp_path):
    url = f"http://127.0.0.1:{free_port()}"
    simulator = build(tmp_path, url, retries=1)

    record = simulator.run(THETA)

    assert (record.outcome, record.attempts) == ("unreachable", 2)
    assert record.message == f"no server at {url}: [Errno 111] Connection refused"
    with pytest.raises(SimulationFailure, match=r"umbridge: unreachable: no server at"):
        simulator.linearise(THETA)


class Endless(http.server.BaseHTTPRequestHandler):
    """A server whose replies do not end, or that sends its clients elsewhere."""

    target = ""
    asked = 0

    def do_GET(self):
        type(self).asked += 1
        if self.target:
            self.send_response(302)
            self.send_header("Location", self.target)
            self.end_headers()
            return
        self.send_response(200)
        self.end_headers()
        try:
            while True:
                self.wfile.write(b" " * 1_000_000)
        except OSError:
            pass

    def log_message(self, *_):
        pass


@contextmanager
def serving(handler):
    with http.server.HTTPServer(("127.0.0.1", 0), handler) as page:
        threading.Thread(target=page.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{page.server_port}"
        page.shutdown()


def test_a_reply_without_end_is_cut_off_at_its_limit(tmp_path):
    with serving(Endless) as url:
        record = build(tmp_path, url).run(THETA)

    assert record.outcome == "wrong shape"
    assert "found a reply of more than 64 MB, expected 64 MB at most" in record.message


def test_redirects_are_not_followed(tmp_path):
    elsewhere = type("Elsewhere", (Endless,), {"asked": 0})
    with serving(elsewhere) as target, serving(type("Sender", (Endless,), {"target": target})) as url:
        record = build(tmp_path, url).run(THETA)

    assert record.outcome == "crashed"
    assert f"redirects to {target}, expected an answer: redirects are not followed" in record.message
    assert elsewhere.asked == 0


def test_server_of_something_else_is_a_record(tmp_path):
    class Page(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.end_headers()
            self.wfile.write(b"<html>welcome</html>")

        def log_message(self, *_):
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Page) as page:
        threading.Thread(target=page.serve_forever, daemon=True).start()
        record = build(tmp_path, f"http://127.0.0.1:{page.server_port}").run(THETA)
        page.shutdown()

    assert record.outcome == "crashed"
    assert record.message.endswith("answers what is not UM-Bridge: <html>welcome</html>")
