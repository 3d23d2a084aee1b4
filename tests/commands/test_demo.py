"""The demonstration: three ways to calibrate one satellite, and the page that has them beside each other."""

import dataclasses
import json
import shutil

import pytest
from ruamel.yaml import YAML

from flightcal.commands import demo
from tests import small
from tests.commands.test_calibrate import write


@pytest.fixture(scope="module")
def satellite(tmp_path_factory):
    """A folder as the bundled satellite's, whose `reduce.yaml` is a scenario, which takes less time."""
    folder = tmp_path_factory.mktemp("satellite")
    first = write(
        folder,
        genetic={"population": 8, "generations": 4},
        nuts={"draws": 50, "warmup": 50},
        prediction={"simulations": 20},
    )
    content = YAML(typ="safe").load(first)
    for name in ("published.yaml", "reduce.yaml"):
        shutil.copy(first, folder / name)
    with first.open("w") as file:
        YAML(typ="safe").dump(content | {"noise": {"model": "ar1"}}, file)
    return folder


@pytest.fixture(scope="module")
def demonstrated(satellite, tmp_path_factory):
    """The demo's folder, its runs, and before each its name and whether a page with the published model is there."""
    out, seen = tmp_path_factory.mktemp("demo") / "run", []
    whole = demo.run_experiment

    def experiment(file, folder, **options):
        page = out / "report.html"
        seen.append((folder.name, page.exists() and "published model" in page.read_text(encoding="utf-8")))
        return whole(file, folder, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demo, "run_experiment", experiment)
        small.unsuspected(patch)
        return out, demo.run_demo(out, satellite), seen


def test_a_demo_keeps_the_scores_of_the_other_models_beside_its_own(demonstrated):
    out, runs, _ = demonstrated
    assert {name: run.run for name, run in runs.items()} == {
        "flightcal": out, "published": out / "published", "reduced": out / "reduced",
    }  # fmt: skip
    kept = [
        {"model": name, "method": m.method, "window": m.window, "channel": m.channel, "metric": m.metric}
        for name in ("published", "reduced")
        for m in runs[name].metrics
        if m.method in ("genetic", "stochastic")
        and m.metric in ("rmse", "mape_kelvin", "mape_celsius", "crps", "picp", "mpiw")
    ]
    records = json.loads((out / "beside.json").read_text())
    assert [{field: record[field] for field in kept[0]} for record in records] == kept
    assert (out / "genetic.nc").read_bytes() == (out / "published" / "genetic.nc").read_bytes()
    assert runs["flightcal"].metrics != runs["published"].metrics
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "reduced model" in page


def test_a_page_of_the_demo_is_there_before_the_reduced_model_is_calibrated(demonstrated):
    _, _, seen = demonstrated
    assert seen == [("run", False), ("published", False), ("reduced", True)]


def test_a_demo_goes_no_further_than_an_interrupted_run(satellite, demonstrated, tmp_path, monkeypatch):
    whole = demo.run_experiment

    def interrupted(file, folder, **options):
        return dataclasses.replace(whole(file, folder, **options), interrupted=folder.name == "published")

    out = shutil.copytree(demonstrated[0], tmp_path / "run")
    monkeypatch.setattr(demo, "run_experiment", interrupted)
    assert list(demo.run_demo(out, satellite)) == ["flightcal", "published"]
