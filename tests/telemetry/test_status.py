"""What a heater's status is made of: words, a number's threshold, bits of a word."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from flightcal.errors import TelemetryError

from .files import frame, read

NAN = float("nan")


def status(folder: Path, cells: list[str], **channel: Any) -> list[float]:
    """The status that a column of cells is read as."""
    table = pd.DataFrame({"time": frame(len(cells))["time"], "HTR": cells, "n": np.arange(len(cells)) ** 2})
    channels = {"heater": {"column": "HTR", "kind": "status"} | channel}
    return read(folder, table.to_csv(index=False), channels=channels)["heater"].to_numpy().tolist()


@pytest.mark.parametrize(
    ("cells", "channel"),
    [
        (["ENABLED", "DISABLED", "enabled", "OFF"], {}),
        (["Active", "Inactive", "YES", "no"], {}),
        (["CLOSED", "OPEN", "closed", "open"], {}),
        (["HEATING", "STANDBY", "HEATING", "SAFE"], {"on": "HEATING", "off": ["STANDBY", "SAFE"]}),
        (["3", "1", "3", "2"], {"on": 3, "off": [1, 2]}),
    ],
)
def test_words_that_mean_on_and_off(tmp_path: Path, cells: list[str], channel: dict):
    assert status(tmp_path, cells, **channel) == [1, 0, 1, 0]


def test_a_word_that_is_neither_is_told_with_what_was_written(tmp_path: Path):
    with pytest.raises(TelemetryError) as caught:
        status(tmp_path, ["HEATING", "IDLE", "SAFE"], on="HEATING", off="STANDBY")
    assert str(caught.value) == (
        "data.csv: line 4: channel 'heater', column 'HTR': found the status 'SAFE', expected one that means on "
        "(HEATING) or off (STANDBY, 0, OFF, FALSE, ...); a mark of an invalid value belongs in the channel's 'invalid'"
    )


@pytest.mark.parametrize(
    ("channel", "expected"),
    [
        ({"on_above": "0.1 A"}, [0, 0, 1, 1, NAN, NAN]),
        ({"on_above": "99 mA"}, [0, 1, 1, 1, NAN, NAN]),
        ({"on_below": "150 mA"}, [1, 1, 0, 0, NAN, NAN]),
        ({"on_above": "0.1 A", "valid_range": ["0 A", "1 A"]}, [0, 0, 1, NAN, NAN, NAN]),
    ],
)
def test_a_threshold_on_a_current_tells_the_status(tmp_path: Path, channel: dict, expected: list[float]):
    cells = ["3", "100", "480", "2000", "", "-1"]
    np.testing.assert_array_equal(status(tmp_path, cells, unit="mA", invalid=[-1], **channel), expected)


def test_the_currents_of_two_branches_are_added_before_the_threshold(tmp_path: Path):
    table = pd.DataFrame({"time": frame(4)["time"], "A": [0, 60, 0, 60], "B": [0, 0, 110, 60]})
    heater = {"column": ["A", "B"], "combine": "sum", "kind": "status", "unit": "mA", "on_above": "100 mA"}
    dataset = read(tmp_path, table, channels={"heater": heater})
    np.testing.assert_array_equal(dataset["heater"], [0, 0, 1, 1])
    assert (dataset["heater"].attrs["kind"], dataset["heater"].attrs["units"]) == ("status", "")


@pytest.mark.parametrize(
    ("bits", "on", "expected"),
    [
        (0, None, [0, 1, 0, 1, 1]),
        (3, None, [0, 0, 1, 1, 1]),
        (3, 0, [1, 1, 0, 0, 0]),
        ([0, 3], None, [0, 1, 1, 1, 1]),
        ([0, 3], 3, [0, 0, 0, 1, 1]),
        ([3, 0], 1, [0, 0, 1, 0, 0]),
        (62, None, [0, 0, 0, 0, 1]),
    ],
)
@pytest.mark.parametrize(
    "cells",
    [
        ["0", "1", "8", "9", "9223372036854775807"],
        ["0x0", "0x01", "0x08", "0X9", "0xFFFFFFFFFFFFFFFF"],
        ["0b0", "0b1", "0b1000", "0b1001", "-1"],
    ],
)
def test_bits_of_a_word_tell_the_status(tmp_path: Path, cells: list[str], bits: Any, on: Any, expected: list[float]):
    channel = {"bits": bits} | ({} if on is None else {"on": on})
    assert status(tmp_path, cells, **channel) == expected


@pytest.mark.parametrize(
    ("base", "cells"),
    [(16, ["00", "08", "1E8", "07"]), (16, ["0x00", "A8", "ff", "10"]), (2, ["0000", "1000", "11001000", "0111"])],
)
def test_digits_of_words_are_of_the_base_that_is_told(tmp_path: Path, base: int, cells: list[str]):
    assert status(tmp_path, cells, bits=3, base=base) == [0, 1, 1, 0]


@pytest.mark.parametrize(
    ("cells", "key"), [(["4", "0", "12"], {"bits": 2}), (["SEND", "IDLE", "SEND"], {"on": ["SEND"]})]
)
def test_a_driver_of_a_state_is_1_or_0(tmp_path: Path, cells: list[str], key: dict[str, Any]):
    table = pd.DataFrame({"time": frame(3)["time"], "TX": cells})
    dataset = read(tmp_path, table, channels={"radio": {"column": "TX", "kind": "driver", **key}})
    np.testing.assert_array_equal(dataset["radio"], [1, 0, 1])
    assert (dataset["radio"].attrs["kind"], dataset["radio"].attrs["units"]) == ("driver", "")


def test_what_is_no_digit_of_the_base_is_told(tmp_path: Path):
    with pytest.raises(TelemetryError) as caught:
        status(tmp_path, ["0010", "0012"], bits=3, base=2)
    assert str(caught.value) == (
        "data.csv: line 3: channel 'heater', column 'HTR': found the word '0012', expected digits of base 2 such as "
        "10010; a mark of an invalid value belongs in the channel's 'invalid'"
    )


def test_what_is_no_word_is_told_with_its_line(tmp_path: Path):
    assert np.isnan(status(tmp_path, ["4", "0", "", "-99"], bits=2, invalid=-99)[2:]).all()
    for cell in ("FAULT", "1.5", "0x", "1.84467e+19"):
        with pytest.raises(
            TelemetryError, match=rf"line 3: channel 'heater', column 'HTR': found the word .{re.escape(cell)}."
        ):
            status(tmp_path, ["4", cell], bits=2)
