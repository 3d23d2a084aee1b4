"""Campaigns: a simulator run at every theta of a design, on this machine or on a cluster, each run kept."""

from .folder import Design, locked, open_campaign, prepare
from .store import DamagedRecord, RunStore
from .subject import Subject, input_hashes, scenario_parts

__all__ = [
    "DamagedRecord",
    "Design",
    "RunStore",
    "Subject",
    "input_hashes",
    "locked",
    "open_campaign",
    "prepare",
    "scenario_parts",
]
