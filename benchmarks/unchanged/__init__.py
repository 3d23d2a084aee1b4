"""Whether a change of the code leaves results as they were: this checkout against another one."""
