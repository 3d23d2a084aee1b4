"""Weights of heat integrated out, against dense normal distributions of all samples of all windows."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scipy import stats
from scipy.linalg import block_diag

from flightcal.compiled import Program
from flightcal.probability import (
    Evidence,
    Follows,
    Gains,
    Shaped,
    Sizes,
    WindowHeat,
    filter_of,
    likelihood_calls,
    weigh,
    window_memory,
)
from flightcal.probability.kernels.heat import LOG_MOST_GROWTH
from flightcal.probability.likelihood import Residuals
from flightcal.probability.shapes import no_shapes

from .residual_cases import CORRELATED, INDEPENDENT

KINDS = {
    "correlated and white": (Shaped(500.0, 0.4), Shaped(0.0, 1.0)),
    "correlated alone": (Shaped(900.0, 0.0), Shaped(200.0, 1.5)),
    "white": (Shaped(0.0, 1.0), Shaped(0.0, 1.0)),
}
COUNTS = (35, 28)
WEIGHTS = 7
GROUP = np.array([0, 0, 0, 1, 1, 2, 2])
SCALES = np.array([0.8, 1.7, 1.0])
"""The last of what has a fixed one."""
DEVIATIONS = np.array([0.3, 0.5])
STEP = 1e-5
ENTRIES = np.array([2.3, -0.4])
"""Entries of theta that the response follows, the first in its logarithm."""
_RNG = np.random.default_rng(8)
FOLLOWS = Follows(
    ("capacity", "turn"),
    np.array([True, False]),
    np.array([np.log(2.0), -0.1]),
    _RNG.normal(size=(WEIGHTS, 2)),
    _RNG.normal(size=WEIGHTS),
)


def noise_covariance(kind, numbers, seconds):
    """By the definition of each kind."""
    if kind == INDEPENDENT:
        return numbers[0] ** 2 * np.eye(len(seconds))
    apart = np.abs(seconds[:, None] - seconds)
    if kind == CORRELATED:
        deviation, white, time = numbers[:3]
    else:
        deviation, white, time = numbers[0], kind.white_share * numbers[0], kind.time
        if time == 0.0:
            return deviation**2 * np.eye(len(seconds))
    return deviation**2 * np.exp(-apart / time) + white**2 * np.eye(len(seconds))


@dataclass
class Windows:
    """Of two channels with gaps at uneven times, whose heat has the same weights."""

    kinds: tuple
    residuals: list = field(default_factory=list)
    observed: list = field(default_factory=list)
    simulated: list = field(default_factory=list)

    def __post_init__(self):
        rng = np.random.default_rng(4)
        for count in COUNTS:
            seconds = np.cumsum(rng.uniform(30.0, 300.0, count))
            seconds[count // 2 :] += 4000.0
            observed, simulated = rng.normal(size=(count, 2)), 0.3 * rng.normal(size=(count, 2))
            observed[[0, 4, 5], 0] = np.nan
            observed[[-1, 11], 1] = np.nan
            response = 0.4 * np.cumsum(rng.normal(size=(count, 2, WEIGHTS)), axis=0) / np.sqrt(count)
            heat = WindowHeat(response, GROUP, ("heat.a", "heat.b", ""), np.zeros((count, 2)))
            valid = np.isfinite(observed).T.copy()
            self.residuals.append(Residuals(seconds, valid, self.kinds, no_shapes(count, 2), heat))
            self.observed.append(observed)
            self.simulated.append(simulated)

    def parts(self):
        """Places of windows and channels, in order."""
        return [(w, k) for w in range(len(COUNTS)) for k in range(2)]

    def stacked(self, arrays):
        """[T, N, ...] of the windows at valid samples, part by part."""
        return np.concatenate([arrays[w][self.residuals[w].valid[k], k] for w, k in self.parts()])

    def noise(self, numbers):
        """Covariance [., .] of the noise of all, with numbers [N, n]."""
        of_parts = []
        for w, k in self.parts():
            terms = self.residuals[w]
            of_parts.append(noise_covariance(terms.kinds[k], numbers[k], terms.seconds[terms.valid[k]]))
        return block_diag(*of_parts)

    def response(self):
        return self.stacked([terms.heat.response for terms in self.residuals])

    def dense(self, numbers, roots):
        """The log likelihood."""
        left = self.stacked([o - s for o, s in zip(self.observed, self.simulated, strict=True)])
        response = self.response() * roots
        return stats.multivariate_normal.logpdf(left, cov=self.noise(numbers) + response @ response.T)

    def posterior(self, left, numbers, roots):
        """Mean and covariance of the weights given residuals [.]."""
        wide = self.response() * roots**2
        gain = np.linalg.solve(self.noise(numbers) + wide @ self.response().T, wide).T
        return gain @ left, np.diag(roots**2) - gain @ wide


@dataclass
class Rows:
    """The likelihood's rows, and the memory that they read and fill."""

    windows: Windows
    sizes: Sizes | None = None
    follows: Follows | None = None

    def __post_init__(self):
        self.numbers = np.zeros((2, 3))
        self.numbers[:, 0] = DEVIATIONS
        self.scales = np.concatenate([SCALES, ENTRIES[: 0 if self.follows is None else None]])
        heats = [replace(terms.heat, sizes=self.sizes, follows=self.follows) for terms in self.windows.residuals]
        residuals = [replace(terms, heat=heat) for terms, heat in zip(self.windows.residuals, heats, strict=True)]
        self.memories = [
            window_memory(observed, simulated.copy(), self.numbers, None, self.scales)
            for observed, simulated in zip(self.windows.observed, self.windows.simulated, strict=True)
        ]
        self.calls = likelihood_calls(residuals, self.memories)
        self.program = Program(self.calls.rows)

    def run(self):
        assert self.program.run() == 0
        return sum(float(memory.value[0]) for memory in self.memories)

    def slope(self, array, place):
        """By differences: of the log likelihood by one of the numbers that it reads."""
        sides = []
        for sign in (1.0, -1.0):
            array[place] += sign * STEP
            sides.append(self.run())
            array[place] -= sign * STEP
        return (sides[0] - sides[1]) / (2.0 * STEP)


