"""The error that remains: discrepancy, residuals, and whether intervals hold what they promise."""

from __future__ import annotations

from collections.abc import Sequence

from flightcal.validation import ResidualCheck, uniformity

from .. import block, discrepancy, tables
from .. import figures as draw
from ..block import Block
from ..run_files import RunFiles, bins, has_prediction
from ..text import listed
from ..verdict import Checks, assumption, correlation_expected, spread


def discrepancies(run: RunFiles) -> list[Block]:
    """What the simulator lacks, as far as it was modelled."""
    windows = {name: window for name, window in run.windows.items() if "discrepancy_mean" in window}
    part = discrepancy.parts(windows)
    blocks = [
        block.text(
            "What the simulator lacks is calibrated with the parameters, as a Gaussian process for each channel. "
            f"{discrepancy.carries_over(part)} It is added to the simulation in the mean and in the intervals."
        ),
        block.table(discrepancy.numbers(run), "Amplitudes and lengthscales are all fixed by the scenario."),
    ]
    if part == "phase":
        name, window = next(iter(windows.items()))
        caption = (
            f"Discrepancy over the orbit, from its start as the window “{name}” counts it: mean and interval of the "
            "posterior. Dots: telemetry minus the simulation alone, which is what the discrepancy has to explain."
        )
        blocks.append(block.figure(draw.figure_discrepancy_in_phase(window), caption))
    else:
        blocks += [
            block.figure(
                draw.figure_discrepancy_in_time(window, bins(run)),
                f"Discrepancy in the window “{name}”: mean and interval of the posterior. Dots: telemetry minus the "
                "simulation alone, which is what the discrepancy has to explain.",
            )
            for name, window in windows.items()
        ]
    blocks += [
        block.text(
            "The interval is that of the discrepancy alone. Each draw's discrepancy makes up for its own simulation, "
            "so their sum, the prediction, is known better than either."
        ),
        block.table(discrepancy.sizes(windows)),
        Block("heading", "How far it can stand in for a parameter"),
    ]
    if run.posterior is None or "discrepancy" not in run.posterior.children:
        why = "It was not determined: there are several training windows, or no posterior (posterior.nc)."
        return [*blocks, block.note(why)]
    return [
        *blocks,
        block.text(
            "Correlation over the posterior's draws of a parameter with how much of the discrepancy lies in the "
            "direction in which that parameter moves the temperatures. Near −1 what the one gives, the other takes: "
            "the parameter's value then rests on the prior of the discrepancy. Near 0 the telemetry tells the two "
            "apart, or, where the contraction is small, nothing about the parameter at all."
        ),
        block.table(discrepancy.confounded(run)),
    ]


def residuals(run: RunFiles, checks: Checks) -> list[Block]:
    """Tests and figures of the residuals, by window."""
    if not checks:
        return [block.note("There is no stochastic prediction in this run, so no residuals.")]
    blocks = [
        *(block.text(words) for words in map(_contradiction, checks, checks.values()) if words),
        block.table(tables.residual_tests(checks)),
        block.text(
            "Residual: telemetry minus the posterior's mean, which includes the expected discrepancy where there is "
            "one. Tested are the residuals, of AR(1) noise its innovations (the part of each residual that those "
            "before it do not tell), of rounded telemetry the noise drawn within the step; the numbers are of that. "
            "“Too narrow by” is √(number / effective number): by about this factor intervals of parameters are too "
            "narrow where the likelihood takes for white what is not. "
            "The posterior rests on what was trained on; other windows show whether the model's error persists."
        ),
    ]
    for name in checks:
        window = run.windows[name]
        blocks.append(Block("heading", f"Window “{name}”"))
        blocks.append(block.figure(draw.figure_residuals(window, bins(run)), f"Residuals in time, window “{name}”."))
        blocks.append(
            block.figure(
                draw.figure_residual_distribution(window),
                f"Distribution and autocorrelation, window “{name}”.",
                wide=True,
            )
        )
    return blocks


def _contradiction(window: str, of_window: Sequence[ResidualCheck]) -> str:
    """In words, how many channels of a window contradict what is assumed; nothing where none can be judged."""
    judged = [c for c in of_window if c.verdict != "unknown"]
    against = [c for c in judged if c.verdict == "contradicted"]
    expected = [c for c in judged if c.verdict == "expected"]
    if not judged:
        return ""
    words = f"Window “{window}”: "
    if against:
        tested = listed(list(dict.fromkeys(c.tested for c in against)))
        alike = min(c.lag1 for c in against) > 0
        dependent = (
            f"each of their {tested} resembles the one before" if alike else f"their {tested} are not independent"
        )
        words += (
            f"{len(against)} of {len(judged)} channels contradict the {assumption(against)} that the likelihood "
            f"assumes: {dependent} (lag-1 autocorrelation {spread([c.lag1 for c in against])}; 0 for what is assumed)."
        )
    else:
        words += f"no channel contradicts {assumption(judged)}."
    if expected:
        tested = listed(list(dict.fromkeys(c.tested for c in expected)))
        words += (
            f" The {tested} of {listed([c.channel for c in expected])} "
            "are correlated, as a discrepancy in time makes them where nothing tells it; the interval contains it."
        )
    return f"{words} {correlation_expected(judged)}".strip()


def reliability(run: RunFiles) -> list[Block]:
    """Whether intervals hold what they promise."""
    windows = {name: window for name, window in run.windows.items() if has_prediction(window, "stochastic")}
    if not windows:
        return [block.note("There is no stochastic prediction in this run, so no reliability of one.")]
    if not all("probability_below" in window for window in windows.values()):
        return [block.note("An earlier version of flightcal predicted this run; it did not keep what this asks for.")]
    blocks = [
        block.table(tables.uniformity({name: uniformity(window) for name, window in windows.items()})),
        block.text(
            "The transform of a sample is the share of the prediction's draws that are of a lower temperature: "
            "predictions that are right make it uniform, ones that are too narrow pile it up at 0 "
            "and 1, ones that are too wide in the middle, biased ones at one end. The test is that of Kolmogorov and "
            "Smirnov for as many independent samples as these are worth; bands of chance use the same number. An "
            "average coverage may be right while parts of the orbit or of the forecast are not covered."
        ),
    ]
    for name, window in windows.items():
        caption = (
            f"Reliability in the window “{name}”: probability integral transform, and share of telemetry inside the "
            "interval by place in the orbit and by hour of the forecast. Grey: what 95% of the values would be by "
            "chance where the interval is right; dotted: the interval's probability."
        )
        blocks.append(block.figure(draw.figure_reliability(window), caption, wide=True))
    return blocks
