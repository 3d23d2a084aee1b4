"""What the report says of a run with unmodelled heat."""

import dataclasses
import json

import numpy as np
import pytest
import xarray as xr

from flightcal.prediction import ANY
from flightcal.report.findings import unmodelled
from flightcal.report.panels import convergence, heat, parameters, prediction, scores
from flightcal.report.run_files import read_run

from .synthetic_run import every_finding, panels

NODES = ["panel", "battery", "payload"]
FLOW = [50.0, 10.0, 8.0]
PLACES = np.linspace(0.0, 1.0, 97)


def model(scale=0.05):
    """Heat of three nodes with one harmonic."""

    def of_nodes(part, share):
        names = [f"heat.{node}.{part}" for node in NODES]
        return [
            {"part": part, "scale": name, "size": share * flow, "node": k, "window": ""}
            for k, (name, flow) in enumerate(zip(names, FLOW, strict=True))
        ]

    gains = {"part": "gains", "scale": "heat.gains", "size": 0.05, "node": -1, "window": ""}
    groups = [*of_nodes("constant", scale), *of_nodes("pattern", scale), gains, *of_nodes("slow", 0.01)]
    shapes = [{"time": 300.0, "white_share": 0.5}] * 3
    return {"nodes": NODES, "flow": FLOW, "harmonics": 1, "groups": groups, "shapes": shapes}


def pattern(draws, places=PLACES):
    """Heat that comes again, [heat_draw, node, place] W."""
    shape = np.broadcast_to(draws, (len(draws), len(NODES), len(places)))
    return xr.DataArray(shape, {"node": NODES, "place": places}, ("heat_draw", "node", "place"))


def cosine(peak):
    """The same of no doubt: the battery's is a cosine of `peak` W, and the others have none."""
    return pattern(peak * np.array([0.0, 1.0, 0.0])[:, None] * np.cos(2 * np.pi * PLACES) * np.ones((2, 1, 1)))


def made(run, peak=0.5, gain=0.04, *, scale=0.05, slow=None, diagnostics=None, **kept):
    """The made-up run with heat; slow: W, of the battery's slow part; kept: further variables of its group."""
    sizes = run.posterior["posterior"].to_dataset().sizes
    draws = np.random.default_rng(5).normal(size=(sizes["chain"], sizes["draw"]))
    both = ("chain", "draw")
    values = {group["scale"]: group["size"] for group in model(scale)["groups"]} | {"heat.gains": gain}
    values |= {} if slow is None else {"heat.battery.slow": slow}
    groups = {name: group.to_dataset() for name, group in run.posterior.children.items()}
    groups["posterior"] = groups["posterior"].assign({n: (both, v * (1 + 0.1 * draws)) for n, v in values.items()})
    content = {"model": ((), json.dumps(model(scale))), "pattern": cosine(peak)}
    groups["heat"] = xr.Dataset(content | kept)
    tree = xr.DataTree.from_dict(groups)
    tree.attrs = run.posterior.attrs
    return dataclasses.replace(run, posterior=tree, diagnostics=diagnostics or run.diagnostics)


def gated(run, **failed):
    """Diagnostics whose gates are all passed but those that are named, and that of heat."""
    names = [g["name"] for g in run.diagnostics["gates"]] + ["response to heat"]
    gates = [
        {"name": n, "passed": n not in failed, "found": "a", "required": "b", "advice": failed.get(n, "")}
        for n in names
    ]
    words = "Converged: 4 chains of 250 draws agree."
    return run.diagnostics | {"gates": gates, "passed": not failed, "verdict": words}


def about(run, words):
    return next(f for f in every_finding(run) if words in f.title)


def section(run, name):
    return next(s for s in panels(run) if s.anchor == name)


def words_of(run, name):
    return " ".join(b.text for b in section(run, name).blocks)


def test_a_run_without_heat_has_no_panel_and_no_verdict_of_it(run):
    assert heat.panel(run) is None
    assert not any("heat" in f.title.lower() and "Heaters" not in f.title for f in every_finding(run))


def test_draws_of_the_pattern_give_its_mean_and_band(run):
    phase = np.linspace(0, 1, 11)
    of_draws = np.random.default_rng(2).normal(size=(4000, 3, 1)) + np.arange(3)[:, None]
    _, battery, _ = heat.node_heats(made(run, pattern=pattern(of_draws, phase)))
    low, high = battery.band
    assert battery.expected == pytest.approx(1.0, abs=5 / np.sqrt(4000))
    # Standard error of a 2.5% quantile of 4000 normal draws: 0.042.
    assert high - low == pytest.approx(3.92, abs=0.25)
    figure = heat.figure_pattern([battery])
    assert [t.name for t in figure.data if t.name] == ["95% interval", "expected pattern"]


