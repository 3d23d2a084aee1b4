"""Units and long names as attributes."""

import numpy as np
import xarray

from flightcal.run import labelled


def test_variables_and_coordinates_are_labelled_and_text_has_no_unit():
    data = xarray.Dataset({"mean": ("channel", [1.0]), "noise": ("channel", ["white"])}, {"channel": ["tank"]})
    words = {"mean": ("K", "predicted"), "noise": ("", "what is assumed"), "none": ("W", "not there")}
    found = labelled(data, words)
    assert found["mean"].attrs == {"units": "K", "long_name": "predicted"}
    assert found["noise"].attrs == {"long_name": "what is assumed"}
    assert found["channel"].attrs == {"long_name": "temperature channel"}
    assert not data["mean"].attrs


def test_a_plain_number_has_the_unit_1_and_time_keeps_its_own():
    time = np.array(["2024-03-01"], "datetime64[ns]")
    found = labelled(xarray.Dataset({"share": ("time", [0.5])}, {"time": time}), {"share": ("", "a share")})
    assert found["share"].attrs["units"] == "1"
    assert "units" not in found["time"].attrs
