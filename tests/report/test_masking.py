"""A page to pass on: no name of the user's and no absolute temperature is in it."""

import dataclasses
import json
import re
import shutil

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from flightcal.cli import app
from flightcal.report import read_run, write_report
from flightcal.report.masking import masked
from flightcal.report.windows import column
from flightcal.run import read_tree

from .cases import with_attributes
from .packed import drawn, without_scripts
from .synthetic_run import CHANNELS, HEATERS, PARAMETERS, every_finding

NAMES = [*CHANNELS, *HEATERS, *(row[0] for row in PARAMETERS), "panel", "battery", "payload", "safe_hold", "Toy"]
NAMES += ["sunwatch", "moonwatch"]
TREACHEROUS = (
    "payload at 285.4 K in safe_hold, battery 12.5 degC, panel_link −3 °C, from 68.0..95.0 degC to 77.4 K and "
    "1234.5 K; 0.5 K is a difference"
)


def said(page):
    """All that a page says in words and in figures, names as they are and as figures write them."""
    words = re.sub(r"<style.*?</style>", "", without_scripts(page), flags=re.S)
    return f"{words} {json.dumps(drawn(page)['figures'])}".replace("<wbr>", "")


def named(text):
    """Names of the run that are in a text."""
    spelled = {name: {name, name.replace("_", " "), name.replace("_", "_<br>")} for name in NAMES}
    return [name for name, ways in spelled.items() if any(re.search(rf"\b{re.escape(way)}\b", text) for way in ways)]


@pytest.fixture(scope="module")
def folder(slim_directory, tmp_path_factory):
    """A run that has a name wherever one can stand."""
    toy = shutil.copytree(slim_directory, tmp_path_factory.mktemp("masking") / "Toy")
    (toy / "scenario.yaml").write_text(
        "name: Toy\nsimulator:\n  nodes: {panel: {}, battery: {}, payload: {}}\n  modes: {safe_hold: {}}\n", "utf-8"
    )
    quality = json.loads((toy / "telemetry_quality.json").read_text("utf-8"))
    quality[0]["detail"] = TREACHEROUS
    gap = "'sunwatch', 'moonwatch' drive the simulator and have no sample for 9.0 min"
    quality.append(quality[0] | {"channel": "sunwatch, moonwatch", "finding": "bridged", "detail": gap})
    (toy / "telemetry_quality.json").write_text(json.dumps(quality), "utf-8")
    diagnostics = json.loads((toy / "diagnostics.json").read_text("utf-8"))
    diagnostics["gates"][0]["advice"] = TREACHEROUS
    (toy / "diagnostics.json").write_text(json.dumps(diagnostics), "utf-8")
    suspect = {"title": TREACHEROUS, "sentence": TREACHEROUS, "advice": TREACHEROUS}
    (toy / "suspects.json").write_text(json.dumps({"found": [suspect]}), "utf-8")
    footing = {"name": "panel_emissivity", "number": "faces.panel.area", "off": 0.07, "change": 0.9}
    results = json.loads((toy / "parameters.json").read_text("utf-8"))
    for row in results["parameters"]:
        row |= {"considered_lower": row["lower"] - 3.0, "considered_upper": row["upper"] + 3.0}
    results["fixed_numbers"] = {"within": 0.1, "footings": [footing]}
    (toy / "parameters.json").write_text(json.dumps(results), "utf-8")
    return toy


@pytest.fixture(scope="module")
def page(folder):
    done = CliRunner().invoke(app, ["report", str(folder), "--mask"])
    assert done.output == f"report: {folder / 'masked.html'}\n"
    return (folder / "masked.html").read_text("utf-8")


def test_no_name_is_on_a_masked_page(page):
    assert named(said(page)) == []
    for neutral in ("channel 1", "heater 1", "parameter 1", "node 2", "initial.node 1", "noise.channel 1"):
        assert neutral in said(page)


def test_the_page_that_is_not_masked_has_the_names(folder):
    """So that the test before this one looks at the right places."""
    text = said(write_report(folder).read_text("utf-8"))
    assert set(named(text)) >= {"battery_temperature", "battery_heater", "panel_emissivity", "payload", "Toy"}


