"""What the report says where the residuals are more than iid noise: AR(1) noise, a discrepancy, several windows."""

import dataclasses

import numpy as np
import pytest
import xarray as xr

from flightcal.report.panels import discrepancy
from flightcal.report.panels.discrepancy import figure_discrepancy
from flightcal.report.panels.parameters import window_values
from flightcal.report.run_files import ParameterInfo

from .synthetic_run import every_finding, panels

AMPLITUDE, LENGTH = "discrepancy.phase.amplitude.battery_temperature", "discrepancy.phase.lengthscale"
CORRELATION = {"panel_absorptivity": 0.1, "battery_link": -0.97, "payload_link": -0.7}


def with_window(window, noise="iid noise"):
    """A window of the made-up run whose second channel has a discrepancy, which takes up its residuals' slow half."""
    residual = (window["observed"] - window["mean"].sel({"by": "stochastic"})).transpose("time", "channel")
    mean = np.zeros(residual.shape)
    mean[:, 1] = 0.5 * np.sin(2 * np.pi * window["orbit_phase"].values)
    both = ("time", "channel")
    return window.assign(
        noise=("channel", [noise] * 3),
        discrepant=("channel", [False, True, False]),
        innovation=(both, np.random.default_rng(4).normal(size=mean.shape)),
        discrepancy_mean=(both, mean),
        discrepancy_lower=(both, mean - 0.2),
        discrepancy_upper=(both, mean + 0.2),
    )


def made(run, noise="iid noise"):
    """The made-up run with a discrepancy."""
    shape = run.posterior["posterior"].to_dataset().sizes
    draws = np.random.default_rng(3).normal(size=(shape["chain"], shape["draw"]))
    groups = {name: group.to_dataset() for name, group in run.posterior.children.items()}
    both = ("chain", "draw")
    values = {AMPLITUDE: 0.8 + 0.01 * draws, LENGTH: 0.2 + 0.01 * draws}
    groups["posterior"] = groups["posterior"].assign({n: (both, v) for n, v in values.items()})
    prior = {n: (both, 3.0 * v[:1]) for n, v in values.items()}
    groups["prior"] = groups["prior"].isel(draw=slice(shape["draw"])).assign(prior)
    groups["discrepancy"] = xr.Dataset(
        {"correlation": ("parameter", list(CORRELATION.values()))}, {"parameter": list(CORRELATION)}
    )
    tree = xr.DataTree.from_dict(groups)
    tree.attrs = run.posterior.attrs
    infos = [
        ParameterInfo(name, "discrepancy", unit, 0.0, (), "", "", quantiles)
        for name, unit, quantiles in (
            (AMPLITUDE, "K", (0.03, 0.7, 2.2)),
            (LENGTH, "orbits", (0.06, 0.3, 0.5)),
        )
    ]
    windows = {name: with_window(window, noise) for name, window in run.windows.items()}
    return dataclasses.replace(run, posterior=tree, windows=windows, parameters=[*run.parameters, *infos])


def section(run, anchor):
    return next(s for s in panels(run) if s.anchor == anchor)


def words(blocks):
    return " ".join(block.text for block in blocks)


def finding(run, title):
    return next(f for f in every_finding(run) if title in f.title)


def test_there_is_a_section_only_where_there_is_a_discrepancy(run):
    assert "discrepancy" not in [s.anchor for s in panels(run)]
    blocks = section(made(run), "discrepancy").blocks
    assert [b.kind for b in blocks] == ["text", "table", "figure", "text", "table", "heading", "text", "table"]
    assert "carries over to every window" in words(blocks)


def test_amplitudes_and_lengthscales_are_in_kelvin_and_orbits(run):
    rows = discrepancy.numbers(made(run)).rows
    assert [row[:2] for row in rows] == [
        ["battery_temperature", "amplitude, K"],
        ["all together", "lengthscale, orbits"],
    ]
    assert rows[1][2] == "0.300 [0.0600, 0.500]"
    assert rows[1][3].startswith("0.200")


