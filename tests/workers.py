"""The worker processes of external simulators, which tests do not leave to each other."""

from flightcal.external.in_worker import _IDLE


def close_workers():
    """End all idle workers; a later run starts new ones."""
    while _IDLE:
        _IDLE.pop().close()
