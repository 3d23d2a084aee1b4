"""Files of reduced models."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from flightcal.commands.demo import DEMO
from flightcal.errors import ScenarioError
from flightcal.reduction.storage import load, save


def test_a_file_is_read_once_and_again_where_it_has_changed(tmp_path):
    file = tmp_path / "rom.nc"
    shutil.copy(DEMO / "reduced" / "reduced_model.nc", file)
    first = load(file)
    assert load(file) is first
    save(file, replace(first, model=replace(first.model, initial=first.model.initial + 1.0)))
    np.testing.assert_allclose(load(file).model.initial, first.model.initial + 1.0, rtol=1e-15)
    file.unlink()
    with pytest.raises(ScenarioError, match="cannot be read as a reduced model"):
        load(file)
