"""How the emulator was learnt, and the simulator itself beside it."""

from __future__ import annotations

from ...words import count, number, percent
from .. import block
from ..block import Block, section
from ..run_files import Record, RunFiles
from ..tables import Table


@section("emulator", "Emulator")
def panel(run: RunFiles) -> list[Block]:
    """How the emulator was learnt, and the simulator itself beside it."""
    record = run.emulator
    if record is None:
        return []
    reached = record["reached"]
    blocks = [
        block.text(
            "The simulator has no derivatives, so an emulator stands in for it: principal shapes of its trajectories, "
            f"with Gaussian processes for their coefficients, learnt from {count(record['runs'])} runs. Its error is "
            f"in the likelihood and in the intervals. {record['failures'] or 'No run failed'}."
        ),
        block.text(
            "Each round adds runs where the emulator's error matters most to the posterior. It ends when that error is "
            "expected to shift the posterior by less than the scenario allows, the posterior no longer moves, and runs "
            "not yet seen are covered. "
            + ("It did." if reached else "It did not: the budget of runs was spent before, and intervals are wider.")
        ),
        block.table(rounds(record)),
    ]
    if any(window.sizes.get("heater", 0) for window in run.windows.values()):
        blocks.append(
            block.note(
                "There are thermostats. In closed loop the likelihood has several modes, and what stands in for a "
                "simulator without derivatives has no open loop in which to seek the best of them. So the first rounds "
                "take only the beginning of the window, in which heaters have switched a few times, and the later ones "
                "as much more as the emulator follows. Whether the heaters keep step with the telemetry at the end is "
                "one of the posterior's gates; where no status is measured, nothing tells."
            )
        )
    if run.emulator_check is not None:
        check = run.emulator_check
        blocks += [
            block.heading("The simulator itself at the posterior's mean and at draws"),
            block.text(
                f"{check['runs']} runs that the emulator has not seen; {check['failed']} more failed. Over the draws "
                f"the simulator's log density and the emulator's differ by {number(check['density_error'], 2)} "
                "(standard deviation): to first order no mean is off by more than so many of its standard deviations."
            ),
            block.table(held_out(check)),
        ]
    return blocks


def rounds(record: Record) -> Table:
    """What each round of the active learning found."""
    rows = []
    for r in record["rounds"]:
        covered = r["validation"]["channels"][-1]["coverage"][-1] if r["validation"] else None
        rows.append(
            [count(r["number"]), count(r["runs"]), count(r["failed"]), count(r["fitted"]), count(r["samples"]),
             count(r["shapes"]), number(r["error_share"], 2), number(r["expected_shift"], 2),
             number(r["mean_shift"], 2), percent(covered, 0), r["verdict"]]
        )  # fmt: skip
    header = (
        "round", "runs", "failed", "fitted", "samples", "shapes", "error / noise", "expected shift, sd",
        "mean moved, sd", "new runs covered", "what goes on",
    )  # fmt: skip
    return Table(header, rows, range(10))


def held_out(check: Record) -> Table:
    """How held-out runs were predicted, by channel."""
    rows = [
        [c["channel"], number(c["rmse"], 2), number(c["worst"], 2), number(c["deviation"], 2),
         number(c["standardised"], 2), *(percent(share, 0) for share in c["coverage"])]
        for c in check["channels"]
    ]  # fmt: skip
    header = ("channel", "RMSE, K", "worst, K", "predicted sd, K", "error / sd", "in 50%", "in 80%", "in 95%")
    return Table(header, rows, range(1, 8))
