"""The whole check of a scenario, from the command line: words, exit code, files."""

import json
import re
from html import unescape

import numpy as np
import pytest
from typer.testing import CliRunner

from flightcal.cli import app
from flightcal.commands.check import check_scenario
from flightcal.errors import ScenarioError
from tests import small
from tests.external import scenes
from tests.workers import close_workers

RUN = CliRunner()


def written_to(folder, written=None, panel_error=0.0):
    """A scenario file with telemetry of its own model, the panel's off by so many kelvin."""
    _, data = small.closed_loop(folder, written)
    table = data.to_dataframe().reset_index()
    for channel in ("body_temp", "panel_temp"):
        table[channel] -= 273.15
    table["panel_temp"] += panel_error
    table["time"] = table["time"].dt.strftime("%Y-%m-%dT%H:%M:%S")
    names = {"body_temp": "body", "panel_temp": "panel", "heater_status": "heater"}
    table.rename(columns=names)[["time", "body", "panel", "heater", "sun"]].to_csv(
        folder / "telemetry.csv", index=False
    )
    return folder / "scenario.yaml"


def check(file, out, *options):
    return RUN.invoke(app, ["check", str(file), "--out", str(out), *options], catch_exceptions=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("checked")


@pytest.fixture(scope="module")
def done(folder):
    return check(written_to(folder), folder / "run", "--profile", "link")


def test_advice_on_the_scenario_is_told_first(tmp_path):
    written = small.content()
    written["simulator"]["heaters"]["heater"]["power"] = "30 kW"
    told = check(written_to(tmp_path, written), tmp_path / "run").output
    assert "advice: parameters.power: its prior is from 15 to 45" in " ".join(told.split())


def test_a_scenario_without_faults_is_ready_to_sample(done, folder):
    assert done.exit_code == 0, done.output
    assert "Ready to sample" in done.output
    content = json.loads((folder / "run" / "check.json").read_text())
    assert content["passed"] is True
    assert {finding["state"] for finding in content["findings"]} <= {"good", "warn"}
    titles = [finding["title"] for finding in content["findings"]]
    assert "The gradient is right" in titles
    assert "The likelihood alone bounds link" in titles
    assert content["examined_at"]["theta"]["link"] == pytest.approx(small.TRUTH["link"], rel=0.05)


def test_its_page_stands_alone_and_has_every_part(done, folder):
    page = (folder / "run" / "check.html").read_text()
    for part in ("flightcal check", "Prior predictive", "Identifiability", "Sensitivity", "Smoothness", "Profiles"):
        assert part in page
    # Bands, four of identifiability, sensitivities, a scan of each of six parameters, and a profile.
    assert page.count('class="plot"') == 1 + 4 + 1 + 6 + 1
    assert "http-equiv" in page
    assert "src=" not in page.split("<script>")[0]


def test_the_same_check_is_not_made_twice_and_another_profile_is_another_check(done, folder):
    made = (folder / "run" / "check.json").stat().st_mtime_ns
    assert check(folder / "scenario.yaml", folder / "run", "--profile", "link").exit_code == 0
    assert (folder / "run" / "check.json").stat().st_mtime_ns == made
    assert check(folder / "scenario.yaml", folder / "run").exit_code == 0
    assert (folder / "run" / "check.json").stat().st_mtime_ns != made


def test_a_scenario_with_a_product_of_unknowns_and_an_unreachable_channel_exits_with_3(tmp_path):
    written = small.content()
    written["windows"]["train"]["end"] = "2024-03-01T01:30:00"
    del written["parameters"]["link"]
    for name in ("contact_area", "contact_conductance"):
        written["parameters"][name] = {
            "scales": "conductors.body-panel.conductance",
            "prior": {"lognormal": {"median": 1, "factor": 1.5}},
        }
    found = check(written_to(tmp_path, written, panel_error=-60.0), tmp_path / "run")
    assert found.exit_code == 3, found.output
    words = " ".join(found.output.split())
    assert "3 findings matter" in words
    assert re.search("Likely wrong: panel_temp reads (5[5-9]|6[0-5]) K too low", words)
    assert "act alike: only their product is known" in words
    assert "The prior cannot reach the telemetry of panel_temp" in words


def test_what_is_the_users_to_mend_is_a_message(folder, tmp_path):
    found = check(folder / "scenario.yaml", tmp_path / "run", "--profile", "lnk")
    assert found.exit_code == 1
    assert "--profile lnk: expected one of link, panel_size" in found.output


TWO = {
    "first": {"start": "2024-03-01T00:00:00", "end": "2024-03-01T01:30:00"},
    "second": {"start": "2024-03-01T02:10:00", "end": "2024-03-01T03:20:00"},
}


def test_two_training_windows_are_checked_together_in_either_order(tmp_path):
    found = []
    for number, labels in enumerate((("first", "second"), ("second", "first"))):
        written = small.content()
        written["windows"]["train"] = {label: TWO[label] for label in labels}
        folder = tmp_path / str(number)
        folder.mkdir()
        summary = check_scenario(written_to(folder, written), folder / "run")
        assert summary.passed
        page = summary.page.read_text()
        # Bands of each window, four of identifiability, sensitivities, a scan of each of eight parameters.
        assert page.count('class="plot"') == 2 + 4 + 1 + 8
        assert "body_temp in 'second'" in unescape(page)
        # 400 draws, 256 (7 + 2) of the Sobol indices and 61 points along each of 8 parameters, in each of two windows.
        assert f"about {2 * (400 + 256 * 9 + 61 * 8)} simulations" in page
        found.append(json.loads((folder / "run" / "check.json").read_text()))
    # Sensitivities are sampled along theta's entries in their order, which is that of the windows.
    sampled = "Over the whole prior the likelihood depends most on"
    states = [
        {finding["title"]: finding["state"] for finding in content["findings"] if sampled not in finding["title"]}
        for content in found
    ]
    assert len(states[0]) > 2
    assert states[0] == states[1]
    totals = [
        dict(zip(content["sensitivity"]["names"], content["sensitivity"]["indices"]["total"][-1], strict=True))
        for content in found
    ]
    assert totals[0] == pytest.approx(totals[1], abs=0.1)
    information = [content["identifiability"]["information"] for content in found]
    np.testing.assert_allclose(information[0], information[1], rtol=0.01)
    assert set(found[0]["examined_at"]["theta"]) >= {"initial.first.body", "initial.second.body"}


COUNTED = """
import {module} as np
from pathlib import Path

def simulate(inputs, times, start):
    with (Path(__file__).parent / "runs").open("a") as file:
        file.write("run ")
    battery = 293 + inputs["load"] / inputs["link"] * (1 - np.exp(-inputs["link"] * times / 900)) - 5
    return np.stack([battery, battery - 15], axis=1)
"""


def external(folder, gradient, **changes):
    """A Python function that writes down that it was called, and telemetry near what it gives."""
    (folder / "model.py").write_text(COUNTED.format(module="jax.numpy" if gradient == "jax" else "numpy"))
    return scenes.write(folder, scenes.written({"callable": {"file": "model.py", "gradient": gradient}}, **changes))


TWO_SHORT = {
    "train": {
        "first": {"start": "2024-03-01T00:00:00", "end": "2024-03-01T00:31:00"},
        "second": {"start": "2024-03-01T01:00:00", "end": "2024-03-01T01:31:00"},
    }
}


@pytest.mark.parametrize("windows", [{}, TWO_SHORT], ids=["one", "two"])
def test_a_simulator_without_derivatives_is_checked_within_the_budget_that_is_stated(tmp_path, windows):
    summary = check_scenario(external(tmp_path, "none", windows=windows), tmp_path / "run", runs=90)
    close_workers()
    runs = (tmp_path / "runs").read_text().count("run")
    stated = int(re.search(r"at most (\d+) runs", summary.page.read_text()).group(1))
    assert 60 < runs <= stated <= 95
    titles = [finding.title for finding in summary.findings]
    assert "There is no gradient to check" in titles
    assert "Jumps were not looked for" in titles
    assert any(title.startswith("Not looked for: wrong heaters") for title in titles)
    content = json.loads((tmp_path / "run" / "check.json").read_text())
    assert "RBD-FAST" in content["sensitivity"]["method"]


def test_a_profile_needs_derivatives(tmp_path):
    with pytest.raises(ScenarioError, match="--profile: found a simulator without derivatives"):
        check_scenario(external(tmp_path, "none"), tmp_path / "run", profiles=["link"])
    close_workers()


def test_the_gradient_of_an_external_simulator_is_checked(tmp_path):
    summary = check_scenario(external(tmp_path, "jax"), tmp_path / "run", runs=60)
    close_workers()
    assert "The gradient is right" in [finding.title for finding in summary.findings]


def test_a_simulator_with_an_error_of_its_own_is_checked(tmp_path):
    written = small.content()
    error = {"offset": "0.2 K", "deviation": "0.1 K", "correlation_time": "600 s"}
    written["simulator"]["errors"] = {"body_temp": error, "panel_temp": error}
    summary = check_scenario(written_to(tmp_path, written), tmp_path / "run")
    assert summary.passed
    assert "The gradient is right" in [finding.title for finding in summary.findings]
