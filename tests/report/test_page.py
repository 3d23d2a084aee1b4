"""The page as a file: whole, offline, in order, and complete whatever is missing."""

import dataclasses
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from flightcal.errors import RunError
from flightcal.report import panels, write_report
from flightcal.report.page import _scenario_name, steps
from flightcal.report.run_files import STAGES
from flightcal.run import read_tree

from .packed import drawn, unpacked, without_scripts
from .synthetic_run import names

FIRST = ["verdict", "calibrated", "picture", "duty"]
TRUST = ["why", "reliability", "residuals", "convergence", "parameters", "pairs", "heaters"]
PUBLISHED = ["scores", "before", "genetic", "densities", "prediction"]
RECORD = ["telemetry", "provenance"]
SECTIONS = [*FIRST, *TRUST, *PUBLISHED, *RECORD]


@pytest.fixture(scope="module")
def page(run_directory, tmp_path_factory):
    return write_report(run_directory, tmp_path_factory.mktemp("page") / "page.html").read_text(encoding="utf-8")


def figures(page):
    return drawn(page)["figures"]


@pytest.fixture
def undrawn(monkeypatch):
    """A page of one word, where a test is of its file."""
    monkeypatch.setattr("flightcal.report.page.render", lambda *_, **__: "drawn")


def test_the_report_lies_in_the_run_unless_told_otherwise(slim_run, tmp_path, undrawn):
    assert write_report(slim_run) == slim_run / "report.html"
    assert write_report(slim_run, tmp_path / "else.html") == tmp_path / "else.html"
    assert (slim_run / "report.html").read_text() == (tmp_path / "else.html").read_text() == "drawn"
    assert (tmp_path / "else.html").stat().st_mode & 0o044
    assert not list(slim_run.glob(".*"))


def test_a_report_that_fails_leaves_the_old_one(own_run):
    (own_run / "report.html").write_text("old", encoding="utf-8")
    (own_run / "metrics.json").write_text("{", encoding="utf-8")
    with pytest.raises(RunError):
        write_report(own_run)
    assert (own_run / "report.html").read_text(encoding="utf-8") == "old"
    assert not list(own_run.glob(".*"))


def test_a_page_that_cannot_be_written_leaves_no_part_behind(slim_run, undrawn, monkeypatch):
    def refuse(*_):
        raise OSError("no space")

    monkeypatch.setattr("flightcal.run.folder.os.replace", refuse)
    with pytest.raises(OSError, match="no space"):
        write_report(slim_run)
    assert not list(slim_run.glob(".*"))


def sections(page):
    return re.findall(r'<section id="(\w+)"', page)


def test_sections_come_in_order_and_what_is_folded_has_links_that_are_seen(page):
    assert sections(page) == SECTIONS
    parts = re.findall(r'<details class="part" id="(\w+)">(.*?)</summary>', page, re.S)
    links = {name: re.findall(r'<a href="#(\w+)">', summary) for name, summary in parts}
    assert links == {"trust": TRUST, "published": PUBLISHED, "record": RECORD}


def test_what_is_not_of_the_first_screen_is_folded(page):
    assert sections(re.sub(r"<details.*?</details>", "", page, flags=re.S))[: len(FIRST)] == FIRST
    assert page.index('<details class="part"') > page.index('id="duty"')
    assert "<details open" not in page


def test_every_panel_has_its_place_in_the_order():
    files = {file.stem for file in Path(sys.modules["flightcal.report.panels"].__file__).parent.glob("[!_]*.py")}
    placed = [*panels.FIRST, *(name for *_, names in panels.PARTS for name in names)]
    assert sorted(placed) == sorted(files)


def test_every_link_inside_the_page_has_a_target(page):
    assert set(re.findall(r'href="#([\w-]+)"', page)) <= set(re.findall(r' id="([\w-]+)"', page))


def test_files_to_load_are_named_by_where_they_are_beside_the_page(slim_run, tmp_path):
    for name in ("parameters.csv", "calibrated.yaml"):
        (slim_run / name).write_text("", encoding="utf-8")
    links = re.findall(r'<a href="([^#"]+)">', write_report(slim_run).read_text(encoding="utf-8"))
    assert links == ["calibrated.yaml", "parameters.csv", "parameters.json"]
    elsewhere = write_report(slim_run, tmp_path / "else.html").read_text(encoding="utf-8")
    assert not re.findall(r'<a href="([^#"]+)">', elsewhere)


