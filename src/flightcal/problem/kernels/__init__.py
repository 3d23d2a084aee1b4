"""All of the log density that is compiled, beside the simulator's and probability's kernels, and nothing else."""
