"""The report of a run directory: one HTML page with figures, tables and a verdict, readable offline."""

from .comparison_page import write_comparison
from .page import write_report
from .validation_page import write_validation

__all__ = ["write_comparison", "write_report", "write_validation"]
