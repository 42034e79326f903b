"""Table of injected faults: expected reports, recovery times and collision checks."""
