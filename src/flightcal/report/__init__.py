"""The report of a run directory: one HTML page with figures, tables and a verdict, readable offline."""

from .page import write_report
from .validation_page import write_validation

__all__ = ["write_report", "write_validation"]