def test_a_backtest_in_the_run_s_folder_is_shown_first_among_the_reasons(slim_run):
    (slim_run / "backtest").mkdir()
    score = {"origin": "all", "channel": "all", "samples": 9, "coverage": 0.93, "rmse": 0.2, "width": 0.8, "crps": 0.1}
    scores = [
        score | {"band": "1 orbit"},
        score | {"band": "8 orbits", "rmse": 0.7},
        score | {"channel": "tank", "band": "x"},
    ]
    content = {"held": 4, "origins": [{}] * 5, "scores": scores, "interval": 0.8}
    (slim_run / "backtest" / "backtest.json").write_text(json.dumps(content), encoding="utf-8")
    page = write_report(slim_run).read_text(encoding="utf-8")
    assert sections(page)[4:6] == ["why", "backtest"]
    assert "Intervals held after 4 of 5 origins." in page
    assert "inside the 80% interval" in page
    part = page[page.index('id="backtest"') : page.index('id="reliability"')]
    assert re.findall(r'<td class="[^"]*">(.*?)</td>', part)[::5] == ["1 orbit", "8 orbits"]
    assert '<a href="backtest/report.html">' in part


def test_nothing_is_fetched_and_nothing_can_be_sent(page):
    shell = without_scripts(page)
    assert not re.search(r"<(link|iframe|img|object|embed)\b|\bsrc=|@import|url\(", shell)
    assert not re.search(r"<script[^>]*\bsrc=", page)
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', page).group(1)
    assert "default-src 'none'" in policy
    assert "form-action 'none'" in policy
    assert "http" not in policy


def test_plotly_is_there_once_and_packed(page):
    assert len(re.findall(r"\* plotly\.js v\d", unpacked(page, "plotly"))) == 1
    assert "plotly.js v" not in page


def test_the_papers_six_figures_are_there(page):
    captions = " ".join(re.findall(r"<figcaption>(.*?)</figcaption>", page, re.S))
    for figure in ("Figure 1.", "Figure 2.", "Figure 3.", "Figure 4.", "Figure 5.", "Figure 6a.", "Figure 6b."):
        assert figure in captions


def test_every_place_has_a_figure_and_every_figure_a_place(page):
    places = re.findall(r'class="plot" id="(figure-\d+)"', page)
    assert places == list(figures(page))
    assert len(places) == 32


def test_arrays_are_shared_and_complete(page):
    content = drawn(page)
    traces = [trace for figure in content["figures"].values() for trace in figure["data"]]
    packed = [value for trace in traces for value in trace.values() if isinstance(value, dict)]
    used = [value["array"] for value in packed if "array" in value]
    columns = [number for value in packed for number in value.get("columns", [])]
    assert set(used) | set(columns) == set(range(len(content["arrays"])))
    assert len(used) > 1.5 * len(set(used))
    sizes = [len(array["steps"]) for array in content["arrays"]]
    for trace in traces:
        if all(isinstance(trace.get(axis), dict) for axis in "xy"):
            assert sizes[trace["x"]["array"]] == sizes[trace["y"]["array"]]


def restored(packed):
    values, now = [], 0
    for step in packed["steps"]:
        now += step or 0
        values.append(np.nan if step is None else now / 10.0 ** packed["digits"])
    return np.array(values)


@pytest.mark.parametrize("size", [1e-9, 1.0, 3e5, 1e30])
def test_packed_numbers_are_finer_than_a_screen(size):
    values = size * np.append(np.random.default_rng(1).normal(size=500), np.nan)
    again = restored(steps(values))
    assert np.nanmax(np.abs(again - values)) <= 1e-3 * np.nanmax(np.abs(values))
    assert np.isnan(again[-1])
    assert np.isfinite(again[:-1]).all()


def test_a_constant_and_nothing_at_all_can_be_packed():
    np.testing.assert_allclose(restored(steps(np.full(3, 293.15))), 293.15)
    assert restored(steps(np.full(2, np.nan))).size == 2
    assert steps(np.empty(0))["steps"] == []


def test_names_from_files_are_text_and_not_markup(slim_run):
    evil = "</script><script>alert(1)</script>"
    (slim_run / "scenario.yaml").write_text(f"name: {evil}\n", encoding="utf-8")
    quality = json.loads((slim_run / "telemetry_quality.json").read_text(encoding="utf-8"))
    quality[0]["channel"] = evil
    (slim_run / "telemetry_quality.json").write_text(json.dumps(quality), encoding="utf-8")
    parameters = json.loads((slim_run / "priors.json").read_text(encoding="utf-8"))
    parameters[0]["unit"] = evil
    (slim_run / "priors.json").write_text(json.dumps(parameters), encoding="utf-8")
    page = write_report(slim_run).read_text(encoding="utf-8")
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert" in page
    for text in re.findall(r'<script type="text/plain"[^>]*>(.*?)</script>', page, re.S):
        assert not set("<>&") & set(text)


def test_the_scenario_is_named_and_folded(page):
    assert "<h1>Toy &lt;satellite&gt; &amp; friends</h1>" in page
    assert "<pre>name: Toy &lt;satellite&gt;" in page


@pytest.mark.parametrize("missing", list(STAGES))
def test_a_run_without_a_file_is_reported_and_the_file_named(slim_run, missing):
    (slim_run / missing).unlink()
    page = without_scripts(write_report(slim_run).read_text(encoding="utf-8"))
    assert f"({missing})" in page
    assert "The run is not complete" in page
    assert sections(page) == SECTIONS


