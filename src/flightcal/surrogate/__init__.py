"""Reduced order models of the operational simulator, with a known error."""
