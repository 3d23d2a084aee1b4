"""One stretch of the timeline that was flown otherwise."""

import numpy as np
import pytest

from flightcal.check.prepared import prepared
from flightcal.check.wrongs.timeline import stretches
from tests import small

from ..cases import named

FLOWN = [(-1440, "idle"), (20, "busy"), (45, "idle"), (95, "busy"), (125, "idle"), (190, "busy"), (215, "idle")]


def satellite(changes):
    written = small.content()
    written["simulator"]["modes"] = {"idle": {"panel": "1 W"}, "busy": {"panel": "9 W"}}
    times = np.datetime64("2024-03-01T00:00:00") + np.array([at for at, _ in changes]).astype("timedelta64[m]")
    written["simulator"]["timeline"] = [
        {"at": str(at), "mode": mode} for at, (_, mode) in zip(times, changes, strict=True)
    ]
    return written


@pytest.mark.parametrize(
    ("written", "title"),
    [
        (
            [*FLOWN[:3], (155, "busy"), (185, "idle"), *FLOWN[5:]],
            "'busy' of 2024-03-01T02:35:00 in the timeline is 60.0 min late",
        ),
        (
            sorted([*FLOWN, (60, "busy"), (85, "idle")]),
            "'busy' of 2024-03-01T01:00:00 in the timeline did not take place",
        ),
    ],
    ids=["an hour later than it was", "one that was not"],
)
def test_a_stretch_that_was_flown_otherwise_is_named(tmp_path, written, title):
    _, data = small.closed_loop(tmp_path, satellite(FLOWN))
    scenario, _ = small.load(tmp_path, satellite(written))
    assert named(scenario, data)[0].title == title


def test_the_timeline_of_another_satellite_is_told_by_what_was_flown(tmp_path):
    _, data = small.closed_loop(tmp_path, satellite(FLOWN))
    sisters = [(-1440, "idle"), (30, "busy"), (75, "idle"), (140, "busy"), (150, "idle")]
    scenario, _ = small.load(tmp_path, satellite(sisters))
    first = named(scenario, data)[0]
    assert first.kind == "mode"
    assert "in another mode than the scenario says" in first.title


def test_a_right_timeline_is_not_suspected(tmp_path):
    scenario, data = small.closed_loop(tmp_path, satellite(FLOWN))
    assert named(scenario, data) == ()


def test_stretches_keep_their_order_and_lie_between_two_of_the_same_mode(tmp_path):
    changes = [*FLOWN[:3], (60, "busy"), (65, "idle"), *FLOWN[3:]]
    view = prepared(*small.closed_loop(tmp_path, satellite(changes)))
    assert view is not None
    found = [(wrong.about, wrong.words.title) for wrong in stretches(view)]
    # Not the mode in which it is most of the time; the last begins after the window.
    assert {about for about, _ in found} == {f"timeline {k}" for k in (1, 3, 5)}
    # Fifteen minutes lie between the two: later by more the first would change places with the second.
    late = [title.split(" is ")[1] for about, title in found if about == "timeline 1" and "early" in title]
    assert late == ["4.0 min early", "8.0 min early", "12.0 min early"]
