"""`flightcal compare`: which models it makes of a scenario, what it recommends and why, and its page."""

import json
import re
from io import StringIO
from types import SimpleNamespace

import numpy as np
import pytest
import xarray
from rich.console import Console
from typer.testing import CliRunner

from flightcal import validation
from flightcal.cli import USER_ERROR, app
from flightcal.commands import compare
from flightcal.commands.backtest import Backtest
from flightcal.commands.calibrate import Summary
from flightcal.commands.display import print_in_short
from flightcal.errors import RunError
from flightcal.prediction import Metric
from flightcal.progress import SILENT
from flightcal.report import write_comparison
from flightcal.run import plain, write_netcdf
from flightcal.scenario import NOISE_BESIDE_HEAT, heat_of, load_scenario, noise_of, resolved_yaml
from flightcal.validation import MODELS, comparison_of, models_of, scored_by_all, variant
from flightcal.validation.comparison import backtest_summary, recommend, recommend_by_backtest
from tests import small
from tests.commands.test_calibrate import write
from tests.commands.test_display import printed
from tests.external import scenes
from tests.told import Told

LATER = {"start": "2024-03-01T00:40:00", "end": "2024-03-01T01:10:00"}

run = CliRunner().invoke


def means(**of_models):
    names = ("rmse", "mape_kelvin", "picp", "mpiw", "crps", "log_score")
    return {model: dict(zip(names, values, strict=True)) for model, values in of_models.items()}


@pytest.mark.parametrize("model", MODELS)
def test_every_model_of_a_scenario_is_a_scenario_without_findings(tmp_path, model):
    written = small.content()
    written["observations"]["body_temp"]["noise"] = {
        "distribution": "student_t", "standard_deviation": {"half_normal": "0.5 K"}
    }  # fmt: skip
    written["discrepancy"] = {"phase": {"harmonics": 5}, "channels": ["panel_temp"]}
    scenario, _ = small.load(tmp_path, written)
    file = tmp_path / "variant.yaml"
    file.write_text(resolved_yaml(variant(scenario, model), absolute=True), encoding="utf-8")
    found = load_scenario(file)
    noise = noise_of(found, "body_temp")
    assert (noise.model, noise.distribution) == {
        "iid": ("iid", "student_t"),
        "ar1": ("ar1", "normal"),
        "phase+ar1": ("ar1", "normal"),
    }.get(model, ("iid", "normal"))
    assert (heat_of(found) is not None) == (model == "heat")
    assert noise.standard_deviation.scale == 0.5
    assert noise_of(found, "panel_temp").standard_deviation == 0.1
    assert (found.discrepancy is not None) == (model in ("phase", "phase+ar1"))
    if found.discrepancy is not None:
        assert (found.discrepancy.phase.harmonics, found.discrepancy.channels) == (5, ("panel_temp",))


@pytest.mark.parametrize("model", MODELS[1:])
def test_no_other_model_has_heat_nor_the_noise_beside_it(tmp_path, model):
    written = small.content()
    plain = variant(small.load(tmp_path, written)[0], model)
    with_heat = variant(small.load(tmp_path, written | {"heat": {}})[0], model)
    assert heat_of(with_heat) is None
    assert noise_of(with_heat, "body_temp") == noise_of(plain, "body_temp")


def test_with_heat_a_scenario_is_as_by_default(tmp_path):
    written = small.content()
    plain = small.load(tmp_path, written | {"heat": "none"})[0]
    heated = variant(plain, "heat")
    assert heat_of(heated) == heat_of(small.load(tmp_path, written | {"heat": {}})[0])
    assert noise_of(heated, "body_temp") == NOISE_BESIDE_HEAT
    narrow = {"pattern": {"scale": 0.01}}
    assert heat_of(variant(small.load(tmp_path, written | {"heat": narrow})[0], "heat")).pattern.scale == 0.01
    noise = {"model": "ar1", "standard_deviation": {"half_normal": "0.3 K"}}
    scenario = small.load(tmp_path, written | {"heat": {}, "noise": noise})[0]
    assert noise_of(variant(scenario, "heat"), "body_temp").standard_deviation.scale == 0.3


def test_a_simulator_that_takes_no_heat_is_compared_without(tmp_path):
    scenario = small.load(tmp_path, small.content())[0]
    assert models_of(scenario) == MODELS
    no_nodes = scenario.simulator.model_copy(update={"nodes": {}})
    assert models_of(scenario.model_copy(update={"simulator": no_nodes})) == MODELS[1:]


