"""The verdict on an emulator's errors."""

import numpy as np
import pytest

from flightcal.emulation.held_out import judge, together


@pytest.fixture
def errors():
    """40 runs of errors that are alike within a run, of 0.1 K and 0.3 K."""
    return np.random.default_rng(3).standard_normal((40, 1, 2)) * [0.1, 0.3] * np.ones((40, 25, 2))


def test_errors_as_large_as_predicted_pass(errors):
    found = judge(errors, np.ones((40, 25, 2)) * [0.1, 0.3], ("a", "b"))
    assert found.passed
    assert [channel.channel for channel in found.channels] == ["a", "b", "all"]
    assert found.channels[1].rmse == pytest.approx(np.sqrt(np.mean(errors[..., 1] ** 2)))
    expected = [np.mean(np.abs(errors[..., 0]) < 0.1 * quantile) for quantile in (0.6744898, 1.2815516, 1.959964)]
    assert found.channels[0].coverage == pytest.approx(expected)


def test_errors_larger_than_predicted_fail_and_the_channel_is_named(errors):
    found = judge(errors, np.ones((40, 25, 2)) * [0.1, 0.12], ("a", "b"))
    assert not found.passed
    assert all(reason.startswith(("b: ", "all: ")) for reason in found.failures)
    assert "intervals cover" in found.failures[0]
    assert "held-out runs, expected at least 85%" in found.failures[0]


def test_an_error_that_is_not_a_number_fails(errors):
    errors[3, 4, 0] = np.nan
    assert not judge(errors, np.ones(errors.shape), ("a", "b")).passed


def test_windows_are_judged_each_for_itself(errors):
    fine = judge(errors, np.ones((40, 25, 2)) * [0.1, 0.3], ("a", "b"))
    wrong = judge(errors[:20], np.ones((20, 25, 2)) * [0.1, 0.12], ("a", "b"))
    assert together({"": wrong}) == wrong
    found = together({"june: ": fine, "july: ": wrong})
    assert not found.passed
    assert all(failure.startswith(("july: b: ", "july: all: ")) for failure in found.failures)
    assert found.runs == 60
    assert [channel.channel for channel in found.channels] == [
        "june: a", "june: b", "june: all", "july: a", "july: b", "july: all", "all",
    ]  # fmt: skip
    everything = judge(errors[np.r_[:40, :20]], np.ones((60, 25, 2)), ("a", "b")).channels[-1]
    assert found.channels[-1].rmse == pytest.approx(everything.rmse)
    assert found.channels[-1].worst == pytest.approx(everything.worst)
