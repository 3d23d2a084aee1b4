"""What stands in for a simulator that is too slow to calibrate, and says how far it may be off."""