@pytest.mark.parametrize("kept", ["genetic.nc", "posterior.nc", "prediction.nc"])
def test_a_run_with_one_file_alone_is_reported(slim_run, kept):
    for name in STAGES:
        if name != kept:
            (slim_run / name).unlink()
    page = write_report(slim_run).read_text(encoding="utf-8")
    assert sections(page) == SECTIONS


def test_a_run_of_the_genetic_algorithm_alone_has_its_figures(own_run):
    for name in ("posterior.nc", "diagnostics.json"):
        (own_run / name).unlink()
    with xr.open_datatree(own_run / "prediction.nc", engine="h5netcdf") as tree:
        windows = {
            name: group.to_dataset().load().drop_dims("simulation").drop_vars(["model_lower", "model_upper"])
            for name, group in tree.children.items()
        }
    point = {
        name: window.sel({"by": ["uncalibrated", "poorly_calibrated", "genetic"]}) for name, window in windows.items()
    }
    xr.DataTree.from_dict(point).to_netcdf(own_run / "prediction.nc", engine="h5netcdf")
    page = write_report(own_run).read_text(encoding="utf-8")
    assert "Figure 4." in page
    assert "Figure 6: there is no stochastic prediction" in page


def test_metrics_that_are_null_are_reported(slim_run):
    metrics = json.loads((slim_run / "metrics.json").read_text(encoding="utf-8"))
    for metric in metrics:
        metric["value"] = None
    (slim_run / "metrics.json").write_text(json.dumps(metrics), encoding="utf-8")
    assert "No scores on the window “test”" in write_report(slim_run).read_text(encoding="utf-8")


def test_the_run_is_only_read(slim_run):
    before = {p.name: p.read_bytes() for p in slim_run.iterdir()}
    write_report(slim_run)
    after = {p.name: p.read_bytes() for p in slim_run.iterdir() if p.name != "report.html"}
    assert after == before


def test_a_long_run_stays_a_small_page(own_run, tmp_path):
    with xr.open_datatree(own_run / "prediction.nc", engine="h5netcdf") as tree:
        window = tree["test"].to_dataset().load()
    size = 17_000
    long = window.isel(time=np.arange(size) % window.sizes["time"])
    long = long.assign_coords(time=window["time"].values[0] + np.arange(size) * np.timedelta64(180, "s"))
    long["observed"] = long["observed"] + np.random.default_rng(1).normal(size=long["observed"].shape)
    xr.DataTree.from_dict({"train": long, "test": long}).to_netcdf(own_run / "prediction.nc", engine="h5netcdf")
    page = write_report(own_run)
    assert 1.9e6 < page.stat().st_size < 2.5e6
    assert "extremes of each stretch" in page.read_text(encoding="utf-8")


def test_a_page_that_would_be_too_large_has_fewer_points(slim_run, monkeypatch):
    tried = []

    def draw(run, **_):
        tried.append(run.stretches)
        return "x" * 1_700 * run.stretches

    monkeypatch.setattr("flightcal.report.page.render", draw)
    assert write_report(slim_run).stat().st_size < 2.5e6
    assert tried == [1_500, 500]


def test_the_cost_of_an_effective_draw_is_that_of_the_worst_quantity(page):
    found = re.search(r"([\d,.\u202f ]+) gradients of the log density.*?, ([\d.]+) for each effective draw", page)
    worst = 900.0 - 20 * (len(names()) - 1)
    assert float(found.group(2)) == pytest.approx(31_250 / worst, abs=0.05)


def test_it_says_how_the_mode_was_sought_and_which_status_counts(page):
    assert "The mode was sought in open loop, and finished in closed loop." in page
    assert "start around the best of 1 found (open loop from prior draw 2)." in page
    assert "In the likelihood besides the temperatures: switch times of battery_htr." in page


def test_a_chain_that_ran_away_is_shown_and_warns_of_nothing(slim_run, recwarn):
    groups = {name: group.to_dataset() for name, group in read_tree(slim_run / "posterior.nc").children.items()}
    variable = next(iter(groups["posterior"].data_vars))
    values = groups["posterior"][variable].values.copy()
    values[0, 10:], values[1, 3:] = np.inf, 1e300
    groups["posterior"] = groups["posterior"].assign({variable: (("chain", "draw"), values)})
    xr.DataTree.from_dict(groups).to_netcdf(slim_run / "posterior.nc", engine="h5netcdf")
    write_report(slim_run)
    assert not [str(w.message) for w in recwarn if "flightcal" in w.filename or "arviz" in w.filename]


def test_the_name_is_read_as_yaml(run):
    assert _scenario_name(dataclasses.replace(run, scenario='name: "my sat"  # the second unit')) == "my sat"
    assert _scenario_name(dataclasses.replace(run, scenario="{")) == "run"
