"""The full-order operational simulator: networks from geometry, and the on-board software in the loop."""