@pytest.mark.parametrize(("model", "scale"), [("iid", 2.0), ("phase", 2.0), ("ar1", 0.1), ("phase+ar1", 0.1)])
def test_the_prior_of_correlated_noise_is_not_that_of_independent_noise(tmp_path, model, scale):
    written = small.content()
    written["noise"] = {"model": "ar1", "standard_deviation": {"half_normal": "0.1 K"}, "white": "0.05 K"}
    found = noise_of(variant(small.load(tmp_path, written)[0], model), "body_temp")
    assert found.standard_deviation.scale == scale
    assert found.white == (0.05 if model.endswith("ar1") else None)


def test_the_best_log_score_among_models_that_can_be_used_is_recommended():
    found = means(
        iid=(1.0, 0.3, 0.95, 4.0, 0.60, -1.5),
        ar1=(1.0, 0.3, 0.97, 5.0, 0.62, -1.6),
        phase=(0.6, 0.2, 0.94, 2.4, 0.35, -0.9),
    )
    found["phase+ar1"] = dict(found["phase"], log_score=-0.5, crps=0.3)
    best, reason = recommend(found, ["iid", "ar1", "phase"])
    assert best == "phase"
    assert "covers 94.0%" in reason
    assert "not converged or not to be used: phase+ar1" in reason
    assert "CRPS 0.35 K instead of 0.6 K (-42%)" in reason
    assert recommend(found, list(found))[0] == "phase+ar1"


def scored(log_score):
    return [
        Metric("stochastic", "test", "all", name, value, "K")
        for name, value in (("rmse", 1.0), ("picp", 0.95), ("log_score", log_score), ("crps", 0.5))
    ]


def test_a_model_whose_own_verdict_is_against_its_use_is_recommended_only_where_all_are(tmp_path):
    metrics, passed = {"iid": scored(2.0), "heat": scored(1.0)}, {"iid": True, "heat": True}
    content = plain(comparison_of("Toy", metrics, passed, ["iid"]))
    assert content["recommended"] == "heat"
    assert "not to be used: iid" in content["reason"]
    (tmp_path / "comparison.json").write_text(json.dumps(content | {"interval": 0.95}))
    page = write_comparison(tmp_path).read_text(encoding="utf-8")
    assert "Not to be used, by their own verdict: iid" in page
    assert comparison_of("Toy", metrics, passed, ["iid", "heat"])["recommended"] == "iid"
    assert comparison_of("Toy", metrics, passed)["recommended"] == "iid"


def test_an_interval_that_does_not_cover_is_not_recommended_without_caution():
    found = means(iid=(1.0, 0.3, 0.95, 4.0, 0.6, -1.5), phase=(0.4, 0.1, 0.84, 1.2, 0.3, -0.8))
    best, reason = recommend(found, list(found))
    assert best == "phase"
    assert "where coverage matters more than sharpness, use 'iid', whose interval covers 95.0%" in reason
    found["iid"]["picp"] = 0.7
    assert "No model's interval covers" in recommend(found, list(found))[1]


def test_scores_are_those_of_unseen_windows_and_the_page_shows_them(tmp_path):
    def metrics(factor):
        return [
            Metric(method, window, channel, metric, value * factor, "K")
            for method in ("genetic", "stochastic")
            for window in ("train", "test", "later")
            for channel in ("body", "all")
            for metric, value in (("rmse", 1.0 if window == "test" else 3.0), ("picp", 0.9), ("log_score", 1.0))
        ]

    content = plain(comparison_of("Toy", {"iid": metrics(1.0), "phase": metrics(1.05)}, {"iid": True, "phase": False}))
    assert content["means"]["iid"]["rmse"] == pytest.approx(2.0)
    assert content["means"]["iid"]["mpiw"] is None
    assert {row["window"] for row in content["scores"]} == {"test", "later"}
    assert content["recommended"] == "iid"
    scores = content["means"]["iid"] | {"rmse": 4.321, "passed": False}
    content["left_out"] = {"iid": {"june": scores}}
    (tmp_path / "comparison.json").write_text(json.dumps(content | {"interval": 0.8}))
    page = write_comparison(tmp_path).read_text(encoding="utf-8")
    assert "Recommended: iid" in page
    assert "inside the 80% interval, to be near 80%" in page
    assert "Not converged: phase" in page
    assert "Training windows left out" in page
    assert "4.32" in page


