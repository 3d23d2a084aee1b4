"""A run's folder, its stages, the records in it, and work in many processes; knows nothing of heat.

Imports: errors, progress.
"""

from .files import locked, sweep, write_bytes
from .folder import (
    INPUT_FILES,
    REDUCED,
    OtherRunError,
    RunDirectory,
    check_whole,
    hash_of,
    hash_of_file,
    hold,
    open_run,
    read_provenance,
)
from .labels import labelled
from .records import (
    plain,
    read_dataset,
    read_json,
    read_records,
    read_tree,
    typed,
    write_json,
    write_netcdf,
    write_text,
)
from .stages import Run, Stage, numbers_told
from .workers import ATTEMPTS, each
