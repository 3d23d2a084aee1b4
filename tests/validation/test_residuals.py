"""Residual tests on simulated white and AR(1) series, with and without gaps."""

import math

import numpy as np
import pytest
import xarray as xr
from scipy.signal import lfilter
from scipy.stats import chi2

from flightcal.validation import autocorrelation, check_window, effective_samples
from flightcal.validation.residuals import check_residuals, ljung_box, pair_counts, segments

START = np.datetime64("2024-03-01", "ns")


def times(size: int, spacing: float = 60.0) -> np.ndarray:
    return START + (np.arange(size) * spacing * 1e9).astype("timedelta64[ns]")


def ar1(rho: float, size: int, rng: np.random.Generator) -> np.ndarray:
    """Stationary AR(1) noise of standard deviation one."""
    noise = rng.normal(size=size) * math.sqrt(1 - rho**2)
    noise[0] = rng.normal()
    return lfilter([1.0], [1.0, -rho], noise)


def gaps(size: int, rng: np.random.Generator) -> np.ndarray:
    """Samples that are left when a tenth is lost at random, and one long stretch."""
    keep = rng.random(size) > 0.1
    keep[size // 3 : size // 2] = False
    return keep


def test_autocorrelation_of_ar1_falls_geometrically_with_and_without_gaps():
    rng = np.random.default_rng(1)
    series, time = ar1(0.8, 40_000, rng), times(40_000)
    expected = 0.8 ** np.arange(9)
    keep = gaps(series.size, rng)
    assert autocorrelation(series, time, 8) == pytest.approx(expected, abs=0.03)
    assert autocorrelation(series[keep], time[keep], 8) == pytest.approx(expected, abs=0.03)
    masked = np.where(keep, series, np.nan)
    assert autocorrelation(masked, time, 8) == pytest.approx(autocorrelation(series[keep], time[keep], 8))


def test_autocorrelation_is_its_sum_over_pairs_written_out():
    max_lag = 4
    # Late, early and missing samples; a step of one and a half spacings, one of a tenth, and one of more than max_lag.
    steps = np.array([1, 1.1, 0.9, 2, 1, 1, 1.5, 1, 1, 3, 1, 0.1, 1, 1, 1, 4, 1, 5, 1, 1, 2, 1, 1, 1.2, 0.8, 1, 1, 1])
    time = START + (60e3 * np.concatenate([[0.0], np.cumsum(steps)])).astype("timedelta64[ms]")
    rng = np.random.default_rng(4)
    # Louder at the end, so that first and second members of the pairs differ.
    residuals = 0.7 + rng.standard_normal(time.size) * np.linspace(0.5, 4.0, time.size)
    residuals[[5, 20]] = np.nan
    centred = residuals - np.nanmean(residuals)
    place, stretch = np.zeros(time.size, int), np.zeros(time.size, int)
    for k, step in enumerate(steps):
        whole = round(step)
        breaks = abs(step - whole) > 0.25 or not 1 <= whole <= max_lag
        stretch[k + 1], place[k + 1] = stretch[k] + breaks, place[k] + max(whole, 1)
    expected, counts = [], []
    for lag in range(max_lag + 1):
        pairs = [
            (centred[i], centred[j])
            for i in range(time.size)
            for j in range(time.size)
            if stretch[i] == stretch[j] and place[j] - place[i] == lag and np.isfinite([centred[i], centred[j]]).all()
        ]
        first, second = np.array(pairs).T
        expected.append(first @ second / np.sqrt((first @ first) * (second @ second)))
        counts.append(len(pairs))
    assert autocorrelation(residuals, time, max_lag) == pytest.approx(np.array(expected), abs=1e-12)
    assert pair_counts(residuals, time, max_lag).tolist() == counts
    assert len(segments(residuals, time, max_lag)) == 1 + stretch[-1]


def test_pairs_do_not_reach_across_a_break_in_the_sampling():
    time = np.concatenate([times(5), times(5) + np.timedelta64(1_030, "s")])
    assert list(pair_counts(np.ones(10), time, 3)) == [10, 8, 6, 4]


def test_a_missing_row_costs_only_its_own_pairs():
    time = np.delete(times(6), 2)
    assert list(pair_counts(np.ones(5), time, 2)) == [5, 3, 2]


def test_jitter_of_the_clock_does_not_break_the_sampling():
    rng = np.random.default_rng(2)
    time = times(200) + rng.integers(-5_000, 5_000, 200).astype("timedelta64[ms]")
    assert pair_counts(np.ones(200), time, 1)[1] == 199


def test_a_slow_drift_of_the_clock_does_not_shift_lags():
    time = times(2_000, spacing=60.2)
    assert list(pair_counts(np.ones(2_000), time, 2)) == [2_000, 1_999, 1_998]


def test_autocorrelation_stays_within_one():
    rng = np.random.default_rng(3)
    for _ in range(20):
        series = np.cumsum(rng.normal(size=30))
        keep = rng.random(30) > 0.4
        found = autocorrelation(np.where(keep, series, np.nan), times(30), 29)
        assert np.nanmax(np.abs(found)) <= 1.0


def test_ljung_box_is_the_published_statistic_for_a_long_series_without_gaps():
    rng = np.random.default_rng(4)
    series = rng.normal(size=4_000)
    centred = series - series.mean()
    published = 0.0
    for lag in range(1, 11):
        correlation = (centred[lag:] @ centred[:-lag]) / (centred @ centred)
        published += 4_000 * 4_002 * correlation**2 / (4_000 - lag)
    assert ljung_box(series, times(4_000), 10)[0] == pytest.approx(published, rel=0.01)


@pytest.mark.parametrize("broken", [False, True])
def test_ljung_box_rejects_white_noise_as_often_as_it_says(broken):
    rng = np.random.default_rng(5)
    rejected = []
    for _ in range(600):
        keep = gaps(300, rng) if broken else np.ones(300, bool)
        rejected.append(ljung_box(rng.normal(size=300)[keep], times(300)[keep], 10)[1] < 0.05)
    assert np.mean(rejected) == pytest.approx(0.05, abs=3.5 * math.sqrt(0.05 * 0.95 / 600))


def test_ljung_box_counts_only_lags_that_have_pairs():
    time = np.concatenate([times(2) + np.timedelta64(3_600 * k, "s") for k in range(60)])
    residuals = np.random.default_rng(3).normal(size=time.size)
    statistic, p_value = ljung_box(residuals, time, 10)
    assert p_value == pytest.approx(chi2.sf(statistic, 1))


def test_ljung_box_finds_weak_autocorrelation():
    rng = np.random.default_rng(6)
    found = [ljung_box(ar1(0.3, 300, rng), times(300), 10)[1] < 0.01 for _ in range(50)]
    assert np.mean(found) > 0.9


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("broken", [False, True])
def test_effective_samples_predict_the_scatter_of_the_mean(rho, broken):
    rng = np.random.default_rng(7)
    keep = gaps(2_000, rng) if broken else np.ones(2_000, bool)
    lags = np.abs(np.subtract.outer(*[np.flatnonzero(keep)] * 2))
    exact = keep.sum() ** 2 / np.sum(rho**lags)
    found = [effective_samples(ar1(rho, 2_000, rng)[keep], times(2_000)[keep]) for _ in range(40)]
    assert np.median(found) == pytest.approx(exact, rel=0.15)


def test_effective_samples_are_their_sum_written_out():
    # A wave on what hardly changes, with gaps: sums of neighbouring autocorrelations rise again before they end.
    rng = np.random.default_rng(7)
    keep = gaps(200, rng)
    time = times(200)[keep]
    residuals = (2.0 * ar1(0.97, 200, rng) + np.sin(np.arange(200) * 0.8))[keep]
    lags = residuals.size // 2
    correlation, counts = autocorrelation(residuals, time, lags), pair_counts(residuals, time, lags)
    total, smallest, rises = 0.0, math.inf, False
    for k in range(0, lags - 1, 2):
        pair = sum(counts[i] * np.nan_to_num(correlation[i]) for i in (k, k + 1)) / residuals.size
        if pair <= 0:
            break
        rises |= bool(pair > smallest)
        smallest = min(smallest, pair)
        total += smallest
    assert rises
    assert effective_samples(residuals, time) == pytest.approx(residuals.size / (2 * total - 1))


def test_effective_samples_do_not_exceed_their_number():
    rng = np.random.default_rng(8)
    assert effective_samples(ar1(-0.7, 500, rng), times(500)) == 500


def test_white_residuals_do_not_contradict_iid_noise():
    rng = np.random.default_rng(10)
    verdicts = [check_residuals("panel", rng.normal(size=400), times(400)).verdict for _ in range(100)]
    assert verdicts.count("white") >= 95


@pytest.mark.parametrize("rho", [0.9, 0.97])
def test_ar1_residuals_contradict_iid_noise_by_the_ar1_factor(rho):
    rng = np.random.default_rng(11)
    checks = [check_residuals("panel", ar1(rho, 6_000, rng), times(6_000)) for _ in range(15)]
    expected = math.sqrt((1 + rho) / (1 - rho))
    assert {c.verdict for c in checks} == {"contradicted"}
    assert np.median([c.factor for c in checks]) == pytest.approx(expected, rel=0.12)
    assert np.median([c.factor_ar1 for c in checks]) == pytest.approx(expected, rel=0.05)
    assert "contradict iid noise" in checks[0].words
    assert f"factor of {checks[0].factor:.1f}" in checks[0].words


def test_an_iid_posterior_is_too_narrow_by_the_factor_named():
    """The mean of AR(1) data, fitted as if iid: its real scatter over its claimed standard deviation."""
    rng = np.random.default_rng(12)
    series = [ar1(0.9, 3_000, rng) for _ in range(300)]
    claimed = np.mean([s.std() for s in series]) / math.sqrt(3_000)
    scatter = np.std([s.mean() for s in series])
    named = np.median([check_residuals("panel", s, times(3_000)).factor for s in series[:20]])
    assert named == pytest.approx(scatter / claimed, rel=0.2)


@pytest.mark.parametrize(("size", "lags"), [(50, 10), (500, 20)])
def test_ljung_box_looks_at_a_fifth_of_a_short_series(size, lags):
    residuals = np.random.default_rng(5).normal(size=size)
    check = check_residuals("panel", residuals, times(size))
    assert check.lags == lags
    assert (check.ljung_box, check.p_value) == pytest.approx(ljung_box(residuals, times(size), lags))


def test_weak_autocorrelation_in_a_long_series_is_called_slight():
    rng = np.random.default_rng(13)
    check = check_residuals("panel", ar1(0.05, 40_000, rng), times(40_000))
    assert check.verdict == "slight"
    assert "hardly matters" in check.words


def test_few_or_constant_residuals_give_no_verdict():
    assert check_residuals("panel", np.arange(10.0), times(10)).verdict == "unknown"
    assert check_residuals("panel", np.ones(100), times(100)).verdict == "unknown"
    assert check_residuals("panel", np.full(100, np.nan), times(100)).samples == 0


IRREGULAR = {
    "at random": lambda rng, size: rng.exponential(60.0, size),
    "in pairs": lambda rng, size: np.tile([3.0, 57.0], size // 2),
    "jittered": lambda rng, size: rng.uniform(30.0, 90.0, size),
    "with gaps": lambda rng, size: rng.uniform(30.0, 90.0, size) + 3e4 * (np.arange(size) % 500 == 499),
    "in bursts": lambda rng, size: np.where(np.arange(size) % 10, 1.0, 600.0),
    "in passes": lambda rng, size: np.where(np.arange(size) % 20, 10.0, 900.0),
}


def irregular(kind: str, correlation_time: float, size: int, rng: np.random.Generator):
    """Noise with an exponential autocorrelation (s), its times, and the factor of its mean's standard deviation."""
    seconds = np.cumsum(IRREGULAR[kind](rng, size))
    rho = np.exp(-np.diff(seconds) / correlation_time)
    noise = rng.normal(size=size)
    series = noise.copy()
    for k, correlation in enumerate(rho, start=1):
        series[k] = correlation * series[k - 1] + math.sqrt(1 - correlation**2) * noise[k]
    distance = np.abs(np.subtract.outer(seconds, seconds))
    factor = math.sqrt(np.exp(-distance / correlation_time).sum() / size)
    return series, START + (seconds * 1e9).astype("timedelta64[ns]"), factor


@pytest.mark.parametrize("kind", IRREGULAR)
@pytest.mark.parametrize("correlation_time", [150.0, 600.0])
def test_the_factor_of_irregular_telemetry_is_that_of_its_correlation(kind, correlation_time):
    rng = np.random.default_rng(15)
    found, exact = [], []
    for _ in range(20):
        series, time, factor = irregular(kind, correlation_time, 1_500, rng)
        check = check_residuals("panel", series, time)
        assert check.verdict == "contradicted"
        found.append(check.factor)
        exact.append(factor)
    assert np.median(found) == pytest.approx(np.median(exact), rel=0.15)


@pytest.mark.parametrize("kind", IRREGULAR)
def test_white_noise_of_irregular_telemetry_is_white_as_often_as_it_should(kind):
    rng = np.random.default_rng(16)
    size = 400
    time = START + (np.cumsum(IRREGULAR[kind](rng, size)) * 1e9).astype("timedelta64[ns]")
    checks = [check_residuals("panel", rng.normal(size=size), time) for _ in range(200)]
    assert np.mean([check.p_value < 0.05 for check in checks]) == pytest.approx(0.05, abs=0.055)
    assert np.median([check.factor for check in checks]) < 1.1


def test_a_window_is_checked_by_channel_on_its_scored_samples():
    rng = np.random.default_rng(14)
    residuals = np.stack([rng.normal(size=500), ar1(0.95, 500, rng)], axis=1)
    residuals[:20] = 1e3
    prediction = xr.Dataset(
        {
            "observed": (("time", "channel"), 290.0 + residuals),
            "mean": (("by", "time", "channel"), np.full((1, 500, 2), 290.0)),
            "scored": ("time", np.arange(500) >= 20),
        },
        {"time": times(500), "by": ["stochastic"], "channel": ["white", "slow"]},
    )
    white, slow = check_window(prediction)
    assert (white.channel, white.verdict, white.samples) == ("white", "white", 480)
    assert (slow.channel, slow.verdict) == ("slow", "contradicted")


def correlated_window():
    """AR(1) residuals, and the innovations that they are made of; a discrepancy of the second channel."""
    rng = np.random.default_rng(16)
    residuals = np.stack([ar1(0.9, 600, rng), ar1(0.9, 600, rng)], axis=1)
    innovations = residuals.copy()
    innovations[1:, 0] -= 0.9 * residuals[:-1, 0]
    return xr.Dataset(
        {
            "observed": (("time", "channel"), 290.0 + residuals),
            "mean": (("by", "time", "channel"), np.full((1, 600, 2), 290.0)),
            "scored": ("time", np.ones(600, bool)),
            "innovation": (("time", "channel"), innovations),
            "noise": ("channel", ["AR(1) noise", "independent Student-t noise"]),
            "discrepant": ("channel", [False, True]),
        },
        {"time": times(600), "by": ["stochastic"], "channel": ["ar1", "lacking"]},
    )


def test_of_correlated_noise_the_innovations_are_tested():
    check, _ = check_window(correlated_window())
    assert (check.verdict, check.tested) == ("white", "innovations")
    assert check.residual_lag1 == pytest.approx(0.9, abs=0.06)
    assert abs(check.lag1) < 0.15
    assert "no contradiction to AR(1) noise" in check.words


def test_correlation_by_slow_heat_is_expected_only_where_nothing_tells_it():
    _, learnt = check_window(correlated_window(), heat=True)
    _, unseen = check_window(correlated_window(), unseen=True, heat=True)
    assert learnt.verdict == "contradicted"
    assert "contradict independent Student-t noise" in learnt.words
    assert unseen.verdict == "expected"
    assert "too narrow" not in unseen.words


def test_correlation_beside_a_discrepancy_is_not_expected():
    plain, unseen = check_window(correlated_window(), unseen=True)
    assert (plain.discrepant, unseen.discrepant) == (False, True)
    assert unseen.verdict == "contradicted"


@pytest.mark.parametrize(
    ("rho", "words"), [(0.7, "too narrow by about a factor"), (0.999, "too narrow by at least a factor")]
)
def test_few_independent_residuals_give_the_factor_a_bound(rho, words):
    check = check_residuals("panel", ar1(rho, 1000, np.random.default_rng(1)), times(1000))
    assert (check.effective < 10) == ("at least" in words)
    assert words in check.words


def test_lags_without_pairs_have_no_autocorrelation_in_a_long_series():
    residuals = np.random.default_rng(2).normal(size=20_000)
    residuals[1::2] = np.nan
    found = autocorrelation(residuals, times(20_000), 6)
    assert np.isnan(found).tolist() == [False, True, False, True, False, True, False]