def rolling(crps, held, *, passed=True):
    whole = {"origin": "all", "channel": "all", "band": "all", "rmse": 1.0, "coverage": 0.93, "coverage_error": 0.02}
    whole |= {"width": 4.0, "crps": crps}
    return {"scores": [whole | {"channel": "body"}, whole], "held": held, "origins": [{}] * 5, "passed": passed}


def test_backtests_recommend_the_lowest_crps_and_name_what_holds_more_often():
    found = {"iid": rolling(0.6, 5), "phase": rolling(0.4, 3), "phase+ar1": rolling(0.3, 2, passed=False)}
    summaries = {model: backtest_summary(content) for model, content in found.items()}
    best, reason = recommend_by_backtest(summaries, ["iid", "phase"])
    assert best == "phase"
    assert (
        "lowest CRPS of those that can be used, 0.4 K. Its interval covers 93.0% and held after 3 of 5 origins"
        in reason
    )
    assert "use 'iid': held after 5, CRPS 0.6 K" in reason
    assert "A lower CRPS, but not converged or not to be used: phase+ar1 (0.3 K, held after 2)" in reason
    summaries.pop("phase+ar1")
    assert "has the lowest CRPS, 0.4 K" in recommend_by_backtest(summaries, list(summaries))[1]


def test_a_comparison_with_backtests_is_ranked_by_them(tmp_path):
    metrics = [
        Metric("stochastic", "test", "all", name, value, "K")
        for name, value in (("rmse", 1.0), ("picp", 0.95), ("log_score", 1.0), ("crps", 0.5))
    ]
    backtests = {"iid": rolling(0.6, 5), "phase": rolling(0.4, 4)}
    passed = {"iid": True, "phase": True}
    content = plain(comparison_of("Toy", {"iid": metrics, "phase": metrics}, passed, backtests=backtests))
    assert content["recommended"] == "phase"
    (tmp_path / "comparison.json").write_text(json.dumps(content | {"interval": 0.95}))
    page = write_comparison(tmp_path).read_text(encoding="utf-8")
    assert "Rolling origins" in page
    assert "4 of 5" in page
    without = plain(comparison_of("Toy", {"iid": metrics, "phase": metrics}, passed))
    assert without["backtest"] == {}


def predicted(error, seed=0, size=400, unscored=10):
    """Telemetry of two channels around a prediction of 0.5 K standard deviation, off by `error` (K) besides.

    unscored: first samples that are not scored.
    """
    rng = np.random.default_rng(seed)
    observed = 290.0 + 0.5 * rng.normal(size=(size, 2))
    by_method = ("by", "time", "channel")
    return xarray.Dataset(
        {
            "observed": (("time", "channel"), observed),
            "scored": ("time", np.arange(size) >= unscored),
            "mean": (by_method, np.full((1, size, 2), 290.0 + error)),
            "lower": (by_method, np.full((1, size, 2), 289.0 + error)),
            "upper": (by_method, np.full((1, size, 2), 291.0 + error)),
            "standard_deviation": (by_method, np.full((1, size, 2), 0.5)),
            "crps": (("time", "channel"), np.abs(observed - 290.0 - error)),
        },
        {
            "time": small.START + np.arange(size) * np.timedelta64(60, "s"),
            "channel": ["body", "panel"],
            "by": ["stochastic"],
        },
        {"origin": str(small.START)},
    )


def keep(prediction, file, name="test"):
    """A file of one prediction."""
    file.parent.mkdir(parents=True, exist_ok=True)
    write_netcdf(file, xarray.DataTree.from_dict({name: prediction}))


def lost_first(model, error=0.0):
    """A prediction that is 20 K off in the first ten samples, which the model heat alone scores."""
    found = predicted(error, unscored=0 if model == "heat" else 10)
    for name in ("mean", "lower", "upper"):
        found[name][0, :10] += 20.0
    return found.assign(crps=abs(found["observed"] - found["mean"][0]))


