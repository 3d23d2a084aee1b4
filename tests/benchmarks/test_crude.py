"""Satellites of the independent simulation, and ways to be wrong of them."""

import json

import numpy as np
import pytest
from benchmarks.attack.files import put
from benchmarks.crude.satellites import satellites, written
from benchmarks.crude.simulation import EPOCH, outside
from benchmarks.crude.variants import VARIANTS, fits

from flightcal.environment import face_fluxes
from flightcal.scenario import load_scenario

KNOWN = satellites()


@pytest.mark.slow
@pytest.mark.parametrize("variant", VARIANTS, ids=lambda variant: variant.name)
def test_every_variant_of_a_satellite_is_a_scenario_that_can_be_read(variant, tmp_path):
    made = variant.make(next(satellite for satellite in KNOWN.values() if fits(variant, satellite)))
    assert load_scenario(put(tmp_path, made.scenario, made.table)).train_windows
    assert np.isfinite(made.table.select_dtypes("number").to_numpy()).all()


@pytest.mark.parametrize("name", list(KNOWN))
def test_what_falls_on_faces_is_what_flightcal_says(name, tmp_path):
    """Two programs of one physics: shadow, albedo and infrared agree to some percent of what is absorbed at most."""
    satellite = KNOWN[name]
    seconds = np.linspace(3600.0, 3600.0 + satellite.craft.orbit.period, 60)
    absorbed, _ = outside(satellite.craft, seconds)
    (tmp_path / "telemetry.csv").touch()
    (tmp_path / "scenario.yaml").write_text(json.dumps(written(satellite)), encoding="utf-8")
    environment = load_scenario(tmp_path / "scenario.yaml").environment
    faces = satellite.craft.faces
    times = EPOCH + (1e3 * seconds).astype("timedelta64[ms]")
    found = face_fluxes(environment, {key: tuple(face.normal) for key, face in faces.items()}, times)
    size, alpha, epsilon = (
        np.array([getattr(face, key) for face in faces.values()]) for key in ("area", "absorptivity", "emissivity")
    )
    wanted = size * (alpha * (found.solar + 0.3 * found.albedo) + epsilon * 237.0 * found.infrared)
    apart = np.abs(absorbed - wanted)
    assert np.median(apart, axis=0) == pytest.approx(0.0, abs=0.02 * wanted.max())
    assert np.quantile(apart, 0.95) < 0.06 * wanted.max()
