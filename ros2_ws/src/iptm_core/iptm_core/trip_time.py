"""Trip time: integer nanoseconds between the parts of the suite, seconds in the models."""

NS_PER_S = 1_000_000_000
"""Nanoseconds in a second."""
NS_PER_MS = 1_000_000
"""Nanoseconds in a millisecond."""
