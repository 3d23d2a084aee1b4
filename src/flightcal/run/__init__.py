"""A run's folder: files written atomically, records, and stages that are not made twice.

Imports: errors.
"""

from .folder import Run, hash_of, hash_of_file, open_run, read_provenance, write_atomically
from .records import plain, read_dataset, read_json, read_records, read_tree, typed
from .workers import each

__all__ = [
    "Run",
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
]
