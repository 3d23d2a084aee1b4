"""A run's folder, its stages, the records in it, and work in many processes; knows nothing of heat.

Imports: errors, progress.
"""

from .folder import RunDirectory, hash_of, hash_of_file, open_run, read_provenance
from .records import (
    plain,
    read_dataset,
    read_json,
    read_records,
    read_tree,
    typed,
    write_atomically,
    write_json,
    write_netcdf,
    write_text,
)
from .stages import Run, Stage
from .workers import each

__all__ = [
    "Run",
    "RunDirectory",
    "Stage",
    "each",
    "hash_of",
    "hash_of_file",
    "open_run",
    "plain",
    "read_dataset",
    "read_json",
    "read_provenance",
    "read_records",
    "read_tree",
    "typed",
    "write_atomically",
    "write_json",
    "write_netcdf",
    "write_text",
]
