"""Functions that return a check of one statement; see `iptm_reproduction.check`."""
