"""The decision from the first screen alone, of short calibrations of satellites that fly and of the bundled one."""

import re
from pathlib import Path

import pytest

from flightcal.commands.calibrate import run_experiment
from flightcal.report import read_run
from flightcal.report.page import render

from .test_browser import needs_browser
from .test_decision import SCREENS, seen_of

EXAMPLES = Path(__file__).parents[2] / "examples"
DATA = Path(__file__).parents[3] / "shared" / "data"
SHORT = """calibration:
  seed: 1
  genetic: {runs: 2, population: 20, generations: 5}
  nuts: {chains: 2, draws: 150, warmup: 200, max_r_hat: 2, min_ess: 5, target_acceptance: 0.9}
  prediction: {simulations: 100}
"""
PUBLISHED = "heat: none\nnoise: {model: iid}\n"
LEAVE = "Next: Leave `heat` and `noise` out of the scenario: flightcal then models both."
NOISE = "The residuals are not the independent noise that was assumed, worst"


def short(example: str, folder: Path, *, published: bool = False) -> Path:
    """The example with a short calibration; published: with the paper's model, which lacks what the example learns."""
    source = EXAMPLES / example
    text = source.read_text(encoding="utf-8")
    text = re.sub(r"(\.\./)+shared/data", str(DATA), text)
    text = re.sub(r"file: (telemetry\S*)", lambda match: f"file: {source.parent / match[1]}", text)
    text = text[: text.index("calibration:")] + SHORT
    if published:
        text = re.sub(r"^heat:\n(  .*\n)+", "", text, flags=re.M) + PUBLISHED
    (folder / "scenario.yaml").write_text(text, encoding="utf-8")
    return folder / "scenario.yaml"


@needs_browser
@pytest.mark.slow
@pytest.mark.skipif(not DATA.exists(), reason="flight data are not here: ../shared/data")
@pytest.mark.parametrize(
    ("example", "published", "words"),
    [
        (
            "bupt1/several_windows.yaml", False,
            (
                "Use it for temperatures of payload_temperature, but not for intervals of parameters",
                "The residuals are not the AR(1) noise that was assumed, worst payload_temperature",
                "flightcal check scenario.yaml --out checked",
            ),
        ),
        # Without its pattern over pitch it lacks far more than any wrong of the set-up explains.
        ("chandra_acis/scenario.yaml", True, ("Do not use it.", "No simple wrong explains the telemetry")),
        ("funcube1/scenario.yaml", True, ("Do not use it.", f"{NOISE} panels_mean", LEAVE)),
        ("leo_observer/published.yaml", False, ("Do not use it.", f"{NOISE} structure_temperature", LEAVE)),
    ],
)  # fmt: skip
def test_what_is_seen_of_a_real_satellite_gives_the_decision(tmp_path, example, published, words):
    run = run_experiment(short(example, tmp_path, published=published), tmp_path / "run").run
    seen = seen_of({"run": render(read_run(run))}, tmp_path)
    for screen in SCREENS:
        found = seen[f"run_{screen}"]
        assert (found["cut"], found["sideways"]) == ([], False)
        assert [word for word in words if word not in found["words"]] == []