def test_both_axes_of_the_figure_are_of_the_same_heat(run):
    battery = heat.node_heats(made(run))[1]
    layout = heat.figure_pattern([battery]).layout
    assert np.array(layout.yaxis2.range) == pytest.approx(100 * np.array(layout.yaxis.range) / battery.flow)
    assert layout.yaxis2.title.text == "% of 10.0 W"


def test_the_table_has_sizes_in_watts_and_as_shares_of_the_flow(run):
    heated = made(run, peak=0.5)
    table = heat.sizes(heat.node_heats(heated), heat.gains(heated))
    assert [row[0] for row in table.rows] == [*NODES, "gains of all nodes"]
    battery = table.rows[1]
    assert battery[1] == "10.0"
    assert battery[2].endswith("5.0% of the flow; prior 0.500")
    assert battery[3].endswith("5.0% of the flow; prior 0.500")
    assert battery[4] == "0.500\n5.0% of the flow"
    assert battery[5].endswith("1.0% of the flow; prior 0.100")
    assert battery[6] == "–"


def test_the_largest_heat_of_each_node_is_that_of_the_table(run):
    largest = heat.largest_heat(made(run, peak=0.5))
    assert next(iter(largest.items())) == ("battery", pytest.approx(0.05))
    assert sorted(largest) == sorted(NODES)


# The mean of a cosine's absolute values is 2 / pi of its peak.
@pytest.mark.parametrize(("peak", "mark", "state"), [(1.4, "–", ""), (1.8, "caution", "warn"), (5.0, "hide", "bad")])
def test_heat_that_is_large_beside_the_flow_is_marked_in_words(run, peak, mark, state):
    heated = made(run, peak=peak)
    table = heat.sizes(heat.node_heats(heated), heat.gains(heated))
    assert mark in table.rows[1][6]
    assert table.state(1, 6) == state
    assert table.rows[0][6] == "–"
    assert about(heated, "Unmodelled heat").state == (state or "good")


def test_heat_that_may_as_well_be_none_is_not_large(run):
    phase = np.linspace(0, 1, 11)
    for spread, share in ((1.0, 2.0 - 1.96), (0.1, 2.0 - 0.196)):
        draws = 2.0 + spread * np.random.default_rng(2).normal(size=(4000, 3, 1))
        heated = made(run, pattern=pattern(draws, phase))
        battery = heat.node_heats(heated)[1]
        # Standard error of a 2.5% quantile of 4000 normal draws: 0.042 deviations.
        assert battery.share == pytest.approx(share / battery.flow, abs=0.2 * spread / battery.flow)
        assert about(heated, "Unmodelled heat").state == ("good" if spread == 1.0 else "warn")


@pytest.mark.parametrize(("slow", "told"), [(0.2, False), (0.4, True)])
def test_heat_that_comes_and_goes_and_is_large_beside_the_flow_is_told(run, slow, told):
    heated = made(run, slow=slow)
    titles = [found.title for found in every_finding(heated) if found.state == "warn"]
    assert ("Much of the unmodelled heat comes and goes: battery, 4% of what flows" in titles) == told
    assert (heat.sizes(heat.node_heats(heated), None).state(1, 5) == "warn") == told


@pytest.mark.parametrize(
    ("target", "acts"),
    [
        ("nodes.battery.capacity", True),
        ("conductors.structure-battery.conductance", True),
        ("modes.imaging.battery", True),
        ("heaters.line.power", True),
        ("faces.top.absorptivity", False),
        ("nodes.battery_box.capacity", False),
        ("conductors.0.conductance", False),
    ],
)
def test_what_acts_on_a_node_with_much_heat_is_doubted_first(run, monkeypatch, target, acts):
    simulator = {"heaters": {"line": {"node": "battery"}}, "faces": {"top": {"node": "panel"}}, "conductors": [{}]}
    first, *others = (dataclasses.replace(info, target=()) for info in run.parameters if info.kind == "parameter")
    targeted = dataclasses.replace(first, target=(target,))
    assert unmodelled._acts_on(targeted, {"battery"}, simulator) == acts
    doubted = [*(info.name for info in others), first.name]
    monkeypatch.setattr(unmodelled, "widened", lambda _: doubted)
    known = dataclasses.replace(run, parameters=[*others, targeted], scenario=json.dumps({"simulator": simulator}))
    named = [words.rpartition(" ")[2] for words in unmodelled._doubted_by_heat(known, {"battery"})]
    assert named == ([first.name, *doubted[:-1]] if acts else doubted)


