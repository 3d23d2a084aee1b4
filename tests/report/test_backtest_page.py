"""What a backtest's page says of origins after which intervals did not hold."""

import json

import pytest

from flightcal.errors import RunError
from flightcal.report import write_backtest
from flightcal.report.backtest_page import _below, _title


@pytest.mark.parametrize("why", ["", "below 60.0%", "7.0 deviations off for five minutes or more, above 5.0"])
def test_it_is_told_why_intervals_did_not_hold(why):
    record = {"coverage": [0.95, 0.5], "why": ["", why]}
    assert _below(record, ["a", "b"]) == ([f"b 50.0%, {why}"] if why else [])
    assert _title(record, 0) == "95.0%"
    assert (f"✕ 50.0%, {why}" in _title(record, 1)) == bool(why)


def test_a_channel_that_is_not_scored_is_no_failure():
    assert _below({"coverage": [None], "why": [""]}, ["a"]) == []


def test_a_backtest_of_an_earlier_version_is_told_to_be_made_again(tmp_path):
    (tmp_path / "backtest.json").write_text(json.dumps({"origins": [{"name": "1", "coverage": [0.5]}]}))
    with pytest.raises(RunError, match="run `flightcal backtest` into this folder again"):
        write_backtest(tmp_path)
