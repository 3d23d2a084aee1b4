"""Runs of many kinds, and the decision that the first screen of each page must give: the table is `CASES`.

A reader sees the first screen alone and must know three things: may the run be used, why (the channel, heater or
parameter by name), and what to do next.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable

import numpy as np
import xarray as xr

from flightcal.calibration import Calibrated
from flightcal.errors import GATE_FAILED, MODEL_FAILED, WITH_LIMITS
from flightcal.prediction import ANY
from flightcal.prediction.holding import replicate
from flightcal.report.masking import masked
from flightcal.report.run_files import RunFiles

from . import test_discrepancy, test_heat
from .test_verdict import fitted, sampled, seconds_of

LONG = "battery_pack_temperature_of_the_inner_cells_near_the_radiator"


def good(run):
    return fitted(run)


def bad_model(run):
    return sampled(run)


def not_converged(run):
    return dataclasses.replace(fitted(run), diagnostics=run.diagnostics)


def with_attributes(run, **attributes):
    """The same posterior with other attributes."""
    tree = run.posterior.copy()
    tree.attrs = run.posterior.attrs | attributes
    return dataclasses.replace(run, posterior=tree)


def interrupted(run):
    return with_attributes(fitted(run), interrupted="true")


def killed_before_a_posterior(run):
    lacking = ("posterior.nc", "diagnostics.json", "prediction.nc", "metrics.json")
    return dataclasses.replace(
        run, posterior=None, diagnostics=None, windows={}, metrics=[], calibrated=(), missing=lacking
    )


def killed_before_a_prediction(run):
    lacking = ("prediction.nc", "metrics.json")
    return dataclasses.replace(fitted(run), windows={}, metrics=[], calibrated=(), missing=lacking)


def one_channel_fails(run):
    return fitted(run, shifted=[1])


def all_channels_fail(run):
    return fitted(run, shifted=[0, 1, 2])


def all_channels_fail_where_training_was_not(run):
    return elsewhere(all_channels_fail(run))


def one_of_two_windows_fails(run):
    right, wrong = fitted(run), fitted(run, shifted=[2])
    return dataclasses.replace(right, windows=right.windows | {"two_months_later": wrong.windows["test"]})


def colder_by_a_little(run):
    return fitted(run, shifted=[0], by=-1.5)


def errors_as_long_as_the_window(run):
    """Each draw is off by its own 2 K all the time, and the battery lies on its interval's upper end."""
    right, rng = fitted(run), np.random.default_rng(2)
    test = right.windows["test"]
    mean, deviation = (test[key].sel({"by": "stochastic"}).values for key in ("mean", "standard_deviation"))
    draws = mean + 2.0 * rng.normal(size=(300, 1, 3)) + deviation * rng.normal(size=(300, *mean.shape))
    observed = mean + deviation * rng.normal(size=mean.shape)
    observed[:, 1] += (np.quantile(draws, 0.975, axis=0) - mean)[:, 1]
    stochastic = test["by"] == "stochastic"
    ends = {
        name: xr.where(stochastic, xr.DataArray(np.quantile(draws, tail, axis=0), dims=("time", "channel")), test[name])
        for name, tail in (("lower", 0.025), ("upper", 0.975))
    }
    held = replicate(seconds_of(test), observed, test["scored"].values, draws, 0.95)
    made = test.assign(observed=(("time", "channel"), observed), **ends, **held.dataset().variables)
    return dataclasses.replace(right, windows=right.windows | {"test": made})


def errors_where_training_was_not(run):
    return elsewhere(errors_as_long_as_the_window(run))


def elsewhere(run):
    """Two thirds of the window that is tested on are outside of what training contained."""
    unseen = [{"name": ANY, "share": 0.66}, {"name": "sunlight on panel", "share": 0.6}]
    test = run.windows["test"].assign_attrs(unseen=json.dumps(unseen))
    return dataclasses.replace(run, windows=run.windows | {"test": test})


