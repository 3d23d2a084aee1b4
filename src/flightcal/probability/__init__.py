"""The probability model: priors of theta, and how telemetry differs from a simulation (noise, discrepancy, switches).

It knows of no calibration: `calibration/problem.py` puts it together with a simulator.
"""
