"""What every test shares: reproducible property tests that do not judge by the clock."""

from hypothesis import settings

# The same examples in every run, and no deadline: a busy machine must not fail a test.
settings.register_profile("iptm", deadline=None, derandomize=True)
settings.load_profile("iptm")
