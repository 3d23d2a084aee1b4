"""How numbers, units, times and lists are written for people: on pages, on terminals and in messages.

Imports: nothing.
"""

from .text import (
    chance,
    count,
    duration,
    in_digits,
    interval,
    labelled,
    letter,
    listed,
    minute,
    moment,
    number,
    percent,
    shown,
    signed_percent,
    unit,
    without_paths,
)
