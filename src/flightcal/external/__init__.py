"""Simulators that flightcal did not write, behind the one `Simulator` protocol."""
