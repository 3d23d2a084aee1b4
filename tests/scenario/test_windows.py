"""Windows in groups: their names, lines and overlaps."""

import pytest

from flightcal.scenario import lint, load_scenario, resolved_yaml

from .. import small

FIRST = {"start": "2024-03-01T00:00:00", "end": "2024-03-01T01:30:00"}
SECOND = {"start": "2024-03-01T02:00:00", "end": "2024-03-01T03:30:00"}
THIRD = {"start": "2024-03-01T04:00:00", "end": "2024-03-01T05:00:00"}


def load(folder, windows, **parameter):
    written = small.content()
    written["windows"] = windows
    written["parameters"]["link"] |= parameter
    return small.load(folder, written)[0]


@pytest.mark.parametrize("train", [[FIRST, SECOND], {"1": FIRST, "2": SECOND}], ids=["list", "mapping"])
def test_several_windows_to_train_on_are_a_list_or_a_mapping(tmp_path, train):
    scenario = load(tmp_path, {"train": train, "test": THIRD}, drift=0.3)
    assert scenario.train_windows == ("train.1", "train.2")
    assert list(scenario.windows) == ["train.1", "train.2", "test"]
    (tmp_path / "again.yaml").write_text(resolved_yaml(scenario))
    assert load_scenario(tmp_path / "again.yaml") == scenario


def findings(folder, windows, **parameter):
    try:
        load(folder, windows, **parameter)
    except Exception:
        return [str(finding) for finding in lint(folder / "scenario.yaml")]
    return []


@pytest.mark.parametrize(
    ("windows", "message"),
    [
        (
            {"train": {"a": FIRST, "b": FIRST | {"start": "2024-03-01T01:00:00", "end": "2024-03-01T02:00:00"}}},
            "windows.train.b: found an overlap with 'train.a', expected unseen telemetry",
        ),
        (
            {"train": [FIRST, SECOND], "test": [SECOND]},
            "windows.test.1: found an overlap with 'train.2', expected unseen telemetry",
        ),
        ({"trains": [FIRST, SECOND]}, "windows: missing window 'train'"),
        ({"train": {"a": FIRST, "b": {"start": "2024-03-01T02:00:00"}}}, "windows.train.b: "),
        ({"train": {"a.b": FIRST, "c": SECOND}}, "found the name 'a.b'"),
        ({"train": FIRST | {"planned": True}}, "windows.train.planned: found true, expected telemetry to train on"),
    ],
)
def test_what_is_wrong_with_windows_in_a_group_is_said_in_its_place(tmp_path, windows, message):
    found = findings(tmp_path, windows)
    assert any(message in text for text in found), found
    text = (tmp_path / "scenario.yaml").read_text().splitlines()
    line = int(found[0].split(":")[1])
    assert line > text.index("windows:"), "the line is that of the window, or of the block"


def test_a_parameter_may_drift_with_one_window_to_train_on(tmp_path):
    assert findings(tmp_path, {"train": FIRST}, drift=0.3) == []
