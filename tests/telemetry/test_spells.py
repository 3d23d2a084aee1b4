"""Stretches of True."""

import numpy as np
import pytest

from flightcal.telemetry import spells


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        ("", []),
        ("000", []),
        ("111", [[0, 3]]),
        ("0110", [[1, 3]]),
        ("1001011", [[0, 1], [3, 4], [5, 7]]),
    ],
)
def test_a_spell_is_from_its_first_sample_to_the_one_past_its_last(flags, expected):
    found = spells(np.array([flag == "1" for flag in flags], bool))
    assert found.shape == (len(expected), 2)
    assert found.tolist() == expected