@pytest.fixture(params=KINDS)
def windows(request):
    return Windows(KINDS[request.param])


@pytest.fixture
def rows(windows):
    return Rows(windows)


@pytest.fixture
def known(windows):
    return Rows(windows, Sizes(DEVIATIONS, SCALES[GROUP]))


# --- what whitens -----------------------------------------------------------------------------------------------


def test_what_the_filter_whitens_is_white(windows):
    for terms in windows.residuals:
        whitens = filter_of(terms)
        for k, kind in enumerate(terms.kinds):
            valid = terms.valid[k]
            unit = np.tile(np.diag(valid.astype(float)), (2, 1, 1))
            white = whitens.whiten(unit, terms.valid)[k]
            assert not white[~valid].any()
            lower = white[np.ix_(valid, valid)]
            covariance = noise_covariance(kind, np.ones(1), terms.seconds[valid])
            np.testing.assert_allclose(lower @ covariance @ lower.T, np.eye(valid.sum()), atol=1e-10)
            assert whitens.determinant[k] == pytest.approx(np.linalg.slogdet(covariance)[1], abs=1e-9)


def test_what_stands_where_there_is_no_sample_is_of_no_matter(windows):
    terms = windows.residuals[0]
    columns = np.random.default_rng(0).normal(size=(*terms.valid.shape, 3))
    other = np.where(terms.valid[..., None], columns, 1e9)
    whitens = filter_of(terms)
    np.testing.assert_array_equal(whitens.whiten(columns, terms.valid), whitens.whiten(other, terms.valid))


def test_a_channel_without_samples_tells_nothing(windows):
    terms = replace(windows.residuals[0], valid=np.zeros_like(windows.residuals[0].valid))
    found = weigh([terms])
    assert not found.samples.any()
    assert not found.determinant.any()
    assert not found.products.any()


# --- the likelihood -----------------------------------------------------------------------------------------------


def test_the_log_likelihood_is_that_of_all_samples_together(windows, rows, known):
    expected = windows.dense(DEVIATIONS[:, None], SCALES[GROUP])
    assert rows.run() == pytest.approx(expected, rel=1e-9)
    assert known.run() == pytest.approx(expected, rel=1e-9)


def test_the_log_likelihood_is_that_at_other_sizes_too(windows, rows):
    rows.numbers[:, 0] *= (1.7, 0.6)
    rows.scales[:2] *= (0.2, 3.0)
    assert rows.run() == pytest.approx(windows.dense(rows.numbers, rows.scales[GROUP]), rel=1e-9)


def test_without_heat_it_is_that_of_the_noise(windows, rows):
    rows.scales[:] = 1e-9
    assert rows.run() == pytest.approx(windows.dense(DEVIATIONS[:, None], np.zeros(WEIGHTS)), rel=1e-9)


