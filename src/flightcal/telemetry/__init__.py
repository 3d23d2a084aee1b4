"""Flight data: files -> samples in SI on UTC time, a reason for each that is not used; windows; inputs.

Imports: environment, errors, scenario.
"""

from .average import ENOUGH, LONG, MANY, dense_channels, length_in_common
from .bridges import bridged, measured_inputs
from .clean import usual_interval
from .columns import FoundColumn
from .detect import FoundPacket, detect
from .drivers import (
    SHORT_GAP,
    driver_corners,
    driver_gaps,
    driver_jumps,
    driver_series,
    sampled_every,
    status_changes,
    status_fraction,
    status_or_unknown,
    switch_bounds,
)
from .fast_status import is_blurred, smoothed
from .modes import NOTHING, FoundModes
from .noise import quiet_noise
from .quality import quality_table
from .quantisation import quantisation_step
from .read import read, read_telemetry
from .spells import spells
from .window import end_of_telemetry, select_window, when_read, window_bounds