def test_models_are_held_to_the_samples_that_all_of_them_score():
    models = {model: {"test": lost_first(model)} for model in ("heat", "iid")}
    found = scored_by_all(models)
    for model, windows in found.items():
        np.testing.assert_array_equal(windows["test"]["scored"], models["iid"]["test"]["scored"], err_msg=model)
    assert models["heat"]["test"]["scored"].all()
    assert scored_by_all({}) == {}


@pytest.mark.parametrize(("error", "recommended"), [(0.01, None), (0.4, "phase")])
def test_nothing_is_recommended_on_a_difference_within_its_error(tmp_path, error, recommended):
    def metrics(score):
        return [
            Metric("stochastic", "test", "all", name, value, "K")
            for name, value in (("rmse", 1.0), ("picp", 0.95), ("log_score", score), ("crps", 0.5))
        ]

    scores = {"iid": metrics(-0.75), "phase": metrics(-0.7), "ar1": metrics(-0.8)}
    passed = {"iid": True, "phase": True, "ar1": False}
    predictions = {
        "iid": {"test": predicted(error)}, "phase": {"test": predicted(0.0)}, "ar1": {"test": predicted(0.0)},
    }  # fmt: skip
    content = plain(comparison_of("Toy", scores, passed, predictions=predictions))
    assert content["recommended"] == recommended
    # The mean of (error^2 - 2 error noise) / (2 deviation^2), but for the chance of the noise.
    assert content["differences"]["iid"]["worse"] == pytest.approx(error**2 / 0.5, abs=4 * error / 0.5 / np.sqrt(780))
    words = "cannot be told from 'iid'"
    assert (words in content["reason"]) == (recommended is None)
    assert "'ar1'" not in content["reason"].split(" worse)")[0]
    (tmp_path / "comparison.json").write_text(
        json.dumps(content | {"failed_gates": {"ar1": ["R-hat 1.2 (link)"]}, "interval": 0.95})
    )
    page = write_comparison(tmp_path).read_text(encoding="utf-8")
    assert ("No model is recommended" in page) == (recommended is None)
    assert "ar1: R-hat 1.2 (link)" in page


def test_the_error_of_a_difference_counts_effective_samples():
    rng = np.random.default_rng(2)
    slow = np.repeat(rng.normal(size=13), 30)[:390]
    other = predicted(0.0)
    other["mean"][0, 10:] += 0.3 * slow[:, None]
    white = predicted(0.0)
    white["mean"][0, 10:] += 0.3 * rng.permutation(slow)[:, None]
    passed = {"iid": True, "phase": True}
    metrics = {model: [Metric("stochastic", "test", "all", "log_score", k, "nat")] for k, model in enumerate(passed)}

    def error(prediction):
        both = {"phase": {"test": predicted(0.0)}, "iid": {"test": prediction}}
        return comparison_of("Toy", metrics, passed, predictions=both)["differences"]["iid"]["standard_error"]

    assert error(other) > 1.5 * error(white)


@pytest.mark.parametrize(("scatter", "recommended"), [(0.02, "phase"), (0.5, None)])
def test_after_a_backtest_a_difference_is_held_to_its_scatter_over_origins(scatter, recommended):
    metrics = [Metric("stochastic", "test", "all", "log_score", 1.0, "nat")]
    backtests = {"iid": rolling(0.6, 5), "phase": rolling(0.4, 4)}
    for k, (content, mean) in enumerate(zip(backtests.values(), (0.6, 0.4), strict=True)):
        content["scores"] += [
            {"origin": str(n), "channel": "all", "band": "all", "crps": mean + scatter * (-1) ** (n + k)}
            for n in range(6)
        ]
    passed = {"iid": True, "phase": True}
    found = comparison_of("Toy", dict.fromkeys(passed, metrics), passed, backtests=backtests)
    assert found["recommended"] == recommended
    assert found["differences"]["iid"]["worse"] == pytest.approx(0.2)


