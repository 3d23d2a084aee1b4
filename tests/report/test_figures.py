"""Figures: what they show, in which unit, and that every axis is labelled."""

import dataclasses

import numpy as np
import plotly.graph_objects as go
import pytest
import xarray as xr

from flightcal.report.heat_map import figure_correlation
from flightcal.report.panels.before import figure_heater_status, poorly_in_words
from flightcal.report.panels.convergence import figure_genetic_history, figure_genetic_spread, figure_traces
from flightcal.report.panels.densities import figure_density
from flightcal.report.panels.pairs import figure_pairs, most_correlated
from flightcal.report.panels.prediction import figure_stochastic
from flightcal.report.panels.reliability import figure_reliability
from flightcal.report.panels.residuals import figure_residual_distribution, figure_residuals
from flightcal.report.run_files import draws
from flightcal.report.style import DARK, METHODS
from flightcal.report.windows import figure_point, unknown_stretches

BINS = 400


def trace(figure, name, row=1):
    axis = "y" if row == 1 else f"y{row}"
    return next(t for t in figure.data if t.name == name and (t.yaxis or "y") == axis)


def chains(run, name):
    return draws(run.posterior, "posterior", [name])[..., 0]


@pytest.fixture(scope="module")
def everything(run) -> dict[str, go.Figure]:
    """Every kind of figure."""
    window = run.windows["test"]
    infos = run.parameters
    values = draws(run.posterior, "posterior", [i.name for i in infos])
    flat = values.reshape(-1, len(infos))
    link = next(i for i in infos if i.name == "battery_link")
    part = infos[:8]
    return {
        "point": figure_point(window, ["genetic", "genetic_best"], BINS),
        "status": figure_heater_status(window, ["uncalibrated", "poorly_calibrated"], BINS),
        "stochastic": figure_stochastic(window, BINS),
        "density": figure_density(
            link, draws(run.posterior, "prior", ["battery_link"]).ravel(), chains(run, link.name)
        ),
        "pairs": figure_pairs(infos[:5], flat[:, :5], np.zeros(len(flat), bool)),
        "history": figure_genetic_history(run.genetic),
        "spread": figure_genetic_spread(
            part, run.genetic["best"].values, run.genetic["best_theta"].values, run.genetic["mean_theta"].values, None
        ),
        "traces": figure_traces(infos[:3], values[..., :3]),
        "residuals": figure_residuals(window, BINS),
        "distribution": figure_residual_distribution(window),
        "reliability": figure_reliability(window),
    }


def test_units_are_written_on_every_axis(everything):
    for name, figure in everything.items():
        layout = figure.to_plotly_json()["layout"]
        axes = {k: v for k, v in layout.items() if k.startswith(("xaxis", "yaxis"))}
        labelled = [v["title"]["text"] for v in axes.values() if v.get("title", {}).get("text")]
        assert labelled, name
        units = (", ", "status", "P(on)", "K", "°C", "J/K", "–")
        assert all(any(u in title for u in units) for title in labelled), (name, labelled)
        for key, axis in axes.items():
            hidden = axis.get("visible") is False or axis.get("showticklabels") is False
            if key.startswith("yaxis") and not hidden and name != "spread":
                assert axis.get("title", {}).get("text"), (name, key)


def test_temperatures_are_in_celsius(run, everything):
    window = run.windows["test"]
    shown = trace(everything["point"], "genetic algorithm, mean of its runs").y
    expected = window["mean"].sel({"by": "genetic"})[:, 0].values - 273.15
    assert shown == pytest.approx(expected, abs=1e-4)


def test_two_methods_in_one_plot_differ_in_colour_and_dash(everything):
    lines = [trace(everything["point"], f"genetic algorithm, {n}").line for n in ("mean of its runs", "best run")]
    assert [line.dash for line in lines] == ["solid", "dot"]
    assert lines[0].color != lines[1].color


def test_telemetry_is_drawn_where_it_is_and_set_apart_where_it_is_not_scored(run, everything):
    window = run.windows["test"]
    observed = np.isfinite(window["observed"].values[:, 1])
    scored = window["scored"].values
    assert len(trace(everything["point"], "telemetry", 2).y) == (observed & scored).sum()
    assert len(trace(everything["point"], "telemetry, not scored", 2).y) == (observed & ~scored).sum()


