"""Checks before sampling: what the data can tell, and whether prior and sampler will get along with them."""

from .run import CheckSummary, check, check_scenario

__all__ = ["CheckSummary", "check", "check_scenario"]
