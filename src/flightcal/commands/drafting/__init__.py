"""A first scenario for telemetry files, as `flightcal init` writes it."""

from .draft import draft

__all__ = ["draft"]