def test_eclipses_are_shaded_in_every_plot_beside_other_shapes(everything):
    for name, rows, others in (("point", 5, 0), ("residuals", 3, 3)):
        shapes = everything[name].layout.shapes
        eclipses = [s for s in shapes if s.name == "eclipse"]
        assert len(eclipses) == 2 * rows
        assert len(shapes) == len(eclipses) + others
        assert sum(bool(s.showlegend) for s in eclipses) == 1
        assert eclipses[0].x0 == "2024-03-02T02:31:20.000"
        assert {s.yref for s in eclipses} == {"y domain", *(f"y{r} domain" for r in range(2, rows + 1))}


def test_an_unknown_eclipse_is_not_shaded(run):
    window = run.windows["test"]
    unknown = window.assign(eclipse=window["eclipse"] * np.nan)
    assert not figure_point(unknown, ["genetic"], BINS).layout.shapes
    assert not figure_point(window.drop_vars("eclipse"), ["genetic"], BINS).layout.shapes


def test_the_interval_lies_around_the_mean_and_the_models_inside_it(everything):
    figure = everything["stochastic"]
    widths = [np.nanmax(trace(figure, n, 2).y) for n in ("95% interval", "95% of the model, without noise")]
    mean = np.nanmax(trace(figure, "stochastic mean", 2).y)
    assert widths[0] > widths[1] > mean


def test_probability_of_on_is_between_zero_and_one(everything):
    shown = trace(everything["stochastic"], "probability of on (posterior)", 4)
    assert shown.line.shape == "hv"
    assert set(np.round(shown.y, 3)) > {0.0, 1.0}
    assert np.nanmax(shown.y) <= 1


def test_each_plot_keeps_its_height_however_many_channels(run):
    window = run.windows["test"]
    one, three = (figure_point(window.isel(channel=slice(n)), ["genetic"], BINS) for n in (1, 3))

    def plot_height(figure):
        span = figure.layout.yaxis.domain
        inner = figure.layout.height - figure.layout.margin.t - figure.layout.margin.b
        return (span[1] - span[0]) * inner

    assert plot_height(one) == pytest.approx(plot_height(three), rel=0.05)
    assert three.layout.height - one.layout.height == 2 * (190 + 44)


def test_long_series_are_thinned_to_their_extremes(run):
    window = run.windows["test"]
    index = np.arange(17_000) % window.sizes["time"]
    time = window["time"].values[0] + np.arange(17_000) * np.timedelta64(180, "s")
    long = window.isel(time=index).assign_coords(time=time)
    long["observed"][9_100, 0] = 500.0
    figure = figure_stochastic(long, bins=100)
    assert max(len(t.x) for t in figure.data if t.mode == "markers") <= 602
    assert np.nanmax(trace(figure, "telemetry").y) == pytest.approx(500 - 273.15, abs=1e-3)


def test_a_channel_without_telemetry_is_drawn_without_it(run):
    empty = run.windows["test"].copy(deep=True)
    empty["observed"][:, 0] = np.nan
    for figure in (figure_stochastic(empty, BINS), figure_residuals(empty, BINS)):
        assert figure.data
    names = [t.name for t in figure_point(empty, ["genetic"], BINS).data if (t.yaxis or "y") == "y"]
    assert names == ["genetic algorithm, mean of its runs"]


def test_residuals_are_of_scored_samples_only(run, everything):
    window = run.windows["test"]
    shown = trace(everything["residuals"], "telemetry − mean").y
    difference = (window["observed"] - window["mean"].sel({"by": "stochastic"}))[:, 0].values
    expected = difference[window["scored"].values & np.isfinite(difference)]
    assert shown == pytest.approx(expected, abs=1e-5)


def test_densities_peak_at_one_and_do_not_fall_before_a_bound_of_the_prior(run):
    info = next(i for i in run.parameters if i.name == "payload_capacity")
    prior = np.random.default_rng(1).uniform(1000.0, 2000.0, 4_000)
    figure = figure_density(info, prior, chains(run, info.name), genetic=1980.0)
    assert [t.name for t in figure.data] == ["prior", *(f"chain {k}" for k in (1, 2, 3, 4)), "genetic algorithm"]
    for shown in figure.data[1:5]:
        assert max(shown.y) == pytest.approx(1.0)
        assert shown.y[-1] > 0.85
        assert shown.y[0] < 0.05
        assert max(shown.x) <= 2000.5