def grown(windows, entries):
    """The dense log likelihood with a response that has grown, and heat that simulations have doing more with it."""
    growth = np.exp(FOLLOWS.slope @ (np.array([np.log(entries[0]), entries[1]]) - FOLLOWS.at))
    left = windows.stacked([o - s for o, s in zip(windows.observed, windows.simulated, strict=True)])
    left = left + windows.response() @ ((growth - 1.0) * FOLLOWS.centre)
    response = windows.response() * SCALES[GROUP] * growth
    covariance = windows.noise(DEVIATIONS[:, None]) + response @ response.T
    return stats.multivariate_normal.logpdf(left, cov=covariance)


@pytest.mark.parametrize("entries", [ENTRIES, np.array([1.4, 0.2])])
def test_a_response_that_follows_parameters_has_grown_with_them(windows, entries):
    rows = Rows(windows, follows=FOLLOWS)
    rows.scales[len(SCALES) :] = entries
    assert rows.run() == pytest.approx(grown(windows, entries), rel=1e-9)
    np.testing.assert_allclose(
        FOLLOWS.growth(entries[None])[0],
        np.exp(FOLLOWS.slope @ (np.array([np.log(entries[0]), entries[1]]) - FOLLOWS.at)),
    )


def test_a_response_grows_no_more_than_so_much(windows):
    far = np.array([2.3, 1e4])
    growth = FOLLOWS.growth(far[None])[0]
    np.testing.assert_allclose(np.abs(np.log(growth)), LOG_MOST_GROWTH)
    rows = Rows(windows, follows=FOLLOWS)
    rows.scales[len(SCALES) :] = far
    rows.run()
    assert not rows.memories[0].scales_bar[len(SCALES) :].any()