def test_what_the_discrepancy_stands_in_for_is_named_worst_first(run):
    table = discrepancy.confounded(made(run))
    assert [row[0] for row in table.rows] == ["battery_link", "payload_link", "panel_absorptivity"]
    assert table.rows[0][3] == "the telemetry tells the sum of the two, not the parameter"
    assert [table.state(k, 3) for k in range(3)] == ["warn", "", "good"]
    against = finding(made(run), "stands in for battery_link")
    assert against.state == "warn"
    assert "battery_link (−0.97)" in against.text
    assert "payload_link" not in against.text


def test_the_size_is_that_of_the_discrepant_channel_alone(run):
    rows = discrepancy.sizes(made(run).windows).rows
    assert [row[:2] for row in rows] == [["train", "battery_temperature"], ["test", "battery_temperature"]]
    assert float(rows[0][2]) == pytest.approx(0.5 / np.sqrt(2), rel=0.01)
    assert rows[0][4] == "0.400"


def test_the_figure_has_the_discrepant_channel_over_the_orbit_with_its_band(run):
    figure = figure_discrepancy(made(run).windows["train"])
    assert [t.name for t in figure.data] == ["telemetry − simulation", "interval", "discrepancy, mean"]
    mean = figure.data[2]
    assert (np.diff(mean.x) >= 0).all()
    np.testing.assert_allclose(mean.y, 0.5 * np.sin(2 * np.pi * np.array(mean.x)), atol=1e-6)


def test_correlated_residuals_are_no_fault_of_ar1_noise_whose_innovations_are_white(run):
    ar1_run = made(run, noise="AR(1) noise")
    good = finding(ar1_run, "look like the noise that was assumed")
    assert good.state == "good"
    assert "AR(1) noise beside a discrepancy of battery_temperature in orbit phase" in good.text
    assert "are correlated" in good.text
    assert "which the AR(1) noise expects" in good.text
    text = words(section(ar1_run, "residuals").blocks)
    assert "iid" not in text
    assert "no channel contradicts AR(1) noise" in text
    iid = finding(run, "not the independent noise")
    assert "payload_temperature" in iid.text


def test_innovations_that_are_not_white_contradict_the_noise_by_its_own_name(run):
    ar1_run = made(run, noise="AR(1) noise")
    windows = {
        n: w.assign(innovation=w["observed"] - w["mean"].sel({"by": "stochastic"})) for n, w in ar1_run.windows.items()
    }
    against = finding(
        dataclasses.replace(ar1_run, windows=windows), "The residuals are not the AR(1) noise that was assumed, worst "
    )
    assert "innovations of battery_temperature and payload_temperature" in against.text
    assert "discrepancy and noise take up in part only" in against.text
    assert "the paper" not in against.text


def test_with_several_training_windows_it_is_said_that_no_correlation_was_determined(run):
    discrepant_run = made(run)
    tree = discrepant_run.posterior.copy()
    del tree["discrepancy"]
    changed = dataclasses.replace(discrepant_run, posterior=tree)
    last = section(changed, "discrepancy").blocks[-1]
    assert last.kind == "note"
    assert "several training windows" in last.text
    assert not [f for f in every_finding(changed) if "stands in" in f.title]


def test_values_of_drifting_parameters_stand_by_window(run):
    assert not window_values(run).rows
    common = run.posterior["posterior"]["battery_link"]
    tree = run.posterior.copy()
    values = np.stack([common.values + 0.1, common.values - 0.1], axis=-1)
    tree["windows"] = xr.DataTree(
        xr.Dataset({"battery_link": (("chain", "draw", "window"), values)}, {"window": ["june", "july"]})
    )
    drifting_run = dataclasses.replace(run, posterior=tree)
    table = window_values(drifting_run)
    assert table.header[2:] == ("in “june”", "in “july”")
    middle = [float(cell.split(" ")[0]) for cell in table.rows[0][1:]]
    assert middle[1:] == pytest.approx([middle[0] + 0.1, middle[0] - 0.1], abs=1e-3)
    assert "Values by window" in words(section(drifting_run, "parameters").blocks)
    warm = [dataclasses.replace(info, unit="degC") for info in run.parameters]
    assert window_values(dataclasses.replace(drifting_run, parameters=warm)).rows[0][0] == "battery_link, °C"
