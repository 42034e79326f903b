"""Fitted parameters as YAML, with the data that they were fitted to."""
