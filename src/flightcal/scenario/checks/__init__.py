"""What blocks of a scenario must be to each other; one module and one line here for each concern."""

from . import (
    calibration,
    environment,
    external,
    heat,
    heating,
    names,
    network,
    observations,
    parameters,
    residuals,
    telemetry,
    windows,
)
from .common import Check

CHECKS: tuple[Check, ...] = (
    names.check,
    telemetry.check,
    environment.check,
    network.check,
    heating.check,
    external.check,
    parameters.check,
    observations.check,
    residuals.check,
    heat.check,
    windows.check,
    calibration.check,
)