def one_channel_says_nothing(run):
    """The battery's intervals are 40 K wide: whatever it reads is inside."""
    right = fitted(run)
    test = right.windows["test"]
    wide = xr.where(test["channel"] == "battery_temperature", 20.0, 0.0) * xr.where(
        test["by"] == "stochastic", 1.0, 0.0
    )
    score = xr.where(test["channel"] == "battery_temperature", 0.23 * 20.0 / 1.96, test["crps"])
    made = test.assign(lower=test["lower"] - wide, upper=test["upper"] + wide, crps=score)
    return dataclasses.replace(right, windows=right.windows | {"test": made})


def no_heaters(run):
    right = fitted(run)
    windows = {
        name: window.drop_dims("heater").assign_coords(heater=("heater", np.array([], str)))
        for name, window in right.windows.items()
    }
    return dataclasses.replace(right, windows=windows)


def heater_is_off(run):
    right = fitted(run)
    test = right.windows["test"]
    status = test["observed_status"].copy()
    status[: 9 * len(status) // 10, 0] = 1.0
    changed = test.assign(observed_status=status, observed_duty_cycle=status.mean("time"))
    return dataclasses.replace(right, windows=right.windows | {"test": changed})


def status_is_of_passes(run):
    """On in all of them, and a third of the whole window."""
    right = fitted(run)
    test = right.windows["test"]
    known = {name: test[name] * 0.0 + 1.0 for name in ("sampled_duty_cycle", "observed_duty_cycle")}
    changed = test.assign(duty_cycle=test["duty_cycle"] * 0.0 + 1.0 / 3.0, **known)
    return dataclasses.replace(right, windows=right.windows | {"test": changed})


def with_a_plan(run):
    """A window of which nothing is measured, beside one that is scored."""
    right = fitted(run)
    test = right.windows["test"]
    nothing = {name: test[name] * np.nan for name in ("observed", "observed_status", "observed_duty_cycle", "coverage")}
    plan = test.assign(nothing).assign_attrs(planned=1)
    return dataclasses.replace(right, windows=right.windows | {"test.tomorrow": plan})


def with_a_limit(run):
    """The same, where the first channel goes below its limit with a chance of a quarter."""
    planned = with_a_plan(run)
    plan = planned.windows["test.tomorrow"]
    limit = plan["lower_limit"].copy()
    limit[0] = float(plan["lowest"].isel(channel=0).quantile(0.25))
    windows = planned.windows | {"test.tomorrow": plan.assign(lower_limit=limit)}
    return dataclasses.replace(planned, windows=windows)


def status_is_not_measured(run):
    right = fitted(run)
    windows = {
        name: window.assign(
            observed_status=window["observed_status"] * np.nan,
            observed_duty_cycle=window["observed_duty_cycle"] * np.nan,
            sampled_duty_cycle=window["sampled_duty_cycle"] * np.nan,
        )
        for name, window in right.windows.items()
    }
    return dataclasses.replace(right, windows=windows)


def nothing_unseen(run):
    right = fitted(run)
    return dataclasses.replace(right, windows={"train": right.windows["train"]})


def with_prior_score(run, score):
    """The same, with battery_link so many deviations from where its prior has it."""
    rows = [
        record | {"prior_score": score if record["name"] == "battery_link" else 0.1}
        for record in run.diagnostics["parameters"]
    ]
    right = fitted(run)
    return dataclasses.replace(right, diagnostics=right.diagnostics | {"parameters": rows})


def prior_is_doubtful(run):
    return with_prior_score(run, 4.2)


def prior_is_far_off(run):
    return with_prior_score(run, 9.0)


def with_suspect(run, title, advice):
    """The run with something that was likely to be wrong before any sampling."""
    suspect = {"title": title, "sentence": "With it the telemetry is explained.", "advice": advice}
    return dataclasses.replace(fitted(run), suspects=[suspect])


def clock_is_late(run):
    advice = "Check the time column: its zone, its leap seconds, the epoch of the orbit; shift it by -240 s"
    return with_suspect(run, "The telemetry's clock is 4 min late", advice)


def channels_are_swapped(run):
    both = "battery_temperature and payload_temperature"
    advice = f"Exchange 'column' of {both} in 'telemetry: channels' (or their nodes in 'observations')"
    return with_suspect(run, f"{both} are swapped", advice)


def much_heat(run):
    """Heat of a fifth of what flows."""
    return test_heat.made(fitted(run), peak=2.0, diagnostics=sampled(run).diagnostics)


def implausible_heat(run):
    return test_heat.made(fitted(run), peak=8.0, diagnostics=sampled(run).diagnostics)


def response_is_not_linear(run):
    gates = [*sampled(run).diagnostics["gates"]]
    gates.append(
        {"name": "response to heat", "passed": False, "found": "0.42 K", "required": "below 0.1 K",
         "advice": "Give heat a smaller scale (heat: pattern: scale)."}
    )  # fmt: skip
    diagnostics = run.diagnostics | {"gates": gates, "passed": False, "verdict": "Converged."}
    return dataclasses.replace(fitted(run), diagnostics=diagnostics)


def another_explanation(run):
    other = [{"differs": [["battery_link", 0.6, 1.2], ["battery_capacity", 3500.0, 5100.0]], "below": 1.3}]
    return with_attributes(fitted(run), other_explanations=json.dumps(other))


def discrepancy_stands_in(run):
    return test_discrepancy.made(fitted(run))


def many_channels_and_parameters(run):
    """Twelve channels of which two fail, and thirty parameters."""
    right, names = fitted(run, shifted=[1]), [f"tray_{k // 2}_{'inner' if k % 2 else 'outer'}_temp" for k in range(12)]
    windows = {}
    for name, window in right.windows.items():
        order = [0, 0, 1, 2, 0, 2, 0, 0, 1, 2, 2, 0]
        windows[name] = window.isel(channel=order).assign_coords(channel=names)
    rows = tuple(
        Calibrated(f"conductance_{k}", "parameter", "W/K", 0.5, 0.1, 2.0, 0.6 + k / 100, 0.6, 0.02, 0.55, 0.65, 0.97)
        for k in range(30)
    )
    return dataclasses.replace(right, windows=windows, calibrated=rows)


def one_channel_of_a_long_name(run):
    right = fitted(run, shifted=[1])
    windows = {name: window.isel(channel=[1]).assign_coords(channel=[LONG]) for name, window in right.windows.items()}
    return dataclasses.replace(right, windows=windows)


def masked_to_be_passed_on(run):
    return masked(fitted(run, shifted=[1]))


USE, NOT = "Use it.", "Do not use it."
ALL = "Use it for temperatures of all 3 channels, but not for"
TRIED = "flightcal backtest scenario.yaml --out backtest"
CHECK = "flightcal check scenario.yaml --out checked"
AGAIN = "Run the same command again: it takes up where it stopped."
HOLDS = "Intervals hold on “test”, in every channel"
FAILS = "Intervals do not hold in 1 of 3 channels, worst"
BATTERY = (
    "Use it for temperatures of panel_temperature and payload_temperature, but not for temperatures of "
    "battery_temperature."
)


@dataclasses.dataclass(frozen=True)
class Case:
    """A kind of run, and what its first screen has to say."""

    what: str
    make: Callable[[RunFiles], RunFiles]
    """Of the made-up run."""
    decision: str
    """The verdict, in full."""
    reason: str
    """Of the answers the one that decides, by name."""
    then: str
    """The next step."""
    exit_code: int = 0

    @property
    def name(self) -> str:
        """Of what makes it."""
        return self.make.__name__


def differs(channel: str, kelvins: float, window: str = "test", others: str = "") -> str:
    """The next step where channels are off all the time."""
    more = f", and {others} likewise" if others else ""
    off = f"{abs(kelvins)} K {'above' if kelvins > 0.0 else 'below'} the prediction"
    return f"Find what differs in “{window}”: {channel} is {off} from beginning to end{more}."


CASES = (
    Case("Nothing is wrong.", good, USE, HOLDS, TRIED),
    Case("Nothing is wrong, and there are no heaters.", no_heaters, USE, HOLDS, TRIED),
    Case("Nothing is wrong, and no heater's status is measured.", status_is_not_measured, USE, HOLDS, TRIED),
    Case(
        "The model lacks a heat load: its residuals are no noise.", bad_model, NOT,
        "The residuals are not the independent noise that was assumed, worst payload_temperature",
        "Leave `heat` and `noise` out of the scenario: flightcal then models both.", MODEL_FAILED,
    ),
    Case(
        "The sampler diverged.", not_converged, NOT, "The chains have not converged: divergences, 2 of 1000 draws",
        "Raise the acceptance (nuts: target_acceptance).", GATE_FAILED,
    ),
    Case(
        "Temperatures do not follow heat in proportion.", response_is_not_linear, f"{ALL} parameters.",
        "Do not rely on the parameters: the response to heat is not linear",
        "Give heat a smaller scale (heat: pattern: scale).", WITH_LIMITS,
    ),
    Case("Somebody pressed Ctrl-C.", interrupted, NOT, "The run was interrupted", AGAIN, GATE_FAILED),
    Case(
        "Killed while sampling.", killed_before_a_posterior, NOT, "The sampling did not finish", AGAIN, GATE_FAILED
    ),
    Case(
        "Killed before the prediction.", killed_before_a_prediction, NOT,
        "Nothing is predicted: the run did not finish", AGAIN, MODEL_FAILED,
    ),
    Case(
        "One channel reads 5 K too much in flight.", one_channel_fails, BATTERY,
        f"{FAILS} battery_temperature in “test”, 0.0% inside", differs("battery_temperature", 5.0), WITH_LIMITS,
    ),
    Case(
        "One channel reads 1.5 K too little, hard to see beside its swing of 50 K.", colder_by_a_little,
        "Use it for temperatures of battery_temperature and payload_temperature, but not for temperatures of "
        "panel_temperature.",
        f"{FAILS} panel_temperature in “test”, 9.8% inside", differs("panel_temperature", -1.6), WITH_LIMITS,
    ),
    Case(
        "Half of a channel is outside, all the time on one side: by chance or not.", errors_as_long_as_the_window,
        BATTERY, "of battery_temperature in “test” is inside: too short to tell whether by chance",
        "Add longer windows to test on: windows: {test: {start: ..., end: ...}}", WITH_LIMITS,
    ),
    Case(
        "The same, and the Sun is where it was not in training.", errors_where_training_was_not,
        BATTERY, "too short to tell whether by chance; 66% of the window is outside of what training contained",
        "Train on telemetry like that of “test” too: "
        "windows: {train: {first: {start: ..., end: ...}, second: {start: ..., end: ...}}}", WITH_LIMITS,
    ),
    Case(
        "Nothing is known of a heater: one channel's intervals are so wide that they always hold.",
        one_channel_says_nothing, BATTERY, "Intervals of battery_temperature are 41 K wide and say nothing", CHECK,
        WITH_LIMITS,
    ),
    Case(
        "All channels read 5 K too much, where training was not.", all_channels_fail_where_training_was_not, NOT,
        "; 66% of the window is outside of what training contained", CHECK, MODEL_FAILED,
    ),
    Case(
        "One channel has drifted after two months.", one_of_two_windows_fails,
        "Use it for temperatures of panel_temperature and battery_temperature, but not for temperatures of "
        "payload_temperature.",
        f"{FAILS} payload_temperature in “two_months_later”, 0.0% inside",
        differs("payload_temperature", 5.0, "two_months_later"), WITH_LIMITS,
    ),
    Case(
        "All channels read 5 K too much.", all_channels_fail, NOT,
        "Intervals do not hold in 3 of 3 channels, worst battery_temperature in “test”, 0.0% inside",
        differs("battery_temperature", 5.0, others="panel_temperature and payload_temperature"), MODEL_FAILED,
    ),
    Case(
        "The only channel, of a long name, reads 5 K too much.", one_channel_of_a_long_name, NOT,
        f"Intervals do not hold: {LONG} in “test”, 0.0% inside", differs(LONG, 5.0), MODEL_FAILED,
    ),
    Case(
        "Two of twelve channels fail; there are thirty parameters.", many_channels_and_parameters,
        "Use it for temperatures of 10 of 12 channels, but not for temperatures of tray_1_outer_temp and "
        "tray_4_outer_temp.",
        "Intervals do not hold in 2 of 12 channels, worst tray_1_outer_temp",
        differs("tray_1_outer_temp", 5.0, others="tray_4_outer_temp"), WITH_LIMITS,
    ),
    Case(
        "A heater is on twice as long as predicted.", heater_is_off, f"{ALL} the duty cycle of battery_heater.",
        "battery_heater is on for 100.0% of “test”, predicted 43.4% to 45.9%", CHECK, WITH_LIMITS,
    ),
    Case(
        "All telemetry was trained on.", nothing_unseen,
        "Use it for the windows that it was trained on, but not for windows that it was not trained on.",
        "No unseen telemetry", "Add a window: windows: {test: {start: ..., end: ...}}", WITH_LIMITS,
    ),
    Case(
        "A number ended in conflict with what was believed.", prior_is_doubtful, f"{ALL} the value of battery_link.",
        "battery_link lies 4.2 deviations from where its prior expects it", CHECK, WITH_LIMITS,
    ),
    Case(
        "A number ended where nobody can believe it.", prior_is_far_off, NOT,
        "battery_link lies 9.0 deviations from where its prior expects it", CHECK, MODEL_FAILED,
    ),
    Case(
        "The telemetry's clock is late.", clock_is_late, NOT, "Likely wrong: The telemetry's clock is 4 min late",
        "Check the time column: its zone, its leap seconds, the epoch of the orbit; shift it by -240 s.", MODEL_FAILED,
    ),
    Case(
        "Two sensors are swapped.", channels_are_swapped, NOT,
        "Likely wrong: battery_temperature and payload_temperature are swapped",
        "Exchange 'column' of battery_temperature and payload_temperature in 'telemetry: channels'", MODEL_FAILED,
    ),
    Case(
        "The scenario lacks some heat.", much_heat, f"{ALL} values of parameters.",
        "Unmodelled heat is large: battery, 13% of what flows",
        "Find what heats or cools battery and the scenario lacks: a mode's power, a load, a pass, a shadow.",
        WITH_LIMITS,
    ),
    Case(
        "Heat that nobody described hides a wrong set-up.", implausible_heat, NOT,
        "Unmodelled heat is implausibly large: battery, 51% of what flows", CHECK, MODEL_FAILED,
    ),
    Case(
        "Two sets of numbers fit the telemetry.", another_explanation,
        f"{ALL} the values of battery_link and battery_capacity.", "Another explanation fits nearly as well",
        "Train on a window that begins at another time.", WITH_LIMITS,
    ),
    Case(
        "A number cannot be told from what the model lacks.", discrepancy_stands_in,
        f"{ALL} the value of battery_link.", "stands in for battery_link", CHECK, WITH_LIMITS,
    ),
    Case(
        "One channel reads 5 K too much, on a page to pass on.", masked_to_be_passed_on,
        "Use it for temperatures of channel 1 and channel 3, but not for temperatures of channel 2.",
        f"{FAILS} channel 2 in “test”, 0.0% inside", differs("channel 2", 5.0), WITH_LIMITS,
    ),
)  # fmt: skip
