"""Attacks: what must neither end in a traceback nor lose a file. `python -m benchmarks.attack` runs all campaigns."""
