"""A run's folder and the records in it; knows nothing of heat."""

from .folder import Run, hash_of, hash_of_file, open_run, read_provenance, write_atomically
from .records import plain, read_dataset, read_json, read_records, read_tree, typed

__all__ = [
    "Run",
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