def test_derivatives_where_the_response_follows_are_those_of_differences(windows):
    found = Rows(windows, follows=FOLLOWS)
    found.run()
    memory = found.memories[0]
    of_scales, of_numbers = memory.scales_bar.copy(), [part.numbers_bar.copy() for part in found.memories]
    simulated = [part.simulated_bar.copy() for part in found.memories]
    for k in (0, 1, *range(len(SCALES), len(found.scales))):
        assert of_scales[k] == pytest.approx(found.slope(found.scales, k), rel=1e-5, abs=1e-5)
    for k in range(2):
        total = sum(bars[k, 0] for bars in of_numbers)
        assert total == pytest.approx(found.slope(found.numbers, (k, 0)), rel=1e-5, abs=1e-5)
    for of_window, bar in zip(found.memories, simulated, strict=True):
        for place in [(2, 0), (20, 1)]:
            assert bar[place] == pytest.approx(found.slope(of_window.simulated, place), rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("sizes", [None, Sizes(DEVIATIONS, SCALES[GROUP])], ids=["inferred", "known"])
def test_derivatives_by_the_simulated_are_those_of_differences(windows, sizes):
    found = Rows(windows, sizes)
    found.run()
    bars = [memory.simulated_bar.copy() for memory in found.memories]
    for memory, bar, terms in zip(found.memories, bars, found.windows.residuals, strict=True):
        assert (bar[~terms.valid.T] == 0.0).all()
        for place in list(np.ndindex(bar.shape))[::5]:
            assert bar[place] == pytest.approx(found.slope(memory.simulated, place), rel=1e-6, abs=1e-6), place


def test_derivatives_are_the_same_where_the_sizes_are_known(rows, known):
    rows.run()
    known.run()
    for one, other in zip(rows.memories, known.memories, strict=True):
        np.testing.assert_allclose(one.simulated_bar, other.simulated_bar, rtol=1e-9, atol=1e-9)
        assert not other.numbers_bar.any()
        assert not other.scales_bar.any()


def test_derivatives_by_the_numbers_are_those_of_differences(rows):
    rows.run()
    bar = sum(memory.numbers_bar for memory in rows.memories)
    assert not bar[:, 1:].any()
    for k in range(2):
        assert bar[k, 0] == pytest.approx(rows.slope(rows.numbers, (k, 0)), rel=1e-6)


def test_derivatives_by_the_scales_are_those_of_differences(rows):
    rows.run()
    bar = sum(memory.scales_bar for memory in rows.memories)
    for g in range(len(SCALES)):
        assert bar[g] == pytest.approx(rows.slope(rows.scales, g), rel=1e-6, abs=1e-6)


def test_a_second_run_gives_the_same(rows, known):
    for found in (rows, known):
        first, bar = found.run(), found.memories[1].simulated_bar.copy()
        assert found.run() == first
        np.testing.assert_array_equal(found.memories[1].simulated_bar, bar)


def test_where_heat_can_do_nothing_the_prior_of_its_scale_stays(windows):
    for terms in windows.residuals:
        terms.heat.response[..., GROUP == 1] = 0.0
    rows = Rows(windows)
    rows.run()
    assert rows.memories[0].scales_bar[1] == pytest.approx(0.0, abs=1e-9)


# --- weights ------------------------------------------------------------------------------------------------------


def draws_of(windows, count):
    """Residuals [S, T, N] of each window, deviations [S, P] and roots [S, m], which differ from draw to draw."""
    rng = np.random.default_rng(7)
    left = [rng.normal(size=(count, *observed.shape)) for observed in windows.observed]
    deviations = np.tile(DEVIATIONS * rng.uniform(0.5, 2.0, (count, 2)), 2)
    return left, deviations, SCALES[GROUP] * rng.uniform(0.5, 2.0, (count, 1))


def test_expected_weights_are_those_of_the_dense_conditional_normal(windows):
    left, deviations, roots = draws_of(windows, 4)
    gains = Gains(windows.residuals, weigh(windows.residuals), deviations, roots)
    found = gains(left)
    assert sorted(np.concatenate([which for which, _ in gains.factors])) == [0, 1, 2, 3]
    for which, factor in gains.factors:
        (s,) = which
        residual = windows.stacked([of_window[s] for of_window in left])
        mean, covariance = windows.posterior(residual, deviations[s, :2, None], roots[s])
        np.testing.assert_allclose(found[s], mean, atol=1e-9)
        np.testing.assert_allclose(factor @ factor.T, covariance, atol=1e-9)


def test_draws_of_the_same_sizes_share_a_factor(windows):
    left, deviations, roots = draws_of(windows, 6)
    which = np.array([0, 1, 0, 2, 1, 0])
    gains = Gains(windows.residuals, weigh(windows.residuals), deviations[which], roots[which])
    alone = Gains(windows.residuals, weigh(windows.residuals), deviations[:3], roots[:3])
    assert len(gains.factors) == 3
    np.testing.assert_allclose(gains(left)[3], alone([residual[[5, 5, 3]] for residual in left])[2], atol=1e-12)


def test_draws_of_weights_have_the_conditional_mean_and_covariance(windows):
    count = 20_000
    rng = np.random.default_rng(1)
    left = [np.tile(rng.normal(size=observed.shape), (count, 1, 1)) for observed in windows.observed]
    deviations, roots = np.tile(DEVIATIONS, (count, 2)), np.tile(SCALES[GROUP], (count, 1))
    drawn = Gains(windows.residuals, weigh(windows.residuals), deviations, roots).draw(left, rng)
    mean, covariance = windows.posterior(
        windows.stacked([residual[0] for residual in left]), DEVIATIONS[:, None], roots[0]
    )
    # In independent coordinates means are N(0, 1 / count), variances N(1, 2 / count), the others N(0, 1 / count).
    standard = np.linalg.solve(np.linalg.cholesky(covariance), (drawn - mean).T)
    limit = 4.5 / np.sqrt(count)
    assert np.abs(standard.mean(axis=1)).max() < limit
    assert np.abs(standard @ standard.T / count - np.eye(WEIGHTS)).max() < np.sqrt(2.0) * limit


# --- the evidence -------------------------------------------------------------------------------------------------

NUMBERS = np.array([[0.3, 0.15, 400.0], [0.5, 0.0, 0.0]])
PLACES = [(0, 0), (0, 1), (0, 2), (1, 0)]
"""Of the numbers that matter."""


@dataclass
class Evident:
    """Correlated noise on one channel, independent noise on the other."""

    def __post_init__(self):
        self.windows = Windows((CORRELATED, INDEPENDENT))
        columns = [terms.heat.response for terms in self.windows.residuals]
        bare = [replace(terms, heat=None) for terms in self.windows.residuals]
        self.evidence = Evidence(bare, columns, NUMBERS.shape[1])
        self.left = [
            np.where(np.isfinite(o), o - s, 0.0)
            for o, s in zip(self.windows.observed, self.windows.simulated, strict=True)
        ]
        self.roots = SCALES[GROUP] * np.linspace(0.5, 1.5, WEIGHTS)

    def __call__(self, numbers=NUMBERS, roots=None):
        return self.evidence(self.left, numbers, self.roots if roots is None else roots)


@pytest.fixture(scope="module")
def evident():
    return Evident()


def test_the_evidence_is_that_of_all_samples_together(evident):
    assert evident()[0] == pytest.approx(evident.windows.dense(NUMBERS, evident.roots), rel=1e-9)
    other = NUMBERS * (1.6, 0.5, 3.0)
    assert evident(other)[0] == pytest.approx(evident.windows.dense(other, evident.roots), rel=1e-9)
    assert evident()[0] == pytest.approx(evident.windows.dense(NUMBERS, evident.roots), rel=1e-9)


@pytest.mark.parametrize("place", PLACES)
def test_derivatives_of_the_evidence_by_the_numbers_are_those_of_differences(evident, place):
    bar = evident()[1]
    step = 1e-5 * NUMBERS[place]
    sides = []
    for sign in (1.0, -1.0):
        moved = NUMBERS.copy()
        moved[place] += sign * step
        sides.append(evident(moved)[0])
    assert bar[place] == pytest.approx((sides[0] - sides[1]) / (2.0 * step), rel=1e-6)


def test_derivatives_of_the_evidence_by_the_weights_deviations_are_those_of_differences(evident):
    bar = evident()[2]
    for j in range(WEIGHTS):
        step = STEP * np.eye(WEIGHTS)[j]
        sides = [evident(roots=evident.roots + sign * step)[0] for sign in (1.0, -1.0)]
        assert bar[j] == pytest.approx((sides[0] - sides[1]) / (2.0 * STEP), rel=1e-6, abs=1e-7)


def test_the_evidence_is_the_likelihood_where_the_noises_shape_is_the_same(windows, rows):
    kinds = tuple(CORRELATED if kind.has_memory else INDEPENDENT for kind in windows.kinds)
    numbers = np.zeros((2, 3))
    for k, kind in enumerate(windows.kinds):
        numbers[k] = DEVIATIONS[k], kind.white_share * DEVIATIONS[k], kind.time
    bare = [replace(terms, heat=None, kinds=kinds) for terms in windows.residuals]
    evidence = Evidence(bare, [terms.heat.response for terms in windows.residuals], 3)
    left = [np.nan_to_num(o - s) for o, s in zip(windows.observed, windows.simulated, strict=True)]
    value, _, roots_bar = evidence(left, numbers, SCALES[GROUP])
    assert value == pytest.approx(rows.run(), rel=1e-9)
    np.testing.assert_allclose(np.bincount(GROUP, roots_bar), rows.memories[0].scales_bar, rtol=1e-8, atol=1e-9)


# --- noise of known shape -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("shaped", [Shaped(500.0, 0.4), Shaped(500.0, 0.0)])
def test_noise_of_known_shape_is_the_correlated_noise_of_that_shape(shaped):
    deviation, seconds = 0.3, np.cumsum(np.random.default_rng(0).uniform(10.0, 400.0, 50))
    single, full = np.array([deviation]), np.array([deviation, shaped.white_share * deviation, shaped.time])
    apart = np.linspace(-2000.0, 2000.0, 9)
    np.testing.assert_allclose(shaped.covariance(single, apart), CORRELATED.covariance(full, apart), rtol=1e-12)
    assert shaped.white_variance(single) == pytest.approx(CORRELATED.white_variance(full), rel=1e-12)
    assert shaped.deviation(single) == pytest.approx(CORRELATED.deviation(full), rel=1e-12)
    residual = np.random.default_rng(1).normal(size=50)
    found, expected = (
        kind.innovations(residual, seconds, numbers, np.random.default_rng(0))
        for kind, numbers in ((shaped, single), (CORRELATED, full))
    )
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("shaped", [Shaped(500.0, 0.4), Shaped(0.0, 1.0)])
def test_draws_of_noise_of_known_shape_have_its_covariance(shaped):
    count, seconds, numbers = 4000, np.array([0.0, 100.0, 700.0, 2000.0]), np.array([0.3])
    rng = np.random.default_rng(0)
    drawn = np.stack([sum(shaped.draw(numbers, seconds, rng)) for _ in range(count)])
    expected = noise_covariance(shaped, numbers, seconds)
    standard = np.linalg.solve(np.linalg.cholesky(expected), drawn.T)
    assert np.abs(standard @ standard.T / count - np.eye(4)).max() < 4.5 * np.sqrt(2.0 / count)
    assert shaped.deviation(numbers) == pytest.approx(np.sqrt(expected[0, 0]), rel=1e-12)