def test_a_prior_much_wider_than_the_posterior_does_not_make_it_a_needle(run):
    info = next(i for i in run.parameters if i.name == "battery_link")
    rng = np.random.default_rng(2)
    posterior = rng.normal(0.6, 0.001, (4, 500))
    low, high = figure_density(info, rng.uniform(0.0, 5.0, 4_000), posterior).layout.xaxis.range
    assert 0.59 < low < 0.6 < high < 0.61
    low, high = figure_density(info, rng.uniform(0.59, 0.61, 4_000), posterior).layout.xaxis.range
    assert low < 0.591
    assert high > 0.609


def test_absolute_temperatures_are_shifted_to_celsius_in_densities(run):
    info = next(i for i in run.parameters if i.name == "initial.panel")
    prior = draws(run.posterior, "prior", [info.name]).ravel()
    figure = figure_density(info, prior, chains(run, info.name))
    assert figure.layout.xaxis.title.text == "initial.panel, °C"
    assert np.median(figure.data[1].x) == pytest.approx(285.0 - 273.15, abs=0.3)


def test_the_most_correlated_quantities_are_chosen_in_their_order():
    correlation = np.eye(5)
    correlation[1, 4] = correlation[4, 1] = -0.9
    correlation[0, 2] = correlation[2, 0] = 0.5
    assert most_correlated(correlation, 4) == [0, 1, 2, 4]
    assert most_correlated(correlation, 9) == [0, 1, 2, 3, 4]


def test_pairs_show_every_divergent_draw(run):
    infos = run.parameters[:3]
    values = draws(run.posterior, "posterior", [i.name for i in infos]).reshape(-1, 3)
    diverging = np.zeros(len(values), bool)
    diverging[[11, 501, 777]] = True
    figure = figure_pairs(infos, values, diverging)
    crosses = [t for t in figure.data if t.type == "scatter" and t.marker.symbol == "x"]
    assert len(crosses) == 3
    assert all(len(t.x) == 3 for t in crosses)


def test_ranks_of_chains_that_agree_stay_near_one_and_of_a_stuck_chain_do_not(run):
    info = run.parameters[0]
    rng = np.random.default_rng(3)
    values = rng.normal(size=(4, 2_000, 1))
    good = [np.array(t.y) for t in figure_traces([info], values).data if t.line.shape == "hv"]
    assert all(abs(y - 1).max() < 0.5 for y in good)
    values[2] += 3.0
    stuck = [np.array(t.y) for t in figure_traces([info], values).data if t.line.shape == "hv"]
    assert stuck[2].max() > 2


def test_the_genetic_history_sets_its_best_run_apart(run):
    figure = figure_genetic_history(run.genetic)
    assert len(figure.data) == 10
    best = figure.data[-1]
    assert best.name == f"best run ({int(run.genetic['rmse'].values.argmin()) + 1})"
    assert best.y[-1] == min(t.y[-1] for t in figure.data)
    assert sum(bool(t.showlegend) for t in figure.data) == 2


def test_the_spread_places_parameters_within_their_priors(run):
    info = dataclasses.replace(run.parameters[0], prior_quantiles=(1.0, 2.0, 3.0))
    figure = figure_genetic_spread([info], np.array([[1.0], [2.5]]), np.array([2.0]), np.array([3.0]), None)
    assert figure.data[0].x.tolist() == [0.0, 0.75]
    assert figure.data[1].x.tolist() == [1.0]


def test_the_heat_map_has_every_pair(run):
    names = [i.name for i in run.parameters]
    values = draws(run.posterior, "posterior", names).reshape(-1, len(names))
    figure = figure_correlation(names, np.corrcoef(values.T))
    assert figure.data[0].z.shape == (14, 14)
    assert float(figure.data[0].z[0, 1]) == pytest.approx(0.92, abs=0.02)


def test_methods_have_a_colour_of_their_own_on_white_and_on_dark():
    colours = [method.colour for method in METHODS.values()]
    assert len(set(colours)) == len(colours)
    dark = [DARK[c] for c in colours]
    assert len(set(dark)) == len(dark)


def test_a_scenario_without_heaters_has_only_temperatures(run):
    bare = run.windows["test"].drop_dims("heater")
    assert isinstance(bare, xr.Dataset)
    assert len([k for k in figure_stochastic(bare, BINS).layout.to_plotly_json() if k.startswith("yaxis")]) == 3


