"""Training windows left out in turn: what is calibrated on, and how the one that is left is predicted."""

from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from flightcal import prediction
from flightcal.cli import USER_ERROR, app
from flightcal.errors import RunError
from flightcal.scenario import ExternalModel
from flightcal.validation import left_out
from tests import small
from tests.commands.test_calibrate import write
from tests.told import Told


def windows():
    return {
        "train": {
            "first": {"start": "2024-03-01T00:00:00", "end": "2024-03-01T01:30:00"},
            "second": {"start": "2024-03-01T02:10:00", "end": "2024-03-01T03:40:00"},
        },
        "test": {"start": "2024-03-01T04:00:00", "end": "2024-03-01T05:30:00"},
    }


AR1 = {"model": "ar1", "standard_deviation": "0.1 K", "correlation_time": "20 s"}


@pytest.mark.parametrize("noise", [{}, AR1], ids=["inferred", "correlated"])
def test_each_window_is_predicted_as_unseen_by_a_calibration_on_the_others(tmp_path, monkeypatch, noise):
    written = small.content()
    written["windows"], written["noise"] = windows(), noise
    if noise:
        written["observations"]["panel_temp"].pop("noise")
    # Of a single window that is left a drift is known from its prior.
    written["parameters"]["link"]["drift"] = 0.5
    scenario, data = small.closed_loop(tmp_path, written)
    calibrated, told, panel_sizes = [], Told(), []

    def at_the_truth(problem):
        calibrated.append([window.name for window in problem.windows])
        theta = problem.priors.median()
        for name, value in (small.TRUTH | {"noise.body_temp": 0.1, "drift.link": 1e-6}).items():
            if name in problem.names:
                theta[problem.names.index(name)] = value
        diagnostics = SimpleNamespace(passed=len(calibrated) == 1)
        draws = SimpleNamespace(interrupted=len(calibrated) == 3)
        flat = np.tile(theta, (200, 1))
        flat[:, problem.names.index("panel_size")] *= 1.0 + 1e-9 * np.arange(200)
        return SimpleNamespace(flat=flat, diagnostics=diagnostics, draws=draws, problem=problem)

    def predict(*arguments, **options):
        panel_sizes.append(arguments[4][:, 1])
        return prediction.predict(*arguments, **options)

    monkeypatch.setattr(left_out, "calibrate_nuts", at_the_truth)
    monkeypatch.setattr(left_out, "predict", predict)
    found = left_out.leave_windows_out(scenario, data, progress=told)
    assert calibrated == [["train.second"], ["train.first"]]
    assert told.said == ["without first", "without second"]
    assert [len(np.unique(sizes)) for sizes in panel_sizes] == [40, 40]
    assert list(found) == ["first", "second"]
    assert [scores["passed"] for scores in found.values()] == [True, False]
    for scores in found.values():
        assert set(scores) == {"rmse", "mape_kelvin", "mape_celsius", "picp", "mpiw", "crps", "log_score", "passed"}
        assert 0.9 < scores["picp"] <= 1.0
        assert scores["rmse"] < 0.3
        # Two channels with noise of 0.1 K, and little else.
        assert scores["mpiw"] == pytest.approx(4 * 0.1, rel=0.2)
    with pytest.raises(KeyboardInterrupt):
        left_out.leave_windows_out(scenario, data)


def test_one_window_cannot_be_left_out(tmp_path):
    arguments = ["--models", "iid,ar1", "--leave-windows-out", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(app, ["compare", str(write(tmp_path)), *arguments])
    assert result.exit_code == USER_ERROR
    assert "found one window to train on" in result.output
    assert not (tmp_path / "out").exists()
    with pytest.raises(RunError, match="found one window to train on"):
        left_out.leave_windows_out(*small.load(tmp_path))


def test_windows_of_an_external_simulator_cannot_be_left_out():
    scenario = SimpleNamespace(train_windows=("train.a", "train.b"), simulator=ExternalModel.model_construct())
    with pytest.raises(RunError, match="expected a network"):
        left_out.check_windows(scenario)