@pytest.mark.parametrize("measured", [True, False])
def test_the_duty_of_a_heater_without_a_status_is_doubted_beside_much_heat_in_its_node(run, measured):
    simulator = {"heaters": {"battery_heater": {"node": "battery"}, "payload_heater": {"node": "payload"}}}
    heated_run = dataclasses.replace(made(run, slow=0.4), scenario=json.dumps({"simulator": simulator}))
    heated_run.__dict__["heat"] = made(run, slow=0.4).heat
    if not measured:
        nothing = {name: window.assign(observed_duty_cycle=np.nan * window["observed_duty_cycle"])
                   for name, window in heated_run.windows.items()}  # fmt: skip
        heated = heated_run.heat
        heated_run = dataclasses.replace(heated_run, windows=nothing)
        heated_run.__dict__["heat"] = heated
    doubted = [limit for found in unmodelled.heat(heated_run) for limit in found.not_for]
    assert ("the duty cycle of battery_heater" in doubted) == (not measured)
    assert "the duty cycle of payload_heater" not in doubted


def test_heat_that_wanders_no_more_than_its_prior_expects_is_not_told(run):
    battery = heat.node_heats(made(run, slow=1.2))[1]
    assert battery.wandering == pytest.approx(0.12, rel=0.05)
    low, _, _ = battery.slow.quantiles
    wide = dataclasses.replace(battery, slow=dataclasses.replace(battery.slow, prior=1.1 * low))
    assert wide.wandering == 0.0


def test_large_gains_are_told(run):
    found = about(made(run, gain=0.2), "Unmodelled heat")
    assert found.state == "warn"
    assert "gains" in found.text


def test_gains_are_marked_as_the_verdict_judges_them(run):
    """By what they are for sure, not by their median."""
    heated = made(run, gain=0.11)
    assert about(heated, "Unmodelled heat").state == "good"
    assert heat.sizes([], heat.gains(heated)).rows[0][-1] == "–"


def test_a_constant_alone_is_heat_too_and_as_much_is_believed_as_the_scenario_expects(run):
    heated = made(run, scale=0.2, pattern=pattern(0.13 * np.array(FLOW)[:, None] * np.ones((2, 1, 1))))
    groups = [group for group in heated.heat["groups"] if group["part"] != "pattern"]
    heated.__dict__["heat"] = heated.heat | {"groups": groups}
    battery = heat.node_heats(heated)[1]
    assert (battery.pattern, battery.constant.prior, battery.allowed) == (None, 2.0, 4.0)
    assert battery.share == pytest.approx(0.13)
    assert about(heated, "Unmodelled heat").state == "good"


def test_what_telemetry_proves_at_most_is_the_largest_share(run):
    peaks = np.array([0.06 * 50.0, 0.09 * 10.0, 0.0])[:, None] * np.ones((2, 1, 1))
    heated = made(run, pattern=pattern(peaks))
    groups = [
        group | {"size": 4.0 * group["size"] if group["node"] == 1 else group["size"]}
        for group in heated.heat["groups"]
    ]
    heated.__dict__["heat"] = heated.heat | {"groups": groups}
    assert "no more than 9.0% of the mean heat through any node (battery)" in about(heated, "Unmodelled heat").text


def test_parameters_from_which_heat_takes_are_named(run):
    names = [info.name for info in run.sampled]
    sd = [float(run.posterior["posterior"][name].std()) for name in names]
    factors = {"battery_link": 3.0, "payload_link": 1.2}
    alone = xr.DataArray(
        [s / factors.get(n, 1.0) for s, n in zip(sd, names, strict=True)], {"parameter": names}, ("parameter",)
    )
    heated = made(run, deviation_without_heat=alone)
    table = parameters.summary(heated)
    column = table.header.index("with heat, times as wide")
    row = next(row for row in table.rows if row[0].startswith("battery_link"))
    assert row[column] == "3.0"
    assert {len(row) for row in table.rows} == {len(table.header)}
    assert "Heat takes most from battery_link (3.0):" in parameters.taken_by_heat(heated)
    assert "takes most from battery_link:" in about(heated, "Unmodelled heat").text
    assert "times as wide" not in " ".join(parameters.summary(made(run)).header)


def test_noise_that_is_held_says_at_what(run):
    extra = [
        dataclasses.replace(info, name=f"{info.name}.correlation_time", unit="s")
        for info in run.parameters
        if info.kind == "noise"
    ]
    heated = made(dataclasses.replace(run, parameters=[*run.parameters, *extra]))
    row = next(
        r for r in parameters.summary(heated).rows if r[0].startswith("noise.panel_temperature.correlation_time")
    )
    assert row[2] == "held at 300"


@pytest.mark.parametrize(
    ("scale", "state", "title"),
    [
        (0.05, "bad", "Unmodelled heat is implausibly large: battery"),
        (0.2, "warn", "Unmodelled heat is large: battery"),
        (0.3, "good", "Unmodelled heat is no larger than the scenario expects"),
    ],
)
def test_where_a_scenario_expects_more_heat_more_is_believed(run, scale, state, title):
    """Half of what flows, of which the scenario expects a twentieth, a fifth or almost a third."""
    found = about(made(run, peak=8.0, scale=scale), "Unmodelled heat is")
    assert (found.state, found.title[: len(title)]) == (state, title)