def test_reliability_shows_each_channels_transform_and_both_coverages(run, everything):
    window = run.windows["test"]
    figure = everything["reliability"]
    bars = [shown for shown in figure.data if shown.type == "bar"]
    assert len(bars) == window.sizes["channel"]
    assert all(sum(shown.y) * 0.1 == pytest.approx(1.0, rel=1e-5) for shown in bars)
    shares = [shown for shown in figure.data if shown.name == "share inside the interval"]
    assert len(shares) == 2 * window.sizes["channel"]
    scored = (np.isfinite(window["observed"]) & window["scored"].astype(bool)).sum("time").values
    assert [sum(shown.customdata) for shown in shares[::2]] == scored.tolist()
    assert [sum(shown.customdata) for shown in shares[1::2]] == scored.tolist()


def test_a_status_that_telemetry_does_not_tell_is_drawn_as_unknown(run):
    window = run.windows["test"]
    figure = figure_heater_status(window, ["uncalibrated"], BINS)
    assert not any(trace.name == "status unknown" for trace in figure.data)
    status = window["observed_status"].copy(deep=True)
    status[40:60, 0] = np.nan
    figure = figure_heater_status(window.assign(observed_status=status), ["uncalibrated"], BINS)
    (unknown,) = [trace for trace in figure.data if trace.name == "status unknown"]
    time = window["time"].values
    assert (np.min(unknown.x), np.max(unknown.x)) == (time[40], time[60])


def test_channels_with_clocks_of_their_own_have_whole_lines_status_and_eclipses(run):
    window = run.windows["test"].isel(time=slice(0, 80))
    bursts = np.repeat(np.arange(20) * 300, 4) + np.tile([0, 10, 20, 45], 20)
    observed = np.where(
        np.arange(80)[:, np.newaxis] % 4 == np.arange(window.sizes["channel"]), window["observed"], np.nan
    )
    status = np.where(np.arange(80)[:, np.newaxis] % 4 == 3, 1.0, np.full(window["observed_status"].shape, np.nan))
    apart = window.assign_coords(time=np.datetime64("2024-03-01", "ns") + bursts * np.timedelta64(1, "s")).assign(
        observed=(window["observed"].dims, observed),
        observed_status=(window["observed_status"].dims, status),
        eclipse=("time", np.zeros(80)),
    )
    figure = figure_stochastic(apart, BINS)
    assert np.isfinite(trace(figure, "stochastic mean").y).all()
    assert len([shape for shape in figure.layout.shapes if shape.name == "eclipse"]) == len(figure.layout.annotations)
    on = next(shown for shown in figure.data if shown.name == "heater on in telemetry")
    assert (on.x[0], on.x[2]) == (apart["time"].values[3], apart["time"].values[79])


def test_a_status_is_unknown_before_its_first_sample_in_gaps_of_the_rows_and_without_any():
    time = np.datetime64("2024-03-01", "ns") + np.arange(100) * np.timedelta64(60, "s")
    status = np.ones(100)
    status[:3] = np.nan
    kept = np.r_[0:50, 70:100]
    starts, ends = unknown_stretches(status[kept], time[kept])
    assert list(zip(starts, ends, strict=True)) == [(time[0], time[3]), (time[50], time[70])]
    starts, ends = unknown_stretches(np.full(100, np.nan), time)
    assert (starts.tolist(), ends.tolist()) == (time[:1].tolist(), time[-1:].tolist())


@pytest.mark.parametrize(("factor", "seen"), [(2.0, True), (1.1, False)])
def test_a_poor_calibration_has_its_error_beside_and_why_it_is_not_visibly_worse(run, factor, seen):
    window = run.windows["train"].copy(deep=True)
    observed = window["observed"].values
    for name, error in (("uncalibrated", 1.0), ("poorly_calibrated", factor)):
        window["mean"].loc[{"by": name}] = np.where(np.isfinite(observed), observed, 280.0) + error
    words = poorly_in_words(window)
    assert words.startswith(f" RMSE {factor:.2f} K, uncalibrated 1.00 K.")
    assert ("not visibly worse" in words) != seen
    assert poorly_in_words(window.sel({"by": ["uncalibrated"]})) == ""
