"""Do calibrations tell the truth when the simulator lacks heat? Random small satellites whose true numbers are known.

`python -m benchmarks.truth --count 20 --variant iid --out FILE`. Each satellite's parameters are drawn from its priors,
and its telemetry is made with heat that the calibrated scenario does not know of.
"""
