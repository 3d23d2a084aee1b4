"""Compiled code that kinds of noise share, and of priors, switches, heat and other shapes."""
