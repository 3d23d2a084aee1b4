"""What flightcal is compared with; each solves the very equations of `benchmarks.problem`."""