def test_no_absolute_temperature_is_on_a_masked_page(page):
    text = said(page)
    assert not re.findall(r"185 degC|285\.4|12\.5 degC|−3 °C|68\.0|95\.0|77\.4|234\.5", text)
    assert "from a temperature to a temperature and a temperature; 0.5 K" in text
    assert "node 3 at a temperature in mode 1" in text
    assert "0.5 K is a difference" in text
    assert "Masked: names are replaced" in text


def test_variables_of_flightcal_keep_their_names_beside_channels_of_the_same(run):
    scenario = "telemetry: {channels: {eclipse: {}, observed_status: {}, mean_theta: {}, diverging: {}}}"
    hidden = masked(dataclasses.replace(run, scenario=scenario))
    assert set(hidden.windows["test"].data_vars) == set(run.windows["test"].data_vars)
    assert set(hidden.genetic.data_vars) == set(run.genetic.data_vars)
    assert "diverging" in hidden.posterior["sample_stats"]


def test_another_explanation_s_temperatures_are_less_their_prior_s_median(run):
    told = with_attributes(
        run, other_explanations=json.dumps([{"differs": [["initial.battery", 283.1, 290.2]], "below": 1.3}])
    )
    median = next(info.prior_quantiles[1] for info in run.parameters if info.name == "initial.battery")
    details = next(finding.details for finding in every_finding(masked(told)) if "explanation" in finding.title)
    assert details == (
        f"initial.node 2 {290.2 - median:.6g} instead of {283.1 - median:.6g} K: 1.3 nats below the best.",
    )


def test_temperatures_are_less_a_constant_of_their_channel(run):
    hidden = masked(run)
    for name, window in hidden.windows.items():
        for alias, real in zip(window["channel"].values, run.windows[name]["channel"].values, strict=True):
            offsets = [column(run.windows[name], v, str(real)) - column(window, v, str(alias)) for v in ("observed",)]
            offset = np.nanmean(offsets)
            assert np.nanmax(np.abs(offsets - offset)) < 1e-9
            assert offset == pytest.approx(np.nanmean(column(run.windows["train"], "observed", str(real))))
            for variable in ("mean", "lower", "upper"):
                change = run.windows[name][variable].sel(channel=real, by="stochastic").values
                change = change - window[variable].sel(channel=alias, by="stochastic").values
                np.testing.assert_allclose(change, offset)


def test_a_threshold_and_an_initial_temperature_are_less_their_prior_s_median(run):
    hidden = {row.name: row for row in masked(run).calibrated}
    threshold = hidden["parameter 8"]
    assert (threshold.before, threshold.unit) == (0.0, "K")
    real = next(row for row in run.calibrated if row.name == "battery_threshold")
    assert threshold.mean == pytest.approx(real.mean - real.before)
    assert abs(hidden["initial.node 1"].mean) < 5.0
    assert hidden["parameter 5"].mean == pytest.approx(0.6, abs=0.02)


def test_the_verdict_is_the_same_but_for_names(run):
    assert [finding.state for finding in every_finding(masked(run))] == [
        finding.state for finding in every_finding(run)
    ]


def test_relative_errors_inputs_and_scenario_are_left_out(run):
    hidden = masked(run)
    assert not [metric for metric in hidden.metrics if metric.metric.startswith("mape")]
    assert len(hidden.metrics) < len(run.metrics)
    assert "inputs" not in hidden.provenance
    assert hidden.scenario == "name: masked"


def test_windows_of_a_group_keep_their_group(own_run):
    groups = {name: group.to_dataset() for name, group in read_tree(own_run / "prediction.nc").children.items()}
    groups = {"train": groups["train"], "test.over_paris": groups["test"]}
    (own_run / "prediction.nc").unlink()
    xr.DataTree.from_dict(groups).to_netcdf(own_run / "prediction.nc", engine="h5netcdf")
    assert list(masked(read_run(own_run)).windows) == ["train", "test.window 1"]


def test_a_backtest_is_not_masked(tmp_path):
    (tmp_path / "backtest.json").write_text("{}", "utf-8")
    done = CliRunner().invoke(app, ["report", str(tmp_path), "--mask"])
    assert done.exit_code != 0
