"""What a backtest's page says of origins after which intervals did not hold."""

import pytest

from flightcal.report.backtest_page import _below, _title


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({}, ""),
        ({"coverage": 0.5}, "50.0%, below 60.0%"),
        ({"error": 3.2}, "95.0%, 3.2 deviations off, above 3.0"),
        ({"lasting": 7.0}, "95.0%, 7.0 deviations off for five minutes or more, above 5.0"),
        ({"coverage": None, "error": 9.0}, ""),
        ({"lasting": None}, ""),
    ],
)
def test_it_is_told_why_intervals_did_not_hold(changed, why):
    right = {"coverage": 0.95, "lower": 0.6, "error": 1.0, "most_error": 3.0, "lasting": 2.0, "most_lasting": 5.0}
    own = {name: [value, changed.get(name, value)] for name, value in right.items()}
    assert _below(own, ["a", "b"]) == ([f"b {why}"] if why else [])
    assert _title(own, 0) == "95.0%"
    assert (f"✕ {why}" in _title(own, 1)) == bool(why)
