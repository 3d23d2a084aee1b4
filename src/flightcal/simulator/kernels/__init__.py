"""All of the simulator that is compiled, and nothing else: only an edit here has it compiled anew."""
