"""Campaigns: a simulator run at every theta of a design, on this machine or on a cluster, each run kept.

Imports: errors, external, probability, progress, run, scenario, simulator.
"""

from .campaign import Tally, run_campaign
from .folder import NOT_RUN, Design, open_campaign
from .job import run_function
from .run import Here, Runner
from .subject import Subject, input_hashes, scenario_parts
