"""The report of a run directory: one HTML page with figures, tables and a verdict, readable offline.

Imports: calibration, errors, prediction, probability, run, scenario, simulator, telemetry, validation, words.
"""

from .backtest_page import write_backtest
from .block import Block, Section
from .comparison_page import write_comparison
from .findings import MARKS, ORDER, UNEXPLAINED, Finding, likely
from .heat_map import figure_correlation, heat_map
from .in_short import in_short
from .page import compose, write_report
from .panels.heat import largest_heat
from .run_files import ParameterInfo, read_run
from .style import BAND, GENETIC, LINE, MODEL_BAND, PRIOR, STOCHASTIC, TELEMETRY, WARNING, finish, polygons
from .tables import Cell, Table
from .thinning import break_lines, extremes, followed
from .validation_page import write_validation
from .verdict import Verdict, verdict_of
from .windows import CHANNEL_HEIGHT, scatter, time_canvas
