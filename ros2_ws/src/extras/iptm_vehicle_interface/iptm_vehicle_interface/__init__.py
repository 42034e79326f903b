"""A car on a CAN bus in place of the simulated plant, from its signals to the last safety layer."""
