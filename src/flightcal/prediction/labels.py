"""What the variables of a prediction are, in words, and their units."""

from __future__ import annotations

from typing import Final

LABELS: Final[dict[str, tuple[str, str]]] = {
    "observed": ("K", "telemetry"),
    "scored": ("1", "whether a sample counts in the scores"),
    "mean": ("K", "predicted temperature"),
    "lower": ("K", "lower end of the interval"),
    "upper": ("K", "upper end of the interval"),
    "standard_deviation": ("K", "standard deviation of the prediction"),
    "model_lower": ("K", "lower end of the interval without measurement noise"),
    "model_upper": ("K", "upper end of the interval without measurement noise"),
    "lowest": (
        "K",
        "lowest temperature of a simulation, of a plan in what is still to come, without measurement noise",
    ),
    "highest": (
        "K",
        "highest temperature of a simulation, of a plan in what is still to come, without measurement noise",
    ),
    "lower_limit": ("K", "lowest temperature that operations allow"),
    "upper_limit": ("K", "highest temperature that operations allow"),
    "crps": ("K", "continuous ranked probability score"),
    "probability_below": ("1", "predicted probability of less than the telemetry"),
    "observed_status": ("1", "measured status of the heater"),
    "status": ("1", "predicted status of the heater: share of the simulations in which it is on"),
    "duty_cycle": ("1", "share of the window in which the heater is on"),
    "sampled_duty_cycle": ("1", "share of the samples of known status in which the heater is on"),
    "switch_count": ("1", "times that the heater switches"),
    "energy": ("J", "energy of the heater"),
    "point_duty_cycle": ("1", "share of the window in which the heater is on"),
    "point_sampled_duty_cycle": ("1", "share of the samples of known status in which the heater is on"),
    "point_switch_count": ("1", "times that the heater switches"),
    "point_energy": ("J", "energy of the heater"),
    "observed_duty_cycle": ("1", "measured share of the samples of known status in which the heater is on"),
    "unknown_status": ("1", "share of the window in which the status is not known"),
    "observed_switch_count": ("1", "measured times that the heater switches"),
    "eclipse": ("1", "sunlit share of the solar disc"),
    "orbit_phase": ("1", "phase of the orbit"),
    "coverage": ("1", "share of the scored telemetry inside the interval"),
    "replicated": ("1", "the same share for draws of the prediction in the place of the telemetry"),
    "error": ("1", "root mean square of the telemetry's distances from the mean, in deviations of the prediction"),
    "replicated_error": ("1", "the same for draws of the prediction in the place of the telemetry"),
    "lasting": ("1", "largest distance from the mean that lasts for five minutes or more, in standard deviations"),
    "replicated_lasting": ("1", "the same for draws of the prediction in the place of the telemetry"),
    "threshold_offset": ("K", "how far above its threshold the heater switches, as its status shows"),
    "least_threshold_offset": ("K", "the same, of which 95% of the draws have more"),
    "noise": ("", "noise that is assumed"),
    "discrepant": ("", "whether a discrepancy is assumed"),
    "innovation": ("1", "residual without what is expected from the one before, in its deviations"),
    "discrepancy_mean": ("K", "mean of the discrepancy"),
    "discrepancy_lower": ("K", "lower end of the discrepancy's interval"),
    "discrepancy_upper": ("K", "upper end of the discrepancy's interval"),
}
"""Variable of a group of prediction.nc -> its unit and what it is."""