def test_a_failed_gate_of_heat_forbids_the_parameters_alone(run):
    heated = made(run, diagnostics=gated(run, **{"response to heat": "Narrow the priors."}))
    first = every_finding(heated)[0]
    assert (first.state, first.not_for) == ("warn", ("parameters",))
    assert first.title == "Do not rely on the parameters: the response to heat is not linear"
    assert "Converged" not in first.text
    assert about(heated, "On unseen telemetry").text.endswith("rests on parameters that cannot be relied on.")


def test_several_failed_gates_do_not_say_that_the_chains_converged(run):
    failed = {"response to heat": "Narrow the priors.", "R-hat": "Draw more."}
    first = every_finding(made(run, diagnostics=gated(run, **failed)))[0]
    assert first.title == "The chains have not converged: R-hat, a"
    assert first.text == "2 of 7 gates are not passed. Do not rely on this posterior."


def test_passed_gates_judge_the_sampling_alone(run):
    first = every_finding(made(run, diagnostics=gated(run)))[0]
    assert first.state == "good"
    assert "judges the sampling, not the model" in first.text


def test_residuals_on_unseen_windows_may_be_correlated_with_heat(run):
    assert {c.verdict for c in made(run).checks["test"]} <= {"white", "slight", "expected"}
    assert "contradicted" in {c.verdict for c in run.checks["test"]}


def test_how_the_mode_was_sought_is_told_with_heat(run):
    tree = made(run).posterior
    tree.attrs = tree.attrs | {
        "mode_search": json.dumps(
            {"sought": "in closed loop", "modes": [{"origin": "prior draw 1", "log_density": 1.0, "converged": True}]}
        )
    }
    blocks = convergence.panel(dataclasses.replace(run, posterior=tree)).blocks
    assert any(b.text.startswith("The mode was sought without unmodelled heat, heaters driven by") for b in blocks)


def test_the_published_run_stands_beside(own_run):
    metrics = json.loads((own_run / "metrics.json").read_text(encoding="utf-8"))
    records = [
        {"model": "published", "value": 2 * m["value"]}
        | {key: m[key] for key in ("method", "window", "channel", "metric")}
        for m in metrics
        if m["channel"] == "all" and m["method"] == "stochastic" and m["metric"] in ("rmse", "picp")
    ]
    (own_run / "beside.json").write_text(json.dumps(records), encoding="utf-8")
    run = read_run(own_run)
    table = scores.beside(run)
    assert [row[:2] for row in table.rows if row[1] == "RMSE, K"] == [["train", "RMSE, K"], ["test", "RMSE, K"]]
    _, _, genetic, published, ours = next(r for r in table.rows if r[:2] == ["test", "RMSE, K"])
    assert float(published) == pytest.approx(2 * float(ours), rel=2e-3)
    assert genetic == "0.4110"
    assert "Beside other models" in words_of(run, "scores")


def test_every_model_stands_beside_by_channel(own_run):
    metrics = json.loads((own_run / "metrics.json").read_text(encoding="utf-8"))
    records = [
        {"model": model, "value": scale * m["value"]}
        | {key: m[key] for key in ("method", "window", "channel", "metric")}
        for model, scale in (("published", 2.0), ("reduced", 0.5))
        for m in metrics
        if m["method"] == "stochastic" and m["metric"] in ("rmse", "picp")
    ]
    (own_run / "beside.json").write_text(json.dumps(records), encoding="utf-8")
    table = scores.beside_by_channel(read_run(own_run))
    assert table.header[2:5] == ("published model", "this run", "reduced model")
    for row in table.rows:
        published, ours, reduced = map(float, row[2:5])
        assert (published, reduced) == (pytest.approx(2 * ours, abs=2e-3), pytest.approx(0.5 * ours, abs=2e-3))
        assert float(row[7].rstrip("%")) == pytest.approx(0.5 * float(row[6].rstrip("%")), abs=0.11)


def test_without_a_published_run_nothing_stands_beside(run):
    assert scores.others(run) == []


def test_what_training_did_not_contain_is_told_the_most_first(run):
    window = run.windows["test"].copy()
    assert prediction.unseen(window) == ""
    window.attrs["unseen"] = json.dumps(
        [
            {"name": "Sun from above", "share": 0.12},
            {"name": ANY, "share": 0.4},
            {"name": "mode imaging", "share": 0.33},
        ]
    )
    words = prediction.unseen(window)
    assert words.startswith(
        "40% of the time lies outside of what training contained: mode imaging (33%), Sun from above"
    )
    changed = dataclasses.replace(run, windows=run.windows | {"test": window})
    assert f"Window “test”: {words}" in words_of(changed, "prediction")
