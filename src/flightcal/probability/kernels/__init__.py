"""Compiled code that kinds of noise share, and of priors and switches; nothing else."""
