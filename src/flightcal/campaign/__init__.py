"""Campaigns: a simulator run at every theta of a design, on this machine or on a cluster, each run kept."""

from .campaign import Tally, run_campaign
from .folder import Design, locked, open_campaign, prepare
from .job import Job, RunFunction, run_function
from .store import DamagedRecord, RunStore
from .subject import Subject, input_hashes, scenario_parts

__all__ = [
    "DamagedRecord",
    "Design",
    "Job",
    "RunFunction",
    "RunStore",
    "Subject",
    "Tally",
    "input_hashes",
    "locked",
    "open_campaign",
    "prepare",
    "run_campaign",
    "run_function",
    "scenario_parts",
]