def test_a_model_that_failed_a_gate_is_named_with_the_gate(tmp_path):
    values = {"rmse": 1.0, "mape_kelvin": 0.3, "picp": 0.95, "mpiw": 4.0, "crps": 0.6, "log_score": -1.0}
    shares = {"all": 0.95, "body": 0.9, "panel": 1.0}
    content = {
        "models": ["iid", "ar1"], "means": {"iid": values, "ar1": values}, "interval": 0.95, "useless": [],
        "scores": [
            {"model": "iid", "window": "test", "channel": name, "picp": share} for name, share in shares.items()
        ],
        "left_out": {}, "backtest": {}, "recommended": None,
        "reason": "Nothing is recommended.", "passed": {"iid": True, "ar1": False},
        "failed_gates": {"iid": [], "ar1": ["R-hat 1.023 (link)", "divergences 12"]},
    }  # fmt: skip
    (tmp_path / "comparison.json").write_text(json.dumps(content), encoding="utf-8")
    lines = printed(print_in_short, tmp_path, "comparison", tmp_path / "comparison.html")
    assert "! caution: Not converged: ar1" in lines
    assert "  - ar1: R-hat 1.023 (link), divergences 12" in lines
    assert "! caution: No model is recommended" in lines
    assert "  - iid covers least: 90.0% of body in “test”." in lines
    # Where a terminal is too narrow for all columns, those that fit are whole.
    written = StringIO()
    print_in_short(tmp_path, "comparison", tmp_path / "comparison.html", Console(file=written, width=41))
    row = next(line for line in written.getvalue().splitlines() if line.startswith("ar1"))
    assert row.split() == ["ar1", "1.00", "0.300", "95.0%", "4.00", "0.600"]
    gates = [
        {"name": "R-hat", "found": "1.2 (link)", "required": "1.01", "passed": False},
        {"name": "divergences", "found": "0", "required": "0", "passed": True},
    ]
    summary = Summary(
        tmp_path, tmp_path, {"passed": False, "gates": gates}, (), False, SimpleNamespace(exit_code=0), {}
    )
    assert compare._failed(summary) == ["R-hat 1.2 (link)"]


def test_a_simulator_that_no_backtest_takes_is_refused_before_the_first_model(tmp_path, monkeypatch):
    monkeypatch.setattr(compare, "run_experiment", lambda *_, **__: pytest.fail("a model was calibrated"))
    content = scenes.written({"callable": {"file": "model.py"}}, windows={"later": LATER})
    (tmp_path / "model.py").write_text("def simulate(inputs, times, start): ...\n", encoding="utf-8")
    with pytest.raises(RunError, match="without derivatives"):
        compare.compare_models(scenes.write(tmp_path, content), tmp_path / "out", ["iid", "ar1"], backtest=True)
    assert not (tmp_path / "out").exists()


def test_each_model_is_backtested_if_asked_for_on_samples_that_all_score(tmp_path, monkeypatch):
    asked = []

    def experiment(file, run, *, searched=None, progress=SILENT):
        keep(lost_first(run.name), run / "prediction.nc")
        return Summary(run, run / "report.html", {"passed": True}, (), False, SimpleNamespace(exit_code=0), {})

    def backtested(file, out, *, progress=SILENT):
        asked.append((file.name, out.name))
        model = out.name.removesuffix("_backtest")
        keep(lost_first(model, 0.0 if model == "heat" else 0.3), out / "backtest.nc", "origin")
        return Backtest(out, out / "report.html", rolling(9.0, 5) | {"period": small.PERIOD})

    monkeypatch.setattr(compare, "run_experiment", experiment)
    monkeypatch.setattr(compare, "backtest_scenario", backtested)
    told = Told()
    found = compare.compare_models(write(tmp_path), tmp_path / "out", ["iid", "heat"], backtest=True, progress=told)
    assert re.fullmatch(r"2 models: 12 calibrations; sampling takes about \d+ (s|min) in all", told.said[0])
    assert asked == [("iid.yaml", "iid_backtest"), ("heat.yaml", "heat_backtest")]
    assert found.content["recommended"] == "heat"
    # The mean distance of a normal variable from its middle.
    assert found.content["backtest"]["heat"]["crps"] == pytest.approx(0.5 * np.sqrt(2.0 / np.pi), rel=0.1)
    assert found.content["means"]["heat"] == found.content["means"]["iid"]


def test_a_window_from_the_end_of_training_on_is_compared_on_samples_that_all_score(tmp_path, monkeypatch):
    def experiment(file, run, *, searched=None, progress=SILENT):
        keep(lost_first(run.name, 0.0 if run.name == "heat" else 0.4), run / "prediction.nc")
        return Summary(run, run / "report.html", {"passed": True}, (), False, SimpleNamespace(exit_code=0), {})

    monkeypatch.setattr(compare, "run_experiment", experiment)
    found = compare.compare_models(write(tmp_path), tmp_path / "out", ["iid", "heat"])
    assert found.content["recommended"] == "heat"
    assert found.content["differences"]["iid"]["worse"] == pytest.approx(0.32, abs=0.1)


