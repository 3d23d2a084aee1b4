"""The check on the full simulator: what it is made anew for."""

from types import SimpleNamespace

from flightcal.validation import flown_from
from tests.reduction import craft


def test_another_spacecraft_file_is_another_flight(tmp_path):
    craft.write(tmp_path)
    scenario = SimpleNamespace(folder=tmp_path, network=SimpleNamespace(checked_on="reduce.yaml"))
    before = flown_from(scenario)
    assert flown_from(scenario) == before
    craft.write(tmp_path, spacecraft={"initial": "6 degC"})
    assert flown_from(scenario) != before
