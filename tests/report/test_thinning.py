"""What is drawn of a long series."""

import numpy as np

from flightcal.report.style import polygons
from flightcal.report.thinning import break_lines, changes, extremes, followed, stretches


def times(size: int) -> np.ndarray:
    return np.datetime64("2024-03-01", "ns") + np.arange(size) * np.timedelta64(60, "s")


def test_thinning_keeps_every_peak_and_both_ends():
    rng = np.random.default_rng(1)
    series = rng.normal(size=17_000)
    series[[3, 8_123, 16_990]] = 50.0, -60.0, 70.0
    kept = extremes([series], 100)
    assert {0, 3, 8_123, 16_990, 16_999} <= set(kept.tolist())
    assert kept.size <= 202
    assert np.all(np.diff(kept) > 0)


def test_thinning_follows_every_column():
    first, second = np.zeros(10_000), np.zeros(10_000)
    first[100], second[200] = 1.0, -1.0
    assert {100, 200} <= set(extremes([first, second], 20).tolist())


def test_short_series_are_kept_whole():
    assert extremes([np.zeros(200)], 100).size == 200


def test_missing_samples_are_never_extremes():
    series = np.where(np.arange(10_000) % 2, np.nan, np.arange(10_000.0))
    kept = extremes([series], 50)
    assert np.isfinite(series[kept[1:-1]]).all()


def drawn(time, kept, values):
    return np.interp(time.astype(float), time[kept].astype(float), values[kept])


def test_lines_go_where_those_of_all_samples_go_with_few_of_them():
    time = np.sort(np.random.default_rng(1).choice(times(20_000), 5_000, replace=False))
    hours = (time - time[0]) / np.timedelta64(1, "h")
    # A steep rise after each eclipse, and an interval that is wide once.
    mean = 20.0 * np.abs(np.sin(hours)) + 5.0 * (hours % 1.6 < 0.6)
    upper = mean + 1.0 + 9.0 * (np.abs(hours - 100.0) < 0.5)
    kept = followed(time, [mean, upper], 3_000)
    assert kept.size < 3_000
    for values in (mean, upper):
        assert np.abs(drawn(time, kept, values) - values).max() <= 0.003 * np.ptp([mean, upper]) * (1.0 + 1e-9)


def test_lines_are_nearest_where_so_many_points_are_not_enough():
    time, noise = times(10_000), np.random.default_rng(2).normal(size=10_000)
    noise[[3_000, 7_000]] = 40.0, -50.0
    kept = followed(time, [noise], 200)
    assert kept.size == 200
    assert {0, 3_000, 7_000, 9_999} <= set(kept.tolist())


def test_lines_keep_both_sides_of_what_is_missing():
    values = np.linspace(0.0, 1.0, 1_000)
    values[300:320] = np.nan
    assert {299, 300, 319, 320} <= set(followed(times(1_000), [values], 100).tolist())
    assert followed(times(90), [np.full(90, np.nan)], 100).size == 90
    assert followed(times(900), [np.full(900, np.nan)], 100).tolist() == [0, 899]


def test_step_lines_keep_both_sides_of_every_change():
    status = np.array([0.0, 0, 0, 1, 1, np.nan, np.nan, 0, 0])
    assert changes(status).tolist() == [0, 2, 3, 4, 5, 6, 7, 8]


def test_lines_break_in_gaps():
    time = np.concatenate([times(50), times(50) + np.timedelta64(1, "D")])
    values = np.arange(100.0)
    x, (y,) = break_lines(time, np.array([0, 99]), [values])
    assert np.isnan(y).sum() == 1
    place = int(np.flatnonzero(np.isnan(y))[0])
    assert time[49] < x[place] < time[50]
    assert y[place - 1] == 49
    assert y[place + 1] == 50


def test_stretches_end_where_telemetry_pauses():
    time = np.concatenate([times(50), times(50) + np.timedelta64(1, "D")])
    flags = np.zeros(100, bool)
    flags[5:8] = flags[45:60] = flags[98:] = True
    assert stretches(flags, time) == [(5, 8), (45, 49), (50, 60), (98, 99)]


def test_bands_are_closed_polygons_that_do_not_span_gaps():
    low = np.array([0.0, 1.0, np.nan, 3.0, 4.0])
    x, y = polygons(np.arange(5.0), low, low + 10)
    assert x.tolist() == [0, 1, 1, 0, 1, 3, 4, 4, 3, 4]
    assert np.flatnonzero(np.isnan(y)).tolist() == [4, 9]
    assert y[:4].tolist() == [0, 1, 11, 10]
