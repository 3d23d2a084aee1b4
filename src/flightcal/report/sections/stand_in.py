"""Of what stood in for a simulator during the calibration: an emulator or a reduced model."""

from __future__ import annotations

from .. import block, tables
from ..block import Block
from ..run_files import RunFiles
from ..text import count, number


def emulator(run: RunFiles) -> list[Block]:
    """How the emulator was learnt, and the simulator itself beside it."""
    record = run.emulator or {}
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
        block.table(tables.emulator_rounds(record)),
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
            Block("heading", "The simulator itself at the posterior's mean and at draws"),
            block.text(
                f"{check['runs']} runs that the emulator has not seen; {check['failed']} more failed. Over the draws "
                f"the simulator's log density and the emulator's differ by {number(check['density_error'], 2)} "
                "(standard deviation): to first order no mean is off by more than so many of its standard deviations."
            ),
            block.table(tables.emulator_check(check)),
        ]
    return blocks


def full_simulator(run: RunFiles) -> list[Block]:
    """The operational simulator beside its reduced model."""
    check = run.full_check or {}
    return [
        block.text(
            "The calibration went through a reduced model. Here it is beside the operational simulator that it stands "
            f"for, on-board software in the loop, on the training window: {count(check['flights'])} flights, at the "
            f"posterior's mean and at draws from it ({count(check['failed'])} could not be compared). The difference "
            "is reduced minus operational; it includes what the software does that a thermostat does not, and the "
            "flight's own initial temperatures. A sensor whose heater cycles out of step differs by up to its band."
        ),
        block.table(tables.full_check(check)),
    ]
