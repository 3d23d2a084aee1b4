"""The made-up run of these tests against one that the experiment writes: files, variables, dimensions, fields."""

import json
import re
import sys
import tempfile
from pathlib import Path

import pytest

from flightcal.commands.calibrate import run_experiment
from flightcal.report import write_report
from flightcal.report.run_files import STAGES, read_run
from flightcal.report.verdict import verdict_of
from tests.commands.test_calibrate import write

from .packed import drawn, without_scripts


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    folder = tmp_path_factory.mktemp("real")
    scenario = write(folder, genetic={"generations": 3}, nuts={"draws": 50, "warmup": 50})
    telemetry = folder / "telemetry.csv"
    *_, last = telemetry.read_text(encoding="utf-8").splitlines()
    with telemetry.open("a", encoding="utf-8") as file:
        # So that there is a finding about the telemetry.
        file.write(f"{last}\n")
    return run_experiment(scenario, folder / "run").run


def fields(record):
    """Names in a JSON record, of the records in its lists too; not those that are the user's."""
    free = ("packages", "inputs", "stages", "stage_inputs")
    return {
        key: fields(value[0]) if isinstance(value, list) and value and isinstance(value[0], dict) else None
        for key, value in record.items()
        if key not in free
    }


@pytest.mark.parametrize("name", [name for name in STAGES if name.endswith(".json")])
def test_records_have_the_same_fields(run_directory, real, name):
    made_up, written = (json.loads((folder / name).read_text(encoding="utf-8")) for folder in (run_directory, real))
    if isinstance(written, list):
        assert written
        made_up, written = made_up[0], written[0]
    assert fields(made_up) == fields(written)


def structure(dataset):
    """Variables with their dimensions, coordinates, attributes."""
    return {str(n): v.dims for n, v in dataset.data_vars.items()}, set(dataset.coords), set(dataset.attrs)


def test_arrays_have_the_same_variables(run, real):
    written = read_run(real)
    assert list(run.windows) == list(written.windows) == ["train", "test"]
    for name in run.windows:
        assert structure(run.windows[name]) == structure(written.windows[name])
        assert run.windows[name]["by"].values.tolist() == written.windows[name]["by"].values.tolist()
    assert structure(run.genetic) == structure(written.genetic)
    assert set(run.posterior.children) == set(written.posterior.children)
    for name in ("sample_stats", "posterior_predictive", "observed_data"):
        assert structure(run.posterior[name].to_dataset()) == structure(written.posterior[name].to_dataset())
    for name in ("posterior", "prior"):
        for variable in (*run.posterior[name].data_vars.values(), *written.posterior[name].data_vars.values()):
            assert variable.dims == ("chain", "draw")
    assert set(run.posterior.attrs) == set(written.posterior.attrs)


def test_stages_are_timed_by_the_names_that_the_report_knows(run, real):
    assert {"read", "genetic", "nuts", "predict"} == set(run.provenance["stages"])
    assert set(run.provenance["stages"]) <= set(read_run(real).provenance["stages"])


def test_a_real_run_lacks_nothing_in_the_report(real):
    run = read_run(real)
    assert run.missing == ()
    assert all(finding.state != "none" for answer in verdict_of(run).answers for finding in answer.findings)
    page = write_report(real)
    assert 'class="note"' not in page.read_text(encoding="utf-8")
    assert page.stat().st_size < 2.5e6


def test_a_page_names_no_place_and_no_user_of_the_machine(real):
    page = write_report(real).read_text(encoding="utf-8")
    said = without_scripts(page) + json.dumps(drawn(page)["figures"])
    places = {str(real.parent), str(real.parent.parent), str(Path.home()), sys.prefix, tempfile.gettempdir()}
    assert not [place for place in places if len(place) > 1 and place in said]
    assert "telemetry.csv" in said
    assert not re.findall(r"[\s\[(\"'](?:/[\w.-]+){2,}", re.sub(r"</\w+>", "", said))


@pytest.mark.slow
def test_a_real_run_with_correlated_noise_and_a_discrepancy_lacks_nothing_either(tmp_path):
    scenario = write(tmp_path, genetic={"generations": 3}, nuts={"draws": 50, "warmup": 50})
    text = scenario.read_text(encoding="utf-8")
    scenario.write_text(f"{text}\nnoise: {{model: ar1}}\ndiscrepancy: {{phase: {{}}}}\n", encoding="utf-8")
    page = write_report(run_experiment(scenario, tmp_path / "run").run).read_text(encoding="utf-8")
    assert 'id="discrepancy"' in page
    assert "discrepancy.phase.lengthscale, orbits" in page
    # The telemetry is without fault, and that is all that is not there.
    assert re.findall(r'class="note">(.*?)<', page) == ["– No findings: every sample of every channel was usable."]
    assert "No interval in this report contains this model discrepancy" not in page