@pytest.mark.parametrize(("models", "message"), [("iid", "two or more"), ("iid,ar2", "found ar2")])
def test_models_that_are_none_are_a_message(tmp_path, models, message):
    result = run(app, ["compare", str(write(tmp_path)), "--models", models, "--out", str(tmp_path / "out")])
    assert result.exit_code == USER_ERROR
    assert message in result.output
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_discrepancy_is_recommended_where_the_simulator_lacks_a_load(tmp_path):
    file = write(tmp_path, nuts={"draws": 200, "warmup": 200}, genetic={"runs": 2})
    text = (tmp_path / "telemetry.csv").read_text().splitlines()
    rows = [line.split(",") for line in text]
    place = rows[0].index("body")
    for k, row in enumerate(rows[1:]):
        # What comes again in every orbit and the model lacks: 0.8 K.
        row[place] = f"{float(row[place]) + 0.8 * np.sin(4 * np.pi * 60 * k / small.PERIOD):.4f}"
    (tmp_path / "telemetry.csv").write_text("\n".join(map(",".join, rows)) + "\n")
    found = compare.compare_models(file, tmp_path / "out", ["iid", "phase"])
    print(found.content["means"], found.content["reason"])
    assert found.content["recommended"] == "phase"
    assert found.content["means"]["phase"]["crps"] < 0.8 * found.content["means"]["iid"]["crps"]
    assert (tmp_path / "out" / "comparison.html").exists()
    assert (tmp_path / "out" / "phase" / "report.html").exists()


def test_an_interrupted_sampling_ends_the_comparison_and_what_was_left_out_is_kept(tmp_path, monkeypatch):
    scenario_file, out = write(tmp_path), tmp_path / "out"
    ran = []

    def experiment(file, run, *, searched=None, progress=SILENT):
        run.mkdir(parents=True, exist_ok=True)
        ran.append(run.name)
        return Summary(run, run / "report.html", {"passed": True}, (), run.name == "ar1", None, {})

    monkeypatch.setattr(compare, "run_experiment", experiment)
    with pytest.raises(KeyboardInterrupt):
        compare.compare_models(scenario_file, out, ["iid", "ar1", "phase"])
    assert ran == ["iid", "ar1"]
    asked = []
    monkeypatch.setattr(validation, "leave_windows_out", lambda *_, **__: asked.append(1) or {"june": {"picp": 0.9}})
    summary = experiment(out / "iid.yaml", out / "iid")
    for _ in range(2):
        assert compare._left_out(out / "iid.yaml", summary, SILENT) == {"june": {"picp": 0.9}}
    assert len(asked) == 1


def test_scores_of_windows_left_out_stand_in_the_comparison_if_asked_for(tmp_path, monkeypatch):
    values = {"rmse": 1.0, "mape_kelvin": 0.3, "picp": 0.95, "mpiw": 4.0, "crps": 0.6, "log_score": -1.0}

    def experiment(file, run, *, searched=None, progress=SILENT):
        keep(predicted(0.0), run / "prediction.nc")
        return Summary(run, run / "report.html", {"passed": True}, (), False, SimpleNamespace(exit_code=0), {})

    monkeypatch.setattr(compare, "run_experiment", experiment)
    monkeypatch.setattr(validation, "check_windows", lambda _: None)
    scores = values | {"passed": True}
    monkeypatch.setattr(validation, "leave_windows_out", lambda *_, **__: {"june": scores})
    for asked in (False, True):
        out = tmp_path / str(asked)
        compare.compare_models(write(tmp_path), out, ["iid", "ar1"], leave_windows_out=asked)
        found = json.loads((out / "comparison.json").read_text(encoding="utf-8"))["left_out"]
        assert found == ({"iid": {"june": scores}, "ar1": {"june": scores}} if asked else {})


def test_no_file_of_a_users_folder_is_replaced(tmp_path):
    file = write(tmp_path)
    result = run(app, ["compare", str(file), "--models", "iid,ar1", "--out", str(tmp_path)])
    assert result.exit_code == USER_ERROR
    assert "the folder holds files but no comparison" in result.output
    assert not (tmp_path / "iid.yaml").exists()
